"""The particles of a cluster's members, laid end to end: what is shared by the computation, and by no member."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster
from wsnsim.base.requests import Delivery, Member
from wsnsim.kernels.swarm import move_own
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.trackers import pso_mhpf
from wsnsim.trackers.pso_mhpf import PsoMhpf
from wsnsim.trackers.shared.dealing import give
from wsnsim.trackers.shared.readings import particles_parcel
from wsnsim.trackers.shared.stacks import CLOUD, LOG_WEIGHTS, Shares, keep, settle


class Loud(AcousticEnergy):
    """A sensor of somebody else, who inherits and has a likelihood of its own."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return super().log_likelihood(points, readings, positions, traits, owners)


def members_of(*counts: int) -> list[Member]:
    rng = np.random.default_rng(3)
    members = [Member(node, np.zeros(2), np.ones(1), key=node) for node in range(len(counts))]
    for member, count in zip(members, counts, strict=True):
        keep(member, rng.normal(size=(4, count)), rng.normal(size=count))
    return members


def test_particles_stay_end_to_end_while_the_members_hold_what_they_were_given() -> None:
    shares, members = Shares(), members_of(3, 0, 2)
    first, _ = shares.stacked(members, 4)
    held = [member.memory[CLOUD] for member in members]
    again, _ = shares.stacked(members, 4)
    assert again.cloud is first.cloud and again.log_weights is first.log_weights
    again.cloud = again.cloud + 1.0
    again.log_weights = again.log_weights - 2.0
    shares.store(again)
    assert all(member.memory[CLOUD] is cloud for member, cloud in zip(members, held, strict=True))
    assert np.array_equal(np.concatenate([member.memory[CLOUD] for member in members], axis=1), again.cloud)
    assert np.array_equal(np.concatenate([member.memory[LOG_WEIGHTS] for member in members]), again.log_weights)


@pytest.mark.parametrize("change", ["another array", "others", "another order"])
def test_they_are_laid_anew_where_a_member_holds_something_else(change: str) -> None:
    shares, members = Shares(), members_of(3, 3)
    before, _ = shares.stacked(members, 4)
    kept = before.cloud.copy()
    if change == "another array":
        keep(members[1], np.ones((4, 2)), np.zeros(2))
    elif change == "others":
        members = members[:1]
    else:
        members = members[::-1]
    stack, _ = shares.stacked(members, 4)
    assert np.array_equal(stack.cloud, np.concatenate([member.memory[CLOUD] for member in members], axis=1))
    assert stack.offsets[-1] == sum(member.memory[LOG_WEIGHTS].size for member in members)
    stack.cloud[:] = 7.0
    assert np.array_equal(before.cloud, kept), "arrays that were given out earlier are not written to"


@pytest.mark.parametrize("lost", [0, 2])
def test_dealt_particles_are_laid_where_their_member_would_have_put_them(lost: int) -> None:
    """Those that arrived completely are laid beside the member's own at once, others settled first."""

    def dealt() -> list[Member]:
        members = members_of(3, 0, 2)
        del members[1].memory[CLOUD], members[1].memory[LOG_WEIGHTS]
        for member, count in ((members[0], 4), (members[1], 1), (members[0], 2)):
            rng = np.random.default_rng(count)
            sent = particles_parcel(rng.normal(size=(4, count)), rng.normal(size=count))
            mask = np.arange(sent.packets) >= lost
            member.inbox.append(Delivery(sent.what, sent.payload, mask))
        return members

    at_once, settled = dealt(), dealt()
    for member in settled:
        settle(member)
    stack, heard = Shares().stacked(at_once, 4)
    twin, _ = Shares().stacked(settled, 4)
    assert np.array_equal(stack.cloud, twin.cloud) and np.array_equal(stack.log_weights, twin.log_weights)
    assert stack.counts.tolist() == twin.counts.tolist() and heard == [[], [], []]
    assert not any(member.inbox for member in at_once) and stack.counts[0] == (9 if not lost else 5)


def test_what_a_member_gave_away_does_not_change_any_more() -> None:
    shares, members = Shares(), members_of(5)
    shares.stacked(members, 4)
    sent = give(members[0], 2)
    assert sent is not None
    cloud, log_weights = (values.copy() for values in sent.payload)
    for _ in range(2):
        stack, _ = shares.stacked(members, 4)
        stack.cloud[:], stack.log_weights[:] = 9.0, 9.0
        shares.store(stack)
    assert np.array_equal(sent.payload[0], cloud) and np.array_equal(sent.payload[1], log_weights)


@pytest.mark.parametrize(
    "tracker",
    [
        PsoMhpf(particles=60),
        PsoMhpf(particles=60, ranking="likelihood", step_length="dt", iterations=3),
        PsoMhpf(particles=60, random_factors=False, resample_always=True),
    ],
)
def test_one_kernel_does_what_the_kernels_do_in_turn(tracker: PsoMhpf, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(pso_mhpf, "move_own", lambda *given: calls.append(1) or move_own(*given))

    def track(sensor: AcousticEnergy) -> list[np.ndarray]:
        cluster = Cluster(7, BoundedVelocity(start=(-45.0, -5.0, -50.0, -8.0)), sensor, seed=2)
        belief, found = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))[0], []
        for step in range(1, 6):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
            found += [belief.mean, belief.cov, *(member.memory[CLOUD] for member in cluster.members.values())]
        return found

    at_once = track(AcousticEnergy())
    assert calls, "the sensor of an energy has the kernel"
    calls.clear()
    in_turn = track(Loud())
    assert not calls, "a subclass with a likelihood of its own is asked for it"
    for a, b in zip(at_once, in_turn, strict=True):
        assert a == pytest.approx(b, rel=1e-9, abs=1e-9)
