"""The scalar benchmark of particle filters: a state that jumps between two wells, measured through its square.

propagate(states (1, N), dt, keys (N,), time) -> (1, N)      log_likelihood(points (1, N), readings (S,), ...) -> (N,)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys, stateful
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import ungm as kernels
from wsnsim.models.bounds import STATE
from wsnsim.models.sensing import OfPosition


@part
class Ungm:
    """The univariate nonstationary growth model.

    x⁺ = x/2 + 25 x/(1 + x²) + 8 cos(ω t) + w with w ~ N(0, q) and t the time of x. The length of a step enters through
    the time alone: with steps of 1 s, 8 cos(1.2 (u - 1)) leads to the u-th state, as printed.

    Source: Wei, Guo (2022), experiment 1.
    """

    columns: ClassVar[tuple[str, ...]] = ("x",)
    units: ClassVar[tuple[str, ...]] = ("",)
    position: ClassVar[tuple[int, ...]] = (0,)

    q: Annotated[float, Quantity("", ge=0, le=1e9), "variance of the process noise"] = 1.0
    rate: Annotated[
        float, Quantity("1/s", ge=0, le=1e6), "ω: angular frequency of the cosine that drives the state"
    ] = 1.2
    start: Annotated[tuple[float], STATE, "x at time 0"] = (0.1,)

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 1) one trajectory from the start state."""
        noise = np.sqrt(self.q) * rng.standard_normal(steps)
        states = np.empty((steps + 1, 1))
        states[0] = self.start
        for step in range(steps):
            states[step + 1] = kernels.advance(states[step, :, None], self._law, step * dt)[:, 0] + noise[step]
        return states

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float) -> Floats:
        """(1, N) the states one step later, with process noise."""
        return kernels.propagate(stateful(states, len(self.columns)), keys, self._law, time)

    def advance(self, states: Floats, dt: float, time: float) -> Floats:
        """(1, N) the states one step later, without noise."""
        return kernels.advance(stateful(states, len(self.columns)), self._law, time)

    def matrices(self, states: Floats, dt: float, time: float) -> tuple[Floats, Floats]:
        """The derivative 1/2 + 25 (1 - x²)/(1 + x²)² (N, 1, 1) at each state, and the noise's variance (1, 1)."""
        part_of_one = 1.0 / (1.0 + np.minimum(np.abs(states[0]), 1e150) ** 2)  # the square overflows beyond 1e150
        slopes = 0.5 + 25.0 * part_of_one * (2.0 * part_of_one - 1.0)
        return slopes[:, None, None], np.array([[self.q]])

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float) -> Floats:
        """(N,) log p(after | before); -inf where either is not finite. Raises RunError if q = 0."""
        if not self.q > 0.0:
            raise RunError("motion: without process noise (q: 0) the transition has no density; use q > 0")
        after, before = stateful(after, len(self.columns)), stateful(before, len(self.columns))
        return kernels.log_transition(after, before, self._law, time)

    def assumed(self, noise_scale: float) -> Ungm:
        """The model that a filter assumes: process variance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale)

    @cached_property
    def _law(self) -> kernels.Law:
        return self.rate, float(np.sqrt(self.q))


@part
class Squared(OfPosition):
    """The square of a scalar state, z = x²/20 + N(0, R): the sign of the state is not observable.

    Every node measures the state, wherever it stands.

    Source: Wei, Guo (2022), experiment 1.
    """

    reach: ClassVar[float] = float("inf")
    constant_gaussian: ClassVar[bool] = True

    variance: Annotated[float, Quantity("", ge=1e-12, le=1e12), "R: variance of a reading"] = 1.0

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings of the states `points` (n, 1), with standard normal noise."""
        readings: Floats = points[:, 0] ** 2 / 20.0 + np.sqrt(self.variance) * noise
        return readings

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(readings | states points (1, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for states that are not finite and for readings that are NaN.
        """
        x = np.ascontiguousarray(points[0])
        if owners is None or not readings.size:
            return kernels.joint_log_likelihood(x, readings, self.variance)
        return kernels.own_log_likelihood(x, readings, owners, self.variance)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings x²/20 (S, N) at states (1, N), their slopes x/10 (S, 1, N) and variances R (S, N)."""
        sensors = len(positions)
        with np.errstate(over="ignore"):
            expected = np.repeat(points**2 / 20.0, sensors, axis=0)
        return expected, np.repeat(points[None] / 10.0, sensors, axis=0), np.full(expected.shape, self.variance)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, 1, 1, N) Fisher information about the state in one reading of each sensor: (x/10)²/R."""
        with np.errstate(over="ignore"):
            each = (points / 10.0) ** 2 / self.variance
        return np.repeat(each[None, None], len(positions), axis=0)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for targets that move in the plane: the sensor squares a position of one column."""
        for motion in setup.motions:
            if len(motion.position) != 1:
                names = " ".join(motion.columns[column] for column in motion.position)
                yield Issue(
                    ("sensor", "kind"),
                    f"squared measures a position of one column, but the motion's has {len(motion.position)} "
                    f"({names}); use it with ungm or constant_acceleration",
                )
