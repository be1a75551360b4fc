"""The motion model of PSO-MHPF's paper, and what motion models in the plane share.

propagate(states (D, N), dt, keys (N,), time) -> (D, N)

Truth, predictions and transition densities share one process covariance. `time` is the instant of the given states, in
s; this model does not depend on it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Keys, planar, stateful
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.kernels import acoustic as kernels
from wsnsim.models.bounds import STATE


def start_issues(motion: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue if the target starts outside the field of a network."""
    if not isinstance(setup, NetworkSetup):
        return
    field = setup.deploy.field
    point = planar(np.array([motion.start[column] for column in motion.position]))
    if not field.contains(point):
        (x, y), (x0, y0) = point, field.centre
        size = f"{field.width:g} m by {field.height:g} m around ({x0:g}, {y0:g})"
        yield Issue(("motion", "start"), f"({x:g}, {y:g}) m is outside the field of {size}")


class InPlane:
    """The columns of a state in the plane: position and velocity."""

    columns: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")
    units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m", "m/s")
    position: ClassVar[tuple[int, ...]] = (0, 2)


def kept_near(states: Floats, position: tuple[int, ...], dt: float) -> Floats:
    """The trajectory itself. Raises RunError with the time at which it diverges."""
    near = np.all(np.abs(states[:, position]) < FARTHEST, axis=1)
    if not near.all():
        raise RunError(f"motion: the trajectory diverges: it is beyond {FARTHEST:g} m at {near.argmin() * dt:g} s")
    return states


START = (-45.0, -20.0, -50.0, -35.0)
FARTHEST = 1e12
"""m: a trajectory beyond this coordinate has diverged (our choice)."""


@part
class BoundedVelocity(InPlane):
    """Near-constant velocity within a bound; beyond it the target is pulled back and slowed, on each axis separately.

    x⁺ = A(x) x + w with A = blkdiag(F_x, F_y): F1 = [1 T; 0 1] while |p| <= a, else F2 = [1 T; -T c1, 1 - T c2].
    The paper gives two covariances of w that cannot both hold: G Gᵀ with G = [T² σ0/2; T σ0], and
    Q = q [T³/2 T²/2; T²/2 T], on each axis. `noise: both`, our choice, is their sum; the others follow one equation.

    Source: Jiang, Song, Lin (2013), eqs. 1-4 and table 2.
    """

    bound: Annotated[
        float, Quantity("m", gt=0), "a: distance from the origin beyond which the target is turned back"
    ] = 180.0
    c1: Annotated[float, Quantity("1/s2", ge=0, le=1e9), "pull towards the origin beyond the bound"] = 0.75
    c2: Annotated[float, Quantity("1/s", ge=0, le=1e9), "drag beyond the bound"] = 1.0
    q: Annotated[float, Quantity("m2/s3", ge=0, le=1e9), "intensity of the process noise Q"] = 0.002
    sigma0: Annotated[float, Quantity("m/s2", ge=0, le=1e6), "σ0: deviation of the random acceleration in G"] = 1.0
    noise: Annotated[Literal["both", "q_only", "g_only"], "which of the paper's two covariances are used"] = "both"
    start: Annotated[tuple[float, float, float, float], STATE, "px, vx, py, vy at time 0, in m and m/s"] = START

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """One trajectory (steps + 1, 4) from the start state.

        Raises:
            RunError: the trajectory diverges because the step is too long for the pull and the drag beyond the bound.
        """
        l11, l21, l22 = self._process(dt).root
        draws = rng.standard_normal((steps, 2, 2))
        noise = np.empty((steps, 4))
        noise[:, 0::2] = l11 * draws[..., 0]
        noise[:, 1::2] = l21 * draws[..., 0] + l22 * draws[..., 1]
        states = np.empty((steps + 1, 4))
        states[0] = self.start
        law = self._law(dt)
        for step in range(steps):
            states[step + 1] = kernels.advance(states[step, :, None], law)[:, 0] + noise[step]
        return kept_near(states, self.position, dt)

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """The states (4, N) one step later, with process noise (eq. 1)."""
        return kernels.propagate(stateful(states, len(self.columns)), keys, self._law(dt), self._process(dt).root)

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """The states (4, N) one step later, without noise."""
        return kernels.advance(stateful(states, len(self.columns)), self._law(dt))

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """The matrix A (N, 4, 4) at each state, and the covariance (4, 4) of the process noise (eqs. 2-4)."""
        transitions = kernels.transitions(stateful(states, len(self.columns)), self._law(dt))
        return transitions, self._process(dt).covariance.copy()

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """The log densities p(after | before), (N,); -inf where either is not finite.

        Raises:
            RunError: the process covariance is singular (`noise: g_only`, or q = 0), so there is no density.
        """
        root = self._process(dt).root
        if not root[0] * root[2] > 0.0:
            raise RunError(
                "motion: the process noise is singular (noise: g_only, or q: 0), so the transition has no density; "
                "use noise: both or q_only with q > 0"
            )
        after, before = stateful(after, len(self.columns)), stateful(before, len(self.columns))
        return kernels.log_transition(after, before, self._law(dt), root)

    def assumed(self, noise_scale: float) -> BoundedVelocity:
        """The model that a filter assumes: process covariance times `noise_scale`, which scales both terms."""
        return dataclasses.replace(self, q=self.q * noise_scale, sigma0=self.sigma0 * math.sqrt(noise_scale))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the target starts outside the field of a network."""
        yield from start_issues(self, setup)

    def _law(self, dt: float) -> kernels.Drift:
        return dt, self.bound, self.c1, self.c2

    def _process(self, dt: float) -> StepNoise:
        q, sigma0 = self.noise != "g_only", self.noise != "q_only"
        return bounded_process(self.q if q else 0.0, self.sigma0**2 if sigma0 else 0.0, dt)


class StepNoise(NamedTuple):
    """The noise of one step: covariance (4, 4), and the lower Cholesky factor (l11, l21, l22) of one axis."""

    covariance: Floats
    root: kernels.Root


@functools.lru_cache(maxsize=64)
def bounded_process(q: float, s: float, dt: float) -> StepNoise:
    """The noise of a step (eq. 4): covariance [a b; b c] on each axis, with a determinant free of cancellation."""
    a = s * dt**4 / 4 + q * dt**3 / 2
    b = s * dt**3 / 2 + q * dt**2 / 2
    c = s * dt**2 + q * dt
    determinant = q * q * dt**4 / 4 + s * q * dt**5 / 4
    root = (math.sqrt(a), b / math.sqrt(a), math.sqrt(determinant / a)) if a > 0.0 else (0.0, 0.0, 0.0)
    return StepNoise(np.kron(np.eye(2), np.array([[a, b], [b, c]])), root)
