"""Filters whose whole state is in the head: readings come up to it, and what it believes goes on with a handover.

    Gather: readings  Compute                       the requests of every step

`HeadFilter` is what all have in common, and enough for one whose belief between steps is a Gaussian. `HeadCloud` is a
particle filter in the head: a tracker of this kind says how its prediction is weighed.

    weighed_with_gains(belief, before, cloud, seen, scene)            of the Gaussian particle filter
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import NO_INNOVATION, Estimate, Floats, Innovation, Ints, Keys
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Member
from wsnsim.base.rng import derive
from wsnsim.kernels.elementary import particle_keys
from wsnsim.kernels.particles import moments, weigh
from wsnsim.trackers.shared.dealing import (
    PREDICT_CYCLES,
    Pool,
    no_particles,
    restored,
    send_all,
    send_moments,
)
from wsnsim.trackers.shared.gains import (
    Gains,
    GainsOfParticles,
    gain_prior,
    gains_before,
    gains_of,
    reported,
    send_gains,
)
from wsnsim.trackers.shared.late import Late, PastStep, step_with_late, with_late
from wsnsim.trackers.shared.moments import forecast, predicted
from wsnsim.trackers.shared.readings import Evidence, gather_readings
from wsnsim.trackers.shared.silence import SharedEstimate
from wsnsim.trackers.shared.stacks import Score, place_of, propagated_by, snapshot

WEIGH_CYCLES = 30.0
"""CPU cycles to weight one particle by one reading."""
MOVE_CYCLES = 50.0
"""CPU cycles to move one particle after its prediction, as a swarm (Jiang 2013, section 5) and other searches do."""
NOTHING = no_particles(0)
RESTORE = 5
"""Makes the key that losses on a handover are made good with another than that of the step's own resampling."""


@dataclass(frozen=True, slots=True)
class GaussianBelief:
    """A Gaussian in the head, and the gains of sensors if the filter estimates them.

    Attributes:
        mean: (D,) of the state.
        cov: (D, D) its covariance.
        head: the id of the head.
        effective: the effective number of particles; NaN without particles.
        gains: those that the filter estimates; None: it estimates none.
        past: the last steps of this head, of a filter that uses late readings.
        innovation: that of the step's update, of a Kalman filter; after a handover there is none yet.
        shared: the estimate that members share with the head, if their trigger needs one.
    """

    mean: Floats
    cov: Floats
    head: int
    effective: float = float("nan")
    gains: Gains | None = field(default=None, kw_only=True)
    past: tuple[PastStep, ...] = field(default=(), kw_only=True)
    innovation: Innovation = field(default=NO_INNOVATION, kw_only=True)
    shared: SharedEstimate | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class CloudBelief(GaussianBelief):
    """Particles with weights in the head, and their moments. It has all that a `GaussianBelief` has.

    Attributes:
        pool: the particles.
    """

    pool: Pool = NOTHING


class Prediction(NamedTuple):
    """Particles one step ago and now.

    Attributes:
        before: (D, N) one step ago.
        cloud: (D, N) now.
        log_weights: (N,) with which they come.
    """

    before: Floats
    cloud: Floats
    log_weights: Floats


class HeadFilter:
    """The base of a filter whose whole state is in the head: members only send readings.

    It gives a tracker `start`, `hand_over`, `estimate` and `forecast` for a `GaussianBelief`; a subclass gives `step`.
    Unless it says otherwise, between steps a head keeps only the Gaussian, and hands over only that.
    """

    angles: ClassVar[bool] = True
    """Whether it compares angles at their shortest difference, by `near`."""
    vector_readings: ClassVar[bool] = True
    """Whether it takes readings of several components."""
    relative_readings: ClassVar[bool] = True
    """Whether it takes all readings of a step together, of which only the differences may count."""
    assumes_gaussian: ClassVar[bool] = False
    """Whether it takes the noise of readings as Gaussian, by their mean and variance at the prediction."""

    member_cycles: ClassVar[float] = 0.0
    """Operations of a member in a step: it only sends its reading, the head does the rest."""

    def start(self, prior: Estimate, scene: Scene) -> Flow[Any]:
        """The prior as the first belief; nothing is sent."""
        return GaussianBelief(prior.mean, prior.cov, scene.head)
        yield  # a flow without requests

    def hand_over(self, belief: Any, scene: Scene, successor: int) -> Flow[Any]:
        """Send the belief; None if nothing of it arrives that a track could go on from."""
        return self.deliver(belief, scene, successor)

    def deliver(self, belief: Any, scene: Scene, successor: int) -> Flow[Any]:
        """Send mean and covariance, 4 packets for a state of four; None if one is lost."""
        arrival = yield from send_moments(belief.mean, belief.cov, successor)
        if arrival is None:
            return None
        gains = yield from self._hand_over_gains(belief, scene, successor)
        return GaussianBelief(arrival.mean, arrival.cov, successor, gains=gains)

    def estimate(self, belief: Any) -> Estimate:
        """The belief's mean and covariance, with its innovation and the effective number of particles if it has any."""
        return Estimate(belief.mean, belief.cov, belief.effective, getattr(belief, "innovation", NO_INNOVATION))

    def forecast(self, belief: Any, scene: Scene, ahead: int) -> Estimate:
        """The estimate, predicted by the motion model for `ahead` steps later."""
        return forecast(self.estimate(belief), scene, ahead)

    def report_state(self, belief: Any) -> dict[str, Floats]:
        """The estimated gains, for the table `tracker_state`; nothing if the filter estimates none."""
        return reported(getattr(belief, "gains", None))

    def _hand_over_gains(self, belief: Any, scene: Scene, successor: int) -> Flow[Gains | None]:
        """What reaches the next head of the gains that this one estimates; without any, nothing is sent."""
        gains = getattr(belief, "gains", None)
        return None if gains is None else (yield from send_gains(gains, scene, successor))


@part
class LateFilter(HeadFilter):
    """The base of filters that can use late readings. A subclass gives `one_step`, which gathers before it computes."""

    retrodicts: ClassVar[bool] = False
    """Whether its belief is one Gaussian that linearised readings update."""

    late: Annotated[
        Late,
        "readings that arrive after the head has gone on: ignored, filtered again in the order of measurement, or "
        "used to correct the present Gaussian",
    ] = "ignore"
    late_window: Annotated[float, Quantity("s", gt=0, le=1e9), "age of the oldest late reading that is used"] = 10.0

    def one_step(self, belief: Any, scene: Scene) -> Flow[Any]:
        """One step with the readings that arrive in time."""
        raise NotImplementedError

    def step(self, belief: Any, scene: Scene) -> Flow[Any]:
        """One step: N_act - 1 readings reach the head, and late ones of earlier steps if it uses them."""
        if self.late == "ignore":
            return self.one_step(belief, scene)
        return step_with_late(self.one_step, self.late, self.late_window, belief, scene)

    def hand_over(self, belief: Any, scene: Scene, successor: int) -> Flow[Any]:
        """Send the belief, after what has arrived late is used; None if no track could go on from what arrives."""
        if self.late == "ignore":
            return self.deliver(belief, scene, successor)
        return self._deliver_with_late(belief, scene, successor)

    def _deliver_with_late(self, belief: Any, scene: Scene, successor: int) -> Flow[Any]:
        """Use what has arrived late, and send the belief without its past."""
        belief = yield from with_late(self.one_step, self.late, self.late_window, belief, scene)
        return (yield from self.deliver(replace(belief, past=()), scene, successor))


@part
class HeadCloud(LateFilter):
    """A particle filter in the head.

    A subclass gives `reading_cycles`, and `weighed` or `filtered`.
    """

    tells_prediction: ClassVar[bool] = True
    """Whether members that quantise about the head's prediction are sent it."""

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles"] = 400
    handover: Annotated[Literal["particles", "gaussian"], "what a handover carries"] = "particles"

    @property
    def reading_cycles(self) -> float:
        """The operations for each particle and reading, in one step."""
        return WEIGH_CYCLES

    @property
    def move_cycles(self) -> float:
        """The operations to move each particle after its prediction, in one step."""
        return 0.0

    def weighed(self, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
        """The belief after at least one reading.

        Args:
            prediction: The particles, predicted to `scene.time`.
            seen: The readings that reached the head.
            scene: What the head knows.
        """
        raise NotImplementedError

    def filtered(self, pool: Pool, seen: Evidence, scene: Scene) -> CloudBelief:
        """The belief after a prediction of the pool and at least one reading, of filters that estimate no gains.

        Args:
            pool: The particles of the last step.
            seen: The readings that reached the head.
            scene: What the head knows.
        """
        before, cloud = propagated_by(scene.key, pool.cloud, scene)
        return self.weighed(Prediction(before, cloud, pool.log_weights), seen, scene)

    def filtered_with_gains(self, belief: CloudBelief, seen: Evidence, scene: Scene) -> Flow[CloudBelief]:
        """As `filtered`, of a filter that estimates the gains of sensors beside the state."""
        raise NotImplementedError

    def start(self, prior: Estimate, scene: Scene) -> Flow[CloudBelief]:
        """Draw the particles from the prior."""
        nothing = CloudBelief(prior.mean, prior.cov, scene.head, pool=no_particles(prior.mean.size))
        return (yield from self._full(nothing, scene))

    def one_step(self, belief: CloudBelief, scene: Scene) -> Flow[CloudBelief]:
        """One step: N_act - 1 readings reach the head, which predicts and weighs; without any, it predicts.

        Then mean and covariance are the motion's prediction of the last ones, free of the noise of a resampling.
        """
        belief = yield from self._full(belief, scene)
        seen = yield from gather_readings(scene, belief=belief)
        used = self.move_cycles + self.reading_cycles * len(seen.ids) if seen.ids else 0.0
        yield Compute((PREDICT_CYCLES * scene.steps + used) * self.particles)
        if seen.ids and gain_prior(scene.sensor):
            return (yield from self.filtered_with_gains(belief, seen, scene))
        if seen.ids:
            return self.filtered(belief.pool, seen, scene)
        _, cloud = propagated_by(scene.key, belief.pool.cloud, scene)
        after = only_predicted(belief, scene)
        pool = replace(belief.pool, cloud=cloud)
        return replace(belief, mean=after.mean, cov=after.cov, gains=after.gains, pool=pool, head=scene.head)

    def deliver(self, belief: CloudBelief, scene: Scene, successor: int) -> Flow[CloudBelief | None]:
        """N_p + ceil(N_p / 4) + 4 packets to the successor, or the 4 of the moments alone (of a state of four)."""
        if self.handover == "gaussian":
            arrival = yield from send_moments(belief.mean, belief.cov, successor)
        else:
            arrival = yield from send_all(belief.pool, belief.mean, belief.cov, successor)
        if arrival is None:
            return None
        gains = yield from self._hand_over_gains(belief, scene, successor)
        return CloudBelief(arrival.mean, arrival.cov, successor, pool=arrival.pool, gains=gains)

    def snapshot(self, belief: CloudBelief, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(head, particles (D, n), weights (n,)), once: all particles are in the head."""
        return snapshot([(belief.head, belief.pool.cloud, belief.pool.log_weights)])

    def block_cycles(self, counts: Ints) -> Floats:
        """(R,) operations of standalone runs, of their numbers of readings (R, K) by step; the start included."""
        used = np.where(counts > 0, self.move_cycles + self.reading_cycles * counts, 0.0)
        cycles: Floats = self.particles * (PREDICT_CYCLES * (1 + counts.shape[1]) + used.sum(axis=1))
        return cycles

    def _full(self, belief: CloudBelief, scene: Scene) -> Flow[CloudBelief]:
        """The belief with its full number of particles, which losses on a handover may have reduced."""
        if belief.pool.log_weights.size == self.particles:
            return belief
        key = derive(scene.key, RESTORE) if belief.pool.log_weights.size else scene.key
        cloud = yield from restored(belief.pool, belief.mean, belief.cov, self.particles, key)
        return replace(belief, pool=Pool(cloud, np.zeros(self.particles)))


def only_predicted(belief: GaussianBelief, scene: Scene) -> GaussianBelief:
    """The belief at `scene.time` when nothing arrived: the prediction by the motion model.

    Args:
        belief: That of the last step.
        scene: What the head knows.
    """
    gains = None if belief.gains is None else gains_before(belief.gains, scene, belief.mean)
    return GaussianBelief(*predicted(belief.mean, belief.cov, scene), scene.head, gains=gains)


def score_of(seen: Evidence, scene: Scene) -> Score:
    """(D, N) particles → (N,) log-likelihoods of all readings that reached the head."""
    place, sensor = place_of(scene), scene.sensor
    return lambda cloud: sensor.log_likelihood(cloud[place], seen.readings, seen.positions, seen.traits)


def keys_of(scene: Scene, count: int, tag: int) -> Keys:
    """The keys (count,), one per particle, for one purpose of this step in this head."""
    return particle_keys(np.array([scene.key], np.uint64), np.array([0, count]), tag)


def summary(cloud: Floats, log_weights: Floats) -> tuple[Floats, Floats, float]:
    """Weighted mean (D,), covariance (D, D), effective number of a cloud. Its log-weights are normalised in place."""
    everyone = np.array([0, log_weights.size])
    effective = float(weigh(log_weights, everyone)[0])
    means, covs = moments(cloud, log_weights, everyone)
    return means[0], covs[0], effective


def weighed_with_gains(
    belief: GaussianBelief,
    before: Floats,
    cloud: Floats,
    seen: Evidence,
    scene: Scene,
    log_weights: Floats | float = 0.0,
) -> Flow[CloudBelief]:
    """The belief after readings whose sensors have unknown gains, which are estimated beside the state.

    Noise counts as normal, whatever the sensor model says: only then are gains Gaussian given a particle (our choice).

    Args:
        belief: the moments of state and gains before the step.
        before: (D, N) particles at the time of the belief.
        cloud: (D, N) the same particles now.
        seen: at least one reading.
        scene: the scene.
        log_weights: (N,) of the particles before the readings.
    """
    gains = gains_of(belief, scene, seen.ids)
    yield Compute(_gain_cycles(cloud, len(gains.nodes), len(seen.ids)))
    given = GainsOfParticles.given(gains, belief.mean, belief.cov, before)
    expected, _, variances = scene.sensor.linearise(cloud[place_of(scene)], seen.positions, seen.traits)
    given, scores = given.weighed(expected, variances, seen)
    scores += log_weights
    mean, cov, effective = summary(cloud, scores)
    gains = replace(given.joint(cloud, mean, scores), name=gains.name)
    return CloudBelief(mean, cov, scene.head, effective, Pool(cloud, scores), gains=gains)


def _gain_cycles(cloud: Floats, gains: int, readings: int) -> float:
    """Operations beyond those without gains: a particle's means of gains, its share of the update, and the moments."""
    each: float = 2.0 * gains * (2 * len(cloud) + readings + gains)
    return each * (cloud.size // len(cloud))
