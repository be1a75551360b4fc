"""Gauss-Markov against the law of Ornstein and Uhlenbeck integrated in fine steps, turns against circles."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import kstest, multivariate_normal

from wsnsim.base.errors import RunError
from wsnsim.base.ports import MotionModel
from wsnsim.base.rng import derive_all
from wsnsim.experiment import simulate_run
from wsnsim.models.mobility import CoordinatedTurn, GaussMarkov

DRIFTING = GaussMarkov(memory=4.0, mean=(2.0, -1.0), sd=3.0)
TURNING = CoordinatedTurn(q=0.3, turn_q=0.02)
STATE = {"gauss_markov": [3.0, -1.0, 5.0, 2.0], "coordinated_turn": [3.0, -1.0, 5.0, 2.0, 0.4]}
BOTH = pytest.mark.parametrize(
    ("model", "state"), [(DRIFTING, STATE["gauss_markov"]), (TURNING, STATE["coordinated_turn"])]
)


def integrated(model: GaussMarkov, dt: float, parts: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """F and Q (2, 2) of one axis over dt, by midpoint sums over e^{A s} of dx = v ds, dv = -v/τ ds + σ √(2/τ) dw."""
    ages = (np.arange(parts) + 0.5) * dt / parts
    kick = np.stack([model.memory * (1 - np.exp(-ages / model.memory)), np.exp(-ages / model.memory)])
    noise = 2.0 * model.sd**2 / model.memory * (kick @ kick.T) * dt / parts
    decay = math.exp(-dt / model.memory)
    return np.array([[1.0, model.memory * (1 - decay)], [0.0, decay]]), noise


def turned(state: np.ndarray, dt: float) -> np.ndarray:
    """The state after dt by a solver of ẍ = -ω ẏ, ÿ = ω ẋ."""

    def slope(_time: float, s: np.ndarray) -> list[float]:
        return [s[1], -s[4] * s[3], s[3], s[4] * s[1], 0.0]

    solved: np.ndarray = solve_ivp(slope, (0.0, dt), state, rtol=1e-11, atol=1e-11).y[:, -1]
    return solved


@pytest.mark.parametrize("dt", [0.5, 4.0, 30.0])
def test_a_step_is_the_integral_of_the_law(dt: float) -> None:
    transition, noise = integrated(DRIFTING, dt)
    transitions, found = DRIFTING.matrices(np.zeros((4, 2)), dt)
    assert np.allclose(transitions, np.kron(np.eye(2), transition), rtol=1e-12)
    assert np.allclose(found, np.kron(np.eye(2), noise), rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("ratio", [1e-9, 1e-5, 9.9e-4, 1.01e-3, 0.02, 0.7, 50.0])
def test_the_covariance_keeps_its_digits_where_the_step_is_short(ratio: float) -> None:
    """Sixty digits of 2r - 3 + 4a - a², (1 - a)², 1 - a² with a = e^-r, at τ = 1 s and σ = 1 m/s."""
    with localcontext() as context:
        context.prec = 60
        r = Decimal(ratio)
        a = (-r).exp()
        position, across, velocity = 2 * r - 3 + 4 * a - a * a, (1 - a) ** 2, 1 - a * a
        determinant = float(position * velocity - across * across)
    found = GaussMarkov(memory=1.0, sd=1.0).matrices(np.zeros((4, 1)), ratio)[1][:2, :2]
    wanted = np.array([[position, across], [across, velocity]], dtype=np.float64)
    assert np.allclose(found, wanted, rtol=2e-6, atol=0)
    assert found[0, 0] * found[1, 1] - found[0, 1] ** 2 == pytest.approx(determinant, rel=1e-5)


def test_two_half_steps_are_one_step() -> None:
    """Chapman and Kolmogorov: F = f f, Q = f q fᵀ + q, and the mean state likewise."""
    half, whole = DRIFTING.matrices(np.zeros((4, 1)), 1.5), DRIFTING.matrices(np.zeros((4, 1)), 3.0)
    f = half[0][0]
    assert np.allclose(f @ f, whole[0][0], rtol=1e-13)
    assert np.allclose(f @ half[1] @ f.T + half[1], whole[1], rtol=1e-11)
    states = np.random.default_rng(1).normal(0, 9, (4, 10))
    twice = DRIFTING.advance(DRIFTING.advance(states, 1.5), 1.5)
    assert np.allclose(twice, DRIFTING.advance(states, 3.0), rtol=1e-12, atol=1e-12)


def test_a_target_at_its_mean_velocity_keeps_it() -> None:
    states = DRIFTING.advance(np.array([[7.0], [2.0], [1.0], [-1.0]]), 10.0)
    assert np.allclose(states[:, 0], [27.0, 2.0, -9.0, -1.0])


@pytest.mark.thorough
def test_the_velocity_forgets_itself_exponentially() -> None:
    """e^(-t/τ) at lags of 0, τ/2, τ, 2τ and 4τ, from 60 truths; tolerance: five deviations of their mean."""
    rng, lags = np.random.default_rng(2), [0, 1, 2, 4, 8]
    found = []
    for _ in range(60):
        apart = DRIFTING.truth(800, 2.0, rng)[:, [1, 3]] - DRIFTING.mean
        found.append([np.mean(apart[: 800 - lag] * apart[lag:800]) / 9.0 for lag in lags])
    error = np.std(found, axis=0) / math.sqrt(60)
    assert np.all(error < 0.02), "or the test says nothing"
    assert np.all(np.abs(np.mean(found, axis=0) - np.exp(-np.array(lags) / 2.0)) < 5 * error)


@pytest.mark.thorough
def test_velocities_are_stationary_from_the_start_and_places_spread_as_their_integral() -> None:
    """Var x(t) = 2 σ² τ² (t/τ - 1 + e^(-t/τ)) of 4000 truths; five standard errors of a variance are 0.11 of it."""
    rng = np.random.default_rng(3)
    states = np.array([DRIFTING.truth(4, 2.5, rng) for _ in range(4000)])
    for step in (0, 1, 4):
        assert kstest((states[:, step, 1] - 2.0) / 3.0, "norm").pvalue > 1e-3
        assert kstest((states[:, step, 3] + 1.0) / 3.0, "norm").pvalue > 1e-3
    for step in (1, 4):
        r = 2.5 * step / 4.0
        spread = 2.0 * 9.0 * 16.0 * (r - 1.0 + math.exp(-r))
        assert states[:, step, 0].var() == pytest.approx(spread, rel=0.11)
        assert abs(states[:, step, 0].mean() - 2.0 * 2.5 * step) < 5 * math.sqrt(spread / 4000)
    assert np.all(states[:, 0, [0, 2]] == 0.0)
    assert abs(np.corrcoef(states[:, 4, 0], states[:, 4, 2])[0, 1]) < 5 / math.sqrt(4000)


def test_a_box_keeps_the_truth_and_mirrors_what_left_it() -> None:
    """Until the first wall the way is the free one; there, place and velocity are its mirror image."""
    box = (-20.0, 30.0, -15.0, 15.0)
    free, kept = (GaussMarkov(box=given).truth(3000, 1.0, np.random.default_rng(4)) for given in (None, box))
    assert np.any(np.abs(free[:, 0]) > 100), "the walls matter"
    assert np.all((kept[:, 0] >= -20) & (kept[:, 0] <= 30) & (kept[:, 2] >= -15) & (kept[:, 2] <= 15))
    out = int(np.argmax((free[:, 0] < -20) | (free[:, 0] > 30)))
    wall = 30.0 if free[out, 0] > 30 else -20.0
    assert np.allclose(kept[:out, :2], free[:out, :2])
    assert np.allclose(kept[out, :2], [2 * wall - free[out, 0], -free[out, 1]])


def test_filters_do_not_know_of_the_box() -> None:
    boxed, states = GaussMarkov(box=(-9.0, 9.0, -9.0, 9.0)), np.array([[8.9], [5.0], [0.0], [0.0]])
    assert np.array_equal(boxed.advance(states, 5.0), GaussMarkov().advance(states, 5.0))
    assert boxed.advance(states, 5.0)[0, 0] > 9.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"box": (5.0, -5.0, 0.0, 9.0)}, "box: xmin < xmax"),
        ({"box": (-5.0, 5.0, -5.0, 5.0), "start": (6.0, 0.0)}, "start: .*outside the box"),
    ],
)
def test_a_box_that_cannot_be_kept_to_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        GaussMarkov(**changes)


def test_a_full_turn_returns_to_where_it_began() -> None:
    """v/ω = 5/0.1 = 50 m: a turn takes 2π/ω s, at its half the target is 100 m to its left."""
    state = np.array([[10.0], [5.0], [-20.0], [0.0], [0.1]])
    turn = 2 * math.pi / 0.1
    assert np.allclose(TURNING.advance(state, turn), state, atol=1e-11)
    assert np.allclose(TURNING.advance(state, turn / 2)[:, 0], [10.0, -5.0, 80.0, 0.0, 0.1], atol=1e-11)
    walked = state
    for _ in range(100):
        walked = TURNING.advance(walked, turn / 100)
        assert math.hypot(walked[0, 0] - 10.0, walked[2, 0] - 30.0) == pytest.approx(50.0)
    assert np.allclose(walked, state, atol=1e-10)


@pytest.mark.parametrize("rate", [-2.0, -0.3, 1e-7, 0.05, 1.0])
def test_a_step_solves_the_equation_of_the_turn(rate: float) -> None:
    state = np.array([3.0, -1.0, 5.0, 2.0, rate])
    assert np.allclose(TURNING.advance(state[:, None], 3.0)[:, 0], turned(state, 3.0), rtol=1e-8, atol=1e-8)


def test_without_turning_it_is_constant_velocity() -> None:
    for rate in (0.0, 1e-12, -1e-9):
        moved = TURNING.advance(np.array([[3.0], [-1.0], [5.0], [2.0], [rate]]), 2.0)[:, 0]
        assert np.allclose(moved, [1.0, -1.0, 9.0, 2.0, rate], atol=1e-8)


@pytest.mark.parametrize("rate", [0.0, 1e-7, 4.9e-5, 5.1e-5, -3e-3, 0.2, -1.5])
def test_the_jacobian_is_that_of_differences(rate: float) -> None:
    """Central differences of 1e-4 err by about 1e-8 here; the angle at which a series takes over is 1e-4 rad."""
    state, small = np.array([3.0, -7.0, 5.0, 4.0, rate]), 1e-4
    moved = [TURNING.advance((state[:, None] + sign * small * np.eye(5)), 2.0) for sign in (1.0, -1.0)]
    found = TURNING.matrices(np.repeat(state[:, None], 3, axis=1), 2.0)[0]
    assert found.shape == (3, 5, 5)
    assert np.allclose(found, (moved[0] - moved[1]) / (2 * small), atol=2e-7)


def test_the_noise_of_a_turn_is_that_of_white_accelerations() -> None:
    covariance = np.zeros((5, 5))
    covariance[:4, :4] = 0.3 * np.kron(np.eye(2), [[8.0 / 3.0, 2.0], [2.0, 2.0]])
    covariance[4, 4] = 0.02 * 2.0
    assert np.allclose(TURNING.matrices(np.zeros((5, 1)), 2.0)[1], covariance)


@pytest.mark.parametrize("rates", [{"q": 0.0, "turn_q": 0.0, "start": (0.0, 5.0, 0.0, 0.0, 0.1)}])
def test_a_truth_without_noise_is_a_circle(rates: dict[str, Any]) -> None:
    states = CoordinatedTurn(**rates).truth(500, 0.5, np.random.default_rng(1))
    assert np.allclose(np.hypot(states[:, 0], states[:, 2] - 50.0), 50.0)
    assert np.allclose(np.hypot(states[:, 1], states[:, 3]), 5.0)


@BOTH
def test_many_particles_have_the_mean_and_the_covariance(model: MotionModel, state: list[float]) -> None:
    """100 000 draws: five standard errors of a mean are 0.016, of a covariance at most 0.023, in deviations."""
    before = np.repeat(np.array(state)[:, None], 100_000, axis=1)
    moved = model.propagate(before, 2.0, derive_all(3, np.arange(100_000)), 0.0)
    covariance = model.matrices(before[:, :1], 2.0, 0.0)[1]
    scale = np.sqrt(np.diag(covariance))
    assert np.allclose((moved.mean(axis=1) - model.advance(before[:, :1], 2.0, 0.0)[:, 0]) / scale, 0.0, atol=0.016)
    assert np.allclose(np.cov(moved) / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.023)


@BOTH
def test_equal_keys_move_alike_in_any_order(model: MotionModel, state: list[float]) -> None:
    states, keys = np.random.default_rng(1).normal(0, 2, (len(state), 40)), derive_all(9, np.arange(40))
    moved, order = model.propagate(states, 2.0, keys, 0.0), np.random.default_rng(2).permutation(40)
    again = model.propagate(states[:, order], 2.0, keys[order], 0.0)
    assert np.allclose(again, moved[:, order], rtol=1e-13, atol=1e-13)


@BOTH
def test_the_transition_has_the_density_of_a_gaussian(model: MotionModel, state: list[float]) -> None:
    before = np.repeat(np.array(state)[:, None], 30, axis=1)
    after = model.propagate(before, 2.0, derive_all(4, np.arange(30)), 0.0)
    truth = multivariate_normal(model.advance(before, 2.0, 0.0)[:, 0], model.matrices(before, 2.0, 0.0)[1])
    assert np.allclose(model.log_transition(after, before, 2.0, 0.0), truth.logpdf(after.T), rtol=1e-9)
    after[0, 3] = np.nan
    assert model.log_transition(after, before, 2.0, 0.0)[3] == -np.inf


@pytest.mark.parametrize("model", [GaussMarkov(sd=0.0), CoordinatedTurn(q=0.0), CoordinatedTurn(turn_q=0.0)])
def test_singular_noise_moves_particles_but_has_no_density(model: MotionModel) -> None:
    states = np.ones((len(model.columns), 2))
    assert np.all(np.isfinite(model.propagate(states, 1.0, derive_all(1, np.arange(2)), 0.0)))
    with pytest.raises(RunError, match="singular"):
        model.log_transition(states, states, 1.0, 0.0)


@BOTH
def test_a_filter_may_assume_more_noise(model: MotionModel, state: list[float]) -> None:
    states = np.array(state)[:, None]
    more, ours = (some.matrices(states, 2.0, 0.0) for some in (model.assumed(9.0), model))
    assert np.array_equal(more[0], ours[0])
    assert np.allclose(more[1], 9.0 * ours[1], rtol=1e-12)
    assert model.assumed(1.0) == model


@BOTH
def test_a_longer_truth_begins_like_a_shorter_one(model: MotionModel, state: list[float]) -> None:
    short, long = (model.truth(steps, 1.0, np.random.default_rng(3)) for steps in (20, 50))
    assert np.array_equal(short, long[:21])


@pytest.mark.thorough(fast=["gauss_markov-ekf"])
@pytest.mark.parametrize("tracker", ["ekf", "pf", "gpf"])
@pytest.mark.parametrize("kind", ["gauss_markov", "coordinated_turn"])
def test_trackers_that_know_the_law_follow_on_a_bench(kind: str, tracker: str) -> None:
    """Four ranges of 2 m give a place to about 2 m at every step; a filter does no worse than twice that."""
    spread = [5, 3, 5, 3] + [0.05] * (kind == "coordinated_turn")
    summary = simulate_run({
        "name": "bench", "seed": 3, "duration": 60, "step": 1, "network": "none", "prior": {"sd": spread},
        "deploy": {"kind": "anchors", "places": [[-150, -150], [150, -150], [150, 150], [-150, 150]]},
        "motion": {"kind": kind}, "sensor": {"kind": "range", "sd": 2, "reach": math.inf}, "tracker": {"kind": tracker},
    })  # fmt: skip
    assert summary.run["rmse"] < 4.0
