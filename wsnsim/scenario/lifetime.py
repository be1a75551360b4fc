"""The block `lifetime` of a scenario: what `wsnsim lifetime` asks of the network, and how well it is to be known."""

from __future__ import annotations

import itertools
from typing import Annotated, Final

from pydantic import AfterValidator, BaseModel, Field, model_validator
from pydantic.types import Strict

from wsnsim.base.errors import did_you_mean
from wsnsim.base.part import Quantity
from wsnsim.scenario.fields import FROZEN
from wsnsim.scenario.units import Number, refusal, shown

CRITERIA: Final = ("first_death", "dead_10", "half_dead", "coverage", "sink", "tracked")
"""When the life of a network may be said to end."""
HOURS: Final = 24
YEAR: Final = 365.25 * 86_400.0
_Share = Annotated[float, Number(Quantity("", gt=0.0, le=1.0))]
_Factor = Annotated[float, Number(Quantity("", ge=0.0, le=1e6))]
_Time = Annotated[float, Number(Quantity("s", ge=0.0, le=1e12), finite=True)]


def _known(name: str) -> str:
    if name not in CRITERIA:
        raise refusal(
            f"unknown criterion {shown(name)} ({did_you_mean(name, CRITERIA, 'known: ' + ', '.join(CRITERIA))})"
        )
    return name


def _ascending(times: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in itertools.pairwise(times)):
        raise refusal("must ascend")
    return times


def _of_day(factors: tuple[float, ...]) -> tuple[float, ...]:
    if len(factors) != HOURS or not any(factors):
        raise refusal(f"expected {HOURS} factors, one for each hour and not all 0, got {len(factors)}")
    return factors


class AskedLifetime(BaseModel):
    """What is asked about the life of a network. `wsnsim run` ignores it."""

    model_config = FROZEN
    intrusions: Annotated[float, Number(Quantity("1/s", ge=0.0, le=1.0))] | None = Field(
        None, description="visits of a target per time in the long run, such as 1/h (the default); 0: none [1/s]"
    )
    times: Annotated[tuple[_Time, ...], AfterValidator(_ascending)] | None = Field(
        None, description="when visits begin, ascending; in place of `intrusions` [s]"
    )
    profile: Annotated[tuple[_Factor, ...], AfterValidator(_of_day)] | None = Field(
        None, description="24 factors of the rate of visits, one for each hour of a day"
    )
    horizon: Annotated[float, Number(Quantity("s", gt=0.0, le=1000.0 * YEAR))] = Field(
        10.0 * YEAR, description="time that is looked ahead [s]"
    )
    until: Annotated[str, Strict(), AfterValidator(_known)] | None = Field(
        None, description=f"last criterion that is asked for: {', '.join(CRITERIA)}; null: all"
    )
    error: Annotated[float, Number(Quantity("", gt=0.0, lt=1.0))] = Field(
        0.05, description="visits are added until half the 95 % interval of the mean first death is this share of it"
    )
    tolerance: _Time = Field(0.0, description="interruptions up to this time do not count [s]")
    coverage: _Share = Field(0.9, description="share of the area covered at the start below which coverage has ended")
    connected: _Share = Field(0.5, description="share of living nodes with a route below which sinks are cut off")
    tracked: _Share = Field(0.9, description="share of the tracked share at the start below which tracking has ended")
    episodes: Annotated[int, Number(Quantity("", ge=2, le=10_000), whole=True)] = Field(
        192, description="largest number of visits simulated before the first death"
    )
    paths: Annotated[int, Number(Quantity("", ge=40, le=100_000), whole=True)] = Field(
        200, description="number of sample paths, rounded up to an even number"
    )
    lead: _Time = Field(60.0, description="simulated time before a visit, in which the network settles [s]")
    tail: _Time = Field(60.0, description="simulated time after a visit, in which the network comes to rest [s]")

    @model_validator(mode="after")
    def _consistent(self) -> AskedLifetime:
        if self.times is not None and (self.intrusions is not None or self.profile is not None):
            raise refusal("times take the place of intrusions and profile: give either")
        return self
