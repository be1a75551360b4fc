"""Whose readings counted in a recorded run, from its tables `estimates`, `clusters` and `events`.

    Recorded(path).heard(replicate, target, readings) -> Heard

`active`: those of the members that sensed, as many as `estimates.active` says. `arrived`: those that the head had when
it worked out the estimate. Where more readings than these entered the computation, as `estimates.readings` tells, it
was done on the members themselves, and those of all active members count; or, at a start anew, of all that sensed. So
what counts is never less than what the tracker used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from wsnsim import recording
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.base.tables import KIND
from wsnsim.bounds.information import Heard

Table = dict[str, np.ndarray]
ALWAYS = ("replicate", "target")


class Recorded:
    """The tables of a result that say whose readings counted."""

    def __init__(self, path: str | Path, problem: TrackingSetup) -> None:
        self._standing = isinstance(problem, NetworkSetup) and not (problem.clusters.is_open or problem.clusters.moves)
        self._estimates = recording.read_table(
            path, "estimates", [*ALWAYS, "step", "time", "issued", "head", "active", "readings"]
        )
        self._clusters = recording.read_table(path, "clusters", [*ALWAYS, "formed", "released", "head"])
        events = recording.read_table(path, "events", [*ALWAYS, "time", "step", "node", "peer", "kind", "what"])
        words = recording.meanings(path, "events", "what")
        reading = words.index("reading") if "reading" in words else -1
        self._sensed = _rows(events, events["kind"] == KIND["sense"])
        self._joined = _rows(events, events["kind"] == KIND["join"])
        self._received = _rows(events, (events["kind"] == KIND["receive"]) & (events["what"] == reading))

    def heard(self, replicate: int, target: int, readings: str) -> Heard:
        """Whose readings count at each step: of the `active` members, or those that `arrived`."""
        estimates, clusters, sensed, joined, received = (
            _rows(table, (table["replicate"] == replicate) & (table["target"] == target))
            for table in (self._estimates, self._clusters, self._sensed, self._joined, self._received)
        )
        sensing = _grouped(sensed["step"], sensed["node"])
        active = self._active(estimates, clusters, joined, sensing)
        if readings == "active":
            return _paired(active)
        arrived = _arrived(estimates, received, sensing)
        counts = dict(zip(estimates["step"].tolist(), estimates["readings"].tolist(), strict=True))
        nobody: frozenset[int] = frozenset()
        return _paired({
            step: next((some for some in (arrived.get(step, nobody), active.get(step, nobody)) if len(some) >= count),
                       sensing.get(step, nobody))
            for step, count in counts.items() if count
        })  # fmt: skip

    def _active(
        self, estimates: Table, clusters: Table, joined: Table, sensing: dict[int, frozenset[int]]
    ) -> dict[int, frozenset[int]]:
        """Who sensed at each step of those in the cluster that led then."""
        if not self._standing:
            return sensing
        members = _members(clusters, joined)
        result = {}
        for step, head, begin, end in _led(estimates):
            led = (clusters["head"] == head) & (clusters["formed"] <= end) & ~(clusters["released"] < begin)
            if led.any():
                result[step] = sensing.get(step, frozenset()) & members[int(np.flatnonzero(led)[-1])]
        return result


def _arrived(estimates: Table, received: Table, sensing: dict[int, frozenset[int]]) -> dict[int, frozenset[int]]:
    """Whose readings the head had: its own, and those that it received from the step's instant until its estimate."""
    result = {}
    times: Floats = received["time"]
    for step, head, begin, end in _led(estimates):
        first, last = np.searchsorted(times, begin, "left"), np.searchsorted(times, end, "right")
        to_head = received["node"][first:last] == head
        own = frozenset([head]) & sensing.get(step, frozenset())
        result[step] = own | frozenset(received["peer"][first:last][to_head].tolist())
    return result


def _led(estimates: Table) -> zip[Any]:
    """(step, head, its instant, when the estimate was made) of each step; the same instant where none was."""
    end = np.where(np.isfinite(estimates["issued"]), estimates["issued"], estimates["time"])
    columns = estimates["step"], estimates["head"], estimates["time"], end
    return zip(*(values.tolist() for values in columns), strict=True)


def _members(clusters: Table, joined: Table) -> list[frozenset[int]]:
    """The head of each cluster, and who joined it between the cluster before and its own beginning."""
    result, since = [], -np.inf
    for head, formed in zip(clusters["head"].tolist(), clusters["formed"].tolist(), strict=True):
        mine = (joined["peer"] == head) & (joined["time"] > since) & (joined["time"] <= formed)
        result.append(frozenset([head, *joined["node"][mine].tolist()]))
        since = formed
    return result


def _grouped(steps: Ints, nodes: Ints) -> dict[int, frozenset[int]]:
    groups: dict[int, set[int]] = {}
    for step, node in zip(steps.tolist(), nodes.tolist(), strict=True):
        groups.setdefault(step, set()).add(node)
    return {step: frozenset(some) for step, some in groups.items()}


def _paired(groups: dict[int, frozenset[int]]) -> Heard:
    pairs = sorted((step, node) for step, some in groups.items() for node in some)
    steps, nodes = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return Heard(steps, nodes)


def _rows(table: Table, chosen: Bools) -> Table:
    return {name: values[chosen] for name, values in table.items()}
