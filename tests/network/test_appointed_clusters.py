"""Appointed clusters: what they cost, who belongs to them, and what they do when nodes fail, sleep or hear nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wsnsim
from tests.helpers.centroid_network import Centroid, Run, network_setup, passing, standing
from tests.helpers.sleeping_networks import Run as SleepingRun
from tests.helpers.sleeping_networks import scenario
from tests.network.ledgers import SPENT, books
from wsnsim.base.outlook import Appointment
from wsnsim.base.part import part
from wsnsim.base.requests import PACKET_BITS, Delivery, Gather, Parcel
from wsnsim.base.tables import CAUSE, Memory
from wsnsim.bounds import bound_of_run
from wsnsim.models.access import Csma, Tdma
from wsnsim.models.appointed import Appointed
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.faults import Crash
from wsnsim.models.links import Disk, LogNormal
from wsnsim.network.clusters.head_messages import HeadMessages

BIT, AMP = 50e-9, 100e-12
TRIANGLE = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0), (150.0, 150.0)]
LINE = [(20.0 * i, 5.0 * (-1) ** i) for i in range(20)]
HERE = "tests.network.test_appointed_clusters"


def three(**changes: Any) -> Run:
    """Nodes 0, 1, 2 sense a target at rest at (5, 5); node 3 is out of range of all others."""
    steps = changes.pop("steps", 4)
    changes = {"energy": FirstOrder(battery=2.0), "clusters": Appointed(), **changes}
    return Run(network_setup(steps=steps, **changes), TRIANGLE, [standing((5.0, 5.0), steps)])


def along(**changes: Any) -> Run:
    """A target that passes twenty nodes in a line, at 60 m/s."""
    changes = {"steps": 100, "clusters": Appointed(), "energy": FirstOrder(battery=2.0), **changes}
    return Run(network_setup(**changes), LINE, [passing((0.0, 0.0), (60.0, 0.0), changes["steps"])])


class Announcing(Centroid):
    """Knows where the target is; announces its belief, in three packets of 64 bits."""

    def __init__(self) -> None:
        super().__init__()
        self.scenes_announced: list[Any] = []
        self.heard: list[tuple[int, int, Delivery]] = []

    def announcement(self, belief: Any, scene: Any) -> Parcel:
        self.scenes_announced.append(scene)
        return Parcel(belief.copy(), 3, 64, "plan")

    def step(self, belief: Any, scene: Any) -> Any:
        def listening(member: Any) -> Parcel:
            self.heard += [(scene.step, member.id, delivery) for delivery in member.take_inbox()]
            return Parcel(member.reading, 1, PACKET_BITS, "reading")

        self.scenes.append(scene)
        yield Gather(listening)
        return np.array([60.0 * scene.time, 60.0, 0.0, 0.0])


def test_the_energy_of_an_appointed_cluster_is_what_a_hand_count_gives():
    run = three()
    bits, distances = 96, {1: 30.0, 2: 40.0}
    # Three strengths and one announcement of two packets at reach, heard by the two others each; two readings a step.
    packets, unicasts = 3 + 2, [distances[1], distances[2]] * 4
    totals = run.outcome.nodes.ledger.totals
    assert totals[CAUSE["tx_electronics"]] == pytest.approx((packets + len(unicasts)) * bits * BIT, rel=1e-12)
    amplifier = bits * AMP * (packets * 75.0**2 + sum(d**2 for d in unicasts))
    assert totals[CAUSE["tx_amplifier"]] == pytest.approx(amplifier, rel=1e-12)
    assert totals[CAUSE["rx"]] == pytest.approx((packets * 2 + len(unicasts)) * bits * BIT, rel=1e-12)
    assert 3 not in books(run.outcome.nodes)
    assert not run.events("send", "join")
    assert [row["node"] for row in run.events("join")] == [1, 2], "they joined, without a packet"


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


def test_the_head_hands_over_along_the_way_and_every_step_has_an_estimate_from_nearly_all_in_range():
    run = along()
    track = run.outcome.tracks[0]
    assert track.handovers >= 4
    assert [cluster.previous_head for cluster in track.clusters] == [-1, *(c.head for c in track.clusters[:-1])]
    table = run.memory.table("estimates")
    assert table["step"].tolist() == list(range(1, 101))
    assert np.array_equal(table["issued"], table["time"])
    counts = [sum(np.hypot(*(np.array(place) - truth[[0, 2]])) <= 60.0 for place in LINE) for truth in run.truths[0]]
    assert (table["readings"] <= counts[1:]).all()
    assert table["readings"].sum() >= 0.85 * sum(counts[1:])
    for book in books(run.outcome.nodes).values():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9)


def test_a_successor_appoints_in_the_step_in_which_the_belief_arrives():
    run = along()
    handovers = {row["step"] for row in run.events("handover")}
    announced = [row["step"] for row in run.events("announce")]
    assert handovers and handovers <= set(announced)
    formed = [round(cluster.formed / 0.04) for cluster in run.outcome.tracks[0].clusters]
    assert formed[1:] == sorted(handovers)


def test_what_a_tracker_announces_is_billed_and_lands_in_the_inboxes_of_the_new_members():
    tracker = Announcing()
    run = along(tracker=tracker)
    track, packets = run.outcome.tracks[0], [int(row["packets"]) for row in run.events("send", "announce")]
    assert packets[0] == 2, "a track that starts has no belief to announce"
    assert set(packets[1:]) == {5}
    assert {row["bits"] // row["packets"] for row in run.events("send", "announce")} == {96}
    assert len(tracker.scenes_announced) == len(packets) - 1 >= track.handovers
    joined = {(row["step"], row["node"]) for row in run.events("join")}
    assert {delivery.what for _, _, delivery in tracker.heard} == {"plan"}
    assert all(delivery.mask.tolist() == [True] * 3 for _, _, delivery in tracker.heard)
    later = {(step, node) for step, node in joined if step > 0}
    heard = {node for _, node, _ in tracker.heard}
    assert {node for _, node in later} >= heard and len(heard) > 10
    heads = {cluster.head for cluster in track.clusters}
    for step, node, delivery in tracker.heard:
        first = min(s for s, n in joined if n == node)
        assert step > first, "a member hears the announcement before it is first asked"
        assert delivery.payload.shape == (4,) and (node not in heads or step > 0)


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


@pytest.mark.parametrize("at", np.linspace(0.0, 1.9, 12))
def test_a_track_goes_on_after_its_head_crashes_at_any_time(at):
    run = along(steps=60, faults=(Crash(at=float(at), head=0),))
    lost = [row for row in run.events("lost") if row["time"] < 2.4]
    estimates = run.memory.table("estimates")
    assert run.outcome.tracks[0].reacquired == len(lost)
    assert estimates["step"][np.isfinite(estimates["px"])].max() == 60


def test_members_that_crash_leave_the_roster_and_come_back_only_when_they_are_appointed_again():
    tracker = Centroid()
    three(tracker=tracker, steps=8, faults=(Crash(at=0.1, nodes=(1,), duration=0.1),))
    rosters = [set(scene.roster) for scene in tracker.scenes]
    assert rosters[:2] == [{0, 1, 2}] * 2 and rosters[2] == {0, 2}
    assert all(1 not in answer for answer in tracker.answers[2:]), "it does not know any more that it is a member"


def test_a_head_that_runs_out_of_energy_is_replaced():
    run = along(energy=FirstOrder(battery=1.5e-3))
    died = {row["node"] for row in run.events("death")}
    heads = [cluster.head for cluster in run.outcome.tracks[0].clusters]
    assert died & set(heads)
    for book in books(run.outcome.nodes).values():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9)


def test_a_successor_that_is_dead_when_the_belief_arrives_ends_the_track_and_another_head_takes_over():
    class Slow(Centroid):
        def hand_over(self, belief: Any, scene: Any, successor: int) -> Any:
            run_of.append(successor)
            return (yield from super().hand_over(belief, scene, successor))

    run_of: list[int] = []
    along(tracker=Slow())
    first = run_of[0]
    run = along(tracker=Slow(), faults=(Crash(at=0.0, nodes=(first,)),))
    assert first not in {cluster.head for cluster in run.outcome.tracks[0].clusters}
    assert run.memory.table("estimates")["step"].tolist() == list(range(1, 101))


def test_a_target_that_is_nowhere_sensed_is_lost_after_the_patience():
    truth = np.concatenate([standing((5.0, 5.0), 9), standing((900.0, 900.0), 40)])
    run = Run(network_setup(steps=50, clusters=Appointed(patience=1.0)), TRIANGLE, [truth])
    lost = [(round(row["time"], 9), run.memory.words.all()[row["what"]]) for row in run.events("lost")]
    assert lost == [(1.4, "no_readings")], "sensed at 0.36 s last: at 1.36 s the patience is not exceeded yet"


def test_the_members_on_record_are_those_that_counted(tmp_path):
    scene = ["duration=3 s", "tracker.kind=ekf", "clusters={kind: appointed}"]
    outcome = wsnsim.run(wsnsim.load("jiang_field", scene), out=tmp_path / "a.h5")
    found = wsnsim.read(tmp_path / "a.h5", "estimates")
    every, active = (bound_of_run(tmp_path / "a.h5", which).each for which in ("in_range", "active"))
    assert outcome is not None and np.isfinite(active).all()
    assert (active >= every - 1e-12).all() and active.mean() < 1.05 * every.mean()
    assert (found["readings"] == found["active"]).all()


def test_heads_and_members_go_by_the_assumed_positions():
    made = ["duration=2 s", "tracker.kind=ekf", "clusters={kind: appointed}", "deploy.position_error=3 m"]
    memory = Memory(dict.fromkeys(("events", "nodes", "estimates", "clusters"), True))
    wsnsim.simulate(wsnsim.load("jiang_field", made), 0, memory)
    assert memory.table("estimates")["step"].size == 50 and memory.table("clusters")["head"].size > 1


@part
class Geometric(StrongestSignal):
    """A standing cluster whose policy sees the geometry: members join, expected information decides on handovers."""

    def must_appoint(self, outlook: Any) -> bool:
        return Appointed().must_appoint(outlook)

    def next_head(self, outlook: Any) -> int | None:
        return Appointed().next_head(outlook)


def test_a_standing_cluster_hands_over_by_the_geometry_if_its_policy_sees_it():
    runs = {name: along(clusters=policy) for name, policy in (("seen", Geometric()), ("counted", StrongestSignal()))}
    readings = {name: run.memory.table("estimates")["readings"].sum() for name, run in runs.items()}
    assert readings["seen"] > 1.1 * readings["counted"]
    assert runs["seen"].events("send", "join"), "members join as before"


def test_the_head_wakes_nodes_before_its_first_step_and_those_woken_are_members():
    said = scenario("gmtt", clusters={"kind": "appointed"}, duration=30.0) | {"tracker": {"kind": "ekf"}}
    run = SleepingRun(said)
    rounds, estimates = run.table("wakeups"), run.table("estimates")
    started = [row["step"] for row in run.events("elect")]
    assert started and started[0] + 1 in rounds["step"].tolist()
    joined = {(row["step"], row["node"]) for row in run.events("join")}
    assert any(step > started[0] for step, _ in joined)
    assert estimates["readings"].max() >= 5
    run.books()


def test_a_track_that_starts_from_too_few_readings_starts_again_from_those_of_the_nodes_that_were_woken():
    asleep = {"kind": "ris", "period": 10.0, "probability": 0.03}
    said = scenario("gmtt", clusters={"kind": "appointed"}, sleep=asleep, duration=100.0)
    run = SleepingRun(said | {"tracker": {"kind": "ekf"}}, 1)
    estimates, restarts = run.table("estimates"), run.events("elect")
    assert restarts
    first = restarts[0]["step"]
    few = estimates["readings"][estimates["step"] == first]
    assert few.size == 0 or few[0] < 3
    after = estimates["error"][(estimates["step"] > first) & (estimates["step"] <= first + 3)]
    assert np.nanmin(after) < 10.0


def test_no_message_wakes_a_region_in_which_everybody_is_a_member_already():
    said = scenario("gmtt", clusters={"kind": "appointed"}, duration=60.0, step=0.5) | {"tracker": {"kind": "ekf"}}
    run = SleepingRun(said | {"acquire": {}})
    rounds, estimates = run.table("wakeups")["step"], run.table("estimates")
    tracked = np.isfinite(estimates["error"])
    assert tracked.sum() > 100
    assert 3 < np.unique(rounds).size < 0.5 * tracked.sum()
    assert np.nanmedian(estimates["readings"]) >= 6, "members stay awake, as long as the cluster is theirs"
    run.books()


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


def test_all_members_of_a_cluster_have_slots_by_one_schedule():
    run = along(mac=Tdma(), steps=60)
    clusters, schedules = run.outcome.tracks[0].clusters, run.events("send", "schedule")
    assert len(clusters) > 2
    assert len(schedules) == len(clusters), "members that begin to sense later have their slots already"
    assert run.memory.table("estimates")["late"].sum() <= 2


def test_heads_of_two_targets_appoint_for_themselves():
    made = network_setup(steps=30, clusters=Appointed(), motions=network_setup().motions * 2)
    truths = [passing((0.0, 0.0), (60.0, 0.0), 30), passing((300.0, 0.0), (-60.0, 0.0), 30)]
    run = Run(made, LINE, truths)
    table = run.memory.table("estimates")
    assert [int((table["target"] == target).sum()) for target in (0, 1)] == [30, 30]
    assert all(track.handovers for track in run.outcome.tracks)


def test_the_appointment_of_a_target_on_a_line_covers_an_interval():
    line = SimpleNamespace(position=(0,), advance=lambda states, dt, time: states)
    rule = Appointment(np.array([5.0, 0.0]), 0.0, 1.0, 3, 10.0)
    assert rule.covers(np.array([[15.0, 0.0], [15.1, 0.0], [5.0, 10.0]]), line).tolist() == [True, False, True]
