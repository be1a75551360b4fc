"""The ports: what each role of a scenario must be able to do. Behind each stands one or more frozen `@part` classes.

Shapes: D state columns, P of them the position (1 or 2), N particles or nodes, S sensors. States are (D, N): column j
is particle j. A target whose position is one column moves along the x-axis. SI units throughout. `keys` are (N,)
uint64 counter keys, one a particle (see `base.rng`): equal keys, equal noise, whatever the order of the calls.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.asks import Flow, Member
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
        return np.all(np.abs(points - np.array(self.centre)) <= np.array([self.width, self.height]) / 2, axis=-1)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A Gaussian summary of what a head believes: mean (D,), cov (D, D); and its number of effective particles."""

    mean: Floats
    cov: Floats
    effective: float = float("nan")


@dataclass(slots=True)
class Scene:
    """What the head knows without asking.

    `steps` model steps of `dt` seconds have passed since the belief's time (1, or more after steps that were missed).
    `ids`, `positions` (n, 2) and `traits` (n, T) are of the members that sense now, the head first if it does;
    `roster` is every living member, sensing or not; `joined` and `left` are the ids that began and ceased to sense
    since the last step (`left` only names the living: they still have what is in their memory). `motion` and `sensor`
    are what the *filter* believes; they may differ from the truth's. `key` serves the head's own draws.
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
class Informs(Protocol):
    """What a sensor may offer besides: what its readings can tell at best, for the bounds on every filter's error."""

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher's information about the position in one reading of each sensor, at points (P, N).

        What a variance that depends on the state tells is included: g gᵀ / R + (∂R / R)(∂R / R)ᵀ / 2.
        """
        ...


@runtime_checkable
class Ranks(Protocol):
    """What a sensor may offer besides: how near its readings say the target is, where a larger one is not nearer."""

    def strength(self, reading: float) -> float:
        """The larger, the nearer."""
        ...


@runtime_checkable
class Detects(Protocol):
    """What a sensor may offer besides: who gets a reading, where it is not everybody within `reach`."""

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether a target at each of the points (n, P) gives a reading at each of the sensors (S, 2)."""
        ...


class Deployment(Protocol):
    """Where the nodes stand."""

    @property
    def field(self) -> Field: ...

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions, covering the field if the part asks for it. Raises RunError where that cannot be had."""
        ...


class Mode(IntEnum):
    """What a node does when it neither sends, receives nor computes."""

    DORMANT = 0
    """Processor asleep; sensor and receiver on, so that the target's sound or a frame wakes it."""
    AWAKE = 1
    """Processor and receiver on."""
    ASLEEP = 2
    """Processor and radio off."""
    DOWN = 3
    """Crashed or dead: draws nothing."""


class Draw(NamedTuple):
    """What a node draws all the time in a mode, in W, and whether each part of it is booked as sleep (else as idle)."""

    radio: float
    radio_sleeps: bool
    processor: float
    processor_sleeps: bool


class EnergyModel(Protocol):
    """What each act costs, in joules. `battery` is a node's charge."""

    @property
    def battery(self) -> float: ...

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules."""
        ...

    def receive(self, bits: float) -> float: ...

    def compute(self, cycles: float) -> float: ...

    def sense(self) -> float: ...


@runtime_checkable
class Draws(Protocol):
    """What an energy model may offer besides: what time costs, and what switching does. Without it, nothing.

    While a node sends or receives, its radio's draw is not charged besides; while it computes, its processor's is not.
    """

    def draw(self, mode: Mode) -> Draw:
        """The draw in a mode; all zero where the model knows no such cost."""
        ...

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a node's change of mode."""
        ...

    def turnaround(self) -> float:
        """Joules of one change of the radio between receiving and sending."""
        ...

    def seconds(self, cycles: float) -> float:
        """How long the processor is busy with so many cycles; 0 where that is not known."""
        ...


class LinkModel(Protocol):
    """Who hears whom, and how well. `reach` is the nominal range in m, `audible` the distance beyond which nobody
    hears anything. `perfect`: every frame that nothing disturbs arrives. `captures`: a frame may survive another that
    overlaps it; otherwise neither arrives where both are heard.
    """

    @property
    def reach(self) -> float: ...

    @property
    def audible(self) -> float: ...

    @property
    def perfect(self) -> bool: ...

    @property
    def captures(self) -> bool: ...

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) received power in dBm over links of these lengths; -inf where nothing is heard.

        `pairs` are counter keys equal for both directions of a link, `directions` differ.
        """
        ...

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) probability that a frame of so many bits on the air arrives, given what disturbs it (mW, 0: nothing)."""
        ...

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node takes the channel for busy when it hears so much (clear channel assessment)."""
        ...


class Mac(Protocol):
    """When a frame gets the channel. `mechanism` names what the network room performs; fields are its parameters."""

    @property
    def mechanism(self) -> str: ...


class FramedMac(Mac, Protocol):
    """A MAC whose frames take time: `rate` bit/s, `turnaround` s between receiving and sending, whether unicasts are
    acknowledged (`acks`, by `ack_bits` on the air, awaited for `ack_wait` s, repeated `max_retries` times).

    `payload_bits`: what a frame can carry.
    """

    rate: float
    turnaround: float
    acks: bool
    ack_wait: float
    max_retries: int

    @property
    def ack_bits(self) -> int: ...

    @property
    def payload_bits(self) -> int: ...

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with such a payload, preamble and headers included."""
        ...

    def airtime(self, bits: float) -> float:
        """Seconds that so many bits on the air take."""
        ...

    def spacing(self, bits: int) -> float:
        """Seconds that a sender leaves after a frame of so many bits on the air."""
        ...


class ContendingMac(FramedMac, Protocol):
    """Carrier sense with collision avoidance: slots of `backoff` s, 2^BE of them, BE from `min_be` to `max_be`; given
    up after `max_backoffs` further attempts; a channel is assessed for `cca` s.
    """

    backoff: float
    min_be: int
    max_be: int
    max_backoffs: int
    cca: float


class SlottedMac(ContendingMac, Protocol):
    """Slots inside a cluster, contention outside. `guard` s at either end of a slot; `slot` s, None: as long as needed;
    `schedule_bits` an entry of the schedule that the head broadcasts.
    """

    guard: float
    slot: float | None
    schedule_bits: int

    def slot_needed(self, bits: int) -> float:
        """Seconds that a frame of so many bits on the air needs: turnaround, acknowledgement and guards included."""
        ...


class Packing(Protocol):
    """How many packets of a burst travel in one frame."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """Of this size, in a frame whose payload holds so many bits; at least 1."""
        ...


class Cpu(Protocol):
    """How long computing takes. `cycles_per_flop`: processor cycles of one operation that a tracker states."""

    @property
    def cycles_per_flop(self) -> float: ...

    def seconds(self, cycles: float) -> float:
        """Simulated seconds that so many cycles take; 0: no time passes."""
        ...


class Clock(Protocol):
    """How true the nodes' clocks are."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on each node's clock in one true second, given a counter key a node."""
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


class Sink(Protocol):
    """Who is told of every estimate. `point` (2,): the node nearest to it; None: nobody. `bits` of a report."""

    @property
    def point(self) -> tuple[float, float] | None: ...

    @property
    def bits(self) -> int: ...


class Workload(Protocol):
    """What the network does. `mechanism`: 'tracking', or 'beacons', a network without a target.

    Beacons have besides a `period` (s) and a payload of `bits`.
    """

    @property
    def mechanism(self) -> str: ...


class FaultEvent(Protocol):
    """Something that goes wrong: what (`mechanism`), when (`at`, s), for how long (`duration`, None: for good).

    Whom it hits is said by one of `nodes` (ids), `fraction` (of all, drawn), `region` (x, y, radius in m) and `head`
    (the head of that target's track at that instant).
    """

    @property
    def mechanism(self) -> str: ...

    @property
    def at(self) -> float: ...

    @property
    def duration(self) -> float | None: ...

    @property
    def nodes(self) -> tuple[int, ...] | None: ...

    @property
    def fraction(self) -> float | None: ...

    @property
    def region(self) -> tuple[float, float, float] | None: ...

    @property
    def head(self) -> int | None: ...


class SleepSchedule(Protocol):
    """Which nodes sense and listen when. `always_listening`: receiver and sensor stay on in sleep (event wake)."""

    @property
    def always_listening(self) -> bool: ...


class WakeUp(Protocol):
    """How nodes ahead of the target are woken. `mechanism` names what the network room performs."""

    @property
    def mechanism(self) -> str: ...


class Acquire(Protocol):
    """How a track starts anew from readings alone."""

    def estimate(
        self,
        readings: Floats,
        positions: Floats,
        traits: Floats,
        sensor: SensorModel,
        motion: MotionModel,
        prior: Estimate,
    ) -> Estimate:
        """A start from the readings that arrived: position from them, the rest from the spread of the prior."""
        ...


class PriorModel(Protocol):
    """What every filter is told at the start."""

    def draw(self, start: Floats, rng: np.random.Generator) -> Estimate: ...


class ClusterPolicy(Protocol):
    """Who leads, who follows, and until when.

    `minimum_active`: a cluster that forms with fewer sensing members holds a network-wide election. `threshold`:
    joules that a head must hold, None for the paper's rule. `is_open`: whoever senses belongs, without a frame, and
    nobody hands over. `calls_election`: the node nearest to the forecast calls an election instead of leading itself.
    """

    @property
    def minimum_active(self) -> int: ...

    @property
    def threshold(self) -> float | None: ...

    @property
    def is_open(self) -> bool: ...

    @property
    def calls_election(self) -> bool: ...

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The head among candidates, given each one's reading and whether its charge exceeds the threshold."""
        ...

    def must_hand_over(self, active: int, members: int) -> bool: ...

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The next head, given the predicted position (2,), all nodes' positions (N, 2) and who is able (N,)."""
        ...


class Routing(Protocol):
    """What a relayed message minimises: `weight` is 'energy' or 'hop'; 'greedy': each hop goes nearest to the goal."""

    @property
    def weight(self) -> str: ...


class Recorder(Protocol):
    """Where rows go. Columns of one call are equally long; names are those of `base.tables`, `replicate` included.

    `words` holds the codes of `events.what`.
    """

    words: Words

    def wants(self, table: str) -> bool: ...

    def write(self, table: str, columns: Mapping[str, Any]) -> None: ...


class Tracker(Protocol[B]):
    """A tracking strategy: half mathematics, half protocol (see `base.asks`). State is argument and return value.

    A tracker may state besides, as a property `member_cycles: float`, how many operations one member spends on one
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
class Snapshots(Protocol):
    """What a tracker may offer besides: a look at its particles, for the table `particles`. No node sees it."""

    def snapshot(self, belief: Any, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(node, states (D, n), weights (n,)) of each node that holds some; weights sum to 1 over the whole set."""
        ...
