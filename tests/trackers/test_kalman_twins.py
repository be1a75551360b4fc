"""The filters of one or several Gaussians, on recorded readings of runs, against textbook forms written here.

Nothing of wsnsim takes part in the twins: they read the priors and readings of a run, and who was in the cluster.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.helpers.recorded_filters import Recorded, Step, recorded

DT, BOUND, PULL, DRAG, Q, SIGMA = 0.04, 180.0, 0.75, 1.0, 0.002, 1.0
NOISE, INTENSITY, DECAY, SPREAD = 1.0, 1e4, 2.2, 2.0 * 1.5 / 1000
PLACE = [0, 2]
AXIS = SIGMA**2 * np.outer([DT**2 / 2, DT], [DT**2 / 2, DT]) + Q * np.array([[DT**3 / 2, DT**2 / 2], [DT**2 / 2, DT]])
PROCESS = np.kron(np.eye(2), AXIS)


def slope(x: np.ndarray) -> np.ndarray:
    """A of Jiang (2013), eqs. 1-3, at a state (4,)."""
    inside, outside = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[1.0, DT], [-DT * PULL, 1.0 - DT * DRAG]])
    result = np.zeros((4, 4))
    for axis in (0, 2):
        result[axis : axis + 2, axis : axis + 2] = inside if abs(x[axis]) <= BOUND else outside
    return result


def expected(x: np.ndarray, positions: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """The mean readings of sensors whose target is in the state x (4,)."""
    return NOISE + gains * INTENSITY * np.maximum(np.hypot(*(x[PLACE] - positions).T), 1.0) ** -DECAY


def gradient(x: np.ndarray, positions: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """(n, 4) their slopes: zero within a metre, where the distance is taken as one."""
    apart = x[PLACE] - positions
    squares = (apart**2).sum(axis=1)
    result = np.zeros((len(gains), 4))
    falls = -DECAY * gains * INTENSITY * squares ** (-DECAY / 2.0 - 1.0)
    result[:, PLACE] = np.where(squares > 1.0, falls, 0.0)[:, None] * apart
    return result


class Moments(NamedTuple):
    mean: np.ndarray
    cov: np.ndarray
    nis: float = np.nan


def sigma_points(mean: np.ndarray, cov: np.ndarray, spread: float) -> list[np.ndarray]:
    root = np.linalg.cholesky(cov)
    steps = [spread * column for column in root.T]
    return [mean, *(mean + step for step in steps), *(mean - step for step in steps)]


def unscented(before: Moments, step: Step, alpha: float, beta: float, kappa: float) -> Moments:
    """A step of the filter in Wan and van der Merwe's equations, with W0 apart in means and covariances."""
    size = before.mean.size
    scaled = alpha**2 * (size + kappa) - size
    weights = np.full(2 * size + 1, 0.5 / (size + scaled))
    of_means, of_covs = weights.copy(), weights.copy()
    of_means[0] = scaled / (size + scaled)
    of_covs[0] = of_means[0] + 1.0 - alpha**2 + beta
    mean, cov = before.mean, before.cov
    for _ in range(step.steps):
        points = np.array([slope(point) @ point for point in sigma_points(mean, cov, np.sqrt(size + scaled))])
        mean = of_means @ points
        cov = (points - mean).T @ np.diag(of_covs) @ (points - mean) + PROCESS
    if not len(step.readings):
        return Moments(mean, cov)
    points = np.array(sigma_points(mean, cov, np.sqrt(size + scaled)))
    heard = np.array([expected(point, step.positions, step.gains) for point in points])
    middle = of_means @ heard
    noise = np.diag(SPREAD * expected(mean, step.positions, step.gains) ** 2)
    width = (heard - middle).T @ np.diag(of_covs) @ (heard - middle) + noise
    across = (points - mean).T @ np.diag(of_covs) @ (heard - middle)
    gain = across @ np.linalg.inv(width)
    error = step.readings - middle
    return Moments(mean + gain @ error, cov - gain @ width @ gain.T, float(error @ np.linalg.solve(width, error)))


def cubature(before: Moments, step: Step) -> Moments:
    """A step of the filter in Arasaratnam and Haykin's equations: 2 D points of equal weight."""
    size = before.mean.size
    mean, cov = before.mean, before.cov
    for _ in range(step.steps):
        points = np.array([slope(point) @ point for point in sigma_points(mean, cov, np.sqrt(size))[1:]])
        mean = points.mean(axis=0)
        cov = (points - mean).T @ (points - mean) / (2 * size) + PROCESS
    if not len(step.readings):
        return Moments(mean, cov)
    points = np.array(sigma_points(mean, cov, np.sqrt(size))[1:])
    heard = np.array([expected(point, step.positions, step.gains) for point in points])
    middle = heard.mean(axis=0)
    noise = np.diag(SPREAD * expected(mean, step.positions, step.gains) ** 2)
    width = (heard - middle).T @ (heard - middle) / (2 * size) + noise
    gain = (points - mean).T @ (heard - middle) / (2 * size) @ np.linalg.inv(width)
    error = step.readings - middle
    return Moments(mean + gain @ error, cov - gain @ width @ gain.T, float(error @ np.linalg.solve(width, error)))


def iterated(before: Moments, step: Step, iterations: int) -> Moments:
    """A step of the iterated extended filter: Gauss-Newton steps on the sum of squares of prior and readings."""
    mean, cov = before.mean, before.cov
    for _ in range(step.steps):
        moves = slope(mean)
        mean, cov = moves @ mean, moves @ cov @ moves.T + PROCESS
    if not len(step.readings):
        return Moments(mean, cov)
    noise = np.diag(SPREAD * expected(mean, step.positions, step.gains) ** 2)
    error, rise = step.readings - expected(mean, step.positions, step.gains), gradient(mean, step.positions, step.gains)
    nis = float(error @ np.linalg.solve(rise @ cov @ rise.T + noise, error))
    point = mean
    for _ in range(iterations):
        rise = gradient(point, step.positions, step.gains)
        error = step.readings - expected(point, step.positions, step.gains)
        curvature = np.linalg.inv(cov) + rise.T @ np.linalg.solve(noise, rise)
        downhill = rise.T @ np.linalg.solve(noise, error) - np.linalg.solve(cov, point - mean)
        point = point + np.linalg.solve(curvature, downhill)
    return Moments(point, np.linalg.inv(curvature), nis)


TWINS: dict[str, Any] = {
    "kind=ukf": lambda before, step: unscented(before, step, 1.0, 2.0, 0.0),
    "kind=ukf, alpha=0.6, beta=2.5, kappa=0.5": lambda before, step: unscented(before, step, 0.6, 2.5, 0.5),
    "kind=ckf": cubature,
    "kind=ekf": lambda before, step: iterated(before, step, 1),
    "kind=ekf, iterations=4": lambda before, step: iterated(before, step, 4),
}
PLACES = {
    "standalone": ("network=none", "duration=4 s"),
    "in a network": ("duration=6 s",),
    "in a network, near the bound": ("duration=3 s", "motion.start=[-160, -20, -150, -25]"),
}


@cache
def run_of(tracker: str, place: str) -> Recorded:
    return recorded("jiang_field", *(f"tracker.{word}" for word in tracker.split(", ")), *PLACES[place])


@pytest.mark.thorough(fast=["kind=ekf-standalone", "kind=ckf-in a network", "kind=ukf-in a network"])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("tracker", TWINS)
def test_a_filter_is_its_textbook_form_on_the_readings_of_a_run(tracker: str, place: str) -> None:
    run, twin = run_of(tracker, place), TWINS[tracker]
    moments = Moments(run.mean, run.cov)
    assert len(run.steps) == len(run.means) > 60 and sum(len(step.readings) for step in run.steps) > 400
    for step, mean, cov, nis in zip(run.steps, run.means, run.covs, run.nis, strict=True):
        moments = twin(moments, step)
        assert mean == pytest.approx(moments.mean, rel=1e-9, abs=1e-9)
        assert cov == pytest.approx(moments.cov, rel=1e-9, abs=1e-9)
        assert nis == pytest.approx(moments.nis, rel=1e-7, nan_ok=True)


def test_the_filters_differ_and_a_network_hands_over() -> None:
    runs = [run_of(tracker, "in a network") for tracker in TWINS]
    assert len({tuple(run.means[-1].round(6)) for run in runs}) == len(TWINS)
    assert all(len({step.head for step in run.steps}) > 1 for run in runs)
    assert np.abs(run_of("kind=ukf", "in a network, near the bound").means[:, PLACE]).max() > BOUND


TICK, TURN_AT_START, STAY, METRES = 0.2, 0.4, 0.95, 0.5
AXES = np.kron(np.eye(2), [[TICK**3 / 3, TICK**2 / 2], [TICK**2 / 2, TICK]])


def straight(x: np.ndarray) -> np.ndarray:
    """Constant velocity; the turn rate is not used, and stays."""
    return np.array([x[0] + TICK * x[1], x[1], x[2] + TICK * x[3], x[3], x[4]])


def turning(x: np.ndarray) -> np.ndarray:
    """A coordinated turn (Bar-Shalom, Li, Kirubarajan 2001, section 11.7); complex arguments are taken."""
    rate, angle = x[4], x[4] * TICK
    along, aside = (np.sin(angle) / rate, 2.0 * np.sin(angle / 2.0) ** 2 / rate) if rate != 0.0 else (TICK, 0.0)
    return np.array([
        x[0] + along * x[1] - aside * x[3],
        np.cos(angle) * x[1] - np.sin(angle) * x[3],
        x[2] + aside * x[1] + along * x[3],
        np.sin(angle) * x[1] + np.cos(angle) * x[3],
        rate,
    ])  # fmt: skip


def jacobian(function: Any, x: np.ndarray) -> np.ndarray:
    """The derivative by a complex step, which has no cancellation."""
    return np.column_stack([function(x + 1e-30j * unit).imag / 1e-30 for unit in np.eye(5)])


def of_modes() -> list[tuple[Any, np.ndarray]]:
    """The function and the process covariance of each mode of the scenario `imm`."""
    lever = np.kron(np.eye(2), [[TICK**2 / 2], [TICK]])
    calm, rough = np.zeros((5, 5)), np.zeros((5, 5))
    calm[:4, :4] = 0.1 * lever @ lever.T
    rough[:4, :4], rough[4, 4] = 0.05 * AXES, 0.1 * TICK
    return [(straight, calm), (turning, rough)]


def interacting(modes: list[tuple[float, np.ndarray, np.ndarray]], step: Step) -> list[Any]:
    """A step of the interacting multiple models (Blom, Bar-Shalom 1988), mode by mode."""
    for k in range(step.steps):
        after = []
        for j, (move, noise) in enumerate(of_modes()):
            joint = [(STAY if i == j else 1.0 - STAY) * one[0] for i, one in enumerate(modes)]
            mean = sum(share * one[1] for share, one in zip(joint, modes, strict=True)) / sum(joint)
            cov = sum(
                share * (one[2] + np.outer(one[1] - mean, one[1] - mean))
                for share, one in zip(joint, modes, strict=True)
            ) / sum(joint)
            slopes = jacobian(move, mean)
            mean, cov, log = move(mean), slopes @ cov @ slopes.T + noise, 0.0
            if k == step.steps - 1 and len(step.readings):
                apart = mean[PLACE] - step.positions
                distances = np.hypot(*apart.T)
                rise = np.zeros((len(distances), 5))
                rise[:, PLACE] = apart / distances[:, None]
                width = rise @ cov @ rise.T + METRES**2 * np.eye(len(distances))
                error = step.readings - distances
                gain = np.linalg.solve(width, rise @ cov).T
                log = -0.5 * error @ np.linalg.solve(width, error) - 0.5 * np.linalg.slogdet(2.0 * np.pi * width)[1]
                mean, cov = mean + gain @ error, cov - gain @ rise @ cov
            after.append((np.log(sum(joint)) + log, mean, cov))
        top = max(one[0] for one in after)
        total = sum(np.exp(one[0] - top) for one in after)
        modes = [(np.exp(one[0] - top) / total, *one[1:]) for one in after]
    return modes


@pytest.mark.thorough(fast=["standalone"])
@pytest.mark.parametrize("place", [("network=none",), ()], ids=["standalone", "in a network"])
def test_the_interacting_models_are_their_textbook_form_on_the_readings_of_a_run(place: tuple[str, ...]) -> None:
    run = recorded("imm", *place)
    mean, cov = np.append(run.mean, 0.0), np.zeros((5, 5))
    cov[:4, :4], cov[4, 4] = run.cov, TURN_AT_START**2
    modes: list[Any] = [(0.5, mean, cov), (0.5, mean, cov)]
    assert len(run.steps) == 140 and (place or len({step.head for step in run.steps}) > 2)
    chances = run.state["mode_probability"]
    for k, (step, ours, spread, probabilities) in enumerate(zip(run.steps, run.means, run.covs, chances, strict=True)):
        near = 1e-9 * 10.0 ** (k / 70.0)  # the filter amplifies: 1e-15 of the first mean is 6e-10 m after 132 steps
        modes = interacting(modes, step)
        mean = sum(chance * each for chance, each, _ in modes)
        cov = sum(chance * (each_cov + np.outer(each - mean, each - mean)) for chance, each, each_cov in modes)
        assert probabilities == pytest.approx([chance for chance, _, _ in modes], rel=near, abs=near)
        assert ours == pytest.approx(mean[:4], rel=near, abs=near)
        assert spread == pytest.approx(cov[:4, :4], rel=near, abs=near)
