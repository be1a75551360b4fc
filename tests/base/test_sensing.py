"""Traits, expected readings and shadowing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest, norm

import wsnsim
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.optional_ports import IsShadowed
from wsnsim.base.rng import Streams, derive
from wsnsim.base.sensing import PathShadowing, informations, path_shadowing
from wsnsim.bounds import bound
from wsnsim.models.ranging import Range, Rssi
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.scenario import build

PLACES = np.array([[0.0, 3.0], [20.0, -5.0], [-7.0, 11.0]])
POINTS = np.array([[4.0, 5.0], [-2.0, 9.0]])


def test_a_variance_that_does_not_depend_on_the_position_tells_nothing_whoever_says_so():
    sensor = Range(sd=2.0)
    said = informations(sensor, POINTS, PLACES, np.empty((3, 0)))
    unsaid = informations(SimpleNamespace(linearise=sensor.linearise), POINTS, PLACES, np.empty((3, 0)))
    assert said.shape == (3, 2, 2, 2)
    assert unsaid == pytest.approx(said, rel=1e-12)


def test_a_variance_that_depends_on_the_position_tells_more():
    sensor, traits = AcousticEnergy(), np.ones((3, 1))
    said = informations(sensor, POINTS, PLACES, traits)
    unsaid = informations(SimpleNamespace(linearise=sensor.linearise), POINTS, PLACES, traits)
    assert (np.trace(said, axis1=1, axis2=2) > np.trace(unsaid, axis1=1, axis2=2)).all()


def test_components_of_a_reading_add_up():
    def linearise(points, positions, traits):
        slopes = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 0.0]])[:, :, None]
        return np.zeros((4, 1)), slopes, np.array([[1.0], [2.0], [4.0], [1.0]])

    told = informations(SimpleNamespace(linearise=linearise), POINTS[:, :1], PLACES[:2], np.empty((2, 0)))
    assert told[..., 0].tolist() == [[[1.0, 0.0], [0.0, 0.5]], [[4.25, 0.25], [0.25, 0.25]]]


SENSOR = Rssi(shadowing=4.0, decorrelation=3.0)
NODES = np.arange(4000)


def path(steps: int = 12) -> np.ndarray:
    """Steps of 0 to 3 m, one of them a rest."""
    lengths = np.linspace(0.0, 3.0, steps)[:, None] * [np.cos(1.0), np.sin(1.0)]
    return np.cumsum(lengths, axis=0)


def table(shadowing: PathShadowing, steps: int, nodes: np.ndarray = NODES) -> np.ndarray:
    """(steps, n) of all steps and nodes."""
    return np.array([shadowing.at(np.full(nodes.size, step), nodes) for step in range(steps)])


def test_its_correlation_falls_exponentially_with_the_path_and_its_variance_stays() -> None:
    """4 000 nodes: correlations to four standard errors, variances within the 99.9 % interval of χ²."""
    points = path()
    found = table(PathShadowing(SENSOR, points, 7), len(points))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    for i, j in ((0, 1), (0, 3), (2, 6), (5, 11), (0, 11)):
        expected = np.exp(-(along[j] - along[i]) / 3.0)
        assert (found[i] * found[j]).mean() / 16.0 == pytest.approx(expected, abs=4.0 * np.sqrt(2.0 / 4000))
    squares = (found**2).sum(axis=1) / 16.0
    assert np.all(chi2.ppf(0.0005, 4000) < squares) and np.all(squares < chi2.ppf(0.9995, 4000))
    assert kstest(found[7], norm(0.0, 4.0).cdf).pvalue > 0.001


def test_it_stays_while_the_target_rests() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    found = table(PathShadowing(SENSOR, points, 7), 5)
    assert np.array_equal(found[1], found[2]) and np.array_equal(found[2], found[3])
    assert not np.any(found[0] == found[1]) and not np.any(found[3] == found[4])


def test_it_depends_on_key_step_and_node_alone() -> None:
    points = path()
    whole = table(PathShadowing(SENSOR, points, 7), len(points), NODES[:50])
    few = PathShadowing(SENSOR, points, 7)
    for step in (11, 3, 0, 7):
        nodes = np.array([step, 40, 17])
        assert np.array_equal(few.at(np.full(3, step), nodes), whole[step, nodes])
    assert np.array_equal(table(PathShadowing(SENSOR, points[:5], 7), 5, NODES[:50]), whole[:5]), "the past stays"
    other = table(PathShadowing(SENSOR, points, derive(7, 1)), len(points), NODES[:50])
    assert abs(np.corrcoef(whole[6], other[6])[0, 1]) < 0.5 and not np.any(whole == other)


def test_between_steps_it_is_interpolated_and_at_steps_it_is_that_of_the_steps() -> None:
    points = path()
    fine = np.column_stack([np.interp(np.arange(45) / 4.0, np.arange(12), column) for column in points.T])
    steps, between = PathShadowing(SENSOR, points, 7), PathShadowing(SENSOR, fine, 7, 4)
    whole = table(steps, 12, NODES[:9])
    for step in range(12):
        assert np.array_equal(between.at(np.full(9, 4 * step), NODES[:9]), whole[step])
    found = between.at(np.full(9, 4 * 5 + 1), NODES[:9])
    assert found == pytest.approx(0.75 * whole[5] + 0.25 * whole[6])


def test_sensors_without_it_have_none() -> None:
    assert path_shadowing(Rssi(), path(), 7) is None
    assert isinstance(Rssi(), IsShadowed)
    assert path_shadowing(SimpleNamespace(), path(), 7) is None  # type: ignore[arg-type]


def scenario(network: bool, tracker: str = "ekf", inflate: bool = False, **sensor: Any) -> dict[str, Any]:
    """Twelve anchors around a walking target, with a network (one cluster, an ideal channel) or without."""
    made = {
        "name": "shadowed", "seed": 3, "duration": "40 s", "step": "1 s",
        "prior": {"sd": [1, 0.5, 1, 0.5]}, "record": {"readings": True},
        "deploy": {"kind": "anchors", "places": [[x, y] for x in (0, 7, 14, 21) for y in (0, 9, 18)]},
        "motion": {"kind": "waypoints", "q": 0.05, "points": [[0, 2, 2], [20, 18, 4], [40, 16, 16]]},
        "sensor": {"kind": "rssi", "sd": 2, "reach": "60 m", "shadowing": 4, "decorrelation": 5, **sensor},
        "tracker": {"kind": tracker, "assumes": {"inflate": inflate}},
    }  # fmt: skip
    radio = {"energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": "50 m"}}
    return {**made, **(radio if network else {"network": "none"})}


def residuals(made: dict[str, Any], tmp_path: Any, batch: bool = True) -> Any:
    """The table `readings` of two runs."""
    report = wsnsim.experiment.run(wsnsim.load(made), replicates=2, out=tmp_path / "x.h5", batch=batch)
    return wsnsim.read(report.out, "readings").set_index(["replicate", "target", "step", "node"]).sort_index()


@pytest.mark.thorough
def test_it_is_added_to_the_same_readings_with_a_network_and_without_one(tmp_path: Any) -> None:
    alone = residuals(scenario(False), tmp_path)["reading"]
    assert np.array_equal(alone, residuals(scenario(True), tmp_path)["reading"])
    drifting = {**scenario(True), "detection": {"kind": "imperfect", "missed": 0.3}}
    some = residuals(drifting, tmp_path)["reading"]
    assert 0 < len(some) < len(alone) and np.array_equal(some, alone.loc[some.index])
    without = residuals(scenario(False, shadowing=0), tmp_path)["reading"]
    setup = build(wsnsim.load(scenario(False)))
    for run in range(2):
        conditions = sample_initial_conditions(setup, run)
        added = PathShadowing(setup.sensor, conditions.truths[0][:, [0, 2]], derive(Streams(3, run).key("sense"), 0))
        difference = (alone - without).loc[run, 0].unstack().to_numpy()
        assert difference == pytest.approx(table(added, setup.steps + 1, np.arange(12))[-len(difference) :], abs=1e-9)


def test_a_batch_has_the_readings_of_single_runs(tmp_path: Any) -> None:
    made = wsnsim.load({**scenario(False), "record": {"readings": False}})
    single = [wsnsim.experiment.simulate_run(made, run).run["fingerprint"] for run in range(3)]
    assert len(set(single)) == 3
    report = wsnsim.experiment.run(made, replicates=3, out=tmp_path / "x.h5")
    assert [one.run["fingerprint"] for one in report.summaries] == single


@pytest.mark.thorough
def test_filters_ignore_it_or_widen_their_noise_and_claim_less_then() -> None:
    sensor = Rssi(sd=2.0, shadowing=4.0, gain_spread=3.0)
    points, nodes, traits = np.array([[3.0], [4.0]]), np.zeros((1, 2)), np.array([[1.5]])
    for gains, inflate, variance in (
        ("known", False, 4.0), ("known", True, 20.0), ("unknown", False, 4.0), ("unknown", True, 29.0),
        ("estimated", True, 20.0),
    ):  # fmt: skip
        means, _, variances = sensor.assumed(gains, inflate).linearise(points, nodes, traits)
        assert variances[0, 0] == pytest.approx(variance)
        level = -37.8 - 23.0 * np.log10(5.0) + (1.5 if gains == "known" else 0.0)
        assert means[0, 0] == pytest.approx(level)
    nees = [
        np.median(
            [
                wsnsim.experiment.simulate_run(wsnsim.load(scenario(False, inflate=how)), run).run["nees"]
                for run in range(8)
            ]
        )
        for how in (False, True)
    ]
    assert nees[1] < 0.5 * nees[0]


def test_bounds_say_that_they_take_readings_as_independent() -> None:
    moving = {"kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.02], "start": [4, 0.5, 5, 0.4]}
    made = {**scenario(False), "motion": moving, "duration": "5 s"}
    assert any("takes them as independent" in text for text in bound(made, [0]).cautions)
    made = {**scenario(False, shadowing=0), "motion": moving, "duration": "5 s"}
    assert not any("independent" in text for text in bound(made, [0]).cautions)
