"""A bank of Kalman filters, one per motion model of an interacting multiple model estimator, and the steps of it.

    mixed(bank, chain) -> predicted(bank, modes, dt, time) -> updated(bank, modes, seen, scene)

Source: Blom, Bar-Shalom (1988).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel, Scene
from wsnsim.base.vector_readings import near, rows
from wsnsim.kernels.relay import kalman
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence

LEAST = 1e-300
"""A predicted probability of a mode that is not above this counts as none: nothing is mixed into it (our choice)."""


class Modes(NamedTuple):
    """The motion models of the modes, in one state.

    Attributes:
        columns: The K names of the state's columns: those of the model that has most.
        place: (P,) which of them are the position.
        models: M motion models.
        rows: Which of the K columns each model moves; the others stay as they are.
        own: Which of them the scenario's motion has, in its order.
    """

    columns: tuple[str, ...]
    place: tuple[int, ...]
    models: tuple[MotionModel, ...]
    rows: tuple[list[int], ...]
    own: list[int]


class Bank(NamedTuple):
    """One Gaussian per mode: means (K, M), covariances (M, K, K) and the modes' probabilities (M,)."""

    means: Floats
    covs: Floats
    chances: Floats


NO_BANK = Bank(np.empty((0, 0)), np.empty((0, 0, 0)), np.empty(0))


@lru_cache(maxsize=64)
def modes_of(models: tuple[MotionModel, ...], motion: Any) -> Modes:
    """The modes of these models. Raises ValueError if no one model has all the columns, or positions differ."""
    widest = max(models, key=lambda model: len(model.columns))
    columns, units = tuple(widest.columns), dict(zip(widest.columns, widest.units, strict=True))
    where = [columns[place] for place in widest.position]
    for model in (*models, motion):
        alien = [name for name, unit in zip(model.columns, model.units, strict=True) if units.get(name) != unit]
        if alien or [model.columns[place] for place in model.position] != where:
            whose = "the scenario's motion" if model is motion else "another model"
            raise ValueError(
                f"one model must have all columns of the others: the state ({' '.join(columns)}) of the widest lacks "
                f"{', '.join(alien) or 'the position'} of {whose} ({' '.join(model.columns)})"
            )
    each = tuple([columns.index(name) for name in model.columns] for model in models)
    return Modes(columns, tuple(widest.position), models, each, [columns.index(name) for name in motion.columns])


@lru_cache(maxsize=64)
def chain_of(transition: tuple[tuple[float, ...], ...] | None, stay: float, count: int) -> Floats:
    """(M, M) the probability that mode i is followed by mode j."""
    if transition is not None:
        return np.array(transition)
    if count == 1:
        return np.ones((1, 1))
    chain = np.full((count, count), (1.0 - stay) / (count - 1))
    np.fill_diagonal(chain, stay)
    return chain


def mixed(bank: Bank, chain: Floats) -> Bank:
    """The mixtures from which the filters of the modes start a step, and the predicted probabilities."""
    joint = chain * bank.chances[:, None]
    chances = joint.sum(axis=0)
    possible = chances > LEAST
    shares = np.where(possible, joint / np.where(possible, chances, 1.0), np.eye(chances.size))
    means = bank.means @ shares
    around = bank.means[:, :, None] - means[:, None, :]
    spreads = np.einsum("ij,kij,lij->jkl", shares, around, around)
    return Bank(means, spreads + np.einsum("ij,ikl->jkl", shares, bank.covs), chances)


def predicted(bank: Bank, modes: Modes, dt: float, time: float) -> Bank:
    """Each filter one step later, by its own motion model; columns that it lacks stay as they are."""
    means, covs = bank.means.copy(), np.empty(bank.covs.shape)
    for mode, (model, own) in enumerate(zip(modes.models, modes.rows, strict=True)):
        point = np.ascontiguousarray(bank.means[own, mode][:, None])
        transitions, process = model.matrices(point, dt, time)
        moves, noise = np.eye(len(means)), np.zeros(covs.shape[1:])
        moves[np.ix_(own, own)], noise[np.ix_(own, own)] = transitions[0], process
        means[own, mode] = model.advance(point, dt, time)[:, 0]
        covs[mode] = symmetric(moves @ bank.covs[mode] @ moves.T + noise)
    return Bank(means, covs, bank.chances)


def updated(bank: Bank, modes: Modes, seen: Evidence, scene: Scene) -> Bank:
    """Each filter updated with the readings, and the modes weighed by log N(ν; 0, S)."""
    place, sensor = list(modes.place), scene.sensor
    linear = sensor.linearise(np.ascontiguousarray(bank.means[place]), seen.positions, seen.traits)
    measured = near(sensor, rows(sensor, seen.readings)[:, None], linear[0])
    known = np.isfinite(measured - linear[0]) & (linear[2] > 0.0) & (linear[2] < np.inf)
    used = known.all(axis=1)
    expected, gradients, variances = (array[used] for array in linear)
    heard = np.broadcast_to(measured, known.shape)[used]
    means, covs, logs = bank.means.copy(), bank.covs.copy(), np.empty(bank.chances.size)
    for mode in range(logs.size):
        slopes, noise = gradients[..., mode], variances[:, mode]
        information = (slopes / noise[:, None]).T @ slopes
        width = np.eye(len(place)) + bank.covs[mode][np.ix_(place, place)] @ information  # |S| = |R| |I + P Hᵀ R⁻¹ H|
        mean, cov = np.ascontiguousarray(means[:, mode]), covs[mode]
        h, slope, r = (np.ascontiguousarray(array[..., mode : mode + 1]) for array in (expected, gradients, variances))
        square, _ = kalman(mean, cov, h, slope, r, np.ascontiguousarray(heard[:, mode]), np.array(place))
        means[:, mode] = mean
        logs[mode] = -0.5 * (square + np.log(noise).sum() + np.linalg.slogdet(width)[1])
    return Bank(means, covs, _weighed(bank.chances, logs))


def _weighed(chances: Floats, logs: Floats) -> Floats:
    """The probabilities (M,) after log-likelihoods; the predicted ones if nothing is left of them."""
    with np.errstate(divide="ignore"):
        weights = np.log(chances) + logs
    top = weights.max()
    if not np.isfinite(top):
        return chances
    weights = np.exp(weights - top)
    result: Floats = weights / weights.sum()
    return result


def moments_of_bank(bank: Bank) -> tuple[Floats, Floats]:
    """Mean (K,) and covariance (K, K) of all modes."""
    mean: Floats = bank.means @ bank.chances
    around = bank.means - mean[:, None]
    return mean, symmetric(np.tensordot(bank.chances, bank.covs, axes=1) + (around * bank.chances) @ around.T)
