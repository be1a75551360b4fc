"""A run without a network: every sensor at one table, every packet arrives, nothing takes time or energy.

    Bench(problem, replicate, positions, traits, truths, priors, streams, recorder).run() -> tuple[Bench track, ...]

Truth, readings and the trackers' own draws are the same as in a network with the same seed: a reading is a function of
(seed, replicate, target, step, sensor). The first sensor is the head for good, and what crosses the table is counted as
a network would have to carry it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, planar
from wsnsim.base.errors import ResultError, RunError, failed_run
from wsnsim.base.ports import Detects, Estimate, Recorder, Scene, SensorModel
from wsnsim.base.requests import Ask, Broadcast, Compute, Gather, Local, Member, Parcel, all_arrived
from wsnsim.base.rng import HEAD_KEY, Streams, derive, derive_all, derive_each, reading_noise
from wsnsim.base.rows import NAN, Issued, wants_belief, write_belief
from wsnsim.base.setups import TrackingSetup
from wsnsim.offline.loopback import perform

HEAD = 0
MOST_AHEAD = 200_000
"""Readings that are drawn at a time: enough to be quick, few enough for a field of many nodes."""


@dataclass
class Bill:
    """What a run's asks would make a network carry and compute; and the readings that entered the last flow."""

    frames: int = 0
    packets: int = 0
    cycles: float = 0.0
    readings: int = 0
    _counted_once: bool = False

    def watch(self, ask: Ask) -> None:
        """Look at an ask before it is performed. A broadcast is one frame, however many hear it."""
        self._counted_once = isinstance(ask, Broadcast)
        if isinstance(ask, Broadcast):
            self._add(ask.parcel)
        elif isinstance(ask, Compute):
            self.cycles += ask.cycles

    def carry(self, source: int, to: int, parcel: Parcel) -> Bools:
        """Everything arrives, and is counted."""
        if not self._counted_once:
            self._add(parcel)
        return all_arrived(parcel.packets)

    def close(self, ask: Ask, answer: Any, members: dict[int, Member]) -> None:
        """Look at an ask and its answer."""
        if isinstance(ask, Local):
            self.cycles += sum(ask.cycles(members[node]) if callable(ask.cycles) else ask.cycles for node in answer)
            self.readings = sum(members[node].reading is not None for node in answer)
        elif isinstance(ask, Gather):
            known = sum(payload is members[node].reading for node, (payload, _) in answer.items())
            self.readings = known or self.readings

    def _add(self, parcel: Parcel) -> None:
        self.frames += 1
        self.packets += parcel.packets


@dataclass
class BenchTrack:
    """One target's estimates by step, and who led at each step from 0 on."""

    target: int
    heads: list[int]
    estimates: dict[int, Issued] = field(default_factory=dict)


class OfflineRun:
    """Sensors around a table, and a tracker in the midst of them."""

    def __init__(
        self,
        problem: TrackingSetup,
        replicate: int,
        positions: Floats,
        traits: Floats,
        truths: Sequence[Floats],
        priors: Sequence[Estimate],
        streams: Streams,
        recorder: Recorder,
    ) -> None:
        self._problem, self._replicate, self._recorder = problem, replicate, recorder
        self._positions, self._traits = positions, traits
        self._truths, self._priors = truths, priors
        self._sense_key, self._tracker_key = streams.key("sense"), streams.key("tracker")
        self._digest = hashlib.blake2b(digest_size=8)
        self.bill = Bill()

    def run(self, progress: Callable[[float], None] | None = None) -> tuple[BenchTrack, ...]:
        """Follow every target from its start to its end. A failure names seed, replicate and simulated time."""
        return tuple(self._follow(target, progress) for target in range(len(self._truths)))

    def run_row(self) -> dict[str, Any]:
        """What the table `runs` says of the bench: there is no energy, and nobody dies."""
        return {
            "energy": NAN,
            "handovers": 0,
            "frames_sent": self.bill.frames,
            "frames_lost": 0,
            "packets_sent": self.bill.packets,
            "in_range": self.bill.frames,
            "delivered": self.bill.frames,
            "collided": 0,
            "access_failures": 0,
            "retries": 0,
            "cycles": self.bill.cycles,
            "awake": NAN,
            "alive": len(self._positions),
            "first_death": NAN,
            "half_dead": NAN,
            "coverage": NAN,
            "event_fingerprint": int.from_bytes(self._digest.digest(), "little"),
        }

    def node_rows(self) -> dict[str, Any]:
        """The table `nodes`: where the sensors stand."""
        names, count = self._problem.sensor.trait_names, len(self._positions)
        return {
            "node": np.arange(count),
            "x": self._positions[:, 0],
            "y": self._positions[:, 1],
            "gain": self._traits[:, names.index("gain")] if "gain" in names else np.ones(count),
            "energy_initial": np.full(count, NAN),
            "energy_left": np.full(count, NAN),
            "died_at": np.full(count, NAN),
        }

    def _follow(self, target: int, progress: Callable[[float], None] | None) -> BenchTrack:
        problem, tracker = self._problem, self._problem.tracker
        keys = derive(self._sense_key, target), derive(self._tracker_key, target)
        seats = Seats(problem, target, self._positions, self._traits, self._truths[target], keys)
        track, step = BenchTrack(target, [HEAD] * (problem.steps + 1)), 0
        try:
            belief = self._perform(tracker.start(self._priors[target], seats.scene(0, 0)), seats)
            for step in range(1, problem.steps + 1):
                scene = seats.scene(step, 1)
                belief = self._perform(tracker.step(belief, scene), seats)
                self._issue(track, scene, tracker.estimate(belief))
                if wants_belief(self._recorder):
                    key = {"replicate": self._replicate, "target": target, "step": step}
                    members = list(seats.members.values())
                    write_belief(self._recorder, key, tracker, belief, members, problem.motions[target].columns)
                if progress:
                    progress(scene.time)
        except ResultError:  # what is written cannot be: the run itself is not to blame
            raise
        except Exception as reason:
            raise failed_run(step * problem.dt, problem.seed, self._replicate, reason) from reason
        return track

    def _perform(self, flow: Any, seats: Seats) -> Any:
        self.bill.readings = 0
        bill, members = self.bill, seats.members
        return perform(flow, members, HEAD, bill.carry, bill.watch, lambda ask, got: bill.close(ask, got, members))

    def _issue(self, track: BenchTrack, scene: Scene, estimate: Estimate) -> None:
        if not np.all(np.isfinite(estimate.mean)):
            raise RunError(f"the tracker's estimate at step {scene.step} is not finite: {estimate.mean}")
        self._digest.update(np.ascontiguousarray(estimate.mean).tobytes())
        counts = scene.active, len(scene.roster), self.bill.readings
        track.estimates[scene.step] = Issued(scene.step, scene.time, estimate, HEAD, *counts)


class Seats:
    """The sensors as members of one cluster, and what each of them reads of one target at each step."""

    def __init__(
        self,
        problem: TrackingSetup,
        target: int,
        positions: Floats,
        traits: Floats,
        truth: Floats,
        keys: tuple[int, int],
    ) -> None:
        self._problem, self._target = problem, target
        self._positions, self._traits = positions, traits
        self._sense_key, self._track_key = keys
        self._points = truth[:, list(problem.motions[target].position)]
        self._length = max(1, min(len(truth), MOST_AHEAD // len(positions)))
        self._block = _Block(0, [], [], [])
        self._ids: tuple[int, ...] = ()
        self._rows = np.zeros(0, dtype=np.int64)
        self.members = {node: Member(node, positions[node], traits[node]) for node in range(len(positions))}

    def scene(self, step: int, steps: int) -> Scene:
        """What the head knows at a step; gives each member its reading and its key."""
        problem, block = self._problem, self._block_of(step)
        before, ids, row = self._ids, block.ids[step - block.first], step - block.first
        if ids != before:
            self._ids, self._rows = ids, np.array(ids, dtype=np.int64)
        for member, value, key in zip(self.members.values(), block.readings[row], block.keys[row], strict=True):
            member.reading, member.key = None if value != value else value, key
        return Scene(
            time=step * problem.dt,
            step=step,
            steps=steps,
            dt=problem.dt,
            target=self._target,
            head=HEAD,
            ids=ids,
            positions=self._positions[self._rows],
            traits=self._traits[self._rows],
            roster=tuple(self.members),
            joined=() if ids == before else tuple([node for node in ids if node not in before]),
            left=() if ids == before else tuple([node for node in before if node not in ids]),
            field=problem.deploy.field,
            motion=problem.filter_motions[self._target],
            sensor=problem.filter_sensor,
            key=derive(self._track_key, step, HEAD_KEY),
        )

    def _block_of(self, step: int) -> _Block:
        """The readings and keys of the steps about this one, drawn many steps at a time."""
        if not self._block.first <= step < self._block.first + len(self._block.ids):
            points = self._points[step : step + self._length]
            numbers = np.arange(step, step + len(points))
            sensor = self._problem.sensor
            readings = sensed(sensor, points, self._positions, self._traits, self._sense_key, step)
            keys = derive_each(
                derive_all(self._track_key, numbers)[:, None], np.arange(len(self.members), dtype=np.uint64)[None, :]
            )
            ids = [tuple(np.flatnonzero(known).tolist()) for known in np.isfinite(readings)]
            self._block = _Block(step, ids, readings.tolist(), keys.tolist())
        return self._block


class _Block(NamedTuple):
    """Of some steps in a row: who senses, what each member reads (not a number: nothing), and the members' keys."""

    first: int
    ids: list[tuple[int, ...]]
    readings: list[list[float]]
    keys: list[list[int]]


def sensed(sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, key: int, first: int = 0) -> Floats:
    """(T, S) what each sensor reads of a target at points (T, P) from step `first` on; not a number where it does not.

    `key`: derive(the key of the stream `sense`, target).
    """
    if isinstance(sensor, Detects):
        detecting = sensor.detects(points, positions)
    else:
        apart = planar(points)[:, None, :] - positions[None, :, :]
        detecting = np.hypot(apart[..., 0], apart[..., 1]) <= sensor.reach
    readings = np.full(detecting.shape, np.nan)
    steps, nodes = np.nonzero(detecting)
    noise = reading_noise(key, first + steps, nodes)
    readings[steps, nodes] = sensor.measure(points[steps], positions[nodes], traits[nodes], noise)
    return readings
