"""The clusters of a replay: changes of membership by frame, in the order of the event log.

The columns are membership_node, membership_target and membership_change: a node JOINS a target's cluster; a cluster
STARTS with the node as its only member; a node LEAVES every cluster, because it goes to sleep or fails; or a cluster
ENDS, because its track is lost.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_encoding import ReplayEncoder

JOINS, STARTS, LEAVES, ENDS = range(4)
CHANGES: Final = {
    "join": JOINS, "announce": STARTS, "elect": STARTS, "lost": ENDS,
    "sleep": LEAVES, "resume": LEAVES, "restart": LEAVES, "crash": LEAVES, "death": LEAVES,
}  # fmt: skip
STATE_CHANGES: Final = ("wake", "stay", "sleep", "resume", "restart", "death", "crash")
"""Events that change a node's state."""
GOING_TO_SLEEP: Final = ("sleep", "resume")
NONE: Final = 255


def coded(kinds: np.ndarray, codes: dict[str, int]) -> np.ndarray:
    """(events,) the code of each kind of event, NONE for kinds without a code."""
    table = np.full(256, NONE, np.uint8)
    for kind, code in codes.items():
        table[KIND[kind]] = code
    return np.asarray(table[kinds])


def shown_from(events: Columns) -> Ints:
    """(events,) the steps from which events show.

    The estimate of a handover's step still belongs to the old cluster, whose nodes go to sleep after the handover, at
    the same time. These nodes are shown asleep from the next step on, unless they are woken again within the step.
    """
    step, kind = events["step"].astype(np.int64), events["kind"]
    handovers = np.flatnonzero(kind == KIND["handover"])
    if not handovers.size:
        return step
    cluster = step << 32 | events["target"].astype(np.int64) + 1
    known, first = np.unique(cluster[handovers], return_index=True)
    at = np.searchsorted(known, cluster).clip(0, known.size - 1)
    after = (known[at] == cluster) & (np.arange(step.size) > handovers[first][at])
    late = after & np.isin(kind, [KIND[name] for name in GOING_TO_SLEEP]) & _is_last_change(events)
    return np.asarray(step + late)


def _is_last_change(events: Columns) -> Bools:
    """(events,) whether an event is the last of its step that changes its node's state."""
    changes = np.flatnonzero(np.isin(events["kind"], [KIND[name] for name in STATE_CHANGES]))[::-1]
    node = events["step"][changes].astype(np.int64) << 32 | events["node"][changes].astype(np.int64) + 1
    result = np.zeros(events["kind"].size, dtype=bool)
    result[changes[np.unique(node, return_index=True)[1]]] = True
    return result


def add_clusters(encoder: ReplayEncoder, joined_before: Ints | None = None) -> Ints:
    """Add the changes of membership, or a note if the event log has none.

    Args:
        encoder: the replay.
        joined_before: indices of the nodes that joined a cluster in earlier portions of the replay.

    Returns:
        The indices of all nodes that joined a cluster so far.
    """
    events = encoder.run.events
    index, change = encoder.index_of(events["node"]), coded(events["kind"], CHANGES)
    targets = np.array(encoder.run.targets, dtype=np.int64)
    of_target = np.isin(events["target"], targets) & (change != LEAVES) & (change != NONE)
    joined = np.unique(index[of_target & (change != ENDS) & (index >= 0)])
    if joined_before is not None:
        joined = np.union1d(joined, joined_before)
    if not joined.size:
        if encoder.run.guess:
            encoder.notes.append("no cluster members are drawn: the event log has none")
        return joined
    of_target &= (index >= 0) | (change == ENDS)
    rows = np.flatnonzero(of_target | ((change == LEAVES) & np.isin(index, joined)))
    number = np.where(of_target, np.searchsorted(targets, events["target"]), 0)[rows]
    encoder.add(
        "membership",
        encoder.frame_of(shown_from(events)[rows]),
        node=index[rows].clip(0).astype("<u4"),
        target=number.astype("<u2"),
        change=change[rows].astype("u1"),
    )
    return joined
