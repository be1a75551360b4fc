"""Who belongs to appointed clusters, and what their heads know of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wsnsim
from tests.helpers.appointed_networks import TRIANGLE, along, three
from tests.helpers.centroid_network import Centroid, Run, network_setup, standing
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.network_ports import Appointment
from wsnsim.base.part import part
from wsnsim.base.tables import KIND, Memory
from wsnsim.bounds import bound_of_run
from wsnsim.models.access import Csma
from wsnsim.models.appointed import Appointed
from wsnsim.models.faults import Crash
from wsnsim.models.links import Disk, LogNormal
from wsnsim.network.clusters.cluster import AppointedCluster
from wsnsim.network.clusters.head_services import HeadMessages


def test_nodes_that_do_not_sense_are_members_too_and_no_others_wake_for_it():
    places = [*TRIANGLE[:3], (65.0, 0.0), (-74.0, 0.0)]
    run = Run(network_setup(steps=4, clusters=Appointed()), places, [standing((5.0, 5.0), 4)])
    scene = run.setup.tracker.scenes[0]
    assert scene.roster == (0, 1, 2, 3), (
        "60 m, 5 m and twice 5 m around (5, 5): node 3 is 60.2 m away, node 4 is 79.2 m"
    )
    assert scene.ids == (0, 1, 2)
    assert scene.roster_positions.tolist() == [list(place) for place in places[:4]]
    assert [row["node"] for row in run.events("join")] == [1, 2, 3]
    assert {row["node"] for row in run.events("wake")} == {0, 1, 2}, "node 3 rests until a target is in range"


def test_with_a_lossy_link_those_that_heard_nothing_are_on_the_roster_and_never_answer():
    tracker = Centroid()
    run = along(tracker=tracker, link=Disk(reach=75.0, loss=0.4))
    silent = set()
    for scene, answer in zip(tracker.scenes, tracker.answers, strict=True):
        members = {scene.head} | {row["node"] for row in run.events("join") if row["peer"] == scene.head}
        assert set(scene.ids) <= set(scene.roster)
        assert set(answer) <= members
        silent |= set(scene.roster) - members
        assert len(scene.roster_positions) == len(scene.roster_traits) == len(scene.roster)
    assert silent


def test_an_announcement_that_nobody_hears_leaves_the_head_alone():
    tracker = Centroid()
    run = three(tracker=tracker, link=Disk(reach=75.0, loss=0.999999))
    assert run.outcome.tracks[0].clusters[0].members == 1
    assert all(set(answer) <= {scene.head} for scene, answer in zip(tracker.scenes, tracker.answers, strict=True))
    assert run.memory.table("estimates")["step"].tolist() == [1, 2, 3, 4]


@part
class Nobody(Appointed):
    """Appoints nobody, and always takes its cluster for too small."""

    def appointment(self, outlook: Any) -> Appointment:
        return replace(super().appointment(outlook), radius=0.0)

    def must_appoint(self, outlook: Any) -> bool:
        return True

    def next_head(self, outlook: Any) -> int | None:
        return outlook.head


def test_a_head_that_appoints_nobody_tracks_alone_and_announces_once():
    run = three(clusters=Nobody())
    assert run.memory.table("estimates")["readings"].tolist() == [1, 1, 1, 1]
    assert len(run.events("announce")) == 1, "a rule that appoints nobody else is not announced again"


def test_members_that_crash_leave_the_roster_and_come_back_only_when_they_are_appointed_again():
    tracker = Centroid()
    three(tracker=tracker, steps=8, faults=(Crash(at=0.1, nodes=(1,), duration=0.1),))
    rosters = [set(scene.roster) for scene in tracker.scenes]
    assert [set(scene.known.ids) for scene in tracker.scenes] == [{0, 1, 2}] * 8, (
        "the head does not know that it is down"
    )
    assert rosters[:2] == [{0, 1, 2}] * 2 and rosters[2] == {0, 2}
    assert all(1 not in answer for answer in tracker.answers[2:]), "it does not know any more that it is a member"


@pytest.mark.thorough
def test_the_members_on_record_are_those_that_counted(tmp_path):
    scene = ["duration=3 s", "tracker.kind=ekf", "clusters={kind: appointed}"]
    outcome = wsnsim.experiment.run(wsnsim.load("jiang_field", scene), out=tmp_path / "a.h5")
    found = wsnsim.read(tmp_path / "a.h5", "estimates")
    every, active = (bound_of_run(tmp_path / "a.h5", which).each for which in ("in_range", "active"))
    assert outcome is not None and np.isfinite(active).all()
    assert (active >= every - 1e-12).all() and active.mean() < 1.05 * every.mean()
    assert (found["readings"] == found["active"]).all()


def test_members_have_a_link_to_the_head_that_can_be_used_in_both_directions(monkeypatch):
    made = network_setup(clusters=Appointed(), link=LogNormal(asymmetry=10.0), mac=Csma(), steps=20)
    asked = []

    def linked(self, head, nodes):
        found = [node for node in nodes if self.transport.connected(node, head)]
        asked.append((set(nodes), set(found)))
        return found

    monkeypatch.setattr(HeadMessages, "linked", linked)
    run = Run(made)
    joined = {row["node"] for row in run.events("join")}
    assert joined and joined <= set().union(*(found for _, found in asked))
    assert any(found < nodes for nodes, found in asked), "some hear the head and cannot be heard"


def test_the_appointment_of_a_target_on_a_line_covers_an_interval():
    line = SimpleNamespace(position=(0,), advance=lambda states, dt, time: states)
    rule = Appointment(np.array([5.0, 0.0]), 0.0, 1.0, 3, 10.0)
    assert rule.covers(np.array([[15.0, 0.0], [15.1, 0.0], [5.0, 10.0]]), line).tolist() == [True, False, True]


@pytest.mark.thorough
def test_heads_and_members_go_by_the_assumed_positions(monkeypatch):
    made = ["duration=2 s", "tracker.kind=ekf", "clusters={kind: appointed}", "deploy.position_error=15 m"]
    setup = wsnsim.scenario.build(wsnsim.load("jiang_field", made))
    known, motion = sample_initial_conditions(setup, 0), setup.filter_motions[0]
    maps, outlooks, announced = [], [], []

    def appoint(cluster, nodes):
        maps.append((cluster.head, set(nodes)))

    def must_appoint(policy, outlook):
        outlooks.append(outlook)
        return original(policy, outlook)

    def announce(messages, target, head, appointment, payload):
        found = yield from broadcast(messages, target, head, appointment, payload)
        announced.append((messages.network.clock.step, head, appointment, set(found)))
        return found

    original, broadcast = Appointed.must_appoint, HeadMessages.announce
    monkeypatch.setattr(AppointedCluster, "appoint", appoint)
    monkeypatch.setattr(Appointed, "must_appoint", must_appoint)
    monkeypatch.setattr(HeadMessages, "announce", announce)
    memory = Memory(dict.fromkeys(("events", "nodes", "estimates", "clusters"), True))
    wsnsim.experiment.simulate_run(wsnsim.load("jiang_field", made), 0, memory)

    def expected(places, head, rule, heard):
        """The members among those that heard, and those on the head's map, were the nodes at these places."""
        covered = set(np.flatnonzero(rule.covers(places, motion)).tolist()) - {head}
        near = set(np.flatnonzero(np.hypot(*(places - places[head]).T) <= setup.link.reach).tolist())
        return covered & heard, covered & near

    events = memory.table("events")
    joins = list(zip(events["kind"], events["step"], events["peer"], events["node"], strict=True))
    members: dict[int, set[int]] = {}
    for (step, head, rule, heard), (mapped_by, mapped) in zip(announced, maps, strict=True):
        own, chart = expected(known.assumed, head, rule, heard)
        new = {node for kind, at, peer, node in joins if (kind, at, peer) == (KIND["join"], step, head)}
        assert new == own - members.setdefault(head, set()) and own
        assert (mapped_by, mapped) == (head, chart)
        assert (own, chart) != expected(known.positions, head, rule, heard)
        members[head] |= new
    assert len(announced) > 1 and len(outlooks) > 20
    for outlook in outlooks:
        near = outlook.nodes_near(outlook.place, 50.0)
        assert np.array_equal(outlook.place, known.assumed[outlook.head])
        assert np.array_equal(near.positions, known.assumed[near.ids])
        away = np.hypot(*(known.assumed - outlook.place).T)
        assert near.ids.tolist() == np.flatnonzero(away <= 50.0).tolist()


def test_a_head_does_not_know_which_of_its_members_are_down():
    seen: list[list[int]] = []

    @part
    class Watched(Appointed):
        def must_appoint(self, outlook: Any) -> bool:
            seen.append(outlook.members.tolist())
            assert outlook.nodes_near(outlook.place, 60.0).ids.tolist() == [0, 1, 2]
            return super().must_appoint(outlook)

    tracker = Centroid()
    three(tracker=tracker, clusters=Watched(), steps=6, faults=(Crash(at=0.1, nodes=(1,)),))
    scene = tracker.scenes[-1]
    assert scene.roster == (0, 2), "the roster has the living ones"
    assert scene.known.ids == (0, 2, 1) and scene.known.positions.tolist() == [list(TRIANGLE[i]) for i in (0, 2, 1)]
    assert len(scene.known.traits) == 3
    assert seen == [[0, 1, 2]] * 6


def test_a_node_that_never_answers_is_called_three_times_and_one_that_answered_no_more():
    nodes = SimpleNamespace(
        alive=[True] * 6, traits=np.ones((6, 1)), assumed=SimpleNamespace(positions=np.zeros((6, 2)))
    )
    network: Any = SimpleNamespace(tracker_key=1, nodes=nodes)
    cluster = AppointedCluster(network, 0, 5)
    assert [cluster.must_call([1, 2]) for _ in range(4)] == [True, True, True, False]
    assert cluster.must_call([1, 2, 3]), "node 3 has not been called yet"
    cluster.note_answers([3])
    assert not cluster.must_call([1, 2, 3])
    assert cluster.known == (5, 1, 2, 3)
    assert not cluster.must_call([])
    assert AppointedCluster(network, 0, 5).must_call([3]), "another cluster knows nothing of it"
