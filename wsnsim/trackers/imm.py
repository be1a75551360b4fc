"""The interacting multiple model estimator: one Kalman filter per motion model, mixed by a Markov chain of modes.

    mixed(bank, chain) -> predicted(bank, modes, dt, time) -> updated(bank, modes, seen, scene)

Source: Blom, Bar-Shalom (1988). Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any, ClassVar, NamedTuple, cast

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import MotionModel, Scene, SensorModel
from wsnsim.base.requests import Compute, Flow, Send
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.relay import kalman
from wsnsim.trackers.shared import gaussian_port
from wsnsim.trackers.shared.heads import GaussianBelief, LateFilter
from wsnsim.trackers.shared.moments import prediction_cycles, symmetric, update_cycles
from wsnsim.trackers.shared.readings import (
    Evidence,
    arrived_groups,
    arrived_probabilities,
    gather_readings,
    moment_packets,
    number_packets,
    parcel,
)

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


PROBABILITY = Quantity("", ge=0.0, le=1.0)
ROUNDING = 1e-9
"""The rows of a transition matrix may miss the sum of 1 by this."""


@dataclass(frozen=True, slots=True)
class ModeBelief(GaussianBelief):
    """The mixture's moments in the columns of the scenario's motion, and the filters of the modes."""

    bank: Bank = field(default=NO_BANK)


@part
class InteractingModels(LateFilter):
    """Interacting multiple model estimator in the head, of extended Kalman filters on all readings that reach it.

    Each step, the filter of a mode starts from a mixture of all, predicts with its own motion model, and updates with
    all readings, linearised at its own prediction, where their variances are taken too; the modes are weighed by the
    likelihoods of the readings. The estimate is the mixture's mean and covariance.

    `models` lists the motion models. Their states may have different columns, if one of them has all the columns of the
    others (`constant_velocity` and `coordinated_turn`): a column that a model lacks, such as the turn rate, stays as it
    is in its mode, with its variance. A column that the scenario's own motion lacks starts at 0 with the standard
    deviation `added_sd`; the estimate has the columns of the scenario's motion. Listed models are taken as they are:
    `assumes.noise_scale` does not change them, nor do their `start` and `course` matter. Without a list, the modes are
    the motion that the filter assumes, and the same with `manoeuvre` times its process noise.

    The modes begin with equal probabilities. A handover carries each mode's mean and covariance and the probabilities;
    a mode that is lost on the way starts from the mixture of those that arrive. The likelihood of a mode is that of the
    readings that are finite for all modes. (All our choice.) The probabilities are recorded in the table
    `tracker_state` as `mode_probability`. A mixture has no innovation, hence no NIS.

    Source: Blom, Bar-Shalom (1988); Bar-Shalom, Li, Kirubarajan (2001), section 11.6.6.
    """

    assumes_gaussian: ClassVar[bool] = True

    models: Annotated[tuple[MotionModel, ...], OfRole("motion"), "a motion model per mode; none: see manoeuvre"] = ()
    manoeuvre: Annotated[
        float, Quantity("", ge=1e-9, le=1e9), "without models: factor of the second mode's process covariance"
    ] = 100.0
    stay: Annotated[float, PROBABILITY, "probability that a mode lasts for a step; the others share the rest"] = 0.95
    transition: Annotated[
        tuple[tuple[float, ...], ...] | None,
        PROBABILITY,
        "probabilities of the modes in the next step, a row per present mode; in place of stay",
    ] = None
    added_sd: Annotated[
        float,
        Quantity("", gt=0, le=1e9, label="SI"),
        "deviation at the start of columns that the scenario's motion lacks, in SI",
    ] = 0.2

    def __post_init__(self) -> None:
        """Raises ValueError if the transition matrix is none, or is not that of these modes."""
        count = len(self.models) or 2
        if self.transition is None:
            return
        if len(self.transition) != count or any(len(row) != count for row in self.transition):
            raise ValueError(f"transition: {count} modes need {count} rows of {count} probabilities")
        for number, row in enumerate(self.transition):
            if abs(sum(row) - 1.0) > ROUNDING:
                raise ValueError(f"transition: row {number} must add up to 1, adds up to {sum(row):g}")

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for models whose columns do not fit each other, or the scenario's motion."""
        for motion in dict.fromkeys(setup.filter_motions):
            try:
                self._modes(motion)
            except ValueError as error:
                yield Issue(("tracker", "models"), str(error))

    def start(self, prior: Estimate, scene: Scene) -> Flow[ModeBelief]:
        """The prior in every mode, with equal probabilities."""
        bank = self.bank_of(prior.mean, prior.cov, self._modes(scene.motion))
        return ModeBelief(prior.mean, prior.cov, scene.head, bank=bank)
        yield  # a flow without requests

    def bank_of(self, mean: Floats, cov: Floats, modes: Modes) -> Bank:
        """The bank of a prior in the columns of the scenario's motion."""
        size, count = len(modes.columns), len(modes.models)
        full, spread = np.zeros(size), self.added_sd**2 * np.eye(size)
        full[modes.own], spread[np.ix_(modes.own, modes.own)] = mean, cov
        return Bank(np.repeat(full[:, None], count, axis=1), np.repeat(spread[None], count, axis=0), _equal(count))

    def gaussian(self, motion: MotionModel) -> ModesPort:
        """The filter for trackers of several targets."""
        modes = self._modes(motion)
        return ModesPort(self, modes, chain_of(self.transition, self.stay, len(modes.models)))

    def one_step(self, belief: ModeBelief, scene: Scene) -> Flow[ModeBelief]:
        """One step: N_act - 1 readings reach the head; the modes mix, predict, and update with what arrived."""
        seen = yield from gather_readings(scene)
        modes = self._modes(scene.motion)
        yield Compute(_cycles(len(modes.columns), len(modes.place), len(modes.models), seen.readings.size, scene.steps))
        bank = self._stepped(belief.bank, modes, scene, scene.since, scene.steps)
        if seen.ids:
            bank = updated(bank, modes, seen, scene)
        return _belief(bank, modes, scene.head)

    def deliver(self, belief: ModeBelief, scene: Scene, successor: int) -> Flow[ModeBelief | None]:
        """The packets of M means and covariances and ceil(M / 4) of probabilities; without a mode there is no track.

        Probabilities that are lost share what is missing to one.
        """
        bank, modes = belief.bank, self._modes(scene.motion)
        size, count = bank.means.shape
        each = moment_packets(size)
        mask = yield Send(successor, parcel(tuple(bank), count * each + number_packets(count), "handover"))
        whole = arrived_groups(mask, count, each)
        if not whole.any():
            return None
        chances = arrived_probabilities(bank.chances, mask[count * each :])
        if whole.all():
            return _belief(bank._replace(chances=chances), modes, successor)
        known = chances[whole].sum()
        shares = chances[whole] / known if known > 0.0 else _equal(int(np.count_nonzero(whole)))
        mean, cov = moments_of_bank(Bank(bank.means[:, whole], bank.covs[whole], shares))
        means, covs = np.where(whole, bank.means, mean[:, None]), np.where(whole[:, None, None], bank.covs, cov)
        return _belief(Bank(means, covs, chances), modes, successor)

    def forecast(self, belief: ModeBelief, scene: Scene, ahead: int) -> Estimate:
        """The mixture `ahead` steps on."""
        modes, now = self._modes(scene.motion), scene.step * scene.dt
        after = _belief(self._stepped(belief.bank, modes, scene, now, ahead), modes, belief.head)
        return Estimate(after.mean, after.cov)

    def report_state(self, belief: ModeBelief) -> dict[str, Floats]:
        """The probabilities of the modes, for the table `tracker_state`."""
        return {"mode_probability": belief.bank.chances}

    def _modes(self, motion: MotionModel) -> Modes:
        return modes_of(self.models or (motion, motion.assumed(self.manoeuvre)), cast(Hashable, motion))

    def _stepped(self, bank: Bank, modes: Modes, scene: Scene, time: float, steps: int) -> Bank:
        """The bank some steps later; in each, the modes mix and predict."""
        chain = chain_of(self.transition, self.stay, len(modes.models))
        for step in range(steps):
            bank = predicted(mixed(bank, chain), modes, scene.dt, time + step * scene.dt)
        return bank


class ModesPort:
    """The estimator for trackers of several targets; its modes mix as those of a single one."""

    def __init__(self, tracker: InteractingModels, modes: Modes, chain: Floats) -> None:
        self._tracker, self._modes, self._chain, self.own = tracker, modes, chain, modes.own

    def begun(self, mean: Floats, cov: Floats) -> gaussian_port.GaussianBank:
        """The prior in every mode."""
        return _stacked([self._tracker.bank_of(mean, cov, self._modes)])

    def predicted(self, bank: gaussian_port.GaussianBank, dt: float, time: float) -> gaussian_port.GaussianBank:
        """The bank one step later: of each target, the modes mix and predict."""
        each = [Bank(means.T, covs, chances) for means, covs, chances in zip(*bank, strict=True)]
        return _stacked([predicted(mixed(one, self._chain), self._modes, dt, time) for one in each])

    def joint(
        self, bank: gaussian_port.GaussianBank, sensor: SensorModel, positions: Floats, traits: Floats
    ) -> tuple[Floats, Floats]:
        """Joint moments of the states of all modes and of readings."""
        return gaussian_port.linearised_joint(bank, list(self._modes.place), sensor, positions, traits)


def _stacked(banks: list[Bank]) -> gaussian_port.GaussianBank:
    means, covs, chances = (np.stack([bank[part] for bank in banks]) for part in range(3))
    return gaussian_port.GaussianBank(np.ascontiguousarray(means.transpose(0, 2, 1)), covs, chances)


def _belief(bank: Bank, modes: Modes, head: int) -> ModeBelief:
    """The belief of a bank, with the mixture's moments in the columns of the scenario's motion."""
    mean, cov = moments_of_bank(bank)
    return ModeBelief(mean[modes.own], cov[np.ix_(modes.own, modes.own)], head, bank=bank)


def _equal(count: int) -> Floats:
    return np.full(count, 1.0 / count)


def _cycles(size: int, place: int, modes: int, readings: int, steps: int) -> float:
    """Operations of a step: those of one filter times M, of mixing times M²."""
    square = size**2
    mixing = 2.0 + 2.0 * size + 3.0 * square  # a mode's share in another's mixture
    mixture = 2.0 * size + 3.0 * square  # a mode's share in the estimate
    weighing = readings * (2.0 * place**2 + 2.0) + 4.0 * place**3 + 10.0  # log |S|
    update = readings * update_cycles(size, place) + weighing if readings else 0.0
    return steps * modes * (modes * mixing + prediction_cycles(size)) + modes * (update + mixture)
