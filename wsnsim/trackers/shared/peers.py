"""Gaussian filters without a head, in information form: beliefs in the members' memories, and what readings add.

    PeerFilter                      the base: a subclass gives `fused(scene)`, the flow after the prediction

A reading z at a node with the prediction (x, P) adds the information H = Gᵀ R⁻¹ G and h = Gᵀ R⁻¹ (z - g(x) + G x), by
the sensor's expected reading g, slope G and variance R at x: exact where the sensor is linear. Both concern the
position alone. A symmetric matrix is sent as its upper triangle, four numbers in a packet.
"""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, is_finite, near, rows
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Delivery, Flow, Local, Member, Parcel
from wsnsim.kernels.gaussian import cholesky
from wsnsim.trackers.shared.moments import LINEARISE_CYCLES, forecast, predicted, prediction_cycles, symmetric
from wsnsim.trackers.shared.readings import is_whole, linearised, moment_packets, parcel

MEAN: Final = "mean"
COV: Final = "cov"
NEWS: Final = "news"
"""What a member's memory holds: mean (D,), covariance (D, D), and the packed information of its own reading, if any."""
Information: TypeAlias = tuple[Floats, Floats]
"""An information vector and its matrix."""


class PeerFilter:
    """A Gaussian filter that every participant runs."""

    headless: ClassVar[bool] = True
    angles: ClassVar[bool] = True
    vector_readings: ClassVar[bool] = True
    assumes_gaussian: ClassVar[bool] = True

    def fused(self, scene: Scene) -> Flow[None]:
        """Combine predictions and readings of all participants, once each has both in its memory."""
        raise NotImplementedError

    def begin(self, member: Member, prior: Estimate) -> None:
        """Take the prior."""
        member.memory[MEAN], member.memory[COV] = prior.mean.copy(), prior.cov.copy()

    def step(self, scene: Scene) -> Flow[None]:
        """Each participant predicts and takes its own reading; then all combine what they have."""
        size = len(scene.motion.columns)
        cycles = scene.steps * prediction_cycles(size) + LINEARISE_CYCLES + inversion_cycles(size)
        yield Local(partial(_predict, scene=scene), cycles)
        yield from self.fused(scene)

    def belief_of(self, member: Member) -> Estimate | None:
        """The mean and the covariance of a participant."""
        return Estimate(member.memory[MEAN], member.memory[COV]) if MEAN in member.memory else None

    def announcement(self, member: Member) -> Parcel:
        """Mean and covariance."""
        mean, cov = member.memory[MEAN], member.memory[COV]
        return parcel(packed(mean, cov), moment_packets(mean.size), "belief")

    def join(self, member: Member, payload: Floats) -> None:
        """Take mean and covariance."""
        member.memory[MEAN], member.memory[COV] = unpacked(payload)

    def estimate(self, belief: Estimate) -> Estimate:
        """The belief itself."""
        return belief

    def forecast(self, belief: Estimate, scene: Scene, ahead: int) -> Estimate:
        """The estimate, predicted by the motion model for `ahead` steps later."""
        return forecast(belief, scene, ahead)


def packed(vector: Floats, matrix: Floats) -> Floats:
    """A vector (n,) and the upper triangle of a symmetric matrix (n, n), one after the other."""
    return np.concatenate([vector, matrix[np.triu_indices(vector.size)]])


def unpacked(numbers: Floats) -> tuple[Floats, Floats]:
    """The vector (n,) and the matrix (n, n) of `packed`."""
    size = int((np.sqrt(9.0 + 8.0 * numbers.size) - 3.0) / 2.0 + 0.5)
    matrix = np.empty((size, size))
    upper = np.triu_indices(size)
    matrix[upper] = numbers[size:]
    matrix.T[upper] = numbers[size:]
    return numbers[:size].copy(), matrix


def inverse(matrix: Floats) -> Floats:
    """The inverse of a positive definite matrix (D, D); of one that is not, after the jitter of `cholesky`."""
    root = np.zeros_like(matrix)
    cholesky(np.ascontiguousarray(matrix), root)
    half = np.linalg.inv(root)
    return half.T @ half


def inversion_cycles(size: int) -> float:
    """Operations to invert a symmetric matrix of so many rows."""
    return float(size**3)


def information_of(member: Member) -> Information:
    """P⁻¹ x and P⁻¹ of what a member holds."""
    matrix = inverse(member.memory[COV])
    return matrix @ member.memory[MEAN], matrix


def widened(news: Floats, scene: Scene) -> Information:
    """(D,) and (D, D) the packed information about a position, as one about the state."""
    place, size = list(scene.motion.position), len(scene.motion.columns)
    vector, matrix = np.zeros(size), np.zeros((size, size))
    vector[place], matrix[np.ix_(place, place)] = unpacked(news)
    return vector, matrix


def news_of(member: Member, scene: Scene) -> Floats:
    """The packed information of a member's own reading; zeros without one."""
    place = len(scene.motion.position)
    found: Floats | None = member.memory.get(NEWS)
    return np.zeros(place * (place + 3) // 2) if found is None else found


def updated(member: Member, scene: Scene, news: Floats) -> tuple[Floats, Floats]:
    """A prediction with packed information about the position: M = (P⁻¹ + H)⁻¹, x⁺ = x + M (h - H x)."""
    vector, matrix = widened(news, scene)
    mean, after = member.memory[MEAN], symmetric(inverse(inverse(member.memory[COV]) + matrix))
    return mean + after @ (vector - matrix @ mean), after


def update(member: Member, scene: Scene, news: Floats) -> None:
    """Update the prediction of a member with packed information about the position."""
    member.memory[MEAN], member.memory[COV] = updated(member, scene, news)


def store(member: Member, vector: Floats, matrix: Floats) -> None:
    """Make an information vector and its matrix the belief of a member."""
    cov = symmetric(inverse(matrix))
    member.memory[MEAN], member.memory[COV] = cov @ vector, cov


def received(member: Member, what: str) -> list[tuple[int, Any]]:
    """(neighbour, payload) of the parcels of this name that arrived whole, by neighbour; the inbox is empty then."""
    arrived: list[Delivery] = [each for each in member.take_inbox() if each.what == what and is_whole(each.mask)]
    return sorted([(each.source, each.payload) for each in arrived], key=lambda pair: pair[0])


def _predict(member: Member, scene: Scene) -> None:
    """Predict to the time of the scene, and note what the member's own reading says there."""
    memory = member.memory
    memory[MEAN], memory[COV] = predicted(memory[MEAN], memory[COV], scene)
    memory.pop(NEWS, None)
    member.take_inbox()
    if member.reading is not None and is_finite(member.reading):
        memory[NEWS] = _information_in(member, memory[MEAN][list(scene.motion.position)], scene)


def _information_in(member: Member, point: Floats, scene: Scene) -> Floats:
    """The packed information in a member's reading about the position, linearised at a point (P,)."""
    assert member.reading is not None, "only a reading informs"
    places, traits = member.position[None], member.traits[None]
    expected, gradients, variances = linearised(point[:, None], scene.sensor, places, traits)
    slopes, weights = gradients[:, :, 0], 1.0 / variances[:, 0]
    heard = near(scene.sensor, rows(scene.sensor, np.array([member.reading])), expected[:, 0])
    weighted = slopes.T * weights
    return packed(weighted @ (heard - expected[:, 0] + slopes @ point), weighted @ slopes)
