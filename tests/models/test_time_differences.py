"""Time differences of arrival: filters, bounds and files against differences from a reference, written out densely."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import wsnsim
from tests.helpers.scenes import make_scene
from tests.helpers.tracker_kinds import trackers_of_one_target
from wsnsim import fitting
from wsnsim.analysis.notes import before_a_run
from wsnsim.base.errors import UsageError
from wsnsim.base.part import Quantity, part
from wsnsim.base.requests import Compute, Flow, Member
from wsnsim.base.sensing import informations
from wsnsim.bounds import bound
from wsnsim.bounds.information import UsedReadings, information
from wsnsim.cli import main
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import TimeDifference
from wsnsim.offline.loopback import perform
from wsnsim.scenario import build
from wsnsim.testing import check_sensor
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.readings import Evidence, gather_readings
from wsnsim.trackers.sigma_points import CubatureKalman, UnscentedKalman

SD = 0.7
SENSOR = TimeDifference(sd=SD, reach=np.inf)
NODES = np.array([[-20.0, 10.0], [35.0, -5.0], [5.0, 28.0], [12.0, -31.0], [-9.0, -14.0]])
NONE = np.empty((5, 0))
READINGS = 1e4 + np.array([21.0, 30.0, 24.5, 33.0, 17.0])


def differences(point: np.ndarray, reference: int, nodes: np.ndarray = NODES) -> tuple[np.ndarray, ...]:
    """What the differences from a reference should be, their slopes (n - 1, 2) and their covariance R (I + 1 1ᵀ)."""
    apart = point - nodes
    distances = np.hypot(*apart.T)
    units, others = apart / distances[:, None], np.arange(len(nodes)) != reference
    cov = SD**2 * (np.eye(len(nodes) - 1) + np.ones((len(nodes) - 1, len(nodes) - 1)))
    return (distances - distances[reference])[others], (units - units[reference])[others], cov


def of_differences(readings: np.ndarray, reference: int) -> np.ndarray:
    return np.delete(readings - readings[reference], reference)


def dense_update(mean: np.ndarray, cov: np.ndarray, seen: Evidence, reference: int) -> tuple[np.ndarray, ...]:
    """An extended Kalman filter's update with differences, in Joseph's form; mean, covariance, and νᵀ S⁻¹ ν."""
    expected, slopes, noise = differences(mean[[0, 2]], reference, seen.positions)
    h = np.zeros((len(expected), mean.size))
    h[:, [0, 2]] = slopes
    width = h @ cov @ h.T + noise
    gain, innovation = cov @ h.T @ np.linalg.inv(width), of_differences(seen.readings, reference) - expected
    keep = np.eye(mean.size) - gain @ h
    after = keep @ cov @ keep.T + gain @ noise @ gain.T
    return mean + gain @ innovation, after, innovation @ np.linalg.solve(width, innovation)


@part
class ByReference(HeadFilter):
    """An extended Kalman filter that takes the differences from one of the readings that arrived."""

    number: Annotated[int, Quantity("", ge=0, le=99), "which of the readings that arrived is the reference"] = 0

    def step(self, belief: GaussianBelief, scene: Any) -> Flow[GaussianBelief]:
        seen = yield from gather_readings(scene)
        yield Compute(1.0)
        mean, cov = belief.mean, belief.cov
        for _ in range(scene.steps):
            (transition,), noise = scene.motion.matrices(mean[:, None], scene.dt, 0.0)
            mean, cov = transition @ mean, transition @ cov @ transition.T + noise
        if len(seen.ids) > 1:
            mean, cov, _ = dense_update(mean, cov, seen, self.number % len(seen.ids))
        return GaussianBelief(mean, cov, scene.head)


@pytest.mark.parametrize("sensor", [SENSOR, TimeDifference(target_height=2.0)], ids=["plane", "space"])
@pytest.mark.parametrize("columns", [1, 2])
def test_the_sensor_keeps_the_rules(sensor: TimeDifference, columns: int) -> None:
    check_sensor(sensor, columns)


@pytest.mark.parametrize("reference", range(5))
def test_likelihood_and_information_are_those_of_differences_from_any_reference(reference: int) -> None:
    points = np.array([[3.0, -12.0, 18.0], [4.0, 7.0, -9.0]])
    found = SENSOR.log_likelihood(points, READINGS, NODES, NONE)
    told = informations(SENSOR, points, NODES, NONE).sum(axis=0)
    for j, point in enumerate(points.T):
        expected, slopes, cov = differences(point, reference)
        wanted = multivariate_normal.logpdf(of_differences(READINGS, reference), expected, cov)
        assert found[j] == pytest.approx(wanted, rel=1e-9)
        assert told[..., j] == pytest.approx(slopes.T @ np.linalg.solve(cov, slopes), rel=1e-9, abs=1e-12)


def test_heights_count_in_the_distances() -> None:
    sensor, traits = TimeDifference(target_height=2.0), np.column_stack([np.zeros(5), [2.0, 5.0, 8.0, 1.0, 2.0]])
    point, places = np.array([3.0, 4.0]), np.column_stack([NODES, traits[:, 1]])
    distances = np.linalg.norm(places - [3.0, 4.0, 2.0], axis=1)
    assert sensor.measure(np.tile(point, (5, 1)), NODES, traits, np.zeros(5)) == pytest.approx(distances, rel=1e-12)
    expected, *_ = sensor.linearise(point[:, None], NODES, traits)
    assert expected[:, 0] == pytest.approx(distances - distances.mean(), rel=1e-12)


FILTERS = {"ekf": ExtendedKalman(), "iterated": ExtendedKalman(iterations=4), "ukf": UnscentedKalman(),
           "ckf": CubatureKalman()}  # fmt: skip


def stepped(tracker: Any, rows: Any, readings: np.ndarray = READINGS) -> Any:
    """The estimate after one step with the readings of these nodes, in this order."""
    rows = list(rows)
    scene = make_scene(1, rows, NODES[rows], NONE[rows], ConstantVelocity(), SENSOR)
    members = {row: Member(row, NODES[row], NONE[row], float(readings[row])) for row in rows}
    belief = GaussianBelief(np.array([3.0, 1.0, 2.0, -0.5]), np.diag([4.0, 0.5, 9.0, 0.5]), rows[0])
    return tracker.estimate(perform(tracker.step(belief, scene), members, rows[0]))


@pytest.mark.parametrize("tracker", FILTERS.values(), ids=FILTERS)
def test_neither_the_order_of_nodes_nor_the_time_of_emission_changes_an_estimate(tracker: Any) -> None:
    one = stepped(tracker, range(5))
    for other in (stepped(tracker, [3, 1, 4, 0, 2]), stepped(tracker, range(5), READINGS - 9321.0)):
        assert other.mean == pytest.approx(one.mean, rel=1e-9, abs=1e-9)
        assert other.cov == pytest.approx(one.cov, rel=1e-9, abs=1e-9)
        assert other.innovation.nis == pytest.approx(one.innovation.nis, rel=1e-9)
    assert one.innovation.dof == 4


@pytest.mark.parametrize("lost", range(5))
def test_whose_reading_is_lost_is_left_out_whoever_the_reference_was(lost: int) -> None:
    kept = [row for row in range(5) if row != lost]
    scene = make_scene(1, kept, NODES[kept], NONE[kept], ConstantVelocity(), SENSOR)
    belief = GaussianBelief(np.array([3.0, 1.0, 2.0, -0.5]), np.diag([4.0, 0.5, 9.0, 0.5]), kept[0])
    (transition,), noise = scene.motion.matrices(belief.mean[:, None], 1.0, 0.0)
    before = transition @ belief.mean, transition @ belief.cov @ transition.T + noise
    seen = Evidence(tuple(kept), READINGS[kept], NODES[kept], NONE[kept])
    silent = np.where(np.arange(5) == lost, np.nan, READINGS)
    found = stepped(ExtendedKalman(), [*kept, lost], silent)
    for reference in range(4):
        mean, cov, square = dense_update(*before, seen, reference)
        assert found.mean == pytest.approx(mean, rel=1e-9, abs=1e-9)
        assert found.cov == pytest.approx(cov, rel=1e-9, abs=1e-9)
        assert found.innovation.nis == pytest.approx(square, rel=1e-9) and found.innovation.dof == 3


@pytest.mark.parametrize("tracker", FILTERS.values(), ids=FILTERS)
def test_a_reading_alone_says_nothing(tracker: Any) -> None:
    one, nothing = stepped(tracker, [2]), stepped(tracker, [2], np.full(5, np.nan))
    assert one.mean == pytest.approx(nothing.mean, rel=1e-12) and one.cov == pytest.approx(nothing.cov, rel=1e-12)
    assert np.isnan(one.innovation.nis) and one.innovation.dof == 0
    assert not SENSOR.log_likelihood(np.ones((2, 3)), READINGS[:1], NODES[:1], NONE[:1]).any()


ALONE = {
    "network": "none", "seed": 3, "duration": "9 s", "step": "1 s", "replicates": 3,
    "prior": {"sd": [3, 1, 3, 1]},
    "deploy": {"kind": "anchors", "places": [[0, 0], [60, 0], [0, 60], [60, 60], [30, 80]]},
    "motion": {
        "kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.01], "start": [20, 1, 30, 0.5],
    },
    "sensor": {"kind": "tdoa", "sd": "0.7 m", "reach": "45 m"},
}  # fmt: skip
NETWORK = {
    "extends": "jiang_field", "seed": 3, "duration": "0.8 s", "replicates": 1,
    "motion": {
        "kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.01], "start": [-45, -20, -50, -35],
    },
    "sensor": {"kind": "tdoa", "sd": "0.7 m", "reach": "60 m"},
}  # fmt: skip


def tables(base: dict[str, Any], tracker: Any, **options: Any) -> np.ndarray:
    """Estimates and covariances of the runs of a scenario with this tracker."""
    options = {"keep": ["estimates", "covariances"]} | options
    result = wsnsim.run(base | {"name": "x", "tracker": tracker}, **options)
    found = [result.estimates[["px", "py", "vx", "vy"]], result.table("covariances").filter(like="cov_")]
    return np.concatenate([each.to_numpy() for each in found], axis=1)


@pytest.mark.parametrize("base", [ALONE, NETWORK], ids=["standalone", "network"])
@pytest.mark.parametrize("number", [0, 3])
def test_the_filter_agrees_with_one_of_differences_from_any_reference(base: dict[str, Any], number: int) -> None:
    mine, theirs = (tables(base, tracker) for tracker in ({"kind": "ekf"}, ByReference(number=number)))
    assert np.isfinite(mine).all() and len(mine) > 15
    assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9)


def test_many_runs_at_once_are_those_of_one_by_one() -> None:
    for tracker in ({"kind": "ekf"}, {"kind": "pf", "particles": 50}):
        one, many = (tables(ALONE, tracker, batch=batch) for batch in (False, True))
        assert np.array_equal(one, many)


TOGETHER = {"ekf", "ukf", "ckf", "imm", "pf", "central_pf", "gpf", "pso_gpf", "gsa_gpf", "cs_pf", "ics_pf", "ipf"}


@pytest.mark.parametrize("kind", sorted({kind.kind for kind in trackers_of_one_target()} - {"grid", "stonesoup"}))
def test_each_tracker_takes_the_readings_of_a_step_together_or_is_refused(kind: str) -> None:
    sensor = {"kind": "tdoa", "sd": "0.7 m", "reach": ".inf"}
    scenario = ALONE | {"name": "x", "replicates": 1, "sensor": sensor, "tracker": {"kind": kind}}
    if kind not in TOGETHER:
        with pytest.raises(wsnsim.ScenarioError) as refused:
            build(wsnsim.load(scenario))
        assert "tracker.kind" in str(refused.value) and "tdoa" in str(refused.value)
        return
    few = {"particles": 200, "move": "position"} if kind.endswith("cs_pf") else {}
    found = wsnsim.run(scenario | {"tracker": {"kind": kind} | few}).estimates["error"]
    assert found.notna().all() and found.iloc[2:].median() < 2.5  # few particles: as with ranges


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ({"tracker": {"kind": "ekf", "readings": "nearest"}}, "tracker.readings: error: of readings of which only"),
        ({"sensor": {"kind": "quantised", "law": {"kind": "tdoa"}}}, "sensor.law: error: the noise must be Gaussian"),
        ({"extends": "jiang_field", "clusters": {"kind": "appointed"}}, "clusters.kind: error: the information"),
        ({"sensor": {"kind": "tdoa", "reach": "1e8 m"}}, "sensor.reach"),
    ],
)
def test_what_needs_a_reading_by_itself_is_refused(lines: dict[str, Any], words: str) -> None:
    base = {"name": "x", "sensor": NETWORK["sensor"], "tracker": {"kind": "ekf"}} if "extends" in lines else ALONE
    with pytest.raises(wsnsim.ScenarioError, match=words):
        build(wsnsim.load({"name": "x", "tracker": {"kind": "ekf"}} | base | lines))


def test_the_information_of_a_step_is_that_of_the_differences_of_those_who_measured() -> None:
    points, used = np.array([[3.0, 4.0], [8.0, 1.0], [12.0, 0.0]]), ([0, 1, 2, 4], [1], [0, 3])
    pairs = np.array([(step, node) for step, nodes in enumerate(used) for node in nodes]).T
    found = information(SENSOR, points, NODES, NONE, UsedReadings(*pairs))
    for step, nodes in enumerate(used):
        _, slopes, cov = differences(points[step], len(nodes) - 1, NODES[nodes])
        assert found[step] == pytest.approx(slopes.T @ np.linalg.solve(cov, slopes), rel=1e-9, abs=1e-12)


def test_the_bounds_are_those_of_differences_above_those_of_ranges() -> None:
    scenario = ALONE | {"name": "x", "tracker": {"kind": "ekf"}}
    ranges = scenario | {"sensor": ALONE["sensor"] | {"kind": "range"}}
    for kind in ("unconditional", "per_trajectory"):
        mine, of_ranges = (bound(each, range(3), kind) for each in (scenario, ranges))
        assert (mine.rmse > of_ranges.rmse).all() and mine.rmse[-1] < 10.0
    errors = scenario | {"deploy": ALONE["deploy"] | {"position_error": "0.1 m"}}
    assert "only the differences count" in bound(errors, range(1), "per_trajectory").reason


def recording(folder: Path, emission: float, reference: int | None = None) -> dict[str, Any]:
    """A scenario with recorded times of arrival, or differences from those of a node, whose own are then 0."""
    rng, path = np.random.default_rng(5), np.array([[20.0 + k, 30.0 + k / 2] for k in range(9)])
    places = np.array(ALONE["deploy"]["places"], dtype=float)
    arrivals = np.linalg.norm(path[:, None] - places, axis=2) + 0.7 * rng.standard_normal((9, 5))
    arrivals += emission * np.arange(9)[:, None] if reference is None else -arrivals[:, [reference]]
    lines = [f"{k},{i},{float(arrivals[k, i])!r}" for k in range(9) for i in range(5)]
    (folder / "readings.csv").write_text("\n".join(["time,node,reading", *lines]))
    (folder / "track.csv").write_text(
        "\n".join(["time,x,y", *[f"{k},{x!r},{y!r}" for k, (x, y) in enumerate(path.tolist())]])
    )
    track = {"kind": "recorded_track", "path": str(folder / "track.csv")}
    sensor = {"kind": "recorded", "path": str(folder / "readings.csv"), "law": {"kind": "tdoa", "sd": 0.7}}
    return ALONE | {"replicates": 1, "motion": track, "sensor": sensor}


def test_recorded_times_of_any_emission_and_differences_from_any_node_are_the_same_readings(tmp_path: Path) -> None:
    one = tables(recording(tmp_path, 0.0), {"kind": "ekf"})
    for given in ({"emission": 311.0}, {"emission": 0.0, "reference": 0}, {"emission": 0.0, "reference": 3}):
        assert tables(recording(tmp_path, **given), {"kind": "ekf"}) == pytest.approx(one, rel=1e-9, abs=1e-9)


def test_recorded_times_of_several_emissions_in_a_step_are_refused(tmp_path: Path) -> None:
    scenario = recording(tmp_path, 1.0) | {"name": "x", "step": "2 s", "duration": "8 s", "tracker": {"kind": "ekf"}}
    for several, words in (("mean", "several times of arrival in a step"), ("all", "independent readings")):
        with pytest.raises(wsnsim.ScenarioError, match=words):
            build(wsnsim.load(scenario | {"sensor": scenario["sensor"] | {"several": several}}))


@pytest.mark.parametrize(("reach", "noted"), [(40.0, True), (1e3, False)])
def test_a_check_and_a_run_note_that_few_nodes_measure_a_target(reach: float, noted: bool) -> None:
    setup = build(
        wsnsim.load(ALONE | {"name": "x", "tracker": {"kind": "ekf"}, "sensor": {"kind": "tdoa", "reach": reach}})
    )
    found = [note for note in before_a_run(setup) if "one reading says nothing of the place" in note]
    assert len(found) == noted


def test_a_fit_says_why_there_is_none() -> None:
    with pytest.raises(UsageError, match="law tdoa cannot be fitted: the times of emission are unknown"):
        fitting.fit("x.csv", "nodes.csv", law="tdoa")


def test_the_commands_run_compare_and_explain_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        "name: mine\nnetwork: none\nduration: 5 s\nstep: 1 s\nreplicates: 2\nprior: {sd: [3, 1, 3, 1]}\n"
        "deploy: {kind: anchors, places: [[0, 0], [60, 0], [0, 60], [60, 60]]}\n"
        "motion: {kind: constant_velocity, start: [20, 1, 30, 0.5]}\nsensor: {kind: tdoa, sd: 0.5 m}\n"
        "tracker: {kind: ekf}\n"
    )
    both = ["compare", str(scenario), "--trackers", "ekf,ukf", "--out", str(tmp_path / "both")]
    for words in (
        ["check", str(scenario)],
        ["run", str(scenario), "--out", str(tmp_path / "x.h5")],
        both,
        ["info", "tdoa"],
    ):
        assert main(words) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "Chan, Ho (1994)" in said and "ekf" in said
