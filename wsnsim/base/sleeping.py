"""The ports of sleep schedules and of wake-up protocols, and the message that wakes nodes.

Times in s, positions in m. `keys` are counter keys (see `base.rng`), one per node: equal keys give equal schedules.

A schedule is a function of time. A wake-up component is pure: its decision for a node depends on the node, the message
and the time alone. The network performs the decision and books its energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple, Protocol

from wsnsim.base.arrays import Bools, Floats, Keys
from wsnsim.base.radio import Mode

Point = tuple[float, float]


class SleepSchedule(Protocol):
    """When nodes sense and listen, by their clocks.

    Times are those that clocks show. Where clocks are not perfect, each node has a time of its own, which is negative
    for a moment if its clock is behind at the start.
    """

    @property
    def rest(self) -> Mode:
        """The mode of a node that has nothing to do.

        DORMANT: sensor and receiver stay on, and a target in range wakes the node. AWAKE: it never sleeps. SCHEDULED:
        the functions of this port say when it is AWAKE and when ASLEEP.
        """

    def awake(self, keys: Keys, time: Floats | float) -> Bools:
        """Which nodes are awake at a time, or each at its own (n,). A change is in effect from its instant on."""

    def state(self, keys: Keys, time: Floats | float) -> tuple[Bools, Floats, Floats]:
        """Which nodes are awake at a time (n,), and a span [from (n,), until (n,)) around it without a change.

        The span may be shorter than possible: its ends need not be changes.
        """

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """Seconds (n,) that each node is awake in [since, until), and its number of changes (n,) in (since, until].

        Args:
            keys: (n,) the nodes' counter keys.
            since: (n,) times.
            until: (n,) times, or one for all nodes.
        """

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Awake seconds (T,) and changes (T,) of all nodes together, from 0 to each of the ascending times (T,)."""


class WakeUpPlan(NamedTuple):
    """What a cluster head knows when it composes a message that wakes nodes for one step.

    Attributes:
        target: number of the target.
        step: the step for which nodes are woken.
        sequence: the number of the message.
        sender: the head.
        place: the position of the head.
        fix: the last estimated position.
        heading: the velocity in the state, (0, 0) if it has none.
        prediction: the predicted position at `due`.
        foreseen: whether `prediction` is a forecast; if not, it is the last fix.
        due: the time of the step.
        ahead: seconds from the last fix to `due`.
        sensing: the sensing range r.
        reach: the communication range R.
        payload_bits: bits of the belief, if a message carries it.
    """

    target: int
    step: int
    sequence: int
    sender: int
    place: Point
    fix: Point
    heading: Point
    prediction: Point
    foreseen: bool
    due: float
    ahead: float
    sensing: float
    reach: float
    payload_bits: int


@dataclass(frozen=True, slots=True)
class WakeUpMessage:
    """One copy of a message that wakes nodes for one step. Positions in m, times in s.

    Attributes:
        target: number of the target.
        step: the step for which nodes are woken.
        sequence: the number of the message.
        sender: the node that sent this copy.
        place: its position.
        centre: of the disc in which nodes are woken.
        radius: of this disc, in m.
        fix: the last estimated position.
        heading: the velocity in the state in m/s, (0, 0) if it has none.
        due: the time of the step.
        expires: the time after which nodes ignore the message.
        sensing: the sensing range r in m.
        reach: the communication range R in m.
        bits: the size of the payload.
        belief: the head's belief, if the message carries it.
    """

    target: int
    step: int
    sequence: int
    sender: int
    place: Point
    centre: Point
    radius: float
    fix: Point
    heading: Point
    due: float
    expires: float
    sensing: float
    reach: float
    bits: int
    belief: Any = None


@dataclass(slots=True)
class WakeUpRound:
    """One wake-up message of a head, and its effects: one row of the table `wakeups`.

    Attributes:
        message: the message as the head composed it.
        node: the head.
        time: when the head sent it, in s.
        foreseen: whether the centre of its region is a prediction; if not, it is the last fix.
        tracking: {node: its copy of the message} for the nodes that track at the message's step.
        sleepers: nodes of the region that slept when the round began and have not been called yet.
        called_nodes: nodes that have been called.
        reached: nodes that a call has woken.
        sequence: the number of the message's frames in the event log.
        forwards, called, expired, dismissed, woken, ineffective: columns of the table.
    """

    message: WakeUpMessage
    node: int
    time: float
    foreseen: bool
    tracking: dict[int, WakeUpMessage] = field(default_factory=dict)
    sleepers: set[int] = field(default_factory=set)
    called_nodes: set[int] = field(default_factory=set)
    reached: set[int] = field(default_factory=set)
    sequence: int = 0
    forwards: int = 0
    called: int = 0
    expired: int = 0
    dismissed: int = 0
    woken: int = 0
    ineffective: int = 0


class Decision(Enum):
    """What a node does with a message: DROP ignores it as expired, STOP does nothing further."""

    DROP = "drop"
    TRACK = "track"
    FORWARD = "forward"
    STOP = "stop"


class WakeUpRadio(NamedTuple):
    """The link of wake-up calls, and the receiver that listens for them while its node sleeps.

    Attributes:
        sensitivity: received power in dBm from which a call is heard.
        power: output power of a caller in dBm; None: that of the link.
        path_gain: by how many dB the path loss of a call is less than that of a frame.
        loss: probability that a call is not heard although its power suffices.
        standby: power in W of the receiver of a sleeping node.
    """

    sensitivity: float = -math.inf
    power: float | None = None
    path_gain: float = 0.0
    loss: float = 0.0
    standby: float = 0.0


class WakeUp(Protocol):
    """How nodes ahead of a target are woken.

    A component may have a member `radio`, its `WakeUpRadio`; without it, calls reach all neighbours, and the receivers
    of sleeping nodes cost nothing.
    """

    @property
    def mechanism(self) -> str:
        """The name of the mechanism that performs the protocol.

        'none': no node is woken. 'flood': nodes forward the message, and call their neighbours in the region. 'region':
        the next head gets the belief first and calls its neighbours in the region. 'invite': the head calls and invites
        all its neighbours. A component with a mechanism of its own has `start`: see `StartsWakeUp`.
        """

    @property
    def carries_belief(self) -> bool:
        """Whether the message carries the belief, so that no handover is needed."""

    @property
    def wait(self) -> float:
        """Seconds that a woken node stays awake after the step for which it was woken."""

    @property
    def call(self) -> float:
        """Duration in s of a call on the wake-up radio, for the caller and for the node called."""

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """The message that the head sends.

        Args:
            plan: what the head knows.
            belief: its belief, of any type, for a message that carries it.
        """

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """What a node does with a message; a pure function.

        Args:
            place: the position of the node.
            message: the copy that reached it.
            seen: the node has decided about this message before.
            now: what the clock of the node shows.
            chance: a uniform random number of the node for this message, in [0, 1).
        """
