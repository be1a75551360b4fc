"""The ports: what each role of a scenario must be able to do. Behind each stands one or more frozen `@part` classes.

Shapes: D state columns, P of them the position (1 or 2), N particles or nodes, S sensors. States are (D, N): column j
is particle j. A target whose position is one column moves along the x-axis. SI units throughout. `keys` are (N,)
uint64 counter keys, one a particle (see `base.rng`): equal keys, equal noise, whatever the order of the calls.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.clustering import ClusterPolicy as ClusterPolicy
from wsnsim.base.clustering import MovingPolicy as MovingPolicy
from wsnsim.base.requests import Flow, Member
from wsnsim.base.tables import Words

B = TypeVar("B")


@dataclass(frozen=True, slots=True)
class Field:
    """The monitored rectangle. Width, height and centre in m."""

    width: float
    height: float
    centre: tuple[float, float] = (0.0, 0.0)

    def contains(self, points: Floats) -> Bools:
        """(N,) whether each of the (N, 2) points lies in the field, its edge included."""
        half = np.array([self.width, self.height]) / 2
        inside: Bools = np.all(np.abs(points - np.array(self.centre)) <= half, axis=-1)
        return inside


@dataclass(frozen=True, slots=True)
class Estimate:
    """A Gaussian summary of what a head believes: mean (D,), cov (D, D); and its number of effective particles."""

    mean: Floats
    cov: Floats
    effective: float = float("nan")


@dataclass(frozen=True, slots=True)
class Scene:
    """What the head knows at a step without a request.

    Attributes:
        time: the time of the step in s.
        step: its number.
        steps: model steps since the belief's time: 1, or more if steps were missed.
        dt: length of a model step in s.
        target: the target.
        head: the cluster head.
        ids: the members that sense now, the head first if it does.
        positions: (n, 2) of these members.
        traits: (n, T) of these members.
        roster: all living members, sensing or not.
        joined: the ids that began to sense since the last step.
        left: the living members that ceased to sense since the last step; they keep what is in their memory.
        field: the monitored rectangle.
        motion: the motion model that the filter assumes; it may differ from the true one.
        sensor: the sensor model that the filter assumes; it may differ from the true one.
        key: counter key of the head's own random numbers.
    """

    time: float
    step: int
    steps: int
    dt: float
    target: int
    head: int
    ids: tuple[int, ...]
    positions: Floats
    traits: Floats
    roster: tuple[int, ...]
    joined: tuple[int, ...]
    left: tuple[int, ...]
    field: Field
    motion: MotionModel
    sensor: SensorModel
    key: int

    @property
    def active(self) -> int:
        """N_act: how many members sense now."""
        return len(self.ids)

    @property
    def since(self) -> float:
        """The time in s of the belief that comes into this step."""
        return (self.step - self.steps) * self.dt

    @property
    def previous(self) -> float:
        """The time in s one step ago: `since`, unless steps were missed."""
        return (self.step - 1) * self.dt


class MotionModel(Protocol):
    """How a target moves. `columns` names the state's D columns; `position` says which P of them are x, or x and y.

    `time` is when the states given hold, in s: the earlier end of the step. Models that do not depend on it may give it
    a default.
    """

    @property
    def columns(self) -> tuple[str, ...]: ...

    @property
    def units(self) -> tuple[str, ...]: ...

    @property
    def position(self) -> tuple[int, ...]: ...

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, D): one trajectory from the start state."""
        ...

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float) -> Floats:
        """(D, N): each state one step on, with process noise."""
        ...

    def advance(self, states: Floats, dt: float, time: float) -> Floats:
        """(D, N): each state one step on, without noise."""
        ...

    def matrices(self, states: Floats, dt: float, time: float) -> tuple[Floats, Floats]:
        """F (N, D, D) at each state, and the process covariance Q (D, D)."""
        ...

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float) -> Floats:
        """(N,) log p(after | before). Raises RunError where the process noise is singular."""
        ...

    def assumed(self, noise_scale: float) -> MotionModel:
        """The model as a filter believes it: process covariance times `noise_scale`."""
        ...


class SensorModel(Protocol):
    """What a node measures of a target within `reach`. A node's traits (its gain, say) are a row of `trait_names`."""

    @property
    def reach(self) -> float: ...

    @property
    def trait_names(self) -> tuple[str, ...]: ...

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T): each node's constants."""
        ...

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings of a target at points[i] (n, P) by a sensor at positions[i], noise[i] standard normal."""
        ...

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | points (P, N)): of all S readings, or of reading owners[j] alone for particle j."""
        ...

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """At points (P, N): expected readings (S, N), their gradients (S, P, N), their variances (S, N)."""
        ...

    def assumed(self, gains: str, inflate: bool) -> SensorModel:
        """The model as a filter believes it: gains 'known' or 'unknown', variance inflated for unknown gains or not."""
        ...


@runtime_checkable
class Continuous(Protocol):
    """Optional port of a motion model: a trajectory in continuous time, the same at every sampling interval."""

    @property
    def continuous(self) -> bool: ...


@runtime_checkable
class Informs(Protocol):
    """Optional port of a sensor model: the Fisher information of its measurements, for Cramér-Rao bounds."""

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher's information about the position in one reading of each sensor, at points (P, N).

        What a variance that depends on the state tells is included: g gᵀ / R + (∂R / R)(∂R / R)ᵀ / 2.
        """
        ...


@runtime_checkable
class Ranks(Protocol):
    """Optional port of a sensor model whose larger measurements do not mean a nearer target: ranks measurements."""

    def strength(self, reading: float) -> float:
        """The larger, the nearer."""
        ...


@runtime_checkable
class Detects(Protocol):
    """Optional port of a sensor model: which nodes measure the target, if not all within `reach`."""

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether a target at each of the points (n, P) gives a reading at each of the sensors (S, 2)."""
        ...


class Deployment(Protocol):
    """Where the nodes stand."""

    @property
    def field(self) -> Field: ...

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions, covering the field if the component requires it. Raises RunError if that fails."""
        ...


class Detection(Protocol):
    """How faithfully nodes report what their sensors measure.

    `missed`: probability that a reading is not taken. `false_alarm`: probability a node and step that a node out of
    range reports a reading all the same.
    """

    @property
    def missed(self) -> float: ...

    @property
    def false_alarm(self) -> float: ...

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the readings as reported, given a counter key a node (equal at every step)."""
        ...


class Acquire(Protocol):
    """How a track is initiated from readings alone.

    Where heads move, awake nodes search for targets that have no track. The first to detect one broadcasts a message;
    nodes that hear it and sense the target answer.
    """

    @property
    def poll(self) -> float | None:
        """The interval in s at which awake nodes search; None: at each step."""

    @property
    def detection_bits(self) -> int:
        """The size of the message that a target has been detected."""

    @property
    def answer_bits(self) -> int:
        """The size of an answer."""

    def estimate(
        self,
        readings: Floats,
        positions: Floats,
        traits: Floats,
        sensor: SensorModel,
        motion: MotionModel,
        prior: Estimate,
    ) -> Estimate:
        """The first estimate: the position from the readings, the other columns from the spread of the prior."""
        ...


class PriorModel(Protocol):
    """What every filter is told at the start."""

    def draw(self, start: Floats, rng: np.random.Generator) -> Estimate: ...


class Recorder(Protocol):
    """Where rows go. Columns of one call are equally long; names are those of `base.tables`, `replicate` included.

    Two category columns get new values at run time: `words` holds the codes of `events.what`, `state_names` those of
    `tracker_state.name` (used only where that table is wanted).
    """

    words: Words
    state_names: Words

    def wants(self, table: str) -> bool: ...

    def write(self, table: str, columns: Mapping[str, Any]) -> None: ...


class Tracker(Protocol[B]):
    """A tracking strategy: half mathematics, half protocol (see `base.requests`). Its state is passed in and returned.

    A tracker may also declare, as a property `member_cycles: float`, how many operations one member spends on one
    step: the energy threshold of heads counts them (Jiang 2013, section 4, step 2). Without it, they are none.
    """

    def start(self, prior: Estimate, scene: Scene) -> Flow[B]:
        """A new track in a cluster that has just formed: the first deal-out crosses the air too."""
        ...

    def step(self, belief: B, scene: Scene) -> Flow[B]:
        """One step. Members that are new (all of them, after a handover) are in `scene.joined`."""
        ...

    def hand_over(self, belief: B, scene: Scene, successor: int) -> Flow[B | None]:
        """Collect from the old cluster and send to the successor; give what *arrived*, or None: the track is lost.

        The deal-out in the new cluster is the first thing that its first `step` does, since only then its members are
        known.
        """
        ...

    def estimate(self, belief: B) -> Estimate: ...

    def forecast(self, belief: B, scene: Scene, ahead: int) -> Estimate:
        """The belief `ahead` steps on, for handover and for waking nodes ahead of the target."""
        ...


@runtime_checkable
class Portable(Protocol):
    """Optional port of a tracker: a belief small enough to be carried by a wake-up message."""

    def belief_bits(self, belief: Any) -> int:
        """Bits of the belief in such a message."""
        ...


@runtime_checkable
class Foresees(Protocol):
    """Optional port of a tracker: whether its forecast is already a prediction, or only its last fix."""

    def foresees(self, belief: Any) -> bool:
        """True once it can predict. Trackers that do not say always can."""
        ...


@runtime_checkable
class Snapshots(Protocol):
    """Optional port of a tracker: its particles for the table `particles`; no node receives them."""

    def snapshot(self, belief: Any, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(node, states (D, n), weights (n,)) of each node that holds some; weights sum to 1 over the whole set."""
        ...


@runtime_checkable
class ReportsState(Protocol):
    """Optional port of a tracker: named quantities of its belief, recorded in the table `tracker_state`."""

    def report_state(self, belief: Any) -> Mapping[str, Floats]:
        """Values (n,) by name, recorded after each step. The lengths may differ, and may change from step to step."""
        ...
