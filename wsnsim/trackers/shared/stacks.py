"""The clouds of a cluster's members laid end to end, so that one kernel call serves them all.

    stack, heard = shares.stacked(members, columns)     what the members hold
    shares.store(stack)                                 what they hold from now on

A member's particles are `memory["cloud"]` (D, n) and `memory["log_weights"]` (n,). What a kernel does to one member's
columns depends on that member's columns, key and readings alone; tests prove that a stack of one gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from operator import is_
from typing import NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Delivery, Member
from wsnsim.base.rng import uniforms
from wsnsim.kernels.elementary import particle_keys
from wsnsim.kernels.gaussian import cholesky
from wsnsim.trackers.shared.readings import MOMENTS, PARTICLES, arrived_particles, guessed, is_whole

CLOUD, LOG_WEIGHTS = "cloud", "log_weights"
DRAW, MOVE, START, PREDICT = 0, 1, 2, 16
"""What a node's key of a step serves: particle keys to draw, to move and to predict with (PREDICT + s over step s),
and the START-th draw of the key itself for the first tooth of a systematic resampling."""


class Layout(NamedTuple):
    """How many columns each segment has (M,), where they begin and the last ends (M + 1,), whose each is (N,).

    `log_counts` (M,) are the logs of the numbers of columns, 0 for an empty segment.
    """

    counts: Ints
    offsets: Ints
    owners: Ints
    log_counts: Floats


@lru_cache(maxsize=1024)
def layout(counts: tuple[int, ...]) -> Layout:
    """The layout of segments of these lengths. Looked up rather than made: it changes with the membership only."""
    sizes = np.array(counts, np.int64)
    offsets = np.zeros(sizes.size + 1, np.int64)
    sizes.cumsum(out=offsets[1:])
    return Layout(sizes, offsets, np.arange(sizes.size).repeat(sizes), np.log(np.maximum(sizes, 1)))


class Chosen(NamedTuple):
    """Some of the members of a stack: their numbers in it (m,), and the numbers of their columns (n,)."""

    rows: Ints
    columns: Ints


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

    def chosen(self, which: Bools) -> Chosen:
        """The members that `which` (M,) names."""
        return Chosen(which.nonzero()[0], which[self.layout.owners].nonzero()[0])

    def part(self, chosen: Chosen) -> Stack:
        """A stack of some of the members; copied."""
        rows, columns = chosen
        return Stack(
            self.cloud.take(columns, axis=1),
            self.log_weights.take(columns),
            layout(tuple(self.counts.take(rows).tolist())),
            self.keys.take(rows),
        )

    def put(self, part: Stack, chosen: Chosen) -> None:
        """Write back a stack of some of the members."""
        self.cloud[:, chosen.columns] = part.cloud
        self.log_weights[chosen.columns] = part.log_weights


class Shares:
    """The particles of a cluster's members, which stay laid end to end from one step to the next.

    What a member holds are views of its own columns. A step writes into the columns, so that nothing needs to be copied
    or handed back. Whether they still lie end to end is decided by the members' memories alone: where one holds another
    array than the view that it was given, all are copied end to end again.
    """

    __slots__ = ("_cloud", "_clouds", "_layout", "_log_weights", "_weights")

    def __init__(self) -> None:
        self._clouds: list[Floats] = []
        self._weights: list[Floats] = []
        self._cloud = self._log_weights = np.empty((0, 0))
        self._layout = layout(())

    def stacked(self, members: Sequence[Member], columns: int) -> tuple[Stack, list[list[Delivery]]]:
        """The members' particles, those in their inboxes included, and the other deliveries of each member.

        Kernels may write into the arrays of the stack.
        """
        gifts = {
            row: [arrived_particles(each.payload, each.mask) for each in member.take_inbox()]
            for row, member in enumerate(members)
            if member.inbox and all(each.what == PARTICLES and is_whole(each.mask) for each in member.inbox)
        }
        heard = [settle(member) if member.inbox else [] for member in members]
        clouds = [member.memory.get(CLOUD) for member in members]
        weights = [member.memory.get(LOG_WEIGHTS) for member in members]
        keys = np.array([member.key for member in members], np.uint64)
        if gifts or not _same(clouds, self._clouds) or not _same(weights, self._weights):
            nothing = np.empty((columns, 0)), np.empty(0)
            held = zip(clouds, weights, strict=True)
            self._lay([
                [nothing if cloud is None or own is None else (cloud, own), *gifts.get(row, ())]
                for row, (cloud, own) in enumerate(held)
            ])  # fmt: skip
            self._hand_out(members)
        return Stack(self._cloud, self._log_weights, self._layout, keys), heard

    def store(self, stack: Stack) -> None:
        """Take over the particles of the stack that was given out last, if they are in arrays of their own."""
        if stack.cloud is not self._cloud:
            self._cloud[:] = stack.cloud
        if stack.log_weights is not self._log_weights:
            self._log_weights[:] = stack.log_weights

    def _lay(self, pieces: list[list[tuple[Floats, Floats]]]) -> None:
        """Copy the pieces of each member's particles and log-weights into new arrays."""
        self._cloud = np.concatenate([cloud for own in pieces for cloud, _ in own], axis=1)
        self._log_weights = np.concatenate([weights for own in pieces for _, weights in own])
        self._layout = layout(tuple([sum([weights.size for _, weights in own]) for own in pieces]))

    def _hand_out(self, members: Sequence[Member]) -> None:
        """Replace what the members hold by views of their columns."""
        ends = self._layout.offsets.tolist()
        self._clouds = [self._cloud[:, first:last] for first, last in pairwise(ends)]
        self._weights = [self._log_weights[first:last] for first, last in pairwise(ends)]
        for member, cloud, weights in zip(members, self._clouds, self._weights, strict=True):
            keep(member, cloud, weights)


def _same(arrays: Sequence[Floats | None], others: Sequence[Floats]) -> bool:
    """Whether these are the very same arrays."""
    return len(arrays) == len(others) and all(map(is_, arrays, others))


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
    """Copies of the particles and log-weights that the member holds, its inbox included; nothing is changed."""
    twin = replace(member, inbox=list(member.inbox), memory=dict(member.memory))
    settle(twin)
    if CLOUD not in twin.memory:
        return np.empty((columns, 0)), np.empty(0)
    return twin.memory[CLOUD].copy(), twin.memory[LOG_WEIGHTS].copy()


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


def place_of(scene: Scene) -> slice | list[int]:
    """Which rows of a cloud are the position; as a slice where they can be, which copies nothing."""
    return slice_of(scene.motion.position)


def slice_of(position: tuple[int, ...]) -> slice | list[int]:
    """These rows, as a slice where they can be one."""
    first, *more = position
    if not more:
        return slice(first, first + 1)
    return slice(first, more[0] + 1, more[0] - first) if more[0] > first else [first, *more]
