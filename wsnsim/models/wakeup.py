"""Wake-up protocols: which nodes ahead of a target a message wakes. Pure rules, which the network performs.

    compose(plan, belief) -> WakeUpMessage      decide(place, message, seen, now, chance) -> Decision

Positions in m, times in s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.sleeping import Decision, Point, WakeUpMessage, WakeUpPlan, WakeUpRadio
from wsnsim.models.bounds import FAILURE, LENGTH, LEVEL, PERIOD, PROBABILITY, SECONDS, SPAN, SPEED

SEQUENCES: Final = 256
"""Sequence numbers have one byte."""
HEADER_BITS: Final = 104
"""Sequence 1, sender 2, target 2, predicted position 4, expiry 4 bytes (Li 2012, figure 1, without past positions)."""
INVITATION_BITS: Final = 136
"""17 bytes: the header and the last fix (our choice)."""
CONE: Final = math.cos(math.radians(60.0))
"""A node is ahead if its direction is within 60° of the heading: the cosine of that angle."""
EXPERIENCE: Final = {"low": (0.6, 0.3, 0.4, 0.1), "mid": (0.9, 0.5, 0.7, 0.2), "high": (1.0, 0.8, 0.9, 0.5)}
"""Probabilities to track: inside r and ahead, inside r and not ahead, beyond r and ahead, beyond r and not ahead."""
MOST_STEPS: Final = 128
"""Steps for which a message may be valid (our choice): half of the sequence numbers."""


@part
class NoWakeUp:
    """No node is woken ahead of the target: event-driven nodes need no warning (Jiang, Song, Lin 2013)."""

    mechanism: ClassVar[str] = "none"
    carries_belief: ClassVar[bool] = False
    wait: ClassVar[float] = 0.0
    call: ClassVar[float] = 0.0

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """Never called."""
        raise NotImplementedError("no node is woken")

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """Nothing."""
        return Decision.STOP


@part
class _Wakes:
    """What all wake-up protocols share that wake nodes: expiry, waiting time, and the wake-up radio.

    A call reaches a sleeping node if it arrives with the sensitivity of its wake-up receiver. It has the shadowing of
    the link between the two nodes (our choice). Where the link knows no powers (`disk`), calls reach its range. Sending
    and receiving a call cost the power of the main radio. The receiver of a sleeping node takes `standby`, unless
    sleeping costs nothing in the energy model.

    Source of the defaults: Schulthess, Cortesi, Magno (2025), "WakeMod: a 6.9 uW wake-up radio module with -72.6 dBm
    sensitivity for on-demand IoT" (868 MHz, arXiv:2505.21529). That module takes up to 54.3 ms from call to wake-up;
    `call` is our choice. 10 dBm and 9 dB are our choices, too: an output power that costs about as much
    as 0 dBm of the CC2420, and 20 log10(2450 MHz / 868 MHz), by which free space attenuates the lower band less.
    """

    expiry: Annotated[float, SECONDS, "how long after its step a message is valid"] = 1.0
    wait: Annotated[
        float, PERIOD, "T_wait: how long a woken node waits for the target before it follows its schedule again"
    ] = 3.0
    call: Annotated[float, SPAN, "duration of a call on the wake-up radio, at both ends"] = 5e-3
    sensitivity: Annotated[float, LEVEL, "received power from which a wake-up receiver hears a call"] = -72.6
    power: Annotated[float, LEVEL, "output power of a call"] = 10.0
    path_gain: Annotated[
        float, Quantity("dB", ge=-100.0, le=100.0), "how much less the path attenuates a call than a frame"
    ] = 9.0
    loss: Annotated[float, FAILURE, "probability that a call within reach is not heard"] = 0.0
    standby: Annotated[float, Quantity("W", ge=0.0, le=1.0), "power of the wake-up receiver of a sleeping node"] = (
        6.9e-6
    )

    @property
    def radio(self) -> WakeUpRadio:
        """The wake-up radio."""
        return WakeUpRadio(self.sensitivity, self.power, self.path_gain, self.loss, self.standby)

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if messages are valid for so long that their sequence number is used again."""
        if self.expiry >= MOST_STEPS * setup.dt:
            yield Issue(
                ("wakeup", "expiry"),
                f"{self.expiry:g} s are too many steps of {setup.dt:g} s: a sequence number of one byte would be used "
                f"again; less than {MOST_STEPS * setup.dt:g} s is allowed",
            )

    def _message(self, plan: WakeUpPlan, belief: Any, radius: float, bits: int) -> WakeUpMessage:
        return WakeUpMessage(
            target=plan.target,
            step=plan.step,
            sequence=plan.sequence % SEQUENCES,
            sender=plan.sender,
            place=plan.place,
            centre=plan.prediction if plan.foreseen else plan.fix,
            radius=radius,
            fix=plan.fix,
            heading=plan.heading,
            due=plan.due,
            expires=plan.due + self.expiry,
            sensing=plan.sensing,
            reach=plan.reach,
            bits=bits,
            belief=belief,
        )


@part
class _WakesRegion(_Wakes):
    """What wake-up protocols share that wake a disc around the predicted position."""

    radius: Annotated[
        float | None, LENGTH, "radius of the region around the predicted position; left out: the sensing range"
    ] = None
    speed: Annotated[float, SPEED, "v_max: greatest speed of the target, used as long as there is no prediction"] = 8.0

    def _region(self, plan: WakeUpPlan) -> float:
        """The radius of the region: r around a prediction; min(R, r + v_max dt) around a last fix."""
        radius = plan.sensing if self.radius is None else self.radius
        return radius if plan.foreseen else min(plan.reach, radius + self.speed * plan.ahead)


@part
class DirectedFlood(_WakesRegion):
    """A message that nodes forward towards the predicted position and that wakes the region around it.

    It carries the belief: 33 bytes with five positions (sequence 1, sender 2, target 2, positions 20, predicted
    position 4, expiry 4). A node that hears it ignores it if it has expired. It tracks if it is in the region, and
    calls its sleeping neighbours there. It forwards the message once if it is nearer to the prediction than the sender.

    Source: Li, Jiang, Zhang, Zhang (2012), section 2.2. Expiry, waiting time and v_max are our choice.
    """

    mechanism: ClassVar[str] = "flood"
    carries_belief: ClassVar[bool] = True

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """The message of figure 1: 13 bytes and the positions of the belief."""
        return self._message(plan, belief, self._region(plan), HEADER_BITS + plan.payload_bits)

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """The rule of figure 2: drop, track, forward or stop."""
        if now > message.expires:
            return Decision.DROP
        if seen:
            return Decision.STOP
        if _apart(place, message.centre) < message.radius:
            return Decision.TRACK
        nearer = _apart(place, message.centre) < _apart(message.place, message.centre)
        return Decision.FORWARD if nearer else Decision.STOP


@part
class Region(_WakesRegion):
    """An announcement to the region around the prediction, by the next head, which gets the belief first.

    A reconstruction of Yang, Xing, Shi, Pan (2007), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    mechanism: ClassVar[str] = "region"
    carries_belief: ClassVar[bool] = False

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """An announcement of 13 bytes; the belief is handed over separately."""
        return self._message(plan, None, self._region(plan), HEADER_BITS)

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """A node in the region tracks."""
        if now > message.expires:
            return Decision.DROP
        inside = not seen and _apart(place, message.centre) < message.radius
        return Decision.TRACK if inside else Decision.STOP


@part
class ExperienceZones(_Wakes):
    """After each fix the head calls every neighbour; each tracks with a probability that depends on its zone.

    Zones are measured from the last fix: within the sensing range r or beyond it, and ahead (within 60° of the last
    displacement) or not. The first fix has no displacement, so no node is ahead. Every node that hears the head is
    invited, however far the fix is (our choices). `levels` names one of three sets of probabilities; `probabilities`
    gives others. No set is right: the set decides which of the compared methods comes first.

    A reconstruction of Ren, Li, Gao, Cheng (2009), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    mechanism: ClassVar[str] = "invite"
    carries_belief: ClassVar[bool] = False

    levels: Annotated[Literal["low", "mid", "high"], "how readily nodes track"] = "mid"
    probabilities: Annotated[
        tuple[float, float, float, float] | None,
        PROBABILITY,
        "probabilities to track: inside r and ahead, inside r and not ahead, beyond r and ahead, beyond r and not "
        "ahead; left out: those of `levels`",
    ] = None

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """An invitation of 17 bytes."""
        return self._message(plan, None, plan.reach, INVITATION_BITS)

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """Track with the probability of the zone."""
        if now > message.expires:
            return Decision.DROP
        return Decision.TRACK if not seen and chance < self.probability(place, message) else Decision.STOP

    def probability(self, place: Point, message: WakeUpMessage) -> float:
        """The probability that an invited node at `place` tracks."""
        inside_ahead, inside, beyond_ahead, beyond = self.probabilities or EXPERIENCE[self.levels]
        x, y = place[0] - message.fix[0], place[1] - message.fix[1]
        distance, pace = math.hypot(x, y), math.hypot(*message.heading)
        ahead = pace > 0.0 and x * message.heading[0] + y * message.heading[1] >= CONE * distance * pace
        if distance <= message.sensing:
            return inside_ahead if ahead else inside
        return beyond_ahead if ahead else beyond

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if no node would ever track, or if messages are valid for too long."""
        yield from super().check(setup)
        if self.probabilities is not None and not any(self.probabilities):
            yield Issue(
                ("wakeup", "probabilities"), "all are 0: no node would ever track; at least one must be positive"
            )


def _apart(a: Point, b: Point) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
