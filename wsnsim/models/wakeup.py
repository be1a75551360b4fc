"""How nodes ahead of the target are woken: pure rules, which the network performs.

    compose(plan, belief) -> Message      decide(place, message, seen, now, chance) -> Decision

Places in m, times in s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Final, Literal

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.sleeping import Decision, Point, WakeUpMessage, WakeUpPlan
from wsnsim.models.bounds import LENGTH

SEQUENCES: Final = 256
"""A sequence number is a byte."""
HEADER_BITS: Final = 104
"""Sequence 1, sender 2, target 2, predicted position 4, expiry 4 bytes (Li 2012, figure 1, without the positions)."""
INVITATION_BITS: Final = 136
"""17 bytes (our choice: the header, and the last fix)."""
CONE: Final = math.cos(math.radians(60.0))
"""Ahead is within so much of the heading."""
EXPERIENCE: Final = {"low": (0.6, 0.3, 0.4, 0.1), "mid": (0.9, 0.5, 0.7, 0.2), "high": (1.0, 0.8, 0.9, 0.5)}
"""Inside r and ahead, inside r and not ahead, beyond it and ahead, beyond it and not ahead."""
MOST_STEPS: Final = 128
"""Steps that a message may be heeded for (our choice): half of what numbers there are."""
SECONDS: Final = Quantity("s", ge=0.0, le=1e6)


@part
class NoWakeUp:
    """Nobody is woken ahead of the target: event-wake nodes need no warning (Jiang, Song, Lin 2013)."""

    mechanism: ClassVar[str] = "none"
    carries_belief: ClassVar[bool] = False
    wait: ClassVar[float] = 0.0
    call: ClassVar[float] = 0.0

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """Never asked for."""
        raise NotImplementedError("nobody is woken")

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """Nothing is done."""
        return Decision.STOP


@part
class _Wakes:
    """What all protocols share that wake nodes."""

    expiry: Annotated[float, SECONDS, "how long after the step's instant its message is heeded"] = 1.0
    wait: Annotated[
        float,
        Quantity("s", ge=1e-3, le=1e6),
        "T_wait: how long a woken node waits for the target before it falls back to its schedule",
    ] = 3.0
    call: Annotated[float, Quantity("s", ge=0.0, le=10.0), "of a call on the wake-up radio, at both ends"] = 5e-3

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Messages that are heeded for so long that their sequence number comes again."""
        if self.expiry >= MOST_STEPS * setup.dt:
            yield Issue(
                ("wakeup", "expiry"),
                f"{self.expiry:g} s are too many steps of {setup.dt:g} s: a sequence number of one byte would come "
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
    """What protocols share that wake a disc about the prediction."""

    radius: Annotated[float | None, LENGTH, "of the region about the prediction; left out: the sensors' reach"] = None
    speed: Annotated[
        float, Quantity("m/s", ge=0.0, le=1e6), "v_max: how fast the target may be, as long as it cannot be predicted"
    ] = 8.0

    def _region(self, plan: WakeUpPlan) -> float:
        """r about a prediction; min(R, r + v_max dt) about a last fix."""
        radius = plan.sensing if self.radius is None else self.radius
        return radius if plan.foreseen else min(plan.reach, radius + self.speed * plan.ahead)


@part
class DirectedFlood(_WakesRegion):
    """A message that is handed on towards the predicted position, and wakes the region about it. It carries the belief.

    33 bytes with five positions: sequence 1, sender 2, target 2, positions 20, predicted position 4, expiry 4. A node
    that hears it drops it if it has expired; tracks if it is in the region, and calls its sleeping neighbours there;
    forwards it, once, if it is nearer to the prediction than the sender; else stops.

    Source: Li, Jiang, Zhang, Zhang (2012), section 2.2; expiry, waiting time, and v_max as long as there is no
    prediction, are our choice.
    """

    mechanism: ClassVar[str] = "flood"
    carries_belief: ClassVar[bool] = True

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """The message of figure 1: 13 bytes, and the positions of the belief."""
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
    """The next main node is told first, and calls its neighbours in the region about the prediction.

    A reconstruction of Yang, Xing, Shi, Pan (2007), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    mechanism: ClassVar[str] = "region"
    carries_belief: ClassVar[bool] = False

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """An announcement of 13 bytes; the belief goes from head to head by itself."""
        return self._message(plan, None, self._region(plan), HEADER_BITS)

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """Whoever is in the region tracks."""
        if now > message.expires:
            return Decision.DROP
        inside = not seen and _apart(place, message.centre) < message.radius
        return Decision.TRACK if inside else Decision.STOP


@part
class ExperienceZones(_Wakes):
    """After each fix every neighbour is called, and tracks with a probability that depends on its zone.

    Zones are measured from the last fix: within the sensors' reach r or beyond it, and ahead, within 60° of the last
    displacement, or not. The first fix has no displacement: nobody is ahead then; and whoever hears the main node is
    invited, however far beyond r the fix is (our choices). `levels` are three sets of probabilities, or `probabilities`
    says others; there is no right one: any order of the rivals can be had from it.

    A reconstruction of Ren, Li, Gao, Cheng (2009), known here from one sentence in Li, Jiang, Zhang, Zhang (2012).
    """

    mechanism: ClassVar[str] = "invite"
    carries_belief: ClassVar[bool] = False

    levels: Annotated[Literal["low", "mid", "high"], "how readily nodes track"] = "mid"
    probabilities: Annotated[
        tuple[float, float, float, float] | None,
        Quantity("", ge=0.0, le=1.0),
        "inside r and ahead, inside r and not, beyond r and ahead, beyond r and not; left out: those of `levels`",
    ] = None

    def compose(self, plan: WakeUpPlan, belief: Any) -> WakeUpMessage:
        """An invitation of 17 bytes."""
        return self._message(plan, None, plan.reach, INVITATION_BITS)

    def decide(self, place: Point, message: WakeUpMessage, seen: bool, now: float, chance: float) -> Decision:
        """Track by chance, as often as the zone says."""
        if now > message.expires:
            return Decision.DROP
        return Decision.TRACK if not seen and chance < self.probability(place, message) else Decision.STOP

    def probability(self, place: Point, message: WakeUpMessage) -> float:
        """How likely a node tracks that has been invited."""
        inside_ahead, inside, beyond_ahead, beyond = self.probabilities or EXPERIENCE[self.levels]
        x, y = place[0] - message.fix[0], place[1] - message.fix[1]
        distance, pace = math.hypot(x, y), math.hypot(*message.heading)
        ahead = pace > 0.0 and x * message.heading[0] + y * message.heading[1] >= CONE * distance * pace
        if distance <= message.sensing:
            return inside_ahead if ahead else inside
        return beyond_ahead if ahead else beyond

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Probabilities that let nobody track, or an expiry that is too long."""
        yield from super().check(setup)
        if self.probabilities is not None and not any(self.probabilities):
            yield Issue(("wakeup", "probabilities"), "all are 0: nobody would ever track; at least one must be more")


def _apart(a: Point, b: Point) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
