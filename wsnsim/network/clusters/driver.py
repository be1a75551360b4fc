"""Performs a tracker's asks on the network, and pays for them: the only place where mathematics meets the clock.

    belief = yield from Driver(stage, target, head, members).perform(tracker.step(belief, scene))

A head that dies in the middle closes the flow: its belief is gone.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any

import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.errors import RunError
from wsnsim.base.requests import Broadcast, Compute, Delivery, Flow, Gather, Local, Member, Parcel, Scatter, Send
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import event
from wsnsim.network.radio.transport import Datagram
from wsnsim.network.run_context import RunContext

Performance = Generator[simpy.Event, Any, Any]
TINY = 1e-12
"""s that are none, but for rounding."""
COMPUTE, CPU, CPU_LEDGER = KIND["compute"], EVENT_CAUSE["cpu"], CAUSE["cpu"]


class HeadDied(Exception):
    """The head ran out of charge in the middle of a flow."""


class Driver:
    """One head's way to its cluster.

    `members` holds every member, the head included, with memory of this cluster's epoch. `readings`: how many entered
    the last computation; `heard`: {node: reading} of the last that the head gathered. `bits`: of letters put on the air
    so far. `hops`: of the last `Send`. `window`: the head gathers until nothing has come for so many s, and for so many
    at most; None: it knows when everything has come, or is lost.
    """

    def __init__(
        self, stage: RunContext, target: int, head: int, members: dict[int, Member],
        window: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        self._stage = stage
        self._target = target
        self._head = head
        self._members = members
        self._window = window
        self.readings = 0
        self.heard: dict[int, float] = {}
        self.bits = 0
        self.hops = 0

    def perform(self, flow: Flow[Any]) -> Performance:
        """Drive a flow to its end and give its belief. Raises HeadDied; whatever ends it early closes the flow."""
        answer: Any = None
        self.readings = 0
        try:
            while True:
                try:
                    ask = flow.send(answer)
                except StopIteration as end:
                    return end.value
                if type(ask) is Local:
                    answer, seconds = self._local(ask)
                    if seconds:
                        yield self._stage.env.timeout(seconds)
                elif type(ask) is Compute:
                    seconds, answer = self._pay(self._head, ask.cycles), None
                    if seconds:
                        yield self._stage.env.timeout(seconds)
                elif type(ask) is Gather:
                    answer = yield from self._gather(ask)
                elif type(ask) is Scatter:
                    answer = yield from self._scatter(ask)
                elif type(ask) is Broadcast:
                    answer = yield from self._broadcast(ask)
                elif type(ask) is Send:
                    answer = yield from self._send(ask)
                else:
                    raise RunError(
                        f"a tracker asked for {ask!r}; asks are Local, Compute, Gather, Scatter, Broadcast and Send"
                    )
                if not self._stage.fleet.alive[self._head]:
                    raise HeadDied
        finally:
            flow.close()

    def _addressed(self, who: Sequence[int] | None) -> list[Member]:
        alive, members = self._stage.fleet.alive, self._members
        if who is None:
            return [member for member in members.values() if member.reading is not None and alive[member.id]]
        return [members[node] for node in who if node in members and alive[node]]

    def _local(self, ask: Local) -> tuple[tuple[int, ...], float]:
        """Who computed, and how long the slowest of them took."""
        addressed = self._addressed(ask.who)
        if ask.work_all is not None and addressed:
            ask.work_all(addressed)
        else:
            for member in addressed:
                ask.work(member)
        self.readings = len([member for member in addressed if member.reading is not None])
        cycles = ask.cycles
        seconds = [self._pay(member.id, cycles(member) if callable(cycles) else cycles) for member in addressed]
        alive = self._stage.fleet.alive
        return tuple([member.id for member in addressed if alive[member.id]]), max(seconds, default=0.0)

    def _pay(self, node: int, operations: float) -> float:
        """Book a computation; the simulated seconds that it takes. Nothing is logged of what costs nothing."""
        stage, parts = self._stage, self._stage.parts
        stage.cycles += operations
        cycles = operations * parts.cpu.cycles_per_flop
        joules = parts.energy.compute(cycles)
        stage.fleet.mark_computing(node, cycles)
        if joules > 0:
            spent = stage.fleet.spend(node, CPU_LEDGER, joules)
            now = stage.env.now
            stage.journal.add(event(now, stage.step, self._target, node, COMPUTE, joules=spent, cause=CPU))
        return parts.cpu.seconds(cycles)

    def _gather(self, ask: Gather) -> Generator[simpy.Event, Any, dict[int, tuple[Any, Bools]]]:
        letters = []
        readings = set()
        for member in self._addressed(ask.who):
            parcel = ask.parcel_of(member)
            if parcel is not None:
                letters.append(Datagram(member.id, self._head, parcel))
                if parcel.payload is member.reading:
                    readings.add(member.id)
        yield from self.collect(letters)
        answer = {item.source: (item.parcel.payload, item.mask) for item in letters if item.arrived}
        if readings:
            self.heard = {node: answer[node][0] for node in sorted(readings.intersection(answer))}
            self.readings = len(self.heard)
        return answer

    def collect(self, letters: list[Datagram]) -> Generator[simpy.Event, Any, None]:
        """Letters to the head: until all have ended, or for as long as it waits. What comes later is not heeded."""
        if self._window is None:
            yield from self._carry(letters, self._head)
            return
        env, (quiet, cap) = self._stage.env, self._window
        began = last = env.now

        def note(item: Datagram) -> None:
            nonlocal last
            last = env.now if item.arrived else last

        for item in letters:
            if item.source == item.to:
                item.arrived = True
                continue
            event = self._stage.air.carry([item], self._target, self._head)
            assert event.callbacks is not None
            event.callbacks.append(lambda _, item=item: note(item))  # type: ignore[misc]
        while (left := min(last + quiet, began + cap) - env.now) > TINY:
            yield env.timeout(left)
        self.bits += sum(item.bits for item in letters)

    def _scatter(self, ask: Scatter) -> Generator[simpy.Event, Any, dict[int, Bools]]:
        letters = [Datagram(self._head, node, parcel) for node, parcel in ask.parcels.items() if node in self._members]
        packets = sum(item.parcel.packets for item in letters if item.to != self._head)
        what = letters[0].parcel.what if letters else ""
        self._stage.log("allocate", self._target, self._head, what, packets=packets)
        yield from self._carry(letters, self._head)
        arrived = [item for item in letters if item.arrived and item.to in self._members]
        return {item.to: self._deliver(item.to, item.parcel, item.mask) for item in arrived}

    def _broadcast(self, ask: Broadcast) -> Generator[simpy.Event, Any, dict[int, Bools]]:
        event, (frame,) = self._stage.air.broadcast([self._head], [ask.parcel], self._target)
        yield event
        return {
            node: self._deliver(node, ask.parcel, mask)
            for node, mask in frame.received.items()
            if node in self._members
        }

    def _send(self, ask: Send) -> Generator[simpy.Event, Any, Bools]:
        item = Datagram(self._head, ask.to, ask.parcel)
        yield from self._carry([item])
        self.hops = item.hops
        return item.mask

    def _carry(self, letters: list[Datagram], hub: int | None = None) -> Generator[simpy.Event, Any, None]:
        if any(item.source != item.to for item in letters):
            yield self._stage.air.carry(letters, self._target, hub)
            self.bits += sum(item.bits for item in letters)
        else:
            for item in letters:
                item.arrived = True

    def _deliver(self, node: int, parcel: Parcel, mask: Bools) -> Bools:
        self._members[node].inbox.append(Delivery(parcel.what, parcel.payload, mask))
        return mask
