"""Particles that live on the members: how they are dealt out, re-dealt, collected and handed to the next head.

Jiang (2013), eq. (25), and the packets of section 5. A head knows how many particles each member holds, but not
their values, unless it relays them. Every member knows the membership and computes from (25) how many particles it has
to give, so that no packet is needed for it (our choice).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Compute, Flow, Gather, Local, Member, Parcel, Scatter, Send
from wsnsim.base.rng import uniforms
from wsnsim.kernels.particles import allocate, moments, systematic
from wsnsim.trackers.shared.readings import (
    MOMENTS,
    arrived_particles,
    guessed,
    moment_packets,
    number_packets,
    parcel,
    particles_parcel,
    state_packets,
)
from wsnsim.trackers.shared.stacks import (
    CLOUD,
    LOG_WEIGHTS,
    START,
    Shares,
    drawn_from,
    keep,
    propagated,
    propagated_by,
    settle,
)

PREDICT_CYCLES = 40.0
"""CPU cycles to draw or predict (and weigh) one particle, readings excluded."""

SMALLEST_CLUSTER = 3
"""Members of the smallest cluster that does not hand over. A member's share and work are largest there (our choice)."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Particles in one place.

    Attributes:
        cloud: (D, n) the particles.
        log_weights: (n,) logarithms of their weights, which need not be normalised.
    """

    cloud: Floats
    log_weights: Floats


@dataclass(frozen=True, slots=True)
class Deal:
    """What a head knows about where the particles are.

    Attributes:
        held: the number of particles that each member holds.
        dealt: the members to which particles were dealt last.
        whole: all particles, while they are at the head and no member holds any; empty if only moments reached it.
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
    """The part of a handover that reached the new head.

    Attributes:
        pool: the particles; none if only moments were sent.
        mean: (D,) with which the new head continues.
        cov: (D, D) its covariance.
    """

    pool: Pool
    mean: Floats
    cov: Floats


def at_head(pool: Pool) -> Deal:
    """A deal with all particles at the head."""
    return Deal({}, frozenset(), pool)


def no_particles(columns: int) -> Pool:
    """An empty pool."""
    return Pool(np.empty((columns, 0)), np.empty(0))


def update_deal(deal: Deal, mean: Floats, cov: Floats, particles: int, by_moments: bool, scene: Scene) -> Flow[Deal]:
    """Deal out particles that are at the head, re-deal them if other members sense now, draw new ones if all are lost.

    Return the deal for this step. While no node senses, no particle is sent. Dead members lose their particles.
    """
    roster = set(scene.roster)
    if not roster.issuperset(deal.held):
        deal = replace(deal, held={node: count for node, count in deal.held.items() if node in roster})
    if deal.whole is None and not deal.total:
        deal = at_head(no_particles(mean.size))
    if not scene.ids:
        return deal
    if deal.whole is not None:
        return (yield from _deal_out(deal.whole, mean, cov, particles, by_moments, scene))
    if scene.joined or scene.left or deal.dealt != frozenset(scene.ids):
        return (yield from redeal(deal, scene))
    return deal


def _deal_out(pool: Pool, mean: Floats, cov: Floats, particles: int, by_moments: bool, scene: Scene) -> Flow[Deal]:
    """Send all particles from the head to the members, without weights, or the four packets to draw them from.

    Member i of A gets every A-th particle, so that each has a fair sample of the whole (our choice), and their numbers
    are those of (25).
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
    """Broadcast mean and covariance; every member that receives all of it draws its own share."""
    shares = dict(zip(scene.ids, allocate(particles, scene.active).tolist(), strict=True))
    message = parcel((mean, cov, shares), moment_packets(mean.size), MOMENTS)
    heard = yield Broadcast(message)
    if scene.head in shares:
        heard = heard | (yield Scatter({scene.head: message}))
    held = {node: shares[node] for node, mask in heard.items() if node in shares and mask.all()}
    return Deal(held, frozenset(scene.ids))


def restored(pool: Pool, mean: Floats, cov: Floats, particles: int, key: int) -> Flow[Floats]:
    """Particles (D, particles) of equal weight: the pool as it is, resampled, or drawn from the Gaussian if empty."""
    if not pool.cloud.shape[1]:
        yield Compute(PREDICT_CYCLES * particles)
        return drawn_from(mean, cov, key, particles)
    if pool.cloud.shape[1] == particles and np.all(pool.log_weights == pool.log_weights[0]):
        return pool.cloud
    return np.ascontiguousarray(pool.cloud[:, resampled(pool.log_weights, particles, key)])


def most_readings(measurements: str) -> int:
    """The number of readings by which a member of the smallest cluster weighs: its 'own', or 'all'."""
    return 1 if measurements == "own" else SMALLEST_CLUSTER


def resampled(log_weights: Floats, count: int, key: int) -> Ints:
    """Column numbers (count,), drawn by systematic resampling with a node's key."""
    start = uniforms(np.array([key], np.uint64), START)
    weights = np.ascontiguousarray(log_weights)
    return systematic(weights, np.array([0, weights.size]), np.array([count]), start)


def redeal(deal: Deal, scene: Scene, common: float | None = None) -> Flow[Deal]:
    """Move surplus particles through the head, so that each member that senses holds as many as (25) says.

    Their weights are sent with them, unless all particles have the same log-weight `common`.
    """
    target = dict(zip(scene.ids, allocate(deal.total, scene.active).tolist(), strict=True))
    surplus = {node: count - target.get(node, 0) for node, count in deal.held.items() if count > target.get(node, 0)}
    wanted = {node: count - deal.held.get(node, 0) for node, count in target.items() if count > deal.held.get(node, 0)}
    held = {node: count - surplus.get(node, 0) for node, count in deal.held.items()}
    if surplus:
        reply = yield Gather(lambda member: give(member, surplus[member.id], common), tuple(surplus))
        pool = pooled([arrived_particles(payload, mask) for payload, mask in reply.values()])
        if pool is not None:
            received = yield from _delivered(_portions(pool, wanted, common))
            held |= {node: held.get(node, 0) + count for node, count in received.items()}
    return Deal({node: count for node, count in held.items() if count}, frozenset(scene.ids))


def _portions(pool: Pool, wanted: Mapping[int, int], common: float | None) -> dict[int, Parcel]:
    """Divide the pool in proportion to the numbers wanted; each member gets its number if no particle was lost."""
    count, total = pool.log_weights.size, sum(wanted.values())
    edges = pairwise([edge * count // total for edge in accumulate(wanted.values(), initial=0)])
    parcels = {}
    for node, (first, last) in zip(wanted, edges, strict=True):
        if last > first:
            cloud = np.ascontiguousarray(pool.cloud[:, first:last])
            parcels[node] = particles_parcel(cloud, pool.log_weights[first:last] if common is None else common)
    return parcels


def _delivered(parcels: Mapping[int, Parcel]) -> Flow[dict[int, int]]:
    """Scatter particles; return the number that reached each member."""
    heard = yield Scatter(parcels)
    return {node: arrived_particles(parcels[node].payload, mask)[1].size for node, mask in heard.items()}


def give(member: Member, count: int, common: float | None = None) -> Parcel | None:
    """Remove the last `count` particles (or all) from the member; return them with weights or a common one."""
    member.inbox = settle(member)
    if CLOUD not in member.memory or not member.memory[CLOUD].shape[1]:
        return None
    cloud, log_weights = member.memory[CLOUD], member.memory[LOG_WEIGHTS]
    rest = max(cloud.shape[1] - count, 0)
    keep(member, cloud[:, :rest], log_weights[:rest])
    return particles_parcel(np.ascontiguousarray(cloud[:, rest:]), log_weights[rest:] if common is None else common)


def pooled(pieces: list[tuple[Floats, Floats]]) -> Pool | None:
    """The arrived particles as one pool, None without any; a lost weight becomes the mean of the others."""
    if not pieces:
        return None
    cloud = np.concatenate([cloud for cloud, _ in pieces], axis=1)
    return Pool(cloud, guessed(np.concatenate([weights for _, weights in pieces])))


def send_all(pool: Pool, mean: Floats, cov: Floats, successor: int) -> Flow[Arrival | None]:
    """Send particles, weights and moments to the next head, n + ceil(n / 4) + 4 packets; return what arrived."""
    mask = yield Send(successor, handover_parcel(pool, mean, cov))
    return arrival_of(pool, mean, cov, mask)


def handover_parcel(pool: Pool, mean: Floats, cov: Floats) -> Parcel:
    """The parcel of a handover: particles, then weights, then mean and covariance."""
    count, columns = pool.log_weights.size, mean.size
    packets = count * state_packets(columns) + number_packets(count) + moment_packets(columns)
    return parcel((pool.cloud, pool.log_weights, mean, cov), packets, "handover")


def arrival_of(pool: Pool, mean: Floats, cov: Floats, mask: Bools) -> Arrival | None:
    """What a new head received of a `handover_parcel`; None if it cannot continue with that.

    Moments that arrived incomplete are replaced by those of the arrived particles.
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
    """Send mean and covariance alone, for the next head to draw particles from. None if a packet is lost.

    It is a flow: `arrival = yield from send_moments(belief.mean, belief.cov, successor)`. For four state columns it
    sends 4 packets.

    Args:
        mean: (D,).
        cov: (D, D).
        successor: The id of the next head.
    """
    mask = yield Send(successor, parcel((mean, cov), moment_packets(mean.size), "handover"))
    return Arrival(no_particles(mean.size), mean, cov) if mask.all() else None


def predict_only(deal: Deal, shares: Shares, scene: Scene) -> Flow[Deal]:
    """Predict every particle where it is, on the head or on the members, without readings to weigh it by."""
    if deal.whole is not None:
        yield Compute(PREDICT_CYCLES * scene.steps * deal.whole.log_weights.size)
        cloud = propagated_by(scene.key, deal.whole.cloud, scene)[1]
        return replace(deal, whole=replace(deal.whole, cloud=cloud))

    def predict(members: list[Member]) -> None:
        stack, _ = shares.stacked(members, len(scene.motion.columns))
        stack.cloud = propagated(stack.cloud, stack.offsets, stack.keys, scene)[1]
        shares.store(stack)

    def cycles(member: Member) -> float:
        return PREDICT_CYCLES * scene.steps * int(member.memory[CLOUD].shape[1])

    yield Local(lambda member: predict([member]), cycles, predict, tuple(deal.held))
    return deal
