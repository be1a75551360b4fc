"""Random values of the fields of components, within their bounds and small enough for a run of a fraction of a second.

of_fields(class, rng) -> {field: value}      a random value for each field without a default, and for some others
"""

from __future__ import annotations

import dataclasses
import functools
import math
import random
import types
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

from wsnsim.base.part import Quantity

TYPICAL: Final = {
    "m": 40.0, "s": 0.5, "m/s": 5.0, "J": 0.05, "W": 1e-3, "Hz": 1e6, "bit/s": 1e5, "dB": 3.0, "dBm": -40.0,
    "J/bit": 5e-8, "J/bit/m2": 1e-10, "J/bit/m4": 1e-15,
}  # fmt: skip
"""A value of each unit for fields without a default; 1 for other units."""
MOST_COUNT: Final = 40
"""The largest whole number that is sampled: particles, cells and iterations cost time."""
OWN_TURN: Final = ("late", "late_window")
"""Fields whose choice changes no other value: random_scenarios gives them."""
GIVEN: Final = 0.5
"""Probability that a field with a default is given a value."""


def of_fields(part: type[Any], rng: random.Random) -> dict[str, Any]:
    """Random values for the fields of a component; None stands for a field that is left out."""
    hints = _hints(part)
    values = {}
    for field in dataclasses.fields(part):
        default = None if field.default is dataclasses.MISSING else field.default
        if field.init and field.name not in OWN_TURN and (default is None or rng.random() < GIVEN):
            values[field.name] = _of_hint(hints[field.name], default, rng)
    return {name: value for name, value in values.items() if value is not None}


@functools.cache
def _hints(part: type[Any]) -> dict[str, Any]:
    return get_type_hints(part, include_extras=True)


def _of_hint(hint: Any, default: Any, rng: random.Random) -> Any:
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    return _of_type(get_args(hint)[0] if notes else hint, quantity, default, rng)


def _of_type(kind: Any, quantity: Quantity, default: Any, rng: random.Random) -> Any:
    """A random value of a type; None for types that are not sampled (texts and datasheets)."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is bool:
        return rng.random() < 0.5
    if kind is int or kind is float:
        return number(quantity, default if isinstance(default, int | float) else None, rng, whole=kind is int)
    if origin is Literal:
        return rng.choice(arguments)
    if origin in (Union, types.UnionType):
        inner = [argument for argument in arguments if argument is not type(None)]
        return None if rng.random() < 0.5 else _of_type(rng.choice(inner), quantity, default, rng)
    if origin is tuple and ... not in arguments:
        defaults = default if isinstance(default, tuple) else [None] * len(arguments)
        return [_of_type(inner, quantity, one, rng) for inner, one in zip(arguments, defaults, strict=True)]
    return None


def number(quantity: Quantity, default: float | None, rng: random.Random, whole: bool = False) -> float | int:
    """A random number within the bounds: near the default or a typical value of the unit, sometimes on a bound."""
    low = max(bound for bound in (quantity.gt, quantity.ge, -math.inf) if bound is not None)
    high = min(bound for bound in (quantity.lt, quantity.le, math.inf) if bound is not None)
    closed = [bound for bound in (quantity.ge, quantity.le) if bound is not None and abs(bound) <= MOST_COUNT]
    if closed and rng.random() < 0.1:
        bound = closed[0] if rng.random() < 0.5 else closed[-1]
        return round(bound) if whole else bound
    near = TYPICAL.get(quantity.unit, 1.0) if default is None or not math.isfinite(default) else default
    value = near * math.exp(rng.gauss(0.0, 0.7)) if near else rng.expovariate(1.0 / TYPICAL.get(quantity.unit, 1.0))
    if value <= low or value >= high:
        value = rng.uniform(max(low, -1e3), min(high, 1e3))
    if whole:
        return max(
            math.ceil(low), min(round(value), MOST_COUNT if math.isinf(high) or high > MOST_COUNT else int(high))
        )
    return float(f"{value:.6g}")
