"""The strategies of the frontier: error, energy and what they lose; the best of them, in words.

    strategies(data) -> [Strategy, ...]
    conclusions(found, bound) -> [line, ...]         three lines for each radio

A strategy `follows` the target if at most 5 % of its runs lose it at any time or have an RMSE of more than 20 m, and at
least 90 % of the steps have an estimate before the next one begins [our choice]: a median alone would ignore runs that
diverge and recover, and a strategy without estimates at difficult steps would look good.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.papers.toolkit import Bools, Data, campaigns, ends, statistics

MOST_LOST: Final = 0.05
DIVERGED: Final = 20.0
"""RMSE (m) above which a run of this field counts as diverged."""
LEAST_IN_TIME: Final = 0.9
NEAR: Final = 1.5
"""Error of a good strategy, as a multiple of the bound."""
ONE_OF_TEN: Final = 0.1
OURS: Final = "information_driven"
"""The strategy that the study was made for."""
RADIOS: Final = ("ideal", "realistic")


class Strategy(NamedTuple):
    """The results of a variant: median RMSE of a run (m) with its interval, mean energy (J), two fractions.

    `lost` is a fraction of runs: those that lost their target at any time, or whose RMSE is above DIVERGED. `in_time`
    is a fraction of steps.
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
        """The kind of radio, as the variant's name has it."""
        return self.variant.partition(": ")[0]

    @property
    def radio(self) -> str:
        """One of RADIOS."""
        return RADIOS[0] if self.air == RADIOS[0] else RADIOS[1]

    @property
    def follows(self) -> bool:
        """Whether it keeps the target and its estimates are in time."""
        return self.lost <= MOST_LOST and self.in_time >= LEAST_IN_TIME


def limit(data: Data) -> float:
    """The median over trajectories of the conditional bound (m) for all measurements in range.

    It is the same for all strategies: a bound for the measurements that arrived would favour those that ask few nodes.
    """
    return float(np.median(data.bound(data.variants[0], "per_trajectory").of_replicates))


def strategies(data: Data) -> list[Strategy]:
    """The results of all variants."""
    return [_strategy(variant, data.of(variant, "runs")) for variant in data.variants]


def _strategy(variant: str, runs: pd.DataFrame) -> Strategy:
    rmse = statistics.median(runs["rmse"].to_numpy(dtype=np.float64))
    lost = (campaigns.ever_lost(runs) | ~(runs["rmse"] <= DIVERGED)).mean()
    energy, in_time = (float(runs[column].mean()) for column in ("energy", "tracked"))
    return Strategy(variant, rmse.value, rmse.low, rmse.high, energy, float(lost), in_time)


def front(found: Sequence[Strategy]) -> Bools:
    """(n,) whether each is on the Pareto front of error and energy of those that follow the target."""
    nan = float("nan")
    return statistics.pareto_front(
        [one.rmse if one.follows else nan for one in found], [one.energy if one.follows else nan for one in found]
    )


def cheapest(found: Sequence[Strategy], most: float) -> Strategy | None:
    """The strategy with the least energy that follows the target with at most this error (m); None if none does."""
    near = [one for one in found if one.follows and one.rmse <= most]
    return min(near, key=lambda one: one.energy, default=None)


def conclusions(found: Sequence[Strategy], bound: float) -> list[str]:
    """Three lines for each radio: the cheapest near the bound, or the nearest; the Pareto front; that of the others."""
    lines = []
    for radio in RADIOS:
        these = [one for one in found if one.radio == radio]
        others = [one for one in these if OURS not in one.variant]
        lines += [
            concluded(radio, these, bound),
            f"{radio} radio, Pareto front of error and energy: {_listed(these, bound)}",
            f"{radio} radio, the same without {OURS}: {_listed(others, bound)}",
        ]
    return lines


def _listed(found: Sequence[Strategy], bound: float) -> str:
    """The Pareto front in words, by energy."""
    best = sorted(compress(found, front(found)), key=lambda one: one.energy)
    return "; ".join(_words(one, bound) for one in best) or "no strategy follows the target"


def named(found: Sequence[Strategy]) -> list[Strategy]:
    """The strategies of one radio that a reader looks for.

    They are `information_driven`, on the Pareto front of the others, or on that if one run of ten may lose the target.
    They keep their order.
    """
    others = [one for one in found if OURS not in one.variant]
    spared = [one._replace(lost=max(0.0, one.lost - ONE_OF_TEN)) for one in others]
    kept = {one.variant for these in (others, spared) for one in compress(others, front(these))}
    return [one for one in found if one.variant in kept or OURS in one.variant]


def concluded(radio: str, found: Sequence[Strategy], bound: float) -> str:
    """A line on a radio's cheapest strategy within 1.5 times the bound, or on the nearest if there is none."""
    head = f"{radio} radio, cheapest within {NEAR:g} x the bound of {bound:.3f} m for all measurements in range: "
    if (best := cheapest(found, NEAR * bound)) is not None:
        return head + _words(best, bound)
    nearest = min((one for one in found if one.follows), key=lambda one: one.rmse, default=None)
    return head + (f"none; nearest is {_words(nearest, bound)}" if nearest else "none; no strategy follows the target")


def _words(one: Strategy, bound: float) -> str:
    """A strategy in words: error (m), error over the bound with its interval, energy (J)."""
    value, low, high = (each / bound for each in (one.rmse, one.low, one.high))
    return f"{one.variant}, {one.rmse:.3g} m, {value:.2f} x{ends(low, high)}, {one.energy:.3g} J"
