"""The mechanisms of time synchronisation: a plug-in's own, or a built-in one by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from wsnsim.base.synchronisation import StartsSync, SyncMechanism, SyncServices, TimeSync
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.network.synchronisation.ftsp import FtspMechanism


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


MECHANISMS: Final[Mapping[str, Callable[[Any, SyncServices], SyncMechanism]]] = {
    "none": NoSyncMechanism,
    "ftsp": FtspMechanism,
}
"""The built-in mechanisms by name."""


def make_sync(component: TimeSync, services: SyncServices) -> SyncMechanism:
    """The mechanism of a component: its own, or the built-in one that it names.

    Raises:
        RunError: there is neither.
    """
    return make_mechanism("sync", component, services, StartsSync, ("begin", "forget", "is_synchronised"), MECHANISMS)
