"""Cell leases: the cells that cluster heads give to their members, announce, and take back.

    leases.request(head, [(source, frame), ...])

A head draws one cell for each frame that it is told of, and broadcasts the list in a shared cell. From the next slot on
the sender of a cell may use it, and its receiver listens in it. A cell ends with the last frame of its sender that is
acknowledged, otherwise with the lease; a frame that says that more are pending extends that. Both know the end of a
cell at once, though the acknowledgement that says so may be lost: an idealisation of ours, worth `rx_wait` of
listening.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.frames import MacFrame, OfferedFrame, Received
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.models.tsch import MOST_CELLS, Tsch
from wsnsim.network.event_log import then
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices
from wsnsim.network.radio.tsch.exchanges import Exchanges, Line
from wsnsim.network.radio.tsch.slots import SlotRadios, Slots

Pair: TypeAlias = tuple[int, int]
"""Sender and receiver."""
Request: TypeAlias = tuple[int, MacFrame]
"""Sender and frame."""
ORDER, OFFSET = 0, 1


class Cell(NamedTuple):
    """A cell that a head gives: its slot in the slotframe, its channel offset, and who sends to whom in it."""

    slot: int
    offset: int
    source: int
    to: int


class CellLeases(MacPart):
    """The cells of all cluster heads."""

    def __init__(
        self, mac: Tsch, services: NetworkMacServices, slots: Slots, radios: SlotRadios, air: Exchanges
    ) -> None:
        super().__init__(services)
        self._mac = mac
        self._slots = slots
        self._radios = radios
        self._exchanges = air
        self._code = self._log.code("cells")
        self._key = services.key("cells")
        self._shared_slots = frozenset(mac.shared_slots)
        self._lines: dict[Pair, Line] = {}
        """Lines with cells of their own"""
        self._shared: dict[int, Line] = {}
        self._requests: dict[int, list[Request]] = {}
        self._announced: dict[int, dict[Pair, list[MacFrame]]] = {}
        """{head whose announcement waits for its cell: the frames that it is about}"""
        self._expected: dict[int, set[int]] = {}
        self._drawn: dict[int, int] = {}
        """{head: how often it drew cells}"""
        air.on_expiry = self._expire

    def shared_line(self, node: int) -> Line:
        """The line of a node for the shared cells."""
        line = self._shared.get(node)
        if line is None or line.stopped:
            line = self._shared[node] = Line(node)
        return line

    def expect(self, head: int, members: Iterable[int]) -> None:
        """Give members cells with the next lease of their head, before they have something to send."""
        self._expected[head] = set(members) - {head}

    def request(self, head: int, frames: list[Request]) -> None:
        """Send frames between a head and its members; those of one instant are given cells together."""
        waiting = self._requests.get(head)
        if waiting is not None:
            waiting += frames
            return
        self._requests[head] = frames
        then(self._env.timeout(0.0), self._serve, head)

    def forget(self, node: int) -> list[Line]:
        """Return the lines of a node that is down or has lost the time; it has no cells any more."""
        lines = [line for pair, line in self._lines.items() if pair[0] == node]
        self._lines = {pair: line for pair, line in self._lines.items() if pair[0] != node}
        shared = self._shared.pop(node, None)
        return lines if shared is None else [*lines, shared]

    def take_waiting(self, node: int) -> list[MacFrame]:
        """Return the frames of a node that wait for cells; they are not sent any more."""
        found: list[MacFrame] = []
        for waiting in self._announced.values():
            for pair in [pair for pair in waiting if pair[0] == node]:
                found += waiting.pop(pair)
        for requests in self._requests.values():
            found += [frame for source, frame in requests if source == node]
            requests[:] = [request for request in requests if request[0] != node]
        return found

    def _serve(self, head: int) -> None:
        """Send the frames that were requested at this instant, in cells that are leased or will be."""
        announced = self._announced.get(head)
        without: list[Request] = []
        for source, frame in self._requests.pop(head, []):
            pair = source, frame.to
            line = self._line(pair)
            if line is not None:
                self._exchanges.enqueue(line, frame)
            elif announced is not None and pair in announced:
                announced[pair].append(frame)
            else:
                without.append((source, frame))
        if announced is not None:
            if without:
                self._requests[head] = without  # Until the announcement is over, whose cell they would take.
        elif len(without) < 2 or not self._may_lease(head):
            self._share(without)
        else:
            self._lease(head, without)

    def _line(self, pair: Pair) -> Line | None:
        """The line of a pair with cells of its own; None if it has none, or its lease is over."""
        line = self._lines.get(pair)
        if line is None or line.frame is not None or line.last >= self._slots.upcoming(pair[0], self._env.now):
            return line
        del self._lines[pair]
        return None

    def _may_lease(self, head: int) -> bool:
        return self._services.is_up(head) and not self._radios.is_scanning(head)

    def _share(self, frames: Iterable[Request]) -> None:
        """Send frames in the shared cells; those of nodes that went down are lost."""
        for source, frame in frames:
            if self._radios.is_scanning(source):
                self._services.log_drop(source, frame, "no_time")
                frame.finish(None)
            elif not self._services.is_up(source):
                frame.finish(None)
            else:
                self._exchanges.enqueue(self.shared_line(source), frame)

    def _lease(self, head: int, frames: list[Request]) -> None:
        """Draw cells for frames, and announce them. Frames that get none wait for the last announcement, then share."""
        waiting: dict[Pair, list[MacFrame]] = {}
        for source, frame in frames:
            waiting.setdefault((source, frame.to), []).append(frame)
        others = [(node, head) for node in sorted(self._expected.pop(head, set())) if (node, head) not in waiting]
        expected = [pair for pair in others if self._line(pair) is None]
        wanted = [pair for pair, each in waiting.items() for _ in each] + expected
        cells = self._draw(head, wanted)
        if not cells:
            self._share(frames)
            return
        self._announced[head] = waiting
        size = self._mac.payload_bits // self._mac.cell_bits
        for first in range(0, len(cells), size):
            self._announce(head, cells[first : first + size], waiting, last=first + size >= len(cells))

    def _draw(self, head: int, wanted: Sequence[Pair]) -> list[Cell]:
        """Draw a cell for each pair, as far as there are slots; the cells of a pair follow one another."""
        taken = {slot for pair, line in self._lines.items() if head in pair and not line.stopped for slot in line.slots}
        receiving = self._radios.receiving.get(head, {})
        taken |= self._shared_slots | receiving.keys()
        free = np.array([slot for slot in range(self._mac.slotframe) if slot not in taken], dtype=np.int64)
        number = self._drawn[head] = self._drawn.get(head, 0) + 1
        keys = derive_all(derive(self._key, head, number), free)
        most = min(len(wanted), MOST_CELLS - len(receiving))
        order = np.argsort(uniforms(keys, ORDER), kind="stable")[:most]
        offsets = (uniforms(keys, OFFSET) * len(self._mac.channels)).astype(np.int64)
        drawn = zip(free[order].tolist(), offsets[order].tolist(), wanted, strict=False)
        return [Cell(slot, offset, *pair) for slot, offset, pair in drawn]

    def _announce(self, head: int, cells: list[Cell], waiting: dict[Pair, list[MacFrame]], last: bool) -> None:
        """Broadcast cells; they are used by those who received them."""

        def heard(received: Received | None) -> None:
            self._begin(head, cells, set() if received is None else set(received.tolist()), waiting)
            if last:
                self._announced.pop(head, None)
                self._share((pair[0], frame) for pair, each in waiting.items() for frame in each)
                if head in self._requests:
                    then(self._env.timeout(0.0), self._serve, head)

        bits = self._mac.bits(self._mac.cell_bits * len(cells))
        frame = OfferedFrame(bits, self._code, heard)
        frame.packets = 0
        self._exchanges.enqueue(self.shared_line(head), frame)

    def _begin(self, head: int, cells: list[Cell], heard: set[int], waiting: dict[Pair, list[MacFrame]]) -> None:
        """Begin the cells of one announcement; frames of nodes that did not receive it use the shared cells."""
        last = self._slots.current(head, self._env.now) + self._mac.lease * self._mac.slotframe
        listening = [cell for cell in cells if cell.to == head or cell.to in heard]
        if self._may_lease(head):
            kept = [cell for cell in listening if self._radios.receive(cell.to, cell.slot, cell.offset)]
            self._end_later(head, kept, last)
        by_pair: dict[Pair, dict[int, int]] = {}
        for cell in cells:
            by_pair.setdefault((cell.source, cell.to), {})[cell.slot] = cell.offset
        for pair, own in by_pair.items():
            frames = waiting.pop(pair, [])
            if self._line(pair) is not None or (
                pair[0] not in heard and not (pair[0] == head and self._may_lease(head))
            ):
                self._share((pair[0], frame) for frame in frames)
                continue
            line = self._lines[pair] = Line(pair[0], cells=own, last=last)
            line.on_end = lambda line=line, to=pair[1]: self._end(line, to)  # type: ignore[misc]
            for frame in frames:
                self._exchanges.enqueue(line, frame)

    def _end_later(self, head: int, cells: list[Cell], last: int) -> None:
        """Let receivers stop listening in cells when the lease is over."""

        def end() -> None:
            extended = [cell for cell in cells if self._last_of(cell) > last]
            for cell in cells:
                if cell not in extended:
                    self._stop_receiving(cell.to, cell.slot, cell.offset)
            if extended:
                self._end_later(head, extended, min(map(self._last_of, extended)))

        over = self._slots.when(head, last + 1, 0.0)
        then(self._env.timeout(over - self._env.now), end)

    def _last_of(self, cell: Cell) -> int:
        """The last ASN of a cell; -1 if it was taken back."""
        line = self._lines.get((cell.source, cell.to))
        return -1 if line is None or line.cells is None or cell.slot not in line.cells else line.last

    def _stop_receiving(self, node: int, slot: int, offset: int) -> None:
        if self._radios.receiving.get(node, {}).get(slot) == offset:
            self._radios.stop_receiving(node, slot)

    def _end(self, line: Line, to: int) -> None:
        """Take back the cells of a line whose last frame was acknowledged."""
        line.stopped = True
        if self._lines.get((line.node, to)) is line:
            del self._lines[line.node, to]
        assert line.cells is not None, "the shared cells are not taken back"
        for slot, offset in line.cells.items():
            self._stop_receiving(to, slot, offset)

    def _expire(self, line: Line) -> None:
        """Let the frames of a line whose lease is over wait for the shared cells."""
        self._lines = {pair: other for pair, other in self._lines.items() if other is not line}
        self._exchanges.move(line, self.shared_line(line.node))
