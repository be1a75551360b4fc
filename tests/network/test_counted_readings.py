"""The readings that enter an estimate are counted by what parcels declare, with a network and without one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.helpers.centroid_network import Centroid, Run, network_setup, standing
from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import PACKET_BITS, Gather, GatherReadings, Local, Member, Parcel
from wsnsim.offline.loopback import perform
from wsnsim.offline.offline_run import RequestCosts

NODES = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0)]


class Sends(Centroid):
    """A centroid tracker whose members send their readings in another form."""

    def __init__(self, parcel_of: Callable[[Member], Parcel]) -> None:
        super().__init__()
        self._parcel_of = parcel_of

    def step(self, belief, scene):
        answer = yield Gather(self._parcel_of)
        return belief if len(answer) < 4 else None


FORMS = {
    "as it is": (lambda member: Parcel(member.reading, 1, PACKET_BITS, "reading"), 3),
    "in single precision": (lambda member: Parcel(np.float32(member.reading), 1, PACKET_BITS, "reading"), 3),
    "in whole numbers": (lambda member: Parcel(np.int16(100 * member.reading), 1, PACKET_BITS, "reading"), 3),
    "in a tuple, declared": (lambda member: Parcel((member.reading, 1), 1, PACKET_BITS, "pair", readings=1), 3),
    "the mean of two": (lambda member: Parcel(member.reading, 1, PACKET_BITS, "mean", readings=2), 6),
    "a number that is no reading": (lambda member: Parcel(7.0, 1, PACKET_BITS, "count", readings=0), 0),
    "an estimate": (lambda member: Parcel(np.zeros(4), 1, PACKET_BITS, "estimate"), 0),
}


@pytest.mark.parametrize("form", FORMS)
def test_readings_are_counted_in_a_network_by_declaration(form):
    parcel_of, count = FORMS[form]
    run = Run(network_setup(steps=3, tracker=Sends(parcel_of)), NODES, [standing((5.0, 5.0), 3)])
    assert run.memory.table("estimates")["readings"].tolist() == [count] * 3
    assert np.isfinite(run.memory.table("estimates")["error"]).all()


@pytest.mark.parametrize("form", FORMS)
def test_readings_are_counted_without_a_network_by_declaration(form):
    parcel_of, count = FORMS[form]
    members = {node: Member(node, np.zeros(2), np.ones(1), 2.5) for node in range(3)}
    costs, request = RequestCosts(), Gather(parcel_of)

    def flow():
        for _ in range(2):
            yield request
        return Estimate(np.zeros(4), np.eye(4))

    perform(flow(), members, 0, answer_of=costs.answer)
    assert costs.readings == count and request.parcel_of is parcel_of


def test_a_member_without_a_reading_carries_none():
    assert Parcel(1.0, 1, PACKET_BITS, "reading", readings=1).readings_of(Member(0, np.zeros(2), np.ones(1))) == 0


class Arrays(Centroid):
    """A centroid tracker that asks for readings as arrays."""

    def step(self, belief, scene):
        self.answers.append((yield GatherReadings()))
        return belief


def test_readings_that_come_as_arrays_are_counted_in_a_network():
    tracker = Arrays()
    run = Run(network_setup(steps=3, tracker=tracker), NODES, [standing((5.0, 5.0), 3)])
    assert run.memory.table("estimates")["readings"].tolist() == [3] * 3
    assert [sorted(answer.ids) for answer in tracker.answers] == [[0, 1, 2]] * 3


def test_readings_that_come_as_arrays_are_counted_without_a_network():
    members = {node: Member(node, np.zeros(2), np.ones(1), 2.5) for node in range(3)}
    costs = RequestCosts()

    def flow():
        yield GatherReadings()

    perform(flow(), members, 0, answer_of=costs.answer)
    assert (costs.readings, costs.frames, costs.packets) == (3, 2, 2)


class Decides(Centroid):
    """A centroid tracker whose members decide in a `Local` that nobody sends; they may have used their readings."""

    def __init__(self, uses_readings: bool) -> None:
        super().__init__()
        self._uses = uses_readings

    def step(self, belief, scene):
        yield Local(lambda member: None, uses_readings=self._uses)
        yield Gather(lambda member: None)
        return belief


@pytest.mark.parametrize(("uses", "count"), [(True, 3), (False, 0)])
def test_members_that_only_decide_and_send_nothing_have_no_reading_in_the_estimate(uses, count):
    run = Run(network_setup(steps=3, tracker=Decides(uses)), NODES, [standing((5.0, 5.0), 3)])
    assert run.memory.table("estimates")["readings"].tolist() == [count] * 3
    members = {node: Member(node, np.zeros(2), np.ones(1), 2.5) for node in range(3)}
    costs, local = RequestCosts(), Local(lambda member: None, uses_readings=uses)

    def flow():
        yield local

    perform(flow(), members, 0, answer_of=costs.answer)
    assert costs.readings == count
