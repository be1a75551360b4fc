"""The nodes of a replay and their traffic: positions, states, residual energy, readings, frames and broadcasts."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_encoding import NONE, ReplayEncoder, coded, evenly, quantised, shown_from, thinned

MAX_CELLS: Final = 20_000_000
"""Nodes times frames above which the residual energy of only those nodes is shown that took part (our choice)."""
ASLEEP, AWAKE, DEAD = 0, 1, 2
STATE_AFTER: Final = {
    "wake": AWAKE, "stay": AWAKE, "sleep": ASLEEP, "resume": ASLEEP, "restart": ASLEEP, "death": DEAD, "crash": DEAD,
}  # fmt: skip
SLEEP_KINDS: Final = ("wake", "sleep", "stay", "resume")
NOTED: Final = 0.001
"""The fraction of the energy above which a note says that its time is unknown (our choice)."""


def add_nodes(encoder: ReplayEncoder) -> list[float] | None:
    """Add the positions, states and residual energy of the drawn nodes.

    Returns:
        The least and the greatest residual energy as fractions of the initial energy, and the number of levels between
        them; None if nodes have no limited energy.
    """
    run = encoder.run
    rows = np.argsort(run.nodes["node"], kind="stable")
    rows = rows[np.isin(run.nodes["node"][rows], encoder.drawn)]
    nodes = {name: values[rows] for name, values in run.nodes.items()}
    total = run.nodes["node"].size
    if encoder.drawn.size < total:
        encoder.notes.append(
            f"{encoder.drawn.size:,} of {total:,} nodes are drawn: those that took part, and others evenly spread"
        )
    x, y = (np.full(rows.size, encoder.box[2]), nodes["x"]) if run.flat else (nodes["x"], nodes["y"])
    add_places(encoder, nodes["node"], x, y)
    if run.events:
        history = StateHistory(encoder.drawn.size)
        history.add_changes(encoder)
        encoder.columns["state"] = history.initial
    else:
        # without an event log, every node is awake until its death
        dead = np.flatnonzero(np.isfinite(nodes["died_at"])) if np.isfinite(encoder.run.dt) else np.empty(0, np.int64)
        steps = np.ceil(nodes["died_at"][dead] / encoder.run.dt).clip(0, encoder.run.last)
        encoder.columns["state"] = np.full(encoder.drawn.size, AWAKE, np.uint8)
        states = np.full(dead.size, DEAD, np.uint8)
        encoder.add("state_change", encoder.frame_of(steps), node=dead.astype("<u4"), state=states)
    return _add_charge(encoder, nodes) if run.network else None


def add_places(encoder: ReplayEncoder, nodes: Ints, x: Floats, y: Floats) -> None:
    """Add the ids and the positions of the drawn nodes."""
    box = encoder.box
    encoder.columns["node"] = nodes.astype("<i4")
    encoder.columns["node_x"] = quantised(x, box[0], box[2])
    encoder.columns["node_y"] = quantised(y, box[1], box[3])


class StateHistory:
    """The initial states of nodes, as far as the events of the portions so far tell.

    Attributes:
        initial: (drawn nodes,) the state of each node before its first event.
    """

    def __init__(self, nodes: int) -> None:
        self.initial = np.full(nodes, AWAKE, np.uint8)
        self._changed = np.zeros(nodes, dtype=np.bool_)
        self._sleeps = False

    def add_changes(self, encoder: ReplayEncoder) -> bool:
        """Add a portion's changes of state to it. Returns whether initial states are now known to be others."""
        events, before = encoder.run.events, self.initial.copy()
        index, after = encoder.index_of(events["node"]), coded(events["kind"], STATE_AFTER)
        if not self._sleeps and np.isin(events["kind"], [KIND[kind] for kind in SLEEP_KINDS]).any():
            self._sleeps = True
            self.initial[:] = ASLEEP
        if not self._sleeps:
            after[events["kind"] == KIND["restart"]] = AWAKE
        rows = (index >= 0) & (after != NONE)
        first, row = np.unique(index[rows], return_index=True)
        awake = (events["kind"][rows][row] == KIND["sleep"]) & ~self._changed[first]
        self.initial[first[awake]] = AWAKE
        self._changed[first] = True
        frames = encoder.frame_of(shown_from(events)[rows])
        encoder.add("state_change", frames, node=index[rows].astype("<u4"), state=after[rows])
        return bool((before != self.initial).any())


def _add_charge(encoder: ReplayEncoder, nodes: Columns) -> list[float] | None:
    """The initial level of residual energy of each node, and its changes by frame."""
    initial, left = nodes["energy_initial"], nodes["energy_left"]
    share = np.divide(left, initial, out=np.full(left.size, np.nan), where=np.isfinite(initial) & (initial > 0))
    if not np.isfinite(share).any() or np.nanmax(initial) == np.inf:
        return None
    low = np.floor(1000 * float(np.nanmin(share))) / 1000
    top = encoder.detail.levels - 1
    encoder.columns["charge"] = _level(share, low, top)
    if encoder.run.events:
        followed = _followed(encoder)
        others = np.setdiff1d(np.arange(encoder.drawn.size), followed)
        if (share[others] < 1.0).any():
            encoder.notes.append(
                f"the residual energy of {followed.size:,} nodes is shown over time; that of the others is "
                "the final one"
            )
        encoder.columns["charge"][followed] = top
        levels = _level(1.0 - _spent(encoder, nodes, followed) / initial[followed, None], low, top)
        frame, row = np.nonzero((np.diff(levels, axis=1, prepend=np.uint8(top)) != 0).T)
        encoder.add("charge_change", frame, node=followed[row].astype("<u4"), level=levels[row, frame])
    return [low, 1.0, top]


def _level(share: Floats, low: float, top: int) -> np.ndarray:
    """The fraction of residual energy as a level from 0 (at `low`) to `top`."""
    part = np.nan_to_num((share - low) / ((1.0 - low) or 1.0), nan=1.0).clip(0, 1)
    return np.asarray(np.rint(part * top).astype(np.uint8))


def _followed(encoder: ReplayEncoder) -> Ints:
    """The indices of nodes whose residual energy is shown over time: all, or of very many those that took part."""
    index = encoder.index_of(encoder.run.events["node"])
    active = np.unique(index[index >= 0])
    if encoder.drawn.size * encoder.frames <= MAX_CELLS:
        active = np.arange(encoder.drawn.size)
    return active[evenly(active.size, MAX_CELLS // encoder.frames)]


def _spent(encoder: ReplayEncoder, nodes: Columns, followed: Ints) -> Floats:
    """(nodes, frames) joules that nodes have spent by each frame. What is not logged is spread over a node's life."""
    events = encoder.run.events
    index, spent = encoder.index_of(events["node"]), np.zeros((followed.size, encoder.frames))
    row = np.searchsorted(followed, index).clip(0, max(followed.size - 1, 0))
    mine = (index >= 0) & (events["joules"] != 0.0)
    np.add.at(spent, (row[mine], encoder.frame_of(events["step"][mine])), events["joules"][mine])
    spent = np.cumsum(spent, axis=1)
    total = nodes["energy_initial"][followed] - nodes["energy_left"][followed]
    rest = np.maximum(total - spent[:, -1], 0.0)
    if rest.sum() > NOTED * total.sum():
        encoder.notes.append(
            f"of {total.sum():.4g} J that the nodes spent, the event log has no time for {rest.sum():.4g} J (idle "
            "listening, sleeping and the like); these are drawn as spent evenly over each node's life"
        )
    ends = np.full(followed.size, max(encoder.frames - 1, 1), dtype=np.float64)
    died = nodes["died_at"][followed] / encoder.run.dt / encoder.detail.stride
    ends = np.where(np.isfinite(died), np.clip(died, 1.0, ends), ends)
    return np.asarray(spent + rest[:, None] * np.minimum(np.arange(encoder.frames) / ends[:, None], 1.0))


def add_traffic(encoder: ReplayEncoder) -> None:
    """Add sensing nodes, broadcasts and links, by frame."""
    events, kind = encoder.run.events, encoder.run.events["kind"]
    frame, node = encoder.frame_of(events["step"]), encoder.index_of(events["node"])
    peer = encoder.index_of(events["peer"])
    sensing = (kind == KIND["sense"]) & (node >= 0)
    senses = np.unique(frame[sensing] << 32 | node[sensing])
    encoder.add("sense", senses >> 32, node=(senses & 0xFFFFFFFF).astype("<u4"))
    sent = np.isin(kind, [KIND["send"], KIND["relay"]])
    broadcast = sent & (events["peer"] < 0) & (node >= 0)
    messages = events["what"][broadcast].astype(np.uint8)
    encoder.add("broadcast", frame[broadcast], node=node[broadcast].astype("<u4"), message=messages)
    received, collided = (kind == KIND["receive"]), (kind == KIND["collide"])
    lost = sent & (events["peer"] >= 0) & ~np.isin(events["frame"], events["frame"][received])
    links = (received | lost | collided) & (node >= 0) & (peer >= 0)
    origin, destination = np.where(lost, node, peer)[links], np.where(lost, peer, node)[links]
    message_and_loss = events["what"][links].astype(np.int64) * 2 + ~received[links]
    count = encoder.drawn.size
    _add_links(encoder, np.unique(((frame[links] * count + origin) * count + destination) * 512 + message_and_loss))


def _add_links(encoder: ReplayEncoder, keys: Ints) -> None:
    """Add links given as one number each: frame, origin, destination, message, and whether the MAC frame was lost."""
    count = max(encoder.drawn.size, 1)
    pairs, message_and_loss = np.divmod(keys, 512)
    rest, destination = np.divmod(pairs, count)
    frame, origin = np.divmod(rest, count)
    kept = thinned(frame, encoder.detail.links)
    if not kept.all():
        encoder.add_total("link", frame)
        encoder.notes.append(f"at most {encoder.detail.links} links in use are drawn at a time")
    message, lost = np.divmod(message_and_loss[kept], 2)
    encoder.add(
        "link",
        frame[kept],
        origin=origin[kept].astype("<u4"),
        destination=destination[kept].astype("<u4"),
        message=message.astype("u1"),
        lost=lost.astype("u1"),
    )
