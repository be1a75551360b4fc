"""check_tracker: the shipped trackers pass it, and those that cheat do not."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

from tests.helpers.thorough import thorough
from tests.helpers.tracker_kinds import trackers_of_one_target
from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import PACKET_BITS, Broadcast, Compute, Gather, Local, Member, Parcel, Send
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.scenario.registry import Kind, load_class
from wsnsim.testing import check_tracker
from wsnsim.trackers.bootstrap_pf import CentralPf
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.information_pf import InformationPf
from wsnsim.trackers.parallel_pf import ParallelPf
from wsnsim.trackers.pso_mhpf import PsoMhpf
from wsnsim.trackers.shared.triggers import Event, Stochastic

SHIPPED = [
    PsoMhpf(particles=40),
    PsoMhpf(particles=40, fusion="inverse_variance", feedback=True),
    PsoMhpf(particles=40, acceptance="transition", resample_first=True, handover="gaussian"),
    InformationPf(particles=40),
    InformationPf(particles=40, proposal="cloud", handover="gaussian"),
    ParallelPf(particles=40),
    CentralPf(particles=40),
]
VARIANTS = [
    PsoMhpf(particles=3),
    PsoMhpf(particles=40, measurements="all", estimate_when="before"),
    PsoMhpf(particles=40, acceptance="likelihood", random_factors=False, resample_always=True),
    PsoMhpf(particles=40, step_length="dt", iterations=20),
    PsoMhpf(particles=40, iterations=0, threshold=1.0),
    InformationPf(particles=40, proposal="local"),
    ParallelPf(particles=3, threshold=1.0),
    ParallelPf(particles=40, measurements="own", handover="gaussian"),
    CentralPf(particles=1, handover="gaussian"),
    CentralPf(particles=40, late="refilter"),
    ExtendedKalman(late="retrodict"),
    ExtendedKalman(trigger=Event()),
    ExtendedKalman(trigger=Stochastic(shared_every=3)),
]


@pytest.mark.thorough(fast=["PsoMhpf2", "InformationPf0", "ExtendedKalman0", "ExtendedKalman2"])
@pytest.mark.parametrize("tracker", [*SHIPPED, *thorough(VARIANTS)], ids=lambda tracker: type(tracker).__name__)
def test_every_shipped_tracker_and_variant_keeps_the_rules(tracker: Any) -> None:
    check_tracker(tracker)


SETTINGS: dict[str, tuple[Any, Any]] = {
    "the plane of Jiang": (BoundedVelocity(), AcousticEnergy()),
    "a line and ranges": (ConstantAcceleration(), Range()),
    "a room and RSSI": (ConstantVelocity(noise_input="diagonal", variances=(0.5,)), Rssi(reach=100.0)),
    "one column and its square": (Ungm(), Squared()),
    "the plane and bearings": (BoundedVelocity(), Bearing()),
    "the plane, ranges with bearings": (BoundedVelocity(), RangeBearing(heading="own")),
}
LOCATING = ("trilateration", "gmtt", "tsstp", "cluster", "ris")
"""These need distances, in a plane."""
CANNOT = {
    ("ipf", "a line and ranges"),  # its weights need a density, and this process noise has none
    *(("grid", name) for name in SETTINGS if name != "one column and its square"),
    *((kind, name) for kind in LOCATING for name in SETTINGS if name != "a room and RSSI"),
    *((kind, "the plane, ranges with bearings") for kind in ("rkf", "imsf")),  # one number a reading
}


def _pairs_of_tracker_and_setting():
    """All pairs of a tracker and a setting, those that the tracker refuses included."""
    for row in trackers_of_one_target():
        usable = [name for name in SETTINGS if (row.kind, name) not in CANNOT]
        for name in SETTINGS:
            marks = () if name not in usable[1:] else pytest.mark.thorough
            yield pytest.param(row, name, id=f"{row.kind}-{name}", marks=marks)


@pytest.mark.thorough(fast=["grid-a line and ranges"])
@pytest.mark.parametrize(("row", "setting"), list(_pairs_of_tracker_and_setting()))
def test_every_tracker_of_the_catalogue_keeps_the_rules_with_every_model_it_can_use(row: Kind, setting: str) -> None:
    part = load_class(row)
    fewer = {"particles": 20, "cells": 300}
    tracker = part(**{f.name: fewer[f.name] for f in fields(part) if f.name in fewer})
    if (row.kind, setting) in CANNOT:
        with pytest.raises(AssertionError, match=r"demand 'sound': .* was raised"):
            check_tracker(tracker, *SETTINGS[setting])
    else:
        check_tracker(tracker, *SETTINGS[setting])


@dataclass(frozen=True)
class Honest:
    """The mean of the readings that arrived moves the estimate; every member keeps count of its steps."""

    def start(self, prior, scene):
        yield Broadcast(Parcel(None, 1, PACKET_BITS, "hello"))
        return prior

    def step(self, belief, scene):
        yield Local(self.work, 5.0, self.work_all)
        answer = yield Gather(self.parcel_of)
        yield Compute(10.0)
        values = [payload for payload, _ in answer.values()]
        return self.moved(belief, sum(values) / len(values) if values else 0.0)

    def hand_over(self, belief, scene, successor):
        mask = yield Send(successor, Parcel(belief, 4, PACKET_BITS, "belief"))
        return belief if mask.all() else None

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return belief

    def moved(self, belief, by):
        return Estimate(belief.mean + 1e-3 * by, belief.cov)

    def work(self, member):
        member.inbox.clear()
        member.memory["seen"] = np.append(member.memory.get("seen", np.empty(0)), member.reading)

    def work_all(self, members):
        for member in members:
            self.work(member)

    def parcel_of(self, member):
        return Parcel(float(member.memory["seen"][-1]), 1, PACKET_BITS, "seen")


class ReadsThroughAClosure(Honest):
    """Remembers the members that it has worked on, and looks at them later."""

    known: dict[int, Member] = {}  # noqa: RUF012

    def work(self, member):
        super().work(member)
        others = [other.reading for other in self.known.values() if other.id != member.id]
        member.memory["stolen"] = sum(reading or 0.0 for reading in others)
        self.known[member.id] = member

    def step(self, belief, scene):
        yield Local(self.work)
        return belief


class SharesADictionary(Honest):
    """Members leave their readings where all can see them."""

    board: dict[int, float] = {}  # noqa: RUF012

    def work(self, member):
        super().work(member)
        self.board[member.id] = member.reading
        member.memory["stolen"] = max(self.board.values())


class MixesInWorkAll(Honest):
    """The work of the whole cluster is not that of its members."""

    def work_all(self, members):
        super().work_all(members)
        for member in members:
            member.memory["mean"] = np.mean([other.reading for other in members])


class ChangesOthers(Honest):
    """Writes into whoever came before."""

    known: list[Member] = []  # noqa: RUF012

    def work(self, member):
        super().work(member)
        for other in self.known:
            if other is not member:
                other.memory["mark"] = member.id
        self.known[:] = [member]


class TellsTheHeadWithoutAPacket(Honest):
    """The head uses what work left in the tracker itself."""

    heap: list[float] = []  # noqa: RUF012

    def step(self, belief, scene):
        self.heap.clear()
        belief = yield from super().step(belief, scene)
        return self.moved(belief, sum(self.heap))

    def work(self, member):
        super().work(member)
        self.heap.append(member.reading)


class TakesArrivalForGranted(Honest):
    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        return self.moved(belief, sum(answer[node][0] for node in scene.ids))


class DividesByWhatArrived(Honest):
    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        share = np.float64(1.0) / len(answer) if scene.ids else 0.0
        return self.moved(belief, share)


class InsistsOnWholeParcels(Honest):
    def parcel_of(self, member):
        return replace(super().parcel_of(member), packets=2)

    def step(self, belief, scene):
        yield Local(self.work)
        answer = yield Gather(self.parcel_of)
        if not all(mask.all() for _, mask in answer.values()):
            raise ValueError("half a parcel")
        return belief


class ForgetsThatParcelsHaveBits(Honest):
    def parcel_of(self, member):
        return replace(super().parcel_of(member), packets=0)


class SendsNothing(Honest):
    def start(self, prior, scene):
        yield Compute(1.0)
        return prior

    def step(self, belief, scene):
        yield Compute(1.0)
        return belief

    def hand_over(self, belief, scene, successor):
        yield Compute(1.0)
        return belief


class IsNoNumber(Honest):
    def moved(self, belief, by):
        return Estimate(belief.mean * np.nan, belief.cov)


class HasNoCovariance(Honest):
    def estimate(self, belief):
        return Estimate(belief.mean, belief.cov - 5.0 * np.eye(4))


class IsLopsided(Honest):
    def estimate(self, belief):
        return Estimate(belief.mean, belief.cov + np.triu(np.ones((4, 4)), 1))


class ChargesNonsense(Honest):
    def step(self, belief, scene):
        yield Local(self.work, lambda member: float("nan"))
        return belief


class ThrowsDice(Honest):
    rng = np.random.default_rng()

    def moved(self, belief, by):
        return Estimate(belief.mean + self.rng.normal(size=4), belief.cov)


class AsksForTheMoon(Honest):
    def step(self, belief, scene):
        yield "the moon"
        return belief


@pytest.mark.thorough
def test_an_honest_stranger_passes() -> None:
    check_tracker(Honest())


@pytest.mark.thorough(fast=["IsLopsided--"])
@pytest.mark.parametrize(
    ("cheat", "demand", "reason"),
    [
        (ReadsThroughAClosure(), "privacy", "depends on what others hold"),
        (SharesADictionary(), "privacy", "depends on what others hold"),
        (MixesInWorkAll(), "privacy", "work_all and work differ"),
        (ChangesOthers(), "privacy", "changed node"),
        (TellsTheHeadWithoutAPacket(), "silence", "readings of other members"),
        (TakesArrivalForGranted(), "silence", "KeyError"),
        (DividesByWhatArrived(), "silence", "RuntimeWarning"),
        (InsistsOnWholeParcels(), "loss", "half a parcel"),
        (ForgetsThatParcelsHaveBits(), "sound", "packets: expected|packet_bits: expected"),
        (SendsNothing(), "sound", "nothing ever crosses the air"),
        (IsNoNumber(), "sound", "mean is not finite"),
        (HasNoCovariance(), "sound", "not positive semidefinite"),
        (IsLopsided(), "sound", "not symmetric"),
        (ChargesNonsense(), "sound", "not a number of cycles"),
        (ThrowsDice(), "repeatable", "two different tracks"),
        (AsksForTheMoon(), "sound", "is not a request"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Honest) else "",
)
def test_a_cheat_is_caught_by_name(cheat: Honest, demand: str, reason: str) -> None:
    with pytest.raises(AssertionError, match=rf"demand '{demand}.*({reason})"):
        check_tracker(cheat)
