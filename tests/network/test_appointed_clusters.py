"""Appointed clusters: what they cost, and what they do along the way and when nodes fail."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.helpers.appointed_networks import LINE, TRIANGLE, along, three
from tests.helpers.centroid_network import Centroid, Run, network_setup, passing, standing
from tests.network.ledgers import SPENT, books
from wsnsim.base.part import part
from wsnsim.base.requests import PACKET_BITS, Delivery, Gather, Parcel
from wsnsim.base.tables import CAUSE
from wsnsim.models.access import Tdma
from wsnsim.models.appointed import Appointed
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.faults import Crash

BIT, AMP = 50e-9, 100e-12


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


@pytest.mark.thorough
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


@pytest.mark.thorough
@pytest.mark.parametrize("at", np.linspace(0.0, 1.9, 12))
def test_a_track_goes_on_after_its_head_crashes_at_any_time(at):
    run = along(steps=60, faults=(Crash(at=float(at), head=0),))
    lost = [row for row in run.events("lost") if row["time"] < 2.4]
    estimates = run.memory.table("estimates")
    assert run.outcome.tracks[0].reacquired == len(lost)
    assert estimates["step"][np.isfinite(estimates["px"])].max() == 60


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
