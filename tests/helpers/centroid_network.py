"""A tracker so simple that its every message can be counted by hand, and a world to put it in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsnsim.base.arrays import Estimate
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.requests import PACKET_BITS, Compute, Gather, Member, Parcel, Send
from wsnsim.base.rng import Streams
from wsnsim.base.rows import estimate_rows, truth_rows
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import Memory
from wsnsim.models.access import IdealMac
from wsnsim.models.acquire import AroundTruth, FromReadings
from wsnsim.models.batteries import Linear
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.deploy import Uniform
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import NoPacking, NoSync, PerfectClock, PerfectDetection, Processor
from wsnsim.models.links import Disk, MinimumEnergy
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.models.sleep import EventWake
from wsnsim.models.wakeup import NoWakeUp
from wsnsim.models.workloads import NoSink
from wsnsim.network.result_rows import NetworkOutcome, network_columns, write_tables
from wsnsim.network.world import World


def reading_of(member: Member) -> Parcel:
    return Parcel(member.reading, 1, PACKET_BITS, "reading")


class Centroid:
    """Gathers every reading, one packet each, and estimates the position by their weighted centroid."""

    member_cycles = 0.0

    def __init__(self, cycles: float = 0.0) -> None:
        self.cycles = cycles
        self.answers: list[dict[int, Any]] = []
        self.scenes: list[Any] = []
        self.closed = 0

    def start(self, prior: Estimate, scene: Any) -> Iterator[Any]:
        yield from ()
        return prior.mean

    def step(self, belief: Any, scene: Any) -> Iterator[Any]:
        self.scenes.append(scene)
        try:
            answer = yield Gather(reading_of)
            yield Compute(self.cycles)
        except GeneratorExit:
            self.closed += 1
            raise
        self.answers.append(answer)
        if not answer:
            return belief
        ids = [node for node in scene.ids if node in answer]
        weights = np.array([answer[node][0] for node in ids])
        points = scene.positions[[scene.ids.index(node) for node in ids]]
        x, y = weights @ points / weights.sum()
        return np.array([x, belief[1], y, belief[3]])

    def hand_over(self, belief: Any, scene: Any, successor: int) -> Iterator[Any]:
        mask = yield Send(successor, Parcel(belief, 4, PACKET_BITS, "belief"))
        return belief if mask.any() else None

    def estimate(self, belief: Any) -> Estimate:
        return Estimate(belief, np.eye(4))

    def forecast(self, belief: Any, scene: Any, ahead: int) -> Estimate:
        return Estimate(scene.motion.advance(belief[:, None], scene.dt, scene.previous)[:, 0], np.eye(4))


def network_setup(**changes: Any) -> NetworkSetup:
    """The Jiang set-up for 50 steps, tracked by the centroid; `changes` replace components."""
    motion, sensor = BoundedVelocity(start=(-45.0, -20.0, -50.0, -35.0)), AcousticEnergy()
    values: dict[str, Any] = {
        "name": "toy",
        "seed": 7,
        "steps": 50,
        "dt": 0.04,
        "prior": AroundTruth(),
        "deploy": Uniform(nodes=256, width=400.0, height=400.0),
        "motions": (motion,),
        "sensor": sensor,
        "filter_motions": (motion,),
        "filter_sensor": sensor,
        "energy": FirstOrder(),
        "link": Disk(reach=75.0),
        "mac": IdealMac(),
        "sleep": EventWake(),
        "wakeup": NoWakeUp(),
        "clusters": StrongestSignal(),
        "acquire": FromReadings(),
        "routing": MinimumEnergy(),
        "packing": NoPacking(),
        "cpu": Processor(),
        "clock": PerfectClock(),
        "sync": NoSync(),
        "battery": Linear(),
        "detection": PerfectDetection(),
        "sink": NoSink(),
        "tracker": Centroid(),
    }
    values.update(changes)
    if "motions" in changes:
        values["filter_motions"] = values["motions"]
    return NetworkSetup(**values)


class Run:
    """One run of a world, with everything that it recorded."""

    def __init__(self, made: NetworkSetup, positions: Any = None, truths: Any = None, replicate: int = 0) -> None:
        streams = Streams(made.seed, replicate)
        self.setup = made
        self.memory = Memory()
        if positions is None:
            positions = made.deploy.draw(made.sensor.reach, streams("deploy"))
        self.positions = np.asarray(positions, dtype=np.float64)
        traits = np.ones((len(self.positions), 1))
        if truths is None:
            stream = streams("truth")
            truths = [motion.truth(made.steps, made.dt, stream) for motion in made.motions]
        self.truths = truths
        priors = [Estimate(truth[0], np.diag([25.0, 9.0, 25.0, 9.0])) for truth in truths]
        conditions = InitialConditions(self.positions, traits, truths, priors, self.positions)
        world = World(made, replicate, conditions, (), streams, self.memory)
        self.outcome: NetworkOutcome = world.run()
        write_tables(self.outcome, replicate, made, self.memory)
        self.errors = np.array([self._write_track(track, replicate) for track in self.outcome.tracks])

    def _write_track(self, track: Any, replicate: int) -> Any:
        """The rows of one target, and its position errors."""
        motion, truth = self.setup.motions[track.target], self.truths[track.target]
        steps, key = self.outcome.steps, {"replicate": replicate, "target": track.target}
        columns = estimate_rows(track.estimates, track.heads, motion, truth, steps, self.setup.dt)
        self.memory.write("truth", {**key, **truth_rows(motion, truth, steps, self.setup.dt)})
        self.memory.write("estimates", {**key, **columns, **network_columns(self.outcome, track)})
        return columns["error"]

    def events(self, kind: str, what: str | None = None) -> list[dict[str, Any]]:
        """The rows of one kind of event, and of one word if given."""
        from wsnsim.base.tables import KIND

        table = self.memory.table("events")
        if not table:
            return []
        keep = table["kind"] == KIND[kind]
        if what is not None:
            keep &= table["what"] == self.memory.words.code(what)
        return [{name: column[i] for name, column in table.items()} for i in np.flatnonzero(keep)]


def standing(point: tuple[float, float], steps: int) -> np.ndarray:
    """A target that stands still."""
    return np.tile([point[0], 0.0, point[1], 0.0], (steps + 1, 1))


def passing(start: tuple[float, float], velocity: tuple[float, float], steps: int, dt: float = 0.04) -> np.ndarray:
    """A target that moves in a straight line."""
    times = np.arange(steps + 1)[:, None] * dt
    truth = np.empty((steps + 1, 4))
    truth[:, [0, 2]] = np.array(start) + times * np.array(velocity)
    truth[:, [1, 3]] = velocity
    return truth
