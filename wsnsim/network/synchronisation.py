"""Time synchronisation: its mechanisms, the services that they use, and the table `clocks` of how wrong clocks are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.mechanisms import StartsSync, SyncMechanism, SyncServices, TimeSync
from wsnsim.base.tables import Recorder
from wsnsim.network.clocks import Clocks
from wsnsim.network.mechanisms import NetworkServices, make_mechanism
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.radio_stack import RadioStack

COLUMNS = ("step", "time", "error", "error_max", "spread", "spread_max", "synchronised")


class NoSyncMechanism:
    """Nobody keeps clocks together."""

    def __init__(self, component: TimeSync, services: SyncServices) -> None: ...

    def begin(self) -> None:
        """The simulation starts."""

    def forget(self, node: int) -> None:
        """A node crashed."""

    def is_synchronised(self, node: int) -> bool:
        """False: no node is synchronised by this."""
        return False


MECHANISMS: Final[Mapping[str, str | Callable[[Any, SyncServices], SyncMechanism]]] = {
    "none": NoSyncMechanism,
    "ftsp": "wsnsim.network.ftsp:FtspMechanism",
}
"""The built-in mechanisms by name."""


def make_sync(component: TimeSync, services: SyncServices) -> SyncMechanism:
    """The mechanism of a component: its own, or the built-in one that it names.

    Raises:
        RunError: there is neither.
    """
    return make_mechanism("sync", component, services, StartsSync, ("begin", "forget", "is_synchronised"), MECHANISMS)


class NetworkSyncServices(NetworkServices):
    """What time synchronisation may use of one network. `key` is its random key."""

    def __init__(self, stack: RadioStack, key: int) -> None:
        super().__init__(stack.radio.env, stack.radio.nodes, stack.clocks)
        self._mac = stack.mac
        self._word = stack.radio.log.code
        self.key = key
        self.size = self._nodes.size
        self.next_change: Callable[[int], float] = self._nodes.sleep_states.next_change
        self.clock: Callable[[int], float] = stack.clocks.local_time
        self.own_clock: Callable[[int], float] = stack.clocks.raw_time

    def set_clock(self, node: int, shows: float, rate: float) -> None:
        """Correct the clock of a node: it shows `shows` now, and its own clock counts `rate` s per second of it."""
        self._clocks.correct(node, shows - self._clocks.local_time(node), rate)

    def broadcast(self, node: int, bits: int, done: Callable[[Ints | None], None]) -> None:
        """Broadcast a message; `done` gets the nodes (n,) that received it, or None if it was not sent."""
        self._mac.offer(node, bits, done, self._word("sync"))


class ClockErrors:
    """The errors of clocks at the beginnings of steps, from which the rows of the table are made."""

    def __init__(self, clocks: Clocks, nodes: Nodes, sync: SyncMechanism, recorder: Recorder) -> None:
        self._wanted = recorder.wants("clocks")
        self._clocks, self._nodes, self._sync = clocks, nodes, sync
        self._rows: list[tuple[float, ...]] = []

    def note(self, step: int, now: float) -> None:
        """Note the errors of the nodes that are up, at the beginning of a step."""
        if not self._wanted or not self._nodes.living.any():
            return
        up = np.flatnonzero(self._nodes.living)
        errors = self._clocks.error(up, now)
        sizes, spreads = np.abs(errors), np.abs(errors - errors.mean())
        synchronised = sum(map(self._sync.is_synchronised, up.tolist())) / len(up)
        self._rows.append((step, now, sizes.mean(), sizes.max(), spreads.mean(), spreads.max(), synchronised))

    def write(self, replicate: int, recorder: Recorder) -> None:
        """Write the table if it is wanted."""
        if self._rows:
            columns = dict(zip(COLUMNS, np.array(self._rows).T, strict=True))
            recorder.write("clocks", {"replicate": replicate, **columns})
