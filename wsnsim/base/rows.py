"""Rows of a target in the tables `truth`, `estimates`, `particles` and `tracker_state`, and those who follow a run.

truth_rows(...), estimate_rows(...) -> columns of a table      write_belief(...)

A follower of a run, such as a live view, only reads. It is asked at each step whether it wants the present state, which
costs nothing if not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import NO_INNOVATION, Estimate, Floats, Reading
from wsnsim.base.optional_ports import ReportsState, Snapshots
from wsnsim.base.ports import MotionModel
from wsnsim.base.requests import Member
from wsnsim.base.setups import Setup
from wsnsim.base.tables import Recorder

NAN = float("nan")


@dataclass(slots=True)
class Issued:
    """One estimate of a cluster head.

    Attributes:
        step: Step that it belongs to.
        issued: Time in s at which the head had it.
        estimate: Mean and covariance.
        head: Number of the head.
        active: Members with a measurement, the head included.
        members: Members, the head included.
        readings: Measurements that were used.
        peers: Without a head, what no node has: the mean (P,) of all participants' estimated positions, and the root
            mean square distance of these from it.
    """

    step: int
    issued: float
    estimate: Estimate
    head: int
    active: int
    members: int
    readings: int
    peers: tuple[Floats, float] | None = None


def is_late(issued: float, step: int, dt: float) -> bool:
    """Whether an estimate was issued after the next step began."""
    return issued > (step + 1) * dt


def truth_rows(motion: MotionModel, truth: Floats, steps: int, dt: float) -> dict[str, Any]:
    """Columns of the table `truth` for steps 0 to `steps` of trajectories (..., steps + 1 or more, D)."""
    numbers = np.arange(steps + 1)
    states = {name: truth[..., : steps + 1, i] for i, name in enumerate(motion.columns)}
    return {"step": numbers, "time": numbers * dt, **states}


def estimate_rows(
    estimates: Mapping[int, Issued], heads: Sequence[int], motion: MotionModel, truth: Floats, steps: int, dt: float
) -> dict[str, Any]:
    """Columns of the table `estimates`, except `woken`, `ineffective` and `gaussian`: one row per step from 1 on.

    Values of a step without an estimate are NaN.

    Args:
        estimates: The estimates by step.
        heads: Cluster head of each step from 0 on; -1 if there is none.
        motion: The motion model.
        truth: (steps + 1 or more, D) ground-truth trajectory.
        steps: Number of the last step.
        dt: Duration of a step in s.
    """
    place = list(motion.position)
    means = np.full((steps, len(motion.columns)), NAN)
    covs, block = np.full((steps, len(place), len(place)), NAN), np.ix_(place, place)
    innovations = np.full((steps, 2), NO_INNOVATION)
    issued, effective, late = np.full(steps, NAN), np.full(steps, NAN), np.ones(steps, dtype=np.uint8)
    counts = np.zeros((steps, 3), dtype=np.int64)
    leaders = np.array(heads[1 : steps + 1], dtype=np.int64)
    for step, item in estimates.items():
        row, guess = step - 1, item.estimate
        means[row], covs[row], innovations[row] = guess.mean, guess.cov[block], guess.innovation
        issued[row], effective[row], late[row] = item.issued, guess.effective, is_late(item.issued, step, dt)
        leaders[row], counts[row] = item.head, (item.active, item.members, item.readings)
    return {
        **state_columns(motion, truth, dt, means, covs),
        "issued": issued,
        "head": leaders,
        "active": counts[:, 0],
        "members": counts[:, 1],
        "readings": counts[:, 2],
        "received": np.full(steps, NAN),
        "late": late,
        "effective_particles": effective,
        "nis": innovations[:, 0],
        "nis_dof": innovations[:, 1].astype(np.int64),
    }


def peer_columns(estimates: Mapping[int, Issued], motion: MotionModel, truth: Floats, steps: int) -> dict[str, Any]:
    """The columns `network_error` and `disagreement` of the table `estimates`; NaN for a step without an estimate.

    Args:
        estimates: The estimates by step.
        motion: The motion model.
        truth: (steps + 1 or more, D) ground-truth trajectory.
        steps: Number of the last step.
    """
    errors, spreads = np.full((2, steps), NAN)
    for step, item in estimates.items():
        assert item.peers is not None, "every estimate of a network without a head is one of several"
        mean, spreads[step - 1] = item.peers
        errors[step - 1] = np.linalg.norm(mean - truth[step, list(motion.position)])
    return {"network_error": errors, "disagreement": spreads}


def state_columns(motion: MotionModel, truth: Floats, dt: float, means: Floats, covs: Floats) -> dict[str, Any]:
    """Columns of the table `estimates` that follow from the moments: of one run, or (...) of several.

    Args:
        motion: The motion model.
        truth: (..., K + 1 or more, D) ground-truth trajectories.
        dt: Duration of a step in s.
        means: (..., K, D) means at the steps from 1 on.
        covs: (..., K, P, P) covariances of the position.
    """
    steps, place = means.shape[-2], list(motion.position)
    numbers, deviations = np.arange(1, steps + 1), means[..., place] - truth[..., 1 : steps + 1, place]
    nees = metrics.normalised_squares(deviations.reshape(-1, len(place)), covs.reshape(-1, *covs.shape[-2:]))
    return {
        "step": numbers,
        "time": numbers * dt,
        **{name: means[..., i] for i, name in enumerate(motion.columns)},
        **{name: np.sqrt(covs[..., i, i]) for i, name in enumerate(("sd_x", "sd_y")[: len(place)])},
        **({"cov_xy": covs[..., 0, 1]} if len(place) > 1 else {}),
        "error": np.sqrt((deviations**2).sum(axis=-1)),
        "nees": nees.reshape(means.shape[:-1]),
    }


def covariance_rows(estimates: Mapping[int, Issued], columns: Sequence[str]) -> dict[str, Any]:
    """Columns of the table `covariances`: one row per estimate, the upper triangle of its covariance (D, D)."""
    size = len(columns)
    covs = np.array([item.estimate.cov for _, item in sorted(estimates.items())]).reshape(-1, size, size)
    return {"step": np.array(sorted(estimates), dtype=np.int64), **triangle_columns(covs, columns)}


def triangle_columns(covs: Floats, columns: Sequence[str]) -> dict[str, Floats]:
    """The upper triangle of covariances (..., D, D) as columns `cov_ONE_OTHER`."""
    pairs = [(i, j) for i in range(len(columns)) for j in range(i, len(columns))]
    return {f"cov_{columns[i]}_{columns[j]}": covs[..., i, j] for i, j in pairs}


def consistency(tracks: Sequence[Mapping[str, Any]], size: int) -> dict[str, float]:
    """The columns `nees`, `nees_median`, `singular` and `nis` of `runs`, from the columns of each track's estimates.

    Args:
        tracks: Columns of the table `estimates` of each track.
        size: Number of position columns.
    """
    nees, nis, dof, sd, error = (
        np.concatenate([track[name] for track in tracks]) if tracks else np.empty(0)
        for name in ("nees", "nis", "nis_dof", "sd_x", "error")
    )
    known = np.isfinite(nis) & (dof > 0)
    per_reading = float(nis[known].sum() / dof[known].sum()) if known.any() else NAN
    average, middle = metrics.mean_error(nees) / size, metrics.median_error(nees) / size
    singular = int(np.count_nonzero(np.isfinite(sd) & np.isfinite(error) & ~np.isfinite(nees)))
    return {"nees": average, "nees_median": middle, "singular": singular, "nis": per_reading}


def fingerprint(
    event_fingerprint: int, tracks: Iterable[Mapping[int, Issued]], unassigned: Mapping[str, Any] = MappingProxyType({})
) -> int:
    """A 64-bit digest of the events' digest and of every estimate: time, step, target, mean and covariance, bit by bit.

    Args:
        event_fingerprint: Digest of the events, see `runs.event_fingerprint`.
        tracks: The estimates of each target by step.
        unassigned: Columns of the estimates of tracks that name no target.
    """
    digest = hashlib.blake2b(event_fingerprint.to_bytes(8, "little"), digest_size=8)
    for target, estimates in enumerate(tracks):
        for step, item in sorted(estimates.items()):
            parts = ([item.issued, step, target], item.estimate.mean, item.estimate.cov)
            for part in parts:
                digest.update(np.ascontiguousarray(part, dtype=np.float64).tobytes())
    for _, column in sorted(unassigned.items()):
        digest.update(np.ascontiguousarray(column, dtype=np.float64).tobytes())
    return int.from_bytes(digest.digest(), "little")


def deviation_rmse(columns: Mapping[str, Any], motion: MotionModel, truth: Floats) -> Floats:
    """(D,) root mean square error of each state column over the steps with an estimate; NaN without one."""
    means = np.stack([columns[name] for name in motion.columns], axis=1)
    known = np.isfinite(columns["error"])
    if not known.any():
        return np.full(means.shape[1], NAN)
    deviations: Floats = np.sqrt(np.mean((means - truth[1 : len(means) + 1])[known] ** 2, axis=0))
    return deviations


def write_readings(recorder: Recorder, key: Mapping[str, float], readings: Mapping[int, Reading]) -> None:
    """Write the rows of the table `readings` of one step, by node, if they are wanted; a row for each component.

    Args:
        recorder: Where the rows go.
        key: Replicate, target, step and time, by column name.
        readings: {node: reading} of the nodes that have one.
    """
    if readings and recorder.wants("readings"):
        nodes = sorted(readings)
        values = np.array([readings[node] for node in nodes])
        if values.ndim == 1:
            recorder.write("readings", {**key, "node": nodes, "reading": values})
            return
        count = values.shape[1]
        of_nodes, components = np.repeat(nodes, count), np.tile(np.arange(count), len(nodes))
        recorder.write("readings", {**key, "node": of_nodes, "component": components, "reading": values.reshape(-1)})


def wants_steps(recorder: Recorder) -> bool:
    """Whether the recorder keeps any of the tables that are written step by step, which no batch of runs writes."""
    return wants_belief(recorder) or recorder.wants("readings")


def wants_belief(recorder: Recorder) -> bool:
    """Whether the recorder keeps any of the tables that `write_belief` writes."""
    return recorder.wants("particles") or recorder.wants("tracker_state")


def write_belief(
    recorder: Recorder,
    key: Mapping[str, int],
    tracker: object,
    belief: object,
    members: Sequence[Member],
    columns: Sequence[str],
) -> None:
    """Write one step's rows of the tables `particles` and `tracker_state`, if they are wanted and the tracker has them.

    Args:
        recorder: Where the rows go.
        key: Replicate, target and step, by column name.
        tracker: The tracker.
        belief: Its belief after the step.
        members: Members of the cluster, which may hold some of the particles.
        columns: Names of the state columns.
    """
    if recorder.wants("particles") and isinstance(tracker, Snapshots):
        for node, states, weights in tracker.snapshot(belief, members):
            rows = {"node": node, **dict(zip(columns, states, strict=True)), "weight": weights}
            recorder.write("particles", {**key, **rows})
    if recorder.wants("tracker_state") and isinstance(tracker, ReportsState):
        for name, values in tracker.report_state(belief).items():
            rows = {"name": recorder.state_names.code(name), "index": np.arange(len(values)), "value": values}
            recorder.write("tracker_state", {**key, **rows})


class RunStart(NamedTuple):
    """What is known of a run before its clock starts.

    Attributes:
        setup: The scenario.
        replicate: Number of the run.
        positions: (N, 2) positions of the nodes in m.
        truths: The states (steps + 1, D) of each target; NaN where it is absent.
    """

    setup: Setup
    replicate: int
    positions: Floats
    truths: Sequence[Floats]


class TrackNow(NamedTuple):
    """The estimates of a target by step, and the cluster heads by step (-1: none), so far. Both grow during the run."""

    target: int
    estimates: Mapping[int, Issued]
    heads: Sequence[int]


class RunNow(NamedTuple):
    """The state of a run at the beginning of a step.

    Attributes:
        step: Number of the step; all steps before it are over, and their events are written.
        time: Simulated time in s.
        tracks: The tracks; of a run without a network, the one that is computed.
        joules: Energy in J that the network has spent so far, by cause; empty without a network.
        residual: (N,) residual energies of the nodes in J, None without a network.
        spent: (causes, N) energy in J that each node has spent so far, None without a network.
    """

    step: int
    time: float
    tracks: Sequence[TrackNow]
    joules: Sequence[float] = ()
    residual: Floats | None = None
    spent: Floats | None = None


@runtime_checkable
class FollowsRuns(Protocol):
    """A recorder that follows runs while they compute."""

    def begin(self, start: RunStart) -> None:
        """A run begins."""

    def due(self) -> bool:
        """Whether the present state is wanted."""

    def follow(self, now: RunNow) -> None:
        """Take the present state. What it refers to changes when the run goes on."""


def follower_of(recorder: object) -> FollowsRuns | None:
    """The recorder, if it follows runs."""
    return recorder if isinstance(recorder, FollowsRuns) else None
