"""A motion model: a target that is drawn back to its home, as an animal to its den.

    python plugin_name.py           checks the rules of a motion model (wsnsim.testing.check_motion)
    wsnsim run plugin_name.yaml     runs the scenario beside this file

Shapes: D columns of the state, N particles; states are (D, N), column j is particle j. SI units throughout.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsnsim import Quantity, part
from wsnsim.plugins import normals

Floats = NDArray[np.float64]


@part
class PluginMotion:
    """A velocity that friction slows, noise drives, and a spring pulls back to the home, on each axis.

    dx = v dt, dv = -(pull (x - home) + friction v) dt + √q dw, to the second order in the step dt: take steps well
    below 1/friction and 1/√pull.
    """

    columns: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")
    units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m", "m/s")
    position: ClassVar[tuple[int, ...]] = (0, 2)

    home: Annotated[tuple[float, float], Quantity("m", ge=-1e7, le=1e7), "x and y of the home"] = (0.0, 0.0)
    pull: Annotated[float, Quantity("1/s2", ge=0, le=1e3), "acceleration towards the home per metre"] = 0.01
    friction: Annotated[float, Quantity("1/s", ge=0, le=1e3), "deceleration per speed"] = 0.1
    q: Annotated[float, Quantity("m2/s3", gt=0, le=1e9), "intensity of the noise in the velocity"] = 4.0
    start: Annotated[
        tuple[float, float, float, float], Quantity("", ge=-1e7, le=1e7, label="SI"), "px, vx, py, vy at time 0"
    ] = (40.0, 0.0, 0.0, 4.0)

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return one ground-truth trajectory (steps + 1, D) from the start."""
        law = _law(self.pull, self.friction, self.q, dt)
        states = np.empty((steps + 1, 4))
        states[0] = self.start
        for step in range(steps):
            noise = law.root @ rng.standard_normal(4)
            states[step + 1] = self._moved(states[step, :, None], law)[:, 0] + noise
        return states

    def propagate(self, states: Floats, dt: float, keys: NDArray[np.uint64], time: float = 0.0) -> Floats:
        """Return the states (D, N) one step later, with process noise.

        Args:
            states: (D, N) the states.
            dt: Length of the step in s.
            keys: (N,) a key per particle: noise is a function of the key alone, so that runs can be repeated.
            time: Time of the states in s.
        """
        law = _law(self.pull, self.friction, self.q, dt)
        noise = np.stack([normals(keys, draw) for draw in range(4)])
        return self._moved(states, law) + law.root @ noise

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """Return the states (D, N) one step later, without noise."""
        return self._moved(states, _law(self.pull, self.friction, self.q, dt))

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """Return the transition matrix at each state (N, D, D), and the process covariance (D, D)."""
        law = _law(self.pull, self.friction, self.q, dt)
        return np.broadcast_to(law.transition, (states.shape[1], 4, 4)), law.covariance

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """Return log p(after | before) for each column, as (N,)."""
        law = _law(self.pull, self.friction, self.q, dt)
        white = np.linalg.solve(law.root, after - self._moved(before, law))
        constant = np.log(np.diag(law.root)).sum() + 2.0 * np.log(2.0 * np.pi)
        logs: Floats = -0.5 * (white**2).sum(axis=0) - constant
        return np.where(np.isfinite(logs), logs, -np.inf)

    def assumed(self, noise_scale: float) -> PluginMotion:
        """Return the model that a filter assumes: with the process covariance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale)

    def _moved(self, states: Floats, law: Law) -> Floats:
        centre = np.array([self.home[0], 0.0, self.home[1], 0.0])[:, None]
        moved: Floats = law.transition @ (states - centre) + centre
        return moved


class Law(NamedTuple):
    """One step: transition matrix (D, D), covariance of the noise (D, D), and the Cholesky factor of that."""

    transition: Floats
    covariance: Floats
    root: Floats


@functools.cache
def _law(pull: float, friction: float, q: float, dt: float) -> Law:
    """Return the law of a step of dt s: the same on both axes."""
    transition = np.array([[1.0 - 0.5 * pull * dt**2, dt - 0.5 * friction * dt**2], [-pull * dt, 1.0 - friction * dt]])
    covariance = np.array([[q * dt**3 / 3.0, q * dt**2 / 2.0], [q * dt**2 / 2.0, q * dt]])
    axes = np.eye(2)
    whole = np.kron(axes, covariance)
    return Law(np.kron(axes, transition), whole, np.linalg.cholesky(whole))


if __name__ == "__main__":
    from wsnsim.testing import check_motion

    check_motion(PluginMotion())
    print("plugin_name: keeps the rules of a motion model")
