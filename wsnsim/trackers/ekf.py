"""The extended Kalman filter in one head: the reference for filters that relay from sensor to sensor.

Requests of a step:

    Gather: readings  Compute                        all members
    Scatter: poll  Gather: reading  Compute          the nearest alone
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import (
    NO_INNOVATION,
    Floats,
    Innovation,
    Ints,
    innovation_of,
    is_relative,
    near,
    planar,
    rows,
)
from wsnsim.base.errors import Issue
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import MotionModel, Scene, Trigger
from wsnsim.base.requests import Compute, Flow, Gather, Member, Parcel, Scatter
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.relay import kalman
from wsnsim.trackers.shared.gains import gain_prior, gains_before, gains_of
from wsnsim.trackers.shared.gaussian_port import LinearisedPort
from wsnsim.trackers.shared.heads import GaussianBelief, LateFilter
from wsnsim.trackers.shared.moments import predicted, prediction_cycles, update_cycles
from wsnsim.trackers.shared.readings import Evidence, packet_bits, parcel, reading_parcel, replied
from wsnsim.trackers.shared.silence import HeardReadings
from wsnsim.trackers.shared.triggers import Always, trigger_issues
from wsnsim.trackers.shared.whole_runs import kalman_runs

POLL = "poll"


@part
class ExtendedKalman(LateFilter):
    """Extended Kalman filter on all readings that reach the head, or on that of the nearest sensor alone.

    `nearest` polls only the member that is nearest to the predicted position: a packet down that polls it, and its
    reading up; nothing if it is the head. All readings are linearised at the predicted mean. The variance of a reading
    is taken there, too. The innovation of each update is reported (columns `nis` and `nis_dof` of `estimates`).

    With `iterations` above 1 it is the iterated filter: each further iteration linearises the readings at the mean
    that the last one gave, and updates the prediction again. These are Gauss-Newton steps towards the mode of the
    posterior. The variances of the readings and the reported innovation stay those at the predicted mean.

    Source: Bar-Shalom, Li, Kirubarajan (2001), section 10.3; section 10.5.2 for the iterations; Bell, Cathey (1993)
    show that they are Gauss-Newton steps.
    """

    linear_gaussian: ClassVar[bool] = True
    assumes_gaussian: ClassVar[bool] = True
    retrodicts: ClassVar[bool] = True
    estimates_gains: ClassVar[bool] = True

    readings: Annotated[Literal["all", "nearest"], "whose readings update the filter"] = "all"
    iterations: Annotated[int, Quantity("", ge=1, le=1000), "linearisations in an update; more than 1: iterated"] = 1
    trigger: Annotated[Trigger, OfRole("trigger"), "when a member sends its reading"] = Always()

    @property
    def tells_prediction(self) -> bool:
        """Whether members that quantise about the head's prediction are sent it: if all of them are asked."""
        return self.readings == "all"

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the reading of the nearest sensor says nothing by itself, or would have to be late."""
        if self.readings == "nearest" and is_relative(setup.filter_sensor):
            yield Issue(("tracker", "readings"), "of readings of which only the differences count, use all")
        if self.readings == "nearest" and self.late != "ignore":
            yield Issue(("tracker", "late"), "the head waits for the reading of the nearest sensor: use readings: all")
        if self.readings == "nearest" and self.trigger != Always():
            yield Issue(
                ("tracker", "trigger"), "the head polls the nearest member, which does not decide: use all readings"
            )
        yield from trigger_issues(self, setup)

    def one_step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head, or one; it predicts, and updates with what arrived."""
        mean, cov = predicted(belief.mean, belief.cov, scene)
        place = np.array(scene.motion.position)
        if self.readings == "nearest":
            heard = HeardReadings((yield from _nearest_reading(mean[place], scene)))
        else:
            heard = yield from self.trigger.gather(belief, scene)
        seen = heard.seen
        yield Compute(_cycles(mean.size, place.size, seen.readings.size, scene.steps, self.iterations))
        if gain_prior(scene.sensor):
            gains = gains_before(gains_of(belief, scene, ()), scene, belief.mean)
            gains = gains_of(replace(belief, gains=gains), scene, seen.ids)
            before = GaussianBelief(mean, cov, scene.head, gains=gains)
            return (yield from _updated_with_gains(before, seen, scene, self.iterations))
        innovation = NO_INNOVATION
        if seen.ids:
            mean, cov, innovation = _updated(mean, cov, seen, scene, self.iterations)
        mean, cov = heard.with_silence(mean, cov, scene)
        return GaussianBelief(mean, cov, scene.head, innovation=innovation, shared=heard.shared)

    def gaussian(self, motion: MotionModel) -> LinearisedPort:
        """The filter for trackers of several targets: without further iterations, and with the scans of all members."""
        return LinearisedPort(motion)

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """All steps of many standalone runs: `WholeRuns`; not of every variant, nor with gains."""
        plain = self.readings == "all" and self.iterations == 1 and self.trigger == Always()
        if not plain or gain_prior(block.sensor):
            return None
        outcome, motion = kalman_runs(block), block.motion
        size, place = len(motion.columns), len(motion.position)
        return outcome.closed(outcome.sums(lambda count: _cycles(size, place, count, 1, 1)))


def _updated(
    mean: Floats, cov: Floats, seen: Evidence, scene: Scene, iterations: int, gains: Ints | None = None
) -> tuple[Floats, Floats, Innovation]:
    """Mean (D,) and covariance (D, D) updated with readings, and the innovation at the predicted mean.

    Each iteration linearises h at the point x of the last one and updates the prediction x⁻ with the readings
    z - h(x) - H (x⁻ - x), which are linear in the state.

    Args:
        mean: The predicted state; with `gains`, the gains behind it.
        cov: Its covariance.
        seen: The readings that arrived, one at least.
        scene: What the head knows.
        iterations: How often the readings are linearised.
        gains: (n,) columns of the gains of the nodes that were heard, in which the reading of each has the slope 1.
    """
    place, measured = np.array(scene.motion.position), rows(scene.sensor, seen.readings)
    columns = place if gains is None else np.concatenate([place, gains])
    point, after, innovation = mean[place], (mean, cov), NO_INNOVATION
    for iteration in range(iterations):
        linear = scene.sensor.linearise(point[:, None], seen.positions, seen.traits)
        expected, gradients, spread = map(np.ascontiguousarray, linear)
        if gains is not None:
            expected = expected + mean[gains, None]
            gradients = np.concatenate([gradients, np.eye(gains.size)[:, :, None]], axis=1)
        heard = near(scene.sensor, measured, expected[:, 0])
        if iteration == 0:
            variances = spread
        else:
            expected = expected + gradients[:, : place.size, 0] @ (mean[place] - point)[:, None]
        after = mean.copy(), cov.copy()
        square, used = kalman(*after, expected, gradients, variances, heard, columns)
        if iteration == 0:
            innovation = innovation_of(scene.sensor, square, used)
        point = after[0][place]
    return *after, innovation


def _updated_with_gains(belief: GaussianBelief, seen: Evidence, scene: Scene, iterations: int) -> Flow[GaussianBelief]:
    """The belief at the time of the scene, updated with readings as one augmented state of the target and the gains."""
    gains, size = belief.gains, belief.mean.size
    assert gains is not None, "the gains of the nodes heard are added before the update"
    yield Compute(_augmentation_cycles(size, len(gains.nodes), len(seen.ids), iterations))
    if not seen.ids:
        return belief
    mean = np.concatenate([belief.mean, gains.mean])
    cov = np.block([[belief.cov, gains.cross], [gains.cross.T, gains.cov]])
    columns = size + np.array(gains.rows(seen.ids))
    mean, cov, innovation = _updated(mean, cov, seen, scene, iterations, columns)
    after = replace(gains, mean=mean[size:].copy(), cov=cov[size:, size:].copy(), cross=cov[:size, size:].copy())
    return replace(belief, mean=mean[:size].copy(), cov=cov[:size, :size].copy(), innovation=innovation, gains=after)


def _nearest_reading(point: Floats, scene: Scene) -> Flow[Evidence]:
    """The reading of the member nearest to a point (P,), if there is one and its packet arrives."""
    if not scene.ids:
        return replied({}, scene)
    node = scene.ids[int(((scene.positions - planar(point[None])) ** 2).sum(axis=1).argmin())]
    polled = {node: True} if node == scene.head else (yield Scatter({node: parcel(None, 1, POLL)}))
    answer = partial(_polled_reading, bits=packet_bits(scene.sensor))
    return replied((yield Gather(answer, who=(node,))) if node in polled else {}, scene)


def _polled_reading(member: Member, bits: int) -> Parcel | None:
    """The reading of a member that was asked for it; the poll is read."""
    member.take_inbox()
    return reading_parcel(member, bits)


def _cycles(size: int, place: int, sensors: int, steps: int, iterations: int) -> float:
    """Operations of a step, those of the update a reading."""
    again = update_cycles(size, place) + 2.0 * place  # H (x⁻ - x) too
    return steps * prediction_cycles(size) + sensors * (update_cycles(size, place) + (iterations - 1) * again)


def _augmentation_cycles(size: int, gains: int, sensors: int, iterations: int) -> float:
    """Further operations of a step with as many gains beside the state: P_xg⁻ = F P_xg, and a larger update."""
    larger = size + gains
    return 2.0 * size * size * gains + iterations * sensors * (2.0 * larger + 8.0 * (larger**2 - size**2))
