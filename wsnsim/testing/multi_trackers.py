"""The contract check of multi-target trackers: `check_multi_tracker`."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.detections import MultiTracker
from wsnsim.base.ports import KnownNodes
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.scans import Facts, Scan, ScanOutcome, TrackEstimate, TrackEvent
from wsnsim.network.clusters.groups import NUMBERS
from wsnsim.testing.isolation import demand_enough_bits, plain
from wsnsim.testing.privacy import NEAR, same
from wsnsim.testing.table import demand, demand_each, examined, run_with

MISSED: Final = 3
"""Steps of a prediction without scans."""


class PlayedRun(NamedTuple):
    """What a tracker gave at a step, and the belief."""

    estimates: tuple[TrackEstimate, ...]
    events: tuple[TrackEvent, ...]
    explained: tuple[Floats, ...]
    belief: Any


class _Recorded:
    """Passes on to a tracker in a network, and keeps what its steps are given: time, scans and nodes."""

    def __init__(self, tracker: MultiTracker) -> None:
        self.tracker = tracker
        self.steps: list[tuple[float, tuple[Scan, ...], KnownNodes]] = []
        self.facts: Facts
        self.priors: tuple[Estimate, ...] = ()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.tracker, name)

    def step(self, belief: Any, time: float, scans: Any, nodes: KnownNodes, facts: Facts, number: int) -> ScanOutcome:
        self.steps.append(copy.deepcopy((time, tuple(scans), nodes)))
        self.facts = facts
        return self.tracker.step(belief, time, scans, nodes, facts, number)

    def play(
        self, copied: Callable[[Any], Any] = lambda belief: belief, steps: Any = None, known: bool = True
    ) -> Iterator[PlayedRun]:
        """Yield what the tracker gives at each step; `known`: the targets are known at the start."""
        priors = self.priors if known else ()
        belief, number = self.tracker.begin(priors, 0.0, self.facts), len(priors)
        for time, scans, nodes in copy.deepcopy(self.steps) if steps is None else steps:
            outcome = self.tracker.step(copied(belief), time, scans, nodes, self.facts, number)
            belief, number = outcome.belief, number + sum(event.kind == "start" for event in outcome.events)
            estimates = tuple(self.tracker.estimates(belief, self.facts))
            yield PlayedRun(estimates, tuple(outcome.events), tuple(outcome.explained), belief)


def check_multi_tracker(tracker: MultiTracker, values: Mapping[str, Any] | None = None) -> None:
    """Check a multi-target tracker, with its filter and its management, against the rules of its port.

    It runs in a small network, in which two targets cross and leave, amid clutter and lost packets; the scans that
    arrived there are then given to it again.

    Args:
        tracker: An instance of the tracker.
        values: Other values of the network's scenario, such as {"sensor": {"kind": "range", "reach": 40.0}}.

    Raises:
        AssertionError: The tracker breaks a rule, which the message names. network: it runs, and its answers are those
            of its port: estimates are finite and ascend by track, covariances are symmetric and positive semidefinite,
            each detection has a probability. events: tracks come, are confirmed and go by events, new ones with the
            numbers from that given on, and none if its management starts none. repeatable: the same scans give the
            same tracks. groups apart: a group does not depend on what the tracker does for another one. values: a
            belief is a value, and no later call changes it or a scan. order: neither the order of detections nor the
            numbers of nodes matter. bits: `numbers_of` suffices for what a belief carries. split and merge: `only` and
            `joined` leave tracks as they are. missed steps: a prediction over several steps is that by single steps.
    """
    recorded = _Recorded(examined(tracker, MultiTracker))
    with demand("network"):
        truth = run_with("multi_tracker", values, {"truth": True}, tracker=recorded).table("truth")
        columns = recorded.facts.motion.columns
        starts = np.column_stack([truth[name] for name in columns])[truth["step"] == 0]
        recorded.priors = tuple(Estimate(start, np.eye(len(columns))) for start in starts)
    demand_each(CHECKS, recorded)


def _demand_same(one: Iterable[PlayedRun], other: Iterable[PlayedRun], fault: str) -> None:
    for step, (first, second) in enumerate(zip(one, other, strict=True), 1):
        assert same(first[:3], second[:3]), f"{fault} (step {step})"


def _check_events(recorded: _Recorded, known: bool = True) -> None:
    number = len(recorded.priors) if known else 0
    state = dict.fromkeys(range(number), True)
    for played in recorded.play(known=known):
        for kind, track, _ in played.events:
            if kind == "start":
                assert recorded.management.starts, "a track starts, and the management says that none does"
                assert track == number, f"a new track has the number {track}, not {number}"
                number += 1
            if kind in ("start", "confirm"):
                state[track] = kind == "confirm"
            else:
                state.pop(track, None)
        found = {track.number: track.confirmed for track in played.estimates}
        assert found == state, f"tracks, and whether they are confirmed, are {found}; by events {state}"


def _check_repeatable(recorded: _Recorded) -> None:
    fault = "the same scans give two different results, or a copy of a belief is not as good"
    _demand_same([*recorded.play()], recorded.play(copied=copy.deepcopy), fault)


def _check_apart(recorded: _Recorded) -> None:
    between = (played for played, _ in zip(recorded.play(), recorded.play(known=False), strict=True))
    _demand_same([*recorded.play()], between, "a group depends on another one, whose steps lie between")


def _check_values(recorded: _Recorded) -> None:
    steps = copy.deepcopy(recorded.steps)
    kept = [(played.belief, plain(played.belief)) for played in recorded.play(steps=steps)]
    assert all(same(before, plain(belief)) for belief, before in kept), "a later step changes an earlier belief"
    assert same(plain(steps), plain(recorded.steps)), "a scan is changed"


def _check_order(recorded: _Recorded) -> None:
    def turned(scan: Scan) -> Scan:
        return replace(scan, node=scan.node + 100, detections=scan.detections[::-1].copy())

    steps = [
        (time, tuple(map(turned, scans)), nodes._replace(ids=tuple(node + 100 for node in nodes.ids)))
        for time, scans, nodes in recorded.steps
    ]
    found = (
        played._replace(explained=tuple(np.asarray(share)[::-1].copy() for share in played.explained))
        for played in recorded.play(steps=steps)
    )
    fault = "the result depends on the order of detections in a scan, or on the numbers of nodes"
    _demand_same(recorded.play(), found, fault)


def _check_bits(recorded: _Recorded) -> None:
    known = frozenset(time for time, _, _ in recorded.steps)
    for played in recorded.play():
        packets = -(-recorded.numbers_of(played.belief) // NUMBERS)
        demand_enough_bits(Parcel(played.belief, packets, PACKET_BITS, "belief"), known)


def _check_groups(recorded: _Recorded) -> None:
    for (time, _, _), played in zip(recorded.steps, recorded.play(), strict=True):
        halves = [played.estimates[i::2] for i in (0, 1)]
        parts = [recorded.only(played.belief, {track.number for track in half}) for half in halves]
        joined = recorded.joined(parts[::-1], time, recorded.facts)
        pairs = [*zip(parts, halves, strict=True), (joined, played.estimates)]
        for belief, tracks in pairs:
            found = tuple(recorded.estimates(belief, recorded.facts))
            assert same(found, tracks), (
                f"`only` or `joined` gives {len(found)} tracks, not these {len(tracks)} as they were"
            )


def _check_missed(recorded: _Recorded) -> None:
    dt, (_, _, nodes) = recorded.facts.dt, recorded.steps[0]
    nobody = KnownNodes((), nodes.positions[:0], nodes.traits[:0])
    steps = [(step * dt, (), nobody) for step in range(1, MISSED + 1)]
    (*_, once), (*_, singly) = recorded.play(steps=steps[-1:]), recorded.play(steps=steps)
    for prior, track, other in zip(recorded.priors, once.estimates, singly.estimates, strict=True):
        away, way = np.linalg.norm(track.mean - other.mean), np.linalg.norm(other.mean - prior.mean)
        assert away <= NEAR * way, "a prediction over several steps of facts.dt is not that by single steps"


CHECKS: Final[Mapping[str, Callable[[_Recorded], None]]] = {
    "events": _check_events, "events without known targets": partial(_check_events, known=False),
    "values": _check_values, "repeatable": _check_repeatable, "groups apart": _check_apart,
    "order": _check_order, "bits": _check_bits, "split and merge": _check_groups, "missed steps": _check_missed,
}  # fmt: skip
