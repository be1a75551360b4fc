"""Worlds small enough to be counted by hand, and accidents in the middle of whatever a head does."""

import math

import numpy as np
import pytest

from tests.network.toys import Centroid, Run, parts, passing, standing
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.models.clusters import Central, StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk, IdealMac, MinimumHop
from wsnsim.network.fleet import SPENT

BIT = 50e-9
AMP = 100e-12
TRIANGLE = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0), (150.0, 150.0)]


def cluster_of_three(**changes):
    """Nodes 0, 1, 2 sense a target that stands at (5, 5); node 3 is far away from everything."""
    steps = changes.pop("steps", 4)
    made = parts(steps=steps, energy=changes.pop("energy", FirstOrder(battery=2.0)), **changes)
    return Run(made, TRIANGLE, [standing((5.0, 5.0), steps)])


def test_the_energy_of_a_cluster_is_what_a_hand_count_gives():
    run = cluster_of_three()
    fleet, bits = run.outcome.fleet, 96
    # Three strengths and one announcement at reach, heard by the two others each; two joins; then two readings a step.
    distances = {1: 30.0, 2: 40.0}
    broadcasts = 4
    unicasts = [distances[1], distances[2]] * (1 + 4)
    electronics = (broadcasts + len(unicasts)) * bits * BIT
    amplifier = bits * AMP * (broadcasts * 75.0**2 + sum(d**2 for d in unicasts))
    reception = (broadcasts * 2 + len(unicasts)) * bits * BIT
    assert fleet.totals[CAUSE["tx_electronics"]] == pytest.approx(electronics, rel=1e-12)
    assert fleet.totals[CAUSE["tx_amplifier"]] == pytest.approx(amplifier, rel=1e-12)
    assert fleet.totals[CAUSE["rx"]] == pytest.approx(reception, rel=1e-12)
    assert 3 not in fleet.books


def test_the_loudest_leads_the_others_join_and_everybody_is_asleep_but_those_who_sense():
    run = cluster_of_three()
    assert run.outcome.tracks[0].clusters[0].head == 0
    assert run.outcome.tracks[0].clusters[0].members == 3
    assert {row["node"] for row in run.events("wake")} == {0, 1, 2}
    assert [row["node"] for row in run.events("join")] == [1, 2]
    assert len(run.events("sense")) == 3 * 5


def test_every_step_has_an_estimate_issued_within_the_instant():
    run = cluster_of_three()
    table = run.memory.table("estimates")
    assert table["step"].tolist() == [1, 2, 3, 4]
    assert np.array_equal(table["issued"], table["time"])
    assert table["readings"].tolist() == [3, 3, 3, 3]
    assert table["late"].sum() == 0


def test_the_ledger_closes_for_every_node():
    run = Run(parts())
    for book in run.outcome.fleet.books.values():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9)


def test_the_events_alone_reproduce_the_energy_of_the_air():
    run = Run(parts())
    table = run.memory.table("events")
    sent = np.isin(table["kind"], [7, 14])
    ends = table["peer"][sent].astype(int)
    starts = table["node"][sent].astype(int)
    distance = np.where(ends < 0, 75.0, np.linalg.norm(run.positions[starts] - run.positions[ends], axis=1))
    bits = table["bits"][sent]
    assert np.allclose(table["joules"][sent], bits * BIT + bits * AMP * distance**2, rtol=1e-12)
    spent = sum(run.outcome.fleet.totals[CAUSE[cause]] for cause in ("tx_electronics", "tx_amplifier"))
    assert table["joules"][sent].sum() == pytest.approx(spent, rel=1e-9)


def test_a_handover_out_of_reach_is_relayed_and_every_hop_is_paid():
    chain = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (70.0, 0.0), (140.0, 0.0), (150.0, 0.0), (140.0, 10.0)]
    truth = standing((2.0, 2.0), 10)
    truth[5:] = [142.0, 0.0, 2.0, 0.0]
    truth[4] = [142.0, 0.0, 2.0, 0.0]
    tracker = Centroid()
    tracker.forecast = lambda belief, scene, ahead: type(tracker).estimate(tracker, np.array([141.0, 0.0, 1.0, 0.0]))
    run = Run(parts(steps=10, tracker=tracker, routing=MinimumHop()), chain, [truth])
    relays = run.events("relay")
    assert [(row["node"], row["peer"]) for row in relays] == [(3, 4)]
    sends = list(run.events("send", "belief"))
    assert [(row["node"], row["peer"]) for row in sends] == [(0, 3)]
    assert relays[0]["sequence"] == sends[0]["sequence"]
    assert run.outcome.tracks[0].clusters[1].hops == 2
    assert run.outcome.tracks[0].clusters[1].handover_bits == 2 * 4 * 96


def test_without_a_path_the_track_is_lost_and_found_again_from_readings():
    islands = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (190.0, 0.0), (180.0, 0.0), (190.0, 10.0)]
    truth = standing((2.0, 2.0), 10)
    truth[4:] = [188.0, 0.0, 2.0, 0.0]
    tracker = Centroid()
    tracker.forecast = lambda belief, scene, ahead: type(tracker).estimate(tracker, np.array([188.0, 0.0, 1.0, 0.0]))
    run = Run(parts(steps=10, tracker=tracker), islands, [truth])
    assert len(run.events("drop", "no_path")) == 1
    assert len(run.events("lost", "handover_lost")) == 1
    assert run.outcome.tracks[0].reacquired == 1
    assert run.errors[0, -1] < 15


def test_a_head_that_dies_in_the_middle_of_a_step_takes_its_belief_along_and_the_track_is_taken_up_from_readings():
    tracker = Centroid(cycles=1e3)
    # The head pays 1.5 mJ a step to compute, and has enough for two.
    energy = FirstOrder(battery=4e-3, capacitance=0.67e-6)
    run = cluster_of_three(energy=energy, tracker=tracker, steps=8)
    deaths = run.events("death")
    assert deaths[0]["node"] == 0
    assert tracker.closed >= 1
    assert run.events("lost", "head_died")
    assert run.outcome.tracks[0].reacquired >= 1
    assert run.outcome.tracks[0].clusters[1].head != 0
    table = run.memory.table("estimates")
    assert np.isnan(table["error"]).any() and np.isfinite(table["error"]).any()


def test_when_nobody_is_left_who_could_lead_nothing_hangs_and_every_step_has_its_row():
    energy = FirstOrder(battery=1e-3, capacitance=0.67e-6)
    run = cluster_of_three(energy=energy, steps=300, tracker=Centroid(cycles=100.0))
    assert {1, 2} <= set(run.outcome.fleet.died_at)
    table = run.memory.table("estimates")
    assert len(table["step"]) == 300
    assert math.isnan(table["error"][-1])
    assert table["head"][-1] == -1
    assert (table["late"][-10:] == 1).all()


def test_a_network_of_ten_thousandths_of_a_joule_ends_without_hanging_whatever_the_moment_of_death():
    for battery in np.linspace(5e-6, 4e-4, 40):
        run = cluster_of_three(energy=FirstOrder(battery=float(battery)), steps=30)
        for node, book in run.outcome.fleet.books.items():
            assert book[SPENT] <= battery
            assert (node in run.outcome.fleet.died_at) == (book[SPENT] == battery)


def test_with_a_rate_airtime_counts_and_an_estimate_that_misses_its_step_is_late():
    slow = cluster_of_three(mac=IdealMac(rate=4000.0), steps=10)  # 24 ms a packet, two readings a step of 40 ms
    table = slow.memory.table("estimates")
    made = np.isfinite(table["issued"])
    delay = table["issued"] - table["time"]
    assert np.allclose(delay[made], 0.048)
    assert table["late"].all()
    assert np.flatnonzero(made).tolist() == [2, 4, 6, 8], "every other step is skipped, and stands as a row"
    assert [scene.steps for scene in slow.parts.tracker.scenes] == [3, 2, 2, 2]


def test_frames_that_are_lost_are_missing_from_the_answers_and_the_loss_does_not_depend_on_the_tracker():
    lossy = [
        cluster_of_three(link=Disk(reach=75.0, loss=0.5), steps=40, tracker=Centroid(cycles)) for cycles in (0.0, 1.0)
    ]
    first = [set(answer) for answer in lossy[0].parts.tracker.answers]
    assert first == [set(answer) for answer in lossy[1].parts.tracker.answers]
    assert {len(answer) for answer in first} == {1, 2, 3} or {len(answer) for answer in first} == {1, 2}
    assert lossy[0].outcome.frames_lost > 0
    assert len(lossy[0].events("drop")) > 0


def test_two_targets_have_two_tracks_and_a_node_may_lead_both():
    made = parts(steps=6)
    made = parts(steps=6, motions=made.motions * 2)
    run = Run(made, TRIANGLE, [standing((1.0, 1.0), 6), standing((2.0, 2.0), 6)])
    assert [track.clusters[0].head for track in run.outcome.tracks] == [0, 0]
    table = run.memory.table("estimates")
    assert sorted(set(table["target"])) == [0, 1]
    assert np.isfinite(table["error"]).all()
    readings = [run.outcome.tracks[t].estimates[3].readings for t in (0, 1)]
    assert readings == [3, 3]


def test_the_second_target_does_not_change_what_is_read_of_the_first():
    made = parts(steps=6)
    alone = Run(made, TRIANGLE, [standing((1.0, 1.0), 6)])
    both = Run(parts(steps=6, motions=made.motions * 2), TRIANGLE, [standing((1.0, 1.0), 6), standing((2.0, 2.0), 6)])
    assert alone.errors[0].tolist() == both.errors[0].tolist()


def test_a_cluster_that_stays_too_small_does_not_hand_over_at_every_step():
    pair = [(0.0, 0.0), (10.0, 0.0), (150.0, 150.0)]
    run = Run(parts(steps=20), pair, [standing((3.0, 3.0), 20)])
    assert len(run.outcome.tracks[0].clusters) <= 2
    assert len(run.outcome.tracks[0].estimates) == 20


def test_an_open_cluster_follows_whoever_senses_over_as_many_hops_as_it_takes_and_never_hands_over():
    run = Run(parts(clusters=Central(), steps=100))
    assert len(run.outcome.tracks[0].clusters) == 1
    assert run.events("relay")
    assert run.events("join") == []
    table = run.memory.table("estimates")
    in_range = [len(run.outcome.tracks[0].heads)]
    assert in_range and np.isfinite(table["error"]).all()
    senses = np.bincount(run.memory.table("events")["step"][run.memory.table("events")["kind"] == 2].astype(int))
    assert table["readings"].tolist() == senses[1:].tolist()


def test_the_successor_may_call_an_election():
    run = Run(parts(clusters=StrongestSignal(successor_rule="elect"), steps=300))
    assert run.events("send", "wake")
    assert len(run.outcome.tracks[0].clusters) > 2
    assert len(run.outcome.tracks[0].estimates) == 300
    assert len(run.events("elect")) >= len(run.outcome.tracks[0].clusters) - 1


def test_a_run_until_so_many_clusters_ends_when_the_last_would_hand_over():
    whole = Run(parts(steps=400))
    count = len(whole.outcome.tracks[0].clusters)
    assert count >= 3
    cut = Run(parts(steps=400, until_clusters=2))
    assert len(cut.outcome.tracks[0].clusters) == 2
    assert cut.outcome.steps < 400
    again = whole.memory.table("estimates")["error"][: cut.outcome.steps]
    assert cut.errors[0].tolist() == again.tolist()


def test_a_target_that_appears_late_is_acquired_from_readings_and_one_that_leaves_is_only_predicted():
    truth = passing((-150.0, 5.0), (20.0, 0.0), 400)
    run = Run(parts(steps=400), TRIANGLE[:3], [truth])
    table = run.memory.table("estimates")
    issued = np.isfinite(table["issued"])
    assert not issued[:50].any(), "nobody senses it yet"
    first = int(np.flatnonzero(issued)[0])
    assert run.errors[0, first] < 60
    assert run.outcome.tracks[0].reacquired == 0 or run.outcome.tracks[0].reacquired == 1


def test_the_same_replicate_gives_the_same_rows_after_any_number_of_others():
    once = Run(parts(), replicate=3)
    Run(parts(), replicate=1)
    again = Run(parts(), replicate=3)
    other = Run(parts(), replicate=4)
    assert once.outcome.fingerprint == again.outcome.fingerprint != other.outcome.fingerprint
    assert once.errors.tolist() == again.errors.tolist()


def test_energy_steps_sum_to_the_ledger():
    run = Run(parts())
    table = run.memory.table("energy_steps")
    for cause in range(len(CAUSES)):
        spent = table["joules"][table["cause"] == cause].sum()
        assert spent == pytest.approx(run.outcome.fleet.totals[cause], rel=1e-9, abs=1e-18)
