"""Clocks, sensors that report badly, processors, sinks."""

from types import SimpleNamespace

import numpy as np
import pytest

from wsnsim.base.rng import derive_all
from wsnsim.models.bounds import truncated_normals
from wsnsim.models.hardware import DriftingClock, ImperfectDetection, PerfectClock, PerfectDetection, Processor
from wsnsim.models.workloads import NearestNode, NoSink

KEYS = derive_all(7, np.arange(200_000))


def test_no_time_passes_unless_the_processor_has_a_rate():
    assert Processor().seconds(1e9) == 0.0
    assert Processor(rate=8e6).seconds(4e6) == 0.5
    assert Processor().cycles_per_flop == 1.0


def test_truncated_normals_are_normal_within_three_deviations():
    """Against the exact variance and the exact share within one deviation: 0.6827 / 0.9973."""
    draws = truncated_normals(KEYS)
    assert np.abs(draws).max() <= 3.0
    assert draws.mean() == pytest.approx(0.0, abs=4 / np.sqrt(draws.size))
    assert draws.var() == pytest.approx(0.97334, rel=4 * np.sqrt(2 / draws.size))
    assert np.mean(np.abs(draws) < 1) == pytest.approx(0.682689 / 0.997300, abs=4 * np.sqrt(0.25 / draws.size))


def test_a_draw_depends_on_its_own_key_alone():
    some = np.arange(0, KEYS.size, 7)
    assert np.array_equal(truncated_normals(KEYS)[some], truncated_normals(KEYS[some]))


def test_clocks_drift_within_ninety_parts_in_a_million():
    rates = DriftingClock().rates(KEYS) - 1.0
    assert np.abs(rates).max() <= 90.0000001e-6
    assert rates.std() == pytest.approx(30e-6 * np.sqrt(0.97334), rel=0.01)
    assert np.array_equal(PerfectClock().rates(KEYS[:3]), np.ones(3))
    assert np.array_equal(DriftingClock(sd=0.0).rates(KEYS[:3]), np.ones(3))


def test_perfect_sensors_report_what_they_measure():
    readings = np.array([1.0, -2.0, 3.5])
    assert np.array_equal(PerfectDetection().distort(readings, KEYS[:3]), readings)
    assert np.array_equal(ImperfectDetection().distort(readings, KEYS[:3]), readings)
    assert PerfectDetection().missed == PerfectDetection().false_alarm == 0.0


@pytest.mark.thorough
def test_a_nodes_bias_is_its_own_and_lasts():
    sensor = ImperfectDetection(bias_sd=2.0)
    off = sensor.distort(np.full(KEYS.size, 10.0), KEYS) - 10.0
    assert off.std() == pytest.approx(2.0, rel=0.01)
    assert sensor.distort(np.full(KEYS.size, 50.0), KEYS) - 50.0 == pytest.approx(off)


def test_stuck_nodes_report_the_same_whatever_they_measure():
    sensor = ImperfectDetection(stuck=0.25, stuck_at=-1.0, bias_sd=1.0)
    first, second = (sensor.distort(np.full(KEYS.size, value), KEYS) for value in (10.0, 20.0))
    stuck = first == -1.0
    assert stuck.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.1875 / KEYS.size))
    assert np.array_equal(stuck, second == -1.0)
    bias = first[~stuck] - 10.0
    assert bias.mean() == pytest.approx(0.0, abs=4 / np.sqrt(bias.size))  # who is stuck says nothing of the bias,
    assert bias.var() == pytest.approx(1.0, rel=4 * np.sqrt(2 / bias.size))  # nor of its size
    assert np.all(ImperfectDetection(stuck=1.0).distort(np.ones(100), KEYS[:100]) == 0.0)


def test_a_sink_is_a_place_or_nobody():
    assert NoSink().point is None
    assert NearestNode(x=3.0, y=-4.0).point == (3.0, -4.0)
    assert NearestNode().bits == 96
    assert NoSink().every is None
    assert NearestNode().every is None


@pytest.mark.parametrize(("every", "step", "whole"), [
    (None, 2.0, True), (10.0, 2.0, True), (2.0, 2.0, True), (0.3, 0.1, True), (1e6, 0.1, True),
    (10.0, 3.0, False), (1.0, 2.0, False), (2.0001, 2.0, False), (1e-3, 2.0, False),
])  # fmt: skip
def test_reports_are_due_every_whole_number_of_steps(every, step, whole):
    sink = NearestNode(every=every)
    found = list(sink.check(SimpleNamespace(dt=step)))
    assert [issue.path for issue in found] == ([] if whole else [("sink", "every")])
    assert all(f"{every:g} s must be a whole number of steps of {step:g} s" in issue.message for issue in found)
