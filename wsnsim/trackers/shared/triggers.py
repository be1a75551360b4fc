"""Triggers: whether a member sends its reading.

    heard = yield from trigger.gather(belief, scene)            instead of `gather_readings`

The head may broadcast its prediction, which is paid for, and members keep it as a shared estimate and decide by it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Annotated, Any, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats, components_of, is_relative, near
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Compute, Flow, Gather, Local, Member, Parcel
from wsnsim.base.rng import derive, uniforms
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.gains import gain_prior
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.readings import (
    gather_readings,
    is_whole,
    moment_packets,
    packet_bits,
    parcel,
    reading_parcel,
    replied,
)
from wsnsim.trackers.shared.silence import LEAST_CHANCE, ExpectedReadings, HeardReadings, SharedEstimate, SilenceMoments

SHARED: Final = "shared_estimate"
DRAW: Final = 11
"""Makes the key of a member's decision to send another than those of its other draws."""
FAR: Final = 38.0
"""Standard deviations beyond which the density of a normal is 0 in floating-point numbers."""
DECISION_CYCLES: Final = 60.0
"""CPU cycles to compare a reading with its limits, or to compute the moments of one silence."""


@part
class Always:
    """Every member sends its reading at each step."""

    def gather(self, belief: Any, scene: Scene) -> Flow[HeardReadings]:
        """The readings that reach the head."""
        return HeardReadings((yield from gather_readings(scene, belief=belief)))


@part
class ChosenMembers(Always):
    """Base of triggers by which each member decides by itself, without anything from the head."""

    def sends(self, member: Member, step: int) -> bool:
        """Whether a member sends its reading."""
        raise NotImplementedError

    def gather(self, belief: Any, scene: Scene) -> Flow[HeardReadings]:
        """The readings that reach the head."""
        bits, step = packet_bits(scene.sensor), scene.step

        def parcel_of(member: Member) -> Parcel | None:
            return reading_parcel(member, bits) if self.sends(member, step) else None

        return HeardReadings(replied((yield Gather(parcel_of)), scene))


@part
class PeriodicSending(ChosenMembers):
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

    silence: Annotated[Literal["used", "ignored"], "whether the head updates with the silence of members"] = "used"
    loss: Annotated[
        float,
        Quantity("", ge=0, lt=1),
        "p: probability with which a packet that is sent does not arrive, for any cause",
    ] = 0.0
    shared_every: Annotated[
        int, Quantity("", ge=1, le=1000), "steps from one broadcast of the estimate to the next"
    ] = 1

    def widths(self, expected: ExpectedReadings) -> Floats:
        """(S,) how far readings may be from what is expected, in their unit."""
        raise NotImplementedError

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether a member is silent whose reading is so far from what is expected."""
        raise NotImplementedError

    def silence_of(self, centre: float, width: float) -> SilenceMoments:
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

    def gather(self, belief: Any, scene: Scene) -> Flow[HeardReadings]:
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
        seen = replied(reply, scene)
        silent = [row for row, node in enumerate(scene.ids) if node in others and node not in reply]
        if self.silence == "ignored" or not silent:
            return HeardReadings(seen, shared)
        yield Compute(len(silent) * DECISION_CYCLES)
        return HeardReadings(seen, shared, tuple(silent), self)

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
                sent = each.payload
                member.memory[SHARED] = SharedEstimate(sent.mean.copy(), sent.cov.copy(), sent.step)
        shared: SharedEstimate | None = member.memory.get(SHARED)
        silent = False
        if shared is not None and scene.step - shared.step < self.shared_every and member.reading is not None:
            expected = shared.expects(scene, member.position[None], member.traits[None])
            value = near(scene.sensor, np.array([member.reading], dtype=np.float64), expected.values)
            apart = abs(float(value[0] - expected.values[0]))
            silent = self.is_silent(apart, float(self.widths(expected)[0]), member)
        member.memory["silent"] = silent


@part
class Event(EstimateTrigger):
    """A member sends if its reading would move the shared estimate of the position by more than a threshold.

    It is silent if |z - ẑ| ‖K‖ is at most the threshold, with the rows of the Kalman gain K of the position. What
    remains of a reading that was not sent is a truncated normal.

    Source: Wu, Jia, Johansson, Shi (2013) for the innovation that is silent in an interval, as a truncated normal.
    """

    threshold: Annotated[float, Quantity("m", gt=0), "shift of the estimated position above which a member sends"] = 1.0

    def widths(self, expected: ExpectedReadings) -> Floats:
        """(S,) half the length of the interval of readings that are not sent."""
        gains = expected.cross / expected.variances[:, None]
        widths: Floats = self.threshold / np.maximum(np.sqrt((gains**2).sum(axis=1)), 1e-300)
        return widths

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether the reading is in the interval."""
        return apart <= width

    def silence_of(self, centre: float, width: float) -> SilenceMoments:
        """A standard normal, truncated to the interval."""
        low, high = max(centre - width, -FAR), min(centre + width, FAR)
        chance = _cdf(high) - _cdf(low) if low <= 0.0 else _cdf(-low) - _cdf(-high)
        if chance < LEAST_CHANCE:
            return SilenceMoments(0.0, 0.0, 1.0)
        mean = (_density(low) - _density(high)) / chance
        square = 1.0 + (low * _density(low) - high * _density(high)) / chance
        return SilenceMoments(chance, mean, max(square - mean**2, 0.0))


@part
class Stochastic(EstimateTrigger):
    """A member is silent with the probability exp(-(z - ẑ)² / (2 w²)), with which the posterior stays Gaussian.

    Source: Han, Mo, Wu, Weerakkody, Sinopoli, Shi (2015), with the closed loop; Xu, Mo, Xie (2018) for loss.
    """

    width: Annotated[float, Quantity("", gt=0), "w, in standard deviations of the expected reading"] = 1.0

    def widths(self, expected: ExpectedReadings) -> Floats:
        """(S,) w in the unit of the readings."""
        return self.width * np.sqrt(expected.variances)

    def is_silent(self, apart: float, width: float, member: Member) -> bool:
        """Whether the member's draw says so."""
        return _uniform(member) < math.exp(-0.5 * (apart / width) ** 2)

    def silence_of(self, centre: float, width: float) -> SilenceMoments:
        """A standard normal times the probability of silence."""
        total = 1.0 + width**2
        chance = width / math.sqrt(total) * math.exp(-0.5 * centre**2 / total)
        return SilenceMoments(chance, centre / total, width**2 / total)


def issues_of(component: Any, setup: TrackingSetup) -> Iterable[Issue]:
    """What a component within another has against a scenario: nothing, if it has no `check`.

    Args:
        component: The component.
        setup: The scenario.
    """
    check = getattr(component, "check", None)
    return () if check is None else check(setup)


def trigger_issues(tracker: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """What speaks against the trigger of a tracker: itself, late readings, or thresholds that each member is sent.

    Args:
        tracker: A tracker with `trigger` and `late`.
        setup: The scenario.
    """
    if tracker.late != "ignore" and tracker.trigger != Always():
        yield Issue(
            ("tracker", "late"), "a head that uses late readings needs all members to send: use trigger: always"
        )
    if getattr(setup.filter_sensor, "adapts", False) and tracker.trigger != Always():
        yield Issue(("tracker", "trigger"), "thresholds about a prediction are sent to all members: use always")
    yield from issues_of(tracker.trigger, setup)


def _reading_of_sender(member: Member, head: int, bits: int) -> Parcel | None:
    """The reading of a member that does not stay silent; the head's own costs nothing."""
    if member.id != head and member.memory.get("silent", False):
        return None
    return reading_parcel(member, bits)


def _uniform(member: Member) -> float:
    """The member's number from 0 to 1 of this step."""
    return float(uniforms(np.array([derive(member.key, DRAW)], np.uint64), 0)[0])


def _cdf(x: float) -> float:
    """The distribution function of the standard normal."""
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def _density(x: float) -> float:
    """The density of the standard normal."""
    return math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
