"""Fault components: what fails, when, for how long, and which nodes it hits. `network.faults` makes it happen.

    mechanism    at (s), duration (s, None: until the end)    exactly one of nodes, fraction, region, head

An injected fault is not an `Issue`, which is a finding of validation. The paths of issues name the list and the field,
("faults", "region"); the scenario package inserts the place in the list.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, inf, isinf
from typing import Annotated, ClassVar, Final

from wsnsim.base.arrays import components_of
from wsnsim.base.errors import Issue, did_you_mean
from wsnsim.base.network_ports import Field
from wsnsim.base.part import Quantity, part
from wsnsim.base.radio import Mode
from wsnsim.base.setups import BeaconSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models.bounds import MOST_NODES, PLACE, READING, SHARE, number_of_nodes

TIME: Final = Quantity("s", ge=0.0, le=1e9)
COMPONENT: Final = "the component of readings that it concerns, such as bearing; left out: all"
TIMELESS: Final = ("ideal", "csma")
"""MACs for which clocks may show any time."""
ROUNDING: Final = 1e-12
"""Share of the duration of a run: a time that is before its end by less is at its end."""
SELECTORS: Final = ("nodes", "fraction", "region", "head")


@part
class Aimed:
    """The fields of every fault: its time, its duration, and the nodes it hits. Plug-in faults may inherit them.

    `standalone`: whether the fault changes or stops readings, and so acts on sensors without a network, too.
    """

    standalone: ClassVar[bool] = False

    at: Annotated[float, TIME, "when it begins"]
    duration: Annotated[float | None, TIME, "how long it lasts; left out: until the end of the run"] = None
    nodes: Annotated[tuple[int, ...] | None, Quantity("", ge=0, lt=MOST_NODES), "the nodes it hits, by number"] = None
    fraction: Annotated[float | None, SHARE, "the nodes it hits, as a share of all nodes, chosen at random"] = None
    region: Annotated[
        tuple[float, float, float] | None, PLACE, "the nodes it hits are those within a circle: x, y and radius"
    ] = None
    head: Annotated[
        int | None, Quantity("", ge=0, le=10_000), "the node it hits is the cluster head of this target at that time"
    ] = None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues for a time that is not in the run, and for nodes not given exactly once or not there."""
        if self.at >= setup.duration * (1.0 - ROUNDING):
            yield _fault("at", f"{self.at:g} s is not before the end of the run at {setup.duration:g} s")
        aims = [name for name in SELECTORS if getattr(self, name) is not None]
        if len(aims) != 1:
            given = f"nodes given by {' and '.join(aims)}" if aims else "no nodes given"
            yield Issue(("faults",), f"{given}: give exactly one of {', '.join(SELECTORS)}")
        count = getattr(setup.deploy, "nodes", None)
        if self.fraction is not None and count is not None and round(self.fraction * count) == 0:
            yield _fault("fraction", f"{self.fraction:g} of {count} nodes is less than one node")
        yield from self._unknown_nodes(setup)
        yield from self._unknown_region(setup.deploy.field)
        yield from self._unknown_head(setup)

    def _unknown_nodes(self, setup: Setup) -> Iterator[Issue]:
        if self.nodes is None:
            return
        if not self.nodes:
            yield _fault("nodes", "is empty: give at least one node, such as [0]")
        number = number_of_nodes(setup.deploy)
        beyond = [node for node in self.nodes if number is not None and node >= number]
        if beyond:
            yield _fault("nodes", f"no node {beyond[0]}: the {number} nodes are numbered from 0")

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
        if not isinstance(setup, RadioSetup):
            yield _fault("head", "no cluster head in a scenario without a network: give nodes, fraction or region")
        elif isinstance(setup, BeaconSetup):
            yield _fault("head", "no cluster head in a network without a target")
        elif isinstance(setup, TrackingSetup) and self.head >= len(setup.motions):
            number = len(setup.motions)
            yield _fault("head", f"no target {self.head}: the targets are numbered from 0 to {number - 1}")


@part
class Crash(Aimed):
    """A node goes down and loses its memory; after the duration it is up again, dormant, with its charge."""

    mechanism: ClassVar[str] = "crash"
    standalone: ClassVar[bool] = True


@part
class Restart(Aimed):
    """A node restarts and loses its memory; it is up again after the duration, by default at once."""

    mechanism: ClassVar[str] = "restart"
    standalone: ClassVar[bool] = True

    duration: Annotated[float | None, TIME, "how long the restart takes"] = 0.0

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of every fault, and one for a restart that does not end."""
        yield from Aimed.check(self, setup)
        if self.duration is None:
            yield _fault("duration", "a restart needs a duration (a crash without one lasts until the end)")


@part
class Drain(Aimed):
    """A node loses charge at once, as through a leak: an amount in joules, or a share of its residual energy."""

    mechanism: ClassVar[str] = "drain"

    joules: Annotated[float | None, Quantity("J", gt=0.0, lt=inf), "charge lost"] = None
    share: Annotated[float | None, SHARE, "charge lost, as a share of the residual energy"] = None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of every fault, and those of an amount that is missing or infinite, and of a duration."""
        yield from Aimed.check(self, setup)
        if (self.joules is None) == (self.share is None):
            yield Issue(("faults",), "give either joules or a share")
        if self.duration is not None:
            yield _fault("duration", "a drain happens at once and is not undone: leave out the duration")
        if isinstance(setup, RadioSetup) and setup.plain_batteries and self.share and isinf(setup.energy.battery):
            yield _fault("share", "an infinite battery (energy.battery = .inf) has no share: give joules")


@part
class Blackout(Aimed):
    """The radio of a node is jammed: it neither receives nor is received. The node senses and computes as before."""

    mechanism: ClassVar[str] = "blackout"


@part
class LinkLoss(Aimed):
    """Frames from and to a node are lost with a probability, in addition to the losses of the link."""

    mechanism: ClassVar[str] = "link_loss"

    loss: Annotated[float, SHARE, "probability that a frame is lost"]


@part
class ClockStep(Aimed):
    """The clock of a node jumps, and jumps back after the duration."""

    mechanism: ClassVar[str] = "clock_step"

    offset: Annotated[float, Quantity("s", ge=-1e6, le=1e6), "size of the jump; positive: the clock is then ahead"]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of every fault, and one for a network in which nothing depends on the time of a clock."""
        yield from Aimed.check(self, setup)
        timeless = isinstance(setup, BeaconSetup) and setup.mac.mechanism in TIMELESS and setup.sync.mechanism == "none"
        if timeless and isinstance(setup, BeaconSetup) and setup.sleep.rest is not Mode.SCHEDULED:
            yield _fault("kind", "has no effect in a network without a target: nothing depends on the time of a clock")


class _OfReadings(Aimed):
    """A fault of readings, or of one of their components."""

    component: str

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of every fault, and one for a network without readings, or without that component."""
        yield from Aimed.check(self, setup)
        if isinstance(setup, BeaconSetup):
            yield _fault("kind", "has no effect in a network without a target: it has no readings")
        yield from _wrong_component(self.component, setup, one_unit=getattr(self, "value", 0.0) is None)


@part
class Stuck(_OfReadings):
    """The readings of a node are stuck: at a value, or at its last reading."""

    mechanism: ClassVar[str] = "stuck"
    standalone: ClassVar[bool] = True

    value: Annotated[
        float | None, READING, "the stuck reading, in the unit of readings; left out: the last reading"
    ] = None
    component: Annotated[str, COMPONENT] = ""


@part
class Bias(_OfReadings):
    """A constant is added to the readings of a node."""

    mechanism: ClassVar[str] = "bias"
    standalone: ClassVar[bool] = True

    offset: Annotated[float, READING, "the constant, in the unit of readings"]
    component: Annotated[str, COMPONENT] = ""


def _wrong_component(component: str, setup: Setup, one_unit: bool) -> Iterator[Issue]:
    """Yield an issue for a component that readings lack, and for none where a number needs the unit of one.

    `one_unit`: whether all components may be meant at once, whatever their units.
    """
    if not isinstance(setup, TrackingSetup):
        return
    names = components_of(setup.sensor)
    if component and component not in names:
        yield _fault("component", f"unknown component '{component}' of a reading ({did_you_mean(component, names)})")
    elif not component and len(names) > 1 and not one_unit:
        yield _fault("component", f"readings have the components {', '.join(names)}: name the one that is meant")


def _fault(key: str, message: str) -> Issue:
    return Issue(("faults", key), message)
