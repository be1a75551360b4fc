"""The mechanism of a component, its own or the built-in one that it names, and what all mechanisms may use."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.errors import RunError
from wsnsim.base.mac_mechanisms import MacMechanism, StartsMac
from wsnsim.base.mechanisms import StartsFault, StartsSync, StartsWakeUp, StartsWorkload, SyncServices, TimeSync
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.nodes import Nodes


class NetworkServices:
    """What every mechanism may use of the network (`base.mechanisms.NodeServices`); each role adds its own."""

    def __init__(self, env: simpy.Environment, nodes: Nodes, clocks: Clocks) -> None:
        self._env, self._nodes, self._clocks = env, nodes, clocks
        self.size = nodes.size
        self.is_awake: Callable[[int], bool] = nodes.is_awake
        self.lasts: Callable[[int, float], float] = clocks.lasts

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return float(self._env.now)

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""
        return bool(self._nodes.alive[node])

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""
        return self._nodes.is_empty(node)

    def clock(self, node: int) -> float:
        """What the clock of a node shows now, in s."""
        return self._clocks.local_time(node)

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        self._env.timeout(seconds).callbacks.append(lambda _: action())


class NetworkSyncServices(NetworkServices):
    """What time synchronisation may use of one network. `key` is its random key."""

    def __init__(
        self, env: simpy.Environment, nodes: Nodes, clocks: Clocks, mac: MacMechanism, log: EventLog, key: int
    ) -> None:  # fmt: skip
        super().__init__(env, nodes, clocks)
        self._mac = mac
        self._log = log
        self.key = key
        self.next_change: Callable[[int], float] = nodes.sleep_states.next_change
        self.own_clock: Callable[[int], float] = clocks.raw_time

    def set_clock(self, node: int, shows: float, rate: float) -> None:
        """Correct the clock of a node: it shows `shows` now, and its own clock counts `rate` s per second of it."""
        self._clocks.correct(node, shows - self._clocks.local_time(node), rate)

    def broadcast(self, node: int, bits: int, done: Callable[[Ints | None], None]) -> None:
        """Broadcast a message; `done` gets the nodes (n,) that received it, or None if it was not sent."""
        self._mac.offer(node, bits, done, self._log.code("sync"))


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


class MechanismRole(NamedTuple):
    """A role of components that act in simulated time.

    Attributes:
        port: The protocol of a component that starts its own mechanism.
        members: What a mechanism must have.
        built_in: "module:name" of the built-in mechanisms under `wsnsim.network`; a run imports its own only.
        others: Names of mechanisms that are not made here, for messages.
    """

    port: type
    members: tuple[str, ...]
    built_in: Mapping[str, str]
    others: tuple[str, ...] = ()


LASTING: Final = ("blackout", "link_loss", "clock_step", "stuck", "bias")
ROLES: Final = {
    "mac": MechanismRole(StartsMac, ("send", "offer", "silence"), {
        "ideal": "radio.ideal_medium:IdealMechanism",
        "csma": "radio.csma:CsmaMechanism",
        "tdma": "radio.tdma:TdmaMechanism",
        "xmac": "radio.lpl.xmac:XMacMechanism",
        "contikimac": "radio.lpl.contikimac:ContikiMacMechanism",
        "tsch": "radio.tsch.tsch_mechanism:TschMechanism",
    }),
    "sync": MechanismRole(StartsSync, ("begin", "forget", "is_synchronised"), {
        "none": "mechanisms:NoSyncMechanism",
        "ftsp": "ftsp:FtspMechanism",
    }),
    "faults": MechanismRole(StartsFault, ("begin", "end"), {
        "crash": "faults:OutageMechanism", "restart": "faults:OutageMechanism", "drain": "faults:DrainMechanism",
        **dict.fromkeys(LASTING, "faults:LastingMechanism"),
    }),
    "wakeup": MechanismRole(StartsWakeUp, ("begin",), {
        "flood": "clusters.wake_up_service:RegionWakeUp",
        "region": "clusters.wake_up_service:RegionWakeUp",
        "invite": "clusters.wake_up_service:InvitationWakeUp",
    }, ("none",)),
    "workload": MechanismRole(StartsWorkload, ("begin",), {
        "beacons": "workload_world:beacons",
        "collection": "workload_world:collection_reports",
    }, ("tracking",)),
}  # fmt: skip
"""The mechanisms of all roles. A new built-in one has a line here; a plug-in starts its own."""


def make_mechanism(role: str, component: Any, services: Any) -> Any:
    """Return the mechanism of a component: its own, or the built-in one that it names.

    Args:
        role: One of the ROLES.
        component: The component.
        services: All of the network that the mechanism may use.

    Raises:
        RunError: There is neither, or the component's own mechanism lacks members of its port.
    """
    port, members, built_in, others = ROLES[role]
    if isinstance(component, port):
        mechanism = component.start(services)  # type: ignore[attr-defined]
        lacking = [name for name in members if not callable(getattr(mechanism, name, None))]
        if lacking:
            name = type(mechanism).__name__
            raise RunError(f"{role}: {name}, which start(services) returned, lacks {', '.join(lacking)}")
        return mechanism
    if component.mechanism not in built_in:
        known = ", ".join([*others, *built_in])
        raise RunError(
            f"{role}: unknown mechanism '{component.mechanism}', and the component has no start(services); "
            f"known: {known}"
        )
    module, name = built_in[component.mechanism].split(":")
    return getattr(importlib.import_module(f"wsnsim.network.{module}"), name)(component, services)
