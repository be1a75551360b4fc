"""What nodes sense and send in a film: who sensed, whose frames went to whom, whose were lost, who broadcast.

traffic(film)
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_encoding import Film, thinned


def traffic(film: Film) -> None:
    """Everything that nodes do with each other at each frame."""
    events, kind = film.run.events, film.run.events["kind"]
    frame, seat, peer = film.at(events["step"]), film.seat(events["node"]), film.seat(events["peer"])
    sensing = (kind == KIND["sense"]) & (seat >= 0)
    senses = np.unique(frame[sensing] << 32 | seat[sensing])
    film.add("sense", senses >> 32, node=(senses & 0xFFFFFFFF).astype("<u4"))
    sent = np.isin(kind, [KIND["send"], KIND["relay"]])
    cast = sent & (events["peer"] < 0) & (seat >= 0)
    film.add("cast", frame[cast], node=seat[cast].astype("<u4"), what=events["what"][cast].astype(np.uint8))
    got, struck = (kind == KIND["receive"]), (kind == KIND["collide"])
    lost = sent & (events["peer"] >= 0) & ~np.isin(events["frame"], events["frame"][got])
    told = (got | lost | struck) & (seat >= 0) & (peer >= 0)
    origin, goal = np.where(lost, seat, peer)[told], np.where(lost, peer, seat)[told]
    words = events["what"][told].astype(np.int64) * 2 + ~got[told]
    _links(film, np.unique(((frame[told] * film.picked.size + origin) * film.picked.size + goal) * 512 + words))


def _links(film: Film, keys: Ints) -> None:
    """Links in the frames' order, each one number: of its frame, from, to, word, and whether what was sent was lost."""
    pairs, word = np.divmod(keys, 512)
    rest, goal = np.divmod(pairs, max(film.picked.size, 1))
    frame, origin = np.divmod(rest, max(film.picked.size, 1))
    kept = thinned(frame, film.plan.links)
    if not kept.all():
        film.count("link", frame)
        film.notes.append(f"of links that frames went over at most {film.plan.links} are drawn at a time")
    ends = {name: values[kept].astype("<u4") for name, values in (("origin", origin), ("goal", goal))}
    film.add("link", frame[kept], **ends, what=(word[kept] // 2).astype("u1"), lost=(word[kept] % 2).astype("u1"))
