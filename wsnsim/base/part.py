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

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

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
    """
    return dataclass(frozen=True, kw_only=True)(cls)
