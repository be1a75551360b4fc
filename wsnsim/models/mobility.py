"""Motion models with a gradually changing velocity: Gauss-Markov, and the coordinated turn.

propagate(states (D, N), dt, keys (N,), time) -> (D, N)

`time` is the instant of the given states, in s; these models do not depend on it.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Keys, stateful
from wsnsim.base.errors import RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.rng import normals
from wsnsim.models.bounds import DURATION, LOG_TWO_PI, PLACE, SPEED, STATE
from wsnsim.models.linear import LinearProcess, mean_reverting, near_constant_velocity
from wsnsim.models.motion import FARTHEST, InPlane

SMALL = 1e-4
"""rad: below this angle a series is used, since the quotient loses digits."""


@part
class GaussMarkov(InPlane):
    """A velocity that reverts to its mean and is driven by noise, on each axis: dv = -(v - v̄)/τ dt + σ √(2/τ) dw.

    v⁺ = v̄ + α (v - v̄) + σ √(1 - α²) w with α = exp(-dt/τ). The position is the exact integral of the velocity; filters
    use their joint Gaussian distribution. Motion is nearly straight if τ is long, and a random walk if τ is short.

    The ground truth may be kept in a `box` with reflecting walls, which filters do not know (our choice).

    Source: Liang, Haas (2003), eq. 2.
    """

    memory: Annotated[float, DURATION, "τ: after which the autocorrelation of the velocity is 1/e"] = 20.0
    mean: Annotated[tuple[float, float], Quantity("m/s", ge=-1e6, le=1e6), "v̄: mean velocity"] = (0.0, 0.0)
    sd: Annotated[float, SPEED, "σ: standard deviation of the velocity, on each axis"] = 3.0
    start: Annotated[tuple[float, float], PLACE, "x and y at time 0; the velocity is random"] = (0.0, 0.0)
    box: Annotated[
        tuple[float, float, float, float] | None, PLACE, "xmin, xmax, ymin, ymax of a box around the ground truth, in m"
    ] = None

    def __post_init__(self) -> None:
        """Raises ValueError if the box is empty or the start is outside it."""
        if self.box is None:
            return
        left, right, bottom, top = self.box
        if not (left < right and bottom < top):
            raise ValueError(f"box: xmin < xmax and ymin < ymax are needed, got {list(self.box)}")
        if not (left <= self.start[0] <= right and bottom <= self.start[1] <= top):
            raise ValueError(f"start: {list(self.start)} is outside the box {list(self.box)}")

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) one trajectory; its first velocity is a sample of the stationary distribution."""
        process = mean_reverting(self.memory, self.sd, dt)
        states = np.empty((steps + 1, 4))
        vx, vy = self.mean + self.sd * rng.standard_normal(2)
        states[0] = (self.start[0], vx, self.start[1], vy)
        for step in range(steps):
            noise = process.root @ rng.standard_normal(4)
            states[step + 1] = self._reflected(self._moved(states[step, :, None], process, dt)[:, 0] + noise)
        return states

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """(4, N) the states one step later, with process noise."""
        process = mean_reverting(self.memory, self.sd, dt)
        noise = np.stack([normals(keys, draw) for draw in range(4)])
        return self._moved(stateful(states, 4), process, dt) + process.root @ noise

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """(4, N) the states one step later, without noise."""
        return self._moved(stateful(states, 4), mean_reverting(self.memory, self.sd, dt), dt)

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """F (N, 4, 4), one read-only matrix repeated, and the process covariance (4, 4)."""
        return mean_reverting(self.memory, self.sd, dt).matrices(states.shape[1])

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """(N,) log p(after | before). Raises RunError if sd = 0, since there is no density."""
        process = mean_reverting(self.memory, self.sd, dt)
        return _log_gaussian(stateful(after, 4) - self._moved(stateful(before, 4), process, dt), process.covariance)

    def assumed(self, noise_scale: float) -> GaussMarkov:
        """The model that a filter assumes: process covariance times `noise_scale`."""
        return dataclasses.replace(self, sd=self.sd * math.sqrt(noise_scale))

    def _moved(self, states: Floats, process: LinearProcess, dt: float) -> Floats:
        drift = np.array([0.0, self.mean[0], 0.0, self.mean[1]])[:, None]
        moved = process.transition @ (states - drift) + drift
        moved[[0, 2]] += dt * drift[[1, 3]]
        return np.asarray(moved)

    def _reflected(self, state: Floats) -> Floats:
        """The state, reflected at the walls of the box that it has passed."""
        if self.box is None:
            return state
        for place, low, high in ((0, *self.box[:2]), (2, *self.box[2:])):
            turns, into = divmod(state[place] - low, high - low)
            if turns % 2:
                state[place], state[place + 1] = high - into, -state[place + 1]
            else:
                state[place] = low + into
        return state


@part
class CoordinatedTurn:
    """Motion along an arc at near-constant speed and turn rate; the turn rate is the fifth column of the state.

    x⁺ = x + sin(ωT)/ω ẋ - (1 - cos ωT)/ω ẏ, ẋ⁺ = cos(ωT) ẋ - sin(ωT) ẏ, and likewise y; ω⁺ = ω. The noise is that of
    near-constant velocity with intensity q, and a random walk of ω with intensity turn_q.

    Source: Bar-Shalom, Li, Kirubarajan (2001), section 11.7.
    """

    columns: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy", "turn")
    units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m", "m/s", "rad/s")
    position: ClassVar[tuple[int, ...]] = (0, 2)

    start: Annotated[
        tuple[float, float, float, float, float], STATE, "px, vx, py, vy, turn at time 0, in m, m/s and rad/s"
    ] = (0.0, 5.0, 0.0, 0.0, 0.05)
    q: Annotated[float, Quantity("m2/s3", ge=0.0, le=1e9), "intensity of the noise in the velocity"] = 0.01
    turn_q: Annotated[float, Quantity("rad2/s3", ge=0.0, le=1e6), "intensity of the noise in the turn rate"] = 1e-5

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 5) one trajectory from the start state. Raises RunError if it diverges."""
        states = np.empty((steps + 1, 5))
        states[0] = self.start
        root = self._root(dt)
        for step in range(steps):
            states[step + 1] = self.advance(states[step, :, None], dt)[:, 0] + root @ rng.standard_normal(5)
            if not np.all(np.abs(states[step + 1]) < FARTHEST):
                raise RunError(f"motion: the trajectory diverges: it is beyond {FARTHEST:g} m at {(step + 1) * dt:g} s")
        return states

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """(5, N) the states one step later, with process noise."""
        return self.advance(states, dt) + self._root(dt) @ np.stack([normals(keys, draw) for draw in range(5)])

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """(5, N) the states one step later, without noise."""
        px, vx, py, vy, turn = stateful(states, 5)
        arc = _arc(turn, dt)
        return np.stack([
            px + arc.along * vx - arc.aside * vy,
            arc.cos * vx - arc.sin * vy,
            py + arc.aside * vx + arc.along * vy,
            arc.sin * vx + arc.cos * vy,
            turn,
        ])  # fmt: skip

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """The Jacobian (N, 5, 5) at each state, and the process covariance (5, 5)."""
        _, vx, _, vy, turn = stateful(states, 5)
        arc, count = _arc(turn, dt), turn.size
        jacobian = np.zeros((count, 5, 5))
        jacobian[:, [0, 2, 4], [0, 2, 4]] = 1.0
        jacobian[:, 0, 1] = jacobian[:, 2, 3] = arc.along
        jacobian[:, 0, 3], jacobian[:, 2, 1] = -arc.aside, arc.aside
        jacobian[:, 1, 1] = jacobian[:, 3, 3] = arc.cos
        jacobian[:, 1, 3], jacobian[:, 3, 1] = -arc.sin, arc.sin
        jacobian[:, 0, 4] = arc.along_slope * vx - arc.aside_slope * vy
        jacobian[:, 1, 4] = -dt * (arc.sin * vx + arc.cos * vy)
        jacobian[:, 2, 4] = arc.aside_slope * vx + arc.along_slope * vy
        jacobian[:, 3, 4] = dt * (arc.cos * vx - arc.sin * vy)
        root = self._root(dt)
        return jacobian, root @ root.T

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """(N,) log p(after | before). Raises RunError if q or turn_q is 0, since there is no density."""
        root = self._root(dt)
        return _log_gaussian(stateful(after, 5) - self.advance(before, dt), root @ root.T)

    def assumed(self, noise_scale: float) -> CoordinatedTurn:
        """The model that a filter assumes: process covariance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale, turn_q=self.turn_q * noise_scale)

    def _root(self, dt: float) -> Floats:
        root = np.zeros((5, 5))
        root[:4, :4] = near_constant_velocity(self.q, dt).root
        root[4, 4] = math.sqrt(self.turn_q * dt)
        return root


class _Arc(NamedTuple):
    """sin ωT, cos ωT, sin(ωT)/ω, (1 - cos ωT)/ω, and the slopes of the last two in ω, each (N,)."""

    sin: Floats
    cos: Floats
    along: Floats
    aside: Floats
    along_slope: Floats
    aside_slope: Floats


def _arc(turn: Floats, dt: float) -> _Arc:
    angle = np.where(np.isfinite(turn), turn, np.nan) * dt
    along = dt * np.sinc(angle / np.pi)
    aside = 0.5 * angle * dt * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = np.abs(angle) < SMALL
    rate = np.where(small, 1.0, turn)
    along_slope = np.where(small, -turn * dt**3 / 3.0, (dt * np.cos(angle) - along) / rate)
    aside_slope = np.where(small, dt**2 / 2.0 - turn**2 * dt**4 / 8.0, (dt * np.sin(angle) - aside) / rate)
    return _Arc(np.sin(angle), np.cos(angle), along, aside, along_slope, aside_slope)


def _log_gaussian(apart: Floats, covariance: Floats) -> Floats:
    """(N,) log N(apart (D, N); 0, covariance); -inf where `apart` is not finite. Raises RunError if singular."""
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise RunError(
            "motion: the process noise is singular, so the transition has no density; every noise must be positive"
        ) from None
    known = np.isfinite(apart).all(axis=0)
    scaled = np.linalg.solve(root, np.where(known, apart, 0.0))
    constant = apart.shape[0] * LOG_TWO_PI / 2.0 + float(np.log(np.diag(root)).sum())
    return np.where(known, -0.5 * (scaled**2).sum(axis=0) - constant, -np.inf)
