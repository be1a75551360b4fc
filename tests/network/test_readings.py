"""What sensors report, rightly and wrongly: against brute force, against the sensor's own law, and by counting."""

import numpy as np
import pytest
from scipy import stats

from wsnsim.base.arrays import components_of
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.rng import derive
from wsnsim.models.hardware import DriftingClock, ImperfectDetection, PerfectClock, PerfectDetection
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.network.clocks import Clocks
from wsnsim.network.imperfect_readings import Imperfections, ImperfectSensors, _sampled
from wsnsim.network.sensing import Readings, Reports, SensorArray

DT = 0.5
RULER = Range(sd=1e-6, reach=60.0)
"""A sensor whose reading is the distance."""


def sensors(positions, model, key=5):
    return SensorArray(positions, np.ones((len(positions), 1)), model, CellGrid(positions), key)


def sensed(points, positions, key=5, target=0):
    sensor = AcousticEnergy()
    return Readings(sensors(positions, sensor, key), target, points)


def test_who_senses_when_is_what_brute_force_finds():
    rng = np.random.default_rng(2)
    positions, points = rng.uniform(-200, 200, (300, 2)), rng.uniform(-200, 200, (20, 2))
    found = sensed(points, positions)
    for step, point in enumerate(points):
        near = np.flatnonzero(np.linalg.norm(positions - point, axis=1) <= 60.0).tolist()
        assert found.ids[step] == near
        before = np.flatnonzero(np.linalg.norm(positions - points[step - 1], axis=1) <= 60.0).tolist() if step else []
        assert found.appeared(step) == sorted(set(near) - set(before))
        assert found.vanished(step) == sorted(set(before) - set(near))


def test_a_reading_depends_on_target_step_and_node_but_not_on_who_else_is_there():
    rng = np.random.default_rng(3)
    positions, points = rng.uniform(-50, 50, (40, 2)), rng.uniform(-10, 10, (5, 2))
    all_of_them = sensed(points, positions)
    first_ten = sensed(points, positions[:10])
    for step in range(5):
        whole = all_of_them.readings(step)
        assert {node: whole[node] for node in range(10)} == first_ten.readings(step)
    values = [value for step in range(5) for value in all_of_them.readings(step).values()]
    assert len(set(values)) == len(values)
    assert all_of_them.readings(0) != sensed(points, positions, target=1).readings(0)


def test_a_target_out_of_everybodys_range_is_sensed_by_nobody():
    found = sensed(np.array([[500.0, 500.0], [0.0, 0.0]]), np.array([[0.0, 10.0]]))
    assert found.readings(0) == {} and list(found.readings(1)) == [0] and found.appeared(1) == [0]


def imperfect(points, positions, sensor=None, detection=None, clock=None, target=0, **changes):
    sensor = sensor or AcousticEnergy()
    clocks = Clocks(clock or PerfectClock(), 4, len(positions))
    made = Imperfections(detection or PerfectDetection(), clocks, DT)
    take = ImperfectSensors(sensors(positions, sensor), target, points, made).take
    return Reports(take, made.defects, components_of(sensor)), made


def crowd(steps=40, nodes=300, seed=2):
    """A target that wanders among nodes."""
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 8, (steps, 2)), axis=0), rng.uniform(-200, 200, (nodes, 2))


@pytest.mark.parametrize("sensor", [AcousticEnergy(), RULER, Range(reach=60.0, own_cell=True)])
def test_imperfections_that_are_none_leave_every_bit_as_it_was(sensor):
    points, positions = crowd()
    plain = Readings(sensors(positions, sensor), 1, points)
    same, made = imperfect(points, positions, sensor, target=1)
    assert not made.matter()
    for step in range(len(points)):
        assert same.vanished(step) == plain.vanished(step) and same.appeared(step) == plain.appeared(step)
        assert list(same.readings(step).items()) == list(plain.readings(step).items())


@pytest.mark.parametrize(
    "detection", [ImperfectDetection(missed=0.1), ImperfectDetection(false_alarm=0.1), ImperfectDetection(bias_sd=1.0)]
)
def test_each_imperfection_matters(detection):
    assert imperfect(*crowd(), detection=detection)[1].matter()
    assert imperfect(*crowd(), clock=DriftingClock())[1].matter()


def test_readings_are_missed_as_often_as_stated_and_the_others_are_what_they_were():
    points, positions = crowd(steps=200)
    every, _ = imperfect(points, positions)
    some, _ = imperfect(points, positions, detection=ImperfectDetection(missed=0.3))
    few, _ = imperfect(points, positions[:20], detection=ImperfectDetection(missed=0.3))
    taken = possible = 0
    for step in range(200):
        whole, part = every.readings(step), some.readings(step)
        assert part == {node: whole[node] for node in part}
        assert few.readings(step) == {node: value for node, value in part.items() if node < 20}
        taken, possible = taken + len(part), possible + len(whole)
    assert taken / possible == pytest.approx(0.7, abs=4 * (0.21 / possible) ** 0.5)


def test_who_began_and_who_ceased_to_report_add_up_to_who_reports():
    detection = ImperfectDetection(missed=0.2, false_alarm=0.02)
    found, _ = imperfect(*crowd(), detection=detection, clock=DriftingClock(sd=0.01))
    reporting: set[int] = set()
    for step in range(40):
        reporting -= set(found.vanished(step))
        assert not reporting & set(found.appeared(step))
        reporting |= set(found.appeared(step))
        assert sorted(reporting) == list(found.readings(step))


@pytest.mark.thorough
def test_false_alarms_come_as_often_as_stated_from_nodes_out_of_range_and_from_anywhere_in_their_reach():
    points, positions = crowd(steps=400)
    true, _ = imperfect(points, positions, RULER)
    both, _ = imperfect(points, positions, RULER, ImperfectDetection(false_alarm=0.02))
    phantoms, chances = [], 0
    for step in range(400):
        in_range = true.readings(step)
        reported = both.readings(step)
        assert {node: reported[node] for node in in_range} == in_range
        phantoms += [value for node, value in reported.items() if node not in in_range]
        chances += len(positions) - len(in_range)
    assert len(phantoms) / chances == pytest.approx(0.02, abs=4 * (0.02 / chances) ** 0.5)
    # Uniform in a disc: the square of the distance is uniform.
    assert stats.kstest((np.array(phantoms) / 60.0) ** 2, "uniform").pvalue > 1e-3


def test_a_phantom_on_a_line_stands_where_the_node_can_sense_it():
    points, positions = np.full((300, 1), 500.0), np.array([[0.0, 36.0], [10.0, 0.0], [0.0, 90.0]])
    found, _ = imperfect(points, positions, RULER, ImperfectDetection(false_alarm=0.5))
    values = [found.readings(step) for step in range(300)]
    near = np.array([value[0] for value in values if 0 in value])
    assert near.size > 100 and near.min() >= 36.0 - 1e-4 and near.max() <= 60.0 + 1e-4
    # Uniform on the chord of half-length 48 m.
    assert stats.kstest(np.sqrt(np.maximum(near**2 - 36.0**2, 0.0)) / 48.0, "uniform").pvalue > 1e-3


@pytest.mark.thorough
def test_the_chosen_are_independent_draws_and_cost_as_much_as_they_are():
    chosen = [_sampled(derive(9, step), 0.25, 40) for step in range(4000)]
    hits = np.array([np.isin(np.arange(40), ids) for ids in chosen])
    assert np.abs(hits.mean(axis=0) - 0.25).max() < 4.5 * (0.1875 / 4000) ** 0.5
    together = (hits[:, :-1] & hits[:, 1:]).mean()
    assert together == pytest.approx(0.0625, abs=0.003)
    # Of 10^12 nodes nobody can draw one by one.
    assert 5 <= np.mean([_sampled(derive(9, step), 1e-11, 10**12).size for step in range(50)]) <= 15
    assert _sampled(9, 0.0, 5).size == 0 and _sampled(9, 1.0, 3).tolist() == [0, 1, 2]


def test_a_nodes_bias_is_the_same_at_every_step_and_for_every_target():
    points, positions = crowd(steps=10)
    exact = [imperfect(points, positions, RULER, target=target)[0] for target in (0, 1)]
    biased = [
        imperfect(points, positions, RULER, ImperfectDetection(bias_sd=3.0), target=target)[0] for target in (0, 1)
    ]
    offsets: dict[int, list[float]] = {}
    for right, wrong in zip(exact, biased, strict=True):
        for step in range(10):
            for node, value in wrong.readings(step).items():
                offsets.setdefault(node, []).append(value - right.readings(step)[node])
    assert max(np.ptp(values) for values in offsets.values()) < 1e-9
    assert np.std([values[0] for values in offsets.values()]) > 1.0


def standing_next_to(nodes=3, steps=8):
    points = np.column_stack([np.arange(steps) * 2.0, np.zeros(steps)])
    return points, np.array([[0.0, 10.0 + node] for node in range(nodes)])


def test_a_biased_sensor_is_off_by_a_constant_while_the_fault_lasts_and_biases_add_up():
    points, positions = standing_next_to()
    right, _ = imperfect(points, positions, RULER)
    wrong, made = imperfect(points, positions, RULER)
    for step in range(8):
        if step == 2:
            made.defects[0] = SensorDefect(frozenset({1}), offset=5.0)
        if step == 4:
            made.defects[1] = SensorDefect(frozenset({1, 2}), offset=-2.0)
        if step == 6:
            del made.defects[0]
        offset = {0: 0.0, 1: 5.0 * (2 <= step < 6) - 2.0 * (step >= 4), 2: -2.0 * (step >= 4)}
        good = right.readings(step)
        assert wrong.readings(step) == pytest.approx({node: good[node] + offset[node] for node in good}, abs=1e-12)


def test_a_stuck_sensor_repeats_what_it_read_last_or_what_it_is_told_until_the_fault_has_passed():
    points, positions = standing_next_to()
    right, _ = imperfect(points, positions, RULER)
    wrong, made = imperfect(points, positions, RULER)
    read = []
    for step in range(8):
        if step == 3:
            made.defects[0] = SensorDefect(frozenset({0}), stuck=True)
            made.defects[1] = SensorDefect(frozenset({1}), stuck=True, value=99.0)
        if step == 6:
            made.defects.clear()
        read.append(wrong.readings(step))
    good = [right.readings(step) for step in range(8)]
    assert [values[0] for values in read] == [good[step if step < 3 or step >= 6 else 2][0] for step in range(8)]
    assert [values[1] for values in read] == [99.0 if 3 <= step < 6 else good[step][1] for step in range(8)]
    assert [values[2] for values in read] == [values[2] for values in good]


def test_of_defects_that_overlap_biases_add_up_and_the_sensor_that_was_stuck_last_decides():
    node = frozenset({0})
    defects = {}
    reports = Reports(lambda step: {0: float(step)}, defects)
    defects[2] = SensorDefect(node, stuck=True, value=7.0)
    assert reports.at(0) == {0: 7.0}
    defects[0] = SensorDefect(node, offset=10.0)
    defects[1] = SensorDefect(node, stuck=True, value=8.0)
    assert reports.at(1) == {0: 8.0}
    del defects[1]
    assert reports.at(2) == {0: 7.0}
    del defects[2]
    defects[3] = SensorDefect(node, offset=0.5)
    assert reports.at(3) == {0: 13.5}


def test_a_sensor_stuck_before_it_ever_read_repeats_its_first_reading_and_only_where_it_senses():
    points = np.column_stack([np.arange(8) * 30.0 - 120.0, np.zeros(8)])
    found, made = imperfect(points, np.array([[0.0, 0.0]]), RULER)
    made.defects[0] = SensorDefect(frozenset({0}), stuck=True)
    values = [found.readings(step) for step in range(8)]
    assert [len(value) for value in values] == [0, 0, 1, 1, 1, 1, 1, 0]
    read = [value[0] for value in values if value]
    assert read[0] == pytest.approx(60.0, abs=1e-4) and len(set(read)) == 1


@pytest.mark.thorough(fast=["1.0"])
@pytest.mark.parametrize("offset", [0.7, -0.7, 1.0, 100.0, -100.0])
def test_a_clock_that_is_wrong_reads_the_target_where_it_is_when_the_clock_shows_the_time(offset):
    points = np.column_stack([np.arange(30) * 7.0, np.arange(30) ** 2 * 0.2])
    positions = np.random.default_rng(1).uniform(-20, 220, (60, 2))
    found, made = imperfect(points, positions, RULER)
    wrong = range(0, 60, 2)
    made.clocks.step(wrong, offset)
    times = np.arange(30) * DT
    for step in range(30):
        expected = {}
        for node in range(60):
            seen = times[step] - (offset if node % 2 == 0 else 0.0)
            place = [np.interp(seen, times, points[:, 0]), np.interp(seen, times, points[:, 1])]
            distance = np.linalg.norm(positions[node] - place)
            if distance <= 60.0:
                expected[node] = distance
        assert found.readings(step) == pytest.approx(expected, abs=1e-4)


def test_a_sensor_with_a_cell_of_its_own_keeps_it_when_its_clock_is_wrong():
    points, positions = crowd(steps=20)
    cells = Range(reach=60.0, own_cell=True)
    found, made = imperfect(points, positions, cells)
    made.clocks.step(range(300), DT)
    right, _ = imperfect(points, positions, cells)
    assert [list(found.readings(step)) for step in range(1, 20)] == [list(right.readings(step)) for step in range(19)]
