"""A part: a frozen, keyword-only bundle of parameters behind a role of the scenario.

Its fields are its YAML keys; bounds and units stand in the annotations, defaults are the paper's:

    @part
    class Disk:
        '''Two nodes hear each other within a fixed reach.'''
        reach: Annotated[float, Quantity("m", gt=0), "nominal range of a link"]

A part may say what cannot be in the company of the others: `def faults(self, parts: Parts) -> Iterator[Fault]`, with
paths that start at the role's name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass(frozen=True)
class Quantity:
    """The unit (as in `scenario.units`; '' for a pure number) and the bounds of a field. Values are SI."""

    unit: str = ""
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None


@dataclass_transform(frozen_default=True, kw_only_default=True)
def part(cls: type[T]) -> type[T]:
    """Make a class a frozen, keyword-only dataclass. It is the whole of what a plug-in class needs."""
    return dataclass(frozen=True, kw_only=True)(cls)


def kind_of(thing: Any) -> str:
    """The class name of a part, for messages."""
    return type(thing).__name__
