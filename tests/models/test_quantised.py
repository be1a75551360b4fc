"""Readings in cells: binary detection, and quantised readings with thresholds that are fixed or about a prediction."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

import wsnsim
from tests.helpers.scenes import make_scene
from wsnsim.analysis import setup_notes
from wsnsim.base.requests import Broadcast, Gather, GatherReadings, Member
from wsnsim.bounds import bound
from wsnsim.models.bearing import Bearing
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.quantised import Binary, Quantised, lloyd_max
from wsnsim.models.ranging import Range, Rssi
from wsnsim.models.recorded_readings import RecordedSensor
from wsnsim.models.sensing import AcousticEnergy, Coordinate
from wsnsim.offline.loopback import perfect, perform, silent
from wsnsim.scenario import build
from wsnsim.testing import check_sensor, check_tracker
from wsnsim.trackers.bootstrap_pf import CentralPf
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.shared.heads import GaussianBelief
from wsnsim.trackers.shared.readings import gather_readings
from wsnsim.trackers.sigma_points import UnscentedKalman

ONE_BIT = (0.637, 0.439, 0.131, 0.015)
LLOYD_MAX = (0.637, 0.883, 0.966, 0.991)
AXIS = np.zeros((1, 1))


def of_a_coordinate(x: Any, bits: int = 1, **thresholds: Any) -> Any:
    """The Fisher information about x in a reading of it with the standard deviation 1, at points of the x-axis."""
    sensor = Quantised(law=Coordinate(sd=1.0), bits=bits, **thresholds)
    points = np.array([x, np.zeros(len(x))])
    return sensor.information(points, np.zeros((1, 2)), AXIS)[0, 0, 0]


def test_one_bit_keeps_two_over_pi_of_the_information_and_less_farther_from_its_threshold() -> None:
    away = np.arange(4.0)
    kept = of_a_coordinate(away, low=-5.0, high=5.0)
    assert kept == pytest.approx(norm.pdf(away) ** 2 / (norm.cdf(away) * norm.sf(away)), rel=1e-9)
    assert kept == pytest.approx(ONE_BIT, rel=0.01, abs=5e-4)  # the last one is published with two digits


@pytest.mark.parametrize("bits", [1, 2, 3, 4])
def test_cells_of_lloyd_and_max_keep_all_information_but_their_distortion(bits: int) -> None:
    edges, values = lloyd_max(bits)
    for low, high, value in zip(edges[:-1], edges[1:], values, strict=True):
        inside = quad(lambda z: z * norm.pdf(z), low, high)[0] / (norm.cdf(high) - norm.cdf(low))
        assert value == pytest.approx(inside, abs=1e-8)
    assert edges[1:-1] == pytest.approx((values[1:] + values[:-1]) / 2.0, abs=1e-8)
    sensor = Range(sd=2.0)
    about = Quantised(law=sensor, bits=bits, thresholds="lloyd_max")
    points, places, none = np.array([[30.0], [10.0]]), np.zeros((1, 2)), np.empty((1, 0))
    told = about.with_thresholds(points[:, 0], np.zeros((2, 2)), places, none)
    full = sensor.information(points, places, none)
    assert about.information(points, places, told) == pytest.approx(LLOYD_MAX[bits - 1] * full, rel=0.01)
    assert about.information(points, places, none) == pytest.approx(about.information(points, places, told), rel=1e-6)


CASES = {
    "range": (Quantised(law=Range(), bits=3, high=40.0), Range(), 0.0, 40.0),
    "bearing": (Quantised(law=Bearing(sd=0.3), bits=2), Bearing(sd=0.3), -np.pi, np.pi),
    "energy": (Quantised(law=AcousticEnergy(), bits=3, low=5.0, high=30.0), AcousticEnergy(), 5.0, 30.0),
}


@pytest.mark.parametrize("case", CASES)
def test_the_likelihood_is_the_laws_density_over_the_cell(case: str) -> None:
    sensor, law, low, high = CASES[case]
    traits = np.ones((1, len(sensor.trait_names)))
    place, point = np.zeros((1, 2)), np.array([[-19.0], [1.0]])
    turns = np.array([-1, 0, 1]) * 2 * np.pi if case == "bearing" else np.zeros(1)
    edges = np.linspace(low, high, 2**sensor.bits + 1)
    if case != "bearing":
        edges[[0, -1]] = -np.inf, np.inf
    mean, _, variance = (each.item() if each.size == 1 else each for each in law.linearise(point, place, traits))
    for cell, value in enumerate(sensor.reading_values):
        ends = edges[cell : cell + 2]
        between = norm.cdf(ends[:, None] + turns, mean, np.sqrt(variance)).sum(axis=1)
        found = sensor.log_likelihood(point, np.array([value]), place, traits)[0]
        assert np.exp(found) == pytest.approx(between[1] - between[0], rel=1e-7, abs=1e-14)


def test_the_cell_of_an_unlikely_reading_keeps_its_digits() -> None:
    sensor = Quantised(law=Coordinate(), bits=1, low=-1.0, high=1.0)
    logs = sensor.log_likelihood(np.array([[60.0, -60.0], [0.0, 0.0]]), np.array([-0.5]), np.zeros((1, 2)), AXIS)
    assert logs == pytest.approx([norm.logcdf(-60.0), 0.0], rel=1e-9)


@pytest.mark.parametrize(
    "sensor",
    [
        Quantised(law=Range(), thresholds="lloyd_max", bits=2),
        Quantised(law=Bearing(), bits=4),
        Quantised(law=Rssi(gain_spread=2.0), low=-100.0, high=-40.0, bits=4),
        Quantised(law=AcousticEnergy(), high=10.0, bits=3),
        Binary(radius=20.0, edge=0.5),
    ],
    ids=lambda sensor: type(getattr(sensor, "law", sensor)).__name__,
)
def test_quantised_sensors_keep_the_rules(sensor: Any) -> None:
    check_sensor(sensor)


@pytest.mark.parametrize("altered", ["value", "mean"])
def test_a_reading_of_no_value_and_a_wrong_mean_are_found(altered: str) -> None:
    class Cheat(Binary):
        def measure(self, *arguments: Any) -> Any:
            readings = super().measure(*arguments)
            return readings + 0.5 if altered == "value" else 1.0 - readings

    with pytest.raises(AssertionError, match={"value": "reading_values", "mean": "have the mean"}[altered]):
        check_sensor(Cheat())


def test_information_is_the_covariance_of_the_score() -> None:
    for sensor in (Binary(error=0.05), Quantised(law=AcousticEnergy(), bits=2, low=5.0, high=30.0)):
        place, traits = np.zeros((1, 2)), np.ones((1, len(sensor.trait_names)))
        point, step = np.array([[22.0], [15.0]]), 1e-4
        wanted = np.zeros((2, 2))
        for value in sensor.reading_values:
            chances = [
                np.exp(
                    sensor.log_likelihood(point + side * step * np.eye(2)[:, [axis]], np.array([value]), place, traits)
                )
                for axis in (0, 1)
                for side in (1, -1)
            ]
            slopes = np.array([(chances[0] - chances[1])[0], (chances[2] - chances[3])[0]]) / (2 * step)
            wanted += np.outer(slopes, slopes) / np.mean(chances)
        assert sensor.information(point, place, traits)[0, :, :, 0] == pytest.approx(wanted, rel=1e-5)


def scene_with(sensor: Any, head: int = 0) -> Any:
    motion = ConstantVelocity(start=(30.0, 0.0, 20.0, 0.0))
    places = np.array([[0.0, 0.0], [60.0, 0.0], [0.0, 60.0]])
    return make_scene(1, (0, 1, 2), places, np.empty((3, 0)), motion, sensor, head=head)


def gathered(sensor: Any, readings: Any, lose: Any = perfect) -> tuple[Any, list[Any]]:
    """The evidence of a head that believes in (30, 20) m, and the requests that it made."""
    scene, requests = scene_with(sensor), []
    belief = GaussianBelief(np.array([30.0, 0.0, 20.0, 0.0]), np.diag([4.0, 0.1, 4.0, 0.1]), 0)
    members = {i: Member(i, scene.positions[i], scene.traits[i], value) for i, value in enumerate(readings)}
    seen = perform(gather_readings(scene, belief=belief), members, 0, lose, requests.append)
    return seen, requests


def test_a_quantised_reading_takes_its_header_and_its_bits() -> None:
    readings = [35.0, 36.0, 50.0]
    _, requests = gathered(Quantised(law=Range(), bits=3, high=64.0), readings)
    assert [type(each) for each in requests] == [GatherReadings] and requests[0].packet_bits == 35
    seen, requests = gathered(Quantised(law=Range(), bits=2, thresholds="lloyd_max"), readings)
    broadcast, gather = next(each for each in requests if isinstance(each, Broadcast)), requests[-1]
    assert broadcast.parcel.packets * broadcast.parcel.packet_bits == 2 * 96  # two numbers, and three of a covariance
    assert isinstance(gather, Gather) and seen.traits.shape == (3, 2)
    assert seen.traits[:, 0] == pytest.approx(np.hypot([30, 30, 30], [20, 20, 40]))
    told = Member(7, np.zeros(2), np.empty(0), 35.0)
    told.inbox.append(SimpleNamespace(what="prediction", payload=broadcast.parcel.payload, mask=np.ones(2, bool)))
    assert gather.parcel_of(told).packet_bits == 34


def test_a_member_that_did_not_hear_the_prediction_sends_nothing() -> None:
    seen, _ = gathered(Quantised(law=Range(), bits=2, thresholds="lloyd_max"), [35.0, 36.0, 50.0], silent)
    assert seen.ids == (0,)


@pytest.mark.thorough(fast=["ekf"])
@pytest.mark.parametrize(
    "tracker", [ExtendedKalman(), UnscentedKalman(), CentralPf(particles=100)], ids=["ekf", "ukf", "pf"]
)
def test_trackers_that_tell_their_prediction_keep_the_rules_of_the_interface(tracker: Any) -> None:
    check_tracker(tracker, ConstantVelocity(), Quantised(law=Range(reach=60.0), bits=2, thresholds="lloyd_max"))


def test_many_bits_about_the_prediction_are_the_reading_itself_for_a_kalman_filter() -> None:
    estimates = []
    for sensor in (Quantised(law=Range(), bits=8, thresholds="lloyd_max"), Range()):
        scene = scene_with(sensor)
        belief = GaussianBelief(np.array([30.0, 0.0, 20.0, 0.0]), np.diag([4.0, 0.1, 4.0, 0.1]), 0)
        members = {i: Member(i, scene.positions[i], scene.traits[i], v) for i, v in enumerate([35.0, 36.5, 50.0])}
        estimates.append(perform(ExtendedKalman().step(belief, scene), members, 0))
    assert estimates[0].mean == pytest.approx(estimates[1].mean, abs=0.02)
    assert estimates[0].cov == pytest.approx(estimates[1].cov, rel=0.01, abs=1e-4)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ({"thresholds": "lloyd_max"}, "does not take thresholds about a prediction"),
        ({"low": 60.0}, "must be above low"),
        ({"law": {"kind": "range_bearing"}}, "scalar readings"),
        ({"law": {"kind": "rssi", "noise": "student_t"}}, "must be Gaussian"),
        ({"law": {"kind": "bearing"}, "thresholds": "lloyd_max"}, "no angle"),
        ({"law": {"kind": "range", "beyond": "noise"}}, "beyond: noise"),
        ({"law": {"kind": "range", "blocked": 0.1}}, "blocking"),
        ({"law": {"kind": "range", "reach": 1e8}}, "sensor.law.reach"),
    ],
)
def test_what_cannot_be_quantised_is_refused(lines: dict[str, Any], words: str) -> None:
    sensor = {"kind": "quantised", "law": {"kind": "range"}} | lines
    tracker = {"kind": "imm"} if "thresholds" in lines else {"kind": "ukf"}
    scenario = {"extends": "jiang_field", "name": "x", "sensor": sensor, "tracker": tracker}
    with pytest.raises(wsnsim.ScenarioError, match=words):
        build(wsnsim.load(scenario))


@pytest.mark.parametrize(
    ("law", "ends", "noted"),
    [
        ({"kind": "rssi", "reach": "50 m"}, {}, True),
        ({"kind": "rssi", "reach": "50 m"}, {"low": -90.0, "high": -30.0}, False),
        ({"kind": "rssi", "reach": "50 m"}, {"thresholds": "lloyd_max"}, False),
        ({"kind": "range", "reach": "50 m"}, {}, False),
        ({"kind": "range", "reach": "50 m"}, {"low": 55.0}, True),
        ({"kind": "bearing", "reach": "50 m"}, {"low": 50.0}, False),
        ({"kind": "acoustic_energy"}, {"high": 9000.0}, False),
    ],
)
def test_cells_that_hardly_meet_the_readings_of_their_law_are_noted(
    law: dict[str, Any], ends: dict[str, Any], noted: bool
) -> None:
    scenario = {"extends": "jiang_field", "name": "x", "tracker": {"kind": "pf"}}
    setup = build(wsnsim.load(scenario | {"sensor": {"kind": "quantised", "law": law, **ends}}))
    assert len([*setup_notes.cells_beside_the_readings(setup)]) == noted


def test_a_mean_of_recorded_readings_is_refused_as_it_is_in_no_cell() -> None:
    with pytest.raises(ValueError, match="in no cell"):
        RecordedSensor(path="x.csv", law=Binary())
    assert RecordedSensor(path="x.csv", law=Binary(), several="last").law == Binary()


def test_fewer_bits_raise_the_bound_and_none_is_below_that_of_full_readings() -> None:
    base = {"extends": "range_anchors", "name": "x", "duration": "8 s", "tracker": {"kind": "ekf"}}
    law = {"kind": "range", "sd": "1 m", "reach": ".inf"}
    sensors = [
        law,
        *({"kind": "quantised", "law": law, "bits": bits, "high": 250} for bits in (8, 4)),
        {"kind": "quantised", "law": law, "bits": 1, "thresholds": "lloyd_max"},
    ]
    full, eight, four, best = (bound(base | {"sensor": sensor}, range(3)) for sensor in sensors)
    assert full.rmse[-1] < eight.rmse[-1] < 1.1 * full.rmse[-1] < four.rmse[-1]
    assert full.rmse[-1] < best.rmse[-1] and any("thresholds follow" in caution for caution in best.cautions)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "sensor",
    [
        {"kind": "quantised", "law": {"kind": "squared"}, "bits": 2, "high": 12},
        {"kind": "binary", "radius": "8 m", "edge": "2 m", "reach": ".inf"},
    ],
    ids=["quantised", "binary"],
)
def test_a_particle_filter_converges_to_the_grid_filter(sensor: dict[str, Any]) -> None:
    places = {"kind": "anchors", "places": [[-10, 0], [0, 0], [5, 2], [12, 0]]}
    base = {"extends": "ungm_pf", "name": "x", "duration": "16 s", "replicates": 3, "sensor": sensor, "deploy": places}

    def estimates(**tracker: Any) -> Any:
        return wsnsim.run(base | {"tracker": tracker}).estimates["x"].to_numpy()

    exact = estimates(kind="grid", cells=2000)
    few, many = (np.sqrt(np.mean((estimates(kind="pf", particles=n) - exact) ** 2)) for n in (400, 25600))
    assert many < 0.4 * few and many < 0.1  # 1/8 is expected; both are one sample
