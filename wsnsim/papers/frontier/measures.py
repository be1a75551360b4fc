"""What is measured for the frontier: ratios to a twin, the bound for the readings that arrived, and who is cheapest.

    rmse_over_twin, energy_over_twin, arrived (data, variant) -> a Series by replicate, as `measures` takes them
    strategies(data) -> [Strategy, ...]      conclusions(data) -> [two lines a radio, ...]

A strategy `follows` the target if at most 5 % of its runs lose it or go astray, by an RMSE of more than 20 m, and at
least 90 % of the steps have an estimate before the next one begins [our choice]: a median alone would pass over runs
that are far off and come back, and one that is silent where it is hard would look good.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.analysis import statistics
from wsnsim.base.arrays import Bools
from wsnsim.papers.frontier.experiments import IDEAL, TIGHT, twin
from wsnsim.papers.measures import Data, of_log

MOST_LOST: Final = 0.05
ASTRAY: Final = 20.0
"""Metres: the error from which on a track of this field counts as lost."""
LEAST_IN_TIME: Final = 0.9
NEAR: Final = 1.5
"""Times the bound that a strategy may be off."""
RADIOS: Final = ("ideal", "realistic")


class Strategy(NamedTuple):
    """A variant in figures: the median RMSE of a run (m) with its interval, mean energy (J), shares of runs, steps.

    `lost` counts runs that lost their target, or whose RMSE is above ASTRAY.
    """

    variant: str
    rmse: float
    low: float
    high: float
    energy: float
    lost: float
    in_time: float

    @property
    def air(self) -> str:
        """What its frames go through."""
        return self.variant.partition(": ")[0]

    @property
    def radio(self) -> str:
        """Ideal or realistic."""
        return RADIOS[0] if self.air == IDEAL else RADIOS[1]

    @property
    def follows(self) -> bool:
        """Whether it keeps the target, and is in time."""
        return self.lost <= MOST_LOST and self.in_time >= LEAST_IN_TIME


def rmse_over_twin(data: Data, variant: str) -> pd.Series:
    """The RMSE of each run over that of its twin's run."""
    return _over_twin(data, variant, "rmse")


def energy_over_twin(data: Data, variant: str) -> pd.Series:
    """The energy of each run over that of its twin's run."""
    return _over_twin(data, variant, "energy")


def arrived(data: Data, variant: str) -> pd.Series:
    """The bound (m) along each run's truth for the readings that the head had; needs events, estimates, clusters."""
    return of_log(data, variant, "arrived")


def limit(data: Data) -> float:
    """The median over truths of the bound along each (m), for all readings in range: one line for all strategies.

    That of the readings that arrived would differ from one to the next, and would forgive who asks few nodes.
    """
    return float(np.median(data.bound(data.variants[0], TIGHT).of_replicates))


def strategies(data: Data) -> list[Strategy]:
    """All variants, in figures."""
    return [_strategy(variant, data.of(variant, "runs")) for variant in data.variants]


def front(found: Sequence[Strategy]) -> Bools:
    """(n,) which of them follow the target, and are not beaten in both error and energy by another that does."""
    nan = float("nan")
    return statistics.pareto_front(
        [one.rmse if one.follows else nan for one in found], [one.energy if one.follows else nan for one in found]
    )


def cheapest(found: Sequence[Strategy], most: float) -> Strategy | None:
    """Which of those that follow the target with at most this error (m) spends least; None if none does."""
    near = [one for one in found if one.follows and one.rmse <= most]
    return min(near, key=lambda one: one.energy, default=None)


def conclusions(data: Data) -> list[str]:
    """Two lines a radio: the cheapest within 1.5 times the bound, or who is nearest; and the front."""
    found, bound = strategies(data), limit(data)
    lines = []
    for radio in RADIOS:
        these = [one for one in found if one.radio == radio]
        on_front = sorted(
            (one for one, best in zip(these, front(these), strict=True) if best), key=lambda one: one.energy
        )
        lines += [concluded(radio, these, bound), f"{radio} radio, beaten by none in both error and energy: "]
        lines[-1] += "; ".join(_told(one, bound) for one in on_front) or "none follows the target"
    return lines


def concluded(radio: str, found: Sequence[Strategy], bound: float) -> str:
    """Of a radio's strategies, the cheapest within 1.5 times the bound; or that there is none, and who is nearest."""
    following = [one for one in found if one.follows]
    head = f"{radio} radio, cheapest within {NEAR:g} x the bound of {bound:.3f} m for all readings in range: "
    if (best := cheapest(found, NEAR * bound)) is not None:
        return head + _told(best, bound)
    nearest = min(following, key=lambda one: one.rmse, default=None)
    return head + (f"none; nearest is {_told(nearest, bound)}" if nearest else "none; no strategy follows the target")


def _told(one: Strategy, bound: float) -> str:
    """A strategy in words; the interval of its median says how sure its place is."""
    value, low, high = (each / bound for each in (one.rmse, one.low, one.high))
    return f"{one.variant}, {one.rmse:.3g} m, {value:.2f} x [{low:.2f}, {high:.2f}], {one.energy:.3g} J"


def _strategy(variant: str, runs: pd.DataFrame) -> Strategy:
    rmse = statistics.median(runs["rmse"].to_numpy(dtype=np.float64))
    lost = ((runs["lost"] > 0) | ~(runs["rmse"] <= ASTRAY)).mean()
    return Strategy(
        variant,
        rmse.value,
        rmse.low,
        rmse.high,
        float(runs["energy"].mean()),
        float(lost),
        float(runs["tracked"].mean()),
    )


def _over_twin(data: Data, variant: str, column: str) -> pd.Series:
    one, two = (data.of(name, "runs").set_index("replicate")[column] for name in (variant, twin(variant)))
    return one.astype(np.float64) / two.astype(np.float64)
