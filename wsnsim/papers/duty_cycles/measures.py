"""Measures of trackers on duty-cycled radios: reports delivered, time with the radio on, lifetimes."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.papers.duty_cycles import hypotheses
from wsnsim.papers.duty_cycles.best import Best, best, over_known
from wsnsim.papers.duty_cycles.points import REFERENCE, intervals, kinds, run, trackers
from wsnsim.papers.measures import Data, OwnMeasure

DAY: Final = 86_400.0
"""Seconds of a day."""


def error(data: Data, variant: str) -> pd.Series:
    """The median position error (m) of each run, by replicate."""
    return data.of_runs(variant, "median_error")


def delivered(data: Data, variant: str) -> pd.Series:
    """The share of the due reports that reached the sink, by replicate."""
    tracks = data.of(variant, "tracks").groupby("replicate")[["received", "due"]].sum()
    return tracks["received"] / tracks["due"]


def radio_on(data: Data, variant: str) -> pd.Series:
    """The share of time with the radio on, mean over nodes, by replicate; nodes that are awake listen without a break.

    The column `radio_on` of `runs` where the MAC is duty-cycled, elsewhere `awake`.
    """
    runs = data.of(variant, "runs").set_index("replicate")
    awake = runs["awake"].astype(np.float64)
    return runs["radio_on"].astype(np.float64).fillna(awake) if "radio_on" in runs else awake


def days(data: Data, variant: str, busiest: bool) -> pd.Series:
    """The days that two AA cells last at the mean power of a run, of the mean node or of the busiest, by replicate.

    The sink does not count among the busiest: it is the node nearest to the point of the scenario's sink.
    """
    scenario = data.scenario(variant)
    found = {}
    for replicate, nodes in data.of(variant, "nodes").groupby("replicate"):
        spent = (nodes["energy_initial"] - nodes["energy_left"]).to_numpy(dtype=np.float64)
        if busiest:
            away = np.hypot(nodes["x"] - scenario["sink"]["x"], nodes["y"] - scenario["sink"]["y"]).to_numpy()
            spent = np.delete(spent, np.argmin(away))
        joules = float(spent.max() if busiest else spent.mean())
        found[replicate] = scenario["energy"]["battery"] / joules * scenario["duration"] / DAY
    return pd.Series(found)


MEASURES: Final[dict[str, OwnMeasure]] = {
    "error": error,
    "delivered": delivered,
    "radio_on": radio_on,
    "days": partial(days, busiest=False),
    "days_busiest": partial(days, busiest=True),
}


def conclusions(data: Data) -> list[str]:
    """The best interval of each tracker on each kind of MAC, and the answers to the hypotheses."""
    return [*best_lines(data), *hypotheses.lines(data)]


def best_lines(data: Data) -> list[str]:
    """A line for each tracker and kind of MAC: the best interval, the energy there, and of how many it is."""
    return [
        _best_line(best(data, tracker, kind), kind, len(intervals(data, tracker, kind)))
        for kind in kinds(data)
        for tracker in trackers(data)
        if intervals(data, tracker, kind) and f"{tracker}, {REFERENCE}" in run(data)
    ]


def _best_line(one: Best, kind: str, count: int) -> str:
    """'gmtt on xmac: best interval 0.25 s [0.25, 0.5], 13.70 [13.11, 14.17] J, best of 5 points'."""
    words = f"{one.tracker} on {kind}: best interval"
    if not one.usable:
        return f"{words} none, " + (
            f"none of {count} points is usable" if count > 1 else "the only point is not usable"
        )
    seconds, joules = one.interval, over_known(one.energies)
    without = f" ({one.without:.0%} of the resamples have none)" if one.without else ""
    among = f"best of {count} points" if count > 1 else "the only point: no choice"
    return f"{words} {seconds.value:g} s [{seconds.low:g}, {seconds.high:g}], {joules} J{without}, {among}"


SUMMARIES: Final = {"answers": conclusions}
