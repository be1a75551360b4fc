"""The tracks of a run whose readings name no target: their numbers, their events, and the rows of `estimates`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Estimate
from wsnsim.base.ports import MotionModel
from wsnsim.base.rows import Issued, is_late
from wsnsim.base.scans import ScanOutcome, TrackEstimate
from wsnsim.network.clusters.track import Track
from wsnsim.network.event_log import ProtocolLog

EVENTS = {"start": "initiate", "confirm": "confirm", "delete": "delete", "merge": "delete"}
"""The kinds of events in the log, by what trackers say of tracks."""


MOST_GROUPS = 2**15
"""Numbers of groups that the column `target` of events holds."""
UNKNOWN = Estimate(np.empty(0), np.empty((0, 0)))
"""The prior of a group: there is none."""


SAME: Final = 3.0
"""Standard deviations of the difference of two states within which they are one target's (our choice)."""


def outdone(track: TrackEstimate, others: Iterable[TrackEstimate]) -> bool:
    """Whether one of the others is of the same target and stays: one that is confirmed, of such the oldest number."""
    return any(
        (not each.confirmed, each.number) < (not track.confirmed, track.number) and _same(track, each)
        for each in others
    )


def _same(one: TrackEstimate, other: TrackEstimate) -> bool:
    """Whether all columns of two states are as near as those of one target that two heads track by themselves."""
    apart = one.mean - other.mean
    return float(apart @ np.linalg.solve(one.cov + other.cov, apart)) <= SAME**2


class TrackRow(NamedTuple):
    """What a head held of a track at a step. `group`: the group of the track."""

    track: TrackEstimate
    issued: Issued
    group: int


@dataclass(slots=True)
class TrackBook:
    """The tracks of all groups.

    Attributes:
        write: Writes what the tables of a result have of a group that has ended: nothing is kept of it.
        priors: Of the targets that are present at step 0.
        next: The number of the next track: numbers are unique in a run (an idealisation: heads agree on them at once).
        groups: The groups that have a head or will have one.
        opened: How many have been opened; `clusters` and `handovers`: how many those had that have ended.
        rows: What heads held, in the order of time.
    """

    log: ProtocolLog
    env: simpy.Environment
    write: Callable[[Track], None]
    priors: Sequence[Estimate] = ()
    next: int = 0
    groups: list[Track] = field(default_factory=list)
    opened: int = 0
    clusters: int = 0
    handovers: int = 0
    rows: list[TrackRow] = field(default_factory=list)

    def open_group(self) -> Track:
        """A new group, which has no head yet. Numbers start again after `MOST_GROUPS`."""
        group = Track(self.opened % MOST_GROUPS, UNKNOWN, self.env.event())
        self.groups.append(group)
        self.opened += 1
        return group

    def close_groups(self) -> None:
        """Forget the groups that have neither a head nor an election; their rows are written."""
        for group in [group for group in self.groups if group.head is None and group.election is None]:
            self.groups.remove(group)
            self.clusters += len(group.clusters)
            self.handovers += group.handovers
            self.write(group)

    def note(self, group: int, head: int, outcome: ScanOutcome) -> None:
        """Log what happened to tracks, and count those that began."""
        for event in outcome.events:
            what = "duplicate" if event.kind == "merge" else ""
            self.log.add(EVENTS[event.kind], group, head, what, sequence=event.track)
            self.next = max(self.next, event.track + 1)

    def columns(self, motion: MotionModel, received: Mapping[tuple[int, int], float], dt: float) -> dict[str, Any]:
        """The columns of the table `estimates`, ordered by step and then by track."""
        rows = sorted(self.rows, key=lambda row: (row.issued.step, row.track.number))
        size, place = len(motion.columns), list(motion.position)
        means = np.array([row.track.mean for row in rows]).reshape(-1, size)
        covs = np.array([row.track.cov for row in rows]).reshape(-1, size, size)
        issued = [row.issued for row in rows]
        steps = np.array([each.step for each in issued], dtype=np.int64)
        of_issued = ("issued", "head", "active", "members", "readings")
        return {
            "track": np.array([row.track.number for row in rows], dtype=np.int64),
            "step": steps,
            "time": steps * dt,
            **{name: np.array([getattr(each, name) for each in issued]) for name in of_issued},
            **{name: means[:, i] for i, name in enumerate(motion.columns)},
            **{name: np.sqrt(covs[:, i, i]) for name, i in zip(("sd_x", "sd_y"), place, strict=False)},
            **({"cov_xy": covs[:, place[0], place[1]]} if len(place) > 1 else {}),
            "confirmed": np.array([row.track.confirmed for row in rows], dtype=np.uint8),
            "existence": np.array([row.track.existence for row in rows], dtype=np.float64),
            "received": np.array([received.get((row.group, row.issued.step), np.nan) for row in rows]),
            "late": np.array([is_late(each.issued, each.step, dt) for each in issued], dtype=np.uint8),
            "effective_particles": np.full(len(rows), np.nan),
        }
