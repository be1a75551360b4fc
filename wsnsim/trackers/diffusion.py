"""The diffusion Kalman filter: neighbours exchange the information of readings, then the estimates that follow.

Local: predict  Exchange: information  Local: update  Exchange: estimate  Local: combine     the requests of a step
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from wsnsim.base.part import part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Exchange, Flow, Local, Member, Parcel
from wsnsim.trackers.shared.peers import (
    MEAN,
    NEWS,
    PeerFilter,
    inversion_cycles,
    news_of,
    number_packets,
    received,
    update,
)
from wsnsim.trackers.shared.readings import parcel

READ, ESTIMATED = "information", "estimate"


@part
class DiffusionFilter(PeerFilter):
    """Diffusion Kalman filter: an update with the readings of all neighbours, then the mean of their estimates.

    Each participant weighs its own estimate and those of its n neighbours that arrive equally, by 1 / (1 + n): the
    simplest of the weights that the paper admits. A participant without a reading sends nothing in the first round.
    The covariance of the update is kept, and is not that of the mean.

    Source: Cattivelli, Sayed (2010), the diffusion Kalman filter in information form.
    """

    has_covariance: ClassVar[bool] = False

    def fused(self, scene: Scene) -> Flow[None]:
        """Two rounds: the incremental update and the diffusion update."""
        size = len(scene.motion.columns)
        yield Exchange(_information)
        yield Local(partial(_update, scene=scene), 2.0 * inversion_cycles(size) + 4.0 * size**2)
        yield Exchange(_estimate)
        yield Local(_combine, 2.0 * size)


def _information(member: Member) -> Parcel | None:
    news = member.memory.get(NEWS)
    return None if news is None else parcel(news, number_packets(news.size), READ)


def _update(member: Member, scene: Scene) -> None:
    update(member, scene, sum((news for _, news in received(member, READ)), news_of(member, scene)))


def _estimate(member: Member) -> Parcel:
    mean = member.memory[MEAN].copy()
    return parcel(mean, number_packets(mean.size), ESTIMATED)


def _combine(member: Member) -> None:
    means = [member.memory[MEAN], *(mean for _, mean in received(member, ESTIMATED))]
    member.memory[MEAN] = sum(means) / len(means)
