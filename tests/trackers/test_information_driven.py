"""The information-driven tracker: who is asked, who decides, what is sent and billed, and readings that come late."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import wsnsim
from wsnsim.base.requests import Broadcast, Delivery, Gather, Member, Send, all_arrived
from wsnsim.base.tables import KIND, Memory
from wsnsim.models.bearing import Bearing
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.mobility import CoordinatedTurn
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy, Coordinate
from wsnsim.offline.loopback import answer_to, perfect, perform, silent
from wsnsim.testing import Table, check_tracker
from wsnsim.testing.table import FIRST
from wsnsim.trackers import information_driven
from wsnsim.trackers.information_driven import InformationDriven
from wsnsim.trackers.shared import selection
from wsnsim.trackers.shared.mixtures import Hypothesis
from wsnsim.trackers.shared.selection import OUTGOING, SelectionPlan, candidates, first_expected, fits, planned, prepare

EVERY = [InformationDriven(), InformationDriven(keep=0.5, every=3), InformationDriven(keep=1.0, every=1)]
SETTINGS = {
    "at a wall": (BoundedVelocity(bound=44.0), AcousticEnergy()),
    "five columns": (CoordinatedTurn(), Range()),
    "a line": (ConstantAcceleration(), Range()),
    "singular noise": (BoundedVelocity(noise="g_only"), AcousticEnergy()),
    "gains unknown": (BoundedVelocity(), AcousticEnergy().assumed("unknown", True)),
    "no distance": (ConstantVelocity(), Coordinate()),
}


PAIRS = [(name, tracker) for name in SETTINGS for tracker in EVERY]
QUICK = ("no distance", EVERY[1])


@pytest.mark.parametrize(
    ("name", "tracker"), [*[pytest.param(*pair, marks=pytest.mark.thorough) for pair in PAIRS if pair != QUICK], QUICK]
)
def test_it_keeps_the_rules(name, tracker) -> None:
    check_tracker(tracker, *SETTINGS[name])


class Network:
    """The members of a table, what they send, and what the head requests."""

    def __init__(self, tracker, reading_noise=True):
        self.table = Table(BoundedVelocity(), AcousticEnergy(), 3)
        self.tracker, self.members = tracker, self.table.members(FIRST)
        self.step, self.requests, self.belief = 0, [], None
        self.run(tracker.start(replace_cov(self.table.prior, 0.0025), self.scene(0)), silent_log=True)

    def scene(self, steps, ids=FIRST):
        return self.table.scene(self.step, steps, self.members, FIRST[0], ids)

    def run(self, flow, silent_log=False, lose=None):
        seen = []
        options = {} if lose is None else {"lose": lose}

        def noted(request, *others):
            answer = answer_to(request, *others)
            seen.append((request, answer))
            return answer

        self.belief = perform(flow, self.members, FIRST[0], answer_of=noted, **options)
        self.requests = [] if silent_log else seen
        return self.belief

    def forward(self, lose=None):
        self.step += 1
        return self.run(self.tracker.step(self.belief, self.scene(1)), lose=lose)

    def answered(self):
        return next(answer for request, answer in self.requests if isinstance(request, Gather))

    def plans(self):
        return [request.parcel for request, _ in self.requests if isinstance(request, Broadcast)]


def replace_cov(prior, scale):
    return replace(prior, mean=prior.mean - 1.0, cov=prior.cov * scale)


def test_the_plan_is_a_state_and_one_more_packet_and_goes_out_once_while_it_fits() -> None:
    network = Network(InformationDriven(keep=0.6, every=1))
    sent = []
    for _ in range(10):
        network.forward()
        sent += network.plans()
    assert len(sent) == 1 and sent[0].packets == 2 and sent[0].what == "plan"
    assert isinstance(sent[0].payload, SelectionPlan) and not sent[0].payload.state.flags.writeable


def test_members_that_the_plan_does_not_ask_are_silent_and_the_heads_reading_always_counts() -> None:
    network = Network(InformationDriven(keep=0.3, every=1))
    for _ in range(3):
        network.forward()
    assert FIRST[0] in network.answered() and len(network.answered()) < len(FIRST)


def test_a_member_that_missed_the_plan_answers() -> None:
    network = Network(InformationDriven(keep=0.3, every=1))
    network.forward(lose=lambda source, to, parcel: np.full(parcel.packets, parcel.what != "plan"))
    assert set(network.answered()) == set(FIRST)


def test_a_decision_depends_on_the_members_own_memory_alone() -> None:
    network = Network(InformationDriven(keep=0.3, every=1))
    network.forward()
    plan = network.plans()[0].payload
    network.step += 1
    scene = network.scene(1)
    for node, member in network.members.items():
        alone = Member(node, member.position, member.traits, member.reading, [], {}, member.key)
        alone.inbox.append(Delivery("plan", plan, all_arrived(2)))
        nowhere, nothing = np.empty((0, 2)), np.empty((0, 1))
        without_map = replace(
            scene, roster=(), roster_positions=nowhere, roster_traits=nothing, ids=(), positions=nowhere, traits=nothing
        )
        prepare([alone], without_map, 1)
        prepare([member], scene, 1)
        assert (OUTGOING in alone.memory) == (OUTGOING in member.memory)


def test_a_nearer_member_with_the_same_information_is_asked_first() -> None:
    network = Network(InformationDriven())
    point = network.table.truth[0][[0, 2]]
    scene = replace(network.scene(0), packet_joules=lambda distances: 1e-5 + 1e-8 * distances**2)
    those = candidates(point, scene)
    plan = planned(network.belief.mean, np.eye(2), those, 0.5, 1, 0)
    told = np.trace(those.information, axis1=1, axis2=2) / 2.0
    worth = told / those.joules
    asked = worth >= plan.least
    order = np.argsort(-worth)
    assert asked[order[: asked.sum()]].all() and 3 <= asked.sum() < worth.size
    assert (
        told[asked].sum() + np.trace(those.own) / 2 >= 0.5 * (told.sum() + np.trace(those.own) / 2) or asked.sum() == 3
    )


def test_a_plan_that_has_gone_astray_or_asks_far_too_many_does_not_fit() -> None:
    network = Network(InformationDriven())
    scene, spread = network.scene(0), np.eye(2)
    truth = network.table.truth[0]
    those = candidates(truth[[0, 2]], scene)
    plan = planned(truth, spread, those, 0.9, 1, 0)
    assert fits(plan, first_expected(plan).state, spread, those, scene, (0.85, 1.5))
    astray = plan._replace(state=truth + np.array([80.0, 0.0, 60.0, 0.0]))
    assert not fits(astray, first_expected(astray).state, spread, those, scene, (0.85, 1.5))
    everybody = plan._replace(least=0.0)
    assert fits(everybody, first_expected(plan).state, spread, those, scene, (0.85, 9.0))
    assert not fits(everybody, first_expected(plan).state, spread, those, scene, (0.1, 1.0))


def test_readings_that_come_three_in_a_packet_give_the_belief_that_single_ones_give(monkeypatch) -> None:
    monkeypatch.setattr(selection, "PROMPT", 1e300)
    single, packed = Network(InformationDriven(keep=1.0)), Network(InformationDriven(keep=0.999, every=3))
    sizes = []
    for _ in range(4):
        single.forward()
        packed.forward()
        sizes.append(len(packed.answered()))
    assert sizes == [len(FIRST), 1, 1, len(FIRST)]
    assert packed.belief.mean == pytest.approx(single.belief.mean, abs=1e-9)
    assert packed.belief.cov == pytest.approx(single.belief.cov, rel=1e-9)


def test_readings_that_are_worth_much_do_not_wait() -> None:
    network = Network(InformationDriven(keep=0.999, every=3))
    sizes = []
    for _ in range(12):
        network.forward()
        sizes.append(len(network.answered()))
    assert any(1 < size < len(FIRST) for size in sizes), sizes


def test_a_packet_carries_four_readings_and_is_billed_for_the_rest() -> None:
    scene = Network(InformationDriven()).scene(0)
    for count, packets in ((1, 1), (4, 1), (5, 2)):
        sent = selection.readings_parcel([(k, 1.0 + k) for k in range(count)], scene)
        assert (sent.packets, sent.readings, sent.packet_bits) == (packets, count, 96)


def test_hypotheses_that_arrive_whole_go_on_and_the_rest_is_sent_twice_more() -> None:
    network = Network(InformationDriven())
    one = network.belief.mixture[0]
    two = (one._replace(log_weight=np.log(0.7)), Hypothesis(float(np.log(0.3)), one.mean + 50.0, one.cov))
    belief, packets = replace(network.belief, mixture=two), []

    def seventh_lost(source, to, parcel):
        packets.append(parcel.packets)
        return np.arange(8)[-parcel.packets :] != 6

    def handed_over(lose):
        return perform(network.tracker.hand_over(belief, network.scene(0), 31), network.members, FIRST[0], lose)

    after = handed_over(seventh_lost)
    assert packets == [8, 4, 4] and len(after.mixture) == 1 and after.mixture[0].log_weight == 0.0 and after.head == 31
    assert np.array_equal(after.mean, one.mean)
    assert handed_over(silent) is None
    both = handed_over(perfect)
    assert len(both.mixture) == 2


REQUESTED: Counter[str] = Counter()


@wsnsim.part
class Counted(InformationDriven):
    """The tracker, with a count of the packets that its requests put on the air, by name."""

    def start(self, prior, scene):
        REQUESTED.clear()
        return (yield from counted(super().start(prior, scene), scene.head))

    def step(self, belief, scene):
        return (yield from counted(super().step(belief, scene), scene.head))

    def hand_over(self, belief, scene, successor):
        return (yield from counted(super().hand_over(belief, scene, successor), scene.head))


def counted(flow, head):
    answer = None
    while True:
        try:
            request = flow.send(answer)
        except StopIteration as end:
            return end.value
        if isinstance(request, Broadcast | Send):
            REQUESTED[request.parcel.what] += request.parcel.packets
        if isinstance(request, Gather):
            request.parcel_of = counting(request.parcel_of, head)
        answer = yield request


def counting(parcel_of, head):
    def counted_parcel(member):
        parcel = parcel_of(member)
        if parcel is not None and member.id != head:
            REQUESTED[parcel.what] += parcel.packets
        return parcel

    return counted_parcel


def test_members_that_are_appointed_later_get_the_plan_of_the_others() -> None:
    network = Network(InformationDriven(keep=0.3))
    assert network.tracker.announcement(network.belief, network.scene(0)) is None
    network.forward()
    announced = network.tracker.announcement(network.belief, network.scene(0))
    assert announced.packets == 2 and announced.payload is network.belief.plan


@pytest.mark.parametrize("every", [1, 2])
def test_when_several_answer_as_if_they_had_no_plan_it_is_replaced(every, monkeypatch) -> None:
    monkeypatch.setattr(information_driven, "MISSED", 2)
    network = Network(InformationDriven(keep=0.3, every=every))
    network.forward()
    network.forward()
    assert network.belief.plan is not None
    for member in network.members.values():
        member.memory.clear()
    network.forward()
    assert not network.plans() and len(network.answered()) == len(FIRST) and network.belief.plan is None
    network.forward()
    assert len(network.plans()) == 1 and len(network.answered()) < len(FIRST)


def test_members_that_hear_a_plan_with_their_appointment_wait_until_it_is_due(monkeypatch) -> None:
    monkeypatch.setattr(selection, "PROMPT", 1e300)
    network = Network(InformationDriven(keep=0.999, every=2))
    network.forward()
    plan = network.belief.plan
    assert plan.every == 2
    for node in FIRST[1:]:
        network.members[node].memory.clear()
        network.members[node].inbox.append(Delivery("plan", plan, all_arrived(2)))
    network.forward()
    assert set(network.answered()) == {FIRST[0]} and network.belief.plan is plan
    network.forward()
    assert set(network.answered()) == set(FIRST)


def test_a_plan_is_billed_for_each_of_its_numbers() -> None:
    for size, weights, packets in ((4, (0.1, 0.2), 2), (5, (0.1, 0.2), 3), (2, (), 1), (3, (), 2), (6, (0.1, 0.2), 3)):
        assert SelectionPlan(np.zeros(size), weights, 7, 1.0, 2).in_parcel().packets == packets


def test_a_plan_is_replaced_before_its_step_is_ambiguous() -> None:
    network = Network(InformationDriven(keep=0.6))
    scene, truth = network.scene(0), network.table.truth[0]
    those = candidates(truth[[0, 2]], scene)
    for age, kept in ((2**14 - 1, True), (2**14, False)):
        plan = planned(truth, np.eye(2), those, 0.6, 1, scene.step - age)
        assert fits(plan, first_expected(plan).state, np.eye(2), those, scene, (0.2, 9.0)) is kept


def test_members_without_a_reading_of_the_expected_target_are_no_candidates() -> None:
    network = Network(InformationDriven())
    point, scene = network.table.truth[0][[0, 2]], network.scene(0)
    away = np.sqrt(((scene.roster_positions - point) ** 2).sum(axis=1))
    least, reach = np.quantile(away, [0.3, 0.8])
    those = candidates(point, replace(scene, sensor=Bearing(reach=float(reach), least=float(least))))
    has = [row for row, node in enumerate(scene.roster) if least <= away[row] <= reach and node != scene.head]
    assert those.rows.tolist() == has and 0 < len(has) < (away <= reach).sum() - 1


@pytest.mark.thorough
def test_where_nobody_sends_no_reading_counts_and_the_track_is_lost_in_time(monkeypatch) -> None:
    monkeypatch.setattr(information_driven, "outgoing", lambda member: None)
    changes = ["duration=0.6 s", "clusters.patience=0.2 s", "seed=1000"]
    memory = Memory()
    wsnsim.experiment.simulate_run(wsnsim.load("information_driven", changes), recorder=memory)
    estimates, events = memory.table("estimates"), memory.table("events")
    lost = events["time"][events["kind"] == KIND["lost"]]
    assert lost.size and 0.2 < lost[0] <= 0.32
    assert not estimates["readings"][estimates["step"] * 0.04 < lost[0]].any()


@pytest.mark.thorough
@pytest.mark.parametrize("every", [1, 3])
def test_every_packet_is_billed(tmp_path, every) -> None:
    changes = ["duration=4 s", f"tracker.kind={__name__}:Counted", f"tracker.every={every}", "seed=1000"]
    report = wsnsim.experiment.run(
        wsnsim.load("jiang_field", changes), replicates=1, out=tmp_path / "x.h5", progress=None
    )
    events = wsnsim.read(report.out, "events")
    sent = events[events["kind"] == "send"].groupby("what", observed=True)["packets"].sum()
    assert REQUESTED["plan"] >= 2 and REQUESTED["handover"] >= 4 and REQUESTED["reading"] > 50
    assert {name: sent[name] for name in REQUESTED} == dict(REQUESTED)
