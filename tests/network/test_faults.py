"""Faults: which nodes they hit, what they change, and that they pass; first alone, then in whole networks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import simpy

from tests.helpers.centroid_network import Centroid, Run, network_setup, passing, standing
from tests.helpers.random_setups import DT, scenario
from tests.helpers.thorough import thorough
from tests.network.ledgers import SPENT, books
from wsnsim.base.errors import RunError
from wsnsim.base.tables import CAUSE, CAUSES, EVENT_CAUSE, KIND, KINDS, Memory
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.clusters import Central, StrongestSignal
from wsnsim.models.faults import Bias, Blackout, ClockStep, Crash, Drain, LinkLoss, Restart, Stuck
from wsnsim.models.hardware import PerfectClock, Processor
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.faults import FaultSchedule, FaultSite
from wsnsim.network.nodes import Nodes

LINE = np.column_stack([np.arange(10.0) * 10.0, np.zeros(10)])


class FaultyNodes:
    """Ten nodes on a line, 10 m apart, with 2 J each, to which nothing happens but faults."""

    def __init__(self, *script: Any, key: int = 11, heads: dict[int, int] | None = None) -> None:
        self.env = simpy.Environment()
        self.memory = Memory()
        self.sensor_nodes = Nodes(LINE, np.ones((10, 1)), 2.0, 75.0)
        self.sensor_nodes.on_death = lambda node: self.sensor_nodes.died_at.__setitem__(node, self.env.now)
        self.clocks = Clocks(PerfectClock(), 1, 10)
        self.heads = heads or {}
        journal = EventLog(self.memory, 0)
        actions = (
            self.sensor_nodes.crash, lambda node: self.sensor_nodes.restart(node, self.env.now), self.heads.get
        )  # fmt: skip
        self.site = FaultSite(self.env, self.sensor_nodes, journal, self.clocks, *actions)
        FaultSchedule(script, self.site, key, 0.1).start()
        self.journal = journal

    def at(self, time: float) -> FaultyNodes:
        """Run until just after a time; returns itself."""
        self.env.run(until=time + 1e-6)
        return self

    def rows(self) -> list[tuple[float, str, str, int]]:
        """(time, kind, what, node) of every event so far."""
        self.journal.flush(everything=True)
        table = self.memory.table("events")
        if not table:
            return []
        words = self.memory.words.all()
        kinds, whats = ([int(code) for code in table[name]] for name in ("kind", "what"))
        rows = zip(table["time"].tolist(), kinds, whats, table["node"].tolist(), strict=True)
        return [(round(time, 6), KINDS[kind], words[what], int(node)) for time, kind, what, node in rows]

    def down(self) -> list[int]:
        """The nodes that are not up."""
        return np.flatnonzero(~self.sensor_nodes.living).tolist()


def test_a_crashed_node_is_down_for_the_duration_and_back_with_the_charge_it_had():
    faulty = FaultyNodes(Crash(at=1.0, duration=2.0, nodes=(3, 5)))
    faulty.sensor_nodes.spend(3, CAUSE["cpu"], 0.5)
    assert faulty.at(0.99).down() == []
    assert faulty.at(1.0).down() == [3, 5]
    assert faulty.at(2.99).down() == [3, 5]
    assert faulty.at(3.0).down() == []
    assert faulty.sensor_nodes.residual_energy(3) == 1.5 and not faulty.sensor_nodes.died_at
    assert faulty.rows() == [
        (1.0, "fault", "crash", 3),
        (1.0, "fault", "crash", 5),
        (1.0, "crash", "", 3),
        (1.0, "crash", "", 5),
        (3.0, "restart", "", 3),
        (3.0, "restart", "", 5),
    ]


def test_a_crash_without_a_duration_lasts_until_the_end_and_is_not_a_death():
    faulty = FaultyNodes(Crash(at=1.0, nodes=(3,))).at(1e6)
    assert faulty.down() == [3] and faulty.sensor_nodes.died_at == {}


def test_a_node_taken_down_by_two_crashes_is_up_when_both_have_passed():
    faulty = FaultyNodes(Crash(at=1.0, duration=4.0, nodes=(1, 2)), Crash(at=2.0, duration=1.0, nodes=(2, 3)))
    assert faulty.at(2.5).down() == [1, 2, 3]
    assert faulty.at(3.5).down() == [1, 2]
    assert faulty.at(5.0).down() == []
    assert [row[3] for row in faulty.rows() if row[1] == "crash"] == [1, 2, 3]
    assert [row[3] for row in faulty.rows() if row[1] == "restart"] == [3, 1, 2]


def test_a_restart_takes_a_living_node_down_and_brings_back_one_that_had_crashed_for_good():
    faulty = FaultyNodes(Crash(at=1.0, nodes=(1,)), Restart(at=2.0, duration=0.5, nodes=(1, 2)))
    assert faulty.at(2.25).down() == [1, 2]
    assert faulty.at(2.5).down() == []
    assert [(row[0], row[1], row[3]) for row in faulty.rows() if row[1] != "fault"] == [
        (1.0, "crash", 1),
        (2.0, "crash", 2),
        (2.5, "restart", 1),
        (2.5, "restart", 2),
    ]
    assert FaultyNodes(Restart(at=1.0, nodes=(4,))).at(1.0).down() == []


def test_a_restart_in_a_crash_ends_the_crash_of_its_nodes_and_the_end_of_the_crash_changes_nothing():
    faulty = FaultyNodes(Crash(at=1.0, duration=5.0, nodes=(1, 2)), Restart(at=2.0, duration=0.5, nodes=(1,)))
    assert faulty.at(2.25).down() == [1, 2]
    assert faulty.at(2.5).down() == [2]
    assert faulty.at(6.0).down() == []
    assert [(row[0], row[3]) for row in faulty.rows() if row[1] == "restart"] == [(2.5, 1), (6.0, 2)]
    at_once = FaultyNodes(Crash(at=1.0, duration=5.0, nodes=(1,)), Restart(at=2.0, nodes=(1,)))
    assert at_once.at(2.0).down() == []


def test_a_crash_that_begins_during_a_restart_outlasts_it():
    faulty = FaultyNodes(Restart(at=1.0, duration=2.0, nodes=(1,)), Crash(at=2.0, duration=3.0, nodes=(1,)))
    assert faulty.at(3.0).down() == [1]
    assert faulty.at(5.0).down() == []


def test_faults_of_nodes_that_are_down_act_when_they_are_up_again_but_charge_is_not_lost():
    faulty = FaultyNodes(
        Crash(at=1.0, duration=2.0, nodes=(1,)),
        Drain(at=1.5, nodes=(1,), joules=1.0),
        Blackout(at=1.5, duration=3.0, nodes=(1,)),
        LinkLoss(at=1.5, duration=3.0, nodes=(1,), loss=0.5),
        ClockStep(at=1.5, duration=3.0, nodes=(1,), offset=0.2),
        Stuck(at=1.5, duration=3.0, nodes=(1,)),
    )
    nodes, clocks = faulty.sensor_nodes, faulty.clocks
    faulty.at(3.0)
    assert faulty.down() == [] and nodes.residual_energy(1) == 2.0
    assert (nodes.jammed[1], nodes.loss[1], float(clocks.error(np.array([1]), 3.0)[0])) == (True, 0.5, 0.2)
    assert [defect.nodes for defect in faulty.site.defects.values()] == [{1}]
    faulty.at(4.5)
    assert not (nodes.jammed.any() or nodes.loss.any() or faulty.site.defects)
    assert ("fault", "drain", -1) in [row[1:] for row in faulty.rows()]


def test_dead_nodes_do_not_restart():
    faulty = FaultyNodes(
        Drain(at=1.0, nodes=(1,), share=1.0), Restart(at=2.0, nodes=(1,)), Crash(at=3.0, duration=1.0, nodes=(1,))
    )
    assert faulty.at(10.0).down() == [1] and faulty.sensor_nodes.died_at == {1: 1.0}
    assert faulty.sensor_nodes.ledger.joules[CAUSE["leak"], 1] == 2.0
    assert [row[1:] for row in faulty.rows()][1:] == [("fault", "restart", -1), ("fault", "crash", -1)]


def test_a_drain_takes_joules_or_a_share_of_what_is_left_and_books_them_as_a_leak():
    faulty = FaultyNodes(Drain(at=1.0, nodes=(1, 2), joules=0.5), Drain(at=2.0, nodes=(1,), share=0.5)).at(2.0)
    assert (
        faulty.sensor_nodes.residual_energy(1) == pytest.approx(0.75, rel=1e-15)
        and faulty.sensor_nodes.residual_energy(2) == 1.5
    )
    assert faulty.sensor_nodes.ledger.totals[CAUSE["leak"]] == pytest.approx(1.75, rel=1e-15)
    faulty.rows()
    assert faulty.memory.table("events")["joules"].tolist() == [0.5, 0.5, 0.75]


def test_a_drain_of_more_than_the_residual_energy_takes_all_of_it_and_the_node_dies():
    faulty = FaultyNodes(Drain(at=1.0, nodes=(6,), joules=5.0)).at(1.0)
    assert (
        faulty.sensor_nodes.died_at == {6: 1.0}
        and faulty.sensor_nodes.ledger.spent[6] == 2.0 == faulty.sensor_nodes.ledger.totals[CAUSE["leak"]]
    )


def test_a_blackout_jams_a_region_for_its_duration_and_overlapping_ones_hold_together():
    faulty = FaultyNodes(
        Blackout(at=1.0, duration=3.0, region=(0.0, 0.0, 20.0)), Blackout(at=2.0, duration=1.0, nodes=(2, 7))
    )
    assert not faulty.sensor_nodes.disturbed
    assert np.flatnonzero(faulty.at(1.5).sensor_nodes.jammed).tolist() == [0, 1, 2] and faulty.sensor_nodes.disturbed
    assert np.flatnonzero(faulty.at(2.5).sensor_nodes.jammed).tolist() == [0, 1, 2, 7]
    assert np.flatnonzero(faulty.at(3.5).sensor_nodes.jammed).tolist() == [0, 1, 2]
    assert not faulty.at(4.5).sensor_nodes.jammed.any() and not faulty.sensor_nodes.disturbed
    assert faulty.rows()[-1] == (4.0, "fault", "blackout_over", 2)


def test_losses_of_overlapping_faults_multiply_what_arrives():
    faulty = FaultyNodes(
        LinkLoss(at=1.0, duration=3.0, nodes=(4,), loss=0.5), LinkLoss(at=2.0, duration=1.0, nodes=(4,), loss=0.2)
    )
    assert (
        faulty.at(1.5).sensor_nodes.loss.tolist() == [0.5 * (node == 4) for node in range(10)]
        and faulty.sensor_nodes.disturbed
    )
    assert faulty.at(2.5).sensor_nodes.loss[4] == pytest.approx(1.0 - 0.5 * 0.8, rel=1e-15)
    assert faulty.at(3.5).sensor_nodes.loss[4] == 0.5
    assert faulty.at(4.5).sensor_nodes.loss[4] == 0.0 and not faulty.sensor_nodes.disturbed


def test_a_clock_jumps_and_jumps_back():
    faulty = FaultyNodes(ClockStep(at=1.0, duration=1.0, nodes=(2,), offset=0.3))
    assert faulty.at(1.5).clocks.error(np.arange(4), 1.5).tolist() == [0.0, 0.0, 0.3, 0.0]
    assert faulty.at(2.5).clocks.largest_error(2.5) == 0.0


def test_sensor_defects_last_for_the_duration():
    faulty = FaultyNodes(Stuck(at=1.0, duration=1.0, nodes=(2,), value=7.0), Bias(at=1.5, nodes=(3,), offset=-1.0))
    (stuck,) = faulty.at(1.2).site.defects.values()
    assert stuck.stuck and stuck.value == 7.0 and stuck.nodes == {2}
    (bias,) = faulty.at(2.0).site.defects.values()
    assert not bias.stuck and bias.offset == -1.0 and bias.nodes == {3}


@pytest.mark.thorough
def test_a_share_of_all_nodes_is_exact_and_depends_on_the_key_and_the_number_of_the_fault_alone():
    first, again = FaultyNodes(Crash(at=1.0, fraction=0.3)).at(1.0), FaultyNodes(Crash(at=1.0, fraction=0.3)).at(1.0)
    assert len(first.down()) == 3 and first.down() == again.down()
    assert FaultyNodes(Crash(at=1.0, fraction=1.0)).at(1.0).down() == list(range(10))
    hits = np.zeros(10)
    for key in range(2000):
        hits[FaultyNodes(Crash(at=0.0, fraction=0.3), key=key).down()] += 1
    # Each node is hit in 3 of 10 runs: five standard errors of 2000 draws.
    assert np.abs(hits / 2000 - 0.3).max() < 5 * (0.21 / 2000) ** 0.5
    second = FaultyNodes(Blackout(at=0.0, fraction=0.3), Crash(at=1.0, fraction=0.3))
    assert np.flatnonzero(second.sensor_nodes.jammed).tolist() == first.down()


def test_a_fault_aimed_at_a_head_hits_the_cluster_head_of_that_instant():
    faulty = FaultyNodes(Crash(at=1.0, head=1), Crash(at=2.0, head=1), heads={0: 4, 1: 5})
    assert faulty.at(1.0).down() == [5]
    faulty.heads[1] = 8
    assert faulty.at(2.0).down() == [5, 8]
    faulty.rows()
    assert set(faulty.memory.table("events")["target"].tolist()) == {1}


@pytest.mark.parametrize(
    "fault",
    [
        Crash(at=1.0, head=0),
        Blackout(at=1.0, duration=1.0, region=(500.0, 500.0, 10.0)),
        Drain(at=1.0, fraction=0.01, joules=1.0),
        LinkLoss(at=1.0, duration=1.0, head=0, loss=0.5),
    ],
)
def test_a_fault_that_hits_no_node_is_logged_once_and_changes_nothing(fault):
    faulty = FaultyNodes(fault).at(5.0)
    assert faulty.rows() == [(1.0, "fault", fault.mechanism, -1)]
    assert faulty.down() == [] and not faulty.sensor_nodes.disturbed and not faulty.sensor_nodes.ledger.spent.any()


def test_a_fault_at_the_time_of_a_step_begins_before_the_step_in_spite_of_rounding():
    seen = []
    faulty = FaultyNodes(Crash(at=0.3 + 1e-12, nodes=(1,)), Crash(at=0.7 + 1e-13, nodes=(2,)))

    def clock():
        for step in range(10):
            seen.append(faulty.down())
            yield faulty.env.timeout((step + 1) * 0.1 - faulty.env.now)

    faulty.env.process(clock())
    faulty.at(0.85)
    assert [len(down) for down in seen] == [0, 0, 0, 1, 1, 1, 1, 2, 2]


def test_a_mechanism_that_the_network_does_not_know_is_refused():
    class Meteor(Crash):
        mechanism = "meteor"

    with pytest.raises(RunError, match=r"meteor.*known: crash"):
        FaultyNodes(Meteor(at=1.0, nodes=(1,)))


# Whole networks.

SLOW = {"mac": IdealMac(rate=20e3), "cpu": Processor()}
"""A radio on which a packet of 96 bits takes 4.8 ms: acts last long enough to be struck in their middle."""
CIRCLE = [(15 * np.cos(a), 15 * np.sin(a)) for a in np.arange(6) * np.pi / 3]
ACTS = {
    KIND[kind]
    for kind in (
        "send", "relay", "receive", "overhear", "collide", "sense", "compute", "join", "announce", "elect", "allocate",
        "estimate", "wake", "sleep", "handover",
    )
}  # fmt: skip


def circle(*faults: Any, steps: int = 20, **changes: Any) -> Run:
    """Six nodes around a target that stands still, on the slow radio unless `changes` say otherwise."""
    made = network_setup(steps=steps, dt=DT, faults=faults, **{**SLOW, **changes})
    return Run(made, CIRCLE, [standing((3.0, 4.0), steps)])


def two_camps(*faults: Any, **changes: Any) -> Run:
    """A target that jumps from one group of nodes to another, which takes over by itself."""
    camps = [(x + dx, y) for x in (0.0, 70.0) for dx, y in ((0.0, 0.0), (8.0, 0.0), (0.0, 9.0), (9.0, 9.0))]
    truth = standing((2.0, 2.0), 30)
    truth[8:] = [75.0, 0.0, 3.0, 0.0]
    tracker = Centroid()
    tracker.forecast = lambda belief, scene, ahead: tracker.estimate(np.array([71.0, 0.0, 1.0, 0.0]))
    made = network_setup(steps=30, dt=DT, faults=faults, tracker=tracker, **{**SLOW, **changes})
    return Run(made, camps, [truth])


def is_well_defined(run: Run) -> bool:
    """Whether the run reached its end, and at its end the target is tracked, or was reported lost."""
    track = run.outcome.tracks[0]
    led = track.head is not None and bool(run.outcome.nodes.alive[track.head])
    told = bool(run.events("lost"))
    return run.outcome.steps == run.setup.steps and (led or told)


def first(run: Run, kind: str, what: str | None = None, after: float = -1.0) -> dict[str, Any]:
    """The first event of a kind after a time."""
    return next(row for row in run.events(kind, what) if row["time"] > after)


def test_a_head_that_crashes_in_the_middle_of_a_step_loses_its_track_and_others_find_it_again():
    calm = circle()
    gathering = first(calm, "send", "reading", after=8 * DT)
    head = int(gathering["peer"])
    # The first reading has just left, four more are to come: the step is under way.
    struck = circle(Crash(at=float(gathering["time"]) + 1e-3, head=0))
    assert [row["node"] for row in struck.events("crash")] == [head]
    assert [row["node"] for row in struck.events("lost", "head_died")] == [head]
    track = struck.outcome.tracks[0]
    assert track.reacquired == 1 and track.head not in (None, head)
    lost, found = first(struck, "lost")["time"], first(struck, "reacquire")["time"]
    assert lost < found <= lost + 5 * DT
    assert is_well_defined(struck)
    assert np.nanmax(struck.errors[0, -5:]) < 15.0


def test_a_run_is_what_it_was_until_the_fault_strikes():
    calm, struck = circle(), circle(Crash(at=0.5, fraction=0.4))
    before, after = (run.memory.table("events") for run in (calm, struck))
    count = int(np.sum(before["time"] < 0.5))
    assert count > 50
    for name, column in before.items():
        assert np.array_equal(column[:count], after[name][:count])


def test_a_head_that_crashes_in_the_middle_of_a_handover_loses_the_belief_and_the_track_is_found_again():
    calm = two_camps()
    handover = first(calm, "handover")
    belief = first(calm, "send", "belief")
    assert belief["time"] > handover["time"]
    at = (float(handover["time"]) + float(belief["time"])) / 2
    struck = two_camps(Crash(at=at, head=0))
    assert [row["node"] for row in struck.events("lost")] == [handover["node"]]
    assert not struck.events("send", "belief")
    assert struck.outcome.tracks[0].reacquired == 1 and is_well_defined(struck)


def test_a_successor_that_crashes_while_the_belief_is_on_its_way_leaves_the_track_to_an_election():
    calm = two_camps()
    handover, belief = first(calm, "handover"), first(calm, "send", "belief")
    at = (float(handover["time"]) + float(belief["time"])) / 2
    struck = two_camps(Crash(at=at, nodes=(int(handover["peer"]),)))
    assert len(struck.events("lost", "handover_lost")) == 1
    track = struck.outcome.tracks[0]
    assert track.reacquired == 1 and track.head not in (None, handover["peer"]) and is_well_defined(struck)


def test_a_successor_that_crashes_before_its_first_step_is_given_up_at_that_instant():
    calm = two_camps()
    handover, belief = first(calm, "handover"), first(calm, "send", "belief")
    at = float(belief["time"]) + 1e-4
    assert at < (int(at / DT) + 1) * DT  # its first step begins with the next tick
    struck = two_camps(Crash(at=at, head=0))
    assert [row["node"] for row in struck.events("crash")] == [handover["peer"]]
    assert first(struck, "lost", "head_died")["time"] == pytest.approx(at, abs=1e-12)
    assert struck.outcome.tracks[0].reacquired == 1 and is_well_defined(struck)


@pytest.mark.parametrize("mac", [IdealMac(rate=20e3), Csma()])
def test_a_candidate_that_crashes_in_the_middle_of_an_election_is_not_waited_for(mac):
    calm = circle(mac=mac)
    winner, ballots = first(calm, "elect"), calm.events("send", "strength")
    (own,) = [row for row in ballots if row["node"] == winner["node"]]
    # Its ballot is on the air, and not yet through.
    at = float(own["time"]) - 1e-4
    assert len(ballots) == 6 and at > 0.0
    struck = circle(Crash(at=at, nodes=(int(winner["node"]),)), mac=mac)
    elected = first(struck, "elect")
    assert elected["node"] != winner["node"] and elected["time"] <= winner["time"] + DT
    assert struck.outcome.tracks[0].head == elected["node"] and is_well_defined(struck)


@pytest.mark.thorough
def test_a_head_that_crashes_while_it_waits_for_the_election_that_it_called_leaves_the_winner_to_the_next_one():
    changes = {"clusters": StrongestSignal(successor_rule="elect")}
    calm = two_camps(**changes)
    wake = first(calm, "receive", "wake")
    ballots = [row for row in calm.events("send", "strength") if row["time"] > wake["time"]]
    struck = two_camps(Crash(at=float(ballots[0]["time"]) + 1e-4, head=0), **changes)
    (lost,) = struck.events("lost", "head_died")
    assert lost["node"] == wake["peer"]
    assert struck.outcome.tracks[0].reacquired == 1 and is_well_defined(struck)


def test_when_everybody_has_crashed_the_track_is_lost_and_the_run_comes_to_its_end():
    struck = circle(Crash(at=0.41, fraction=1.0))
    assert is_well_defined(struck) and struck.outcome.tracks[0].head is None
    assert not struck.events("sense") or max(row["time"] for row in struck.events("sense")) < 0.41
    assert struck.memory.table("estimates")["head"][-1] == -1


def test_when_everybody_has_crashed_and_restarts_the_target_is_found_again():
    struck = circle(Crash(at=0.41, duration=0.15, fraction=1.0))
    assert len(struck.events("restart")) == 6
    woken = [row["node"] for row in struck.events("wake") if row["time"] > 0.41]
    assert sorted(woken) == list(range(6))
    assert {round(float(row["time"]), 9) for row in struck.events("wake")} == {0.0, 0.56}
    assert struck.outcome.tracks[0].reacquired == 1 and struck.outcome.tracks[0].head is not None


def test_a_member_that_restarts_is_no_member_any_more_but_senses_again():
    calm = circle()
    head = calm.outcome.tracks[0].clusters[0].head
    member = (head + 1) % 6
    struck = circle(Crash(at=0.41, duration=0.1, nodes=(member,)))
    scenes = struck.setup.tracker.scenes
    assert member in scenes[3].roster and member not in scenes[-1].roster
    assert len(struck.outcome.tracks[0].clusters) == 1
    senses = {round(float(row["time"]) / DT) for row in struck.events("sense") if row["node"] == member}
    assert senses == set(range(21)) - {11, 12}


def test_in_an_open_cluster_a_member_that_restarts_joins_anew_with_nothing_in_its_memory():
    tracker = Centroid()
    struck = circle(Crash(at=0.41, duration=0.01, nodes=(4,)), tracker=tracker, clusters=Central(x=15.0))
    joined = [(scene.step, scene.joined, scene.left) for scene in tracker.scenes if scene.joined or scene.left]
    assert (11, (4,), ()) in joined
    assert is_well_defined(struck)


def test_a_jammed_head_hears_nobody_and_goes_on_when_the_jamming_ends():
    tracker = Centroid()
    jammed = circle(Blackout(at=0.4, duration=0.2, head=0), tracker=tracker, mac=IdealMac())
    answers = [len(answer) for answer in tracker.answers]
    # Steps 10 to 14 begin within the blackout: the head has its own reading alone.
    assert answers == [6] * 9 + [1] * 5 + [6] * 6
    assert jammed.outcome.tracks[0].reacquired == 0


def test_a_link_loss_of_one_on_a_member_takes_its_reading_alone():
    tracker = Centroid()
    calm = circle(mac=IdealMac())
    member = (calm.outcome.tracks[0].clusters[0].head + 1) % 6
    circle(LinkLoss(at=0.4, duration=0.2, nodes=(member,), loss=1.0), tracker=tracker, mac=IdealMac())
    assert [set(range(6)) - set(answer) for answer in tracker.answers[9:14]] == [{member}] * 5
    assert all(len(answer) == 6 for answer in tracker.answers[:9] + tracker.answers[14:])


def test_a_stuck_sensor_and_a_clock_that_jumps_change_what_the_tracker_is_told():
    def told(*faults: Any) -> list[float]:
        tracker = Centroid()
        truth = passing((-10.0, 0.0), (30.0, 0.0), 20, DT)
        Run(network_setup(steps=20, dt=DT, faults=faults, tracker=tracker), CIRCLE, [truth])
        return [answer[2][0] for answer in tracker.answers]

    calm, stuck = told(), told(Stuck(at=0.4, duration=0.2, nodes=(2,), value=123.0))
    assert stuck == [123.0 if 10 <= step < 15 else value for step, value in enumerate(calm, start=1)]
    late = told(ClockStep(at=0.4, nodes=(2,), offset=DT))
    assert late[:9] == calm[:9] and all(one != other for one, other in zip(late[9:], calm[9:], strict=True))
    assert told(ClockStep(at=0.4, nodes=(3,), offset=DT)) == calm


def test_a_drained_head_dies_and_the_leak_is_in_the_ledger_and_in_the_log():
    struck = circle(Drain(at=0.41, head=0, share=1.0))
    (death,) = struck.events("death")
    assert struck.outcome.nodes.died_at == {int(death["node"]): 0.41} and is_well_defined(struck)
    (fault,) = struck.events("fault", "drain")
    assert fault["joules"] == struck.outcome.nodes.ledger.totals[CAUSE["leak"]] > 1.9


@pytest.mark.thorough
@pytest.mark.parametrize("block", [0, *thorough(range(1, 6))])
def test_of_random_scenarios_full_of_faults_every_one_ends_and_its_books_close(block):
    for number in range(30 * block, 30 * block + 30):
        made, positions, truths = scenario(number)
        run = Run(made, positions, truths)
        table = run.memory.table("events")
        assert run.outcome.steps == made.steps, number
        assert table["time"].max() <= made.steps * DT + DT, number
        _ledger_closes(run, number)
        _events_sum_to_the_ledger(run, table, number)
        _nobody_acts_while_down(table, number)


@pytest.mark.thorough
def test_the_random_scenarios_meet_what_they_are_for():
    """Of the first thirty: nodes that crash, come back, run dry; heads that fall, tracks that are found again."""
    seen = dict.fromkeys(("crash", "restart", "death", "lost", "reacquire", "handover", "relay", "collide"), 0)
    for number in range(30):
        run = Run(*scenario(number))
        kinds = set(run.memory.table("events")["kind"].tolist())
        for kind in seen:
            seen[kind] += KIND[kind] in kinds
    assert min(seen.values()) >= 5, seen


def _ledger_closes(run: Run, number: int) -> None:
    battery = run.setup.energy.battery
    for node, book in books(run.outcome.nodes).items():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9), (number, node)
        assert book[SPENT] <= battery * (1 + 1e-12), (number, node)
        assert (node in run.outcome.nodes.died_at) == (book[SPENT] == battery), (number, node)


def _events_sum_to_the_ledger(run: Run, table: Any, number: int) -> None:
    """Of what acts cost, node by node; what time costs has no events."""
    ledger, size = run.outcome.nodes.ledger.joules, run.outcome.nodes.size
    for cause in ("tx", "rx", "overhear", "cpu", "sense", "leak"):
        rows = table["cause"] == EVENT_CAUSE[cause]
        logged = np.bincount(table["node"][rows].astype(int), table["joules"][rows], size)
        names = [name for name in CAUSES if name == cause or (cause == "tx" and name.startswith("tx_"))]
        booked = sum(ledger[CAUSE[name]] for name in names)
        assert np.allclose(logged, booked, rtol=1e-9, atol=1e-15), (number, cause)


def _nobody_acts_while_down(table: Any, number: int) -> None:
    """Between a crash and a restart, and after a death, but for the act that it died of."""
    down: dict[int, float] = {}
    columns = (table[name].tolist() for name in ("time", "node", "kind"))
    for time, node, kind in zip(*columns, strict=True):
        if kind in (KIND["crash"], KIND["death"]):
            down[node] = time
        elif kind == KIND["restart"]:
            assert node in down, (number, node, time)
            del down[node]
        elif kind in ACTS and node in down:
            assert time == down[node], (number, node, time, KINDS[int(kind)])


def test_a_fault_at_the_beginning_of_a_step_is_of_that_step_and_a_tiny_one_passes():
    made = network_setup(
        faults=(Blackout(at=0.4, duration=0.2, nodes=(1,)), Crash(at=0.2, duration=1e-12, nodes=(2,))), steps=30
    )
    rows = [(int(row["step"]), round(float(row["time"]), 9)) for row in Run(made).events("fault")]
    assert (10, 0.4) in rows and (15, 0.6) in rows and all(step == round(time / DT) for step, time in rows)


@pytest.mark.thorough
def test_thousands_of_overlapping_faults_combine():
    script = [Blackout(at=0.1 + 0.0001 * i, duration=0.5, nodes=(3,)) for i in range(3000)]
    lossy = [
        LinkLoss(at=0.1, duration=0.2, nodes=(4, 5), loss=0.5),
        LinkLoss(at=0.15, duration=0.5, nodes=(5,), loss=0.5),
    ]
    faulty = FaultyNodes(*script, *lossy).at(0.2)
    assert faulty.sensor_nodes.jammed[3] and faulty.sensor_nodes.loss[4:6].tolist() == [0.5, 0.75]
    faulty.at(0.4)
    assert faulty.sensor_nodes.loss[4:6].tolist() == [0.0, 0.5]
    faulty.at(0.95)
    assert (
        not faulty.sensor_nodes.jammed.any()
        and not faulty.sensor_nodes.loss.any()
        and not faulty.sensor_nodes.disturbed
    )
