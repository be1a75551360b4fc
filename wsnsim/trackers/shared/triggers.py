"""Triggers: whether a member sends its reading, and what a head learns from one that did not.

    heard = yield from trigger.gather(belief, scene)            instead of `gather_readings`
    mean, cov = heard.with_silence(mean, cov, scene)            after the update with `heard.seen`

The head broadcasts its prediction, which is paid for, and its members keep it as a shared estimate. A member compares
its reading z with what that expects, ẑ, and is silent if they are close. A head that uses silence takes it as

    p + (1 - p) r P(silent | z)        p: probability that a packet does not arrive, r: that the broadcast did

and replaces the posterior, which is a mixture, by the Gaussian with its mean and covariance, one silent member after
the other, with the readings linearised. So without loss and with a linear sensor one silent member is treated exactly
up to second moments.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, components_of, is_relative, near
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Broadcast, Compute, Flow, Gather, Local, Member, Parcel
from wsnsim.base.rng import derive, uniforms
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.gains import gain_prior
from wsnsim.trackers.shared.moments import predicted, stepped, symmetric
from wsnsim.trackers.shared.readings import (
    Evidence,
    gather_readings,
    is_whole,
    moment_packets,
    packet_bits,
    parcel,
    reading_parcel,
)

SHARED: Final = "shared_estimate"
DRAW: Final = 11
"""Makes the key of a member's decision to send another than those of its other draws."""
LEAST_CHANCE: Final = 1e-12
"""A silence less probable than this is left out: its moments would be rounding errors."""
FAR: Final = 38.0
"""Standard deviations beyond which the density of a normal is 0 in floating-point numbers."""
DECISION_CYCLES: Final = 60.0
"""CPU cycles to compare a reading with its limits, or to compute the moments of one silence."""


@dataclass(frozen=True, slots=True)
class SharedEstimate:
    """What a head has broadcast last: the predicted state, or its position alone if it is for one step.

    Attributes:
        mean: (D,) or (P,).
        cov: (D, D) or (P, P) its covariance.
        step: The step to which it was predicted.
    """

    mean: Floats
    cov: Floats
    step: int

    def expects(self, scene: Scene, positions: Floats, traits: Floats) -> Expected:
        """What it expects the sensors of S nodes at (S, 2), with traits (S, T), to measure at the step of a scene."""
        mean, cov, place = self.mean, self.cov, list(scene.motion.position)
        if mean.size > len(place):
            mean, cov = stepped(mean, cov, scene.motion, scene.dt, self.step * scene.dt, scene.step - self.step)
            mean, cov = mean[place], cov[np.ix_(place, place)]
        return expected_of(mean, cov, scene.sensor, positions, traits)


class Expected(NamedTuple):
    """What the sensors of S nodes are expected to measure of a Gaussian position.

    Attributes:
        values: (S,) ẑ.
        slopes: (S, P) H, by the position.
        noise: (S,) variances R of the readings alone.
        cross: (S, P) covariances of readings and position, H P.
        variances: (S,) H P Hᵀ + R.
    """

    values: Floats
    slopes: Floats
    noise: Floats
    cross: Floats
    variances: Floats


class Moments(NamedTuple):
    """Silence of one member, in standard deviations of its reading: its probability, and moments if nothing is lost."""

    chance: float
    mean: float
    variance: float


@dataclass(frozen=True, slots=True)
class Heard:
    """What a head has after asking for readings.

    Attributes:
        seen: The readings that arrived.
        shared: What it has broadcast last, None if nothing.
        silent: Rows of `scene.ids` whose silence it uses.
        trigger: By what they decided.
    """

    seen: Evidence
    shared: SharedEstimate | None = None
    silent: tuple[int, ...] = ()
    trigger: EstimateTrigger | None = None

    def with_silence(self, mean: Floats, cov: Floats, scene: Scene) -> tuple[Floats, Floats]:
        """Mean (D,) and covariance (D, D) after the silence of members, which comes after all readings.

        Args:
            mean: After the update with the readings that arrived.
            cov: Its covariance.
            scene: What the head knows.
        """
        if not self.silent or self.trigger is None or self.shared is None:
            return mean, cov
        rows, place, start = list(self.silent), list(scene.motion.position), mean
        nodes = scene.positions[rows], scene.traits[rows]
        told = self.shared.expects(scene, *nodes)
        now = expected_of(mean[place], cov[np.ix_(place, place)], scene.sensor, *nodes)
        centres, widths = near(scene.sensor, told.values, now.values), self.trigger.widths(told)
        loss = self.trigger.loss
        for row, slope in enumerate(now.slopes):
            cross = cov[:, place] @ slope
            sd = math.sqrt(float(slope @ cross[place] + now.noise[row]))
            centre = now.values[row] + slope @ (mean - start)[place]
            moments = self.trigger.silence_of(float(centres[row] - centre) / sd, float(widths[row]) / sd)
            if moments.chance < LEAST_CHANCE:
                continue
            shift, left = _with_loss(moments, loss, (1.0 - loss) ** moment_packets(self.shared.mean.size))
            mean = mean + cross * (shift / sd)
            cov = symmetric(cov - np.outer(cross, cross) * ((1.0 - left) / sd**2))
        return mean, cov


@part
class Always:
    """Every member sends its reading at each step."""

    shares: ClassVar[bool] = False
    """Whether members decide by an estimate that the head broadcasts."""

    def gather(self, belief: Any, scene: Scene) -> Flow[Heard]:
        """The readings that reach the head."""
        return Heard((yield from gather_readings(scene, belief=belief)))


@part
class ChosenMembers(Always):
    """Base of triggers by which each member decides by itself, from nothing that the head tells it."""

    def sends(self, member: Member, step: int) -> bool:
        """Whether a member sends its reading."""
        raise NotImplementedError

    def gather(self, belief: Any, scene: Scene) -> Flow[Heard]:
        """The readings that reach the head."""
        bits, step = packet_bits(scene.sensor), scene.step

        def parcel_of(member: Member) -> Parcel | None:
            return reading_parcel(member, bits) if self.sends(member, step) else None

        return Heard(_evidence((yield Gather(parcel_of)), scene))


@part
class Periodic(ChosenMembers):
    """A member sends at every n-th step, each at a step of its own: decimation, the rival of events."""

    every: Annotated[int, Quantity("", ge=2, le=10_000), "steps from one reading of a member to its next"] = 2

    def sends(self, member: Member, step: int) -> bool:
        """Whether it is the member's turn."""
        return (step + member.id) % self.every == 0


@part
class RandomSending(ChosenMembers):
    """A member sends at each step with the same probability, independently."""

    probability: Annotated[float, Quantity("", gt=0, lt=1), "probability that a member sends"] = 0.5

    def sends(self, member: Member, step: int) -> bool:
        """Whether the member's draw of this step says so."""
        return _uniform(member) < self.probability


@part
class EstimateTrigger(Always):
    """Base of triggers by which a member compares its reading with an estimate that the head broadcasts.

    The head broadcasts mean and covariance of the predicted position at every step; or of the whole state at every
    `shared_every` steps and after a handover, and members predict it to the steps between. A member that has none that
    is recent enough sends its reading. The head knows which members sense, as everywhere here: an idealisation,
    without which silence says less.
    """

    shares: ClassVar[bool] = True

    silence: Annotated[Literal["used", "ignored"], "whether the head updates with the silence of members"] = "used"
    loss: Annotated[
        float,
        Quantity("", ge=0, lt=1),
        "p: probability with which a packet that is sent does not arrive, for any cause",
    ] = 0.0
    shared_every: Annotated[
        int, Quantity("", ge=1, le=1000), "steps from one broadcast of the estimate to the next"
    ] = 1

    def widths(self, told: Expected) -> Floats:
        """(S,) how far readings may be from what is expected, in their unit."""
        raise NotImplementedError

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether a member is silent whose reading is so far from what is expected."""
        raise NotImplementedError

    def silence_of(self, centre: float, width: float) -> Moments:
        """The silence of a member whose reading is standard normal, if it is silent `width` about `centre`."""
        raise NotImplementedError

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if a reading is more than one number, or a cell."""
        sensor = setup.filter_sensor
        if len(components_of(sensor)) > 1 or is_relative(sensor) or hasattr(sensor, "reading_bits"):
            why = "compares a reading, one number, with what is expected: not readings of several components, relative "
            yield Issue(("tracker", "trigger"), f"{why}ones or such in few bits; use periodic or random")
        elif gain_prior(sensor):
            why = "members do not know the gains that the head estimates; use periodic or random, or assume known gains"
            yield Issue(("tracker", "trigger"), why)

    def gather(self, belief: Any, scene: Scene) -> Flow[Heard]:
        """The readings that reach the head, and whose silence it uses."""
        shared: SharedEstimate | None = getattr(belief, "shared", None)
        others = set(scene.ids) - {scene.head}
        if shared is None or scene.step - shared.step >= self.shared_every:
            shared = self._shared(belief, scene)
            if set(scene.roster) - {scene.head}:
                yield Broadcast(parcel(shared, moment_packets(shared.mean.size), SHARED))
        if others:
            yield Local(partial(self._decide, scene=scene), DECISION_CYCLES, who=tuple(others), uses_readings=False)
        bits, head = packet_bits(scene.sensor), scene.head
        reply = yield Gather(partial(_reading_of_sender, head=head, bits=bits))
        seen = _evidence(reply, scene)
        silent = [row for row, node in enumerate(scene.ids) if node in others and node not in reply]
        if self.silence == "ignored" or not silent:
            return Heard(seen, shared)
        yield Compute(len(silent) * DECISION_CYCLES)
        return Heard(seen, shared, tuple(silent), self)

    def _shared(self, belief: Any, scene: Scene) -> SharedEstimate:
        """The prediction: of the state, or of the position if members need it for one step only."""
        mean, cov = predicted(belief.mean, belief.cov, scene)
        if self.shared_every == 1:
            place = list(scene.motion.position)
            mean, cov = mean[place], cov[np.ix_(place, place)]
        return SharedEstimate(mean, cov, scene.step)

    def _decide(self, member: Member, scene: Scene) -> None:
        """Remember whether the member sends; it does without a shared estimate that is recent enough."""
        for each in member.take_inbox():
            if each.what == SHARED and is_whole(each.mask):
                member.memory[SHARED] = each.payload
        shared: SharedEstimate | None = member.memory.get(SHARED)
        silent = False
        if shared is not None and scene.step - shared.step < self.shared_every and member.reading is not None:
            told = shared.expects(scene, member.position[None], member.traits[None])
            value = near(scene.sensor, np.array([member.reading], dtype=np.float64), told.values)
            apart = abs(float(value[0] - told.values[0]))
            silent = self.is_silent(apart, float(self.widths(told)[0]), member)
        member.memory["silent"] = silent


@part
class Event(EstimateTrigger):
    """A member sends if its reading would move the shared estimate of the position by more than a threshold.

    It is silent if |z - ẑ| ‖K‖ is at most the threshold, with the rows of the Kalman gain K of the position. What
    remains of a reading that was not sent is a truncated normal.

    Source: Wu, Jia, Johansson, Shi (2013) for the innovation that is silent in an interval, as a truncated normal.
    """

    threshold: Annotated[float, Quantity("m", gt=0), "shift of the estimated position above which a member sends"] = 1.0

    def widths(self, told: Expected) -> Floats:
        """(S,) half the length of the interval of readings that are not sent."""
        gains = told.cross / told.variances[:, None]
        return self.threshold / np.maximum(np.sqrt((gains**2).sum(axis=1)), 1e-300)

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether the reading is in the interval."""
        return apart <= width

    def silence_of(self, centre: float, width: float) -> Moments:
        """A standard normal, truncated to the interval."""
        low, high = max(centre - width, -FAR), min(centre + width, FAR)
        chance = _cdf(high) - _cdf(low) if low <= 0.0 else _cdf(-low) - _cdf(-high)
        if chance < LEAST_CHANCE:
            return Moments(0.0, 0.0, 1.0)
        mean = (_density(low) - _density(high)) / chance
        square = 1.0 + (low * _density(low) - high * _density(high)) / chance
        return Moments(chance, mean, max(square - mean**2, 0.0))


@part
class Stochastic(EstimateTrigger):
    """A member is silent with the probability exp(-(z - ẑ)² / (2 w²)), with which the posterior stays Gaussian.

    Source: Han, Mo, Wu, Weerakkody, Sinopoli, Shi (2015), with the closed loop; Xu, Mo, Xie (2018) for loss.
    """

    width: Annotated[float, Quantity("", gt=0), "w, in standard deviations of the expected reading"] = 1.0

    def widths(self, told: Expected) -> Floats:
        """(S,) w in the unit of the readings."""
        return self.width * np.sqrt(told.variances)

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether the member's draw says so."""
        return _uniform(member) < math.exp(-0.5 * (apart / width) ** 2)

    def silence_of(self, centre: float, width: float) -> Moments:
        """A standard normal times the probability of silence."""
        total = 1.0 + width**2
        chance = width / math.sqrt(total) * math.exp(-0.5 * centre**2 / total)
        return Moments(chance, centre / total, width**2 / total)


def issues_of(component: Any, setup: TrackingSetup) -> Iterable[Issue]:
    """What a component within another has against a scenario: nothing, if it has no `check`.

    Args:
        component: The component.
        setup: The scenario.
    """
    check = getattr(component, "check", None)
    return () if check is None else check(setup)


def expected_of(point: Floats, cov: Floats, sensor: SensorModel, positions: Floats, traits: Floats) -> Expected:
    """What the sensors of S nodes are expected to measure of a Gaussian position, linearised at its mean.

    Args:
        point: (P,) its mean.
        cov: (P, P) its covariance.
        sensor: Their sensor model.
        positions: (S, 2) of the nodes in m.
        traits: (S, T) of their sensors.
    """
    values, gradients, noise = sensor.linearise(point[:, None], positions, traits)
    slopes = gradients[:, :, 0]
    cross = slopes @ cov
    return Expected(values[:, 0], slopes, noise[:, 0], cross, (slopes * cross).sum(axis=1) + noise[:, 0])


def _with_loss(moments: Moments, loss: float, informed: float) -> tuple[float, float]:
    """Mean and variance of a standard normal reading that did not arrive.

    It was lost, or its member has the shared estimate, with the probability `informed`, and was silent.
    """
    chance, mean, variance = moments
    told = (1.0 - loss) * informed * chance
    total = loss + told
    first = told * mean / total
    return first, (loss + told * (variance + mean**2)) / total - first**2


def _reading_of_sender(member: Member, head: int, bits: int) -> Parcel | None:
    """The reading of a member that does not stay silent; the head's own costs nothing."""
    if member.id != head and member.memory.get("silent", False):
        return None
    return reading_parcel(member, bits)


def _evidence(reply: Any, scene: Scene) -> Evidence:
    """The readings that arrived, in the order of the scene's members."""
    rows = [row for row, node in enumerate(scene.ids) if node in reply]
    values = np.array([reply[scene.ids[row]][0] for row in rows], dtype=np.float64)
    return Evidence(tuple([scene.ids[row] for row in rows]), values, scene.positions[rows], scene.traits[rows])


def _uniform(member: Member) -> float:
    """The member's number from 0 to 1 of this step."""
    return float(uniforms(np.array([derive(member.key, DRAW)], np.uint64), 0)[0])


def _cdf(x: float) -> float:
    """The distribution function of the standard normal."""
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def _density(x: float) -> float:
    """The density of the standard normal."""
    return math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
