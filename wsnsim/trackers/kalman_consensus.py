"""The Kalman consensus filter: neighbours exchange predictions and the information of their readings, once a step.

Local: predict  Exchange: prediction and information  Local: update          the requests of a step
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Exchange, Flow, Local, Member, Parcel
from wsnsim.trackers.shared.peers import (
    COV,
    MEAN,
    NEWS,
    PeerFilter,
    inversion_cycles,
    news_of,
    received,
    update,
)
from wsnsim.trackers.shared.readings import number_packets, parcel

SENT = "prediction"


@part
class KalmanConsensus(PeerFilter):
    """Kalman consensus filter: an update with the readings of all neighbours, pulled towards their predictions.

    x⁺ = x + M (y - S x) + γ P Σ_j (x_j - x) with M = (P⁻¹ + S)⁻¹, the sums y and S of the information of its own
    and its neighbours' readings, and γ = ε / (1 + ‖P‖) by the Frobenius norm. A participant without a reading sends
    its prediction alone. M is taken for the covariance and is not that of x⁺: it knows nothing of the consensus term,
    nor of what predictions have in common.

    Source: Olfati-Saber (2009), eq. 20, with the neighbours' readings fused in information form.
    """

    has_covariance: ClassVar[bool] = False

    pull: Annotated[float, Quantity("", ge=0, le=1), "ε: towards the predictions of neighbours"] = 0.05

    def fused(self, scene: Scene) -> Flow[None]:
        """One round."""
        size = len(scene.motion.columns)
        yield Exchange(_message)
        yield Local(partial(self._update, scene=scene), 2.0 * inversion_cycles(size) + 6.0 * size**2)

    def _update(self, member: Member, scene: Scene) -> None:
        mean, cov = member.memory[MEAN], member.memory[COV]
        heard = [payload for _, payload in received(member, SENT)]
        rate = self.pull / (1.0 + float(np.linalg.norm(cov)))
        pulled = rate * (cov @ sum((other - mean for other, _ in heard), np.zeros(mean.size)))
        update(member, scene, sum((news for _, news in heard if news is not None), news_of(member, scene)))
        member.memory[MEAN] += pulled


def _message(member: Member) -> Parcel:
    mean, news = member.memory[MEAN], member.memory.get(NEWS)
    numbers = mean.size + (0 if news is None else news.size)
    return parcel((mean.copy(), news), number_packets(numbers), SENT)
