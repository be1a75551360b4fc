"""What a MAC was given to send, what it says became of it, and under which numbers it was on the air.

with watched_frames() as frames:      a run
frames.given                          one `Given` for each frame, or burst on the ideal channel

The MACs are watched from outside; what they do does not change.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import numpy as np
import pytest

from wsnsim.base.frames import EVERYONE, Burst, OfferedFrame
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.csma import CsmaMechanism
from wsnsim.network.radio.fragmentation import Fragment, Fragmentation
from wsnsim.network.radio.ideal_medium import IdealMechanism
from wsnsim.network.radio.lpl.senders import Senders
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.tsch.exchanges import Exchanges


@dataclass
class Attempt:
    """One time that a frame was on the air.

    Attributes:
        number: its number in the event log.
        decided: when the MAC decided to send it, in s; its radio may have to turn round before its start.
        start: when its first bit is sent, in s.
        ends: when its last bit is sent unless its sender falls, in s.
        ended: whether its end was reached.
        is_copy: whether it is one of several copies in a row, which a MAC counts as one frame.
        receivers: the nodes for which it was meant: over recorded links those of a copy may differ from the next one's.
    """

    number: int
    decided: float
    start: float
    ends: float
    receivers: list[int]
    ended: bool = False
    is_copy: bool = False


@dataclass
class Given:
    """A frame that a MAC was given.

    Attributes:
        source: the sender.
        to: the destination, or EVERYONE.
        packets: the packets in it.
        sequence: the number of its burst.
        since: when the MAC got it, in s.
        neighbours: (n,) the nodes that its sender may reach, when it was last sent or else given.
        usable: (n,) whether the links to them are usable, so that a loss is logged.
        attempts: when it was on the air.
        strobes: how many strobes its sender has sent for it.
        reported: {node: packets that it received} as the MAC says; None as long as the MAC has not said anything.
    """

    source: int
    to: int
    packets: int
    sequence: int
    since: float
    neighbours: np.ndarray
    usable: np.ndarray
    attempts: list[Attempt] = field(default_factory=list)
    strobes: int = 0
    reported: dict[int, int] | None = None

    @property
    def receivers(self) -> list[int]:
        """The nodes for which it is meant: of a broadcast all neighbours."""
        return [self.to] if self.to != EVERYONE else self.neighbours.tolist()

    def is_usable(self, node: int) -> bool:
        """Whether the loss of a broadcast at a neighbour is logged."""
        return bool(self.usable[np.searchsorted(self.neighbours, node)])


class Frames:
    """All frames of one run. `ideal` says whether it was on the ideal channel."""

    def __init__(self) -> None:
        self.given: list[Given] = []
        self.ideal = False
        self._radio: Any = None
        self._of: dict[int, tuple[Any, list[Given]]] = {}

    @property
    def now(self) -> float:
        """The time at which the run ended, in s."""
        return float(self._radio.env.now) if self._radio else 0.0

    def open(self, radio: Any, ideal: bool) -> None:
        """Note the radio of the run."""
        self._radio, self.ideal = radio, ideal

    def add(self, what: Any, source: int, to: int, packets: int, sequence: int, bits: int | None = None) -> Given:
        """Note something that was given. `what`: the frame or the burst. `bits` of a frame."""
        given = Given(source, to, packets, sequence, self.now, *self._links(source, bits))
        self.given.append(given)
        self._of.setdefault(id(what), (what, []))[1].append(given)
        return given

    def aim(self, given: Given, bits: int | None) -> None:
        """Note the links again, when something is sent: recorded links change from round to round."""
        given.neighbours, given.usable = self._links(given.source, bits)

    def _links(self, source: int, bits: int | None) -> tuple[np.ndarray, np.ndarray]:
        """(n,) the neighbours of a sender, and whether the links to them are usable."""
        topology = self._radio.topology
        neighbours = topology.neighbours(source)
        if bits is not None:
            return neighbours.ids, topology.reliable(neighbours, bits)
        usable = [topology.is_reliable(source, node) for node in neighbours.id_list]
        return neighbours.ids, np.array(usable, dtype=bool)

    def of(self, what: Any) -> list[Given]:
        """What is known of a frame or burst; nothing of acknowledgements."""
        return self._of.get(id(what), (None, []))[1]

    def tell(self, frame: Any, received: Any) -> None:
        """Note the result of a frame: the receivers of a broadcast, whether a unicast arrived, None for neither."""
        for given in self.of(frame):
            if given.to != EVERYONE:
                given.reported = {given.to: given.packets} if received else {}
            else:
                given.reported = {} if received is None else dict.fromkeys(np.asarray(received).tolist(), given.packets)


@contextlib.contextmanager
def watched_frames() -> Iterator[Frames]:
    """Note what the MAC is given in the run that the block makes."""
    frames = Frames()
    with pytest.MonkeyPatch.context() as patch:
        for owner, name, make in (
            (NetworkMacServices, "fragmentation", _opening), (Fragmentation, "split", _splitting),
            (CsmaMechanism, "_enqueue", _offering), (Senders, "_enqueue", _offering),
            (Exchanges, "enqueue", _enqueuing), (Channel, "transmit", _transmitting),
            (Fragment, "finish", _telling), (OfferedFrame, "finish", _telling), (Burst, "lose", _losing),
            (IdealMechanism, "__init__", _opening_ideal), (IdealMechanism, "send", _sending),
            (IdealMechanism, "carry", _carrying),
        ):  # fmt: skip
            whole = getattr(owner, name)
            patch.setattr(owner, name, wraps(whole)(make(frames, whole)))
        yield frames


Whole = Callable[..., Any]


def _opening(frames: Frames, whole: Whole) -> Whole:
    def opened(services: NetworkMacServices, mac: Any) -> Any:
        frames.open(services.radio, ideal=False)
        return whole(services, mac)

    return opened


def _opening_ideal(frames: Frames, whole: Whole) -> Whole:
    def opened(mechanism: IdealMechanism, mac: Any, services: NetworkMacServices) -> None:
        frames.open(services.radio, ideal=True)
        whole(mechanism, mac, services)

    return opened


def _splitting(frames: Frames, whole: Whole) -> Whole:
    def split(self: Fragmentation, burst: Burst, on_end: Any) -> Any:
        fragments = whole(self, burst, on_end)
        for one in fragments:
            given = frames.add(one, burst.source, burst.to, one.packets, one.sequence, one.bits)
            frames._of.setdefault(id(burst), (burst, []))[1].append(given)
        return fragments

    return split


def _offering(frames: Frames, whole: Whole) -> Whole:
    def enqueue(self: Any, node: int, frame: Any) -> None:
        if isinstance(frame, OfferedFrame):
            frames.add(frame, node, frame.to, frame.packets, frame.sequence, frame.bits)
        whole(self, node, frame)

    return enqueue


def _transmitting(frames: Frames, whole: Whole) -> Whole:
    def transmit(self: Channel, source: int, frame: Any, on_end: Any, *more: Any) -> Any:
        attempts: list[Attempt] = []
        decided = frames.now

        def ended(transmission: Any, received: Any) -> None:
            for attempt in attempts:
                attempt.ended = True
            on_end(transmission, received)

        sent = whole(self, source, frame, ended, *more)
        for given in frames.of(getattr(frame.owner, "frame", None)) if _is_strobe(source, frame) else ():
            given.strobes += 1
        for given in frames.of(getattr(frame, "original", frame)):
            frames.aim(given, frame.bits)
            attempts.append(Attempt(sent.number, decided, sent.start, sent.end, given.receivers, is_copy=frame.is_copy))
            given.attempts.append(attempts[-1])
        return sent

    return transmit


def _is_strobe(source: int, frame: Any) -> bool:
    """Whether the sender of a frame sends a strobe; acknowledgements of that frame have the same owner."""
    return not frame.packets and getattr(frame.owner, "node", None) == source


def _enqueuing(frames: Frames, whole: Whole) -> Whole:
    def enqueue(self: Exchanges, line: Any, frame: Any, **named: Any) -> None:
        if isinstance(frame, OfferedFrame) and not frames.of(frame):
            frames.add(frame, line.node, frame.to, frame.packets, frame.sequence, frame.bits)
        whole(self, line, frame, **named)

    return enqueue


def _telling(frames: Frames, whole: Whole) -> Whole:
    def finish(frame: Any, received: Any) -> None:
        frames.tell(frame, received)
        whole(frame, received)

    return finish


def _losing(frames: Frames, whole: Whole) -> Whole:
    def lose(burst: Burst) -> None:
        for given in frames.of(burst):
            given.reported = {}
        whole(burst)

    return lose


def _sending(frames: Frames, whole: Whole) -> Whole:
    def send(self: IdealMechanism, bursts: Any, head: Any = None) -> Any:
        for burst in bursts:
            frames.add(burst, burst.source, burst.to, burst.packets, burst.sequence)
        return whole(self, bursts, head)

    return send


def _carrying(frames: Frames, whole: Whole) -> Whole:
    def carry(self: IdealMechanism, burst: Burst) -> None:
        before, bits = self._counters.frames_sent, burst.bits
        if not frames.of(burst):
            frames.add(burst, burst.source, burst.to, burst.packets, burst.sequence)
        (given,) = frames.of(burst)
        frames.aim(given, None)
        whole(self, burst)
        now = frames.now
        if self._counters.frames_sent > before:
            start = now - bits * self._seconds_per_bit
            given.attempts.append(Attempt(before + 1, start, start, now, given.receivers, ended=True))
        each = {node: int(mask.sum()) for node, mask in burst.received.items()}
        given.reported = {burst.to: burst.packets} if burst.to != EVERYONE else each

    return carry
