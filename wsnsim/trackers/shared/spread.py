"""The belief of a head whose particles are distributed over its members: two moments, and how many each member holds.

begin(prior, ...) -> Flow[Spread]     only_predicted(belief, deal, scene) -> belief     look(belief, members)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Estimate, Scene
from wsnsim.base.requests import Flow, Gather, Member, Parcel
from wsnsim.trackers.shared.dealing import (
    Deal,
    Pool,
    at_head,
    give,
    no_particles,
    pooled,
    resampled,
    send_all,
    send_moments,
    update_deal,
)
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.parcels import arrived_particles
from wsnsim.trackers.shared.stacks import CLOUD, LOG_WEIGHTS, Shares, keep, present, settle, snapshot

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Spread:
    """Fused mean (D,) and covariance (D, D), of which `within` is one cloud's part; who holds how many particles.

    `shares` are no knowledge of the head: the simulation need not copy the members' particles end to end at each step.
    """

    mean: Floats
    cov: Floats
    within: Floats
    deal: Deal
    head: int
    effective: float = NAN
    shares: Shares = field(default_factory=Shares)


S = TypeVar("S", bound=Spread)


def begin(prior: Estimate, particles: int, by_moments: bool, scene: Scene) -> Flow[Spread]:
    """Draw the particles from the prior at the head and deal them out; paid like a handover's deal-out."""
    nothing = at_head(no_particles(prior.mean.size))
    deal = yield from update_deal(nothing, prior.mean, prior.cov, particles, by_moments, scene)
    return Spread(prior.mean, prior.cov, prior.cov, deal, scene.head)


def hand_on(belief: Spread, collect: Flow[Pool | None] | None, successor: int) -> Flow[Spread | None]:
    """Collect the particles and send them on, N_p + ceil(N_p / 4) + 4 packets; or the moments' 4 alone.

    `collect` brings in what the members hold, and is not asked where nothing was dealt out; None: the moments alone go.
    What is returned is all with the successor, and not yet dealt out; None if nothing reached it.
    """
    if collect is None:
        arrival = yield from send_moments(belief.mean, belief.cov, successor)
    else:
        pool = belief.deal.whole if belief.deal.whole is not None else (yield from collect)
        arrival = yield from send_all(pool or no_particles(belief.mean.size), belief.mean, belief.cov, successor)
    if arrival is None:
        return None
    return Spread(arrival.mean, arrival.cov, arrival.cov, at_head(arrival.pool), successor)


def collected(belief: Spread) -> Flow[Pool | None]:
    """Collect all particles that the members hold, in n packets each."""
    answer = yield Gather(_give_all, tuple(belief.deal.held))
    return pooled([arrived_particles(payload, mask) for payload, mask in answer.values()])


def _give_all(member: Member) -> Parcel | None:
    """All of a member's particles, equally weighted, without weights."""
    member.inbox = settle(member)
    log_weights = member.memory.get(LOG_WEIGHTS, np.empty(0))
    if log_weights.size and np.any(log_weights != log_weights[0]):
        columns = resampled(log_weights, log_weights.size, member.key)
        keep(member, np.take(member.memory[CLOUD], columns, axis=1), np.zeros(log_weights.size))
    return give(member, log_weights.size, common=0.0)


def only_predicted(belief: S, deal: Deal, scene: Scene) -> S:
    """The belief when nothing arrived: the motion's prediction, its covariance grown."""
    mean, cov = predicted(belief.mean, belief.cov, scene)
    within = within_predicted(belief, scene)
    return replace(belief, mean=mean, cov=cov, within=within, deal=deal, head=scene.head, effective=NAN)


def within_predicted(belief: Spread, scene: Scene) -> Floats:
    """(D, D) the last covariance of one cloud that the head knew, grown."""
    return predicted(belief.mean, belief.within, scene)[1]


def look(belief: Spread, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
    """(node, particles (D, n), weights (n,)) of each holder, the weights normalised over the whole set."""
    whole = belief.deal.whole
    if whole is not None:
        return snapshot([(belief.head, whole.cloud, whole.log_weights)])
    return snapshot([(member.id, *present(member, belief.mean.size)) for member in members])
