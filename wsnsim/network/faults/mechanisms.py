"""The mechanisms of faults: the built-in ones, and the table that binds them to the names of fault components."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.mechanisms import (
    NOBODY,
    FaultMechanism,
    FaultServices,
    SensorDefect,
    StartsFault,
)
from wsnsim.base.network_ports import FaultEvent
from wsnsim.network.mechanisms import make_mechanism

CHANGE_READINGS: Final = frozenset({"clock_step", "stuck", "bias"})
"""Built-in mechanisms that change what sensors read."""


class OutageMechanism:
    """The nodes are down for the duration; `alone`: whatever other faults hold them down."""

    def __init__(self, services: FaultServices, alone: bool) -> None:
        self._services = services
        self._take_down = services.take_down_alone if alone else services.take_down

    def begin(self, nodes: Ints) -> None:
        """Log, then crash: the rows of all nodes that are hit come first."""
        _log_starts(self._services, nodes)
        self._take_down(nodes)

    def end(self, nodes: Ints) -> None:
        """Restart them; the restarts are logged in place of the end of the fault."""
        self._services.bring_up()


class DrainMechanism:
    """Nodes lose energy: `joules`, or a `share` of what is left; nodes that are down lose none (our choice)."""

    def __init__(self, services: FaultServices, joules: float | None, share: float | None) -> None:
        self._services = services
        self._joules = joules
        self._share = share

    def begin(self, nodes: Ints) -> None:
        """Drain the nodes that are up, one after the other."""
        up = [node for node in nodes.tolist() if self._services.is_up(node)]
        for node in up:
            self._services.log_start(node, self._services.drain(node, self._amount(node)))
        if not up:
            self._services.log_start(NOBODY)

    def end(self, nodes: Ints) -> None:
        """Charge does not come back."""

    def _amount(self, node: int) -> float:
        if self._joules is not None:
            return self._joules
        assert self._share is not None, "a drain has joules or a share"
        return self._services.residual_energy(node) * self._share if self._share < 1.0 else np.inf


class LastingMechanism:
    """A change to the nodes that is undone after the duration. Both are logged."""

    def __init__(self, services: FaultServices, apply: Callable[[Ints], None], undo: Callable[[Ints], None]) -> None:
        self._services = services
        self._apply = apply
        self._undo = undo

    def begin(self, nodes: Ints) -> None:
        """Log and apply the change."""
        _log_starts(self._services, nodes)
        self._apply(nodes)

    def end(self, nodes: Ints) -> None:
        """Log the end for the nodes that are not dead, and undo the change."""
        for node in nodes.tolist():
            if not self._services.is_dead(node):
                self._services.log_end(node)
        self._undo(nodes)


def _log_starts(services: FaultServices, nodes: Ints) -> None:
    for node in nodes.tolist():
        services.log_start(node)


def _blackout(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(services, services.jam, services.unjam)


def _link_loss(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(services, lambda nodes: services.set_loss(nodes, fault.loss), services.clear_loss)


def _clock_step(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(
        services,
        lambda nodes: services.step_clocks(nodes, fault.offset),
        lambda nodes: services.step_clocks(nodes, -fault.offset),
    )


def _defect(services: FaultServices, fault: Any, **defect: Any) -> FaultMechanism:
    component = getattr(fault, "component", "")
    return LastingMechanism(
        services,
        lambda nodes: services.set_defect(SensorDefect(frozenset(nodes.tolist()), component=component, **defect)),
        lambda nodes: services.clear_defect(),
    )


MECHANISMS: Final[Mapping[str, Callable[[Any, FaultServices], FaultMechanism]]] = {
    "crash": lambda fault, services: OutageMechanism(services, alone=False),
    "restart": lambda fault, services: OutageMechanism(services, alone=True),
    "drain": lambda fault, services: DrainMechanism(services, fault.joules, fault.share),
    "blackout": _blackout,
    "link_loss": _link_loss,
    "clock_step": _clock_step,
    "stuck": lambda fault, services: _defect(services, fault, stuck=True, value=fault.value),
    "bias": lambda fault, services: _defect(services, fault, offset=fault.offset),
}
"""Built-in mechanisms by the name in `fault.mechanism`. The first argument is the component."""


def change_readings(faults: Iterable[FaultEvent]) -> bool:
    """Whether any of the faults may change what sensors read. A plug-in may."""
    return any(fault.mechanism in CHANGE_READINGS or isinstance(fault, StartsFault) for fault in faults)


def make_fault(fault: FaultEvent, services: FaultServices) -> FaultMechanism:
    """Return the mechanism of a fault: its own, or the built-in one of that name.

    Raises:
        RunError: There is neither.
    """
    return make_mechanism("faults", fault, services, StartsFault, ("begin", "end"), MECHANISMS)
