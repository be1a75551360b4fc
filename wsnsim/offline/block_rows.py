"""Rows of many standalone runs at once, for the tables `truth`, `estimates`, `covariances`, `tracks` and `runs`.

They hold the same numbers, bit by bit, as `base.results.summarise` writes run by run. Every step has an estimate, which
is issued at the step itself. Arrays have the axes runs (R) and steps (K).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.ports import MotionModel
from wsnsim.base.results import RunTotals, Summary, columns_of_totals, losses
from wsnsim.base.rows import NAN, state_columns
from wsnsim.base.setups import TrackingSetup
from wsnsim.offline.loopback import HEAD


class FollowedTarget(NamedTuple):
    """One target of all runs.

    Attributes:
        motion: Its motion model.
        gaussian: Whether the posterior is Gaussian, as in `estimates.gaussian`.
        truths: (R, K + 1, D) ground-truth trajectories.
        estimates: The estimates.
        readings: (R, K) number of readings at each step.
        frames: (R,) number of readings that were sent to the head.
    """

    motion: MotionModel
    gaussian: bool
    truths: Floats
    estimates: BlockEstimates
    readings: Ints
    frames: Ints


def demand_shapes(estimates: BlockEstimates, block: StandaloneBlock) -> None:
    """Raise RunError if an array has another shape than `BlockEstimates` says."""
    steps, size = (len(block.runs), block.steps), len(block.motion.columns)
    shapes = {"means": (*steps, size), "covs": (*steps, size, size), "cycles": steps[:1]}
    for name, wanted in (dict.fromkeys(("effective", "nis", "nis_dof"), steps) | shapes).items():
        if (found := np.shape(getattr(estimates, name))) != wanted:
            raise RunError(f"whole_runs: {name} must have the shape {wanted}, not {found}")


def estimate_columns(target: FollowedTarget, setup: TrackingSetup, sensors: Ints) -> dict[str, Any]:
    """Columns (R, K) of the table `estimates`, without `replicate` and `target`. `sensors`: (R,) number of sensors.

    Those that are the same in all runs are (K,) or scalars.
    """
    estimates, place = target.estimates, list(target.motion.position)
    covs = estimates.covs[:, :, place][:, :, :, place]
    columns = state_columns(target.motion, target.truths, setup.dt, estimates.means, covs)
    return {
        **columns,
        "issued": columns["time"],
        "head": HEAD,
        "active": target.readings,
        "members": sensors[:, None],
        "readings": target.readings,
        "received": NAN,
        "late": 0,
        "effective_particles": estimates.effective,
        "nis": estimates.nis,
        "nis_dof": estimates.nis_dof,
        "woken": 0,
        "ineffective": 0,
        "gaussian": int(target.gaussian),
    }


def track_columns(columns: Mapping[str, Any], setup: TrackingSetup) -> dict[str, Any]:
    """Columns (R,) of the table `tracks`, without `replicate` and `target`, from those of `estimates`."""
    errors, readings = np.ascontiguousarray(columns["error"]), columns["readings"]
    sure = readings >= metrics.ENOUGH_READINGS
    return {
        **{name: STATISTICS[name](errors, axis=1) for name in ("rmse", "median_error")},
        **_losses(errors, setup),
        "late": 0,
        "reports": errors.shape[1],
        "delay": 0.0,
        "received": 0,
        "report_delay": NAN,
        "due": 0,
        "in_time": NAN,
        "tracked": (readings >= 1).mean(axis=1),
        "tracked_three": sure.mean(axis=1),
        "mean_error": errors.mean(axis=1),
        **{f"{name}_three": _of_known(statistic, errors, sure) for name, statistic in STATISTICS.items()},
        **dict.fromkeys(("woken", "ineffective", "ineffective_twenty", "reacquired", "called", "dismissed"), 0),
        "handover_bits": NAN,
    }


def _rmse(errors: Floats, axis: int) -> Floats:
    found: Floats = np.sqrt((errors**2).mean(axis=axis))
    return found


STATISTICS: Final[Mapping[str, Callable[..., Floats]]] = {
    "mean_error": np.mean, "rmse": _rmse, "median_error": np.median,
}  # fmt: skip


def _of_known(statistic: Callable[..., Floats], values: Floats, known: Bools) -> Floats:
    """(R,) a statistic of the known ones of each run's values (R, n); NaN without any."""
    found, whole = np.full(len(values), NAN), known.all(axis=1)
    found[whole] = statistic(values[whole], axis=1)
    for run in np.flatnonzero(known.any(axis=1) & ~whole):
        found[run] = statistic(values[run][known[run]], axis=0)
    return found


def _losses(errors: Floats, setup: TrackingSetup) -> dict[str, Any]:
    """Whether, how often and for how long each track was lost, and when first. Most tracks never are."""
    window, limit, none = setup.lost_window, setup.lost_limit, np.zeros(errors.shape[1])
    found = {name: np.full(len(errors), value) for name, value in losses(none, window, limit, setup.dt).items()}
    for run in np.flatnonzero(errors.max(axis=1) > limit):
        for name, value in losses(errors[run], window, limit, setup.dt).items():
            found[name][run] = value
    return found


def run_columns(
    setup: TrackingSetup,
    targets: Sequence[FollowedTarget],
    estimates: Sequence[Mapping[str, Any]],
    tracks: Sequence[Mapping[str, Any]],
    sensors: Ints,
) -> dict[str, Any]:
    """Columns (R,) of the table `runs`, without `replicate` and `cpu_seconds`.

    Args:
        setup: The scenario.
        targets: The targets.
        estimates: For each target, its columns of `estimates`.
        tracks: For each target, its columns of `tracks`.
        sensors: (R,) number of sensors.
    """
    errors = np.concatenate([columns["error"] for columns in estimates], axis=1)
    means = np.stack([target.estimates.means for target in targets], axis=1)
    events = [_digest(each.tobytes()) for each in means]
    totals = columns_of_totals(RunTotals(event_fingerprint=0, alive=0))
    totals |= {"event_fingerprint": events, "alive": sensors}
    totals |= dict.fromkeys(("frames_sent", "packets_sent", "in_range", "delivered"), sum(t.frames for t in targets))
    totals |= {"cycles": sum(target.estimates.cycles for target in targets)}
    shares = ("time_lost", "lost_share", "tracked", "tracked_three")
    return {
        "status": 0,
        "steps": setup.steps,
        **{name: STATISTICS[name](errors, axis=1) for name in ("rmse", "median_error")},
        "lost": np.max([row["lost"] for row in tracks], axis=0),
        "losses": np.sum([row["losses"] for row in tracks], axis=0),
        **{name: np.mean([row[name] for row in tracks], axis=0) for name in shares},
        **totals,
        "fingerprint": [_fingerprint(targets, run, digest, setup.dt) for run, digest in enumerate(events)],
        "lost_window": setup.lost_window * setup.dt,
        "lost_limit": setup.lost_limit,
        **_consistency(estimates, len(setup.motions[0].position)),
    }


def _consistency(estimates: Sequence[Mapping[str, Any]], size: int) -> dict[str, Floats]:
    """The columns on consistency: as `base.rows.consistency`."""
    nees, nis, dof, sd = (
        np.concatenate([columns[name] for columns in estimates], axis=1) for name in ("nees", "nis", "nis_dof", "sd_x")
    )
    mean, middle = (_of_known(statistic, nees, np.isfinite(nees)) for statistic in (np.mean, np.median))
    singular = np.count_nonzero(np.isfinite(sd) & ~np.isfinite(nees), axis=1)
    known = np.isfinite(nis) & (dof > 0)
    ratios = np.full(len(nis), NAN)
    for run in np.flatnonzero(known.any(axis=1)):
        ratios[run] = nis[run][known[run]].sum() / dof[run][known[run]].sum()
    return {"nees": mean / size, "nees_median": middle / size, "singular": singular, "nis": ratios}


def _fingerprint(targets: Sequence[FollowedTarget], run: int, events: int, dt: float) -> int:
    """The fingerprint of a run: as `base.rows.fingerprint`."""
    data = [events.to_bytes(8, "little")]
    for number, target in enumerate(targets):
        means, covs = target.estimates.means[run], target.estimates.covs[run]
        steps = np.arange(1, len(means) + 1, dtype=np.float64)
        key = np.column_stack([steps * dt, steps, np.full(len(means), float(number))])
        data.append(np.concatenate([key, means, covs.reshape(len(means), -1)], axis=1).tobytes())
    return _digest(b"".join(data))


def _digest(data: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(data, digest_size=8).digest(), "little")


def summaries_of(
    targets: Sequence[FollowedTarget],
    estimates: Sequence[Mapping[str, Any]],
    tracks: Sequence[Mapping[str, Any]],
    runs: Mapping[str, Any],
) -> list[Summary]:
    """The summary of each run, from columns of `estimates` and `tracks` for each target, and those of `runs`."""
    errors = np.stack([columns["error"] for columns in estimates], axis=1)
    squares = [(target.estimates.means - target.truths[:, 1:]) ** 2 for target in targets]
    deviations = np.stack([np.sqrt(square.mean(axis=1)) for square in squares], axis=1)
    track_rows = zip(*(rows_of(columns, len(errors)) for columns in tracks), strict=True)
    each = zip(rows_of(runs, len(errors)), track_rows, errors, deviations, strict=True)
    return [Summary(run, rows, error, deviation, {}, 0) for run, rows, error, deviation in each]


def rows_of(columns: Mapping[str, Any], runs: int) -> list[dict[str, Any]]:
    """The rows of columns whose values are arrays (R,), lists of R, or one for all, as Python numbers."""
    lists = [
        column.tolist() if isinstance(column, np.ndarray) else column if isinstance(column, list) else [column] * runs
        for column in columns.values()
    ]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]
