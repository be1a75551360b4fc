"""Local estimates of members that filter their own share of the particles, and the feedback of the fused estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Flow, Local, Member
from wsnsim.trackers.shared.parcels import is_whole, parcel, state_packets
from wsnsim.trackers.shared.spread import Spread
from wsnsim.trackers.shared.stacks import CLOUD, LOG_WEIGHTS, keep, settle

LOCAL: Final = "local"
"""Key of the local estimate in a member's memory."""


class LocalEstimate(NamedTuple):
    """A member's own mean (D,) and covariance (D, D), their operations, and its effective number of particles."""

    mean: Floats
    cov: Floats
    cycles: float
    effective: float = math.nan


local_estimate = partial(tuple.__new__, LocalEstimate)
"""Makes a `LocalEstimate` of its four values; faster than the class, which matters for one a member and step."""


def cycles_of(member: Member) -> float:
    """The operations that the member's local estimate took."""
    estimate: LocalEstimate = member.memory[LOCAL]
    return estimate.cycles


def reported_variances(variances: Floats, masks: Sequence[Bools], packets: int) -> Floats | None:
    """The variances sent (M, D), a lost one taken to be the mean of the others'; None where all are lost.

    The masks are those of reports whose first `packets` packets hold something else.
    """
    known = np.array([is_whole(mask[packets:]) for mask in masks])
    if not known.any():
        return None
    variances = variances.copy()
    variances[~known] = variances[known].mean(axis=0)
    return variances


def feed_back(belief: Spread, scene: Scene) -> Flow[None]:
    """Broadcast the fused estimate: each member that receives it shifts its particles by the error of its own mean."""
    yield Broadcast(parcel(belief.mean, state_packets(belief.mean.size), "feedback"))

    def shift(member: Member) -> None:
        heard = [news.payload for news in settle(member) if news.what == "feedback" and news.mask.all()]
        target = belief.mean if member.id == scene.head else heard[-1] if heard else None
        if target is not None and LOCAL in member.memory and CLOUD in member.memory:
            offset = target - member.memory[LOCAL].mean
            keep(member, member.memory[CLOUD] + offset[:, None], member.memory[LOG_WEIGHTS])

    yield Local(shift, lambda member: float(member.memory[CLOUD].size if CLOUD in member.memory else 0))
