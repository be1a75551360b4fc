"""The mechanism of `mac: tsch`: frames of bursts and broadcasts on their way into slots.

Slots and radios are in `slots`, frames in slots in `exchanges`, cells of clusters in `cell_leases`, and the
clocks of nodes in `synchronisation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import simpy

from wsnsim.base.frames import EVERYONE, Burst, MacFrame, OfferedFrame, Received
from wsnsim.models.tsch import Tsch
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices
from wsnsim.network.radio.tsch.cell_leases import CellLeases
from wsnsim.network.radio.tsch.exchanges import Exchanges
from wsnsim.network.radio.tsch.slots import SlotRadios, Slots
from wsnsim.network.radio.tsch.synchronisation import Synchronisation


class TschMechanism(MacPart):
    """TSCH of all nodes."""

    def __init__(self, mac: Tsch, services: NetworkMacServices) -> None:
        super().__init__(services)
        self._mac = mac
        slots = Slots(mac, services.clocks)
        self._radios = SlotRadios(mac, slots, self._nodes)
        self._exchanges = Exchanges(mac, services, slots, self._radios)
        self._leases = CellLeases(mac, services, slots, self._radios, self._exchanges)
        self._fragmentation = services.fragmentation(mac)
        self._sync = Synchronisation(mac, services, self._radios, self._exchanges, self._leases)
        services.clocks.on_step.append(self._sync.note_change)
        if not services.clocks.perfect:
            self._sync.start()

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Send bursts; those between a head and its members in cells that it gives them."""
        in_cluster: list[tuple[int, MacFrame]] = []

        def enqueue(node: int, frame: MacFrame) -> None:
            if head is None or frame.to == EVERYONE:
                self._exchanges.enqueue(self._leases.shared_line(node), frame)
            else:
                in_cluster.append((node, frame))

        def may_send(burst: Burst) -> bool:
            return self._may_send(burst.source, burst)

        event = self._fragmentation.send_all(bursts, self._env.event(), may_send, enqueue)
        if head is not None and in_cluster:
            self._leases.request(head, in_cluster)
        return event

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, then call `done` with the receivers, or with None if its sender lost the time."""
        frame = OfferedFrame(self._mac.bits(payload_bits), code, done)
        if self._may_send(node, frame):
            self._exchanges.enqueue(self._leases.shared_line(node), frame)
        else:
            done(None)

    def expect(self, head: int, members: Sequence[int]) -> None:
        """Give members cells with the next lease of their head, before they have something to send."""
        self._leases.expect(head, members)

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost, its transmission is cut, and it has no cells."""
        self._exchanges.silence(node)
        for line in self._leases.forget(node):
            self._exchanges.stop(line)
        for frame in self._leases.take_waiting(node):
            frame.finish(None)
        self._radios.forget(node)

    def restart(self, node: int) -> None:
        """A node that is up again after a crash does not know the time, where clocks err."""
        self._sync.lose(node)

    def _may_send(self, node: int, dropped: Burst | MacFrame) -> bool:
        """Whether a node is up and knows the time; otherwise what it was to send is logged as dropped."""
        if not self._nodes.alive[node]:
            return False
        if self._radios.is_scanning(node):
            self._services.log_drop(node, dropped, "no_time")
            return False
        return True
