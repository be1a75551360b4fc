"""Networks without a head: what participants compute, exchange, pay, and survive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import pytest
from scipy.stats import chi2

from tests.helpers.tracker_kinds import trackers_without_a_head
from wsnsim import experiment, scenario
from wsnsim.base.arrays import Estimate
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.requests import PACKET_BITS, Exchange, Gather, Local, Member, Parcel
from wsnsim.base.tables import KIND, Memory
from wsnsim.bounds import bounds_of_run
from wsnsim.experiment import Summary
from wsnsim.models.bearing import RangeBearing
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import Coordinate
from wsnsim.offline.loopback import perform
from wsnsim.testing import check_tracker
from wsnsim.testing.table import FIRST, Table
from wsnsim.trackers.covariance_intersection import CovarianceIntersection, NaiveFusion
from wsnsim.trackers.information_consensus import HybridConsensus, InformationConsensus
from wsnsim.trackers.neighbour_filters import DiffusionFilter, KalmanConsensus
from wsnsim.trackers.shared.consensus import VALUES, average, neighbourhood
from wsnsim.trackers.shared.heads import HeadFilter
from wsnsim.trackers.shared.peers import PeerFilter

PLACES = "[[0, 0], [30, 0], [60, 0], [0, 30], [30, 30], [60, 30]]"
FIXED = (
    f"deploy={{kind: anchors, places: {PLACES}}}",
    "motion={kind: constant_velocity, start: [10, 1, 5, 1], variances: [0.1]}",
    "sensor={kind: range, reach: 500 m, sd: 2 m}", "step=1 s", "duration=6 s", "link.reach=40 m", "energy.battery=2 J",
    "clusters={kind: none}",
)  # fmt: skip
"""Six nodes in two rows, which hear their neighbours, and all sense."""
FIXED_REAL = (*FIXED[:5], "clusters={kind: none}", "step=2 s", "duration=30 s", "sink={kind: none}")
CENTRAL = ("clusters={kind: central}", "tracker={kind: ekf}")


def simulated(*changes: str, run: int = 0, name: str = "jiang_field") -> tuple[Memory, Summary]:
    memory = Memory()
    return memory, experiment.simulate_run(scenario.load(name, changes), run, memory)


def estimates(*changes: str) -> dict[str, Any]:
    return dict(simulated(*changes)[0].table("estimates"))


def sends(memory: Memory, what: str) -> int:
    """How many parcels of a name were broadcast."""
    events = memory.table("events")
    return int(((events["kind"] == KIND["send"]) & (events["what"] == memory.words.code(what))).sum())


@pytest.mark.parametrize("kind", ["information_consensus", "hybrid_consensus"])
@pytest.mark.parametrize("options", ["participants: 6", "weights: ratio"])
def test_after_many_rounds_consensus_is_the_central_filter(kind: str, options: str) -> None:
    found = estimates(*FIXED, f"tracker={{kind: {kind}, rounds: 150, {options}}}")
    central = estimates(*FIXED, *CENTRAL)
    for name in ("px", "vx", "py", "vy", "sd_x", "sd_y", "cov_xy"):
        np.testing.assert_allclose(found[name], central[name], rtol=1e-6, atol=1e-6)
    assert found["disagreement"].max() < 1e-6
    assert (found["readings"] == 6).all()


@pytest.mark.parametrize("rounds", [20, 100])
def test_the_parts_of_a_cut_graph_do_not_agree(rounds: int) -> None:
    cut = "deploy={kind: anchors, places: [[0, 0], [30, 0], [0, 30], [200, 0], [230, 0], [200, 30]]}"
    found = estimates(*FIXED, cut, f"tracker={{kind: information_consensus, rounds: {rounds}}}")
    assert found["disagreement"][-1] > 0.05


def test_frames_are_rounds_times_senders_and_joules_follow() -> None:
    memory, summary = simulated(*FIXED, "tracker={kind: information_consensus, rounds: 7, participants: 6}")
    steps, senders, links = 5, 6, 14
    assert sends(memory, "consensus") == 7 * senders * steps
    assert sends(memory, "known") == senders * steps
    assert summary.run["frames_sent"] == 8 * senders * steps
    bits = (7 * 4 + 1) * PACKET_BITS * steps  # 15 numbers in four packets
    electronics, amplifier = 50e-9, 100e-12 * 40.0**2
    expected = senders * bits * (electronics + amplifier) + links * bits * electronics
    assert summary.run["energy"] - summary.joules["cpu"] == pytest.approx(expected, rel=1e-9)


ONE_STEP_HOPS: Final = {
    KalmanConsensus(): 1, DiffusionFilter(): 2, InformationConsensus(rounds=3, participants=7): 3,
    HybridConsensus(rounds=3, participants=7): 3, InformationConsensus(rounds=3, participants=7, weights="ratio"): 3,
    CovarianceIntersection(rounds=3): 3, NaiveFusion(rounds=2): 2,
}  # fmt: skip
"""How far a reading goes in one step."""


@pytest.mark.parametrize("tracker", ONE_STEP_HOPS, ids=lambda tracker: type(tracker).__name__)
def test_in_a_step_a_reading_goes_as_many_hops_as_there_are_rounds(tracker: Any) -> None:
    on_a_line = [after_a_step(tracker, first) for first in (40.0, 41.0)]
    changed = [not np.array_equal(one, other) for one, other in zip(*on_a_line, strict=True)]
    hops = ONE_STEP_HOPS[tracker]
    assert changed == [node <= hops for node in range(7)]


def after_a_step(tracker: Any, first: float) -> list[Any]:
    """The means of seven nodes on a line, each of which hears those beside it; the first has this reading."""
    table = Table(ConstantVelocity(), Range(reach=500.0), 1)
    members = {node: Member(node, np.array([30.0 * node, 0.0]), np.ones(1), 50.0 + node) for node in range(7)}
    members[0].reading = first
    scene = table.scene(1, 1, table.members(FIRST), FIRST[0], ())
    for member in members.values():
        tracker.begin(member, Estimate(np.array([90.0, 0.0, 30.0, 0.0]), np.diag([25.0, 1.0, 25.0, 1.0])))
    perform(tracker.step(scene), members, -1, beside)
    return [tracker.belief_of(member).mean for member in members.values()]


def beside(source: int, to: int, parcel: Parcel) -> Any:
    """Only those beside each other on a line hear each other."""
    return np.full(parcel.packets, abs(source - to) == 1)


@pytest.mark.parametrize("weights", ["metropolis", "ratio"])
def test_the_error_of_consensus_falls_with_the_second_largest_eigenvalue_modulus(weights: Any) -> None:
    members = {node: Member(node, np.zeros(2), np.ones(1), 1.0) for node in range(7)}
    rng = np.random.default_rng(3)
    start = rng.normal(size=7)

    def error(rounds: int) -> float:
        for node, member in members.items():
            member.memory = {VALUES: np.array([start[node]])}
        perform(neighbourhood(), members, -1, beside)
        perform(average(rounds, weights), members, -1, beside)
        values = np.array([member.memory[VALUES][0] for member in members.values()])
        return float(np.linalg.norm(values - start.mean()))

    adjacent = np.eye(7, k=1) + np.eye(7, k=-1)
    degrees = adjacent.sum(axis=0)
    shares = adjacent / (1.0 + (np.maximum.outer(degrees, degrees) if weights == "metropolis" else degrees))
    second = sorted(abs(np.linalg.eigvals(shares + np.diag(1.0 - shares.sum(axis=0)))))[-2]
    assert (error(60) / error(40)) ** (1.0 / 20.0) == pytest.approx(second, rel=0.05)


def test_where_frames_are_lost_ratio_consensus_still_finds_the_mean() -> None:
    rng = np.random.default_rng(5)
    members = {node: Member(node, np.zeros(2), np.ones(1), 1.0) for node in range(7)}

    def lossy(source: int, to: int, parcel: Parcel) -> Any:
        return beside(source, to, parcel) & (rng.random() > 0.3)

    def spread(weights: Any) -> float:
        for node, member in members.items():
            member.memory = {VALUES: np.array([float(node)])}
        perform(neighbourhood(), members, -1, beside)
        perform(average(300, weights), members, -1, lossy)
        return max(abs(float(member.memory[VALUES][0]) - 3.0) for member in members.values())

    assert spread("ratio") < 0.02 < spread("metropolis")


@pytest.mark.parametrize("weights", ["metropolis", "ratio"])
def test_where_the_count_of_neighbours_is_lost_too_values_agree_within_their_range(weights: Any) -> None:
    rng = np.random.default_rng(5)
    members = {node: Member(node, np.zeros(2), np.ones(1), 1.0) for node in range(7)}
    for node, member in members.items():
        member.memory = {VALUES: np.array([float(node)])}

    def lossy(loss: float) -> Any:
        return lambda source, to, parcel: np.full(parcel.packets, rng.random() > loss)

    perform(neighbourhood(), members, -1, lossy(0.95))
    perform(average(100, weights), members, -1, lossy(0.3))
    values = np.array([float(member.memory[VALUES][0]) for member in members.values()])
    assert np.ptp(values) < 1e-3 and 1.0 < values.min() <= values.max() < 5.0


@pytest.mark.parametrize("kind", [row.kind for row in trackers_without_a_head()])
def test_over_a_lossy_radio_the_ledger_closes_and_joining_is_paid(kind: str) -> None:
    small = "deploy={kind: uniform, nodes: 90, width: 250 m, height: 250 m, cover: false}"
    changes = f"tracker.kind={kind}", "clusters.kind=none", "link.loss=0.2", "duration=0.6 s", small
    memory, summary = simulated(*changes)
    nodes, events = memory.table("nodes"), memory.table("events")
    spent = nodes["energy_initial"] - nodes["energy_left"]
    assert summary.run["energy"] == pytest.approx(spent.sum(), rel=1e-9)
    assert summary.run["energy"] == pytest.approx(sum(summary.joules.values()), rel=1e-9)
    assert summary.joules["cpu"] > 0.0 and np.isfinite(memory.table("estimates")["error"]).all()
    belief = memory.words.code("belief")
    joins = events["kind"] == KIND["join"]
    received = (events["kind"] == KIND["receive"]) & (events["what"] == belief)
    assert joins.any()
    for node, time, peer in zip(events["node"][joins], events["time"][joins], events["peer"][joins], strict=True):
        assert ((events["node"] == node) & (events["time"] == time) & (events["peer"] == peer) & received).any()


@pytest.mark.parametrize("mac", ["{kind: csma, rate: 250 kbit/s}", "{kind: tdma}", "{kind: xmac}", "{kind: tsch}"])
def test_rounds_are_sent_over_every_mac(mac: str) -> None:
    real = (*FIXED_REAL, f"mac={mac}", "tracker={kind: information_consensus, rounds: 2, participants: 6}")
    memory, summary = simulated(*real, name="ekf_real")
    nodes = memory.table("nodes")
    assert np.isfinite(memory.table("estimates")["error"]).sum() >= 2
    assert summary.run["energy"] == pytest.approx((nodes["energy_initial"] - nodes["energy_left"]).sum(), rel=1e-9)
    assert sends(memory, "consensus") > 0


def test_estimation_goes_on_when_a_node_dies_in_the_middle_of_a_round() -> None:
    slow, crash = "mac={kind: ideal, rate: 10 kbit/s}", "faults=[{kind: crash, nodes: [4], at: 2.5 s}]"
    tracker = "tracker={kind: information_consensus, rounds: 3, participants: 6}"
    memory, _ = simulated(*FIXED, slow, crash, tracker, "duration=8 s")
    found, events = memory.table("estimates"), memory.table("events")
    sent = events["time"][(events["kind"] == KIND["send"]) & (events["what"] == memory.words.code("consensus"))]
    assert (sent[sent < 2.5].max() > 2.4) and (sent[sent > 2.5].min() < 2.6)  # the crash is within a round
    assert np.isfinite(found["error"]).all() and found["members"].tolist()[-3:] == [5, 5, 5]


def test_the_death_of_a_head_loses_the_track_and_that_of_a_gateway_does_not() -> None:
    few = ("duration=2 s", "faults=[{kind: crash, head: 0, at: 1.01 s}]", "deploy.nodes=256")
    with_head, head_summary = simulated(*few, "tracker.kind=ekf")
    without, summary = simulated(*few, "clusters.kind=none", "tracker.kind=kalman_consensus")
    assert (with_head.table("events")["kind"] == KIND["lost"]).any() and head_summary.tracks[0]["reacquired"] == 1
    assert (without.table("events")["kind"] == KIND["crash"]).any()
    assert not (without.table("events")["kind"] == KIND["lost"]).any() and summary.tracks[0]["reacquired"] == 0
    assert np.isfinite(without.table("estimates")["error"]).all()


def test_a_track_whose_participants_are_all_gone_is_initiated_from_readings_that_nodes_broadcast() -> None:
    gone = "faults=[{kind: crash, fraction: 1.0, at: 2.5 s, duration: 1 s}]"
    memory, summary = simulated(*FIXED, gone, "tracker={kind: diffusion}", "duration=8 s")
    found = memory.table("estimates")
    assert summary.tracks[0]["reacquired"] == 1 and sends(memory, "reading") >= 6
    assert np.isfinite(found["error"][-2:]).all() and np.isnan(found["error"][2])


def test_the_estimate_of_the_participant_nearest_to_the_sink_is_reported_and_paid() -> None:
    sink = ("sink={kind: node, x: 60 m, y: 30 m}", "tracker={kind: information_consensus, rounds: 1}")
    memory, summary = simulated(*FIXED, *sink)
    assert (memory.table("estimates")["head"] == 5).all()
    memory, summary = simulated(*FIXED, *sink, "clusters.gateway=target")
    found = memory.table("estimates")
    assert (found["head"] != 5).any() and np.isfinite(found["received"]).all()
    assert sends(memory, "report") > 0 and summary.tracks[0]["received"] == len(found["head"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("tracker.kind=ekf",), "ekf needs a cluster head, and clusters: none has none"),
        (("tracker.kind=diffusion", "clusters.kind=central"), "diffusion runs on every participant"),
        (("tracker.kind=diffusion", "network=none"), "it needs clusters: {kind: none}"),
        (("tracker.kind=diffusion", "until={clusters: 3}"), "without a head there are no clusters to end at"),
        (("tracker={kind: gnn, filter: {kind: ekf}}", "detection={kind: unlabelled}"), "no group of tracks is led so"),
    ],
)  # fmt: skip
def test_what_needs_a_head_is_refused_without_one(changes: tuple[str, ...], message: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario.build(scenario.load("jiang_field", ("clusters.kind=none", *changes)))
    assert message in str(refused.value)


@pytest.mark.parametrize(("kind", "shown"), [("kalman_consensus", False), ("diffusion", False),
                                             ("information_consensus", True), ("naive_fusion", True)])  # fmt: skip
def test_no_consistency_is_claimed_of_a_filter_without_a_covariance(kind: str, shown: bool) -> None:
    memory, summary = simulated(*FIXED, f"tracker.kind={kind}")
    found = memory.table("estimates")
    for name in ("nees", "sd_x", "sd_y", "cov_xy"):
        assert np.isfinite(found[name]).all() == shown and np.isnan(found[name]).all() != shown
    assert np.isfinite(summary.run["nees"]) == shown and summary.run["singular"] == 0


@pytest.mark.parametrize("tracker", ONE_STEP_HOPS, ids=lambda tracker: type(tracker).__name__)
def test_every_shipped_tracker_without_a_head_keeps_the_rules(tracker: Any) -> None:
    check_tracker(tracker, BoundedVelocity(), Range(reach=100.0))


def test_a_tracker_that_needs_the_number_of_participants_and_counts_them_keeps_the_rules() -> None:
    check_tracker(HybridConsensus(rounds=4), sensor=RangeBearing())


SEEN: dict[int, float] = {}


class Peeks(PeerFilter):
    """Looks at readings that were not sent."""

    def fused(self, scene: Any) -> Any:
        yield Exchange(lambda member: Parcel(1, 1, PACKET_BITS, "hello"))
        yield Local(lambda member: SEEN.update({member.id: member.reading or 0.0}))
        yield Local(lambda member: member.memory.update(mean=member.memory["mean"] + SEEN[4]))


class SendsTooMuch(PeerFilter):
    """Sends four numbers in a bit."""

    def fused(self, scene: Any) -> Any:
        yield Exchange(lambda member: Parcel(member.memory["mean"].copy(), 1, 1, "mean"))


class AsksAHead(PeerFilter):
    """Sends to a head."""

    def fused(self, scene: Any) -> Any:
        yield Gather(lambda member: Parcel(1, 1, PACKET_BITS, "hello"))


@pytest.mark.parametrize(("cheat", "rule"), [(Peeks, "farther away"), (SendsTooMuch, "declares 1 bits"),
                                             (AsksAHead, "use Local and Exchange")])  # fmt: skip
def test_a_tracker_without_a_head_that_cheats_is_caught(cheat: Any, rule: str) -> None:
    SEEN.clear()
    with pytest.raises(AssertionError, match=rule):
        check_tracker(cheat())


def test_a_flow_without_a_head_that_requests_one_is_refused_with_its_line() -> None:
    setup = scenario.build(scenario.load("jiang_field", (*FIXED, "tracker.kind=diffusion")))
    with pytest.raises(RunError, match="Gather: without a head, use Local and Exchange"):
        experiment.replicate_of(replace(setup, tracker=AsksAHead()), 0, Memory())


class AsksNeighbours(HeadFilter):
    """Has a head, and requests what only participants without one do."""

    def step(self, belief: Any, scene: Any) -> Any:
        yield Exchange(lambda member: None)
        return belief


def test_a_flow_with_a_head_that_requests_an_exchange_is_refused() -> None:
    setup = scenario.build(scenario.load("jiang_field", (*FIXED, *CENTRAL)))
    with pytest.raises(RunError, match="requests to a head are Local, Compute"):
        experiment.replicate_of(replace(setup, tracker=AsksNeighbours()), 0, Memory())


class NearCoordinate(Coordinate):
    """A linear sensor of finite range."""

    reach: ClassVar[float] = 500.0


@pytest.mark.thorough
def test_covariance_intersection_is_consistent_and_naive_fusion_is_not() -> None:
    def nees(kind: str) -> Any:
        changes = (*FIXED, "duration=6 s", "record.events=false", f"tracker.kind={kind}")
        setup = scenario.build(scenario.load("jiang_field", changes))
        setup = replace(setup, sensor=NearCoordinate(sd=2.0), filter_sensor=NearCoordinate(sd=2.0))
        memory = Memory()
        for run in range(200):
            experiment.replicate_of(setup, run, memory)
        return memory.table("estimates")["nees"].reshape(200, -1).mean(axis=0)

    upper = chi2.ppf(0.975, 2 * 200) / 200  # of the mean of 200 runs, at each step
    assert (nees("covariance_intersection") <= upper).all()
    assert (nees("naive_fusion")[1:] > upper).all()


def test_there_is_no_bound_for_readings_that_arrived_where_they_arrive_nowhere(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    experiment.run(scenario.load("jiang_field", (*FIXED, "tracker.kind=diffusion")), out=path)
    found = {bound.query.readings: bound.reason for bound in bounds_of_run(path)}
    assert not found.pop("in_range")
    assert all("from neighbour to neighbour" in reason for reason in found.values()) and found
