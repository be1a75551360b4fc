"""The pydantic models of sweeps, and the plan of a sweep.

SweepText: the checked keys of a sweep file      StoppingRule: when a point has enough replicates
Plan, Point: a sweep whose points are all valid scenarios
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, Field, Strict, model_validator

from wsnsim.base.errors import did_you_mean
from wsnsim.base.part import Quantity
from wsnsim.base.tables import METRICS
from wsnsim.scenario.axes import MOST_POINTS
from wsnsim.scenario.fields import FROZEN
from wsnsim.scenario.schema import names
from wsnsim.scenario.units import Number, refusal, shown

BLOCK: Final = 5
MOST_REPLICATES: Final = 100_000

_Text = Annotated[str, Strict()]
_Whole = Annotated[int, Number(Quantity("", ge=1, le=MOST_REPLICATES), whole=True)]


def _known_metric(name: str) -> str:
    if name not in METRICS:
        raise refusal(f"table runs has no metric {shown(name)} ({did_you_mean(name, METRICS)})")
    return name


class StoppingRule(BaseModel):
    """The rule that ends a point: replicates are added until the median of a metric is known precisely enough.

    The rule is evaluated at `at_least` replicates, then whenever their number has grown by half. Its decision depends
    on the replicates alone, not on who ran them. Failed replicates do not count; a point of which more than half failed
    gets no further ones.
    """

    model_config = FROZEN
    metric: Annotated[str, Strict(), AfterValidator(_known_metric)] = Field(
        "rmse", description="column of the table runs whose median is estimated"
    )
    half_width: Annotated[float, Number(Quantity("", gt=0, lt=1))] = Field(
        description="half of the 95 % interval of the median, as a share of the median"
    )
    at_least: _Whole = Field(10, description="replicates before the rule is asked first")
    at_most: _Whole = Field(1000, description="replicates at which a point ends anyway")

    @model_validator(mode="after")
    def _in_order(self) -> StoppingRule:
        if self.at_least > self.at_most:
            raise refusal(f"at_least is {self.at_least}, and at_most only {self.at_most}")
        return self

    def next_look(self, replicates: int) -> int:
        """Return the number of replicates at which the rule is evaluated next."""
        return min(self.at_most, replicates + max(1, replicates // 2))


class SampledPoints(BaseModel):
    """A block of random points: their number, the seed, and the axes (ranges or lists)."""

    model_config = FROZEN
    points: Annotated[int, Number(Quantity("", ge=1, le=MOST_POINTS), whole=True)] = Field(
        description="number of points"
    )
    seed: Annotated[int, Number(Quantity("", ge=0), whole=True)] = Field(0, description="seed of the sample")
    over: dict[str, Any] = Field(description="axes, as ranges or lists")


class SweepText(BaseModel):
    """The keys of a sweep file."""

    model_config = FROZEN
    name: Annotated[str, Strict(), names("a folder")] | None = Field(
        None, description="name, also of the folder of results; default that of the file"
    )
    scenario: _Text | tuple[_Text, ...] = Field(description="the scenario to vary, or several")
    set: dict[str, Any] = Field({}, description="values that replace those of the scenario at every point")
    grid: dict[str, Any] = Field({}, description="axes, every combination of which is a point")
    zip: dict[str, Any] = Field({}, description="axes varied together: all first values, all second values, ...")
    points: tuple[dict[str, Any], ...] | None = Field(None, description="points one by one")
    random: SampledPoints | None = Field(None, description="random points")
    latin_hypercube: SampledPoints | None = Field(None, description="points of a Latin hypercube")
    replicates: _Whole | None = Field(None, description="runs per point; default that of the scenario")
    until: StoppingRule | None = Field(None, description="add replicates until a metric is known well enough")
    block: _Whole = Field(BLOCK, description="replicates in one file; one worker runs them in sequence")
    timeout: Annotated[float, Number(Quantity("s", gt=0))] | None = Field(
        None, description="time limit of a replicate [s]"
    )

    @model_validator(mode="after")
    def _one_end(self) -> SweepText:
        if self.until is not None and self.replicates is not None:
            raise refusal("'replicates' and 'until' both end a point: give one of them (until.at_most)")
        return self


@dataclass(frozen=True)
class Point:
    """One point of a sweep.

    Attributes:
        id: name of its folder, a digest of everything that determines its runs.
        settings: the values that distinguish it from other points, by column.
        resolved: its scenario as JSON.
        world: digest of the keys that determine ground truth and deployment; equal for comparable points.
    """

    id: str
    settings: Mapping[str, Any]
    resolved: str
    world: str


@dataclass(frozen=True)
class Plan:
    """A checked sweep: what a campaign runs.

    Attributes:
        name: name of the sweep.
        keys: the columns that distinguish points, in order.
        points: the points.
        replicates: runs per point; with `until`, their maximum.
        until: the stopping rule, or None.
        block: replicates in one file.
        timeout: time limit of a replicate in s, or None.
        source: the text of the sweep.
    """

    name: str
    keys: tuple[str, ...]
    points: tuple[Point, ...]
    replicates: int
    until: StoppingRule | None
    block: int
    timeout: float | None
    source: str
