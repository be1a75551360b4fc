"""A component: a frozen, keyword-only bundle of parameters that plays one role of a scenario.

Its fields are the keys in YAML. Units and bounds stand in the annotations; defaults are those of the paper:

    @part
    class Disk:
        '''Two nodes hear each other within a fixed range.'''
        reach: Annotated[float, Quantity("m", gt=0), "nominal range of a link"]

A component that depends on the others may check them: `def check(self, setup: NetworkSetup) -> Iterator[Issue]`. The
paths of these issues start at the name of a role.

    names_of(class) -> names of its fields      abouts_of(class) -> {name: meaning and unit}
    nested_of(class) -> {name: class of the component within}      roles_of(class) -> {name: role of what it holds}
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, TypeVar, dataclass_transform, get_args, get_origin, get_type_hints

T = TypeVar("T")


class Quantity(NamedTuple):
    """The unit and the bounds of a field of a component: `Annotated[float, Quantity("m", gt=0), "sensing range"]`.

    Attributes:
        unit: the SI unit of the value, such as 'm', 's', 'dBm' or 'bit/s'; '' for a pure number.
        gt: the value is greater than this.
        ge: the value is at least this.
        lt: the value is less than this.
        le: the value is at most this.
        label: the unit that documentation shows where `unit` is '' though the number has one: 'SI' for a state whose
            columns have several, 'byte' for a length that is counted in bytes.
    """

    unit: str = ""
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    label: str = ""


class OfRole(NamedTuple):
    """Says that a field holds a component of a role, of any of its kinds: `Annotated[SensorModel, OfRole("sensor")]`.

    In YAML it is a mapping with a key `kind`, as the role itself. A field that is a tuple of them is a list of such
    mappings: `Annotated[tuple[MotionModel, ...], OfRole("motion")]`.

    Attributes:
        role: the name of the role, such as 'motion'.
    """

    role: str


@dataclass_transform(frozen_default=True, kw_only_default=True)
def part(cls: type[T]) -> type[T]:
    """Return the class as a frozen, keyword-only dataclass. A plug-in class needs nothing else.

    Args:
        cls: The class, whose fields are the keys of a scenario; `Quantity` in their annotations gives units and bounds.
    """
    return dataclass(frozen=True, kw_only=True)(cls)


def is_part(kind: Any) -> bool:
    """Return whether something is the class of a component."""
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def names_of(part: type[Any]) -> list[str]:
    """Return the names of a component's fields."""
    return [field.name for field in dataclasses.fields(part) if field.init]


class About(NamedTuple):
    """The description of a field and its unit ('' for a pure number or a text), from its annotation."""

    words: str
    unit: str


def abouts_of(part: type[Any]) -> dict[str, About]:
    """Return the descriptions of a component's fields, by name."""
    hints = get_type_hints(part, include_extras=True)
    return {name: about(hints[name])[1] for name in names_of(part)}


def about(hint: Any) -> tuple[Quantity, About]:
    """Return the unit and bounds, and the description, that the annotation of a field gives."""
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
    return quantity, About(next((note for note in notes if isinstance(note, str)), ""), quantity.unit)


@functools.cache
def nested_of(part: Any) -> Mapping[str, Any]:
    """Return the fields of a component that hold, or may hold, another component, with its class."""
    found = {}
    for name, hint in get_type_hints(part).items():
        inner = next((kind for kind in (hint, *get_args(hint)) if is_part(kind)), None)
        if inner is not None and name in names_of(part):
            found[name] = inner
    return MappingProxyType(found)


class Inner(NamedTuple):
    """The role of the components that a field holds; `several`: a list of them."""

    role: str
    several: bool


def roles_of(part: Any) -> Mapping[str, Inner]:
    """Return the fields of a component that hold a component, or a list of them, of any kind of a role."""
    return _roles_of(part)


@functools.cache
def _roles_of(part: Any) -> Mapping[str, Inner]:
    hints = get_type_hints(part, include_extras=True)
    found = {name: inner_in(hints[name]) for name in names_of(part)}
    return MappingProxyType({name: inner for name, inner in found.items() if inner})


def inner_in(hint: Any) -> Inner | None:
    """Return the role that the annotation of a field names; None if it names none."""
    held, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    role = next((note.role for note in notes if isinstance(note, OfRole)), "")
    return Inner(role, get_origin(held) is tuple) if role else None
