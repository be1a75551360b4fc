"""Constant acceleration and constant velocity against matrices written by hand, SciPy's densities, slow samplers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from pydantic import create_model
from scipy.stats import ks_2samp, kstest, multivariate_normal, truncnorm

from wsnsim.base.errors import RunError
from wsnsim.base.ports import MotionModel
from wsnsim.base.rng import derive_all
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.scenario.fields import fields_of

T = 0.5
RUAN = (0.5, 1.0, 0.5, 1.0)
ROOM = (0.0, 10.0, 0.0, 10.0)
LINE = np.array([[1, 0.5, 0.125], [0, 1, 0.5], [0, 0, 1]])
PLANE = np.array([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]])
LIU = 1e-6 * np.array([[0.015625, 0.0625, 0.125], [0.0625, 0.25, 0.5], [0.125, 0.5, 1.0]])
WEI = 0.72 * np.array([[0.015625, 0.0625, 0, 0], [0.0625, 0.25, 0, 0], [0, 0, 0.015625, 0.0625], [0, 0, 0.0625, 0.25]])
MODELS: dict[str, tuple[MotionModel, np.ndarray, np.ndarray]] = {
    "liu": (ConstantAcceleration(), LINE, LIU),
    "wei": (ConstantVelocity(), PLANE, WEI),
    "two inputs": (
        ConstantVelocity(variances=(0.5, 2.0)),
        PLANE,
        np.array([[0.5, 2, 0, 0], [2, 8, 0, 0], [0, 0, 2, 8], [0, 0, 8, 32]]) / 64,
    ),
    "diagonal": (
        ConstantVelocity(noise_input="diagonal", variances=RUAN),
        PLANE,
        np.diag([0.0078125, 0.25, 0.0078125, 0.25]),
    ),
    "direct": (ConstantVelocity(noise_input="direct", variances=RUAN), PLANE, np.diag(RUAN)),
    "one variance for four": (ConstantVelocity(noise_input="direct", variances=(0.3,)), PLANE, 0.3 * np.eye(4)),
}
CASES = pytest.mark.parametrize(("model", "transition", "covariance"), MODELS.values(), ids=MODELS)


def some_states(model: MotionModel, count: int = 40) -> np.ndarray:
    return np.random.default_rng(6).normal(0.0, 20.0, (len(model.columns), count))


def some_keys(count: int = 40) -> np.ndarray:
    return derive_all(9, np.arange(count))


def in_a_room(**changes: Any) -> ConstantVelocity:
    """Ruan's set-up."""
    given = {"noise_input": "diagonal", "variances": RUAN, "start": (0.0, 0.5, 0.0, 0.5), "room": ROOM}
    return ConstantVelocity(**{**given, "course": "in_room", **changes})


@CASES
def test_the_matrices_are_those_written_out(model: MotionModel, transition: np.ndarray, covariance: np.ndarray) -> None:
    transitions, noise = model.matrices(some_states(model), T, 0.0)
    assert transitions.shape == (40, *transition.shape)
    assert np.allclose(transitions, transition, rtol=1e-14, atol=0)
    assert np.allclose(noise, covariance, rtol=1e-14, atol=0)


def test_the_matrices_of_another_step_are_others() -> None:
    model = ConstantAcceleration(q=4.0)
    model.matrices(np.zeros((3, 1)), T)
    transitions, noise = model.matrices(np.zeros((3, 1)), 2.0)
    assert transitions[0].tolist() == [[1, 2, 2], [0, 1, 2], [0, 0, 1]]
    assert noise == pytest.approx(4.0 * np.array([[4, 4, 2], [4, 4, 2], [2, 2, 1]]))


def test_what_a_caller_does_to_the_covariance_is_his_own_affair() -> None:
    model = ConstantVelocity()
    model.matrices(np.zeros((4, 1)), T)[1][:] = 7.0
    assert np.allclose(model.matrices(np.zeros((4, 1)), T)[1], WEI, rtol=1e-14)


@CASES
def test_advancing_applies_the_matrix_at_any_time(
    model: MotionModel, transition: np.ndarray, covariance: np.ndarray
) -> None:
    states = some_states(model)
    assert np.allclose(model.advance(states, T, 0.0), transition @ states, rtol=1e-12, atol=1e-12)
    assert np.array_equal(model.advance(states, T, 31.0), model.advance(states, T, 0.0))


@CASES
def test_the_noise_of_many_particles_has_the_covariance(
    model: MotionModel, transition: np.ndarray, covariance: np.ndarray
) -> None:
    """100 000 draws: five standard errors of a mean are 0.016, of a covariance at most 0.023, in deviations."""
    count, start = 100_000, np.array(model.truth(0, T, np.random.default_rng(0))[0])
    moved = model.propagate(np.repeat(start[:, None], count, axis=1), T, some_keys(count), 0.0)
    scale = np.sqrt(np.diag(covariance))
    assert np.allclose((moved.mean(axis=1) - transition @ start) / scale, 0.0, atol=0.016)
    found, wanted = np.cov(moved) / np.outer(scale, scale), covariance / np.outer(scale, scale)
    assert np.allclose(found, wanted, atol=0.023)


@pytest.mark.parametrize("name", ["diagonal", "direct", "one variance for four"])
def test_the_transition_density_is_the_multivariate_normal(name: str) -> None:
    model, transition, covariance = MODELS[name]
    states = some_states(model)
    after = model.propagate(states, T, some_keys(), 0.0)
    truth = multivariate_normal(cov=covariance).logpdf((after - transition @ states).T)
    assert np.allclose(model.log_transition(after, states, T, 0.0), truth, rtol=1e-9)


@pytest.mark.parametrize(
    ("model", "word"),
    [
        (ConstantAcceleration(), "constant_acceleration"),
        (ConstantVelocity(), "noise_input: accelerations"),
        (ConstantVelocity(noise_input="direct", variances=(1.0, 1.0, 0.0, 1.0)), "variance of 0"),
        (ConstantVelocity(noise_input="diagonal", variances=(0.0,)), "variance of 0"),
    ],
)
def test_singular_noise_moves_particles_but_has_no_density(model: MotionModel, word: str) -> None:
    states = some_states(model)
    assert np.all(np.isfinite(model.propagate(states, T, some_keys(), 0.0)))
    with pytest.raises(RunError, match=f"singular .*{word}"):
        model.log_transition(states, states, T, 0.0)


@CASES
def test_equal_keys_move_alike_in_any_order(model: MotionModel, transition: np.ndarray, covariance: np.ndarray) -> None:
    states, order = some_states(model), np.random.default_rng(1).permutation(40)
    moved = model.propagate(states, T, some_keys(), 0.0)
    again = model.propagate(states[:, order], T, some_keys()[order], 0.0)
    assert np.allclose(again, moved[:, order], rtol=1e-13, atol=1e-13)
    assert np.allclose(model.propagate(states[:, 5:9], T, some_keys()[5:9], 0.0), moved[:, 5:9], rtol=1e-13, atol=1e-13)


@CASES
def test_a_filter_may_assume_more_noise(model: MotionModel, transition: np.ndarray, covariance: np.ndarray) -> None:
    assert np.allclose(model.assumed(100.0).matrices(some_states(model), T, 0.0)[1], 100.0 * covariance, rtol=1e-13)
    assert model.assumed(1.0) == model


@pytest.mark.parametrize(
    ("model", "start"),
    [(ConstantAcceleration(), (1.0, 0.1, 0.01)), (ConstantVelocity(), (70.0, 5.0, 21.0, 8.0))],
)
def test_a_truth_without_noise_follows_the_power_of_the_matrix(model: MotionModel, start: tuple[float, ...]) -> None:
    kind: Any = type(model)
    silent, transition = kind(truth_noise=False), model.matrices(np.zeros((len(start), 1)), T, 0.0)[0][0]
    states = silent.truth(60, T, np.random.default_rng(3))
    powers = [np.linalg.matrix_power(transition, step) @ start for step in range(61)]
    assert np.allclose(states, powers, rtol=1e-12)
    assert np.array_equal(silent.matrices(states.T, T)[1], model.matrices(states.T, T, 0.0)[1])


@pytest.mark.thorough(fast=["liu"])
@CASES
def test_a_truth_starts_at_the_start_and_keeps_to_the_model(
    model: MotionModel, transition: np.ndarray, covariance: np.ndarray
) -> None:
    """4000 steps: five standard errors of a covariance are 0.11, in deviations."""
    states = model.truth(4000, T, np.random.default_rng(3))
    assert states.shape == (4001, len(model.columns))
    assert tuple(states[0]) == model.start  # type: ignore[attr-defined]
    scale = np.sqrt(np.diag(covariance))
    noise = (states[1:] - states[:-1] @ transition.T) / scale
    assert np.allclose(noise.T @ noise / 4000, covariance / np.outer(scale, scale), atol=0.11)


@CASES
def test_a_longer_truth_begins_like_a_shorter_one(
    model: MotionModel, transition: np.ndarray, covariance: np.ndarray
) -> None:
    short, long = (model.truth(steps, T, np.random.default_rng(3)) for steps in (50, 90))
    assert np.array_equal(short, long[:51])


@pytest.mark.thorough
def test_the_start_of_a_truth_may_be_drawn_about_the_start() -> None:
    """4000 draws: five standard errors of a mean are 0.08, of a deviation 0.056, in deviations."""
    sd = (2.0, 1.0, 0.5, 0.0)
    model, rng = ConstantVelocity(start_sd=sd), np.random.default_rng(8)
    starts = np.array([model.truth(1, T, rng)[0] for _ in range(4000)]) - np.array(model.start)
    assert np.all(starts[:, 3] == 0.0)
    assert np.allclose(starts[:, :3].mean(axis=0) / sd[:3], 0.0, atol=0.08)
    assert np.allclose(starts[:, :3].std(axis=0) / sd[:3], 1.0, atol=0.056)


@pytest.mark.parametrize(("steps", "half"), [(30, 15), (31, 16), (1, 1)])
def test_a_turn_reverses_vy_at_half_of_the_steps(steps: int, half: int) -> None:
    model = ConstantVelocity(course="turn", truth_noise=False, start=(0.0, 0.5, 0.0, 0.5))
    states = model.truth(steps, T, np.random.default_rng(3))
    step = np.arange(steps + 1)
    assert np.allclose(states[:, 0], 0.25 * step)
    assert np.allclose(states[:, 2], 0.25 * np.minimum(step, 2 * half - step))
    assert states[:, 3].tolist() == [0.5] * half + [-0.5] * (steps + 1 - half)


def test_a_turn_meets_the_same_noise_as_the_free_course() -> None:
    free, turned = (ConstantVelocity(course=c).truth(20, T, np.random.default_rng(3)) for c in ("free", "turn"))  # type: ignore[arg-type]
    assert np.array_equal(free[:10], turned[:10])
    assert np.array_equal(free[:, :2], turned[:, :2])
    assert np.allclose(turned[10:, 3], free[10:, 3] - 2 * free[10, 3])


@pytest.mark.parametrize(("steps", "seeds"), [(30, 20), (60, 20), (120, 1)])
def test_a_truth_in_a_room_stays_there_and_the_same_generator_gives_the_same(steps: int, seeds: int) -> None:
    model = in_a_room(draws=10**6)
    for seed in range(seeds):
        states = model.truth(steps, T, np.random.default_rng(seed))
        assert states.shape == (steps + 1, 4)
        assert tuple(states[0]) == model.start
        assert np.all((states[:, [0, 2]] >= -0.5) & (states[:, [0, 2]] <= 10.5))
        assert np.array_equal(states, model.truth(steps, T, np.random.default_rng(seed)))


def test_one_step_in_a_room_is_a_normal_cut_off_at_its_walls() -> None:
    """px after a step is N(0.25, 0.0078125), given that it is within 0.2 and 0.35; py is never near a wall."""
    model = in_a_room(room=(0.25, 0.3, -50.0, 50.0), slack=0.05, start=(0.25, 0.0, 0.0, 0.0))
    rng, deviation = np.random.default_rng(4), np.sqrt(0.0078125)
    ends = np.array([model.truth(1, T, rng)[1] for _ in range(1500)])
    cut = truncnorm(-0.05 / deviation, 0.10 / deviation, loc=0.25, scale=deviation)
    assert kstest(ends[:, 0], cut.cdf).pvalue > 0.01
    assert kstest(ends[:, 2] / deviation, "norm").pvalue > 0.01


@pytest.mark.thorough
def test_truths_in_a_room_are_distributed_as_one_by_one_rejection_gives_them() -> None:
    model, rng = (
        in_a_room(room=(-1.0, 1.0, -1.0, 1.0), slack=0.2, start_sd=(0.5, 0.1, 0.5, 0.1)),
        np.random.default_rng(7),
    )
    found = np.array([model.truth(4, T, rng)[[0, 2, 4]].ravel() for _ in range(800)])
    slow, deviation = [], np.sqrt(np.diag(MODELS["diagonal"][2]))
    while len(slow) < 800:
        states = [np.array(model.start) + np.array([0.5, 0.1, 0.5, 0.1]) * rng.standard_normal(4)]
        for _ in range(4):
            states.append(PLANE @ states[-1] + deviation * rng.standard_normal(4))
        if all(max(abs(state[0]), abs(state[2])) <= 1.2 for state in states):
            slow.append(np.array(states)[[0, 2, 4]].ravel())
    for column, other in zip(found.T, np.array(slow).T, strict=True):
        assert ks_2samp(column, other).pvalue > 1e-3  # of twelve: once in a hundred of seeds, were they alike


def test_a_room_that_none_keeps_to_is_an_error_that_says_what_was_tried() -> None:
    model = in_a_room(noise_input="direct", draws=700)
    said = "none of 700 sampled trajectories of 300 steps stayed along x and y in the room x 0 to 10 m, y 0 to 10 m"
    with pytest.raises(RunError, match=re.escape(said)):
        model.truth(300, T, np.random.default_rng(1))


def test_no_more_truths_are_drawn_than_allowed() -> None:
    """Of single draws 0.585 end within the walls; of 400, within five standard errors, 185 to 283."""
    model, kept = in_a_room(room=(0.25, 0.3, -50.0, 50.0), slack=0.05, start=(0.25, 0.0, 0.0, 0.0), draws=1), 0
    for seed in range(400):
        try:
            model.truth(1, T, np.random.default_rng(seed))
        except RunError:
            continue
        kept += 1
    assert 185 <= kept <= 283


def test_a_long_truth_in_a_room_is_drawn_in_few_at_a_time() -> None:
    model = in_a_room(variances=(0.0,), start_sd=(0.0, 0.0, 0.0, 0.5), start=(5.0, 0.0, 5.0, 0.0), draws=10**6)
    states = model.truth(2000, 0.01, np.random.default_rng(1))
    assert states.shape == (2001, 4)
    assert np.all(np.abs(states[:, 2] - 5.0) <= 5.5)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"variances": (1.0, 2.0, 3.0)}, "variances: 3 values; noise_input: accelerations takes 1"),
        ({"variances": ()}, "variances: 0 values"),
        ({"noise_input": "direct", "variances": (1.0, 2.0)}, "noise_input: direct takes 1 for all its inputs, or 4"),
        ({"course": "in_room"}, "course: in_room needs room: [xmin, xmax, ymin, ymax]"),
        ({"course": "in_room", "room": (0.0, 0.0, 0.0, 1.0)}, "xmin < xmax and ymin < ymax are needed"),
        ({"course": "in_room", "room": ROOM}, "start: (70, 21) m is outside the room x 0 to 10 m"),
        ({"course": "in_room", "room": (0, 100, 0, 100), "truth_noise": False}, "all samples are equal"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_words(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        ConstantVelocity(**given)


@pytest.mark.parametrize("model", [ConstantAcceleration(q=1e9), ConstantVelocity(variances=(1e9,))])
def test_a_target_that_leaves_every_field_is_an_error(model: MotionModel) -> None:
    with pytest.raises(RunError, match=r"diverges: it is beyond 1e\+12 m at 1e\+06 s"):
        model.truth(10, 1e6, np.random.default_rng(3))


def test_a_scenario_can_write_every_field() -> None:
    model = create_model("Motion", **fields_of(ConstantVelocity))  # type: ignore[call-overload]
    written = {"course": "in_room", "room": ["0 m", 10, 0, 10], "variances": [1, 2], "start_sd": [1, 0, 1, 0]}
    read = ConstantVelocity(**{**model(**written).model_dump(), "start": (1.0, 0.0, 1.0, 0.0)})
    assert read == ConstantVelocity(
        course="in_room", room=ROOM, variances=(1.0, 2.0), start_sd=(1.0, 0.0, 1.0, 0.0), start=(1.0, 0.0, 1.0, 0.0)
    )
    line = create_model("Motion", **fields_of(ConstantAcceleration))  # type: ignore[call-overload]
    assert ConstantAcceleration(**line(q="1 m2/s4", truth_noise=False).model_dump()).q == 1.0
