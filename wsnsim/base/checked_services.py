"""The services that the mechanism of a plug-in is given: what it asks of the network is checked by parameter."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, Final

import numpy as np

from wsnsim.base.answers import LARGEST, ids_fault, number_fault, told
from wsnsim.base.errors import PluginAnswerError

_SIZES: Final = ("positions.__len__", "size.__int__", "radio.nodes.size.__int__", "_nodes.size.__int__")
"""Where the services of the roles know the number of nodes."""
_OF_NODES: Final = frozenset({"node", "nodes", "source", "to", "sleepers", "centre_node"})
_LEAST: Final[Mapping[str, float]] = {
    "seconds": 0.0, "joules": 0.0, "radius": 0.0, "probability": 0.0, "bits": 1.0, "payload_bits": 1.0,
    "rate": 1e-9, "shows": -LARGEST,
}  # fmt: skip
"""The least value of each number."""
_FUNCTIONS: Final = frozenset({"action", "done", "on_end", "on_heard", "on_awake"})
_FREE: Final = frozenset({("step_clocks", "seconds"), ("log_start", "node")})
"""Where seconds go back too, and where NOBODY is a node."""


class CheckedServices:
    """Passes on everything, and checks the arguments of calls: a fault is reported with the line that calls."""

    def __init__(self, services: Any) -> None:
        self._services = services

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._services, name)
        if not inspect.ismethod(value):
            return value
        parameters = tuple(inspect.signature(value).parameters)

        def checked(*arguments: Any, **options: Any) -> Any:
            for key, argument in (dict(zip(parameters, arguments, strict=False)) | options).items():
                if (name, key) not in _FREE and (fault := self._fault(key, argument)):
                    raise PluginAnswerError(f"services.{name}: {key}: {fault}")
            answer = value(*arguments, **options)
            return CheckedServices(answer) if name == "open_channel" else answer

        self.__dict__[name] = checked
        return checked

    def _fault(self, key: str, argument: Any) -> str:
        if key in _OF_NODES:
            return ids_fault(
                [argument] if np.ndim(argument) == 0 and not isinstance(argument, set) else argument, self._size
            )
        if key in _LEAST:
            most = 1.0 if key == "probability" else LARGEST
            return number_fault(argument, least=_LEAST[key], most=most, infinite=key in ("joules", "seconds"))
        return told("a function", argument) if key in _FUNCTIONS and not callable(argument) else ""

    @property
    def _size(self) -> float:
        """The number of nodes; infinite where the services do not know it."""
        for path in _SIZES:
            found: Callable[[], int] | None = None
            try:
                found = attrgetter(path)(self._services)
            except AttributeError:
                continue
            return found()
        return np.inf
