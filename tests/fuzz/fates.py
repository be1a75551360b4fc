"""The fate of every packet that a MAC was given, at every node that it was meant for: one, found in the event log.

    packets_in_are_packets_out_and_lost(run) -> sentences
    fates(run) -> Counter of packets by fate        their sum is that of the packets given

A packet was received, or it was lost for a reason of `LOST`, or it was on its way when the run ended.
"""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from tests.fuzz import radios_on
from tests.fuzz.given_frames import Attempt, Given
from wsnsim.base.frames import EVERYONE
from wsnsim.base.tables import EVENT_CAUSE, KIND

if TYPE_CHECKING:
    from tests.fuzz.properties import Run

RECEIVED, ON_ITS_WAY = "received", "on its way"
LOST: Final = {
    "collided": "another frame was heard meanwhile",
    "dropped": "the link or a fault lost it, or its destination slept, was down, or died of it",
    "link": "the link lost some packets of a burst, or all over a link that nobody counts on",
    "down": "a neighbour was down",
    "asleep": "a neighbour did not listen from beginning to end",
    "sender fell": "the sender died or crashed before the end",
    "off": "the radio of a neighbour was off, or on another channel",
    "no answer": "its destination answered none of the strobes",
    "never sent": "the channel stayed busy, or the sender did not know its slot, or sent elsewhere in it",
}
"""Why packets are lost, as the event log has it."""
INSTANT: Final = 1e-9
"""Seconds by which times of the same instant may differ."""


class Log:
    """The events of a run, by what is asked of them."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.frames = run.frames
        self.arrivals: dict[tuple[int, int], list[tuple[str, int]]] = defaultdict(list)
        self.unsent: set[tuple[int, int]] = set()
        self._down: dict[int, list[tuple[float, float]]] = defaultdict(list)
        names = ("time", "node", "frame", "sequence", "packets", "cause")
        kinds = {KIND[kind]: kind for kind in ("receive", "collide", "drop", "crash", "death", "restart")}
        chosen = run.rows(*kinds.values())
        columns = (run.events[name][chosen].tolist() for name in (*names, "kind"))
        for time, node, frame, sequence, packets, cause, code in zip(*columns, strict=True):
            kind = kinds[code]
            if kind == "drop" and cause == EVENT_CAUSE["overhear"]:
                continue  # a node died while it overheard a frame for another one
            if kind in ("crash", "death"):
                self._down[node].append((time, np.inf))
            elif kind == "restart":
                self._down[node] = [(begin, min(end, time)) for begin, end in self._down[node]]
            elif frame:
                self.arrivals[frame, node].append((kind, packets))
            else:
                self.unsent.add((node, sequence))

    def fell(self, node: int, since: float, until: float) -> bool:
        """Whether a node was down at some time from `since` to `until`."""
        return any(begin <= until + INSTANT and end >= since - INSTANT for begin, end in self._down[node])

    def fate(self, given: Given, node: int) -> Counter[str]:
        """The packets of a frame at one of its receivers, by their fate; '' for those without one."""
        rows = list(itertools.chain.from_iterable(self.arrivals[a.number, node] for a in given.attempts))
        got = max((packets for kind, packets in rows if kind == "receive"), default=0)
        if got:
            return Counter({RECEIVED: got, "link": given.packets - got})
        return Counter({self._why_lost(given, node, {kind for kind, _ in rows}): given.packets})

    def _why_lost(self, given: Given, node: int, kinds: set[str]) -> str:
        if given.reported is None and (not given.attempts or given.to != EVERYONE or not given.attempts[-1].ended):
            return ON_ITS_WAY
        if kinds:
            return "collided" if "collide" in kinds else "dropped"
        if (given.source, given.sequence) in self.unsent and not given.attempts:
            return "never sent"
        if given.strobes and not given.attempts and not self.fell(given.source, given.since, self.frames.now):
            return "no answer"
        until = given.attempts[-1].ends if given.attempts else self.frames.now
        sent = bool(given.attempts) and given.attempts[-1].ended  # else the sender may have fallen before it began
        if self.fell(given.source, given.attempts[-1].decided if sent else given.since, until):
            return "sender fell"
        return self._why_not_heard(given, given.attempts[-1], node) if given.attempts and given.to == EVERYONE else ""

    def _why_not_heard(self, given: Given, attempt: Attempt, node: int) -> str:
        begin, end = (attempt.ends if self.frames.ideal else attempt.start) - INSTANT, attempt.ends + INSTANT
        if self.fell(node, begin, end):
            return "down"
        radios = self.run.radios  # one that was on for exactly the time of a frame may have missed its beginning or end
        if radios.on_channels or not any(
            radios.was_held(node, each.number, -radios_on.INSTANT) for each in given.attempts
        ):
            return "off"
        if not self.run.listening.throughout(node, begin, end):
            return "asleep"
        return "" if given.is_usable(node) else "link"


def fates(run: Run) -> Counter[str]:
    """The packets of the run by their fate, one for each node that they were meant for."""
    log, found = Log(run), Counter[str]()
    for given in run.frames.given:
        for node in given.receivers:
            found += log.fate(given, node)
    return found


def packets_in_are_packets_out_and_lost(run: Run) -> Iterator[str]:
    """Every packet has one fate in the event log, which is what the MAC says; counters count the same."""
    log, total, seen = Log(run), 0, Counter[str]()
    for given in run.frames.given:
        for node in given.receivers:
            fate = log.fate(given, node)
            total += given.packets
            seen += fate
            yield from _wrong(given, node, fate, log)
    if total != seen.total():
        yield f"{total} packets in, {seen.total()} have a fate"
    yield from _wrong_counters(run, log)
    yield from _not_meant(run, log)
    yield from _overtaken(run, log)


def _wrong(given: Given, node: int, fate: Counter[str], log: Log) -> Iterator[str]:
    what = f"a frame of {given.packets} packets from node {given.source} to {node}, given at {given.since!r} s"
    if fate[""]:
        yield f"{what}: lost without a reason"
    if given.reported is not None and given.reported.get(node, 0) != fate[RECEIVED]:
        yield f"{what}: the MAC says that {given.reported.get(node, 0)} packets arrived, the events {fate[RECEIVED]}"
    for attempt in given.attempts:
        rows = log.arrivals[attempt.number, node]
        fell = partial(log.fell, given.source, attempt.decided, attempt.ends)
        if len(rows) > 1:
            yield f"{what}: frame {attempt.number} has {len(rows)} results: {rows}"
        if not rows and attempt.ended and given.to != EVERYONE and not fell():
            yield f"{what}: frame {attempt.number} has no result"


def _wrong_counters(run: Run, log: Log) -> Iterator[str]:
    """The counters of the run are those of its frames: sent, delivered, collided."""
    counted = Counter[str]()
    if any(attempt.is_copy for given in run.frames.given for attempt in given.attempts):
        return  # copies of a frame are counted together, but have a result each
    for given in run.frames.given:
        if not given.packets:
            continue  # what a MAC sends for itself
        ended = [attempt for attempt in given.attempts if attempt.ended]
        counted["frames_sent"] += len(ended)
        counted["packets_sent"] += len(ended) * given.packets
        nodes = [node for node in given.receivers if given.to != EVERYONE or given.is_usable(node)]
        for attempt, node in itertools.product(ended, nodes):
            for kind, packets in log.arrivals[attempt.number, node]:
                counted["delivered"] += kind == "receive" and packets == given.packets
                counted["collided"] += kind == "collide"
    for name, number in counted.items():
        if run.summary.run[name] != number:
            yield f"the run's {name} is {run.summary.run[name]}, that of its frames {number}"


def _not_meant(run: Run, log: Log) -> Iterator[str]:
    """Nobody has the result of a frame that was not meant for it."""
    meant = {attempt.number: attempt.receivers for given in run.frames.given for attempt in given.attempts}
    for (number, node), rows in log.arrivals.items():
        if rows and number in meant and node not in meant[number]:
            yield f"frame {number} has the result {rows[0][0]!r} at node {node}, for which it was not meant"


def _overtaken(run: Run, log: Log) -> Iterator[str]:
    """With CSMA/CA a node sends frames in turn: none stays on its way after a later one, or after the node fell."""
    if getattr(run.setup.mac, "mechanism", "") != "csma":
        return
    waits: dict[int, Given] = {}
    for given in run.frames.given:
        if given.reported is None:
            waits.setdefault(given.source, given)
            if log.fell(given.source, given.since + INSTANT, run.frames.now):
                yield f"a frame of node {given.source}, given at {given.since!r} s, is on its way, and the node fell"
        elif given.source in waits and not log.fell(given.source, given.since, given.since):
            yield f"a frame that node {given.source} was given at {given.since!r} s overtook an earlier one"
