"""The row of a track in the table `tracks`, from the columns of its estimates.

track_row(estimates, columns, rule) -> {column: value}      losses(errors, window, limit, dt) -> those on losses
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.rows import Issued, late_steps

NAN: Final = float("nan")
FIRST_STEPS: Final = 20
"""Steps over which Li (2012) counts unnecessary wake-ups."""


class TrackRule(NamedTuple):
    """When a track is lost (window in steps, limit in m), the duration of a step (s), and the number of due reports."""

    window: int
    limit: float
    dt: float
    due: int


def track_row(estimates: Mapping[int, Issued], columns: Mapping[str, Any], rule: TrackRule) -> dict[str, Any]:
    """The row of one track, from its estimates and their columns in the table `estimates`."""
    errors, steps = np.asarray(columns["error"]), len(columns["time"])
    return {
        "rmse": metrics.rmse(errors),
        "median_error": metrics.median_error(errors),
        **losses(errors, rule.window, rule.limit, rule.dt),
        "late": late_steps(estimates, steps, rule.dt),
        "reports": len(estimates),
        **_delays(columns, rule),
        **_followed(columns, rule.dt),
        **_woken(columns, steps),
    }


def losses(errors: Floats, window: int, limit: float, dt: float) -> dict[str, Any]:
    """Whether the track is lost at the end, how often and for how long it was lost, and when first."""
    lost = metrics.lost_steps(errors, window, limit)
    steps = int(lost.sum())
    return {
        "lost": int(lost[-1:].any()),
        "losses": metrics.count_losses(lost),
        "time_lost": steps * dt,
        "lost_share": steps / lost.size if lost.size else NAN,
        "lost_at": (int(np.argmax(lost)) + window) * dt if steps else NAN,
    }


def _delays(columns: Mapping[str, Any], rule: TrackRule) -> dict[str, Any]:
    """Latencies at the cluster head and at the sink, in s; NaN without an estimate."""
    steps, issued, received = (columns[name] for name in ("time", "issued", "received"))
    in_time = int((received <= steps + rule.dt).sum())
    return {
        "delay": metrics.median_error(issued - steps),
        "received": int(np.isfinite(received).sum()),
        "report_delay": metrics.median_error(received - steps),
        "due": rule.due,
        "in_time": in_time / rule.due if rule.due else NAN,
    }


def _followed(columns: Mapping[str, Any], dt: float) -> dict[str, Any]:
    """Share of steps with an estimate, and errors of the steps with at least three measurements."""
    times, issued, readings = (np.asarray(columns[name]) for name in ("time", "issued", "readings"))
    errors = np.asarray(columns["error"])
    sure = errors[readings >= metrics.ENOUGH_READINGS]
    return {
        "tracked": metrics.tracked_share(issued, times, readings, dt, 1),
        "tracked_three": metrics.tracked_share(issued, times, readings, dt, metrics.ENOUGH_READINGS),
        "mean_error": metrics.mean_error(errors),
        "mean_error_three": metrics.mean_error(sure),
        "rmse_three": metrics.rmse(sure),
        "median_error_three": metrics.median_error(sure),
    }


def _woken(columns: Mapping[str, Any], steps: int) -> dict[str, int]:
    """Number of wake-ups, and of unnecessary ones."""
    woken, ineffective = (np.broadcast_to(columns[name], steps) for name in ("woken", "ineffective"))
    twenty = int(ineffective[:FIRST_STEPS].sum())
    return {"woken": int(woken.sum()), "ineffective": int(ineffective.sum()), "ineffective_twenty": twenty}
