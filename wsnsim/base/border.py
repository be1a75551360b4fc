"""The border to plug-ins: what their components answer is checked against the annotations of their ports.

    checked_setup(setup)               the setup, in which every component of a plug-in is checked from now on
    checked(component, Port, columns)  the same for one component: what the `check_*` of `wsnsim.testing` use

A checked component is a copy whose methods look at their own answers. The components of wsnsim are left alone, since
the contract suite calls them checked; runs without a plug-in therefore cost nothing more.

`CheckedServices` are what the mechanism of a plug-in is given: what it asks of the network is checked by parameter.
"""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Callable, Generator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache, partial
from typing import Any, Final, TypeVar, cast

import numpy as np

from wsnsim.base import (
    answers,
    batteries,
    detections,
    initial_conditions,
    mac_mechanisms,
    mechanisms,
    medium_access,
    network_ports,
    optional_ports,
    ports,
    radio,
    sleeping,
)
from wsnsim.base.answers import is_protocol
from wsnsim.base.errors import PluginAnswerError, WsnsimError
from wsnsim.base.plugin_code import code_place, line_place, plugin_fault
from wsnsim.base.requests import Exchange, Flow, Gather, Local, Member, Parcel, Request
from wsnsim.base.setups import Setup, TrackingSetup

_OF_NODES: Final = frozenset({"node", "nodes", "source", "to", "sleepers", "centre_node"})
_LEAST: Final[Mapping[str, float]] = {
    "seconds": 0.0, "joules": 0.0, "radius": 0.0, "probability": 0.0, "bits": 1.0, "payload_bits": 1.0,
    "rate": 1e-9, "shows": -answers.LARGEST,
}  # fmt: skip
"""The least value of each number."""
_FUNCTIONS: Final = frozenset({"action", "done", "on_end", "on_heard", "on_awake"})
_FREE: Final = frozenset({("step_clocks", "seconds"), ("log_start", "node")})
"""Where seconds go back too, and where NOBODY is a node."""


class CheckedServices:
    """Passes on everything, and checks the arguments of calls: a fault is reported with the line that calls."""

    def __init__(self, services: Any, size: float | None = None) -> None:
        self._services = services
        self._size: float = getattr(services, "size", np.inf) if size is None else size

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
            return CheckedServices(answer, self._size) if name == "open_channel" else answer

        self.__dict__[name] = checked
        return checked

    def _fault(self, key: str, argument: Any) -> str:
        if key in _OF_NODES:
            return answers.ids_fault(
                [argument] if np.ndim(argument) == 0 and not isinstance(argument, set) else argument, self._size
            )
        if key in _LEAST:
            most = 1.0 if key == "probability" else answers.LARGEST
            return answers.number_fault(argument, least=_LEAST[key], most=most, infinite=key in ("joules", "seconds"))
        return answers.told("a function", argument) if key in _FUNCTIONS and not callable(argument) else ""


Component = TypeVar("Component")
SetupKind = TypeVar("SetupKind", bound=Setup)
_MODULES: Final = (
    ports, optional_ports, network_ports, radio, medium_access, sleeping, mechanisms, mac_mechanisms,
    initial_conditions, batteries, detections,
)  # fmt: skip
NAMES: Final[Mapping[str, Any]] = {name: value for module in _MODULES for name, value in vars(module).items()}
"""What the annotations of ports may name."""
_OF_ROLES: Final[Mapping[type, tuple[type, ...]]] = {
    mechanisms.StartsFault: (network_ports.FaultEvent,),
    mechanisms.StartsWakeUp: (sleeping.WakeUp,),
    mechanisms.StartsWorkload: (network_ports.Workload,),
    mechanisms.StartsSync: (mechanisms.TimeSync,),
    mac_mechanisms.StartsMac: (medium_access.Mac,),
    network_ports.HasSeveralSinks: (network_ports.Sink, network_ports.Workload),
}
"""The roles of optional ports whose members, such as `start`, mean something else in other roles."""
_OPTIONAL: Final = [
    port for port in NAMES.values() if is_protocol(port) and getattr(port, "_is_runtime_protocol", False)
]


def checked_setup(setup: SetupKind) -> SetupKind:
    """Return the setup with checked components where they, or components within them, are those of plug-ins.

    Raises:
        PluginAnswerError: A property of a component is wrong.
    """
    return _with_checked_fields(setup, len(setup.motions[0].columns) if isinstance(setup, TrackingSetup) else None)


def _with_checked_fields(component: Component, columns: int | None) -> Component:
    """The component, or a copy of it whose fields hold checked components."""
    changed: dict[str, Any] = {}
    for name, port in _component_fields(cast(Any, type(component))):
        value = getattr(component, name, None)
        old = value if isinstance(value, tuple) else () if value is None else (value,)
        new = tuple(_if_foreign(part, port, columns) for part in old)
        if any(one is not other for one, other in zip(old, new, strict=True)):
            changed[name] = new if isinstance(value, tuple) else new[0]
    if not changed:
        return component
    result = copy.copy(component)
    for name, value in changed.items():
        object.__setattr__(result, name, value)
    return result


@lru_cache
def _component_fields(kind: Any) -> list[tuple[str, type]]:
    """The fields of a class that hold components, and their ports, by their annotations."""
    named = {
        field.name: [NAMES[word] for word in re.findall(r"\w+", str(field.type)) if is_protocol(NAMES.get(word))]
        for field in (fields(kind) if is_dataclass(kind) else ())
    }
    return [(name, found[0]) for name, found in named.items() if found]


def _if_foreign(component: Any, port: type, columns: int | None) -> Any:
    own = type(component).__module__.partition(".")[0] == "wsnsim"
    return (_with_checked_fields if own else partial(checked, port=port))(component, columns=columns)


def checked(component: Component, port: type, columns: int | None = None) -> Component:
    """Return a copy of a component, or a mechanism itself, whose answers are checked from now on.

    Args:
        component: The component.
        port: The protocol of its role.
        columns: The number of columns of the target's state, which the estimates of trackers have.

    Raises:
        PluginAnswerError: A property is wrong.
    """
    if "_border" in getattr(component, "__dict__", ()):
        return component
    port = NAMES.get(ports.port_of(component), port)
    if port.__name__.endswith("Mechanism"):  # others hold it
        result = component if hasattr(component, "__dict__") else None
    else:
        result = _with_room(_with_checked_fields(component, columns))
    if result is None:
        return component
    object.__setattr__(result, "_border", columns)
    for name, (returns, parameters) in _members_of(cast(Any, type(component)), port).items():
        if parameters is None:
            _demand(result, name, returns, getattr(result, name), {})
        elif returns.startswith("Flow"):
            object.__setattr__(result, name, checked_flow(result, name, "None" not in returns))
        elif returns != "None":
            object.__setattr__(result, name, _checked_method(result, name, returns, parameters))
    return result


def _with_room(component: Component) -> Component | None:
    """A copy that can hold methods of its own, of a class with `__slots__` one of a subclass; None if there is none."""
    kind: Any = type(component)
    if hasattr(component, "__dict__"):
        return copy.copy(component)
    if kind.__new__ is not object.__new__ or "__slots__" not in vars(kind):  # a tuple, or no class of Python's
        return None
    room = {"__module__": kind.__module__, "__qualname__": kind.__qualname__}
    fields = {"__getattr__": lambda _, name: getattr(component, name)}  # asked where a slot is empty
    return cast(Component, object.__new__(type(kind.__name__, (kind,), room | fields)))


def _checked_method(component: Any, name: str, returns: str, parameters: tuple[str, ...]) -> Callable[..., Any]:
    method, port = getattr(component, name), NAMES.get(returns, object)
    goes_on = is_protocol(port) and returns != "Signal"

    def answer(*arguments: Any, **options: Any) -> Any:
        if parameters == ("services",):
            arguments = (CheckedServices(*arguments),)
        try:
            found = method(*arguments, **options)
        except Exception as reason:
            if isinstance(reason, WsnsimError) or plugin_fault(reason):
                raise
            said = f"{type(component).__name__}.{name} failed: {type(reason).__name__}: {reason}"
            raise PluginAnswerError(said, code_place(type(component), name)) from reason
        _demand(component, name, returns, found, dict(zip(parameters, arguments, strict=False)) | options)
        return _if_foreign(found, port, component._border) if goes_on else found

    return answer


def _demand(component: Any, name: str, returns: str, found: Any, given: Mapping[str, Any]) -> None:
    """Raise PluginAnswerError if a member of a component is not what its port says."""
    shape = answers.SHAPES[name](component, given) if name in answers.SHAPES and given else None
    shapes = shape if isinstance(shape, list) else [] if shape is None else [shape]
    infinite, signed = name in answers.INFINITE, name in answers.SIGNED
    fault = answers.fault_of(returns, found, answers.ExpectedAnswer(NAMES, shapes, component._border, infinite, signed))
    choices = answers.CHOICES.get(name) if given and found is not None else None
    if not fault and choices and found not in choices(given):
        fault = answers.told("one of the nodes that it was given", found)
    if fault and all(map(_is_finite, given.values())):  # otherwise it is not to blame
        raise PluginAnswerError(f"{type(component).__name__}.{name}: {fault}", code_place(type(component), name))


def _is_finite(value: Any) -> bool:
    return (
        not isinstance(value, float | np.ndarray)
        or np.asarray(value).dtype.kind != "f"
        or bool(np.isfinite(value).all())
    )


@lru_cache
def _members_of(kind: Any, port: type) -> dict[str, tuple[str, tuple[str, ...] | None]]:
    """The members of a port and of the class's optional ports: {name: (annotation, parameters of a method)}."""
    members: dict[str, tuple[str, tuple[str, ...] | None]] = {}
    optional = [each for each in _OPTIONAL if port in _OF_ROLES.get(each, (port,)) and _offers(kind, each)]
    for each in (port, *optional):
        for base in filter(is_protocol, each.__mro__):
            for name, value in vars(base).items():
                function = value.fget if isinstance(value, property) else value
                if name[0] != "_" and inspect.isfunction(function) and _has(kind, name) and name not in members:
                    parameters = None if isinstance(value, property) else tuple(inspect.signature(value).parameters)[1:]
                    members[name] = str(function.__annotations__.get("return", "")), parameters
    return members


def _offers(kind: type, port: type) -> bool:
    """Whether a class has all members of a port, methods as methods and properties as properties."""
    members = {name: value for base in filter(is_protocol, port.__mro__) for name, value in vars(base).items()}
    return all(
        _has(kind, name) and inspect.isfunction(getattr(kind, name, None)) == inspect.isfunction(value)
        for name, value in members.items()
        if name[0] != "_"
    )


def _has(kind: type, name: str) -> bool:
    return hasattr(kind, name) or name in getattr(kind, "__dataclass_fields__", {})


MOST_REQUESTS: Final = 10_000
"""Of one flow: shipped trackers make at most a few dozen. A flow with more would hardly ever end."""


def checked_flow(tracker: Any, name: str, gives_belief: bool = True) -> Callable[..., Flow[Any]]:
    """Return a method of a tracker whose requests are checked before they are performed.

    Args:
        tracker: The tracker.
        name: The name of the method.
        gives_belief: Whether the flow must return a belief.
    """
    method, who = getattr(tracker, name), f"{type(tracker).__name__}.{name}"

    def flow(*arguments: Any, **options: Any) -> Flow[Any]:
        made = method(*arguments, **options)
        if not isinstance(made, Generator):
            fault = answers.told("a generator, a function with yield", made)
            raise PluginAnswerError(f"{who}: {fault}", code_place(type(tracker), name))
        belief = yield from _performed(made, who)
        if belief is None and gives_belief:
            raise PluginAnswerError(f"{who}: {answers.told('a belief', None)}", code_place(type(tracker), name))
        return belief

    return flow


def _performed(made: Flow[Any], who: str) -> Flow[Any]:
    """Pass on the requests of a flow, and the answers to it."""
    answer, count = None, 0
    try:
        while True:
            place = line_place(made)
            try:
                request = made.send(answer)
            except StopIteration as end:
                return end.value
            except GeneratorExit as reason:
                said = f"{who} raises GeneratorExit, by which the network ends a flow from outside"
                raise PluginAnswerError(said, place) from reason
            count += 1
            endless = f"more than {MOST_REQUESTS:,} requests in one step: does it end?" if count > MOST_REQUESTS else ""
            if fault := endless or answers.request_fault(request):
                raise PluginAnswerError(f"{who}: {fault}", line_place(made))
            try:
                answer = yield _with_checked_functions(request, who, line_place(made))
            except PluginAnswerError as refused:  # by the driver
                raise PluginAnswerError(f"{who}: {refused.said}", line_place(made)) from refused
    finally:
        made.close()


def _with_checked_functions(request: Request, who: str, place: str) -> Request:
    """The request; what the functions of a Local, a Gather or an Exchange return is checked for each member."""
    if isinstance(request, Local) and callable(request.cycles):
        return replace(request, cycles=_checked(request.cycles, answers.cycles_fault, f"{who}: Local", place))
    if isinstance(request, Gather | Exchange):

        def fault(parcel: Parcel | None) -> str:
            return "" if parcel is None else answers.parcel_fault(parcel)

        name = f"{who}: {type(request).__name__}"
        return replace(request, parcel_of=_checked(request.parcel_of, fault, name, place))
    return request


def _checked(function: Callable[[Member], Any], fault_of: Callable[[Any], str], who: str, place: str) -> Any:
    def checked(member: Member) -> Any:
        answer = function(member)
        if fault := fault_of(answer):
            raise PluginAnswerError(f"{who}: node {member.id}: {fault}", place)
        return answer

    return checked
