"""The policy of appointed clusters: who is appointed, when the cluster must be renewed, and who leads next."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wsnsim.base.arrays import Estimate
from wsnsim.base.network_ports import Appointment, NearNodes, Outlook, SeesGeometry, predicted_path, steps_in
from wsnsim.models.appointed import PRIOR, Appointed, ExpectedInformation
from wsnsim.models.clusters import MovingHead, StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import Processor
from wsnsim.models.links import Disk
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy

MOTION, SENSOR = BoundedVelocity(), AcousticEnergy(reach=60.0)
STATE = np.array([0.0, 40.0, 0.0, 10.0])


def field(positions, able=None, traits=None):
    """A function that finds nodes near a point, as a head's map does."""
    places = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    fit = np.ones(len(places), dtype=np.bool_) if able is None else np.asarray(able)
    constants = np.ones((len(places), 1)) if traits is None else traits

    def near(point, radius):
        ids = np.flatnonzero(np.hypot(*(places - point).T) <= radius)
        return NearNodes(ids, places[ids], constants[ids], fit[ids])

    return near


def outlook(positions, head=0, members=(0,), state=STATE, able=None, sd=0.0, motion=MOTION, sensor=SENSOR):
    forecast = Estimate(np.asarray(state, dtype=np.float64), sd**2 * np.eye(len(state)))
    places = np.asarray(positions, dtype=np.float64)
    return Outlook(
        head, places[head], np.array(members), 1.0, 0.04, forecast, forecast, motion, sensor, 75.0, field(places, able)
    )


def scattered(seed, count=120, side=260.0):
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (count, 2))


def spread_of(ids, positions, point):
    """The mean square error that the readings of nodes leave of a target at a point (2,), written out."""
    total = PRIOR / SENSOR.reach**2 * np.eye(2)
    for node in ids:
        away = point - positions[node]
        distance = np.hypot(*away)
        if distance <= SENSOR.reach:
            one = positions[node][None], np.ones((1, 1))
            around = point[:, None] + 1e-3 * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1]])
            _, slope, variance = SENSOR.linearise(around, *one)
            change = (variance[0, 1::2] - variance[0, 2::2]) / 2e-3 / variance[0, 0]
            total += np.outer(slope[0, :, 0], slope[0, :, 0]) / variance[0, 0] + 0.5 * np.outer(change, change)
    return np.trace(np.linalg.inv(total))


@pytest.mark.parametrize("seed", range(5))
def test_what_readings_are_expected_to_leave_is_that_of_each_node_alone_added_up(seed):
    positions = scattered(seed)
    seen = outlook(positions)
    path = seen.path(STATE, 0.4)
    expected = ExpectedInformation.along(seen, path)
    chosen = np.random.default_rng(seed).random((3, expected.near.ids.size)) < 0.5
    found = expected.spread(chosen)
    for row, some in enumerate(chosen):
        ids = expected.near.ids[some]
        assert found[row] == pytest.approx([spread_of(ids, positions, point) for point in path], rel=1e-6)


def test_without_a_node_the_error_is_that_of_being_somewhere_in_sensing_range():
    seen = ExpectedInformation.along(outlook([[200.0, 200.0]]), STATE[None, [0, 2]])
    assert seen.near.ids.size == 0
    assert seen.spread(np.ones((1, 0), dtype=np.bool_)) == pytest.approx(2 * SENSOR.reach**2 / PRIOR)


def test_an_appointment_covers_the_nodes_near_any_predicted_position():
    positions = scattered(3)
    policy = Appointed(horizon=1.0, margin=7.0)
    rule = policy.appointment(outlook(positions, sd=1.5))
    path = predicted_path(MOTION, STATE, 1.0, 0.04, 25)
    assert (rule.steps, rule.radius, rule.packets) == (25, pytest.approx(60.0 + 7.0 + 2 * 1.5), 2)
    near = [min(np.hypot(*(place - point)) for point in path) <= rule.radius for place in positions]
    assert rule.covers(positions, MOTION).tolist() == near
    assert 0 < sum(near) < len(near)


def test_the_predicted_path_is_that_of_the_motion_model_without_noise():
    truth = STATE.copy()
    for point in predicted_path(MOTION, STATE, 0.0, 0.04, 6):
        assert point.tolist() == truth[[0, 2]].tolist()
        truth = MOTION.advance(truth[:, None], 0.04, 0.0)[:, 0]


@pytest.mark.parametrize(
    ("seconds", "steps"), [(0.0, 1), (0.03, 1), (0.04, 1), (0.08, 2), (0.12, 3), (0.4, 10), (0.439, 10)]
)
def test_a_time_is_as_many_steps_as_begin_in_it(seconds, steps):
    assert steps_in(seconds, 0.04) == steps


@pytest.mark.parametrize("share", [0.3, 0.8, 1.0])
def test_the_cluster_must_be_renewed_if_its_members_would_tell_too_little(share):
    positions, policy = scattered(1), Appointed(share=share)
    near = np.flatnonzero(np.hypot(*(positions - STATE[[0, 2]]).T) <= SENSOR.reach)
    everyone = spread_of(near, positions, STATE[[0, 2]])
    answers = []
    for kept in range(near.size + 1):
        own = spread_of(near[:kept], positions, STATE[[0, 2]])
        answers.append(policy.must_appoint(outlook(positions, members=near[:kept])))
        assert answers[-1] == (everyone < share * own)
    assert not answers[-1], "if all nodes in range are members, nothing is missing"
    assert answers[0], "no member at all is too few"


def test_members_out_of_sensing_range_tell_nothing_and_a_target_out_of_all_ranges_asks_for_nobody():
    positions = [[0.0, 0.0], [200.0, 0.0], [5.0, 5.0], [0.0, -30.0]]
    assert Appointed().must_appoint(outlook(positions, members=(1,)))
    far = np.array([1000.0, 0.0, 1000.0, 0.0])
    assert not Appointed().must_appoint(outlook(positions, state=far))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(8))
def test_the_head_whose_neighbours_would_tell_most_leads_next(seed):
    positions, policy = scattered(seed), Appointed(share=1.0)
    seen = outlook(positions, head=7)
    path = seen.path(STATE, policy.horizon)
    in_range = np.flatnonzero(np.hypot(*(positions - positions[7]).T) <= 75.0)
    score = {}
    for one in in_range:
        neighbours = np.flatnonzero(np.hypot(*(positions - positions[one]).T) <= 75.0)
        score[one] = np.mean([spread_of(neighbours, positions, point) for point in path])
    good = [one for one in in_range if 0.99 * score[one] <= min(score.values())]
    middle = path.mean(axis=0)
    expected = min(good, key=lambda one: np.hypot(*(positions[one] - middle)))
    assert policy.next_head(seen) == (7 if score[7] <= min(score.values()) else expected)


def test_the_head_stays_unless_another_is_better_by_the_share():
    positions = scattered(2)
    seen = outlook(positions, head=7)
    assert Appointed(share=1.0).next_head(seen) != 7
    assert Appointed(share=1e-6).next_head(seen) == 7


def test_only_able_nodes_within_range_of_the_head_lead():
    positions = np.array([[0.0, 0.0], [70.0, 0.0], [80.0, 0.0], [75.0, 10.0], [90.0, 0.0], [78.0, -30.0], [81.0, 25.0]])
    state = np.array([80.0, 0.0, 0.0, 0.0])
    able = np.ones(7, dtype=np.bool_)
    assert Appointed().next_head(outlook(positions, state=state)) == 1
    able[1] = False
    assert Appointed().next_head(outlook(positions, state=state, able=able)) == 0
    assert Appointed().next_head(outlook(positions, state=state, able=np.zeros(7, np.bool_))) is None


def test_a_target_on_a_line_is_weighed_by_its_one_coordinate():
    line = SimpleNamespace(position=(0,), advance=_advanced)
    sensor = SimpleNamespace(reach=30.0, linearise=_distances)
    seen = outlook([[0.0, 0.0], [20.0, 0.0], [100.0, 0.0]], state=[5.0, 1.0], motion=line, sensor=sensor)
    expected = ExpectedInformation.along(seen, seen.path(seen.forecast.mean, 0.08))
    assert expected.near.ids.tolist() == [0, 1]
    assert expected.spread(np.array([[1, 1], [0, 1]])) == pytest.approx(
        np.array([[1 / (2 / 4.0 + PRIOR / 900.0)] * 2, [1 / (1 / 4.0 + PRIOR / 900.0)] * 2])
    )
    assert not Appointed().must_appoint(outlook([[0, 0], [20, 0]], members=(0, 1), state=[5.0, 1.0], motion=line,
                                                sensor=sensor))  # fmt: skip


def test_a_reading_of_several_components_tells_the_sum_of_what_they_tell():
    def linearise(points, positions, traits):
        (n, count), rows = (len(positions), points.shape[1]), np.tile(np.eye(2), (len(positions), 1))
        return np.zeros((2 * n, count)), np.repeat(rows[:, :, None], count, axis=2), np.full((2 * n, count), 4.0)

    seen = outlook([[0.0, 0.0], [20.0, 0.0]], sensor=SimpleNamespace(reach=30.0, linearise=linearise))
    expected = ExpectedInformation.along(seen, STATE[None, [0, 2]])
    assert expected.spread(np.ones((1, 2)))[0, 0] == pytest.approx(2 / (2 / 4.0 + PRIOR / 900.0))


def test_a_number_that_is_not_finite_tells_nothing():
    def linearise(points, positions, traits):
        return np.zeros((2, 1)), np.array([[[np.nan], [0.0]], [[1.0], [0.0]]]), np.ones((2, 1))

    seen = outlook([[0.0, 0.0], [20.0, 0.0]], sensor=SimpleNamespace(reach=30.0, linearise=linearise))
    both, second = ExpectedInformation.along(seen, STATE[None, [0, 2]]).spread(np.array([[1, 1], [0, 1]]))
    assert np.isfinite(both).all() and both == pytest.approx(second)


def test_the_policy_names_its_protocol_and_sees_the_geometry():
    assert Appointed().protocol == "appointing"
    assert isinstance(Appointed(), SeesGeometry)
    assert not any(isinstance(policy, SeesGeometry) for policy in (StrongestSignal(), MovingHead()))
    assert not Appointed().must_hand_over(0, 17)
    assert Appointed().elect([4, 7], [3.0, 8.0], [True, True]) == 7
    able = np.array([True, False, True])
    assert Appointed().successor(np.array([10.0, 0.0]), np.array([[0.0, 0.0], [10.0, 0.0], [30.0, 0.0]]), able) == 0


def test_an_announcement_is_billed_by_what_it_carries():
    assert [Appointment(np.zeros(size), 0.0, 1.0, 1, 5.0).packets for size in (1, 2, 4, 5, 8, 9)] == [2, 2, 2, 3, 3, 4]


def test_a_battery_too_small_for_any_head_is_an_issue():
    setup = SimpleNamespace(
        energy=FirstOrder(battery=1e-9),
        plain_batteries=True,
        head_threshold=1e-6,
        clusters=Appointed(),
        link=Disk(),
        cpu=Processor(),
        sensor=SENSOR,
        dt=0.04,
    )
    assert [issue.path for issue in Appointed().check(setup)] == [("energy", "battery")]


def test_a_horizon_of_more_than_a_thousand_steps_is_an_issue():
    setup = SimpleNamespace(
        energy=FirstOrder(), head_threshold=1e-9, clusters=Appointed(threshold=1e-9), sensor=SENSOR, dt=0.04
    )
    assert not [*Appointed(horizon=40.0).check(setup)]
    (issue,) = Appointed(horizon=1e6).check(setup)
    assert issue.path == ("clusters", "horizon")
    assert "25000000 steps" in issue.message and "at most 1000" in issue.message


def _distances(points, positions, traits):
    """Readings of the coordinate of a target on a line, with a variance of 4."""
    nodes, count = len(positions), points.shape[1]
    return np.zeros((nodes, count)), np.ones((nodes, 1, count)), np.full((nodes, count), 4.0)


def _advanced(states, dt, time):
    """A target on a line, at its constant speed, one step later."""
    return np.array([[states[0, 0] + dt * states[1, 0]], [states[1, 0]]])
