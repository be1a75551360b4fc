"""The ports: the protocols that the components of a scenario implement, one per role.

A component is a frozen `@part` class. Optional ports are in `base.optional_ports`.

Shapes: D state columns, P of them the position (1 or 2), N particles or nodes, S sensors. States are (D, N): column j
is particle j. A target whose position is one column moves along the x-axis. SI units throughout. `keys` are (N,)
uint64 counter keys, one per particle (see `base.rng`): equal keys give equal noise, in any order of the calls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as field_of
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, Ints, Keys
from wsnsim.base.network_ports import Field
from wsnsim.base.radio import free_packets
from wsnsim.base.requests import Flow, Member, Parcel

B = TypeVar("B")


class KnownNodes(NamedTuple):
    """Nodes as a head knows them.

    Attributes:
        ids: (n) their ids.
        positions: (n, 2) where they are assumed to be, in m.
        traits: (n, T) the constants of each.
    """

    ids: tuple[int, ...]
    positions: Floats
    traits: Floats


@dataclass(frozen=True, slots=True)
class Scene:
    """What a cluster head knows at the beginning of a step, before any request.

    Attributes:
        time: the time of the step in s.
        step: number of the step.
        steps: model steps since the belief's time: 1, or more if steps were missed.
        dt: length of a model step in s.
        target: number of the target.
        head: the cluster head.
        ids: the members that sense now; the head is first if it senses.
        positions: (n, 2) of these members.
        traits: (n, T) of these members.
        roster: all living members, sensing or not.
        joined: the ids that began to sense since the last step.
        left: the living members that ceased to sense since the last step; they keep what is in their memory.
        field: the monitored rectangle.
        motion: the motion model that the filter assumes; it may differ from the true one.
        sensor: the sensor model that the filter assumes; it may differ from the true one.
        key: counter key of the head's own random numbers.
        head_position: (2,) the assumed place of the head; without a network, where no packet is sent, the middle of
            the field.
        roster_positions: (m, 2) of the members in `roster`.
        roster_traits: (m, T) of the members in `roster`.
        packet_joules: what one packet of `PACKET_BITS` costs, sent and received: distances (n,) in m -> (n,) J. Zero
            without a network.
        hop_seconds: how long a packet of a member takes to the head at most, in s, without contention and
            retries; where each member has a slot, used or not, until the last of them has had its own; 0 without a
            network, and where sending takes no time. A deadline before it gets few replies.
        appointed: the nodes with whose readings a head reckons that appoints its members; see `known`.
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
    head_position: Floats = field_of(default_factory=lambda: np.zeros(2))
    roster_positions: Floats = field_of(default_factory=lambda: np.zeros((0, 2)))
    roster_traits: Floats = field_of(default_factory=lambda: np.zeros((0, 0)))
    packet_joules: Callable[[Floats], Floats] = free_packets
    hop_seconds: float = 0.0
    appointed: KnownNodes | None = None

    @property
    def known(self) -> KnownNodes:
        """The nodes with whose readings the head reckons, itself included.

        They are those of the roster. A head that appoints its members does not know who of them is down: these are
        among them. Members that it did not expect are there as soon as they heard that they are (an idealisation).
        """
        if self.appointed is not None:
            return self.appointed
        return KnownNodes(self.roster, self.roster_positions, self.roster_traits)

    @property
    def active(self) -> int:
        """N_act: the number of members that sense now."""
        return len(self.ids)

    @property
    def since(self) -> float:
        """The time in s of the belief before this step."""
        return (self.step - self.steps) * self.dt

    @property
    def previous(self) -> float:
        """The time in s one step ago: `since`, unless steps were missed."""
        return (self.step - 1) * self.dt


class MotionModel(Protocol):
    """How a target moves: a Markov process with a state of D columns.

    In all methods `dt` is the length of a step in s, and `time` the time in s of the given states, that is the
    beginning of the step; it may have a default. States are (D, N): column j is particle j.
    """

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the D columns of the state, such as ('x', 'vx', 'y', 'vy')."""

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each column, such as ('m', 'm/s', 'm', 'm/s')."""

    @property
    def position(self) -> tuple[int, ...]:
        """Which P columns are the position: those of x and y, or that of x alone."""

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, D): one trajectory from the start state, of as many steps; `rng` is the source of its noise."""

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float) -> Floats:
        """(D, N) each state after one step, with process noise; particle j has the noise of its key keys[j]."""

    def advance(self, states: Floats, dt: float, time: float) -> Floats:
        """(D, N) each state after one step, without noise."""

    def matrices(self, states: Floats, dt: float, time: float) -> tuple[Floats, Floats]:
        """The derivative F (N, D, D) of `advance` at each state, and the process covariance Q (D, D)."""

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float) -> Floats:
        """(N,) log p(after | before) of states (D, N) one step apart.

        Raises:
            RunError: The process noise is singular: it has no density.
        """

    def assumed(self, noise_scale: float) -> MotionModel:
        """The model that a filter assumes: the process covariance is multiplied by `noise_scale`."""


class SensorModel(Protocol):
    """What a node measures of a target within `reach`.

    A reading is a number without a period, unless the port `VectorReadings` says otherwise. P is the number of
    coordinates of the target (1 or 2), T that of traits.
    """

    @property
    def reach(self) -> float:
        """The sensing range in m."""

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of the T traits: constants of a node's sensor, such as its gain."""

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) the traits of each node."""

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings, the i-th of a target at points[i] by a sensor at positions[i].

        Args:
            points: (n, P) the target in m. With the trait `height`, points of a target whose height is known have a
                third column: x, y and height.
            positions: (n, 2) the sensors in m.
            traits: (n, T) of the sensors.
            noise: (n,) standard normal.
        """

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | points): of all S readings, or of reading owners[j] alone for particle j.

        Args:
            points: (P, N) supposed positions of the target in m. The result is -inf where one is not finite.
            readings: (S,) in the sensor's unit; without any, the result is 0.
            positions: (S, 2) the sensors in m.
            traits: (S, T) of the sensors.
            owners: (N,) which reading counts for each particle; None: all of them.
        """

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N), their gradients (S, P, N) and their variances (S, N) at points (P, N) in m.

        Args:
            points: (P, N) supposed positions of the target in m.
            positions: (S, 2) the sensors in m.
            traits: (S, T) of the sensors.
        """

    def assumed(self, gains: str, inflate: bool) -> SensorModel:
        """The model that a filter assumes: gains 'known', 'unknown' or 'estimated', variance inflated or not."""


class Detection(Protocol):
    """The errors of what nodes report."""

    @property
    def missed(self) -> float:
        """The probability that a reading is not taken."""

    @property
    def false_alarm(self) -> float:
        """The probability, per node and step, that a node out of range reports a reading."""

    def distort(self, readings: Floats, keys: Keys) -> Floats:
        """(n,) the reported readings, given one counter key per node, which is the same at every step."""


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
        """The first estimate: the position from the readings, the other columns from the spread of the prior.

        Args:
            readings: (S,) what the nodes measured.
            positions: (S, 2) the nodes in m.
            traits: (S, T) of their sensors.
            sensor: The sensor model that the filter assumes.
            motion: The motion model that the filter assumes.
            prior: What is known of a target without readings.
        """


class PriorModel(Protocol):
    """The prior of a track."""

    def draw(self, start: Floats, rng: np.random.Generator) -> Estimate:
        """The prior of a target whose state at the start is `start` (D,)."""


class Tracker(Protocol[B]):
    """A tracking strategy: half mathematics, half protocol. Its state, the belief, is passed in and returned.

    `start`, `step` and `hand_over` are flows: generators that yield requests, are sent what happened, and return a
    belief of any type. A tracker may also have a property `member_cycles: float`: the operations that one member
    computes in a step. They count in the energy threshold of heads (Jiang 2013, section 4, step 2). Without the
    property they are 0.
    """

    def start(self, prior: Estimate, scene: Scene) -> Flow[B]:
        """Start a track in a cluster that has just formed. What the head gives its members is sent by radio too.

        Args:
            prior: Mean (D,) and covariance (D, D) of the state at the start.
            scene: What the head knows.

        Returns:
            The first belief.
        """

    def step(self, belief: B, scene: Scene) -> Flow[B]:
        """Perform one step. New members (after a handover, all of them) are in `scene.joined`.

        Args:
            belief: That of the last step, `scene.steps` model steps ago.
            scene: What the head knows.

        Returns:
            The belief at `scene.time`.
        """

    def hand_over(self, belief: B, scene: Scene, successor: int) -> Flow[B | None]:
        """Collect from the old cluster and send to the successor. Return what arrived; None: the track is lost.

        The first `step` in the new cluster gives the new members what they need: only then are they known.

        Args:
            belief: That of the last step.
            scene: What the old head knows.
            successor: The id of the next head.
        """

    def estimate(self, belief: B) -> Estimate:
        """The estimate of a belief: finite numbers, and a covariance that is symmetric and positive semidefinite."""

    def forecast(self, belief: B, scene: Scene, ahead: int) -> Estimate:
        """The estimate predicted for `ahead` steps later, for waking nodes ahead of the target and for handover.

        A tracker with the port `ForecastsSuccession` has another one for handover.

        Args:
            belief: That of the last step.
            scene: What the head knows at this step.
            ahead: The number of model steps, 1 or more.
        """


class Trigger(Protocol):
    """Decides which members send their readings to a head, and what the head learns from the others."""

    def gather(self, belief: Any, scene: Scene) -> Flow[Any]:
        """Ask the members for readings; return a `wsnsim.trackers.shared.silence.HeardReadings`.

        Args:
            belief: That of the last step, with `mean` and `cov`, and with `shared` if a trigger left it there.
            scene: What the head knows.
        """


class HeadlessTracker(Protocol):
    """A tracking strategy of a network without a head: every participant runs it on what it holds and receives.

    Its belief is in its memory. `step` requests `Local` and `Exchange` alone; in both, `who=None` means all of them.

    A class of this port says `headless: ClassVar[bool] = True`. It says `has_covariance: ClassVar[bool] = False` if
    what it gives as the covariance of its estimates is not theirs: no standard deviation and no NEES are recorded then.
    """

    def begin(self, member: Member, prior: Estimate) -> None:
        """Begin at a participant, from what it knows of the target: the prior, or a first estimate from readings."""

    def step(self, scene: Scene) -> Flow[None]:
        """One step of all participants.

        Args:
            scene: What every node knows, such as the time and the models; it names no node.
        """

    def belief_of(self, member: Member) -> Any:
        """What a participant believes; None if it has not begun."""

    def announcement(self, member: Member) -> Parcel:
        """What a participant broadcasts to nodes that are to join: its belief."""

    def join(self, member: Member, payload: Any) -> None:
        """Begin at a node from an announcement that arrived whole."""

    def estimate(self, belief: Any) -> Estimate:
        """The estimate of one participant's belief."""

    def forecast(self, belief: Any, scene: Scene, ahead: int) -> Estimate:
        """The estimate predicted for `ahead` steps later, by one participant."""


def port_of(tracker: Any) -> str:
    """The name of the port of a component or a class, if it is a tracker of another port than `Tracker`; else ''."""
    if getattr(tracker, "multi_target", False):
        return "MultiTracker"
    return "HeadlessTracker" if getattr(tracker, "headless", False) else ""
