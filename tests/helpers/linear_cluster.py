"""A linear Gaussian world, in which the Kalman filter is the truth, and a cluster that watches it.

A target of nearly constant velocity; a node's reading is a x + b y plus noise, (a, b) being its traits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.helpers.scenes import make_scene
from wsnsim.base.arrays import Estimate
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Compute, Local, Member, Parcel, Request, all_arrived
from wsnsim.base.rng import derive, derive_all, normals
from wsnsim.offline.loopback import Lose, perform

AXIS = np.array([[1.0, 0.5], [0.0, 1.0]])
AXIS_NOISE = 0.4 * np.array([[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]])
F = np.kron(np.eye(2), AXIS)
VARIANCE = 2.0


class LinearMotion:
    """x⁺ = F x + w, whatever dt is said to be."""

    def __init__(self, noise_scale=1.0):
        self.noise = noise_scale * np.kron(np.eye(2), AXIS_NOISE)
        self.root = np.linalg.cholesky(self.noise)

    columns = ("px", "vx", "py", "vy")
    units = ("m", "m/s", "m", "m/s")
    position = (0, 2)

    def truth(self, steps, dt, rng):
        states = [np.array([1.0, 2.0, -3.0, 0.5])]
        for _ in range(steps):
            states.append(F @ states[-1] + self.root @ rng.normal(size=4))
        return np.array(states)

    def propagate(self, states, dt, keys, time=0.0):
        return F @ states + self.root @ np.array([normals(keys, draw) for draw in range(4)])

    def advance(self, states, dt, time=0.0):
        return F @ states

    def matrices(self, states, dt, time=0.0):
        return np.repeat(F[None], states.shape[1], axis=0), self.noise

    def log_transition(self, after, before, dt, time=0.0):
        white = np.linalg.solve(self.root, after - F @ before)
        return -0.5 * (white**2).sum(axis=0) - 2.0 * np.log(2.0 * np.pi) - np.log(np.diag(self.root)).sum()

    def assumed(self, noise_scale):
        return self


class LinearSensor:
    """z = a x + b y + N(0, 2)."""

    reach = 100.0
    trait_names = ("a", "b")

    def draw_traits(self, nodes, rng):
        return rng.normal(size=(nodes, 2))

    def measure(self, points, positions, traits, noise):
        return (points * traits).sum(axis=1) + np.sqrt(VARIANCE) * noise

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        if owners is None:
            return sum(
                (_log_normal(z - points.T @ trait) for z, trait in zip(readings, traits, strict=True)),
                np.zeros(points.shape[1]),
            )
        return _log_normal(readings[owners] - (points.T * traits[owners]).sum(axis=1))

    def linearise(self, points, positions, traits):
        count = points.shape[1]
        return traits @ points, np.repeat(traits[:, :, None], count, axis=2), np.full((len(traits), count), VARIANCE)

    def assumed(self, gains, inflate):
        return self


def _log_normal(difference):
    return -0.5 * difference**2 / VARIANCE - 0.5 * np.log(2.0 * np.pi * VARIANCE)


@dataclass
class Heard:
    """What crossed the air: (source, to, what, packets), a broadcast once with to = -1; and the cycles by node."""

    packets: list[tuple[int, int, str, int]] = field(default_factory=list)
    cycles: dict[int, float] = field(default_factory=dict)

    def total(self, what: str) -> int:
        return sum(packets for _, _, word, packets in self.packets if word == what)


class Cluster:
    """Members 100, 101, ..., the first of them the head. A step takes `dt` s."""

    dt = 0.04

    def __init__(self, count: int, motion: Any = None, sensor: Any = None, seed: int = 0, reach: float = 40.0) -> None:
        self.motion, self.sensor, self.seed = motion or LinearMotion(), sensor or LinearSensor(), seed
        rng = np.random.default_rng(seed)
        self.truth = self.motion.truth(200, 0.04, rng)
        self.ids = tuple(range(100, 100 + count))
        centre = self.truth[0][[0, 2]]
        self.positions = centre + rng.uniform(-reach, reach, (count, 2))
        self.traits = self.sensor.draw_traits(count, rng)
        self.renew()

    def renew(self) -> None:
        """Members with empty memories."""
        self.members = {node: Member(node, self.positions[row], self.traits[row]) for row, node in enumerate(self.ids)}
        self.sensing: tuple[int, ...] = ()

    @property
    def head(self) -> int:
        return self.ids[0]

    @property
    def prior(self) -> Estimate:
        sd = np.array([3.0, 1.0, 3.0, 1.0])
        noise = np.random.default_rng(self.seed + 1).normal(size=4)
        return Estimate(self.truth[0] + sd * noise, np.diag(sd**2))

    def scene(self, step: int, ids: tuple[int, ...] | None = None, steps: int = 1) -> Scene:
        """The scene of a step, readings and keys set."""
        ids = self.ids if ids is None else ids
        point = self.truth[step][[0, 2]]
        for row, (node, member) in enumerate(self.members.items()):
            member.key = derive(self.seed, step, node)
            noise = normals(derive_all(member.key, np.array([3])), 0)
            z = self.sensor.measure(point[None], self.positions[row : row + 1], self.traits[row : row + 1], noise)
            member.reading = float(z[0]) if node in ids else None
        joined = tuple(node for node in ids if node not in self.sensing)
        left = tuple(node for node in self.sensing if node not in ids)
        self.sensing = ids
        rows = [self.ids.index(node) for node in ids]
        return make_scene(
            step, ids, self.positions[rows], self.traits[rows], self.motion, self.sensor, steps=steps, dt=self.dt,
            head=self.head, roster=self.ids, joined=joined, left=left, key=derive(self.seed, step, 1),
        )  # fmt: skip

    def drive(self, flow: Any, lose: Lose | None = None, watch: Any = None) -> tuple[Any, Heard]:
        """Drive a flow, and count."""
        heard, locals_done, broadcasting = Heard(), [], [False]

        def see(ask: Request) -> None:
            broadcasting[0] = isinstance(ask, Broadcast)
            if isinstance(ask, Broadcast):
                heard.packets.append((self.head, -1, ask.parcel.what, ask.parcel.packets))
            elif isinstance(ask, Compute):
                heard.cycles[self.head] = heard.cycles.get(self.head, 0.0) + ask.cycles
            elif isinstance(ask, Local):
                locals_done.append(ask)
                ask.work, ask.work_all = self._billing(ask, heard)
            if watch:
                watch(ask)

        def carry(source: int, to: int, parcel: Parcel) -> np.ndarray:
            if not broadcasting[0]:
                heard.packets.append((source, to, parcel.what, parcel.packets))
            return lose(source, to, parcel) if lose else all_arrived(parcel.packets)

        return perform(flow, self.members, self.head, carry, see), heard

    def _billing(self, ask: Local, heard: Heard) -> Any:
        work, work_all, cycles = ask.work, ask.work_all, ask.cycles

        def bill(members: list[Member]) -> None:
            if work_all:
                work_all(members)
            else:
                for member in members:
                    work(member)
            for member in members:
                taken = cycles(member) if callable(cycles) else cycles
                heard.cycles[member.id] = heard.cycles.get(member.id, 0.0) + taken

        return (lambda member: bill([member])), bill

    def readings(self) -> tuple[np.ndarray, np.ndarray]:
        """Readings and traits of those who sense now."""
        sensing = [member for member in self.members.values() if member.reading is not None]
        return np.array([member.reading for member in sensing]), np.array([member.traits for member in sensing])


def kalman(mean, cov, noise, readings, traits):
    """The exact posterior one step on, by conditioning the joint Gaussian."""
    mean, cov = F @ mean, F @ cov @ F.T + noise
    slope = np.zeros((len(readings), 4))
    slope[:, [0, 2]] = traits
    cross = cov @ slope.T
    gain = cross @ np.linalg.inv(slope @ cross + VARIANCE * np.eye(len(readings)))
    return mean + gain @ (readings - slope @ mean), cov - gain @ cross.T


def against_kalman(
    tracker: Any, noise_scale: float = 1.0, steps: int = 15, seeds: int = 12
) -> tuple[np.ndarray, np.ndarray]:
    """Of the second half of each run: errors of the mean in the Kalman filter's sd, and ratios of variances."""
    errors, ratios = [], []
    for seed in range(seeds):
        cluster = Cluster(5, LinearMotion(noise_scale), seed=seed)
        mean, cov = cluster.prior.mean, cluster.prior.cov
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        for step in range(1, steps + 1):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
            mean, cov = kalman(mean, cov, cluster.motion.noise, *cluster.readings())
            if step > steps // 2:
                found, sd = tracker.estimate(belief), np.sqrt(np.diag(cov))
                errors.append((found.mean - mean) / sd)
                ratios.append(np.diag(found.cov) / sd**2)
    return np.array(errors), np.array(ratios)


def sent(heard: Heard, head: int) -> dict[str, int]:
    """Packets by what, downward ones with a v, upward ones with a ^."""
    result: dict[str, int] = {}
    for source, _, what, packets in heard.packets:
        name = ("v" if source == head else "^") + what
        result[name] = result.get(name, 0) + packets
    return result
