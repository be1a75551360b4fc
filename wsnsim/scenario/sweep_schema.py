"""What a sweep file may say, and the plan that it becomes.

SweepText: the file, every key checked;  StoppingRule: when a point has replicates enough
Plan, Point: a sweep of which every point is known to be a scenario that can run
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, Field, model_validator

from wsnsim.base.errors import did_you_mean
from wsnsim.base.part import Quantity
from wsnsim.base.tables import METRICS
from wsnsim.scenario.axes import MOST_POINTS
from wsnsim.scenario.fields import FROZEN, Number, Strict, refusal
from wsnsim.scenario.schema import is_safe_name
from wsnsim.scenario.units import shown

BLOCK: Final = 5
MOST_REPLICATES: Final = 100_000

_Text = Annotated[str, Strict("str")]
_Whole = Annotated[int, Number(Quantity("", ge=1, le=MOST_REPLICATES), whole=True)]


def _known_metric(name: str) -> str:
    if name not in METRICS:
        raise refusal(f"table runs has no figure {shown(name)} ({did_you_mean(name, METRICS)})")
    return name


def _safe_name(name: str) -> str:
    if not is_safe_name(name):
        raise refusal(f"{shown(name)} cannot name a folder: use letters and digits, then also '_', '-' and '.'")
    return name


class StoppingRule(BaseModel):
    """Replicates are added at a point until the median of a metric is known well enough.

    The rule is asked at `at_least` replicates, and then each time that half as many more are done; so what it decides
    depends on the replicates alone, and never on who ran them. Where a replicate fails, its point gets no more.
    """

    model_config = FROZEN
    metric: Annotated[str, Strict("str"), AfterValidator(_known_metric)] = Field(
        "rmse", description="column of the table runs whose median is looked at"
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
        """At how many replicates the rule is asked after it was asked at `replicates`."""
        return min(self.at_most, replicates + max(1, replicates // 2))


class SampledPoints(BaseModel):
    """Points to be drawn, over axes that are ranges or lists."""

    model_config = FROZEN
    points: Annotated[int, Number(Quantity("", ge=1, le=MOST_POINTS), whole=True)] = Field(description="how many")
    seed: Annotated[int, Number(Quantity("", ge=0), whole=True)] = Field(0, description="seed of the draw")
    over: dict[str, Any] = Field(description="axes, as ranges or lists")


class SweepText(BaseModel):
    """What a sweep file may say."""

    model_config = FROZEN
    name: Annotated[str, Strict("str"), AfterValidator(_safe_name)] | None = Field(
        None, description="name, also of the folder of results; default that of the file"
    )
    scenario: _Text | tuple[_Text, ...] = Field(description="the scenario to vary, or several")
    set: dict[str, Any] = Field({}, description="values laid on the scenario at every point")
    grid: dict[str, Any] = Field({}, description="axes, every combination of which is a point")
    zip: dict[str, Any] = Field({}, description="axes that go together: the first values, the second, ...")
    points: tuple[dict[str, Any], ...] | None = Field(None, description="points one by one")
    random: SampledPoints | None = Field(None, description="points drawn at random")
    latin_hypercube: SampledPoints | None = Field(None, description="points of a Latin hypercube")
    replicates: _Whole | None = Field(None, description="runs a point; default what the scenario says")
    until: StoppingRule | None = Field(None, description="add replicates until a metric is known well enough")
    block: _Whole = Field(BLOCK, description="replicates in one file, which one worker runs one after the other")
    timeout: Annotated[float, Number(Quantity("s", gt=0))] | None = Field(
        None, description="seconds after which a replicate is given up [s]"
    )

    @model_validator(mode="after")
    def _one_end(self) -> SweepText:
        if self.until is not None and self.replicates is not None:
            raise refusal("'replicates' and 'until' both say when a point ends: give one of them (until.at_most)")
        return self


@dataclass(frozen=True)
class Point:
    """One point: `id` names its folder (a digest of all that decides its replicates), `settings` sets it apart.

    `resolved` is its scenario as JSON; points of equal `world` chase the same truth, from the same places.
    """

    id: str
    settings: Mapping[str, Any]
    resolved: str
    world: str


@dataclass(frozen=True)
class Plan:
    """A sweep, checked: what a campaign is to run. `keys` are the columns that tell points apart, in order.

    With `until`, `replicates` is the most that a point is given. `source` is the sweep's text.
    """

    name: str
    keys: tuple[str, ...]
    points: tuple[Point, ...]
    replicates: int
    until: StoppingRule | None
    block: int
    timeout: float | None
    source: str
