"""Exchanges: a frame and its acknowledgement in one slot, and the back-off of frames that were not acknowledged.

    exchanges.enqueue(line, frame)      exchanges.stop(node)

The frames of a node that share cells form a *line*: one for the shared cells, and one for each set of cells that a
cluster head gave to a sender. Lines do not wait for each other. Where nobody has anything to send, nothing happens.

Source: IEEE 802.15.4-2015, 6.2.5.3 (back-off in shared cells) and 6.5.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.models.tsch import Tsch
from wsnsim.network.event_log import then
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.mac_services import FrameSender, MacPart, NetworkMacServices, control_frame
from wsnsim.network.radio.transmission import Transmission
from wsnsim.network.radio.tsch.slots import ROUNDING, ChannelListening, ListeningTime, SlotRadios, Slots


@dataclass(slots=True, eq=False)
class Line(FrameSender):
    """Frames of one node that are sent in the same cells.

    It is stopped, too, if its node lost the time, or its cells were taken back.

    Attributes:
        cells: {slot: channel offset} the cells; None: the shared ones.
        last: The last ASN of the cells.
        asn: The slot in which the frame is sent next, or was last.
        exponent: Back-off exponent (BE).
        on_end: Called when the last frame of the line was acknowledged.
    """

    cells: dict[int, int] | None = None
    last: int = 0
    asn: int = -1
    exponent: int = 0
    on_end: Callable[[], None] = lambda: None
    slots: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.slots = sorted(self.cells or ())

    def waiting(self) -> list[MacFrame]:
        """The frames of the line, the one in progress first."""
        return [*([] if self.frame is None else [self.frame]), *self.queue]

    def take_all(self) -> list[MacFrame]:
        """Stop the line; return its frames."""
        frames = self.waiting()
        self.frame, self.stopped = None, True
        self.queue.clear()
        return frames


class Exchanges(MacPart):
    """Sends the frames of all lines.

    Attributes:
        on_frame: Called at the end of each frame, before its result is used: (transmission, result).
        on_answer: Called when a node has received an acknowledgement: (node, who acknowledged).
        on_expiry: Called with a line whose cells were taken back while it had frames.
    """

    def __init__(self, mac: Tsch, services: NetworkMacServices, slots: Slots, radios: SlotRadios) -> None:
        super().__init__(services)
        self._mac = mac
        self._slots = slots
        self._radios = radios
        self._listening = ListeningTime(mac, slots, radios, self._nodes)
        self._key = services.key("mac")
        self._ack = self._log.code("ack")
        self._channels: dict[int, Channel] = {}
        self._busy: dict[int, int] = {}
        """{node: lines with a frame in progress}"""
        self.on_frame: Callable[[Transmission, Received], None] = lambda *_: None
        self.on_answer: Callable[[int, int], None] = lambda *_: None
        self.on_expiry: Callable[[Line], None] = lambda *_: None

    def enqueue(self, line: Line, frame: MacFrame, first: bool = False) -> None:
        """Queue a frame at the end of a line, or before the frames that wait."""
        if line.frame is None:
            self._begin(line, frame)
        elif first:
            line.queue.appendleft(frame)
        else:
            line.queue.append(frame)

    def stop(self, line: Line) -> None:
        """End a line whose node is down or has lost the time: its frames are lost."""
        frame, received = line.frame, line.received
        frames = line.take_all()
        if frame is not None:
            self._release(line.node)
        for each in frames:
            each.finish(True if each is frame and received else None)

    def move(self, line: Line, to: Line) -> None:
        """Let the frames of a line whose cells were taken back wait in another line."""
        if line.frame is not None:
            self._release(line.node)
        for frame in line.take_all():
            self.enqueue(to, frame)

    def silence(self, node: int) -> None:
        """Cut the transmission of a node that is down."""
        for channel in self._channels.values():
            channel.silence(node)

    def _channel(self, number: int) -> Channel:
        channel = self._channels.get(number)
        if channel is None:
            channel = self._services.open_channel(self._mac, 0.0, ChannelListening(self._radios, number))
            self._channels[number] = channel
        return channel

    def _begin(self, line: Line, frame: MacFrame) -> None:
        line.frame, line.received = frame, False
        if self._mac.acks:
            frame.acknowledged = False
        self._busy[line.node] = self._busy.get(line.node, 0) + 1
        self._nodes.begin_sending(line.node)
        self._plan(line)

    def _release(self, node: int) -> None:
        """A line of a node has no frame in progress any more."""
        self._busy[node] -= 1
        if not self._busy[node]:
            del self._busy[node]
            self._nodes.end_sending(node)

    def _plan(self, line: Line, skipped: int = 0) -> None:
        """Wait for the next cell of a line, after skipping some shared ones."""
        first = max(self._slots.upcoming(line.node, self._env.now), line.asn + 1)
        if line.cells is None:
            line.asn = self._slots.shared_cell(first, skipped)
        else:
            line.asn = self._slots.next_of(first, line.slots)
            if line.asn > line.last:
                self.on_expiry(line)
                return
        self._wait(line)

    def _wait(self, line: Line) -> None:
        """Wait until a line may switch to sending in its slot."""
        begins = self._slots.when(line.node, line.asn, self._mac.tx_offset - self._mac.turnaround)
        then(self._env.timeout(max(begins - self._env.now, 0.0)), self._transmit, line)

    def _transmit(self, line: Line) -> None:
        """Send the frame of a line, unless its node sends in another cell of this slot."""
        if line.stopped:
            return
        now, mac, node, frame = self._env.now, self._mac, line.node, line.current
        left = self._slots.when(node, line.asn, mac.tx_offset - mac.turnaround) - now
        if left > ROUNDING * mac.slot:  # Its clock was put back meanwhile.
            self._wait(line)
            return
        if self._radios.is_sending(node, now):
            self._plan(line)
            return
        frame.owner = line
        channel = self._channel_of(line)
        sent = self._channel(channel).transmit(node, frame, self._sent)
        answer = mac.tx_ack_delay + mac.airtime(mac.ack_bits) if mac.acks and frame.to != EVERYONE else 0.0
        self._radios.send(node, channel, now - mac.tx_offset + mac.turnaround, sent.end + answer)

    def _sent(self, transmission: Transmission, received: Received) -> None:
        """Finish a frame, or have it acknowledged; if nobody received it, its sender waits and gets no answer."""
        frame = transmission.frame
        line: Line = frame.owner
        line.received = line.received or (frame.to != EVERYONE and bool(received))  # first: the sender may die next
        self._listening.settle(transmission, line.cells is None)
        self.on_frame(transmission, received)
        if frame.to != EVERYONE and self._mac.acks:
            self._radios.await_answer(line.node, self._channel_of(line), self._env.now)
            if received:
                then(self._env.timeout(self._mac.tx_ack_delay - self._mac.turnaround), self._acknowledge, transmission)
            else:
                self._await_in_vain(line)
        elif not line.stopped:
            self._finish(line, received)

    def _channel_of(self, line: Line) -> int:
        offset = 0 if line.cells is None else line.cells[line.asn % self._mac.slotframe]
        return self._slots.channel(line.asn, offset)

    def _acknowledge(self, transmission: Transmission) -> None:
        """Send the acknowledgement of a frame."""
        frame = transmission.frame
        line: Line = frame.owner
        if not self._nodes.alive[frame.to]:
            self._await_in_vain(line)
            return
        ack = control_frame(frame, transmission.source, self._mac.ack_bits, self._ack, line)
        self._channel(self._channel_of(line)).transmit(frame.to, ack, self._answered)

    def _answered(self, transmission: Transmission, received: Received) -> None:
        line: Line = transmission.frame.owner
        if line.stopped:
            return
        if received:
            self._listening.settle_answer(line.node, answered=True)
            self.on_answer(line.node, transmission.source)
            if line.frame is not None and not line.stopped:
                line.frame.acknowledged = True
                self._finish(line, True)
        else:
            self._await_in_vain(line)

    def _await_in_vain(self, line: Line) -> None:
        """The sender of a frame listens for an acknowledgement that does not come; then it tries again."""
        then(self._env.timeout(self._mac.rx_ack_delay + self._mac.ack_wait), self._retry, line)

    def _retry(self, line: Line) -> None:
        """Back off and try again, or give up."""
        if line.stopped:
            return
        self._listening.settle_answer(line.node, answered=False)
        frame = line.frame
        if line.stopped or frame is None:  # It died of it.
            return
        if not self._repeats(frame, self._mac.max_retries):
            self._finish(line, line.received)
            return
        if line.cells is None:
            first = frame.retries == 1
            line.exponent = self._mac.min_be if first else min(line.exponent + 1, self._mac.max_be)
            self._plan(line, self._draw(line))
        else:
            self._plan(line)

    def _draw(self, line: Line) -> int:
        """The number of shared cells that a line skips: uniform, below 2^BE."""
        number = line.draw(self._key, self._log.step)
        return number >> (64 - line.exponent) if line.exponent else 0

    def _finish(self, line: Line, received: Received | None) -> None:
        """Report the result of a frame; the next one of its line follows."""
        frame, line.frame = line.current, None
        frame.finish(received)
        if line.cells is not None and received and line.queue:  # A frame says whether more are pending.
            line.last = max(line.last, line.asn + self._mac.lease * self._mac.slotframe)
        if line.frame is None and line.queue and not line.stopped:
            self._begin(line, line.queue.popleft())
        elif line.frame is None and not line.stopped and line.cells is not None and received:
            line.on_end()
        self._release(line.node)
