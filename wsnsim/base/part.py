"""A component: a frozen, keyword-only bundle of parameters that plays one role of a scenario.

Its fields are the keys in YAML. Units and bounds stand in the annotations; defaults are those of the paper:

    @part
    class Disk:
        '''Two nodes hear each other within a fixed range.'''
        reach: Annotated[float, Quantity("m", gt=0), "nominal range of a link"]

A component that depends on the others may check them: `def check(self, setup: NetworkSetup) -> Iterator[Issue]`. The
paths of these issues start at the name of a role.
"""

from __future__ import annotations

import functools
from dataclasses import MISSING, dataclass, fields
from typing import Any, TypeVar, dataclass_transform

from wsnsim.base.errors import UsageError, did_you_mean, shown_value

T = TypeVar("T")


@dataclass(frozen=True)
class Quantity:
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


@dataclass(frozen=True)
class OfRole:
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

    Raises:
        UsageError: an instance is made with parameters that the class does not have, without names, or without a value
            that is needed.
    """
    made: Any = dataclass(frozen=True, kw_only=True)(cls)
    initialise = made.__init__

    @functools.wraps(initialise)
    def checked(self: T, *values: Any, **given: Any) -> None:
        try:
            initialise(self, *values, **given)
        except TypeError as error:
            if reason := _misfit(made, values, given):
                raise UsageError(f"{made.__name__}(): {reason}") from error
            raise

    made.__init__ = checked
    return made  # type: ignore[no-any-return]


def _misfit(made: Any, values: tuple[Any, ...], given: dict[str, Any]) -> str:
    """Why these are not the parameters of a component; '' if they are."""
    known = {field.name: field for field in fields(made) if field.init}
    if values:
        allowed = f"give each parameter by its name ({', '.join(known)})" if known else "there is no parameter"
        return f"{allowed}, got {shown_value(values[0])} without a name"
    if unknown := next((name for name in given if name not in known), None):
        return f"there is no parameter '{unknown}' ({did_you_mean(unknown, known)})"
    absent = [name for name, field in known.items() if field.default is field.default_factory is MISSING]
    absent = [name for name in absent if name not in given]
    return f"needs a value of {', '.join(absent)}" if absent else ""
