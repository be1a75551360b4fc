"""The extended Kalman filter in one head: the reference for filters that relay from sensor to sensor.

Requests of a step:

    Gather: readings  Compute                        all members
    Scatter: poll  Gather: reading  Compute          the nearest alone
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.part import part
from wsnsim.base.ports import NO_INNOVATION, Estimate, Innovation, Scene
from wsnsim.base.requests import Compute, Flow, Gather, Member, Parcel, Scatter
from wsnsim.base.standalone import BlockEstimates, StandaloneBlock
from wsnsim.kernels.relay import kalman
from wsnsim.trackers.shared.gains import Gains, gain_prior, gains_before, no_gains
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.parcels import parcel
from wsnsim.trackers.shared.readings import Evidence, gather_readings, reading_parcel
from wsnsim.trackers.shared.whole_runs import kalman_runs

POLL = "poll"
LINEARISE_CYCLES = 20.0
"""CPU cycles to linearise one reading."""


@dataclass(frozen=True, slots=True)
class KalmanBelief(GaussianBelief):
    """Mean and covariance after a step, and the innovation of its update."""

    innovation: Innovation = NO_INNOVATION


@part
class ExtendedKalman(HeadFilter):
    """Extended Kalman filter on all readings that reach the head, or on that of the nearest sensor alone.

    `nearest` polls only the member that is nearest to the predicted position: a packet down that polls it, and its
    reading up; nothing if it is the head. All readings are linearised at the predicted mean. The variance of a reading
    is taken there, too. The innovation of each update is reported (columns `nis` and `nis_dof` of `estimates`).

    Source: Bar-Shalom, Li, Kirubarajan (2001), section 10.3.
    """

    paper: ClassVar[str] = ""
    idea: ClassVar[str] = "extended Kalman filter in the head, on all readings or the nearest sensor's: a reference"
    state: ClassVar[str] = "mean and covariance in the head"
    messages: ClassVar[str] = "a reading up per member; or a poll down and a reading up, of the nearest"
    variants: ClassVar[str] = "readings all|nearest"
    linear_gaussian: ClassVar[bool] = True
    estimates_gains: ClassVar[bool] = True

    readings: Annotated[Literal["all", "nearest"], "whose readings update the filter"] = "all"

    def step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head, or one; it predicts, and updates with what arrived."""
        mean, cov = predicted(belief.mean, belief.cov, scene)
        place = np.array(scene.motion.position)
        if self.readings == "nearest":
            seen = yield from _nearest_reading(mean[place], scene)
        else:
            seen = yield from gather_readings(scene)
        yield Compute(_cycles(mean.size, place.size, len(seen.ids), scene.steps))
        if prior := gain_prior(scene.sensor):
            gains = gains_before(belief.gains or no_gains(mean.size), scene, belief.mean).with_nodes(seen.ids, prior)
            return (yield from _updated_with_gains(KalmanBelief(mean, cov, scene.head, gains=gains), seen, scene))
        innovation = NO_INNOVATION
        if seen.ids:
            linear = scene.sensor.linearise(mean[place, None], seen.positions, seen.traits)
            mean = mean.copy()
            expected, gradients, variances = map(np.ascontiguousarray, linear)
            square, used = kalman(mean, cov, expected, gradients, variances, seen.readings, place)
            innovation = Innovation(square, used) if used else NO_INNOVATION
        return KalmanBelief(mean, cov, scene.head, innovation=innovation)

    def estimate(self, belief: GaussianBelief) -> Estimate:
        """The belief's mean and covariance, with the innovation of the step; after a handover there is none yet."""
        innovation = belief.innovation if isinstance(belief, KalmanBelief) else NO_INNOVATION
        return Estimate(belief.mean, belief.cov, innovation=innovation)

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """All steps of many standalone runs: `base.standalone.WholeRuns`; not for the nearest one, nor with gains."""
        if self.readings == "nearest" or gain_prior(block.sensor):
            return None
        outcome, motion = kalman_runs(block), block.motion
        size, place = len(motion.columns), len(motion.position)
        return outcome.closed(outcome.sums(lambda count: _cycles(size, place, count, 1)))


def _updated_with_gains(belief: KalmanBelief, seen: Evidence, scene: Scene) -> Flow[KalmanBelief]:
    """The belief at the time of the scene, updated with readings as one augmented state of the target and the gains.

    A reading has the slope 1 in the gain of its node.
    """
    gains, size, place = belief.gains, belief.mean.size, list(scene.motion.position)
    assert gains is not None, "the gains of the nodes heard are added before the update"
    yield Compute(_augmentation_cycles(size, len(gains.nodes), len(seen.ids)))
    if not seen.ids:
        return belief
    linear = scene.sensor.linearise(belief.mean[place, None], seen.positions, seen.traits)
    rows, count = gains.rows(seen.ids), len(seen.ids)
    expected, variances = linear[0] + gains.mean[rows, None], np.ascontiguousarray(linear[2])
    slopes = np.concatenate([linear[1], np.eye(count)[:, :, None]], axis=1)
    mean, cov = (
        np.concatenate([belief.mean, gains.mean]),
        np.block([[belief.cov, gains.cross], [gains.cross.T, gains.cov]]),
    )
    columns = np.array([*place, *(size + row for row in rows)])
    square, used = kalman(mean, cov, expected, slopes, variances, seen.readings, columns)
    after = Gains(gains.nodes, mean[size:].copy(), cov[size:, size:].copy(), cov[:size, size:].copy())
    innovation = Innovation(square, used) if used else NO_INNOVATION
    return replace(belief, mean=mean[:size].copy(), cov=cov[:size, :size].copy(), innovation=innovation, gains=after)


def _nearest_reading(point: Floats, scene: Scene) -> Flow[Evidence]:
    """The reading of the member nearest to a point (P,), if there is one and its packet arrives."""
    rows: list[int] = []
    values: list[float] = []
    if scene.ids:
        row = int(((scene.positions - planar(point[None])) ** 2).sum(axis=1).argmin())
        node = scene.ids[row]
        polled = {node: True} if node == scene.head else (yield Scatter({node: parcel(None, 1, POLL)}))
        answer = (yield Gather(_polled_reading, who=(node,))) if node in polled else {}
        rows = [row] if node in answer else []
        values = [answer[node][0] for _ in rows]
    ids = tuple(scene.ids[row] for row in rows)
    return Evidence(ids, np.array(values, dtype=np.float64), scene.positions[rows], scene.traits[rows])


def _polled_reading(member: Member) -> Parcel | None:
    """The reading of a member that was asked for it; the poll is read."""
    member.take_inbox()
    return reading_parcel(member)


def _cycles(size: int, place: int, sensors: int, steps: int) -> float:
    """Operations of a step, those of the update a reading."""
    prediction = steps * (4.0 * size**3 + 2.0 * size**2)  # x⁻ = f(x), P⁻ = F P Fᵀ + Q
    innovation = 4.0 * place + 2.0 * place * size + LINEARISE_CYCLES  # ν, S = H P⁻ Hᵀ + R
    update = 3.0 * size + 8.0 * size**2  # x⁺ = x⁻ + G ν; P⁺ in Joseph's form
    return prediction + sensors * (innovation + update)


def _augmentation_cycles(size: int, gains: int, sensors: int) -> float:
    """Further operations of a step with as many gains beside the state: P_xg⁻ = F P_xg, and a larger update."""
    larger = size + gains
    return 2.0 * size * size * gains + sensors * (2.0 * larger + 8.0 * (larger**2 - size**2))
