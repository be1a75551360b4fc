"""What an answer of a plug-in must be: of the type that its port's annotation names, of the right shape, and finite.

The same of the requests of its trackers, as far as it shows before a request is performed.

Each function returns what is wrong, in words; '' if nothing is. `wsnsim.testing` asks the same functions.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from numbers import Integral, Real
from typing import Any, Final, NamedTuple, get_args

import numpy as np

from wsnsim.base.arrays import components_of
from wsnsim.base.errors import shown_value
from wsnsim.base.requests import (
    Broadcast,
    Compute,
    Exchange,
    Gather,
    GatherLate,
    GatherReadings,
    Local,
    Parcel,
    Scatter,
    Send,
)
from wsnsim.base.scans import EventKind, ScanOutcome, TrackEstimate, TrackEvent

LARGEST: Final = 1e100
"""A greater number is a mistake: no quantity of a network is, and its powers overflow."""
MOST_CYCLES: Final = 1e15
"""Of one request: a processor of 30 MHz is busy with them for a year."""
MOST_PACKETS: Final = 1_000_000
"""Of one parcel: at 250 kbit/s they take more than six minutes."""
ROUNDING: Final = 1e-9
"""Of a covariance, relative to its trace."""
_ARRAYS: Final = {"Floats": ("fiu", "real numbers"), "Ints": ("iu", "integers"), "Bools": ("b", "truth values")}
_PLAIN: Final = {"bool": ((bool, np.bool_), "True or False"), "str": (str, "a text")}
INFINITE: Final = frozenset(
    {"powers", "log_likelihood", "log_transition", "state", "round_end", "reading_limits", "drawable"}
)
"""Methods whose answers may be infinite."""
SIGNED: Final = frozenset({"strength", "reading_limits", "points", "point", "region", "losses"})
"""Members whose numbers may be negative."""


def _points(component: Any, given: Mapping[str, Any]) -> tuple[int, int]:
    """(rows of a linearisation, points)."""
    return len(given["positions"]) * len(components_of(component)), np.shape(given["points"])[1]


Shape = tuple[int | None, ...]
SHAPES: Final[Mapping[str, Callable[[Any, Mapping[str, Any]], Shape | list[Shape]]]] = {
    "draw": lambda part, given: (None, 2),
    "truth": lambda part, given: (given["steps"] + 1, len(part.columns)),
    "propagate": lambda part, given: np.shape(given["states"]),
    "advance": lambda part, given: np.shape(given["states"]) if "states" in given else (),
    "matrices": lambda part, given: [(None, len(part.columns), len(part.columns)), (len(part.columns),) * 2],
    "log_transition": lambda part, given: np.shape(given["after"])[1:],
    "heights": lambda part, given: (given["steps"] + 1,),
    "draw_traits": lambda part, given: (given["nodes"], len(part.trait_names)),
    "measure": lambda part, given: np.shape(given["noise"]),
    "detects": lambda part, given: (len(given["points"]), len(given["positions"])),
    "linearise": lambda part, given: [
        _points(part, given), (_points(part, given)[0], len(given["points"]), _points(part, given)[1]),
        _points(part, given),
    ],
    "log_likelihood": lambda part, given: np.shape(given["points"])[1:],
    "distort": lambda part, given: np.shape(given["readings"]),
    "powers": lambda part, given: np.shape(given["distances"]),
    "reception": lambda part, given: np.shape(given["powers"]),
    "senses": lambda part, given: np.shape(given["powers"]),
    "rates": lambda part, given: np.shape(given["keys"]),
    "offsets": lambda part, given: np.shape(given["keys"]),
    "awake": lambda part, given: np.shape(given["keys"]),
    "state": lambda part, given: [np.shape(given["keys"])] * 3,
    "tally": lambda part, given: [np.shape(given["keys"])] * 2,
    "profile": lambda part, given: [np.shape(given["times"])] * 2,
    "step": lambda part, given: [(len(scan.detections),) for scan in given["scans"]],
}  # fmt: skip
"""The shape of the answer of a method, or those of its arrays, from the component and the arguments by name."""
CHOICES: Final[Mapping[str, Callable[[Mapping[str, Any]], Sequence[int]]]] = {
    "elect": lambda given: given["ids"],
    "successor": lambda given: range(len(given["positions"])),
}
"""The nodes among which a method chooses."""


class ExpectedAnswer(NamedTuple):
    """What is demanded of an answer beside its type.

    Attributes:
        names: what annotations may name.
        shapes: those of its arrays, in order; none: any.
        columns: the size of the mean of an Estimate; None: any.
        infinite: whether numbers may be infinite.
        signed: whether single numbers may be negative.
    """

    names: Mapping[str, Any]
    shapes: Sequence[Shape] = ()
    columns: int | None = None
    infinite: bool = False
    signed: bool = False


def told(expected: str, found: object) -> str:
    """Return 'expected ..., not ...', with the value found."""
    if inspect.iscoroutine(found):
        found.close()  # otherwise Python warns that nobody awaited it
    if isinstance(found, np.ndarray) and found.size > 1:
        return f"expected {expected}, not an array of {found.dtype} of shape {found.shape}"
    found = found.item() if isinstance(found, np.generic) else found
    hint = " (of an async function)" if inspect.iscoroutine(found) or inspect.isasyncgen(found) else ""
    return f"expected {expected}, not {shown_value(found)}{hint}"


def is_protocol(kind: Any) -> bool:
    """Whether something is a port."""
    return isinstance(kind, type) and bool(getattr(kind, "_is_protocol", False))


def fault_of(annotation: str, value: Any, wanted: ExpectedAnswer) -> str:
    """Return what is wrong with a value of which the annotation of a port says the type."""
    options = _parts(annotation, "|")
    if len(options) > 1:
        if value is None and "None" in options:
            return ""
        faults = [fault_of(option, value, wanted) for option in options if option != "None"]
        return "" if "" in faults else faults[0]
    if annotation.startswith("tuple["):
        return _tuple_fault(_parts(annotation[6:-1], ","), value, wanted)
    if annotation in _ARRAYS:
        return array_fault(value, *_ARRAYS[annotation], wanted.shapes[0] if wanted.shapes else None, wanted.infinite)
    if annotation in ("float", "int"):
        return number_fault(value, annotation == "int", -LARGEST if wanted.signed else 0.0, infinite=True)
    if annotation in _OF_BELIEFS:
        return _OF_BELIEFS[annotation](value, wanted)
    return _object_fault(annotation, value, wanted.names.get(annotation))


@lru_cache
def _parts(annotation: str, separator: str) -> list[str]:
    """The parts of an annotation between separators outside of brackets."""
    parts, depth = [""], 0
    for letter in annotation:
        depth += (letter == "[") - (letter == "]")
        if letter == separator and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _tuple_fault(kinds: list[str], value: Any, wanted: ExpectedAnswer) -> str:
    if kinds[-1] == "...":
        kinds = [kinds[0]] * len(value) if isinstance(value, tuple) else [""]
    if not isinstance(value, tuple) or len(value) != len(kinds):
        return told(f"a tuple of {len(kinds)}", value)
    each = [[shape] for shape in wanted.shapes] or [[]] * len(kinds)
    faults = (
        fault_of(kind, one, wanted._replace(shapes=shapes))
        for kind, one, shapes in zip(kinds, value, each, strict=True)
    )
    return next((f"number {i} of its tuple: {fault}" for i, fault in enumerate(faults, 1) if fault), "")


def _object_fault(annotation: str, value: Any, kind: Any) -> str:
    if kind is Any:
        return ""
    if is_protocol(kind):
        names = [name for base in kind.__mro__ if is_protocol(base) for name in vars(base) if name[0] != "_"]
        lacking = [name for name in names if not hasattr(value, name)]
        return told(f"a {annotation}", value) + f", which lacks {', '.join(lacking)}" if lacking else ""
    kind, name = _PLAIN.get(annotation, (kind, f"a {annotation}"))
    return told(name, value) if isinstance(kind, type | tuple) and not isinstance(value, kind) else ""


def number_fault(
    value: Any, whole: bool = False, least: float = 0.0, most: float = LARGEST, infinite: bool = False
) -> str:
    """Return what is wrong with a number that must lie between two bounds; with `infinite` it may be infinite."""
    kind = isinstance(value, Integral if whole else Real) and not isinstance(value, bool | np.bool_)
    if kind and (least <= value <= most or (infinite and value == np.inf)):
        return ""
    bounds = f", {least:g} or more" if most == LARGEST else f" from {least:g} to {most:g}"
    return told(f"{'an integer' if whole else 'a number'}{'' if least == -LARGEST else bounds}", value)


def array_fault(value: Any, letters: str, what: str, shape: Shape | None = None, infinite: bool = False) -> str:
    """Return what is wrong with an array: its type, its shape, or numbers that are not finite."""
    try:
        array = np.asarray(value)
    except ValueError:
        return told(f"an array of {what}", value)
    if array.dtype.kind not in letters and array.size:
        return told(f"an array of {what}", value)
    if shape is not None and (
        array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True))
    ):
        expected = str(tuple("N" if n is None else n for n in shape)).replace("'", "")
        return f"expected an array of shape {expected}, not {array.shape}"
    if array.dtype.kind != "f":
        return ""
    with np.errstate(invalid="ignore"):
        bad = np.isnan(array) if infinite else ~(np.abs(array) <= LARGEST)
    return f"expected finite numbers, not {array[bad][0]} ({bad.sum()} of {array.size})" if bad.any() else ""


def estimate_fault(estimate: Any, columns: int | None = None) -> str:
    """Return what is wrong with an Estimate whose mean has that many columns; None: any number."""
    if not (hasattr(estimate, "mean") and hasattr(estimate, "cov")) or inspect.ismethod(estimate.mean):
        return told("an Estimate", estimate)
    size = np.size(estimate.mean) if columns is None else columns
    for name, array, shape in (("mean", estimate.mean, (size,)), ("covariance", estimate.cov, (size, size))):
        if fault := array_fault(array, "fiu", "real numbers", shape):
            is_number = np.asarray(array).dtype.kind == "f" and np.shape(array) == shape
            return f"the {name} is not finite: {fault}" if is_number else f"the {name}: {fault}"
    scale = max(float(np.trace(estimate.cov)), 1e-300)
    if not np.allclose(estimate.cov, np.transpose(estimate.cov), atol=ROUNDING * scale, rtol=0):
        return "the covariance is not symmetric"
    lowest = float(np.linalg.eigvalsh(estimate.cov)[0])
    return "" if lowest >= -ROUNDING * scale else f"the covariance is not positive semidefinite: eigenvalue {lowest:g}"


def _tracks_fault(tracks: Any, wanted: ExpectedAnswer) -> str:
    if not isinstance(tracks, Sequence) or not all(isinstance(track, TrackEstimate) for track in tracks):
        return told("a sequence of TrackEstimate", tracks)
    for before, track in zip([None, *tracks], tracks, strict=False):
        fault = number_fault(track.number, whole=True) or estimate_fault(track, wanted.columns)
        fault = fault or ("" if track.existence != track.existence else number_fault(track.existence, most=1.0))
        if fault or (before is not None and before.number >= track.number):
            return f"track {track.number}: {fault or f'stands after track {before.number}: tracks ascend by number'}"
    return ""


def _outcome_fault(outcome: Any, wanted: ExpectedAnswer) -> str:
    if not isinstance(outcome, ScanOutcome):
        return told("a ScanOutcome", outcome)
    kinds, shapes = get_args(EventKind), wanted.shapes
    wrong = [event for event in outcome.events if not isinstance(event, TrackEvent) or event.kind not in kinds]
    if wrong:
        return told(f"a TrackEvent whose kind is {', '.join(kinds)}", wrong[0])
    if len(outcome.explained) != len(shapes):
        return f"explained: expected an array for each of {len(shapes)} scans, not {len(outcome.explained)}"
    for share, shape in zip(outcome.explained, shapes, strict=True):
        fault = array_fault(share, "fiu", "real numbers", shape)
        if fault or not all(-ROUNDING <= each <= 1.0 + ROUNDING for each in share):
            return f"explained: {fault or told('probabilities', share)}"
    return cycles_fault(outcome.cycles)


_OF_BELIEFS: Final[Mapping[str, Callable[[Any, ExpectedAnswer], str]]] = {
    "Estimate": lambda value, wanted: estimate_fault(value, wanted.columns),
    "Sequence[TrackEstimate]": _tracks_fault,
    "ScanOutcome": _outcome_fault,
}
"""By annotation, what is wrong with what a tracker tells of its belief."""


def cycles_fault(cycles: Any) -> str:
    """Return what is wrong with a number of operations."""
    fault = number_fault(cycles, most=MOST_CYCLES)
    return f"not a number of cycles: {fault}" if fault else ""


def parcel_fault(parcel: Any) -> str:
    """Return what is wrong with a parcel."""
    if not isinstance(parcel, Parcel):
        return told("a Parcel", parcel)
    if not isinstance(parcel.what, str) or not parcel.what:
        return f"a parcel without a name: {told('a text', parcel.what)}"
    packets = number_fault(parcel.packets, whole=True, least=1, most=MOST_PACKETS)
    fault = f"packets: {packets}" if packets else number_fault(parcel.packet_bits, least=1)
    return f"parcel {parcel.what!r}: {fault if packets else f'packet_bits: {fault}'}" if fault else ""


def ids_fault(ids: Iterable[Any] | None, size: float = np.inf) -> str:
    """Return what is wrong with the ids of nodes; None stands for those that sense. `size`: the number of nodes."""
    if ids is None:
        return ""
    try:
        found = [one for one in ids if not (isinstance(one, int | np.integer) and 0 <= one < size)]
    except TypeError:
        return told("ids of nodes", ids)
    most = "" if size == np.inf else f" from 0 to {size - 1:g}"
    return told(f"ids of nodes{most}", found[0]) if found else ""


def request_fault(request: Any) -> str:
    """Return what is wrong with a request."""
    if type(request) not in _FAULTS:
        names = ", ".join(each.__name__ for each in _FAULTS)
        return f"{shown_value(request)} is not a request; requests are {names}"
    fault = _FAULTS[type(request)](request)
    return f"{type(request).__name__}: {fault}" if fault else ""


def _local_fault(request: Local) -> str:
    functions = [request.work] if request.work_all is None else [request.work, request.work_all]
    if not all(map(callable, functions)):
        return told("functions as work and work_all", functions[-1])
    return ids_fault(request.who) or ("" if callable(request.cycles) else cycles_fault(request.cycles))


def _gather_fault(request: Gather | GatherReadings | Exchange) -> str:
    if isinstance(request, Gather | Exchange) and not callable(request.parcel_of):
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
    GatherLate: lambda request: number_fault(request.since) or number_fault(request.until),
    Scatter: _scatter_fault,
    Broadcast: lambda request: parcel_fault(request.parcel),
    Send: lambda request: ids_fault([request.to]) or parcel_fault(request.parcel),
    Exchange: _gather_fault,
}
