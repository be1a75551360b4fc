"""Trackers that use what no parcel carried: `check_tracker` catches each of them, although something always arrives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.test_testing import Honest
from wsnsim.base.requests import PACKET_BITS, Compute, Gather, GatherReadings, Local, Parcel, Send
from wsnsim.testing import check_tracker
from wsnsim.testing.table import SECOND


def others(answer, scene):
    """Who else than the head has an answer that arrived."""
    return answer.keys() - {scene.head}


class KeepsReadingsWhileGathering(Honest):
    """The function of a Gather leaves readings in the tracker; they are used once some parcel has arrived."""

    def step(self, belief, scene):
        heap = []

        def parcel_of(member):
            heap.append(member.reading)
            return self.parcel_of(member)

        yield Local(self.work)
        answer = yield Gather(parcel_of)
        return self.moved(belief, sum(heap) if others(answer, scene) else 0.0)


class KeepsReadingsWhileComputing(Honest):
    """The function of a Local does the same."""

    def step(self, belief, scene):
        heap = []

        def work(member):
            self.work(member)
            heap.append(member.reading)

        yield Local(work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(heap) if others(answer, scene) else 0.0)


class SendsItsMember(Honest):
    """The payload is the member itself, of which the head reads what it likes."""

    def parcel_of(self, member):
        return Parcel(member, 1, PACKET_BITS, "seen")

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(member.reading for member, _ in answer.values()))


class SendsAFloatInOneBit(Honest):
    """The parcel declares one bit."""

    def parcel_of(self, member):
        return replace(super().parcel_of(member), packet_bits=1)


class AsksForArrays(Honest):
    """Honest: the mean of the readings that arrived as arrays."""

    bits = PACKET_BITS

    def step(self, belief, scene):
        seen = yield GatherReadings(self.bits)
        yield Compute(10.0)
        return self.moved(belief, float(seen.values.mean()) if seen.ids else 0.0)


class AsksForArraysInOneBit(AsksForArrays):
    """Each reading is sent in a packet of one bit."""

    bits = 1


class AsksNobodyForArrays(AsksForArrays):
    """Readings are asked of nobody, so that nothing is ever sent."""

    def start(self, prior, scene):
        return prior
        yield

    def hand_over(self, belief, scene, successor):
        return belief
        yield

    def step(self, belief, scene):
        yield GatherReadings(who=())
        return self.moved(belief, 0.0)


class KeepsReadingsBesideArrays(AsksForArrays):
    """A Local leaves readings in the tracker, which are used once some array has arrived."""

    def step(self, belief, scene):
        heap = []
        yield Local(lambda member: heap.append(member.reading))
        seen = yield GatherReadings()
        return self.moved(belief, sum(heap) if set(seen.ids) - {scene.head} else 0.0)


class SendsAFloatAsAnInteger(Honest):
    """The parcel declares eight bits, and carries all those of a float in an integer."""

    def parcel_of(self, member):
        return Parcel(int(np.float64(member.reading).view(np.int64)), 1, 8, "seen")

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(float(np.int64(number).view(np.float64)) for number, _ in answer.values()))


class SendsAFloatInSmallIntegers(Honest):
    """The parcel declares eight bits, and carries the 64 of a float in four integers of 16 bits."""

    kind: type = np.uint16

    def parcel_of(self, member):
        pieces = np.array([member.reading]).view(np.uint8)
        pieces = np.unpackbits(pieces).astype(bool) if self.kind is np.bool_ else pieces.view(self.kind)
        return Parcel(tuple(pieces), 1, 8, "seen")

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(self.number(pieces) for pieces, _ in answer.values()))

    def number(self, pieces):
        found = np.array(pieces)
        return float((np.packbits(found) if found.dtype == bool else found).view(np.float64)[0])


class SendsAFloatInTruthValues(SendsAFloatInSmallIntegers):
    """It carries them in 64 truth values."""

    kind = np.bool_


class SendsAFunction(Honest):
    """The payload reads the member when the head calls it."""

    def parcel_of(self, member):
        return Parcel(lambda: member.reading, 1, PACKET_BITS, "seen")

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(reading() for reading, _ in answer.values()))


class SharesACacheBetweenNodes(Honest):
    """Each member adds its reading to a sum that all members see, and sends the sum."""

    cache: dict[int, float] = {}  # noqa: RUF012

    def step(self, belief, scene):
        self.cache.clear()
        return (yield from super().step(belief, scene))

    def parcel_of(self, member):
        self.cache[member.id] = member.reading
        return Parcel(sum(self.cache.values()), 1, PACKET_BITS, "sum")


class UsesWhatAnEarlierStepLeft(Honest):
    """The function of a Local leaves readings in the tracker; the head uses them one step later."""

    heap: list[float] = []  # noqa: RUF012

    def start(self, prior, scene):
        self.heap.clear()
        return (yield from super().start(prior, scene))

    def step(self, belief, scene):
        earlier, self.heap[:] = sum(self.heap), []

        def work(member):
            self.work(member)
            self.heap.append(member.reading)

        yield Local(work)
        answer = yield Gather(self.parcel_of)
        yield Compute(1.0)
        return self.moved(belief, earlier if others(answer, scene) else 0.0)


class HidesReadingsInTheCycles(Honest):
    """The function that declares cycles leaves readings in the tracker."""

    def step(self, belief, scene):
        heap = []

        def cycles(member):
            heap.append(member.reading)
            return 5.0

        yield Local(self.work, cycles)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(heap) if others(answer, scene) else 0.0)


class HandsOverWhatAStepMakes(Honest):
    """A belief has a plan once a step has made one; a handover sends it."""

    def start(self, prior, scene):
        return (yield from super().start(prior, scene)), None

    def step(self, belief, scene):
        after = yield from super().step(belief[0], scene)
        return after, (after.mean, scene.step)

    def hand_over(self, belief, scene, successor):
        mean, _ = belief[1]
        mask = yield Send(successor, Parcel((belief[0], mean), 8, PACKET_BITS, "belief"))
        return belief if mask.all() else None

    def estimate(self, belief):
        return belief[0]

    def forecast(self, belief, scene, ahead):
        return belief[0]


class StepsAtTheNextHeadWithWhatAStepMade(HandsOverWhatAStepMakes):
    """The handover survives a belief without a plan; the first step after it does not."""

    def step(self, belief, scene):
        if scene.head == SECOND[0]:
            belief = belief[0], tuple(belief[1])
        return (yield from super().step(belief, scene))

    def hand_over(self, belief, scene, successor):
        mask = yield Send(successor, Parcel(belief, 8, PACKET_BITS, "belief"))
        return belief if mask.any() else None


class LosesItsCovarianceOnTheWay(Honest):
    """Hands over twice as much as it had, and so no covariance is left when it is handed over twice."""

    def start(self, prior, scene):
        return replace((yield from super().start(prior, scene)), effective=1.0)

    def step(self, belief, scene):
        return replace((yield from super().step(belief, scene)), effective=1.0)

    def hand_over(self, belief, scene, successor):
        mask = yield Send(successor, Parcel(belief, 4, PACKET_BITS, "belief"))
        after = replace(belief, cov=belief.cov * belief.effective, effective=belief.effective - 2.0)
        return after if mask.any() else None


CHEATS = [
    (KeepsReadingsWhileGathering(), "isolation", "were not in them"),
    (KeepsReadingsWhileComputing(), "isolation", "were not in them"),
    (SendsItsMember(), "values", "live Member"),
    (SendsAFloatInOneBit(), "values", "declares 1 bits; what it carries needs at least 8"),
    (AsksForArraysInOneBit(), "values", "declares 1 bits; what it carries needs at least 8"),
    (AsksNobodyForArrays(), "sound", "nothing ever crosses the air"),
    (KeepsReadingsBesideArrays(), "isolation", "were not in them"),
    (SendsAFloatAsAnInteger(), "values", "declares 8 bits"),
    (SendsAFloatInSmallIntegers(), "values", "declares 8 bits"),
    (SendsAFloatInTruthValues(), "values", "declares 8 bits"),
    (SendsAFunction(), "values", "holds a function"),
    (SharesACacheBetweenNodes(), "isolation", "readings of other nodes that it never received"),
    (UsesWhatAnEarlierStepLeft(), "isolation", "were not in them"),
    (HidesReadingsInTheCycles(), "isolation", "were not in them"),
    (HandsOverWhatAStepMakes(), r"early handover \(1 before", "TypeError was raised"),
    (StepsAtTheNextHeadWithWhatAStepMade(), r"early handover \(1 before", "TypeError was raised"),
    (LosesItsCovarianceOnTheWay(), r"early handover \(2 before", "not positive semidefinite"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("cheat", "demand", "reason"), CHEATS, ids=lambda value: type(value).__name__)
def test_a_cheat_that_some_arrived_parcel_covers_is_caught(cheat, demand, reason):
    with pytest.raises(AssertionError, match=rf"demand '{demand}.*({reason})"):
        check_tracker(cheat)


@pytest.mark.thorough
def test_a_tracker_that_asks_for_readings_as_arrays_keeps_the_rules():
    check_tracker(AsksForArrays())


class WeighsByDelays(Honest):
    """Older and farther readings count less."""

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of, deadline=0.03)
        late, far = answer.delays, answer.hops
        later = yield GatherReadings(deadline=0.03)
        return self.moved(belief, sum(answer[i][0] / (1.0 + late[i] + far[i]) for i in answer) + later.delays.sum())


@pytest.mark.thorough
def test_a_tracker_that_uses_delays_and_hops_keeps_the_rules():
    check_tracker(WeighsByDelays())
