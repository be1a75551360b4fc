"""The event log of one step, grouped into node actions and messages, with the hops, bursts and outcomes of these.

group_events(rows, other_steps) -> [NodeAction | LoggedMessage]        in the order in which they began
LoggedMessage, LoggedBurst      a unicast over its hops, a broadcast, or a flood: a broadcast that other nodes forward
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from wsnsim.analysis.logged_events import ACKS, STROBE, LoggedEvent, OtherSteps

EVERYONE: Final = -1


@dataclass(slots=True)
class LoggedBurst:
    """One burst on the air.

    Attributes:
        number: number of the burst; column `frame` of the events.
        source: the sender.
        to: the addressed node, or `EVERYONE`.
        packets: packets sent.
        bits: bits sent.
        received: {node: packets that it received}.
        collided: nodes at which it collided.
        dropped: nodes at which it was lost otherwise.
    """

    number: int
    source: int
    to: int
    packets: int
    bits: int
    received: dict[int, int] = field(default_factory=dict)
    collided: list[int] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)

    @property
    def arrived(self) -> bool:
        """Whether the addressed node received it; of a broadcast, whether it was lost nowhere."""
        return self.to in self.received if self.to != EVERYONE else not (self.collided or self.dropped)


@dataclass(slots=True)
class LoggedMessage:
    """A message with its bursts, hop by hop.

    Attributes:
        time: time of its first event, in s.
        until: time of its last event, in s.
        what: what the parcel carried.
        target: number of the target.
        source: the first sender.
        to: the addressed node of the first burst, or `EVERYONE`.
        begun: whether its first burst is in this step.
        goes_on: whether a later step has events of it.
        relayed: whether its first event in this step is a relay event.
        ended: reason why a burst of it was not sent ('no_path', 'no_channel', ...); '' if all were sent.
        most: packets of its largest burst.
        joules: energy of its senders and addressed receivers, wake-up calls included, overhearing excluded.
        frames: its bursts, without acknowledgements and strobes.
        acknowledgements: number of acknowledgements received, without those of strobes.
        strobes: number of strobes sent.
        strobe_bits: bits of these.
        callers: nodes that sent wake-up calls for it.
        woken: nodes that these calls woke.
        expired: nodes at which it expired.
    """

    time: float
    until: float
    what: str
    target: int
    source: int
    to: int
    begun: bool = True
    goes_on: bool = False
    relayed: bool = False
    ended: str = ""
    most: int = 0
    joules: float = 0.0
    frames: list[LoggedBurst] = field(default_factory=list)
    acknowledgements: int = 0
    strobes: int = 0
    strobe_bits: int = 0
    callers: list[int] = field(default_factory=list)
    woken: list[int] = field(default_factory=list)
    expired: list[int] = field(default_factory=list)

    @property
    def path(self) -> tuple[int, ...]:
        """The nodes of its path, from the first sender to the last addressed node."""
        nodes = [self.source]
        for burst in self.frames:
            if burst.source == nodes[-1] and burst.to != EVERYONE:
                nodes.append(burst.to)
        if self.strobes and not (self.frames or self.is_broadcast):
            nodes.append(self.to)
        return tuple(nodes)

    @property
    def hop(self) -> list[LoggedBurst]:
        """The bursts of its last hop."""
        last = self.frames[-1]
        return [burst for burst in self.frames if (burst.source, burst.to) == (last.source, last.to)]

    @property
    def packets(self) -> int:
        """Packets that arrived over its last hop, summed over bursts; the packets sent, if none arrived."""
        if self.is_broadcast or not self.frames:
            return self.most
        got = sum(burst.received.get(burst.to, 0) for burst in self.hop)
        return max(got, self.most)

    @property
    def bits(self) -> int:
        """Bits put on the air, summed over strobes, bursts and hops."""
        return self.strobe_bits + sum(burst.bits for burst in self.frames)

    @property
    def is_broadcast(self) -> bool:
        """Whether it was for all nodes in range."""
        return self.to == EVERYONE

    @property
    def heard(self) -> set[int]:
        """The nodes that received a burst of it."""
        return {node for burst in self.frames for node in burst.received}

    @property
    def forwarders(self) -> list[int]:
        """The nodes that forwarded a broadcast, in order of time."""
        return [burst.source for burst in self.frames if burst.source != self.source] if self.is_broadcast else []

    @property
    def is_flood(self) -> bool:
        """Whether it is a broadcast that was forwarded or that woke nodes."""
        return self.is_broadcast and bool(self.forwarders or self.callers or self.expired)


SENDS: Final = ("send", "relay")
OUTCOMES: Final = ("receive", "drop", "collide")
CALLS: Final = ("call", "called")
WAKE_UP_MESSAGES: Final = ("track", "announce", "invitation")
"""Their names in the event log."""
EXPIRED: Final = "expired"


@dataclass(slots=True)
class NodeAction:
    """An action that several nodes perform, each of them once; overheard frames are all counted together.

    Attributes:
        time: time of the first event, in s.
        until: time of the last event, in s.
        kind: kind of the events.
        what: column `what` of the events.
        target: number of the target.
        peer: the other node, -1 for none.
        nodes: the acting nodes.
        count: number of events.
        packets: sum over the events.
        bits: sum over the events.
        joules: sum over the events.
    """

    time: float
    until: float
    kind: str
    what: str
    target: int
    peer: int
    nodes: list[int] = field(default_factory=list)
    count: int = 0
    packets: int = 0
    bits: int = 0
    joules: float = 0.0


def group_events(
    rows: Iterable[LoggedEvent], other_steps: Mapping[int, OtherSteps] | None = None
) -> list[NodeAction | LoggedMessage]:
    """The events grouped into messages, one per sequence number, and equal actions of nodes.

    If a node repeats an action, a new group begins, so that rounds remain separate.

    Args:
        rows: the events of a step.
        other_steps: what `logged_events.in_other_steps` returns.
    """
    groups, rows = _StepGroups(), list(rows)
    heads = {row.node for row in rows if row.kind in ("estimate", "announce", "allocate", "handover")}
    for row in rows:
        if row.kind == "drop" and row.frame == 0 and row.what == EXPIRED:
            message = groups.messages.get((True, row.sequence))
            if message is None:
                groups.add_action(row)
            else:
                message.expired.append(row.node)
        elif row.kind in SENDS or row.kind in OUTCOMES:
            groups.add_burst_event(row, (other_steps or {}).get(row.sequence, OtherSteps()))
        elif row.kind not in CALLS:
            groups.add_action(row, row.kind == "compute" and row.node in heads)
    for row in _assign_calls([row for row in rows if row.kind in CALLS], list(groups.messages.values())):
        groups.add_action(row)
    return sorted(groups.found, key=lambda one: one.time)


def _assign_calls(rows: Sequence[LoggedEvent], messages: Sequence[LoggedMessage]) -> list[LoggedEvent]:
    """Add each wake-up call to the wake-up message that it belongs to; returns the rows of the other calls.

    The caller sent or received that message, or was itself woken for it. If there are several such messages, the call
    belongs to the nearest in time (our choice: calls have no sequence numbers). If the caller also sends a unicast
    to the only node that it woke, the call belongs to no wake-up message.
    """
    calls: dict[tuple[float, int, int], list[LoggedEvent]] = {}
    for row in rows:
        calls.setdefault((row.time, row.target, row.node if row.kind == "call" else row.peer), []).append(row)
    unicasts = {(one.source, one.to) for message in messages if not message.is_broadcast for one in message.frames}
    left = []
    for (time, target, caller), events in calls.items():
        woken = [row.node for row in events if row.kind == "called"]
        candidates = [
            one for one in messages if one.is_broadcast and one.target == target and one.what in WAKE_UP_MESSAGES
        ]
        candidates = [one for one in candidates if caller == one.source or caller in one.heard or caller in one.woken]
        if not candidates or (len(woken) == 1 and (caller, woken[0]) in unicasts):
            left += events
            continue
        message = min(candidates, key=lambda one: abs(one.time - time))
        message.callers += [caller] if caller not in message.callers else []
        message.woken += woken
        message.joules += sum(row.joules for row in events)
        message.time, message.until = min(message.time, time), max(message.until, time)
    return left


class _StepGroups:
    """The messages, by sequence number or burst, and the actions of a step so far."""

    def __init__(self) -> None:
        self.found: list[NodeAction | LoggedMessage] = []
        self.messages: dict[tuple[bool, int], LoggedMessage] = {}
        self._actions: dict[tuple[object, ...], tuple[NodeAction, set[int]]] = {}

    def add_action(self, row: LoggedEvent, by_head: bool = False) -> None:
        """Add an event that belongs to no message, or the overhearing of a burst, to its action."""
        overheard = row.kind == "overhear"
        key = (row.kind,) if overheard else (row.kind, row.what, row.target, row.peer, by_head)
        action, nodes = self._actions.get(key, (None, set()))
        if action is None or (row.node in nodes and not overheard):
            action = NodeAction(row.time, row.time, row.kind, row.what, row.target, -1 if overheard else row.peer)
            _, nodes = self._actions[key] = action, set()
            self.found.append(action)
        nodes.add(row.node)
        action.until = row.time
        action.nodes.append(row.node)
        action.count += 1
        action.packets += row.packets
        action.bits += row.bits
        action.joules += row.joules

    def add_burst_event(self, row: LoggedEvent, other: OtherSteps) -> None:
        """Add an event of a burst to its message."""
        key = (row.sequence > 0, row.sequence or row.frame)
        message = self.messages.get(key) if key[1] else None
        if message is None:
            message = _new_message(row, other)
            self.found.append(message)
            if key[1]:
                self.messages[key] = message
        message.until = row.time
        message.joules += row.joules
        if row.what in ACKS:
            message.acknowledgements += row.kind == "receive" and row.what == ACKS[0]
        elif row.what == STROBE:
            message.strobes += row.kind in SENDS
            message.strobe_bits += row.bits * (row.kind in SENDS)
        elif row.kind in SENDS:
            message.frames.append(LoggedBurst(row.frame, row.node, row.peer, row.packets, row.bits))
            message.to = EVERYONE if row.peer == EVERYONE else message.to
            message.most = max(message.most, row.packets)
            message.what = message.what or row.what
        elif row.frame == 0:
            message.ended = row.what or "no_reason"
            message.most = max(message.most, row.packets)
        else:
            _add_outcome(message, row)


def _new_message(row: LoggedEvent, other: OtherSteps) -> LoggedMessage:
    """The message of its first event in this step. If that event is not a send, it began in an earlier step."""
    what = other.what if row.frame == 0 or row.what in (*ACKS, STROBE) else row.what
    is_answer = row.what in ACKS if row.kind in SENDS else row.frame != 0
    if is_answer:
        return LoggedMessage(row.time, row.time, what, row.target, row.peer, row.node, False, other.after)
    relayed = row.kind == "relay"
    begun = not relayed and not other.before
    return LoggedMessage(row.time, row.time, what, row.target, row.node, row.peer, begun, other.after, relayed)


def _add_outcome(message: LoggedMessage, row: LoggedEvent) -> None:
    """Add the outcome of a burst at one node."""
    burst = next((burst for burst in reversed(message.frames) if burst.number == row.frame), None)
    if burst is None:
        burst = LoggedBurst(row.frame, row.peer, row.node, row.packets, row.bits)
        message.frames.append(burst)
    if row.kind == "receive":
        burst.received[row.node] = row.packets
    else:
        (burst.collided if row.kind == "collide" else burst.dropped).append(row.node)
