"""The ports of a network that sleeps: when nodes are awake of themselves, and how others are woken ahead of a target.

Times in s, places in m. `keys` are counter keys (see `base.rng`), one a node: equal keys, equal schedules.

A schedule is a function of time that nobody polls. A wake-up protocol is pure: what it decides for a node depends on
the node, the message and the time alone; the network room performs it, and pays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple, Protocol

from wsnsim.base.arrays import Bools, Floats, Keys
from wsnsim.base.radio import Mode

Point = tuple[float, float]


class SleepSchedule(Protocol):
    """Which nodes sense and listen when.

    `rest`: the mode of a node that has nothing to do: DORMANT (sensor and receiver stay on, the target's sound wakes
    it), AWAKE (it never sleeps), or SCHEDULED, where the functions say when it is AWAKE and when ASLEEP.
    """

    @property
    def rest(self) -> Mode: ...

    def awake(self, keys: Keys, time: float) -> Bools:
        """(n,) who is awake at a time >= 0; a change counts from its instant on."""
        ...

    def state(self, keys: Keys, time: float) -> tuple[Bools, Floats, Floats]:
        """Who is awake at a time (n,), and the span [from (n,), until (n,)) about it in which that does not change.

        Neither end need be a change: the span may be shorter than it could be.
        """
        ...

    def tally(self, keys: Keys, since: Floats, until: Floats | float) -> tuple[Floats, Floats]:
        """(n,) seconds that each node is awake in [since, until), and how often it falls asleep or wakes in
        (since, until]; since (n,), until (n,) or one for all.
        """
        ...

    def profile(self, keys: Keys, times: Floats) -> tuple[Floats, Floats]:
        """Of all nodes together, from 0 to each of the ascending times (T,): awake seconds (T,), and switches (T,)."""
        ...


class WakeUpPlan(NamedTuple):
    """What a main node knows when it composes a message that wakes nodes for one step.

    `fix` is its last fix, `heading` the displacement between the last two, (0, 0) if there is one; `prediction` where
    the target will be at `due`, `ahead` s after the last fix; `foreseen`: whether that is more than the last fix.
    `sensing` is the sensors' reach r, `reach` the radio's R. `payload_bits`: of the belief, where it rides along.
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
    """What wakes nodes ahead of a target for one step, as it is on the air: `sender` is who sent this copy, at `place`.

    The region to be woken is a disc of `radius` about `centre`; after `expires` nobody heeds the message. `belief` is
    the main node's, where it rides along. `bits` of the payload.
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
    """One wake-up message of a head, and what came of it; a row of the table `wakeups`.

    Attributes:
        message: as the head composed it.
        node: the head.
        time: at which the head sent it, in s.
        foreseen: the message names a predicted position, not the last fix.
        tracking: {node: copy of the message} of the nodes that track at the message's step.
        sleepers: nodes of the region that slept when the round began, and have not been called.
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
    """What a node does about a message."""

    DROP = "drop"
    TRACK = "track"
    FORWARD = "forward"
    STOP = "stop"


class WakeUp(Protocol):
    """How nodes ahead of the target are woken.

    `mechanism`: 'none'; 'flood', nodes hand the message on, and wake their neighbours in the region; 'region', the
    next main node is told first and calls its neighbours in the region; 'invite', the main node calls and invites all
    its neighbours. `carries_belief`: the message hands the belief over. `wait` s: how long a node that was woken stays
    awake after the step it was woken for, or after it last sensed the target. `call` s: what a call on the wake-up
    radio takes, at both ends.
    """

    @property
    def mechanism(self) -> str: ...

    @property
    def carries_belief(self) -> bool: ...

    @property
    def wait(self) -> float: ...

    @property
    def call(self) -> float: ...

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """The message of a main node."""
        ...

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """What a node at `place` does about a message; pure. `seen`: it has heeded this message before.

        `chance`: a uniform draw of the node for this message, on [0, 1).
        """
        ...
