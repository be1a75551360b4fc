"""The mechanism of a component, its own or the built-in one that it names, and what all mechanisms may use."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import simpy

from wsnsim.base.errors import RunError
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import then
from wsnsim.network.nodes import Nodes

Services = TypeVar("Services")
Mechanism = TypeVar("Mechanism")


class NetworkServices:
    """What every mechanism may use of the network (`base.mechanisms.NodeServices`); each role adds its own."""

    def __init__(self, env: simpy.Environment, nodes: Nodes, clocks: Clocks) -> None:
        self._env, self._nodes, self._clocks = env, nodes, clocks
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
        return node in self._nodes.died_at

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        then(self._env.timeout(seconds), action)


def make_mechanism(
    role: str,
    component: Any,
    services: Services,
    port: type,
    members: Sequence[str],
    built_in: Mapping[str, str | Callable[[Any, Services], Mechanism]],
    *others: str,
) -> Mechanism:
    """Return the mechanism of a component.

    Args:
        role: The role of the component, for messages.
        component: The component.
        services: All of the network that the mechanism may use.
        port: The protocol of a component that starts its own mechanism.
        members: What such a mechanism must have.
        built_in: What makes the built-in mechanisms, by name: the class, or "module:class" if it is imported now only.
        others: Names of mechanisms that are not made here, for messages.

    Raises:
        RunError: There is neither, or the component's own mechanism lacks members of its port.
    """
    if isinstance(component, port):
        own: Mechanism = _started(role, component, services, members)
        return own
    if component.mechanism not in built_in:
        known = ", ".join([*others, *built_in])
        raise RunError(
            f"{role}: unknown mechanism '{component.mechanism}', and the component has no start(services); "
            f"known: {known}"
        )
    makes: Any = built_in[component.mechanism]
    if isinstance(makes, str):
        module, name = makes.split(":")
        makes = getattr(importlib.import_module(module), name)
    mechanism: Mechanism = makes(component, services)
    return mechanism


def _started(role: str, component: Any, services: Any, members: Sequence[str]) -> Any:
    mechanism = component.start(services)
    lacking = [name for name in members if not callable(getattr(mechanism, name, None))]
    if lacking:
        raise RunError(
            f"{role}: {type(mechanism).__name__}, which start(services) returned, lacks {', '.join(lacking)}"
        )
    return mechanism
