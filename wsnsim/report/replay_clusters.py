"""Who belongs to which cluster, frame by frame, in the order of the log.

    clusters(film);  shown_from(events) -> steps

The columns are join_node, join_target and join_what: a node JOINS a target's cluster, BEGINS it anew as its only
member, LEAVES every cluster (it is sent to rest, or fails), or the cluster ENDS, as its target is lost.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_encoding import Film

JOINS, BEGINS, LEAVES, ENDS = range(4)
WHAT: Final = {
    "join": JOINS, "announce": BEGINS, "elect": BEGINS, "lost": ENDS,
    "sleep": LEAVES, "resume": LEAVES, "restart": LEAVES, "crash": LEAVES, "death": LEAVES,
}  # fmt: skip
TURNS: Final = ("wake", "stay", "sleep", "resume", "restart", "death", "crash")
"""Events after which a node is in another state."""
RESTS: Final = ("sleep", "resume")
NONE: Final = 255


def coded(kinds: np.ndarray, codes: dict[str, int]) -> np.ndarray:
    """Each kind of event as the code that a table gives it, NONE where it gives none."""
    table = np.full(256, NONE, np.uint8)
    for kind, code in codes.items():
        table[KIND[kind]] = code
    return table[kinds]


def shown_from(events: Columns) -> Ints:
    """(events,) the steps from which events show: those who go to rest at a handover do so from the next step on.

    The estimate of a handover's step is still that of the old cluster and its head, who rest once they have handed it
    over, at the same time. A node that is woken again in the step is shown at once.
    """
    step, kind = events["step"].astype(np.int64), events["kind"]
    handed = np.flatnonzero(kind == KIND["handover"])
    if not handed.size:
        return step
    cluster = step << 32 | events["target"].astype(np.int64) + 1
    known, first = np.unique(cluster[handed], return_index=True)
    at = np.searchsorted(known, cluster).clip(0, known.size - 1)
    after = (known[at] == cluster) & (np.arange(step.size) > handed[first][at])
    return step + (after & np.isin(kind, [KIND[name] for name in RESTS]) & _final(events))


def _final(events: Columns) -> np.ndarray:
    """(events,) whether an event is the last of its step to change its node's state."""
    turns = np.flatnonzero(np.isin(events["kind"], [KIND[name] for name in TURNS]))[::-1]
    who = events["step"][turns].astype(np.int64) << 32 | events["node"][turns].astype(np.int64) + 1
    result = np.zeros(events["kind"].size, dtype=bool)
    result[turns[np.unique(who, return_index=True)[1]]] = True
    return result


def clusters(film: Film) -> None:
    """Who joins, begins and leaves clusters; a note where the log says nothing of it."""
    events = film.run.events
    seat, what = film.seat(events["node"]), coded(events["kind"], WHAT)
    targets = np.array(film.run.targets, dtype=np.int64)
    of_target = np.isin(events["target"], targets) & (what != LEAVES) & (what != NONE)
    joined = np.unique(seat[of_target & (what != ENDS) & (seat >= 0)])
    if not joined.size:
        if film.run.guess:
            film.notes.append("no members of clusters are drawn: the log names none")
        return
    of_target &= (seat >= 0) | (what == ENDS)
    mine = np.flatnonzero(of_target | ((what == LEAVES) & np.isin(seat, joined)))
    number = np.where(of_target, np.searchsorted(targets, events["target"]), 0)[mine]
    node = seat[mine].clip(0).astype("<u4")
    film.add(
        "join", film.at(shown_from(events)[mine]), node=node, target=number.astype("<u2"), what=what[mine].astype("u1")
    )
