"""Networks small enough to be counted by hand, and failures at any point of a head's lead."""

import math

import numpy as np
import pytest

from tests.helpers.centroid_network import Centroid, Run, network_setup, passing, standing
from tests.helpers.thorough import thorough
from tests.network.ledgers import SPENT, books
from wsnsim.base.errors import RunError
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.models.access import IdealMac
from wsnsim.models.clusters import Central, StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk, MinimumHop
from wsnsim.models.wakeup import NoWakeUp

BIT = 50e-9
AMP = 100e-12
TRIANGLE = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0), (150.0, 150.0)]


def cluster_of_three(**changes):
    """Nodes 0, 1, 2 sense a target at rest at (5, 5); node 3 is out of range of all others."""
    steps = changes.pop("steps", 4)
    made = network_setup(steps=steps, energy=changes.pop("energy", FirstOrder(battery=2.0)), **changes)
    return Run(made, TRIANGLE, [standing((5.0, 5.0), steps)])


def test_the_energy_of_a_cluster_is_what_a_hand_count_gives():
    run = cluster_of_three()
    sensor_nodes, bits = run.outcome.nodes, 96
    # Three strengths and one announcement at reach, heard by the two others each; two joins; then two readings a step.
    distances = {1: 30.0, 2: 40.0}
    broadcasts = 4
    unicasts = [distances[1], distances[2]] * (1 + 4)
    electronics = (broadcasts + len(unicasts)) * bits * BIT
    amplifier = bits * AMP * (broadcasts * 75.0**2 + sum(d**2 for d in unicasts))
    reception = (broadcasts * 2 + len(unicasts)) * bits * BIT
    assert sensor_nodes.ledger.totals[CAUSE["tx_electronics"]] == pytest.approx(electronics, rel=1e-12)
    assert sensor_nodes.ledger.totals[CAUSE["tx_amplifier"]] == pytest.approx(amplifier, rel=1e-12)
    assert sensor_nodes.ledger.totals[CAUSE["rx"]] == pytest.approx(reception, rel=1e-12)
    assert 3 not in books(sensor_nodes)


def test_the_node_with_the_strongest_reading_leads_the_others_join_and_only_sensing_nodes_wake():
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
    run = Run(network_setup())
    for book in books(run.outcome.nodes).values():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9)


def test_the_events_alone_reproduce_the_transmit_energy():
    run = Run(network_setup())
    table = run.memory.table("events")
    sent = np.isin(table["kind"], [7, 14])
    ends = table["peer"][sent].astype(int)
    starts = table["node"][sent].astype(int)
    distance = np.where(ends < 0, 75.0, np.linalg.norm(run.positions[starts] - run.positions[ends], axis=1))
    bits = table["bits"][sent]
    assert np.allclose(table["joules"][sent], bits * BIT + bits * AMP * distance**2, rtol=1e-12)
    spent = sum(run.outcome.nodes.ledger.totals[CAUSE[cause]] for cause in ("tx_electronics", "tx_amplifier"))
    assert table["joules"][sent].sum() == pytest.approx(spent, rel=1e-9)


def test_a_handover_out_of_reach_is_relayed_and_every_hop_is_paid():
    chain = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (70.0, 0.0), (140.0, 0.0), (150.0, 0.0), (140.0, 10.0)]
    truth = standing((2.0, 2.0), 10)
    truth[5:] = [142.0, 0.0, 2.0, 0.0]
    truth[4] = [142.0, 0.0, 2.0, 0.0]
    tracker = Centroid()
    tracker.forecast = lambda belief, scene, ahead: type(tracker).estimate(tracker, np.array([141.0, 0.0, 1.0, 0.0]))
    run = Run(network_setup(steps=10, tracker=tracker, routing=MinimumHop()), chain, [truth])
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
    run = Run(network_setup(steps=10, tracker=tracker), islands, [truth])
    assert len(run.events("drop", "no_path")) == 1
    assert len(run.events("lost", "handover_lost")) == 1
    assert run.outcome.tracks[0].reacquired == 1
    assert run.errors[0, -1] < 15


def test_a_head_that_dies_during_a_step_loses_its_belief_and_the_track_is_initiated_again_from_readings():
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


def test_when_no_node_can_lead_the_run_ends_and_every_step_has_its_row():
    energy = FirstOrder(battery=1e-3, capacitance=0.67e-6)
    run = cluster_of_three(energy=energy, steps=300, tracker=Centroid(cycles=100.0))
    assert {1, 2} <= set(run.outcome.nodes.died_at)
    table = run.memory.table("estimates")
    assert len(table["step"]) == 300
    assert math.isnan(table["error"][-1])
    assert table["head"][-1] == -1
    assert (table["late"][-10:] == 1).all()


def test_a_run_ends_whenever_its_nodes_die():
    for battery in np.linspace(5e-6, 4e-4, 40):
        run = cluster_of_three(energy=FirstOrder(battery=float(battery)), steps=30)
        for node, book in books(run.outcome.nodes).items():
            assert book[SPENT] <= battery
            assert (node in run.outcome.nodes.died_at) == (book[SPENT] == battery)


def test_with_a_rate_airtime_counts_and_an_estimate_that_misses_its_step_is_late():
    slow = cluster_of_three(mac=IdealMac(rate=4000.0), steps=10)  # 24 ms a packet, two readings a step of 40 ms
    table = slow.memory.table("estimates")
    made = np.isfinite(table["issued"])
    delay = table["issued"] - table["time"]
    assert np.allclose(delay[made], 0.048)
    assert table["late"].all()
    assert np.flatnonzero(made).tolist() == [2, 4, 6, 8], "every other step is skipped, and stands as a row"
    assert [scene.steps for scene in slow.setup.tracker.scenes] == [3, 2, 2, 2]


def test_frames_that_are_lost_are_missing_from_the_answers_and_the_loss_does_not_depend_on_the_tracker():
    lossy = [
        cluster_of_three(link=Disk(reach=75.0, loss=0.5), steps=40, tracker=Centroid(cycles)) for cycles in (0.0, 1.0)
    ]
    first = [set(answer) for answer in lossy[0].setup.tracker.answers]
    assert first == [set(answer) for answer in lossy[1].setup.tracker.answers]
    assert len({len(answer) for answer in first}) > 1
    assert lossy[0].outcome.counters.frames_lost > 0
    assert len(lossy[0].events("drop")) > 0


def test_two_targets_have_two_tracks_and_a_node_may_lead_both():
    made = network_setup(steps=6)
    made = network_setup(steps=6, motions=made.motions * 2)
    run = Run(made, TRIANGLE, [standing((1.0, 1.0), 6), standing((2.0, 2.0), 6)])
    assert [track.clusters[0].head for track in run.outcome.tracks] == [0, 0]
    table = run.memory.table("estimates")
    assert sorted(set(table["target"])) == [0, 1]
    assert np.isfinite(table["error"]).all()
    readings = [run.outcome.tracks[t].estimates[3].readings for t in (0, 1)]
    assert readings == [3, 3]


def test_the_second_target_does_not_change_what_is_read_of_the_first():
    made = network_setup(steps=6)
    alone = Run(made, TRIANGLE, [standing((1.0, 1.0), 6)])
    both = Run(
        network_setup(steps=6, motions=made.motions * 2), TRIANGLE, [standing((1.0, 1.0), 6), standing((2.0, 2.0), 6)]
    )
    assert alone.errors[0].tolist() == both.errors[0].tolist()


def test_a_cluster_that_stays_too_small_does_not_hand_over_at_every_step():
    pair = [(0.0, 0.0), (10.0, 0.0), (150.0, 150.0)]
    run = Run(network_setup(steps=20), pair, [standing((3.0, 3.0), 20)])
    assert len(run.outcome.tracks[0].clusters) <= 2
    assert len(run.outcome.tracks[0].estimates) == 20


@pytest.mark.thorough
def test_an_open_cluster_takes_readings_of_all_sensing_nodes_over_several_hops_and_never_hands_over():
    run = Run(network_setup(clusters=Central(), steps=100))
    assert len(run.outcome.tracks[0].clusters) == 1
    assert run.events("relay")
    assert run.events("join") == []
    table = run.memory.table("estimates")
    assert np.isfinite(table["error"]).all()
    senses = np.bincount(run.memory.table("events")["step"][run.memory.table("events")["kind"] == 2].astype(int))
    assert table["readings"].tolist() == senses[1:].tolist()


def test_the_successor_may_call_an_election():
    run = Run(network_setup(clusters=StrongestSignal(successor_rule="elect"), steps=300))
    assert run.events("send", "wake")
    assert len(run.outcome.tracks[0].clusters) > 2
    assert len(run.outcome.tracks[0].estimates) == 300
    assert len(run.events("elect")) >= len(run.outcome.tracks[0].clusters) - 1


def test_a_run_until_a_number_of_clusters_ends_when_the_last_would_hand_over():
    whole = Run(network_setup(steps=400))
    count = len(whole.outcome.tracks[0].clusters)
    assert count >= 3
    cut = Run(network_setup(steps=400, until_clusters=2))
    assert len(cut.outcome.tracks[0].clusters) == 2
    assert cut.outcome.steps < 400
    again = whole.memory.table("estimates")["error"][: cut.outcome.steps]
    assert cut.errors[0].tolist() == again.tolist()


def test_a_track_of_a_late_target_is_initiated_from_readings_and_a_target_out_of_range_is_only_predicted():
    run = Run(network_setup(steps=400), TRIANGLE[:3], [passing((-150.0, 5.0), (20.0, 0.0), 400)])
    table = run.memory.table("estimates")
    issued = np.isfinite(table["issued"])
    assert not issued[:50].any(), "nobody senses it yet"
    first = int(np.flatnonzero(issued)[0])
    assert table["active"][first] > 0 and run.errors[0, first] < 60
    assert table["readings"][first] >= 1, "the readings that started it are counted"
    assert run.outcome.tracks[0].reacquired == 0 and run.events("reacquire") == []
    assert table["active"][-1] == 0 and table["readings"][-1] == 0 and issued[-1], "predicted, of nothing"


def test_a_run_gives_the_same_rows_whatever_ran_before():
    once = Run(network_setup(), replicate=3)
    Run(network_setup(), replicate=1)
    again = Run(network_setup(), replicate=3)
    other = Run(network_setup(), replicate=4)
    assert once.outcome.event_fingerprint == again.outcome.event_fingerprint != other.outcome.event_fingerprint
    assert once.errors.tolist() == again.errors.tolist()


def test_energy_steps_sum_to_the_ledger():
    run = Run(network_setup())
    table = run.memory.table("energy_steps")
    for cause in range(len(CAUSES)):
        spent = table["joules"][table["cause"] == cause].sum()
        assert spent == pytest.approx(run.outcome.nodes.ledger.totals[cause], rel=1e-9, abs=1e-18)


def gone_at(start: tuple[float, float], steps: int) -> np.ndarray:
    """A target fast enough that its clusters hand over."""
    return passing(start, (30.0, 12.0), steps)


def assert_no_track_waits_for_a_dead_node(run: Run) -> None:
    """Assert that no track has a dead head, or no head although a node that can lead senses its target."""
    sensor_nodes = run.outcome.nodes
    for track in run.outcome.tracks:
        assert track.head is None or sensor_nodes.alive[track.head]
    for book in books(sensor_nodes).values():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9, abs=1e-15)


def assert_radio_energy_is_in_the_events(run: Run) -> None:
    """Assert that equations (9)-(10) over the logged bits give the booked joules, deaths during bursts included."""
    table, totals = run.memory.table("events"), run.outcome.nodes.ledger.totals
    sent = np.isin(table["kind"], [7, 14])
    starts, ends = table["node"][sent].astype(int), table["peer"][sent].astype(int)
    distance = np.where(ends < 0, 75.0, np.linalg.norm(run.positions[starts] - run.positions[ends], axis=1))
    heard = table["bits"][table["cause"] == 2].sum()
    assert np.sum(table["bits"][sent]) * BIT == pytest.approx(totals[CAUSE["tx_electronics"]], rel=1e-9)
    assert np.sum(table["bits"][sent] * AMP * distance**2) == pytest.approx(totals[CAUSE["tx_amplifier"]], rel=1e-9)
    assert heard * BIT == pytest.approx(totals[CAUSE["rx"]], rel=1e-9, abs=1e-18)


@pytest.mark.thorough
@pytest.mark.parametrize("part", [0, *thorough((1, 2, 3))])
@pytest.mark.parametrize("rule", ["nearest", "elect"])
def test_deaths_during_handovers_and_elections_leave_every_track_with_a_head_or_open_to_election(rule, part):
    lost, died = set(), 0
    for battery in np.geomspace(7e-5, 2e-2, 40)[part::4]:
        energy, policy = FirstOrder(battery=float(battery)), StrongestSignal(successor_rule=rule, threshold=0.0)
        run = Run(network_setup(steps=150, energy=energy, clusters=policy), truths=[gone_at((-60.0, -30.0), 150)])
        assert_no_track_waits_for_a_dead_node(run)
        assert_radio_energy_is_in_the_events(run)
        lost |= {run.memory.words.all()[int(row["what"])] for row in run.events("lost")}
        died += len(run.outcome.nodes.died_at)
    assert died > 25 and "head_died" in lost


@pytest.mark.thorough
@pytest.mark.parametrize("part", [0, *thorough((1, 2))])
def test_two_targets_that_cross_on_failing_nodes_leave_every_track_with_a_head_or_open_to_election(part):
    made = network_setup(steps=100)
    for battery in np.geomspace(2e-4, 5e-3, 30)[part::3]:
        both = network_setup(
            steps=100,
            motions=made.motions * 2,
            energy=FirstOrder(battery=float(battery)),
            clusters=StrongestSignal(threshold=0.0),
        )
        truths = [passing((-60.0, 0.0), (30.0, 0.0), 100), passing((60.0, 0.0), (-30.0, 0.0), 100)]
        run = Run(both, truths=truths)
        assert_no_track_waits_for_a_dead_node(run)
        assert_radio_energy_is_in_the_events(run)


@pytest.mark.thorough
def test_a_candidate_that_dies_during_its_broadcast_wins_no_election():
    for battery in np.linspace(6.0e-5, 7.5e-5, 40):
        run = Run(
            network_setup(steps=20, energy=FirstOrder(battery=float(battery)), clusters=StrongestSignal(threshold=0.0))
        )
        died = run.outcome.nodes.died_at
        assert not any(row["node"] in died and died[row["node"]] < row["time"] for row in run.events("elect"))
        assert_no_track_waits_for_a_dead_node(run)


def test_a_late_handover_carries_the_step_of_its_belief():
    tracker = Centroid()
    run = Run(
        network_setup(steps=300, mac=IdealMac(rate=30_000.0), tracker=tracker), truths=[gone_at((-100.0, -60.0), 300)]
    )
    assert len(run.outcome.tracks[0].clusters) > 3
    scenes = tracker.scenes
    assert max(scene.steps for scene in scenes) > 1, "the air is slow enough to miss steps"
    assert [scene.step - scene.steps for scene in scenes[1:]] == [scene.step for scene in scenes[:-1]]


def test_on_a_lossy_channel_a_track_survives_its_handovers_or_is_reacquired_and_the_ledger_closes():
    run = Run(network_setup(steps=400, link=Disk(reach=75.0, loss=0.4)), truths=[gone_at((-100.0, -60.0), 400)])
    assert len(run.outcome.tracks[0].clusters) > 2
    drops = {int(row["frame"]) for row in run.events("drop")} - {0}
    assert run.outcome.counters.frames_lost >= len(drops) > 0
    assert_radio_energy_is_in_the_events(run)
    assert_no_track_waits_for_a_dead_node(run)


def test_without_the_wake_packet_no_election_is_held():
    islands = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0), (190.0, 0.0), (180.0, 0.0), (190.0, 10.0)]
    truth = standing((2.0, 2.0), 10)
    truth[4:] = [188.0, 0.0, 2.0, 0.0]
    tracker = Centroid()
    tracker.forecast = lambda belief, scene, ahead: type(tracker).estimate(tracker, np.array([188.0, 0.0, 1.0, 0.0]))
    run = Run(
        network_setup(steps=10, tracker=tracker, clusters=StrongestSignal(successor_rule="elect")), islands, [truth]
    )
    assert len(run.events("lost", "no_successor")) == 1
    step_of_loss = run.events("lost")[0]["step"]
    assert [row["step"] for row in run.events("elect")] == [0, step_of_loss + 1], "the vacancy is filled a step later"


def test_woken_counts_the_logged_wake_ups_and_the_unnecessary_ones():
    run = Run(network_setup(steps=300), truths=[gone_at((-100.0, -60.0), 300)])
    table = run.memory.table("estimates")
    wakes = [row for row in run.events("wake") if row["step"] > 0]
    assert table["woken"].sum() == len(wakes)
    by_frame = [row for row in wakes if row["what"] == run.memory.words.code("frame")]
    assert 0 <= table["ineffective"].sum() <= len(by_frame)


def test_no_node_sends_while_it_is_asleep():
    run = Run(network_setup(steps=300), truths=[gone_at((-100.0, -60.0), 300)])
    table = run.memory.table("events")
    awake: set[int] = set()
    for kind, node in zip(table["kind"].astype(int), table["node"].astype(int), strict=True):
        if kind == 0:
            awake.add(node)
        elif kind == 1:
            awake.discard(node)
        elif kind == 7:
            assert node in awake


def test_a_component_without_a_mechanism_is_refused():
    class Drum(NoWakeUp):
        mechanism = "drum"

    with pytest.raises(RunError, match=r"'drum'.*known: none, flood"):
        Run(network_setup(wakeup=Drum()))


def test_a_failing_tracker_is_named_with_seed_replicate_and_time():
    class Odd(Exception):
        def __init__(self, one, two):
            super().__init__(f"{one} and {two}")

    class Failing(Centroid):
        def step(self, belief, scene):
            if scene.step == 3:
                raise Odd("salt", "pepper")
            return (yield from super().step(belief, scene))

    with pytest.raises(RunError, match=r"0\.12 s of simulated time \(seed 7, replicate 0\): .*Odd: salt and pepper"):
        Run(network_setup(tracker=Failing()))
