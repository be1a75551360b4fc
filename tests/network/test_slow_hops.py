"""Clusters whose hops take as long as on radios that are mostly off: elections, joins, deadlines, wake intervals."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import simpy

from tests.helpers import late_mac
from tests.network.late_runs import CALM, LATE, MOVING, Run, played
from wsnsim.base import medium_access
from wsnsim.base.medium_access import head_waits
from wsnsim.base.tables import KIND
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.bearing import Bearing
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.models.tsch import Tsch
from wsnsim.network.clusters.election import Election, waiting_share
from wsnsim.network.clusters.standing_cluster import StandingClusterProtocol
from wsnsim.scenario import build, load
from wsnsim.trackers.information_driven import InformationDriven


def test_on_a_radio_that_listens_heads_wait_as_ever():
    for mac in (Csma(), IdealMac()):
        assert head_waits(mac, 0.04) == (12e-3, 50e-3, None, None, None, None)


def test_on_a_radio_that_is_mostly_off_heads_wait_for_hops_but_not_for_more_than_a_share_of_a_step():
    late = late_mac.LateCsma(interval=0.125)
    hop = late.latency(96).unicast
    waits = head_waits(late, 100.0)
    assert waits == pytest.approx((1.5 * hop, 4 * hop, 4 * hop, 2 * hop, 6 * hop, 8 * hop))
    assert head_waits(late, 0.5) == pytest.approx((1.5 * hop, 0.3, 0.3, 0.15, 0.25, 0.25 + 2 * hop))
    assert head_waits(late, 0.04).gather == pytest.approx(hop), "where a step is shorter than a hop"


POLICIES = {
    "standing": ("ekf_real", ()),
    "electing": ("ekf_real", ("clusters.successor_rule=elect",)),
    "appointing": ("ekf_real", ("clusters={kind: appointed}",)),
    "open": ("ekf_real", ("clusters={kind: central}",)),
    "information_driven": ("information_driven_real", ()),
}


@pytest.mark.thorough
@pytest.mark.parametrize("policy", POLICIES)
def test_every_policy_tracks_at_intervals_of_125_ms_with_steps_of_1_s(policy):
    name, changes = POLICIES[policy]
    run = played(name, *CALM, LATE.format(0.125), *changes)
    (track,) = run.summary.tracks
    issued = run.estimates["issued"] - run.estimates["time"]
    assert track["losses"] == 0 and track["mean_error"] < 3.0
    assert np.sum(issued < 1.0) >= 0.8 * 20, "estimates in time"


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "main"), [("gmtt", "prediction"), ("tsstp", "detection"), ("ris", "detection")])
def test_moving_heads_track_at_intervals_of_125_ms_with_steps_of_2_s(name, main):
    run = played(name, "duration=40 s", LATE.format(0.125), MOVING.format(main))
    issued = run.estimates["issued"] - run.estimates["time"]
    sensed = run.estimates["readings"] > 0
    assert np.sum(issued[sensed] < 2.0) >= 0.8 * 20
    assert np.nanmax(issued[sensed]) < 2.0
    late = played(name, "duration=40 s", LATE.format(0.5), MOVING.format(main))
    assert np.nanmedian(late.estimates["issued"] - late.estimates["time"]) > np.nanmedian(issued)


@pytest.mark.thorough
def test_a_head_goes_on_after_the_deadline_that_follows_from_the_mac(monkeypatch):
    monkeypatch.setattr(medium_access, "CAP_HOPS", 0.5)
    run = Run("ekf_real", *CALM, LATE.format(0.4))
    assert run.setup.waits.gather == pytest.approx(run.setup.hop.unicast / 2)
    delays = run.estimates["issued"] - run.estimates["time"]
    at_deadline = np.abs(delays - run.setup.waits.gather) < 1e-3
    assert at_deadline.sum() > 5, "some members are still sending then"
    assert np.all(run.estimates["readings"][at_deadline] < run.estimates["active"][at_deadline])


def test_a_join_that_arrives_after_the_head_has_gone_on_makes_a_member_all_the_same():
    run = played("ekf_real", *CALM, LATE.format(0.4))
    joined, announced, received = run.times("join"), run.times("announce"), run.times("receive", "join")
    after = np.array([time - announced[announced <= time].max() for time in joined])
    longest = run.setup.hop.broadcast + run.setup.waits.joins
    late = joined[after > longest + 1e-6]
    assert 0 < late.size < joined.size
    for time in late:
        assert 0.0 <= time - received[received <= time].max() < 1e-3, "once its acknowledgement has come"


@pytest.mark.thorough
def test_few_candidates_broadcast_where_a_broadcast_takes_long():
    changes = (*CALM[1:], "step=1 s", "duration=2 s")
    late, prompt = (
        played("ekf_real", *changes, mac) for mac in (LATE.format(0.125), "mac={kind: csma, rate: 250 kbit/s}")
    )
    counts = [
        Counter(run.events["node"][run.events["what"] == run.memory.words.code("strength")].tolist())
        for run in (late, prompt)
    ]
    assert 1 <= late.times("send", "strength").size < prompt.times("send", "strength").size
    assert len(counts[1]) > 8
    assert late.times("elect")[0] < late.setup.waits.closing + 1e-9


def candidates(*strengths: float) -> tuple[Election, list[Any]]:
    """An election among nodes 0, 1, ... with these readings, and a list that the winner is put into."""
    closed, winners = simpy.Environment().event(), []
    closed.callbacks.append(lambda event: winners.append(event.value))
    election = Election(closed, 0, dict(enumerate(strengths)), StrongestSignal(), AcousticEnergy())
    return election, winners


def won(election: Election, winners: list[Any]) -> list[Any]:
    election.closed.env.run()
    return winners


def test_a_candidate_that_heard_a_stronger_reading_is_outbid():
    election, winners = candidates(1.0, 3.0, 3.0)
    assert not election.is_outbid(0)
    election.report(1, {0: np.ones(1, bool)})
    assert election.is_outbid(0) and not election.is_outbid(2), "node 2 did not hear it"
    election.withdraw(0)
    election.report(2, {1: np.ones(1, bool)})
    assert won(election, winners) == [1]
    assert election.readings_at(1) == {1: 3.0, 2: 3.0}


def test_an_overdue_election_closes_with_those_that_have_broadcast_or_with_the_first_one():
    election, winners = candidates(1.0, 3.0, 2.0)
    election.report(2, {})
    election.close()
    assert won(election, winners) == [2]
    election, winners = candidates(1.0, 3.0)
    election.close()
    assert not won(election, winners)
    election.report(0, {})
    assert won(election, winners) == [0]
    election.report(1, {})
    assert winners == [0], "what comes later changes nothing"


def test_candidates_wait_the_longer_the_farther_their_reading_says_the_target_is():
    sensor, traits = Range(reach=40.0, sd=2.0), np.zeros(0)
    shares = [waiting_share(sensor, 2, traits, reading, 0.5) for reading in (0.0, 10.0, 20.0, 39.9, 80.0)]
    assert shares == sorted(shares) and shares[0] < 0.05 and 0.94 < shares[-1] < 1.0
    assert waiting_share(sensor, 2, traits, 20.0, 0.0) < waiting_share(sensor, 2, traits, 20.0, 0.9)
    acoustic = AcousticEnergy()
    one = np.ones(1)
    loud, soft = (waiting_share(acoustic, 2, one, reading, 0.5) for reading in (100.0, 1.5))
    assert loud < soft
    assert waiting_share(Bearing(), 2, np.zeros(1), 0.3, 0.25) == 0.25, "a bearing says nothing of the distance"


def test_a_deadline_that_is_left_out_leaves_time_for_a_hop():
    tracker = InformationDriven()
    scenes = [SimpleNamespace(dt=1.0, hop_seconds=hop) for hop in (0.0, 0.125, 0.7, 3.0)]
    assert [tracker._seconds(cast(Any, scene)) for scene in scenes] == [0.6, 0.6, 0.7, 0.9]
    assert InformationDriven(deadline=0.1)._seconds(cast(Any, scenes[2])) == 0.1, "what is given stays"


@pytest.mark.parametrize("members", [5, 14, 18, 30])
def test_a_deadline_that_is_left_out_leaves_time_for_a_round_with_a_slot_for_each_member(members):
    setup = build(load("information_driven_real"))
    schedule, slot = setup.hop.broadcast, 2 * 0.25e-3 + 29 * 8 / 250e3
    round_ = setup.gathering(members)
    assert round_ == pytest.approx(schedule + members * slot)
    scene = SimpleNamespace(dt=0.04, hop_seconds=round_)
    assert InformationDriven()._seconds(cast(Any, scene)) == pytest.approx(min(max(0.024, round_), 0.036))
    skipped = build(load("information_driven_real", ["mac.idle_slots=skipped"]))
    assert skipped.gathering(members) == skipped.hop.unicast


KEEPING = {
    "standing": ("ekf_real", (*CALM, "duration=30 s")),
    "electing": ("ekf_real", (*CALM, "duration=30 s", "clusters.successor_rule=elect")),
    "appointing": ("ekf_real", (*CALM, "clusters={kind: appointed}")),
    "waker": ("cluster", ("duration=60 s", MOVING.format("prediction"))),
    "detecting": ("tsstp", ("duration=60 s", MOVING.format("detection"))),
}


@pytest.mark.thorough
@pytest.mark.parametrize("policy", KEEPING)
def test_a_head_whose_belief_does_not_reach_the_next_one_goes_on_with_it(policy, monkeypatch):
    name, changes = KEEPING[policy]
    send, undelivered = late_mac.LateMechanism.send, []

    def lossy(mechanism: Any, bursts: Any, head: int | None = None) -> Any:
        if len(undelivered) < 2 and bursts and bursts[0].parcel.what == "handover":
            undelivered.append(mechanism.services.now)
            bursts[0].lose()
            return send(mechanism, [])
        return send(mechanism, bursts, head)

    monkeypatch.setattr(late_mac.LateMechanism, "send", lossy)
    run = Run(name, *changes, LATE.format(0.125))
    began = run.times("handover")
    assert len(undelivered) == 2 and not run.times("lost").size
    assert np.sum(began >= undelivered[1]) > 1, "another handover is tried, and arrives"
    assert {*run.memory.table("clusters")["previous_head"].tolist()} != {-1.0}
    issued = run.estimates["issued"] - run.estimates["time"]
    assert np.sum(issued < run.setup.dt) > 0.6 * run.setup.steps


@pytest.mark.thorough
@pytest.mark.parametrize("policy", ["standing", "appointing"])
def test_an_announcement_that_nobody_heard_is_repeated(policy, monkeypatch):
    name, changes = KEEPING[policy]
    send, unheard = late_mac.LateMechanism.send, []

    def lossy(mechanism: Any, bursts: Any, head: int | None = None) -> Any:
        if not unheard and bursts and bursts[0].parcel.what == "announce":
            unheard.append(mechanism.services.now)
            return send(mechanism, [])
        return send(mechanism, bursts, head)

    monkeypatch.setattr(late_mac.LateMechanism, "send", lossy)
    run = Run(name, *changes, LATE.format(0.125))
    again = run.times("announce")
    assert len(unheard) == 1 and again[1] - again[0] <= 2.0, "within two steps"
    issued = run.estimates["issued"] - run.estimates["time"]
    assert np.sum((issued < 1.0) & (run.estimates["readings"] > 1)) > 0.7 * run.setup.steps


def test_a_head_does_not_hand_over_while_nodes_are_joining():
    run = played("ekf_real", *CALM, LATE.format(0.4))
    events = run.events
    joins, handovers = (
        list(zip(events[who][chosen].tolist(), events["time"][chosen].tolist(), strict=True))
        for who, chosen in (("peer", events["kind"] == KIND["join"]), ("node", events["kind"] == KIND["handover"]))
    )
    assert joins and handovers
    for head, at in handovers:
        assert not [time for node, time in joins if node == head and at < time < at + 1.0]


def test_a_head_waits_for_cells_that_it_has_to_announce_first():
    for slotframe, shared in ((101, 16), (31, 4)):
        tsch = Tsch(slotframe=slotframe, shared=shared)
        hop = tsch.latency(96)
        assert hop.granted > tsch.interval + hop.unicast > 2.0 * hop.unicast
        waits = head_waits(tsch, 100.0)
        assert waits.gather == waits.cap == pytest.approx(max(4.0 * hop.unicast, hop.granted))
        assert waits.quiet == pytest.approx(max(1.5 * hop.unicast, hop.granted))
        assert head_waits(tsch, 1.0).gather == pytest.approx(min(0.6, waits.cap))


class Joining:
    """A standing cluster whose joins end late: what becomes a member, what is logged, who gets a role and a slot."""

    def __init__(self, forming: bool, of_track: bool) -> None:
        self.members: list[int] = []
        self.logged: list[int] = []
        self.enlisted: list[int] = []
        self.expected: list[int] = []
        cluster: Any = SimpleNamespace(awaited=2, forming=forming, head=9, admit=self.admit, members=self.members)
        track: Any = SimpleNamespace(cluster=cluster if of_track else None, target=0)
        protocol: Any = StandingClusterProtocol.__new__(StandingClusterProtocol)
        protocol._log = SimpleNamespace(add=lambda kind, target, node, peer: self.logged.append(node))
        enlist = SimpleNamespace(enlist=lambda nodes, target: self.enlisted.extend(nodes))
        expect = SimpleNamespace(keeps_idle_slots=True, expect=lambda head, nodes: self.expected.extend(nodes))
        protocol._services = SimpleNamespace(processes=enlist, messages=SimpleNamespace(transport=expect))
        protocol._end_join(track, cluster, SimpleNamespace(source=4, arrived=True))
        protocol._end_join(track, cluster, SimpleNamespace(source=5, arrived=False))
        assert cluster.awaited == 0

    def admit(self, nodes: list[int]) -> list[int]:
        self.members += nodes
        return nodes


@pytest.mark.parametrize(
    ("forming", "of_track", "members", "enlisted"),
    [(True, False, [4], []), (False, True, [4], [4]), (False, False, [], [])],
)
def test_a_late_join_counts_while_the_cluster_forms_and_while_it_exists(forming, of_track, members, enlisted):
    seen = Joining(forming, of_track)
    assert (seen.members, seen.logged, seen.enlisted) == (members, members, enlisted)
    assert seen.expected == enlisted, "a head that keeps idle slots has one for it; one that forms says so afterwards"
