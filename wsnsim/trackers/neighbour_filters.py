"""Filters without a head whose participants exchange readings and estimates with their neighbours alone, once a step.

Local: predict  Exchange: information  Local: update  Exchange: estimate  Local: combine     a step of diffusion
Local: predict  Exchange: prediction, information  Local: update                    a step of Kalman consensus
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Exchange, Flow, Local, Member, Parcel
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.peers import (
    COV,
    MEAN,
    NEWS,
    PeerFilter,
    inversion_cycles,
    news_of,
    received,
    update,
    updated,
)
from wsnsim.trackers.shared.readings import number_packets, parcel

READ, ESTIMATED = "information", "estimate"
COPIES, SENDS = "copies", "sends"
"""In a member's memory: {node: (mean (D,), step)} of what participants sent last, itself included; whether it sends."""


@part
class DiffusionFilter(PeerFilter):
    """Diffusion Kalman filter: an update with the readings of all neighbours, then the mean of their estimates.

    Each participant weighs its own estimate and those of its n neighbours that arrive equally, by 1 / (1 + n): the
    simplest of the weights that the paper admits. A participant without a reading sends nothing in the first round.
    The covariance of the update is kept, and is not that of the mean.

    With a `threshold` sending is triggered by events. A participant sends its reading only if that would move its own
    estimate of the position by more; and its estimate only if that is farther from where its neighbours predict it, by
    the one that it sent last, or if that is `heartbeat` steps old. They go on with their prediction, and forget one
    that is older. Silence about readings is ignored: neighbours do not share one estimate.

    Source: Cattivelli, Sayed (2010), the diffusion Kalman filter in information form; for what is sent at events,
    Battistelli, Chisci, Gao, Selvi (2019), who compare whole beliefs.
    """

    has_covariance: ClassVar[bool] = False

    threshold: Annotated[float, Quantity("m", ge=0), "shift of the position up to which nothing is sent; 0: always"] = (
        0.0
    )
    heartbeat: Annotated[int, Quantity("", ge=1, le=10_000), "steps after which an estimate is sent in any case"] = 10

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a heartbeat of estimates that are sent at each step."""
        if not self.threshold and self.heartbeat != type(self).heartbeat:
            yield Issue(
                ("tracker", "heartbeat"), "without a threshold every estimate is sent: give one, or leave this out"
            )

    def fused(self, scene: Scene) -> Flow[None]:
        """Two rounds: the incremental update and the diffusion update."""
        size = len(scene.motion.columns)
        yield Exchange(partial(_information, scene=scene, threshold=self.threshold))
        yield Local(partial(_update, scene=scene), partial(_update_cycles, size=size, decides=self.threshold > 0.0))
        if self.threshold:
            yield Local(partial(self._decide, scene=scene), partial(_copies_cycles, size=size))
        yield Exchange(_estimate)
        yield Local(partial(self._combine, scene=scene), 2.0 * size)

    def _decide(self, member: Member, scene: Scene) -> None:
        """Predict what neighbours were sent, and what they sent; remember whether the estimate is news to them."""
        memory, place = member.memory, list(scene.motion.position)
        copies = memory.setdefault(COPIES, {})
        for node, (mean, step) in list(copies.items()):
            if scene.step - step >= self.heartbeat:
                del copies[node]
            else:
                copies[node] = _moved(mean, scene), step
        own = copies.get(member.id)
        far = own is None or np.linalg.norm((memory[MEAN] - own[0])[place]) > self.threshold
        memory[SENDS] = bool(far)
        if memory[SENDS]:
            copies[member.id] = memory[MEAN].copy(), scene.step

    def _combine(self, member: Member, scene: Scene) -> None:
        """Take the mean of the own estimate and of those that neighbours sent now, or that are known of them."""
        known = member.memory[COPIES] if self.threshold else {}
        known |= {node: (mean, scene.step) for node, mean in received(member, ESTIMATED)}
        means = [member.memory[MEAN], *(mean for node, (mean, _) in sorted(known.items()) if node != member.id)]
        member.memory[MEAN] = sum(means) / len(means)


def _moved(mean: Floats, scene: Scene) -> Floats:
    """A mean (D,) of the step before, moved to the scene's."""
    states = mean[:, None]
    for passed in range(scene.steps):
        states = scene.motion.advance(states, scene.dt, scene.since + passed * scene.dt)
    return states[:, 0]


def _information(member: Member, scene: Scene, threshold: float) -> Parcel | None:
    news = member.memory.get(NEWS)
    if news is None or (threshold and _shift(member, scene, news) <= threshold):
        return None
    return parcel(news, number_packets(news.size), READ)


def _shift(member: Member, scene: Scene, news: Floats) -> float:
    """How far (m) a reading moves the estimate of the position of the member that took it."""
    mean, _ = updated(member, scene, news)
    return float(np.linalg.norm((mean - member.memory[MEAN])[list(scene.motion.position)]))


def _update(member: Member, scene: Scene) -> None:
    update(member, scene, sum((news for _, news in received(member, READ)), news_of(member, scene)))


def _update_cycles(member: Member, size: int, decides: bool) -> float:
    """Operations of the update, and of that with the own reading alone by which a member decides whether to send it."""
    updates = 2.0 if decides and NEWS in member.memory else 1.0
    return updates * (2.0 * inversion_cycles(size) + 4.0 * size**2)


def _copies_cycles(member: Member, size: int) -> float:
    """Operations to predict what neighbours sent, linearly."""
    return 2.0 * size**2 * len(member.memory[COPIES])


def _estimate(member: Member) -> Parcel | None:
    if not member.memory.get(SENDS, True):
        return None
    mean = member.memory[MEAN].copy()
    return parcel(mean, number_packets(mean.size), ESTIMATED)


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
