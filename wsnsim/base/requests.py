"""What a tracker may ask of the network, and the one shape of a tracker's flow.

    Flow[Belief] = Generator[Request, Any, Belief]

A flow yields an ask and is sent back what happened. It knows no clock and no engine; joules, airtime and loss are the
driver's.

| ask | what is done | answer |
| --- | --- | --- |
| Local | each member computes, on what it has at hand | tuple of ids that computed |
| Gather | members send to the head (the head's own parcel costs nothing) | {id: (payload, mask)} of what arrived |
| Scatter | the head sends to single members (to itself: at no cost) | {id: mask}; a silent network answers {} |
| Broadcast | the head sends once to all within reach | {id: mask} of the cluster's members that heard |
| Send | the head sends to any node, relayed if need be (to itself: at no cost) | mask |
| Compute | the head computes | None |

A mask is a (packets,) boolean array: which packets of the parcel arrived. An id that is missing from an answer means
that nothing arrived from or at it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np

from wsnsim.base.arrays import Bools, Floats

NodeId: TypeAlias = int
PACKET_BITS: Final = 96
"""A packet of Jiang (2013), section 5: 12 bytes, of which 4 are header and 8 payload."""
Belief = TypeVar("Belief")


@dataclass(slots=True)
class Delivery:
    """What a member finds in its inbox: the head's parcel, and which of its packets arrived."""

    what: str
    payload: Any
    mask: Bools


@dataclass(slots=True)
class Member:
    """What ONE node has at hand when it computes; nothing else is reachable.

    `reading` is its own reading of this step (None if it does not sense), `memory` its own and lasting (it dies with
    the node or with the cluster), `inbox` what the head sent since its last `Local`, `key` a 64-bit integer for
    counter noise, new at each step, equal for equal (seed, replicate, target, step, node).
    """

    id: NodeId
    position: Floats
    traits: Floats
    reading: float | None = None
    inbox: list[Delivery] = field(default_factory=list)
    memory: dict[str, Any] = field(default_factory=dict)
    key: int = 0

    def take_inbox(self) -> list[Delivery]:
        """What arrived since the last call, oldest first."""
        arrived, self.inbox = self.inbox, []
        return arrived


@dataclass(slots=True)
class Parcel:
    """What crosses the air: `packets` packets of `packet_bits` each. `what` names it in the event log."""

    payload: Any
    packets: int
    packet_bits: int
    what: str


@dataclass(slots=True)
class Local:
    """Each addressed member computes; results stay in its memory.

    `cycles` is a number, or is asked of each member afterwards. `work_all` may do the whole cluster's work in one
    call, if member i's result depends on member i's own inputs alone. `who`: ids addressed; None means the members
    that sense now.
    """

    work: Callable[[Member], None]
    cycles: float | Callable[[Member], float] = 0.0
    work_all: Callable[[list[Member]], None] | None = None
    who: Sequence[NodeId] | None = None


@dataclass(slots=True)
class Gather:
    """Members send parcels to the head. `who`: ids addressed; None means the members that sense now."""

    parcel_of: Callable[[Member], Parcel | None]
    who: Sequence[NodeId] | None = None


@dataclass(slots=True)
class Scatter:
    """The head sends to each member its own parcel; it arrives in the member's inbox."""

    parcels: Mapping[NodeId, Parcel]


@dataclass(slots=True)
class Broadcast:
    """The head sends one parcel to everyone within reach; members find it in their inbox."""

    parcel: Parcel


@dataclass(slots=True)
class Send:
    """The head sends to any node of the network, over several hops if need be."""

    to: NodeId
    parcel: Parcel


@dataclass(slots=True)
class Compute:
    """The head computes for so many cycles."""

    cycles: float


Request: TypeAlias = Local | Gather | Scatter | Broadcast | Send | Compute
Flow: TypeAlias = Generator[Request, Any, Belief]

_ALL: dict[int, Bools] = {}


def all_arrived(packets: int) -> Bools:
    """A read-only mask of `packets` packets that all arrived. Shared: masks of whole deliveries are the common case."""
    mask = _ALL.get(packets)
    if mask is None:
        mask = np.ones(packets, dtype=np.bool_)
        mask.flags.writeable = False
        _ALL[packets] = mask
    return mask
