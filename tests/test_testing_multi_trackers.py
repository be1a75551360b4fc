"""`check_multi_tracker` passes the multi-target trackers of the catalogue, and finds each kind of mistake."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

from wsnsim.base.scans import TrackEvent
from wsnsim.scenario.registry import ROLES, find, load_class
from wsnsim.testing import check_multi_tracker
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.multi_target.frames import Belief
from wsnsim.trackers.multi_target.management import KnownTargets, MOfN, SequentialTest
from wsnsim.trackers.multi_target.single_gaussian import Gnn

KINDS = [row.kind for row in ROLES["tracker"].kinds if ".multi_target." in row.path]
RANGES = {"sensor": {"kind": "range", "reach": 40.0}}


@pytest.mark.thorough(fast=["gnn-ekf-MOfN"])
@pytest.mark.parametrize("management", [MOfN, SequentialTest, KnownTargets])
@pytest.mark.parametrize("inner", ["ekf", "imm"])
@pytest.mark.parametrize("kind", KINDS)
def test_each_multi_target_tracker_of_the_catalogue_passes_the_check(kind, inner, management):
    tracker = load_class(find("tracker", kind))(filter=load_class(find("tracker", inner))(), management=management())
    check_multi_tracker(tracker)
    check_multi_tracker(tracker, RANGES)


class Wrong(Gnn):
    """A tracker of a plug-in; subclasses make one mistake each."""

    state: ClassVar[dict[str, Any]] = {}


class NotFinite(Wrong):
    def estimates(self, belief, facts):
        return [track._replace(mean=track.mean * np.nan) for track in super().estimates(belief, facts)]


class NotPositive(Wrong):
    def estimates(self, belief, facts):
        return [track._replace(cov=-track.cov) for track in super().estimates(belief, facts)]


class Descending(Wrong):
    def estimates(self, belief, facts):
        return super().estimates(belief, facts)[::-1]


class TooProbable(Wrong):
    def step(self, *given):
        outcome = super().step(*given)
        return outcome._replace(explained=tuple(share + 1.0 for share in outcome.explained))


class ForgetsScans(Wrong):
    def step(self, *given):
        outcome = super().step(*given)
        return outcome._replace(explained=outcome.explained[:1])


class FailsWithoutDetections(Wrong):
    def step(self, belief, time, scans, nodes, facts, number):
        assert not scans or min(len(scan.detections) for scan in scans) > 0, "no detections"
        return super().step(belief, time, scans, nodes, facts, number)


class UnknownEvents(Wrong):
    def step(self, *given):
        outcome = super().step(*given)
        return outcome._replace(events=(*outcome.events, TrackEvent("lost", 0)))


class CountsFromOne(Wrong):
    def step(self, belief, time, scans, nodes, facts, number):
        return super().step(belief, time, scans, nodes, facts, number + 1)


class DeletesSilently(Wrong):
    def step(self, *given):
        outcome = super().step(*given)
        return outcome._replace(events=tuple(event for event in outcome.events if event.kind != "delete"))


class ConfirmsSilently(Wrong):
    def step(self, *given):
        outcome = super().step(*given)
        return outcome._replace(events=tuple(event for event in outcome.events if event.kind != "confirm"))


class StartsInSpite(Wrong):
    def step(self, *given):
        return Gnn(filter=self.filter).step(*given)


class Random(Wrong):
    def estimates(self, belief, facts):
        noise = self.state.setdefault("rng", np.random.default_rng(1)).standard_normal()
        return [track._replace(mean=track.mean + noise) for track in super().estimates(belief, facts)]


class KnowsItsBeliefs(Wrong):
    """Takes a belief for that of another tracker if it did not make the object."""

    def begin(self, *given):
        self.state["last"] = super().begin(*given)
        return self.state["last"]

    def step(self, belief, time, scans, *given):
        mine = belief is self.state["last"]
        outcome = super().step(belief, time, scans, *given)
        self.state["last"] = outcome.belief
        return outcome if mine else outcome._replace(explained=tuple(0.0 * share for share in outcome.explained))


class OneGroup(Wrong):
    """Keeps what it believes, as if it led one group alone."""

    def begin(self, *given):
        self.state["belief"] = super().begin(*given)
        return self.state["belief"]

    def step(self, belief, *given):
        outcome = super().step(self.state["belief"], *given)
        self.state["belief"] = outcome.belief
        return outcome


class ChangesBeliefs(Wrong):
    def step(self, belief, *given):
        outcome = super().step(belief, *given)
        for track in belief.tracks:
            track.bank.means[...] += 1.0
        return outcome


class ChangesScans(Wrong):
    def step(self, belief, time, scans, *given):
        outcome = super().step(belief, time, scans, *given)
        for scan in scans:
            scan.detections[...] = np.sort(scan.detections, axis=0)[::-1]
        return outcome


class TakesTheFirst(Wrong):
    def step(self, belief, time, scans, *given):
        outcome = super().step(belief, time, [replace(scan, detections=scan.detections[:1]) for scan in scans], *given)
        explained = (np.resize(np.append(share, 0.0), len(scan.detections)) for share, scan in zip(
            outcome.explained, scans, strict=True))  # fmt: skip
        return outcome._replace(explained=tuple(explained))


class DependsOnNumbers(Wrong):
    def step(self, belief, time, scans, *given):
        heard = [scan if scan.node > 99 else replace(scan, detections=scan.detections + 1e-3) for scan in scans]
        return super().step(belief, time, heard, *given)


class SendsForFree(Wrong):
    def numbers_of(self, belief):
        return min(1, len(belief.tracks))


class KeepsAll(Wrong):
    def only(self, belief, numbers):
        return belief


class JoinsTheFirst(Wrong):
    def joined(self, beliefs, time, facts):
        return beliefs[0]


class OneStep(Wrong):
    def step(self, belief, time, scans, nodes, facts, number):
        late = Belief(max(belief.time, time - facts.dt), belief.tracks)
        return super().step(late, time, scans, nodes, facts, number)


FOUND = {
    NotFinite: "network.*the mean is not finite",
    NotPositive: "network.*the covariance is not",
    Descending: "network.*tracks ascend by number",
    TooProbable: "network.*explained: expected probabilities",
    ForgetsScans: "network.*explained: expected an array for each of",
    FailsWithoutDetections: "network.*no detections",
    UnknownEvents: "network.*expected a TrackEvent whose kind is start, confirm, delete, merge",
    CountsFromOne: "events without known targets.*a new track has the number",
    DeletesSilently: "events.*by events",
    ConfirmsSilently: "events without known targets.*by events",
    StartsInSpite: "events.*the management says that none does",
    Random: "repeatable.*two different results",
    KnowsItsBeliefs: "repeatable.*a copy of a belief",
    OneGroup: "groups apart.*depends on another one",
    ChangesBeliefs: "values.*changes an earlier belief",
    ChangesScans: "values.*a scan is changed",
    TakesTheFirst: "order.*order of detections",
    DependsOnNumbers: "order.*numbers of nodes",
    SendsForFree: "bits.*declares",
    KeepsAll: "split and merge.*`only`",
    JoinsTheFirst: "split and merge.*`joined`",
    OneStep: "missed steps.*not that by single steps",
}


@pytest.mark.parametrize("kind", FOUND)
def test_each_mistake_is_found_and_named(kind, monkeypatch):
    monkeypatch.setattr(Wrong, "state", {})
    management = KnownTargets() if kind is StartsInSpite else MOfN()
    with pytest.raises(AssertionError, match=re.compile(f"demand '{FOUND[kind]}", re.DOTALL)):
        check_multi_tracker(kind(filter=ExtendedKalman(), management=management))


def test_every_mistake_is_listed():
    assert set(FOUND) == set(Wrong.__subclasses__())
