"""Many standalone runs of a filter in one head, step by step with all runs in each call of a kernel.

Particles of R runs are stacked as (D, R N), those of run r in the columns r N to (r + 1) N. The kernels and the counter
keys are those of the composed steps, so that a run has the same bits alone, in a block, and composed of requests.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys, innovation_of, near
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock, StandaloneRun
from wsnsim.base.network_ports import Field
from wsnsim.base.ports import MotionModel, Scene, SensorModel
from wsnsim.base.rng import uniforms
from wsnsim.kernels.elementary import particle_keys
from wsnsim.kernels.gaussian import sample
from wsnsim.kernels.particles import moments, systematic, weigh
from wsnsim.kernels.relay import kalman
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Linear, linearised
from wsnsim.trackers.shared.stacks import DRAW, PREDICT, START, drawn_from, slice_of

HEAD = 0
"""The sensor that is the head of a standalone run."""
NO_FIELD = Field(0.0, 0.0)
PARTICLES_AT_ONCE = 8192
"""Particles of a stack, of one run at least: few enough for a processor's cache."""


class Heard(NamedTuple):
    """The finite readings of a run, by step and sensor: those of step k are the rows cuts[k] to cuts[k + 1]."""

    cuts: list[int]
    nodes: Ints
    readings: Floats
    positions: Floats
    traits: Floats

    @classmethod
    def of(cls, run: StandaloneRun) -> Heard:
        """Those of a run."""
        known = np.isfinite(run.readings)
        nodes = np.nonzero(known)[1]
        cuts = [0, *np.cumsum(known.sum(axis=1)).tolist()]
        return cls(cuts, nodes, run.readings[known], run.positions[nodes], run.traits[nodes])

    def at(self, step: int) -> tuple[Floats, Floats, Floats]:
        """Readings (n,), positions (n, 2) and traits (n, T) of a step."""
        rows = slice(self.cuts[step], self.cuts[step + 1])
        return self.readings[rows], self.positions[rows], self.traits[rows]

    def has_the_sensors_of(self, other: Heard) -> bool:
        """Whether the same sensors measure at all steps of both runs."""
        return self.cuts == other.cuts and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ("nodes", "positions", "traits")
        )

    def ids(self, step: int) -> tuple[int, ...]:
        """The sensors of a step, as `Scene.ids`."""
        return tuple(self.nodes[self.cuts[step] : self.cuts[step + 1]].tolist())


class Outcome:
    """The estimates of a block while they are made, and how many readings each run heard at each step."""

    def __init__(self, block: StandaloneBlock) -> None:
        runs, steps, size = len(block.runs), block.steps, len(block.motion.columns)
        self.heard = [Heard.of(run) for run in block.runs]
        self.counts = np.array([np.diff(heard.cuts)[1:] for heard in self.heard])
        self.means, self.covs = np.empty((runs, steps, size)), np.empty((runs, steps, size, size))
        self.effective = np.full((runs, steps), np.nan)
        first = self.heard[0]
        self.alike = all(map(first.has_the_sensors_of, self.heard))
        self.nis, self.nis_dof = np.full((runs, steps), np.nan), np.zeros((runs, steps), dtype=np.int64)

    def linearised(self, points: Floats, sensor: SensorModel, step: int) -> Iterator[tuple[int, Floats, Linear]]:
        """(run, readings, the sensor model at its point) of the runs that hear a reading; points are (R, P).

        Angles are those nearest to what is expected.

        Runs with the same sensors at all steps are linearised in one call, as `readings.linearised` does one.
        """
        if self.alike:
            _, positions, traits = self.heard[0].at(step)
            linear = sensor.linearise(np.ascontiguousarray(points.T), positions, traits)
            each = [np.ascontiguousarray(np.moveaxis(array, -1, 0))[..., None] for array in linear]
            for run, heard in enumerate(self.heard if len(positions) else ()):
                expected = each[0][run]
                readings = near(sensor, heard.at(step)[0], expected[:, 0])
                yield run, readings, (expected, each[1][run], each[2][run])
            return
        for run, heard in enumerate(self.heard):
            readings, positions, traits = heard.at(step)
            if readings.size:
                linear = linearised(points[run, :, None], sensor, positions, traits)
                yield run, near(sensor, readings, linear[0][:, 0]), linear

    def sums(self, cycles: Callable[[int], float]) -> Floats:
        """(R,) the operations of all steps, of a function of the number of readings in a step."""
        counts, places = np.unique(self.counts, return_inverse=True)
        each = np.array([cycles(count) for count in counts.tolist()])
        total: Floats = each[places.reshape(self.counts.shape)].sum(axis=1)
        return total

    def closed(self, cycles: Floats) -> BlockEstimates:
        """The estimates, with the operations of each run."""
        return BlockEstimates(self.means, self.covs, self.effective, self.nis, self.nis_dof, cycles)


def cloud_runs(block: StandaloneBlock, particles: int, threshold: float) -> Outcome:
    """Runs of the bootstrap filter; `threshold` as in `heads.bootstrap`."""
    outcome = Outcome(block)
    for first, last in _stacks(len(block.runs), particles):
        stack = _StackedRuns(block, outcome, first, last, particles)
        stack.cloud = np.concatenate([
            drawn_from(run.prior.mean, run.prior.cov, int(run.keys[0]), particles) for run in block.runs[first:last]
        ], axis=1)  # fmt: skip
        for step in range(1, block.steps + 1):
            stack.cloud = stack.moved(stack.cloud, step)
            stack.score(step)
            heard = stack.summarise(step)
            stack.resample(heard & ((threshold >= 1.0) | (stack.effective < threshold * particles)), step)
    return outcome


def gaussian_runs(block: StandaloneBlock, particles: int) -> Outcome:
    """Runs of the Gaussian particle filter."""
    outcome = Outcome(block)
    for first, last in _stacks(len(block.runs), particles):
        stack = _StackedRuns(block, outcome, first, last, particles)
        for step in range(1, block.steps + 1):
            keys = particle_keys(stack.keys[step], stack.offsets, DRAW)
            drawn = np.empty((stack.means.shape[1], keys.size))
            for mean, cov, columns in zip(stack.means, stack.covs, stack.columns, strict=True):
                drawn[:, columns], _ = sample(mean[:, None].copy(), cov[None], keys[columns])
            stack.cloud = stack.moved(drawn, step)
            stack.log_weights[:] = 0.0
            stack.effective[:] = np.nan
            stack.score(step)
            stack.summarise(step)
    return outcome


class _StackedRuns:
    """The particles of some runs of a block with their log-weights, and each run's latest moments."""

    def __init__(self, block: StandaloneBlock, outcome: Outcome, first: int, last: int, particles: int) -> None:
        runs = block.runs[first:last]
        self._block, self._outcome, self._rows = block, outcome, slice(first, last)
        self._heard = outcome.heard[first:last]
        self._place = slice_of(block.motion.position)
        self._all_heard = np.all(outcome.counts[first:last] > 0, axis=0)
        self.keys: Keys = np.ascontiguousarray(np.array([run.keys for run in runs]).T)
        self._teeth: Floats = uniforms(self.keys, START)
        self.offsets = np.arange(len(runs) + 1) * particles
        self.columns = [slice(r * particles, (r + 1) * particles) for r in range(len(runs))]
        self.sizes = np.full(len(runs), particles)
        self.cloud = np.empty((len(block.motion.columns), 0))
        self.log_weights = np.zeros(len(runs) * particles)
        self.means = np.array([run.prior.mean for run in runs])
        self.covs = np.array([run.prior.cov for run in runs])
        self.effective = np.full(len(runs), np.nan)

    def moved(self, cloud: Floats, step: int) -> Floats:
        """The particles (D, R N) moved into a step, with process noise."""
        keys, dt = particle_keys(self.keys[step], self.offsets, PREDICT), self._block.dt
        return self._block.motion.propagate(cloud, dt, keys, (step - 1) * dt)

    def score(self, step: int) -> None:
        """Add the log-likelihoods of each run's readings to its log-weights."""
        points, sensor, log_weights = self.cloud[self._place], self._block.sensor, self.log_weights
        for heard, columns in zip(self._heard, self.columns, strict=True):
            readings, positions, traits = heard.at(step)
            if readings.size:
                log_weights[columns] += sensor.log_likelihood(points[:, columns], readings, positions, traits)

    def summarise(self, step: int) -> Bools:
        """Weigh and write the moments of the step; (R,) which runs heard a reading. The others only predict."""
        outcome, row = self._outcome, step - 1
        heard: Bools = outcome.counts[self._rows, row] > 0
        means, covs, effective = self.means, self.covs, self.effective
        kept = None if self._all_heard[row] else self.log_weights.copy()
        self.effective = weigh(self.log_weights, self.offsets)
        self.means, self.covs = moments(self.cloud, self.log_weights, self.offsets)
        if kept is not None:
            silent = ~heard
            again = np.repeat(silent, self.sizes)
            self.log_weights[again], self.effective[silent] = kept[again], effective[silent]
            dt = self._block.dt
            moved = predicted(means[silent], covs[silent], self._block.motion, dt, row * dt)
            self.means[silent], self.covs[silent] = moved
        outcome.means[self._rows, row], outcome.covs[self._rows, row] = self.means, self.covs
        outcome.effective[self._rows, row] = self.effective
        return heard

    def resample(self, which: Bools, step: int) -> None:
        """Resample the runs `which` (R,) by systematic resampling; their particles are equally weighted then."""
        if not which.any():
            return
        starts = self._teeth[step]
        if which.all():
            columns = systematic(self.log_weights, self.offsets, self.sizes, starts)
            self.log_weights[:] = 0.0
        else:
            sizes = np.where(which, self.sizes, 0)
            again, columns = np.repeat(which, self.sizes), np.arange(self.log_weights.size)
            columns[again] = systematic(self.log_weights, self.offsets, sizes, starts)
            self.log_weights[again] = 0.0
        self.cloud = np.take(self.cloud, columns, axis=1)


def scenes_of(block: StandaloneBlock, heard: Heard) -> Iterator[Scene]:
    """The scenes of the steps 0 to K of a run, for trackers whose steps read no more of them than this."""
    for step in range(block.steps + 1):
        _, positions, traits = heard.at(step)
        yield Scene(
            time=step * block.dt,
            step=step,
            steps=min(step, 1),
            dt=block.dt,
            target=0,
            head=HEAD,
            ids=heard.ids(step),
            positions=positions,
            traits=traits,
            roster=(),
            joined=(),
            left=(),
            field=NO_FIELD,
            motion=block.motion,
            sensor=block.sensor,
            key=0,
        )


def kalman_runs(block: StandaloneBlock) -> Outcome:
    """Runs of the extended Kalman filter on all readings."""
    outcome = Outcome(block)
    place, motion, dt = np.array(block.motion.position), block.motion, block.dt
    means, covs = priors(block)
    for step in range(1, block.steps + 1):
        means, covs = predicted(means, covs, motion, dt, (step - 1) * dt)
        for run, readings, linear in outcome.linearised(means[:, place], block.sensor, step):
            square, used = kalman(means[run], covs[run], *linear, readings, place)
            innovation = innovation_of(block.sensor, square, used)
            outcome.nis[run, step - 1], outcome.nis_dof[run, step - 1] = innovation.nis, innovation.dof
        outcome.means[:, step - 1], outcome.covs[:, step - 1] = means, covs
    return outcome


def priors(block: StandaloneBlock) -> tuple[Floats, Floats]:
    """Means (R, D) and covariances (R, D, D) of the priors."""
    return np.array([run.prior.mean for run in block.runs]), np.array([run.prior.cov for run in block.runs])


def predicted(means: Floats, covs: Floats, motion: MotionModel, dt: float, time: float) -> tuple[Floats, Floats]:
    """Means (R, D) and covariances (R, D, D) one step later: `moments.predicted` of many runs."""
    points = np.ascontiguousarray(means.T)
    transitions, noise = motion.matrices(points, dt, time)
    moved = np.ascontiguousarray(motion.advance(points, dt, time).T)
    return moved, symmetric(transitions @ covs @ transitions.transpose(0, 2, 1) + noise)


def _stacks(runs: int, particles: int) -> Iterator[tuple[int, int]]:
    """(first, last + 1) of the runs of each stack."""
    most = max(1, PARTICLES_AT_ONCE // particles)
    for first in range(0, runs, most):
        yield first, min(first + most, runs)
