"""The traffic of a replay: which nodes sense, which links carry frames, which frames are lost, and who broadcasts."""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_encoding import ReplayEncoder, thinned


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
