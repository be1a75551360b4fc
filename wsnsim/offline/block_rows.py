"""Rows of many standalone runs at once, for the tables `truth`, `estimates`, `covariances`, `tracks` and `runs`.

They hold the same numbers, bit by bit, as `base.results.summarise` writes run by run. Every step has an estimate, which
is issued at the step itself. Arrays have the axes runs (R) and steps (K).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import RunError
from wsnsim.base.ports import MotionModel
from wsnsim.base.results import RunTotals, Summary, columns_of_totals, losses
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.standalone import BlockEstimates, StandaloneBlock
from wsnsim.offline.loopback import HEAD

NAN: Final = float("nan")


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


def estimate_columns(target: FollowedTarget, setup: TrackingSetup, sensors: Ints) -> dict[str, Floats | Ints]:
    """Columns (R, K) of the table `estimates`, without `replicate` and `target`. `sensors`: (R,) number of sensors."""
    estimates, place = target.estimates, list(target.motion.position)
    runs, steps, _ = estimates.means.shape
    covs = estimates.covs[:, :, place][:, :, :, place]
    deviations = estimates.means[:, :, place] - target.truths[:, 1:, place]
    numbers = np.arange(1, steps + 1)
    nees = metrics.normalised_squares(deviations.reshape(runs * steps, -1), covs.reshape(runs * steps, *covs.shape[2:]))
    shape = (runs, steps)
    columns: dict[str, Any] = {
        "step": numbers,
        "time": numbers * setup.dt,
        "issued": numbers * setup.dt,
        **{name: estimates.means[:, :, i] for i, name in enumerate(target.motion.columns)},
        **{name: np.sqrt(covs[:, :, i, i]) for i, name in enumerate(("sd_x", "sd_y")[: len(place)])},
        **({"cov_xy": covs[:, :, 0, 1]} if len(place) > 1 else {}),
        "error": np.sqrt((deviations**2).sum(axis=2)),
        "head": HEAD,
        "active": target.readings,
        "members": sensors[:, None],
        "readings": target.readings,
        "received": NAN,
        "late": 0,
        "effective_particles": estimates.effective,
        "nees": nees.reshape(shape),
        "nis": estimates.nis,
        "nis_dof": estimates.nis_dof,
        "woken": 0,
        "ineffective": 0,
        "gaussian": int(target.gaussian),
    }
    return {name: np.broadcast_to(values, shape) for name, values in columns.items()}


def truth_columns(target: FollowedTarget, setup: TrackingSetup) -> dict[str, Floats | Ints]:
    """Columns (R, K + 1) of the table `truth`, without `replicate` and `target`."""
    shape = target.truths.shape[:2]
    numbers = np.arange(shape[1])
    states = {name: target.truths[:, :, i] for i, name in enumerate(target.motion.columns)}
    columns = {"step": numbers, "time": numbers * setup.dt, **states}
    return {name: np.broadcast_to(values, shape) for name, values in columns.items()}


def covariance_columns(target: FollowedTarget) -> dict[str, Floats | Ints]:
    """Columns (R, K) of the table `covariances`, without `replicate` and `target`."""
    names, covs = target.motion.columns, target.estimates.covs
    triangle = [(i, j) for i in range(len(names)) for j in range(i, len(names))]
    columns = {"step": np.arange(1, covs.shape[1] + 1)}
    columns |= {f"cov_{names[i]}_{names[j]}": covs[:, :, i, j] for i, j in triangle}
    return {name: np.broadcast_to(values, covs.shape[:2]) for name, values in columns.items()}


def track_columns(columns: Mapping[str, Any], setup: TrackingSetup) -> dict[str, Any]:
    """Columns (R,) of the table `tracks`, without `replicate` and `target`, from those of `estimates`."""
    errors, readings = np.ascontiguousarray(columns["error"]), columns["readings"]
    steps = errors.shape[1]
    mean, rmse = errors.mean(axis=1), np.sqrt((errors**2).mean(axis=1))
    median = np.median(errors, axis=1)
    return {
        "rmse": rmse,
        "median_error": median,
        **_losses(errors, setup),
        "late": 0,
        "reports": steps,
        "delay": 0.0,
        "received": 0,
        "report_delay": NAN,
        "due": 0,
        "in_time": NAN,
        "tracked": (readings >= 1).mean(axis=1),
        "tracked_three": (readings >= metrics.ENOUGH_READINGS).mean(axis=1),
        "mean_error": mean,
        **_of_three(errors, readings, {"mean_error": mean, "rmse": rmse, "median_error": median}),
        **dict.fromkeys(("woken", "ineffective", "ineffective_twenty", "reacquired", "called", "dismissed"), 0),
        "handover_bits": NAN,
    }


def _losses(errors: Floats, setup: TrackingSetup) -> dict[str, Any]:
    """Whether, how often and for how long each track was lost, and when first. Most tracks never are."""
    window, limit, none = setup.lost_window, setup.lost_limit, np.zeros(errors.shape[1])
    found = {name: np.full(len(errors), value) for name, value in losses(none, window, limit, setup.dt).items()}
    for run in np.flatnonzero(errors.max(axis=1) > limit):
        for name, value in losses(errors[run], window, limit, setup.dt).items():
            found[name][run] = value
    return found


def _of_three(errors: Floats, readings: Ints, whole: Mapping[str, Floats]) -> dict[str, Floats]:
    """The same statistics of the steps with at least three readings; NaN without one."""
    sure = readings >= metrics.ENOUGH_READINGS
    measures = {"mean_error": metrics.mean_error, "rmse": metrics.rmse, "median_error": metrics.median_error}
    result = {}
    for name, measure in measures.items():
        values = np.where(sure.all(axis=1), whole[name], NAN)
        for run in np.flatnonzero(sure.any(axis=1) & ~sure.all(axis=1)):
            values[run] = measure(errors[run][sure[run]])
        result[f"{name}_three"] = values
    return result


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
        "rmse": np.sqrt((errors**2).mean(axis=1)),
        "median_error": np.median(errors, axis=1),
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
    mean, middle = nees.mean(axis=1), np.median(nees, axis=1)
    for run in np.flatnonzero(~np.isfinite(nees).all(axis=1)):
        mean[run], middle[run] = metrics.mean_error(nees[run]), metrics.median_error(nees[run])
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
