"""Linear Gaussian motion models: constant acceleration on a line, constant velocity in the plane; x⁺ = F x + Γ w.

propagate(states (D, N), dt, keys (N,), time) -> (D, N)

`time` is the instant of the given states, in s; these models do not depend on it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Keys, stateful
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import linear as kernels
from wsnsim.models.bounds import PLACE, STATE
from wsnsim.models.motion import InPlane, kept_near, start_issues

BATCH: Final = 256
"""Trajectories that rejection sampling computes together; fewer if they are longer than 1024 steps."""
INPUTS: Final = {"accelerations": 2, "diagonal": 4, "direct": 4}
"""Number of noise inputs: the columns of Γ."""


NoiseInput = Literal["accelerations", "diagonal", "direct"]


class LinearProcess(NamedTuple):
    """One step of a linear motion: F (D, D), a root L (D, K) of the process covariance Q, and Q = L Lᵀ (D, D)."""

    transition: Floats
    root: Floats
    covariance: Floats

    def matrices(self, count: int) -> tuple[Floats, Floats]:
        """F (count, D, D), one read-only matrix repeated, and a copy of Q (D, D)."""
        if count != 1:
            return np.broadcast_to(self.transition, (count, *self.transition.shape)), self.covariance.copy()
        once = self.transition[None]  # a tenth of the time
        once.flags.writeable = False
        return once, self.covariance.copy()


@functools.lru_cache(maxsize=64)
def accelerating(q: float, dt: float) -> LinearProcess:
    """F and G of Liu, Wang (2012), eqs. 16-17."""
    transition = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    root = np.sqrt(q) * np.array([[dt**2 / 2], [dt], [1.0]])
    return LinearProcess(transition, root, root @ root.T)


@functools.lru_cache(maxsize=64)
def coasting(noise_input: NoiseInput, variances: tuple[float, ...], dt: float) -> LinearProcess:
    """F and Γ of Wei, Guo (2022), experiment 3, or of Ruan et al. (2020), eq. 3."""
    transition = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    lever = np.array([[dt**2 / 2], [dt]])
    gammas = {
        "accelerations": np.kron(np.eye(2), lever),
        "diagonal": np.diag(np.tile(lever[:, 0], 2)),
        "direct": np.eye(4),
    }
    root = gammas[noise_input] * np.sqrt(variances)
    return LinearProcess(transition, root, root @ root.T)


@functools.lru_cache(maxsize=64)
def near_constant_velocity(q: float, dt: float) -> LinearProcess:
    """White noise of intensity q in the acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-7)."""
    transition = np.kron(np.eye(2), np.array([[1.0, dt], [0.0, 1.0]]))
    root: Floats = math.sqrt(q) * np.array(
        [[math.sqrt(dt**3 / 3.0), 0.0], [math.sqrt(3.0 * dt) / 2.0, math.sqrt(dt) / 2.0]]
    )
    both_axes: Floats = np.kron(np.eye(2), root).astype(np.float64)
    return LinearProcess(transition, both_axes, both_axes @ both_axes.T)


@functools.lru_cache(maxsize=64)
def mean_reverting(memory: float, sd: float, dt: float) -> LinearProcess:
    """An Ornstein-Uhlenbeck velocity and its integral over dt (Uhlenbeck, Ornstein 1930), independent on each axis.

    The terms of the position's variance cancel to third order in dt/τ: below 1e-3 its series is used.
    """
    r = dt / memory
    alpha, gone = math.exp(-r), -math.expm1(-r)
    position = r**3 * (2.0 / 3.0 - r / 2.0) if r < 1e-3 else 2.0 * r - 3.0 + 4.0 * alpha - alpha * alpha
    a, b, c = sd**2 * memory**2 * position, sd**2 * memory * gone**2, -(sd**2) * math.expm1(-2.0 * r)
    first = math.sqrt(a)
    lower = b / first if first > 0.0 else 0.0
    axis = np.array([[first, 0.0], [lower, math.sqrt(max(c - lower * lower, 0.0))]])
    root = np.kron(np.eye(2), axis)
    transition = np.kron(np.eye(2), np.array([[1.0, memory * gone], [0.0, alpha]]))
    return LinearProcess(transition, root, root @ root.T)


class LinearMotion:
    """The base of motions x⁺ = F x + L w with standard normal w. A subclass gives `_process` and `columns`."""

    no_density: ClassVar[str]
    """Why a transition has no density, and what to do: where L has no inverse."""
    columns: ClassVar[tuple[str, ...]]

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """(D, N) the states one step later, with process noise."""
        process = self._process(dt)
        return kernels.propagate(stateful(states, len(self.columns)), keys, process.transition, process.root)

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """(D, N) the states one step later, without noise."""
        return kernels.advance(stateful(states, len(self.columns)), self._process(dt).transition)

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """F (N, D, D), one read-only matrix repeated, and the process covariance (D, D)."""
        return self._process(dt).matrices(states.shape[1])

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """(N,) log p(after | before); -inf where either is not finite. Raises RunError if there is no density."""
        size, process = len(self.columns), self._process(dt)
        if process.root.shape[1] < size or not np.all(np.diag(process.root) > 0.0):
            raise RunError(f"motion: {self.no_density}")
        return kernels.log_transition(stateful(after, size), stateful(before, size), process.transition, process.root)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the target starts outside the field of a network."""
        yield from start_issues(self, setup)

    def _process(self, dt: float) -> LinearProcess:
        raise NotImplementedError


@part
class ConstantAcceleration(LinearMotion):
    """Near-constant acceleration of a target on the x-axis.

    x⁺ = F x + G w with F = [1 T T²/2; 0 1 T; 0 0 1], G = [T²/2; T; 1] and w ~ N(0, q): the process covariance G q Gᵀ
    has rank one.

    Source: Liu, Wang (2012), eqs. 15-17 and 26; the paper prints Q for G Q Gᵀ.
    """

    columns: ClassVar[tuple[str, ...]] = ("px", "vx", "ax")
    units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m/s2")
    position: ClassVar[tuple[int, ...]] = (0,)
    linear_gaussian: ClassVar[bool] = True
    no_density: ClassVar[str] = (
        "the process noise is singular (constant_acceleration has one noise input for three columns), so the "
        "transition has no density; use a tracker, or a variant of it, that does not need the density"
    )

    q: Annotated[float, Quantity("m2/s4", ge=0, le=1e9), "variance of the noise in the acceleration"] = 1e-6
    start: Annotated[tuple[float, float, float], STATE, "px, vx, ax at time 0, in SI units"] = (1.0, 0.1, 0.01)
    truth_noise: Annotated[bool, "whether the ground truth has process noise; filters always assume it"] = True

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 3) one trajectory from the start state. Raises RunError if it diverges."""
        walk = _walk(np.array(self.start)[:, None], _root(self, dt), self._process(dt).transition, steps, rng)
        return kept_near(np.array([states[:, 0] for states in walk]), self.position, dt)

    def assumed(self, noise_scale: float) -> ConstantAcceleration:
        """The model that a filter assumes: process covariance times `noise_scale`."""
        return dataclasses.replace(self, q=self.q * noise_scale)

    def _process(self, dt: float) -> LinearProcess:
        return accelerating(self.q, dt)


@part
class ConstantVelocity(InPlane, LinearMotion):
    """Near-constant velocity of a target in the plane.

    x⁺ = F x + Γ w with F = blkdiag([1 T; 0 1], [1 T; 0 1]). `noise_input` selects Γ: `accelerations` is
    [T²/2 0; T 0; 0 T²/2; 0 T] with w in m/s² (Wei), `diagonal` is diag(T²/2, T, T²/2, T), `direct` is the identity.
    The last two are interpretations of Ruan, whose 4 x 4 covariance of w does not fit the printed Γ of two columns.

    The ground truth follows a `course`, which filters do not know. `free`: the model alone. `turn`: vy is reversed
    after half of the steps, rounded up. `in_room`: each axis is sampled until it stays in the `room` enlarged by
    `slack`; the axes are independent, so that the truth is a sample of the model under that condition.

    Source: Wei, Guo (2022), experiment 3, whose values are the defaults; Ruan, Wang, Yang, Zhang (2020), eq. 3. The
    courses are our interpretation of Ruan's figures; the limit on samples and `start_sd` are our choice.
    """

    linear_gaussian: ClassVar[bool] = True
    no_density: ClassVar[str] = (
        "the process noise is singular (noise_input: accelerations, or a variance of 0), so the transition has no "
        "density; use noise_input: diagonal or direct with variances > 0"
    )

    noise_input: Annotated[NoiseInput, "Γ: what the process noise acts on"] = "accelerations"
    variances: Annotated[
        tuple[float, ...],
        Quantity("", ge=0, le=1e9, label="SI"),
        "variances of the noise inputs, in SI units: one for all, or one each",
    ] = (0.72,)
    start: Annotated[tuple[float, float, float, float], STATE, "px, vx, py, vy at time 0, in m and m/s"] = (
        70.0, 5.0, 21.0, 8.0,
    )  # fmt: skip
    start_sd: Annotated[
        tuple[float, float, float, float] | None,
        Quantity("", ge=0, le=1e7, label="SI"),
        "standard deviations of the ground truth's start about `start`, in m and m/s; default: none",
    ] = None
    truth_noise: Annotated[bool, "whether the ground truth has process noise; filters always assume it"] = True
    course: Annotated[Literal["free", "in_room", "turn"], "constraint on the ground truth"] = "free"
    room: Annotated[
        tuple[float, float, float, float] | None, PLACE, "xmin, xmax, ymin, ymax of the room of `in_room`, in m"
    ] = None
    slack: Annotated[float, Quantity("m", ge=0, le=1e7), "how far outside the room the target may be"] = 0.5
    draws: Annotated[int, Quantity("", ge=1, le=10**7), "most trajectories sampled for `in_room`"] = 100_000

    def __post_init__(self) -> None:
        """Raises ValueError for a wrong number of variances, or if `in_room` has no room or cannot succeed."""
        inputs = INPUTS[self.noise_input]
        if len(self.variances) not in (1, inputs):
            raise ValueError(
                f"variances: {len(self.variances)} values; noise_input: {self.noise_input} takes 1 for all its inputs, "
                f"or {inputs}"
            )
        if self.course == "in_room":
            self._check_room()

    def _check_room(self) -> None:
        if self.room is None:
            raise ValueError("course: in_room needs room: [xmin, xmax, ymin, ymax]")
        if not (self.room[0] < self.room[1] and self.room[2] < self.room[3]):
            raise ValueError(f"room: xmin < xmax and ymin < ymax are needed, got {list(self.room)}")
        if not self.truth_noise and self.start_sd is None:
            raise ValueError(
                "course: in_room samples the truth again, but with truth_noise: false all samples are equal"
            )
        if self.start_sd is None and not self._inside(np.array(self.start)[:, None]).all():
            raise ValueError(
                f"start: ({self.start[0]:g}, {self.start[2]:g}) m is outside {self._room_in_words()}, in which "
                "course: in_room must keep it"
            )

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) one trajectory on the course.

        Raises:
            RunError: the trajectory diverges, or none of `draws` samples stayed in the room on one of the axes.
        """
        if self.course == "in_room":
            return self._truth_in_room(steps, dt, rng)
        turn = (steps + 1) // 2 if self.course == "turn" else None
        return kept_near(np.array([states[:, 0] for states in self._walk(1, steps, dt, rng, turn)]), self.position, dt)

    def assumed(self, noise_scale: float) -> ConstantVelocity:
        """The model that a filter assumes: process covariance times `noise_scale`."""
        return dataclasses.replace(self, variances=tuple(variance * noise_scale for variance in self.variances))

    def _process(self, dt: float) -> LinearProcess:
        return coasting(self.noise_input, self.variances, dt)

    def _walk(
        self, count: int, steps: int, dt: float, rng: np.random.Generator, turn: int | None = None
    ) -> Iterator[Floats]:
        """(4, count) the states of `count` trajectories at each step, from independent starts."""
        starts = np.repeat(np.array(self.start)[:, None], count, axis=1)
        if self.start_sd is not None:
            starts = starts + np.array(self.start_sd)[:, None] * rng.standard_normal((4, count))
        return _walk(starts, _root(self, dt), self._process(dt).transition, steps, rng, turn)

    def _truth_in_room(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """The first x and the first y that stay in the room: noise, start and room are independent on the two axes.

        Exact, and far cheaper than to wait for a trajectory that stays on both: P(x and y stay) = P(x stays) P(y
        stays). A batch ends early when all of its trajectories have left on the axes that are missing.
        """
        most, found = min(BATCH, max(1, 1024 * BATCH // (steps + 1))), {}
        for done in range(0, self.draws, most):
            count = min(most, self.draws - done)
            missing = [axis for axis in (0, 1) if axis not in found]
            inside, track = np.ones((2, count), dtype=np.bool_), []
            for states in self._walk(count, steps, dt, rng):
                inside &= self._inside(states)
                track.append(states)
                if not inside[missing].any():
                    break
            for axis in missing if len(track) == steps + 1 else ():
                if inside[axis].any():
                    found[axis] = np.array(track)[:, 2 * axis : 2 * axis + 2, inside[axis].argmax()]
            if len(found) == 2:
                return np.concatenate([found[0], found[1]], axis=1)
        names = " and ".join(name for axis, name in enumerate("xy") if axis not in found)
        raise RunError(
            f"motion: none of {self.draws} sampled trajectories of {steps} steps stayed along {names} in "
            f"{self._room_in_words()}; enlarge room or slack, shorten the duration, lower variances, or raise draws"
        )

    def _inside(self, states: Floats) -> Bools:
        """(2, B) whether x, and y, of each position is in the room enlarged by the slack, edges included."""
        assert self.room is not None, "__post_init__ requires a room for this course"
        low, high = np.array(self.room[::2])[:, None], np.array(self.room[1::2])[:, None]
        places = states[list(self.position)]
        return (low - self.slack <= places) & (places <= high + self.slack)

    def _room_in_words(self) -> str:
        assert self.room is not None, "__post_init__ requires a room for this course"
        left, right, bottom, top = self.room
        return f"the room x {left:g} to {right:g} m, y {bottom:g} to {top:g} m with {self.slack:g} m of slack"


def _root(motion: ConstantAcceleration | ConstantVelocity, dt: float) -> Floats:
    """L of the ground truth's noise, without columns if it has no noise."""
    root = motion._process(dt).root
    return root if motion.truth_noise else root[:, :0]


def _walk(
    states: Floats, root: Floats, transition: Floats, steps: int, rng: np.random.Generator, turn: int | None = None
) -> Iterator[Floats]:
    """(D, B) states of B trajectories at the steps 0, 1, ... `steps`; vy is reversed at the step `turn`."""
    for step in range(steps + 1):
        if step > 0:
            states = transition @ states + root @ rng.standard_normal((root.shape[1], states.shape[1]))
        if step == turn:
            states = states * np.array([[1.0], [1.0], [1.0], [-1.0]])
        yield states
