"""The flows and requests of a plug-in's tracker, checked one by one as they are made.

tracker.step = checked_flow(tracker, "step")     request_fault(request) -> what is wrong with it, '' if nothing is
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from typing import Any, Final

from wsnsim.base.answers import cycles_fault, ids_fault, number_fault, parcel_fault, told
from wsnsim.base.errors import PluginAnswerError, shown_value
from wsnsim.base.plugin_code import code_place, line_place
from wsnsim.base.requests import (
    Broadcast,
    Compute,
    Flow,
    Gather,
    GatherReadings,
    Local,
    Member,
    Parcel,
    Request,
    Scatter,
    Send,
)

MOST_REQUESTS: Final = 10_000
"""Of one flow: shipped trackers make at most a few dozen. A flow with more would hardly ever end."""
REQUESTS: Final = (Local, Compute, Gather, GatherReadings, Scatter, Broadcast, Send)


def checked_flow(tracker: Any, name: str) -> Callable[..., Flow[Any]]:
    """Return a method of a tracker whose requests are checked before they are performed, and whose belief is."""
    method, who = getattr(tracker, name), f"{type(tracker).__name__}.{name}"

    def flow(*arguments: Any, **options: Any) -> Flow[Any]:
        made = method(*arguments, **options)
        if not isinstance(made, Generator):
            fault = told("a generator, a function with yield", made)
            raise PluginAnswerError(f"{who}: {fault}", code_place(type(tracker), name))
        belief = yield from _performed(made, who)
        if belief is None and name != "hand_over":
            raise PluginAnswerError(f"{who}: {told('a belief', None)}", code_place(type(tracker), name))
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
            if fault := _too_many(count) or request_fault(request):
                raise PluginAnswerError(f"{who}: {fault}", line_place(made))
            try:
                answer = yield _with_checked_functions(request, who, line_place(made))
            except PluginAnswerError as refused:  # by the driver
                raise PluginAnswerError(f"{who}: {refused.said}", line_place(made)) from refused
    finally:
        made.close()


def _too_many(count: int) -> str:
    return f"more than {MOST_REQUESTS:,} requests in one step: does it end?" if count > MOST_REQUESTS else ""


def request_fault(request: Any) -> str:
    """Return what is wrong with a request, as far as it shows before the request is performed."""
    if type(request) not in REQUESTS:
        names = ", ".join(each.__name__ for each in REQUESTS)
        return f"{shown_value(request)} is not a request; requests are {names}"
    fault = _FAULTS[type(request)](request)
    return f"{type(request).__name__}: {fault}" if fault else ""


def _local_fault(request: Local) -> str:
    functions = [request.work] if request.work_all is None else [request.work, request.work_all]
    if not all(map(callable, functions)):
        return told("functions as work and work_all", functions[-1])
    return ids_fault(request.who) or ("" if callable(request.cycles) else cycles_fault(request.cycles))


def _gather_fault(request: Gather | GatherReadings) -> str:
    if isinstance(request, Gather) and not callable(request.parcel_of):
        return told("a function as parcel_of", request.parcel_of)
    if isinstance(request, GatherReadings) and (fault := number_fault(request.packet_bits, least=1)):
        return f"packet_bits: {fault}"
    return ids_fault(request.who)


def _scatter_fault(request: Scatter) -> str:
    if not isinstance(request.parcels, Mapping):
        return told("a mapping of ids to parcels", request.parcels)
    return ids_fault(request.parcels) or next(filter(None, map(parcel_fault, request.parcels.values())), "")


_FAULTS: Final[Mapping[type, Callable[[Any], str]]] = {
    Local: _local_fault,
    Compute: lambda request: cycles_fault(request.cycles),
    Gather: _gather_fault,
    GatherReadings: _gather_fault,
    Scatter: _scatter_fault,
    Broadcast: lambda request: parcel_fault(request.parcel),
    Send: lambda request: ids_fault([request.to]) or parcel_fault(request.parcel),
}


def _with_checked_functions(request: Request, who: str, place: str) -> Request:
    """The request; what the functions of a Local or a Gather return is checked for each member."""
    if isinstance(request, Local) and callable(request.cycles):
        return replace(request, cycles=_checked(request.cycles, cycles_fault, f"{who}: Local", place))
    if isinstance(request, Gather):

        def fault(parcel: Parcel | None) -> str:
            return "" if parcel is None else parcel_fault(parcel)

        return replace(request, parcel_of=_checked(request.parcel_of, fault, f"{who}: Gather", place))
    return request


def _checked(function: Callable[[Member], Any], fault_of: Callable[[Any], str], who: str, place: str) -> Any:
    def checked(member: Member) -> Any:
        answer = function(member)
        if fault := fault_of(answer):
            raise PluginAnswerError(f"{who}: node {member.id}: {fault}", place)
        return answer

    return checked
