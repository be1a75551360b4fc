"""Metrics of several tracks beside several targets when no track says which target it is: GOSPA, OSPA(2), identities.

    gospa(truth, tracks, cutoffs) -> Gospa          a set of estimates beside a set of targets, at each step
    ospa2(truth, tracks, cutoff, window)            the histories of tracks beside those of targets
    follow(truth, tracks, cutoff) -> rows           which track follows which target at each step, decided afterwards
    switches(present, tracks, followed)             where a target's track changes
    FollowedRun.of(...)                             all of it for one run, and the columns of the table `runs`

truth: (T, K + 1, P) positions of targets at the steps 0 to K, NaN where a target is absent. Metrics are of the steps 1
to K, and of confirmed tracks alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats, Ints

ORDER: Final = 2.0
"""The order p of GOSPA and OSPA(2): root mean squares."""
HOUR: Final = 3600.0
PARTS: Final = ("localisation", "missed", "false")
DISTANCES: Final = ("gospa", *(f"gospa_{part}" for part in PARTS), "ospa2")


class Tracks(NamedTuple):
    """What a tracker believes: one row per track and step at which it exists, ordered by step.

    Attributes:
        step: (n,) number of the step.
        track: (n,) number of the track.
        position: (n, P) estimated position.
        confirmed: (n,) whether the track is confirmed.
    """

    step: Ints
    track: Ints
    position: Floats
    confirmed: Bools


class Gospa(NamedTuple):
    """GOSPA and its parts, (C, K) by cutoff and step: distance^p = localisation^p + missed^p + false^p.

    Attributes:
        distance: the metric.
        localisation: due to errors of the tracks that are assigned to targets.
        missed: due to targets without a track.
        false: due to tracks without a target.
    """

    distance: Floats
    localisation: Floats
    missed: Floats
    false: Floats


class MultiTargetRule(NamedTuple):
    """What the tracks of a run are judged by.

    Attributes:
        cutoff: distance c at and above which a track does not follow a target, in the unit of the position.
        window: number of steps of a history in OSPA(2).
        dt: duration of a step in s.
    """

    cutoff: float
    window: int
    dt: float


def cutoff_of(limit: float) -> float:
    """The distance c of a run in which a track is lost above an error `limit`: this, or 20 m if it is infinite."""
    return limit if np.isfinite(limit) else metrics.LOST_ERROR


def gospa(truth: Floats, tracks: Tracks, cutoffs: Sequence[float], order: float = ORDER) -> Gospa:
    """GOSPA (Rahmathullah, García-Fernández, Svensson 2017, definition 1) with α = 2, at the steps 1 to K.

    With α = 2 it is the least sum over assignments of errors^p below c, and c^p / 2 for each target and for each track
    that is left out (their proposition 1), so that it has parts.

    Args:
        truth: (T, K + 1, P) positions of targets, NaN where absent.
        tracks: the estimates.
        cutoffs: the distances c.
        order: the order p, at least 1.

    Returns:
        Distances in the unit of the position.
    """
    powers = np.zeros((3, len(cutoffs), truth.shape[1] - 1))
    for step, targets, rows, distances in _steps(truth, tracks):
        for i, cutoff in enumerate(cutoffs):
            pairs = _assigned(distances, cutoff, order)
            left = targets.size - len(pairs[0]), rows.size - len(pairs[0])
            powers[:, i, step - 1] = ((distances[pairs] / cutoff) ** order).sum(), left[0] / 2.0, left[1] / 2.0
    scale = np.array(cutoffs)[:, None]
    return Gospa(*(scale * part ** (1.0 / order) for part in (powers.sum(axis=0), *powers)))


def ospa2(truth: Floats, tracks: Tracks, cutoff: float, window: int, order: float = ORDER) -> Floats:
    """(K,) OSPA(2) over the `window` steps that end at each step, fewer at the start (Beard, Vo, Vo 2017, 2020).

    The distance of a track from a target is the mean, of this order and over the steps at which one of them exists, of
    their distance below c, which is c where only one of them exists. OSPA of the same order is made of these distances:
    a track that changes its target has an error, and GOSPA sees none. We take equal weights and q = p.

    Args:
        truth: (T, K + 1, P) positions of targets, NaN where absent.
        tracks: the estimates.
        cutoff: the distance c.
        window: number of steps.
        order: the order p = q, at least 1.
    """
    tracks = _confirmed(tracks)
    result = np.zeros(truth.shape[1] - 1)
    for last in range(1, truth.shape[1]):
        first = max(1, last - window + 1)
        targets = truth[:, first : last + 1]
        targets = targets[np.isfinite(targets[..., 0]).any(axis=1)]
        rows = slice(*np.searchsorted(tracks.step, (first, last + 1)))
        numbers, which = np.unique(tracks.track[rows], return_inverse=True)
        histories = np.full((numbers.size, last + 1 - first, truth.shape[2]), np.nan)
        histories[which, tracks.step[rows] - first] = tracks.position[rows]
        result[last - 1] = cutoff * _ospa(_apart(targets, histories, cutoff, order), order)
    return result


def _apart(targets: Floats, histories: Floats, cutoff: float, order: float) -> Floats:
    """(T, N) time-averaged distances of histories (T, W, P) and (N, W, P), as shares of the cutoff."""
    distances = np.sqrt(((targets[:, None] - histories[None]) ** 2).sum(axis=-1)) / cutoff
    powers = np.where(np.isnan(distances), 1.0, np.minimum(distances, 1.0)) ** order
    exist = np.isfinite(targets[:, None, :, 0]) | np.isfinite(histories[None, :, :, 0])
    apart: Floats = (np.where(exist, powers, 0.0).sum(axis=-1) / exist.sum(axis=-1)) ** (1.0 / order)
    return apart


def _ospa(distances: Floats, order: float) -> float:
    """OSPA (Schuhmacher, Vo, Vo 2008, eq. 3) of distances (T, N) as shares of the cutoff, itself such a share."""
    size, least = max(distances.shape), min(distances.shape)
    if not size:
        return 0.0
    pairs = _assignment(distances**order)
    return float((((distances[pairs] ** order).sum() + size - least) / size) ** (1.0 / order))


def follow(truth: Floats, tracks: Tracks, cutoff: float, order: float = ORDER) -> Ints:
    """(T, K) which row of `tracks` follows each target at the steps 1 to K; -1: none.

    A track follows a target only below the distance `cutoff`. A target keeps the track that it had last, if this is
    confirmed, that near, and has not followed another target since; targets and tracks left are assigned as in GOSPA.
    So an identity is kept while it is possible (as in CLEAR MOT: Bernardin, Stiefelhagen 2008). A target that was
    absent has no last track.

    Args:
        truth: (T, K + 1, P) positions of targets, NaN where absent.
        tracks: the estimates.
        cutoff: the distance c.
        order: of the assignment.
    """
    followed = np.full((len(truth), truth.shape[1] - 1), -1, dtype=np.int64)
    held: dict[int, int] = {}
    for step, targets, rows, distances in _steps(truth, tracks):
        held = {target: track for target, track in held.items() if np.isfinite(truth[target, step, 0])}
        column_of = {track: column for column, track in enumerate(tracks.track[rows].tolist())}
        near = distances < cutoff
        last = [column_of.get(held.get(target, -1), -1) for target in targets.tolist()]
        pairs = [(line, column) for line, column in enumerate(last) if column >= 0 and near[line, column]]
        for line, column in pairs:
            near[line], near[:, column] = False, False
        if near.any():
            lines, columns = _assigned(np.where(near, distances, cutoff), cutoff, order)
            pairs += zip(lines.tolist(), columns.tolist(), strict=True)
        for line, column in pairs:
            target, row = int(targets[line]), int(rows[column])
            track = int(tracks.track[row])
            if held.get(target) != track:
                held = {other: its for other, its in held.items() if its != track} | {target: track}
            followed[target, step - 1] = row
    return followed


def switches(present: Bools, tracks: Tracks, followed: Ints) -> Ints:
    """(n, 4) the identity switches by step: step, target, number of the track before, and of the one that follows now.

    Args:
        present: (T, K) whether a target is there at the steps 1 to K. After an absence, any track is its first.
        tracks: the estimates.
        followed: (T, K) as `follow` returns it.
    """
    found = []
    for target, (there, rows) in enumerate(zip(present, followed, strict=True)):
        at = np.flatnonzero(rows >= 0)
        numbers, visit = tracks.track[rows[at]], np.cumsum(~there)[at]
        changed = np.flatnonzero((np.diff(numbers) != 0) & (np.diff(visit) == 0)) + 1
        found += [(int(at[i]) + 1, target, int(numbers[i - 1]), int(numbers[i])) for i in changed.tolist()]
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 4)


class FollowedRun(NamedTuple):
    """The tracks of one run beside its targets.

    Attributes:
        replicate: number of the run.
        truth: (T, K + 1, P) positions of the targets at the steps from 0 on, NaN where absent.
        tracks: the tracks at these steps.
        followed: (T, K) which row of the tracks follows each target at the steps from 1 on; -1: none.
        rule: what the tracks are judged by.
    """

    replicate: int
    truth: Floats
    tracks: Tracks
    followed: Ints
    rule: MultiTargetRule

    @classmethod
    def of(cls, replicate: int, truth: Floats, tracks: Tracks, limit: float, window: int, dt: float) -> FollowedRun:
        """The run, with tracks assigned to targets afterwards.

        Args:
            replicate: number of the run.
            truth: positions of the targets.
            tracks: the tracks.
            limit: the error above which a track is lost, see `cutoff_of`.
            window: number of steps of a history in OSPA(2).
            dt: duration of a step in s.
        """
        cutoff = cutoff_of(limit)
        return cls(replicate, truth, tracks, follow(truth, tracks, cutoff), MultiTargetRule(cutoff, window, dt))

    @property
    def present(self) -> Bools:
        """(T, K) whether each target is there at the steps from 1 on."""
        return np.isfinite(self.truth[:, 1:, 0])

    @property
    def errors(self) -> Floats:
        """(T, K) distance of each target from the track that follows it; NaN where none does."""
        places = np.full((*self.followed.shape, self.truth.shape[2]), np.nan)
        there = self.followed >= 0
        places[there] = self.tracks.position[self.followed[there]]
        errors: Floats = np.sqrt(((places - self.truth[:, 1:]) ** 2).sum(axis=-1))
        return errors

    @property
    def switches(self) -> Ints:
        """(n, 4) the identity switches by step: step, target, number of the track before, and of the one after."""
        return switches(self.present, self.tracks, self.followed)

    def columns(self) -> dict[str, Any]:
        """The columns `tables.UNLABELLED` of the table `runs`.

        Distances are means over the steps of the order of the metric, so that the parts of GOSPA still add up.
        """
        parts, rule, present, followed = (
            gospa(self.truth, self.tracks, [self.rule.cutoff]), self.rule, self.present, self.followed >= 0
        )  # fmt: skip
        histories = ospa2(self.truth, self.tracks, rule.cutoff, rule.window)
        distances = dict(zip(DISTANCES, (*(part[0] for part in parts), histories), strict=True))
        numbers, lengths = np.unique(_confirmed(self.tracks).track, return_counts=True)
        true = np.isin(numbers, self.tracks.track[self.followed[followed]])
        hours = followed.shape[1] * rule.dt / HOUR
        return {
            **{name: float(np.mean(values**ORDER) ** (1.0 / ORDER)) for name, values in distances.items()},
            "completeness": float(followed.sum() / present.sum()) if present.any() else np.nan,
            "switches": len(self.switches),
            "fragments": sum(_gaps(*each) for each in zip(present, followed, strict=True)),
            "time_to_confirm": metrics.mean_error(_waits(present, followed) * rule.dt),
            "track_life": metrics.mean_error(lengths[true].astype(np.float64) * rule.dt),
            "confirmed_tracks": numbers.size,
            "false_tracks": int((~true).sum()) / hours,
        }


def _gaps(present: Bools, followed: Bools) -> int:
    """How often a target is followed again that was followed before and then was not, while present."""
    starts = np.count_nonzero(np.diff(followed[present], prepend=False) & followed[present])
    return max(int(starts) - 1, 0)


def _waits(present: Bools, followed: Bools) -> Floats:
    """(T,) steps from a target's first one to the first at which a track follows it; NaN without one."""
    waits = (np.argmax(followed, axis=1) - np.argmax(present, axis=1)).astype(np.float64)
    return np.where(followed.any(axis=1), waits, np.nan)


def _confirmed(tracks: Tracks) -> Tracks:
    """The rows of confirmed tracks."""
    kept = tracks.confirmed
    return Tracks(tracks.step[kept], tracks.track[kept], tracks.position[kept], tracks.confirmed[kept])


def _steps(truth: Floats, tracks: Tracks) -> Iterator[tuple[int, Ints, Ints, Floats]]:
    """Yield, from step 1 on, its number, the targets present, the rows of confirmed tracks, and their distances."""
    ends = np.searchsorted(tracks.step, np.arange(1, truth.shape[1] + 1))
    present = np.isfinite(truth[..., 0])
    for step, (first, last) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True), start=1):
        targets = np.flatnonzero(present[:, step])
        rows = first + np.flatnonzero(tracks.confirmed[first:last])
        apart = truth[targets, step][:, None] - tracks.position[rows][None]
        yield step, targets, rows, np.sqrt((apart**2).sum(axis=-1))


def _assigned(distances: Floats, cutoff: float, order: float) -> tuple[Ints, Ints]:
    """The pairs below the cutoff of the assignment that has the least sum of min(distance, c)^p."""
    lines, columns = _assignment(np.minimum(distances / cutoff, 1.0) ** order)
    near = distances[lines, columns] < cutoff
    return lines[near], columns[near]


def _assignment(costs: Floats) -> tuple[Ints, Ints]:
    """The assignment of least cost."""
    from scipy.optimize import linear_sum_assignment  # slow to import, and needed with several tracks only

    lines, columns = linear_sum_assignment(costs)
    return lines, columns
