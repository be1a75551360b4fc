"""Scripted tracks for checks: two clusters around a target, and handovers, without clock and energy.

estimates = list(track(tracker, Table(motion, sensor, seed)))
estimates = list(passed_on(tracker, Play(Table(motion, sensor, seed)), handovers=1))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from wsnsim.base.answers import estimate_fault
from wsnsim.base.arrays import Estimate, Floats, Reading, as_readings, components_of, planar
from wsnsim.base.border import checked
from wsnsim.base.errors import PluginAnswerError
from wsnsim.base.network_ports import Field
from wsnsim.base.optional_ports import ForecastsSuccession
from wsnsim.base.ports import MotionModel, Scene, SensorModel, Tracker
from wsnsim.base.radio import PacketJoules
from wsnsim.base.requests import Flow, Member, Request
from wsnsim.base.rng import component_noise, derive, derive_all
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.energy import FirstOrder
from wsnsim.offline.loopback import Answer, Lose, perfect, perform
from wsnsim.scenario import build, load

Component = TypeVar("Component")


@contextmanager
def demand(name: str) -> Iterator[None]:
    """Turn every exception into an AssertionError that names the demand."""
    try:
        yield
    except (AssertionError, PluginAnswerError) as reason:
        raise AssertionError(f"demand '{name}': {reason}") from reason
    except Exception as reason:
        raise AssertionError(f"demand '{name}': {type(reason).__name__} was raised: {reason}") from reason


def demand_each(checks: Mapping[str, Callable[..., object]], *given: Any) -> None:
    """Make checks of what is given, in order, each under the name of its demand."""
    for name, check in checks.items():
        with demand(name):
            check(*given)


def demand_sound(estimates: Iterable[Estimate]) -> None:
    """Assert that estimates are what a tracker may answer."""
    for estimate in estimates:
        assert not (fault := estimate_fault(estimate)), fault


def examined(component: Component, port: type, columns: int | None = None) -> Component:
    """The component, whose answers are checked from now on as those of plug-ins are in every run."""
    with demand("answers"):
        return checked(component, port, columns)


SCENARIOS: Final = Path(__file__).with_name("scenarios")
"""The folder of the scenarios in which components are checked."""


def run_with(
    name: str, values: Mapping[str, Any] | None = None, tables: Mapping[str, bool] | None = None, **components: Any
) -> Memory:
    """The tables of one run of a scenario of `SCENARIOS`, with these values and components in place of its own."""
    memory, setup = Memory(tables), build(load(SCENARIOS / f"{name}.yaml", values or {}))
    replicate_of(replace(setup, **components), 0, memory)
    return memory


def demand_same_events(one: Memory, other: Memory) -> None:
    """Assert that two runs have the same events."""
    columns, others = one.table("events"), other.table("events")
    equal = all(np.array_equal(column, others[name]) for name, column in columns.items())
    assert equal, "the same seed gives two different runs"


def demand_silence_of_the_down(events: Mapping[str, np.ndarray], sends: Sequence[str] = ("send",)) -> None:
    """Assert that no node has one of these events between a crash, or its death, and a restart."""
    down: set[int] = set()
    changes = {KIND["crash"]: down.add, KIND["death"]: down.add, KIND["restart"]: down.discard}
    kinds = [KIND[name] for name in sends]
    for kind, node in zip(events["kind"].tolist(), events["node"].tolist(), strict=True):
        if kind in changes:
            changes[kind](node)
        assert kind not in kinds or node not in down, f"node {node} sends though it is down"


DT = 0.04
FARTHEST = 100.0
"""m: upper limit of the sensing range, which may be infinite, when members are placed."""
FIRST, SECOND = (11, 4, 29, 17, 23, 8), (31, 2, 29, 40, 6)
"""Node ids of the two clusters, the head first; in no particular order."""
PACKET_JOULES = PacketJoules(FirstOrder())
SCRIPT: tuple[tuple[int, tuple[int, ...]], ...] = (
    (1, FIRST),
    (1, FIRST),
    (1, FIRST[:4]),
    (1, FIRST[1:]),
    (1, ()),
    (2, FIRST),
    (1, FIRST[:1]),
    (1, FIRST),
)
"""(steps since the last one, ids with a measurement): some leave, the head, all; all return; the head alone; all."""


@dataclass
class Table:
    """A target and two clusters of members around it, on which `track` runs a tracker.

    Attributes:
        motion: the motion model, for the target and for the filter.
        sensor: the sensor model, for the nodes and for the filter.
        seed: of trajectory, positions, measurements and all keys.
        alter: (id, reading) -> the reading that the member has instead; None: it keeps its own.
        sensing: the members that sensed at the last scene.
        truth: (K, D) the trajectory.
        places: {id: (2,)} the positions of the members in m.
        traits: {id: (T,)} the constants of their sensors.
    """

    motion: MotionModel
    sensor: SensorModel
    seed: int
    alter: Callable[[int, Reading], Reading] | None = None
    sensing: tuple[int, ...] = ()
    truth: Floats = field(init=False)
    places: dict[int, Floats] = field(init=False)
    traits: dict[int, Floats] = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        ids = sorted({*FIRST, *SECOND})
        self.truth = self.motion.truth(len(SCRIPT) + 4, DT, rng)
        centre = planar(self.truth[0][list(self.motion.position)])
        spread = 0.4 * min(self.sensor.reach, FARTHEST)
        self.places = {node: centre + rng.uniform(-spread, spread, 2) for node in ids}
        self.traits = dict(zip(ids, self.sensor.draw_traits(len(ids), rng), strict=True))

    @property
    def known(self) -> frozenset[float]:
        """The numbers that every node knows: positions and sensor constants of all nodes."""
        constants = [*self.places.values(), *self.traits.values()]
        return frozenset(float(value) for array in constants for value in array)

    @property
    def prior(self) -> Estimate:
        """A prior near the true start, with a standard deviation of 2 in every state column."""
        size = self.truth.shape[1]
        return Estimate(self.truth[0] + 1.0, 4.0 * np.eye(size))

    def members(self, ids: Sequence[int]) -> dict[int, Member]:
        """New members with empty memories."""
        self.sensing = ()
        return {node: Member(node, self.places[node], self.traits[node]) for node in ids}

    def scene(self, step: int, steps: int, members: dict[int, Member], head: int, ids: tuple[int, ...]) -> Scene:
        """The scene of a step; each member gets its measurement and its key."""
        point = self.truth[min(step, len(self.truth) - 1)][list(self.motion.position)]
        for node, member in members.items():
            member.key = derive(self.seed, step, node)
            member.reading = self._reading(member, point) if node in ids else None
        joined = tuple(node for node in ids if node not in self.sensing)
        left = tuple(node for node in self.sensing if node not in ids)
        self.sensing = ids
        positions, traits = self._constants(ids)
        roster_positions, roster_traits = self._constants(tuple(members))
        return Scene(
            time=step * DT,
            step=step,
            steps=steps,
            dt=DT,
            target=0,
            head=head,
            ids=ids,
            positions=positions,
            traits=traits,
            roster=tuple(members),
            joined=joined,
            left=left,
            field=Field(400.0, 400.0),
            motion=self.motion,
            sensor=self.sensor,
            key=derive(self.seed, step, -1 - head),
            head_position=self.places[head],
            roster_positions=roster_positions,
            roster_traits=roster_traits,
            packet_joules=PACKET_JOULES,
        )

    def _constants(self, ids: tuple[int, ...]) -> tuple[Floats, Floats]:
        """Positions (n, 2) and traits (n, T) of members."""
        positions = np.array([self.places[node] for node in ids]).reshape(-1, 2)
        traits = np.array([self.traits[node] for node in ids]).reshape(len(ids), len(self.sensor.trait_names))
        return positions, traits

    def _reading(self, member: Member, point: Floats) -> Reading:
        noise = component_noise(derive_all(member.key, np.array([7])), len(components_of(self.sensor)))
        measured = self.sensor.measure(point[None], member.position[None], member.traits[None], noise)
        value = as_readings(measured)[0]
        return value if self.alter is None else self.alter(member.id, value)


def another(reading: Reading) -> Reading:
    """Another reading that is as possible."""
    if isinstance(reading, tuple):
        return tuple([1.7 * value + 0.3 for value in reading])
    return 1.7 * reading + 0.3


Watch = Callable[[Request, dict[int, Member]], None]


@dataclass
class Play:
    """Performs a tracker's flows at a table, in the cluster that it is in; `lead` forms one.

    Args:
        table: The target and the clusters.
        lose: Which packets arrive.
        watch: Called with each request and the members before it is performed.
        answer: Answers the requests; by default `loopback.answer_to`.
    """

    table: Table
    lose: Lose = perfect
    watch: Watch | None = None
    answer: Answer | None = None
    members: dict[int, Member] = field(init=False)
    head: int = field(init=False)

    def lead(self, cluster: Sequence[int]) -> None:
        """Form a cluster of new members, the first of which leads it."""
        self.members, self.head = self.table.members(cluster), cluster[0]

    def scene(self, step: int, steps: int, ids: tuple[int, ...]) -> Scene:
        """The scene of a step of this cluster; `ids` have a measurement."""
        return self.table.scene(step, steps, self.members, self.head, ids)

    def drive(self, flow: Flow[Any]) -> Any:
        """Perform a flow; return its belief."""
        watch, members = self.watch, self.members
        before = (lambda request: watch(request, members)) if watch else None
        return perform(flow, members, self.head, self.lose, before, answer_of=self.answer)


def track(
    tracker: Tracker[Any],
    table: Table,
    lose: Lose = perfect,
    watch: Watch | None = None,
    answer: Answer | None = None,
) -> Iterator[Estimate]:
    """Every estimate and forecast of the scripted track: start, eight steps, handover, three more steps.

    It ends at the handover if that is lost.

    Args:
        tracker: The tracker.
        table: The target and the clusters.
        lose: (sender, receiver, parcel) -> (packets,) which packets arrive; by default all.
        watch: Called with each request and {id: member} before it is performed.
        answer: Answers the requests; by default as in a standalone run, in which all parcels take no time.
    """
    play = Play(table, lose, watch, answer)
    play.lead(FIRST)
    belief = play.drive(tracker.start(table.prior, play.scene(0, 0, FIRST)))
    yield tracker.estimate(belief)
    step = 0
    for passed, ids in SCRIPT:
        step += passed
        scene = play.scene(step, passed, ids)
        belief = play.drive(tracker.step(belief, scene))
        yield tracker.estimate(belief)
        yield from _forecasts(tracker, belief, scene, 2)
    belief = play.drive(tracker.hand_over(belief, scene, SECOND[0]))
    if belief is None:
        return
    play.lead(SECOND)
    yield tracker.estimate(belief)
    for ids in (SECOND[1:], SECOND, SECOND):
        step += 1
        belief = play.drive(tracker.step(belief, play.scene(step, 1, ids)))
        yield tracker.estimate(belief)


def passed_on(tracker: Tracker[Any], play: Play, handovers: int) -> Iterator[Estimate]:
    """Every estimate and forecast of a track that is handed over right after its start: before its first step.

    A head hands over as early where heads move, and where an election gives a new cluster to another node; then a
    belief that has just arrived goes on, without a step between two `handovers`. Two steps follow at the last head.
    The track ends at a handover that is lost.
    """
    play.lead(FIRST)
    scene = play.scene(0, 0, FIRST)
    belief = play.drive(tracker.start(play.table.prior, scene))
    for number in range(1, handovers + 1):
        yield tracker.estimate(belief)
        yield from _forecasts(tracker, belief, scene, 1)
        cluster = (FIRST, SECOND)[number % 2]
        belief = play.drive(tracker.hand_over(belief, scene, cluster[0]))
        if belief is None:
            return
        play.lead(cluster)
        scene = play.scene(0, 0, cluster)
    yield tracker.estimate(belief)
    for step, ids in ((1, cluster[1:]), (2, cluster)):
        belief = play.drive(tracker.step(belief, play.scene(step, 1, ids)))
        yield tracker.estimate(belief)


def _forecasts(tracker: Tracker[Any], belief: Any, scene: Scene, ahead: int) -> Iterator[Estimate]:
    """The forecast, and that for the choice of the next head if the tracker has one of its own."""
    yield tracker.forecast(belief, scene, ahead)
    if isinstance(tracker, ForecastsSuccession):
        yield tracker.successor_forecast(belief, scene, ahead)
