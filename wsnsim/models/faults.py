"""What goes wrong, when, for how long, and whom it hits. The network room makes it happen.

    mechanism    at (s), duration (s, None: for good)    exactly one of nodes, fraction, region, head

Not to be confused with `base.errors.Issue`, a finding of the validation. Paths of those name the role and the
field, ("faults", "region"); which of the list it is, the scenario room puts between.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, inf, isinf
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Field
from wsnsim.base.setups import BeaconSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models.bounds import MOST_NODES, PLACE

TIME: Final = Quantity("s", ge=0.0, le=1e9)
SELECTORS: Final = ("nodes", "fraction", "region", "head")


@part
class Aimed:
    """What all of them share: when, for how long, and whom: ids, a share of all, a region, or the head of a track."""

    at: Annotated[float, TIME, "when it happens"]
    duration: Annotated[float | None, TIME, "how long it lasts; left out: for good"] = None
    nodes: Annotated[tuple[int, ...] | None, Quantity("", ge=0, lt=MOST_NODES), "whom it hits: their numbers"] = None
    fraction: Annotated[
        float | None, Quantity("", gt=0.0, le=1.0), "whom it hits: a share of all nodes, drawn at random"
    ] = None
    region: Annotated[
        tuple[float, float, float] | None, PLACE, "whom it hits: all within a circle; x, y and radius"
    ] = None
    head: Annotated[
        int | None, Quantity("", ge=0, le=10_000), "whom it hits: who leads this target's cluster at that instant"
    ] = None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A time after the run's end; aim at nothing, at several things, or at what is not there."""
        if self.at > setup.steps * setup.dt:
            yield _fault("at", f"{self.at:g} s is after the end of the run at {setup.steps * setup.dt:g} s")
        aims = [name for name in SELECTORS if getattr(self, name) is not None]
        if len(aims) != 1:
            given = f"aimed by {' and '.join(aims)} at once" if aims else "aimed at nothing"
            yield Issue(("faults",), f"is {given}: give exactly one of {', '.join(SELECTORS)}")
        count = getattr(setup.deploy, "nodes", None)
        if self.fraction is not None and count is not None and round(self.fraction * count) == 0:
            yield _fault("fraction", f"{self.fraction:g} of {count} nodes is nobody")
        yield from self._unknown_nodes(setup)
        yield from self._unknown_region(setup.deploy.field)
        yield from self._unknown_head(setup)

    def _unknown_nodes(self, setup: Setup) -> Iterator[Issue]:
        if self.nodes is None:
            return
        if not self.nodes:
            yield _fault("nodes", "names no node: give at least one, such as [0]")
        number = _number_of_nodes(setup)
        beyond = [node for node in self.nodes if number is not None and node >= number]
        if beyond:
            yield _fault("nodes", f"there is no node {beyond[0]}: the {number} nodes are numbered from 0")

    def _unknown_region(self, field: Field) -> Iterator[Issue]:
        if self.region is None:
            return
        x, y, radius = self.region
        if radius <= 0.0:
            yield _fault("region", f"has a radius of {radius:g} m: it must be greater than 0 (x, y, radius)")
            return
        outside = abs(x - field.centre[0]) - field.width / 2, abs(y - field.centre[1]) - field.height / 2
        if hypot(max(outside[0], 0.0), max(outside[1], 0.0)) > radius:
            yield _fault(
                "region",
                f"the circle of {radius:g} m around ({x:g}, {y:g}) does not touch the field of {field.width:g} m by "
                f"{field.height:g} m around ({field.centre[0]:g}, {field.centre[1]:g})",
            )

    def _unknown_head(self, setup: Setup) -> Iterator[Issue]:
        if self.head is None:
            return
        if isinstance(setup, BeaconSetup):
            yield _fault("head", "nobody leads in a network without a target")
        elif isinstance(setup, TrackingSetup) and self.head >= len(setup.motions):
            number = len(setup.motions)
            yield _fault("head", f"there is no target {self.head}: the targets are numbered from 0 to {number - 1}")


@part
class Crash(Aimed):
    """A node falls silent and loses what it knew; after the duration it comes back, dormant, with its charge."""

    mechanism: ClassVar[str] = "crash"


@part
class Restart(Aimed):
    """A node starts anew: what it knew is lost, and it is back after the duration, by default at once."""

    mechanism: ClassVar[str] = "restart"

    duration: Annotated[float | None, TIME, "how long starting takes"] = 0.0

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What all of them share, and a start that never ends."""
        yield from Aimed.check(self, setup)
        if self.duration is None:
            yield _fault("duration", "a restart ends: say after how long (a crash without a duration is for good)")


@part
class Drain(Aimed):
    """A node loses charge at once, as through a leak: so many joules, or a share of what it still has."""

    mechanism: ClassVar[str] = "drain"

    joules: Annotated[float | None, Quantity("J", gt=0.0, lt=inf), "charge lost"] = None
    share: Annotated[float | None, Quantity("", gt=0.0, le=1.0), "charge lost, as a share of what is left"] = None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What all of them share; an amount that is not said, or is without limit; a duration."""
        yield from Aimed.check(self, setup)
        if (self.joules is None) == (self.share is None):
            yield Issue(("faults",), "a drain takes either joules or a share: give exactly one of them")
        if self.duration is not None:
            yield _fault("duration", "a drain happens at once and is not undone: leave the duration out")
        if self.share is not None and isinstance(setup, RadioSetup) and isinf(setup.energy.battery):
            yield _fault("share", "there is no share of a battery without limit (energy.battery = .inf): give joules")


@part
class Blackout(Aimed):
    """A node's radio is jammed: it neither hears nor is heard. It senses and computes as before."""

    mechanism: ClassVar[str] = "blackout"


@part
class LinkLoss(Aimed):
    """Frames from and to a node are lost with this probability, besides what the link loses."""

    mechanism: ClassVar[str] = "link_loss"

    loss: Annotated[float, Quantity("", gt=0.0, le=1.0), "probability that a frame is lost"]


@part
class ClockStep(Aimed):
    """A node's clock jumps, and jumps back after the duration."""

    mechanism: ClassVar[str] = "clock_step"

    offset: Annotated[float, Quantity("s", ge=-1e6, le=1e6), "how far it jumps; positive: the clock is ahead"]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What all of them share, and a network that asks no clock for the time."""
        yield from Aimed.check(self, setup)
        if isinstance(setup, BeaconSetup):
            yield _fault("kind", "without a target nobody asks a clock for the time: a jump would change nothing")


@part
class OfReading(Aimed):
    """What those share that change a node's readings."""

    def check(self, setup: Setup) -> Iterator[Issue]:
        """What all of them share, and a network in which nothing is sensed."""
        yield from Aimed.check(self, setup)
        if isinstance(setup, BeaconSetup):
            yield _fault("kind", "there are no readings in a network without a target")


@part
class Stuck(OfReading):
    """A node's reading freezes: at a value, or at what it was when it froze."""

    mechanism: ClassVar[str] = "stuck"

    value: Annotated[
        float | None,
        Quantity("", ge=-1e18, le=1e18),
        "what it reads, in the reading's unit; left out: what it read last",
    ] = None


@part
class Bias(OfReading):
    """A node's readings are off by a constant."""

    mechanism: ClassVar[str] = "bias"

    offset: Annotated[float, Quantity("", ge=-1e18, le=1e18), "what is added, in the reading's unit"]


def _fault(key: str, message: str) -> Issue:
    return Issue(("faults", key), message)


def _number_of_nodes(setup: Setup) -> int | None:
    """How many nodes there are, if the deployment can tell before it is drawn."""
    places = getattr(setup.deploy, "places", None)
    return getattr(setup.deploy, "nodes", None) if places is None else len(places)
