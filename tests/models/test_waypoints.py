"""Straight legs, drawn or given: against integrals over the area, a simulator of its own, and hand counts."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, multivariate_normal

from tests.helpers.thorough import thorough
from wsnsim.base.errors import RunError
from wsnsim.base.rng import derive_all
from wsnsim.experiment import simulate_run
from wsnsim.models.waypoints import RandomWaypoint, Waypoints

SIDE, DRAWS = 500.0, 8000
PAUSING = RandomWaypoint(pause=(10.0, 90.0))
STOPS = ((10.0, 0.0, 0.0), (20.0, 30.0, -40.0), (25.0, 30.0, -40.0), (45.0, 930.0, -40.0), (65.0, 30.0, -40.0))


@functools.cache
def draws(model: RandomWaypoint, steps: int, dt: float, count: int = DRAWS, seed: int = 5) -> np.ndarray:
    """(count, steps + 1, 4) truths of one stream."""
    rng = np.random.default_rng(seed)
    return np.array([model.truth(steps, dt, rng) for _ in range(count)])


def speeds(states: np.ndarray) -> np.ndarray:
    return np.hypot(states[..., 1], states[..., 3])


def density(points: np.ndarray, side: float = SIDE, directions: int = 720) -> np.ndarray:
    """∫ a b (a + b) dφ over half a turn, a and b being the ways to the walls ahead and behind: (n,), not normalised.

    Hyytiä, Lassila, Virtamo (2006); over side⁴ times the mean leg it is the density of who is on a leg.
    """
    angle = (np.arange(directions) + 0.5) * math.pi / directions
    total = np.zeros(len(points))
    for c, s in zip(np.cos(angle), np.sin(angle), strict=True):
        ways = []
        for sign in (1.0, -1.0):
            x = (side / 2 - np.sign(sign * c) * points[:, 0]) / abs(c)
            y = (side / 2 - np.sign(sign * s) * points[:, 1]) / abs(s)
            ways.append(np.minimum(x, y))
        total += ways[0] * ways[1] * (ways[0] + ways[1])
    return total * math.pi / directions


@functools.cache
def cells(bins: int = 5, fine: int = 24) -> np.ndarray:
    """(bins, bins) the integral of the density over each cell of the area, by midpoints."""
    middles = (np.arange(bins * fine) + 0.5) / (bins * fine) * SIDE - SIDE / 2
    points = np.stack([axis.ravel() for axis in np.meshgrid(middles, middles, indexing="ij")], axis=1)
    each = density(points, directions=180).reshape(bins, fine, bins, fine)
    return each.sum(axis=(1, 3)) * (SIDE / (bins * fine)) ** 2


def long_run(legs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and places of a pausing target's knots, by array operations, from an ordinary start."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-SIDE / 2, SIDE / 2, (legs + 1, 2))
    seconds = np.hypot(*np.diff(places, axis=0).T) / rng.uniform(1.0, 8.0, legs)
    ends = np.cumsum(np.column_stack([seconds, rng.uniform(10.0, 90.0, legs)]).ravel())
    return np.concatenate([[0.0], ends]), np.concatenate([places[:1], np.repeat(places[1:], 2, axis=0)])


@pytest.mark.parametrize("model", [RandomWaypoint(), PAUSING, RandomWaypoint(begin="uniform")])
@pytest.mark.parametrize("finer", [2, 4, 8])
def test_the_way_does_not_depend_on_how_finely_it_is_sampled(model: RandomWaypoint, finer: int) -> None:
    coarse = model.truth(300, 2.0, np.random.default_rng(4))
    fine = model.truth(300 * finer, 2.0 / finer, np.random.default_rng(4))
    assert np.array_equal(fine[::finer], coarse)


def test_a_longer_way_begins_like_a_shorter_one() -> None:
    short, long = (PAUSING.truth(steps, 1.0, np.random.default_rng(4)) for steps in (100, 2000))
    assert np.array_equal(short, long[:101])


def test_a_second_target_of_the_stream_does_not_depend_on_the_step_either() -> None:
    seconds = []
    for steps, dt in ((200, 1.0), (400, 0.5)):
        rng = np.random.default_rng(4)
        PAUSING.truth(steps, dt, rng)
        seconds.append(PAUSING.truth(steps, dt, rng)[:: steps // 200])
    assert np.array_equal(*seconds)


@pytest.mark.thorough
@pytest.mark.parametrize("seconds", [200.0, *thorough([0.0])])
def test_the_mean_speed_over_targets_is_the_harmonic_mean_at_any_time(seconds: float) -> None:
    """Five standard errors about (8 - 1)/ln 8 = 3.366 m/s."""
    found = speeds(draws(RandomWaypoint(), 1, seconds or 1.0)[:, 1 if seconds else 0])
    assert abs(found.mean() - 7.0 / math.log(8.0)) < 5 * found.std() / math.sqrt(DRAWS)


@pytest.mark.thorough
def test_speeds_on_the_way_have_the_density_of_one_over_v() -> None:
    found = speeds(draws(RandomWaypoint(), 0, 1.0)[:, 0])
    assert kstest(found, lambda v: np.log(v) / math.log(8.0)).pvalue > 1e-3


@pytest.mark.thorough
def test_a_uniform_start_slows_down() -> None:
    """Yoon, Liu, Noble (2003): from 4.5 m/s, the mean of the speeds, towards 3.366. It shows that the test can fail."""
    found = speeds(draws(RandomWaypoint(begin="uniform"), 1, 600.0, 4000))
    error = found.std(axis=0) / math.sqrt(4000)
    assert abs(found[:, 0].mean() - 4.5) < 5 * error[0]
    assert abs(found[:, 1].mean() - 7.0 / math.log(8.0)) < 5 * error[1]


def test_the_mean_leg_normalises_the_density() -> None:
    """Ghosh's closed form against an integral that knows nothing of it: 0.52141 of the side."""
    assert cells().sum() / SIDE**4 == pytest.approx(RandomWaypoint().mean_leg(), rel=2e-4)


@pytest.mark.parametrize("sides", [(500.0, 500.0), (300.0, 100.0), (10.0, 400.0)])
def test_the_mean_leg_of_a_rectangle_is_that_of_many_pairs(sides: tuple[float, float]) -> None:
    apart = np.random.default_rng(2).uniform(size=(2, 2, 400_000)) * np.array(sides)[:, None]
    found = np.hypot(*(apart[0] - apart[1]))
    assert abs(found.mean() - RandomWaypoint(width=sides[0], height=sides[1]).mean_leg()) < 5 * found.std() / 632.4


@pytest.mark.thorough
@pytest.mark.parametrize("seconds", [200.0, *thorough([0.0])])
def test_places_have_the_exact_density_at_any_time(seconds: float) -> None:
    places = draws(RandomWaypoint(), 1, seconds or 1.0)[:, 1 if seconds else 0][:, [0, 2]]
    counts, _, _ = np.histogram2d(*places.T, bins=5, range=[[-SIDE / 2, SIDE / 2]] * 2)
    expected = cells()
    assert chisquare(counts.ravel(), expected.ravel() / expected.sum() * DRAWS).pvalue > 1e-3


@pytest.mark.thorough
@pytest.mark.parametrize("seconds", [200.0, *thorough([0.0])])
def test_the_share_of_targets_that_pause_is_the_share_of_time(seconds: float) -> None:
    """50 s of pauses on average against legs of 260.7 m at 3.366 m/s: 0.392."""
    found = speeds(draws(PAUSING, 1, seconds or 1.0)[:, 1 if seconds else 0]) == 0.0
    share = 50.0 / (50.0 + 0.5214054331647207 * SIDE * math.log(8.0) / 7.0)
    assert abs(found.mean() - share) < 5 * math.sqrt(share * (1 - share) / DRAWS)
    assert PAUSING.paused_share() == pytest.approx(share)


@pytest.mark.thorough(fast=["5.0"])
@pytest.mark.parametrize("seconds", [5.0, 30.0, 60.0])
def test_what_is_left_of_the_first_pause_is_that_of_an_inspected_one(seconds: float) -> None:
    """What is left of a pause U[10, 90] s has the density P(pause > r) / 50 s: who is still there after r seconds.

    Legs of a microsecond are next to never met. A new pause of the whole length would leave 0.75 at 30 s, not 0.45.
    """
    model = RandomWaypoint(width=1e-3, height=1e-3, speed=(1e3, 1e3), pause=(10.0, 90.0))
    states = draws(model, 1, seconds, 3000, 3)
    stayed = np.mean(np.all(states[:, 0] == states[:, 1], axis=1))
    left = seconds if seconds < 10 else seconds - (seconds - 10.0) ** 2 / 160.0
    share = 1.0 - left / 50.0
    assert abs(stayed - share) < 5 * math.sqrt(share * (1 - share) / 3000)


@pytest.mark.thorough
def test_the_process_is_that_of_a_long_run_of_another_simulator() -> None:
    """Who pauses, how fast and where, at 200 s of many targets and over 10^5 legs of one: equal laws."""
    times, places = long_run(100_000, 8)
    rng = np.random.default_rng(9)
    now = rng.uniform(0.1 * times[-1], times[-1], DRAWS)
    leg = np.searchsorted(times, now) - 1
    lengths = np.hypot(*np.diff(places, axis=0).T)[leg] / np.diff(times)[leg]
    share = (now - times[leg]) / np.diff(times)[leg]
    there = places[leg] + share[:, None] * (places[leg + 1] - places[leg])
    ours = draws(PAUSING, 1, 200.0)[:, 1]
    edges = np.array([-0.5, 0.5, 1.5, 2.0, 3.0, 4.0, 6.0, 8.5])
    for first, second, bins in (
        (speeds(ours), lengths, edges),
        (np.hypot(ours[:, 0], ours[:, 2]), np.hypot(*there.T), np.array([0.0, 60, 100, 140, 180, 220, 260, 360])),
    ):
        a, b = np.histogram(first, bins)[0], np.histogram(second, bins)[0]
        assert a.sum() == b.sum() == DRAWS
        assert float(((a - b) ** 2 / (a + b)).sum()) < 26.1, "χ² of 6 to 7 degrees of freedom, at about 1/2000"


def test_the_velocity_is_the_slope_of_the_way_and_zero_in_a_pause() -> None:
    states = PAUSING.truth(200_000, 0.05, np.random.default_rng(6))
    moved, told = np.diff(states[:, [0, 2]], axis=0) / 0.05, states[:-1, [1, 3]]
    along = np.all(np.isclose(moved, told, atol=1e-6), axis=1)
    assert 1.0 - along.mean() < 2e-3, "but for the steps in which a leg or a pause ends"
    fast = speeds(states)
    assert np.all((fast == 0) | ((fast > 1 - 1e-6) & (fast < 8 + 1e-6)))
    assert 0.2 < np.mean(fast == 0.0) < 0.6


def test_the_area_lies_where_it_is_said_to_and_may_be_thin() -> None:
    states = RandomWaypoint(width=100, height=1, centre=(1000.0, -50.0)).truth(5000, 1.0, np.random.default_rng(1))
    assert np.all(np.abs(states[:, 0] - 1000) <= 50 + 1e-9)
    assert np.all(np.abs(states[:, 2] + 50) <= 0.5 + 1e-9)
    assert np.ptp(states[:, 0]) > 90


def test_one_speed_is_kept_and_limits_must_be_in_order() -> None:
    kept = speeds(RandomWaypoint(speed=(3.0, 3.0)).truth(500, 1.0, np.random.default_rng(1)))
    assert np.allclose(kept, 3.0, rtol=1e-9)
    for name, limits in (("speed", (8.0, 1.0)), ("pause", (2.0, 1.0))):
        with pytest.raises(ValueError, match=f"{name}: the first is the least"):
            RandomWaypoint(**{name: limits})  # type: ignore[arg-type]


MODELS = [RandomWaypoint(q=0.3), Waypoints(points=STOPS, q=0.3)]


@pytest.mark.parametrize("model", MODELS)
def test_filters_believe_in_white_noise_of_the_acceleration(model: Any) -> None:
    """q [T³/3 T²/2; T²/2 T] an axis, at T = 2 s; 100 000 draws: five standard errors are 0.016 and 0.023."""
    transition = np.kron(np.eye(2), [[1.0, 2.0], [0.0, 1.0]])
    covariance = 0.3 * np.kron(np.eye(2), [[8.0 / 3.0, 2.0], [2.0, 2.0]])
    transitions, noise = model.matrices(np.zeros((4, 3)), 2.0, 7.0)
    assert np.allclose(transitions, transition)
    assert np.allclose(noise, covariance)
    assert np.allclose(model.assumed(9.0).matrices(np.zeros((4, 1)), 2.0)[1], 9.0 * covariance)
    before = np.repeat(np.array([[3.0], [-1.0], [5.0], [2.0]]), 100_000, axis=1)
    assert np.allclose(model.advance(before[:, :2], 2.0), transition @ before[:, :2])
    moved, scale = model.propagate(before, 2.0, derive_all(3, np.arange(100_000))), np.sqrt(np.diag(covariance))
    assert np.allclose((moved.mean(axis=1) - transition @ before[:, 0]) / scale, 0.0, atol=0.016)
    assert np.allclose(np.cov(moved) / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.023)
    after, truth = moved[:, :20], multivariate_normal(transition @ before[:, 0], covariance)
    assert np.allclose(model.log_transition(after, before[:, :20], 2.0), truth.logpdf(after.T), rtol=1e-9)


def test_without_noise_there_is_no_density() -> None:
    with pytest.raises(RunError, match="singular"):
        RandomWaypoint(q=0.0).log_transition(np.zeros((4, 1)), np.zeros((4, 1)), 1.0)


def test_given_points_are_passed_at_their_times() -> None:
    """Waits until 10 s, walks at 5 m/s, stops for 5 s, leaves at 45 m/s, returns, stays."""
    states = Waypoints(points=STOPS).truth(16, 5.0, np.random.default_rng(0))
    assert states[:, 0].tolist() == [0, 0, 0, 15, 30, 30, 255, 480, 705, 930, 705, 480, 255, 30, 30, 30, 30]
    assert states[:, 2].tolist() == [0, 0, 0, -20] + [-40] * 13
    assert states[:, 1].tolist() == [0, 0, 3, 3, 0, 45, 45, 45, 45, -45, -45, -45, -45, 0, 0, 0, 0]
    assert states[:, 3].tolist() == [0, 0, -4, -4] + [0] * 13


def test_a_file_gives_the_way_of_its_columns_whatever_their_order(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    lines = ["y, name, t, x"] + [f"{y},p,{t},{x}" for t, x, y in STOPS] + ["", " , "]
    path.write_text("\n".join(lines), encoding="utf-8-sig")
    given, read = Waypoints(points=STOPS), Waypoints(path=str(path))
    assert np.array_equal(given.truth(70, 1.0, np.random.default_rng(0)), read.truth(70, 1.0, np.random.default_rng(0)))
    assert list(read.check(None)) == []  # type: ignore[arg-type]


BAD = {
    "t,x\n0,0\n": r":1: .*header must name .*t, x and y",
    "t,x,y\n0,1,2\n1,z,3\n": r":3: x must be a finite number, is 'z'",
    "t,x,y\n0,1\n1,2,3\n": r":2: y must be a finite number",
    "t,x,y\n5,1,2\n\n5,1,3\n": r":4: .*5 s must be later than .*5 s",
    "t,x,y\n0,1,2\n1e-300,1,3\n": r":3: its time 1e-300 s must be later .* by 1e-09 s at least",
    "t,x,y\n0,1,2\n": r"at least two points are needed",
    "t,x,y\n": r"contains no waypoints",
    "t,x,y\n0,inf,2\n1,2,3\n": r":2: .*finite",
    "t,x,y\n0,1,2\n1,1e300,3\n": r":3: .*within",
}


@pytest.mark.parametrize(("text", "said"), BAD.items(), ids=range(len(BAD)))
def test_a_bad_file_is_refused_at_its_line(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RunError, match=said) as refused:
        Waypoints(path=str(path)).truth(3, 1.0, np.random.default_rng(0))
    (issue,) = Waypoints(path=str(path)).check(None)  # type: ignore[arg-type]
    assert str(path) in str(refused.value)
    assert (issue.path[0], issue.message) == ("motion", str(refused.value))


def test_a_missing_file_is_a_fault_and_so_are_both_or_neither(tmp_path: Path) -> None:
    (issue,) = Waypoints(path=str(tmp_path / "none.csv")).check(None)  # type: ignore[arg-type]
    assert "none.csv: cannot be read" in issue.message
    for given in ({}, {"points": STOPS, "path": "way.csv"}):
        with pytest.raises(ValueError, match="either points"):
            Waypoints(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (STOPS[:1], "at least two points are needed"),
        ((STOPS[1], STOPS[0]), r"points\[1\]: its time 10 s must be later than .*20 s"),
    ],
)
def test_points_that_make_no_way_are_refused(points: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Waypoints(points=points)


@pytest.mark.parametrize(
    "motion",
    [
        {"kind": "random_waypoint", "width": 200, "height": 200},
        {"kind": "waypoints", "points": [[0, -60, 0], [20, 40, 0], [30, 40, 0], [60, -20, 30]]},
    ],
)
def test_a_scenario_tracks_them_on_a_bench(motion: dict[str, Any]) -> None:
    places = [[-150, -150], [150, -150], [150, 150], [-150, 150]]
    summary = simulate_run({
        "name": "bench", "seed": 4, "duration": 60, "step": 1, "network": "none", "prior": {"sd": [5, 3, 5, 3]},
        "deploy": {"kind": "anchors", "places": places}, "motion": {**motion, "q": 2.0},
        "sensor": {"kind": "range", "sd": 2, "reach": math.inf}, "tracker": {"kind": "ekf"},
    })  # fmt: skip
    assert summary.run["rmse"] < 4.0
