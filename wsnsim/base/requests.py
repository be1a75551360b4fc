"""The requests that a tracker makes of the network, and the type of a tracker's flow.

    Flow[Belief] = Generator[Request, Any, Belief]

A flow is a generator that yields requests and is sent their replies. It knows neither the clock nor the simulation
engine; energy, airtime and loss belong to the driver.

| request | performed as | reply |
| --- | --- | --- |
| Local | each addressed member computes on what it holds | tuple of ids that computed |
| Gather | members send to the head (the head's own parcel costs nothing) | {id: (payload, mask)} of what arrived |
| GatherReadings | members send their own measurements to the head, each in one packet | GatheredReadings: arrays |
| GatherLate | nothing is sent | {step: GatheredReadings} of readings that arrived after their step |
| Scatter | the head sends to single members (to itself: at no cost) | {id: mask}; a silent network replies {} |
| Broadcast | the head sends once to all within range | {id: mask} of the members that received it |
| Send | the head sends to any node, over several hops if needed (to itself: at no cost) | mask |
| Compute | the head computes | None |
| Exchange | without a head: participants broadcast to their neighbours | {id: {neighbour: mask}} of what arrived |

A mask is a (packets,) boolean array: which packets of the parcel arrived. An id that is missing from a reply means
that nothing arrived from it, or at it. The replies to `Gather` and `GatherReadings` also say how long each parcel took
(`delays`, s) and over how many hops (`hops`). With a `deadline` the head goes on that many seconds after its request,
with what has arrived by then; what arrives later is paid for all the same, and ignored unless `GatherLate` asks for it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Reading, is_finite
from wsnsim.base.errors import RunError

NOBODY: Final = -1


class Journeys(NamedTuple):
    """How parcels came to the head; its own take no time and no hop.

    Attributes:
        head: The head.
        seconds: What the parcels of all others took, over one hop.
        each: {id: (seconds, hops)} of each other, where they differ. None: they do not.
    """

    head: int = NOBODY
    seconds: float = 0.0
    each: Mapping[int, tuple[float, int]] | None = None

    def of(self, node: int) -> tuple[float, int]:
        """(seconds, hops) of the parcel of one node."""
        if node == self.head:
            return 0.0, 0
        return (self.seconds, 1) if self.each is None else self.each[node]


WITHIN_THE_INSTANT: Final = Journeys()
"""0 s and one hop, from every node."""


class Gathered(dict[int, tuple[Any, Bools]]):
    """{id: (payload, mask)} of what arrived at the head: the reply to `Gather`. A mask is (packets,).

    Args:
        arrived: What arrived.
        journeys: How the parcels came.
    """

    __slots__ = ("journeys",)

    def __init__(self, arrived: Mapping[int, tuple[Any, Bools]], journeys: Journeys = WITHIN_THE_INSTANT) -> None:
        super().__init__(arrived)
        self.journeys = journeys

    @property
    def delays(self) -> dict[int, float]:
        """{id: seconds from the request until the last packet of its parcel had arrived}; 0 for the head's own."""
        return {node: self.journeys.of(node)[0] for node in self}

    @property
    def hops(self) -> dict[int, int]:
        """{id: hops that its parcel took}; 0 for the head's own."""
        return {node: self.journeys.of(node)[1] for node in self}


NodeId: TypeAlias = int
HEADER_BITS: Final = 32
PACKET_BITS: Final = HEADER_BITS + 64
"""A packet of Jiang (2013), section 5: 12 bytes, of which 4 are header and 8 payload."""
Belief = TypeVar("Belief")
_NUMBERS: Final = frozenset({float, int, *(kind for kind in np.sctypeDict.values() if issubclass(kind, np.number))})


@dataclass(slots=True)
class Delivery:
    """A parcel in a member's inbox, of the head or, where there is none, of a neighbour.

    Attributes:
        what: the name of the parcel.
        payload: what the parcel carries.
        mask: (packets,) which packets arrived.
        source: the neighbour that sent it; NOBODY: the head did.
    """

    what: str
    payload: Any
    mask: Bools
    source: NodeId = NOBODY


@dataclass(slots=True)
class Member:
    """Everything that one node holds when it computes; it can reach nothing else.

    Attributes:
        id: Number of the node.
        position: (2,) in m.
        traits: Constants of its sensor.
        reading: Its own measurement of this step, a tuple if it has several components; None if it has none.
        inbox: Parcels of the head, or of neighbours, that arrived since its last `Local`.
        memory: Its own storage, which lasts as long as the node and the cluster.
        key: A 64-bit integer for random draws; a function of (seed, replicate, target, step, node).
    """

    id: NodeId
    position: Floats
    traits: Floats
    reading: Reading | None = None
    inbox: list[Delivery] = field(default_factory=list)
    memory: dict[str, Any] = field(default_factory=dict)
    key: int = 0

    def take_inbox(self) -> list[Delivery]:
        """The parcels that arrived since the last call, oldest first; the inbox is empty afterwards."""
        arrived, self.inbox = self.inbox, []
        return arrived


@dataclass(slots=True)
class Parcel:
    """A message of `packets` packets with `packet_bits` each.

    Attributes:
        payload: What it carries: numbers, arrays, texts, and tuples, mappings or dataclasses of them.
        packets: The number of packets.
        packet_bits: Bits of each packet, its header included.
        what: Its name in the event log.
        readings: How many readings of its sender it carries, in whatever form; they count as used once it arrives at
            the head. None: one if the payload is a number or the sender's reading, otherwise none.
    """

    payload: Any
    packets: int
    packet_bits: int
    what: str
    readings: int | None = None

    def readings_of(self, sender: Member) -> int:
        """How many readings of its sender it carries."""
        if sender.reading is None:
            return 0
        if self.readings is not None:
            return self.readings
        return 1 if type(self.payload) in _NUMBERS or self.payload is sender.reading else 0


@dataclass(slots=True)
class Local:
    """Each addressed member computes; the results stay in its memory.

    Attributes:
        work: Computes for one member.
        cycles: Operations per member: a number, or a function that is called with each member afterwards.
        work_all: Computes for all members in one call; member i's result depends on member i's inputs alone.
        who: Ids of the members; None means those with a measurement at this step, and without a head all participants.
        uses_readings: Whether the measurements of these members enter the estimate by this computation, and count as
            readings of the step. False: only those count that members send afterwards.
    """

    work: Callable[[Member], None]
    cycles: float | Callable[[Member], float] = 0.0
    work_all: Callable[[list[Member]], None] | None = None
    who: Sequence[NodeId] | None = None
    uses_readings: bool = True


@dataclass(slots=True)
class Gather:
    """Members send parcels to the head.

    Attributes:
        parcel_of: What a member sends, None if nothing.
        who: Ids of the members; None means those with a measurement at this step.
        deadline: The head goes on after as many seconds, with what has arrived. None: once all has arrived or is lost.
        expected: Returns the ids of the nodes that the head expects to send, now and until it says otherwise, from what
            it knows: a MAC that keeps idle slots gives slots to these alone. Others do not call it. None: to those that
            it expected before.
        expected_cycles: Operations of the head for `expected`, if it is called.
    """

    parcel_of: Callable[[Member], Parcel | None]
    who: Sequence[NodeId] | None = None
    deadline: float | None = None
    expected: Callable[[], Sequence[NodeId]] | None = None
    expected_cycles: float = 0.0

    def __post_init__(self) -> None:
        _demand_deadline(self.deadline)


@dataclass(slots=True)
class GatherReadings:
    """Members send their own measurements to the head, each in one packet.

    It costs what a `Gather` of the same parcels costs, and is answered faster, by arrays. A member whose measurement is
    not finite sends nothing; neither does one without a measurement.

    Attributes:
        packet_bits: Bits of each packet.
        who: Ids of the members; None means those with a measurement at this step.
        what: Name of the packets in the event log.
        deadline: As that of `Gather`.
    """

    packet_bits: int = PACKET_BITS
    who: Sequence[NodeId] | None = None
    what: str = "reading"
    deadline: float | None = None

    def __post_init__(self) -> None:
        _demand_deadline(self.deadline)

    def readings_of(self, addressed: Iterable[Member]) -> dict[NodeId, Reading]:
        """{id: measurement} of the members that send one, in their order."""
        return {
            member.id: reading for member in addressed if (reading := member.reading) is not None and is_finite(reading)
        }

    def parcel_of(self, member: Member) -> Parcel | None:
        """What a member sends, None if nothing."""
        if member.reading is None or not is_finite(member.reading):
            return None
        return Parcel(member.reading, 1, self.packet_bits, self.what, readings=1)

    def gather(self) -> Gather:
        """The same request as a `Gather`, whose reply `GatheredReadings.of` turns into arrays."""
        return Gather(self.parcel_of, self.who, self.deadline)


@dataclass(frozen=True, slots=True, eq=False)
class GatheredReadings:
    """The measurements that reached the head: the reply to `GatherReadings`.

    Attributes:
        ids: (S,) the members whose packets arrived, in the order in which they were addressed.
        values: (S,) their measurements; (S, M) if these have M > 1 components.
        journeys: How the packets came.
    """

    ids: tuple[NodeId, ...]
    values: Floats
    journeys: Journeys = WITHIN_THE_INSTANT

    @classmethod
    def of(cls, reply: Mapping[NodeId, tuple[Reading, Bools]]) -> GatheredReadings:
        """The reply to `GatherReadings.gather()` as arrays."""
        journeys = reply.journeys if isinstance(reply, Gathered) else WITHIN_THE_INSTANT
        return cls(tuple(reply), np.array([value for value, _ in reply.values()], dtype=np.float64), journeys)

    @property
    def masks(self) -> Bools:
        """(S, 1) which packets of each member arrived: all, since a measurement takes one packet."""
        return np.ones((len(self.ids), 1), dtype=np.bool_)

    @property
    def delays(self) -> Floats:
        """(S,) seconds from the request until each packet had arrived; 0 for the head's own measurement."""
        return np.array([self.journeys.of(node)[0] for node in self.ids], dtype=np.float64)

    @property
    def hops(self) -> Ints:
        """(S,) hops that each packet took; 0 for the head's own measurement."""
        return np.array([self.journeys.of(node)[1] for node in self.ids], dtype=np.int64)


@dataclass(slots=True)
class GatherLate:
    """The head looks at measurements that it requested by `GatherReadings` and that arrived after it had gone on.

    Nothing is sent for it. The reply has all of them that have arrived until now, also those of earlier replies. A head
    that leads no more drops what arrives for it.

    Attributes:
        since: The first step whose measurements are wanted.
        until: The last one.
    """

    since: int
    until: int


@dataclass(slots=True)
class Scatter:
    """The head sends each member its own parcel, which arrives in the member's inbox.

    Attributes:
        parcels: {id: parcel}.
    """

    parcels: Mapping[NodeId, Parcel]


@dataclass(slots=True)
class Broadcast:
    """The head sends one parcel to all nodes within range; it arrives in the members' inboxes.

    Attributes:
        parcel: What is sent.
    """

    parcel: Parcel


@dataclass(slots=True)
class Send:
    """The head sends a parcel to any node of the network, over several hops if needed.

    Attributes:
        to: Id of the node.
        parcel: What is sent.
    """

    to: NodeId
    parcel: Parcel


@dataclass(slots=True)
class Compute:
    """The head computes.

    Attributes:
        cycles: The number of operations.
    """

    cycles: float


@dataclass(slots=True)
class Exchange:
    """In a network without a head, each participant broadcasts one parcel, once; its neighbours may hear it.

    What arrives at other participants is in their inboxes. Each of several rounds is a request of its own.

    Attributes:
        parcel_of: What a participant sends, None if nothing.
        who: Ids of the participants that send; None means all of them.
    """

    parcel_of: Callable[[Member], Parcel | None]
    who: Sequence[NodeId] | None = None


Request: TypeAlias = Local | Gather | GatherReadings | GatherLate | Scatter | Broadcast | Send | Compute | Exchange
Flow: TypeAlias = Generator[Request, Any, Belief]


def _demand_deadline(deadline: float | None) -> None:
    if deadline is not None and not deadline >= 0.0:
        raise RunError(f"a tracker requested the deadline {deadline!r}: it must be a number of seconds, 0 or more")


_ALL: dict[int, Bools] = {}


def all_arrived(packets: int) -> Bools:
    """A read-only mask of `packets` packets that all arrived. It is shared, since complete deliveries are common."""
    mask = _ALL.get(packets)
    if mask is None:
        mask = np.ones(packets, dtype=np.bool_)
        mask.flags.writeable = False
        _ALL[packets] = mask
    return mask
