"""The clouds of a cluster's members laid end to end, so that one kernel call serves them all.

    stack, heard = stacked(members, columns)   take what each member holds
    stack.store(members)                       give it back, as views

A member's particles are `memory["cloud"]` (D, n) and `memory["log_weights"]` (n,). What a kernel does to one member's
columns depends on that member's columns, key and readings alone; tests prove that a stack of one gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Delivery, Member
from wsnsim.base.rng import uniforms
from wsnsim.kernels.gaussian import cholesky
from wsnsim.kernels.noise import particle_keys
from wsnsim.trackers.shared.parcels import MOMENTS, PARTICLES, arrived_particles, guessed, is_whole
from wsnsim.trackers.shared.readings import Evidence, evidence_at

CLOUD, LOG_WEIGHTS = "cloud", "log_weights"
DRAW, MOVE, START, PREDICT = 0, 1, 2, 16
"""What a node's key of a step serves: particle keys to draw, to move and to predict with (PREDICT + s over step s),
and the START-th draw of the key itself for the first tooth of a systematic resampling."""


class Layout(NamedTuple):
    """How many columns each segment has (M,), where they begin and the last ends (M + 1,), whose each is (N,)."""

    counts: Ints
    offsets: Ints
    owners: Ints


@lru_cache(maxsize=1024)
def layout(counts: tuple[int, ...]) -> Layout:
    """The layout of segments of these lengths. Looked up rather than made: it changes with the membership only."""
    sizes = np.array(counts, np.int64)
    offsets = np.zeros(sizes.size + 1, np.int64)
    sizes.cumsum(out=offsets[1:])
    return Layout(sizes, offsets, np.arange(sizes.size).repeat(sizes))


@dataclass(slots=True)
class Stack:
    """Particles (D, N) with log-weights (N,), member m's as segment m of the layout; and the members' keys (M,)."""

    cloud: Floats
    log_weights: Floats
    layout: Layout
    keys: Keys

    @property
    def counts(self) -> Ints:
        """(M,) how many particles each member has."""
        return self.layout.counts

    @property
    def offsets(self) -> Ints:
        """(M + 1,) the column where each member's begin, and the last one's end."""
        return self.layout.offsets

    def store(self, members: Sequence[Member]) -> None:
        """Write each member's columns back to its memory."""
        cloud, log_weights = self.cloud, self.log_weights
        first = 0
        for member, last in zip(members, self.layout.offsets[1:].tolist(), strict=True):
            memory = member.memory
            memory[CLOUD] = cloud[:, first:last]
            memory[LOG_WEIGHTS] = log_weights[first:last]
            first = last


def stacked(members: Sequence[Member], columns: int) -> tuple[Stack, list[list[Delivery]]]:
    """The members' particles, those in their inboxes included, and the other deliveries of each member."""
    heard = [settle(member) if member.inbox else [] for member in members]
    held = [member.memory if CLOUD in member.memory else _nothing(columns) for member in members]
    clouds = [memory[CLOUD] for memory in held]
    keys = np.array([member.key for member in members], np.uint64)
    cloud = np.concatenate(clouds, axis=1) if len(clouds) > 1 else np.ascontiguousarray(clouds[0])
    log_weights = np.concatenate([memory[LOG_WEIGHTS] for memory in held])
    return Stack(cloud, log_weights, layout(tuple([cloud.shape[1] for cloud in clouds])), keys), heard


def _nothing(columns: int) -> dict[str, Floats]:
    return {CLOUD: np.empty((columns, 0)), LOG_WEIGHTS: np.empty(0)}


def settle(member: Member) -> list[Delivery]:
    """Take dealt particles from the inbox into memory, or draw the share that dealt moments ask for; give the rest.

    Moments count if all of their packets arrived; the share is drawn with the member's own key.
    """
    rest = []
    for delivery in member.take_inbox():
        if delivery.what == PARTICLES:
            cloud, log_weights = held_with(member, *arrived_particles(delivery.payload, delivery.mask))
            keep(member, cloud, log_weights if is_whole(delivery.mask) else guessed(log_weights))
        elif delivery.what == MOMENTS:
            mean, cov, shares = delivery.payload
            if delivery.mask.all() and member.id in shares:
                drawn = drawn_from(mean, cov, member.key, shares[member.id])
                keep(member, *held_with(member, drawn, np.zeros(drawn.shape[1])))
        else:
            rest.append(delivery)
    return rest


def held_with(member: Member, cloud: Floats, log_weights: Floats) -> tuple[Floats, Floats]:
    """The member's particles together with these."""
    if CLOUD in member.memory:
        cloud = np.concatenate([member.memory[CLOUD], cloud], axis=1)
        log_weights = np.concatenate([member.memory[LOG_WEIGHTS], log_weights])
    return cloud, log_weights


def keep(member: Member, cloud: Floats, log_weights: Floats) -> None:
    """Replace the member's particles."""
    member.memory[CLOUD] = cloud
    member.memory[LOG_WEIGHTS] = log_weights


def present(member: Member, columns: int) -> tuple[Floats, Floats]:
    """The particles and log-weights that the member holds, its inbox included; nothing is changed."""
    twin = replace(member, inbox=list(member.inbox), memory=dict(member.memory))
    settle(twin)
    return twin.memory.get(CLOUD, np.empty((columns, 0))), twin.memory.get(LOG_WEIGHTS, np.empty(0))


def snapshot(pieces: Iterable[tuple[int, Floats, Floats]]) -> Iterator[tuple[int, Floats, Floats]]:
    """(node, particles (D, n), weights (n,)) from log-weights, normalised over all pieces; empty ones are left out."""
    holding = [piece for piece in pieces if piece[2].size]
    top = max((log_weights.max() for _, _, log_weights in holding), default=0.0)
    total = sum(np.exp(log_weights - top).sum() for _, _, log_weights in holding)
    for node, cloud, log_weights in holding:
        yield node, cloud.copy(), np.exp(log_weights - top) / total


def drawn_from(mean: Floats, cov: Floats, key: int, count: int) -> Floats:
    """(D, count) particles from a Gaussian, by a node's key.

    Components 2p and 2p + 1 take the p-th Box-Muller pair of a particle's key. Plain NumPy: it is called a few times a
    run, which is too rarely to be worth compiling.
    """
    keys = particle_keys(np.array([key], np.uint64), np.array([0, count]), DRAW)
    factor, white = np.zeros(cov.shape), np.empty((mean.size + 1, count))
    cholesky(np.ascontiguousarray(cov), factor)
    for component in range(0, mean.size, 2):
        radius = np.sqrt(-2.0 * np.log1p(-uniforms(keys, component)))
        turn = 2.0 * np.pi * uniforms(keys, component + 1)
        white[component], white[component + 1] = radius * np.cos(turn), radius * np.sin(turn)
    return mean[:, None] + factor @ white[: mean.size]


def propagated(cloud: Floats, offsets: Ints, keys: Keys, scene: Scene) -> tuple[Floats, Floats]:
    """The particles (D, N) one step ago and now, after all model steps since the belief's time. Eq. (12)."""
    before = cloud
    for step in range(scene.steps):
        before = cloud
        now = scene.since + step * scene.dt
        cloud = scene.motion.propagate(before, scene.dt, particle_keys(keys, offsets, PREDICT + step), now)
    return before, cloud


def propagated_by(key: int, cloud: Floats, scene: Scene) -> tuple[Floats, Floats]:
    """As `propagated`, for the particles of one node."""
    return propagated(cloud, np.array([0, cloud.shape[1]]), np.array([key], np.uint64), scene)


Score: TypeAlias = Callable[[Floats], Floats]
"""(D, N) particles → (N,) log-likelihoods."""


@dataclass(frozen=True, slots=True)
class OwnReadings:
    """Likelihood of stacked particles if each node uses only its own measurement."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: Evidence

    @classmethod
    def of(cls, members: Sequence[Member], scene: Scene) -> OwnReadings:
        """From the members' own readings; a missing one is not a number, and so is every likelihood with it."""
        values = np.array([np.nan if member.reading is None else member.reading for member in members])
        ids = tuple([member.id for member in members])
        if ids == scene.ids:
            return cls(scene.sensor, place_of(scene), Evidence(ids, values, scene.positions, scene.traits))
        positions = np.concatenate([member.position for member in members]).reshape(len(members), -1)
        traits = np.concatenate([member.traits for member in members]).reshape(len(members), -1)
        return cls(scene.sensor, place_of(scene), Evidence(ids, values, positions, traits))

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [1] * len(self.evidence.ids)

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's."""
        sensor, place, seen, owners = self.sensor, self.place, self.evidence, stack.layout.owners
        readings, positions, traits = seen.readings, seen.positions, seen.traits
        return lambda cloud: sensor.log_likelihood(cloud[place], readings, positions, traits, owners)


@dataclass(frozen=True, slots=True)
class SharedReadings:
    """Likelihood of stacked particles if each node uses the measurements of several nodes."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: list[Evidence]

    @classmethod
    def of(cls, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene) -> SharedReadings:
        """From what the members heard of the broadcast, and their own readings."""
        evidence = [evidence_at(member, news) for member, news in zip(members, heard, strict=True)]
        return cls(scene.sensor, place_of(scene), evidence)

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [len(seen.ids) for seen in self.evidence]

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's; one call where all members have the same readings."""
        first = self.evidence[0]
        if all(seen is first for seen in self.evidence):
            return lambda cloud: self._of(cloud[self.place], first)
        cuts = stack.offsets.tolist()
        return lambda cloud: self._piecewise(cloud[self.place], cuts)

    def _piecewise(self, points: Floats, cuts: list[int]) -> Floats:
        segments = zip(self.evidence, pairwise(cuts), strict=True)
        return np.concatenate(
            [self._of(np.ascontiguousarray(points[:, first:last]), seen) for seen, (first, last) in segments]
        )

    def _of(self, points: Floats, seen: Evidence) -> Floats:
        return self.sensor.log_likelihood(points, seen.readings, seen.positions, seen.traits)


def place_of(scene: Scene) -> slice | list[int]:
    """Which rows of a cloud are the position; as a slice where they can be, which copies nothing."""
    first, *more = scene.motion.position
    if not more:
        return slice(first, first + 1)
    return slice(first, more[0] + 1, more[0] - first) if more[0] > first else [first, *more]


def likelihood_of(
    measurements: str, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene
) -> OwnReadings | SharedReadings:
    """The likelihood that members use: of their 'own' measurements, or of 'all' that they received."""
    if measurements == "own":
        return OwnReadings.of(members, scene)
    return SharedReadings.of(members, heard, scene)
