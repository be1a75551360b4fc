"""Measures of trackers on duty-cycled radios: reports delivered, time with the radio on, lifetimes."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.papers.duty_cycles import hypotheses
from wsnsim.papers.duty_cycles.best import best, over_known
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
    """A line for each tracker and kind of MAC: the best interval, and the energy there."""
    found = []
    for kind in kinds(data):
        for tracker in trackers(data):
            if intervals(data, tracker, kind) and f"{tracker}, {REFERENCE}" in run(data):
                one = best(data, tracker, kind)
                seconds, joules = one.interval, over_known(one.energies)
                said = f"{seconds.value:g} s [{seconds.low:g}, {seconds.high:g}], {joules} J"
                said += f" ({one.without:.0%} of the resamples have none)" if one.without else ""
                found.append(f"{tracker} on {kind}: best interval " + (said if one.usable else "none, none is usable"))
    return found


SUMMARIES: Final = {"answers": conclusions}
