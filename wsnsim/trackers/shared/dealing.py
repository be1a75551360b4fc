"""Particles that live on the members: how they are dealt out, re-dealt, collected and handed to the next head.

Jiang (2013), eq. (25), and the packets of section 5. A head knows how many particles each member holds, never which,
unless they are on their way through it. How many a member has to give follows from (25), which every member can work
out from the membership that it was told: no packet of its own (our choice).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Compute, Flow, Gather, Local, Member, Parcel, Scatter, Send
from wsnsim.base.rng import uniforms
from wsnsim.kernels.allocation import allocate
from wsnsim.kernels.particles import moments, systematic
from wsnsim.trackers.shared.parcels import (
    MOMENTS,
    arrived_particles,
    guessed,
    moment_packets,
    parcel,
    particles_parcel,
    state_packets,
    weight_packets,
)
from wsnsim.trackers.shared.stacks import (
    CLOUD,
    LOG_WEIGHTS,
    START,
    drawn_from,
    keep,
    propagated,
    propagated_by,
    settle,
    stacked,
)

PREDICT_CYCLES = 40.0
"""To draw or predict (and weigh) one particle, before its readings."""

SMALLEST_CLUSTER = 3
"""Members of the smallest cluster that does not hand over: where a member's share and work are largest (our choice)."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Particles (D, n) in one place, with log-weights (n,)."""

    cloud: Floats
    log_weights: Floats


@dataclass(frozen=True, slots=True)
class Deal:
    """What a head knows of where the particles are.

    `held`: how many each member holds; `dealt`: among whom they were last dealt out. Or `whole`: they are all still at
    the head (a pool of none: only the moments reached it), and nobody holds any.
    """

    held: Mapping[int, int]
    dealt: frozenset[int]
    whole: Pool | None = None

    @property
    def total(self) -> int:
        """How many particles the members hold."""
        return sum(self.held.values())


@dataclass(frozen=True, slots=True)
class Arrival:
    """What of a handover reached the new head: particles, and the moments to go on from."""

    pool: Pool
    mean: Floats
    cov: Floats


def undealt(pool: Pool) -> Deal:
    """All particles at the head."""
    return Deal({}, frozenset(), pool)


def no_particles(columns: int) -> Pool:
    """A pool of none."""
    return Pool(np.empty((columns, 0)), np.empty(0))


def up_to_date(deal: Deal, mean: Floats, cov: Floats, particles: int, by_moments: bool, scene: Scene) -> Flow[Deal]:
    """The deal for this step: dealt out if it was not, re-dealt if other members sense now, made new if all is lost.

    While nobody senses, nothing moves. The dead keep nothing.
    """
    roster = set(scene.roster)
    if not roster.issuperset(deal.held):
        deal = replace(deal, held={node: count for node, count in deal.held.items() if node in roster})
    if deal.whole is None and not deal.total:
        deal = undealt(no_particles(mean.size))
    if not scene.ids:
        return deal
    if deal.whole is not None:
        return (yield from _deal_out(deal.whole, mean, cov, particles, by_moments, scene))
    if scene.joined or scene.left or deal.dealt != frozenset(scene.ids):
        return (yield from redeal(deal, scene))
    return deal


def _deal_out(pool: Pool, mean: Floats, cov: Floats, particles: int, by_moments: bool, scene: Scene) -> Flow[Deal]:
    """Everything from the head to the members: particles without weights, or the four packets they can be drawn from.

    Member i of A gets every A-th particle, so that each has a fair sample of the whole (our choice); as many as (25)
    says.
    """
    if by_moments and not pool.cloud.shape[1]:
        return (yield from _deal_moments(mean, cov, particles, scene))
    cloud = yield from restored(pool, mean, cov, particles, scene.key)
    active = scene.active
    parcels = {}
    for place, node in enumerate(scene.ids):
        share = np.ascontiguousarray(cloud[:, active - 1 - place :: active])
        if share.shape[1]:
            parcels[node] = particles_parcel(share, 0.0)
    held = yield from _delivered(parcels)
    return Deal(held, frozenset(scene.ids))


def _deal_moments(mean: Floats, cov: Floats, particles: int, scene: Scene) -> Flow[Deal]:
    """One broadcast of mean and covariance; every member that hears all of it draws its own share."""
    shares = dict(zip(scene.ids, allocate(particles, scene.active).tolist(), strict=True))
    news = parcel((mean, cov, shares), moment_packets(mean.size), MOMENTS)
    heard = yield Broadcast(news)
    if scene.head in shares:
        heard = heard | (yield Scatter({scene.head: news}))
    held = {node: shares[node] for node, mask in heard.items() if node in shares and mask.all()}
    return Deal(held, frozenset(scene.ids))


def restored(pool: Pool, mean: Floats, cov: Floats, particles: int, key: int) -> Flow[Floats]:
    """(D, particles) equally weighted: the pool as it is, or resampled, or drawn anew from the Gaussian if empty."""
    if not pool.cloud.shape[1]:
        yield Compute(PREDICT_CYCLES * particles)
        return drawn_from(mean, cov, key, particles)
    if pool.cloud.shape[1] == particles and np.all(pool.log_weights == pool.log_weights[0]):
        return pool.cloud
    return np.ascontiguousarray(pool.cloud[:, resampled(pool.log_weights, particles, key)])


def readings_at_most(measurements: str) -> int:
    """How many readings a member of the smallest cluster weighs with: its 'own', or 'all' of them."""
    return 1 if measurements == "own" else SMALLEST_CLUSTER


def resampled(log_weights: Floats, count: int, key: int) -> Ints:
    """(count,) columns, drawn by systematic resampling with a node's key."""
    start = uniforms(np.array([key], np.uint64), START)
    weights = np.ascontiguousarray(log_weights)
    return systematic(weights, np.array([0, weights.size]), np.array([count]), start)


def redeal(deal: Deal, scene: Scene, common: float | None = None) -> Flow[Deal]:
    """Even out the numbers by (25) over those who sense; only particles that move cross the air, by way of the head.

    Their weights go along, unless all particles have the same log-weight `common`.
    """
    target = dict(zip(scene.ids, allocate(deal.total, scene.active).tolist(), strict=True))
    surplus = {node: count - target.get(node, 0) for node, count in deal.held.items() if count > target.get(node, 0)}
    wanted = {node: count - deal.held.get(node, 0) for node, count in target.items() if count > deal.held.get(node, 0)}
    held = {node: count - surplus.get(node, 0) for node, count in deal.held.items()}
    if surplus:
        answer = yield Gather(lambda member: give(member, surplus[member.id], common), tuple(surplus))
        pool = pooled([arrived_particles(payload, mask) for payload, mask in answer.values()])
        if pool is not None:
            received = yield from _delivered(_portions(pool, wanted, common))
            held |= {node: held.get(node, 0) + count for node, count in received.items()}
    return Deal({node: count for node, count in held.items() if count}, frozenset(scene.ids))


def _portions(pool: Pool, wanted: Mapping[int, int], common: float | None) -> dict[int, Parcel]:
    """The pool cut in proportion to what each wants; exactly that if nothing was lost."""
    edges = np.concatenate([[0], np.cumsum(list(wanted.values()))]) * pool.log_weights.size // sum(wanted.values())
    parcels = {}
    for node, first, last in zip(wanted, edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if last > first:
            cloud = np.ascontiguousarray(pool.cloud[:, first:last])
            parcels[node] = particles_parcel(cloud, pool.log_weights[first:last] if common is None else common)
    return parcels


def _delivered(parcels: Mapping[int, Parcel]) -> Flow[dict[int, int]]:
    """Scatter particles; how many reached whom."""
    heard = yield Scatter(parcels)
    return {node: arrived_particles(parcels[node].payload, mask)[1].size for node, mask in heard.items()}


def give(member: Member, count: int, common: float | None = None) -> Parcel | None:
    """The member's last `count` particles (or all it has), which it no longer holds, with weights or a common one."""
    member.inbox = settle(member)
    if CLOUD not in member.memory or not member.memory[CLOUD].shape[1]:
        return None
    cloud, log_weights = member.memory[CLOUD], member.memory[LOG_WEIGHTS]
    rest = max(cloud.shape[1] - count, 0)
    keep(member, cloud[:, :rest], log_weights[:rest])
    return particles_parcel(np.ascontiguousarray(cloud[:, rest:]), log_weights[rest:] if common is None else common)


def pooled(pieces: list[tuple[Floats, Floats]]) -> Pool | None:
    """What arrived, as one; a lost weight becomes the mean of the others. None if nothing did."""
    if not pieces:
        return None
    cloud = np.concatenate([cloud for cloud, _ in pieces], axis=1)
    return Pool(cloud, guessed(np.concatenate([weights for _, weights in pieces])))


def send_all(pool: Pool, mean: Floats, cov: Floats, successor: int) -> Flow[Arrival | None]:
    """Particles, weights, mean and covariance to the next head, n + ceil(n / 4) + 4 packets; what of them arrived."""
    mask = yield Send(successor, handover_parcel(pool, mean, cov))
    return arrival_of(pool, mean, cov, mask)


def handover_parcel(pool: Pool, mean: Floats, cov: Floats) -> Parcel:
    """Particles, then weights, then mean and covariance."""
    count, columns = pool.log_weights.size, mean.size
    packets = count * state_packets(columns) + weight_packets(count) + moment_packets(columns)
    return parcel((pool.cloud, pool.log_weights, mean, cov), packets, "handover")


def arrival_of(pool: Pool, mean: Floats, cov: Floats, mask: Bools) -> Arrival | None:
    """What a new head has of a `handover_parcel`; None if there is nothing to go on from.

    The moments count if they arrived whole; otherwise those of the arrived particles take their place.
    """
    cloud, log_weights = arrived_particles((pool.cloud, pool.log_weights), mask)
    log_weights = guessed(log_weights)
    packets = moment_packets(mean.size)
    if not mask[-packets:].all():
        if not log_weights.size:
            return None
        means, covs = moments(cloud, log_weights, np.array([0, log_weights.size]))
        mean, cov = means[0], covs[0]
    return Arrival(Pool(cloud, log_weights), mean, cov)


def send_moments(mean: Floats, cov: Floats, successor: int) -> Flow[Arrival | None]:
    """Mean and covariance alone, 4 packets: the next head draws its particles from them. None if a packet is lost."""
    mask = yield Send(successor, parcel((mean, cov), moment_packets(mean.size), "handover"))
    return Arrival(no_particles(mean.size), mean, cov) if mask.all() else None


def predict_only(deal: Deal, scene: Scene) -> Flow[Deal]:
    """Every particle a step on where it is, on the head or on the members, since there is nothing to weigh it with."""
    if deal.whole is not None:
        yield Compute(PREDICT_CYCLES * scene.steps * deal.whole.log_weights.size)
        cloud = propagated_by(scene.key, deal.whole.cloud, scene)[1]
        return replace(deal, whole=replace(deal.whole, cloud=cloud))

    def predict(members: list[Member]) -> None:
        stack, _ = stacked(members, len(scene.motion.columns))
        stack.cloud = propagated(stack.cloud, stack.offsets, stack.keys, scene)[1]
        stack.store(members)

    def cycles(member: Member) -> float:
        return PREDICT_CYCLES * scene.steps * int(member.memory[CLOUD].shape[1])

    yield Local(lambda member: predict([member]), cycles, predict, tuple(deal.held))
    return deal
