"""The smallest parts that can stand behind each role, so that the scenario room is tested without the other rooms.

`base_scenario()` is a whole scenario of them; their kinds are dotted paths into this file.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from wsnsim import scenario
from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.base.part import Quantity, part


def kind(name: str) -> str:
    """The dotted path of a class of this file."""
    return f"{__name__}:{name}"


class _Port:
    """Has every member that a port names; the scenario package calls none but `assumed`."""

    columns = ("px", "vx", "py", "vy")
    units = position = field = audible = perfect = captures = poll = detection_bits = answer_bits = None
    missed = false_alarm = threshold = None
    protocol = "standing"
    mechanism = "tracking"
    cycles_per_flop = point = bits = every = weight = rest = carries_belief = wait = call = None
    battery = duration = fraction = region = head = None

    def assumed(self, *beliefs: Any) -> Any:
        return (self, *beliefs)

    def _nothing(self, *arguments: Any) -> None:
        raise AssertionError("the scenario package should not call this")

    draw = truth = propagate = advance = matrices = log_transition = _nothing
    draw_traits = measure = log_likelihood = linearise = transmit = receive = compute = sense = _nothing
    powers = reception = senses = packets = seconds = rates = distort = _nothing
    estimate = elect = must_hand_over = successor = start = step = hand_over = forecast = _nothing
    awake = state = tally = profile = compose = decide = _nothing


@part
class Prior(_Port):
    """A prior."""

    sd: Annotated[tuple[float, ...], Quantity(gt=0), "standard deviations"] = (5.0, 3.0, 5.0, 3.0)


@part
class Deploy(_Port):
    """A deployment that finds fault with too few nodes."""

    nodes: Annotated[int, Quantity("", ge=1), "number of nodes"]
    width: Annotated[float, Quantity("m", gt=0), "width of the field"] = 400.0
    height: Annotated[float, Quantity("m", gt=0), "height of the field"] = 400.0
    cover: bool = True
    path: str = ""

    def check(self, setup: Any) -> Iterator[Issue]:
        if self.nodes < 3:
            yield Issue(("deploy", "nodes"), f"{self.nodes} nodes cannot form a cluster")
        if self.nodes < 2:
            yield Issue(("clusters", "minimum_active"), "more members than nodes")


@part
class Motion(_Port):
    """A motion that refuses a bound of 13 m by itself."""

    start: Annotated[tuple[float, float, float, float], Quantity("m"), "start state"] = (0.0, 0.0, 0.0, 0.0)
    bound: Annotated[float, Quantity("m", gt=0), "distance from which it turns back"] = 180.0

    def __post_init__(self) -> None:
        if self.bound == 13:
            raise ValueError("13 m brings bad luck")


@part
class ShyMotion(Motion):
    """A motion that finds fault with other targets."""

    def check(self, setup: Any) -> Iterator[Issue]:
        if len(setup.motions) > 1:
            yield Issue(("motion", "start"), "does not like company")


@part
class FlatMotion(_Port):
    """A motion with other state columns."""

    columns = ("x",)


@part
class Sensor(_Port):
    """A sensor."""

    reach: Annotated[float, Quantity("m", gt=0), "sensing range"] = 60.0
    decay: Annotated[float, Quantity("", gt=0, le=6), "path loss exponent"] = 2.2
    samples: Annotated[int, Quantity("", ge=1), "samples"] = 1000

    trait_names = ("gain",)


@part
class Energy(_Port):
    """An energy model."""

    electronics: Annotated[float, Quantity("J/bit", ge=0), "per bit"] = 50e-9
    amplifier: Annotated[float, Quantity("J/bit/m2", ge=0), "per bit and m2"] = 100e-12
    battery: Annotated[float, Quantity("J", gt=0), "charge"] = 2.0


@part
class Sheet:
    """A datasheet with lists of one length, that refuses others, and a value that may be left out."""

    name: Annotated[str, "of the radio"]
    rate: Annotated[float, Quantity("bit/s", gt=0), "of the air"]
    sleep: Annotated[float, Quantity("W", ge=0), "while it is off"]
    levels: Annotated[tuple[float, ...], Quantity("dBm"), "output powers"] = (0.0,)
    transmit: Annotated[tuple[float, ...], Quantity("W", ge=0), "at each of them"] = (0.05,)
    extra: Annotated[float | None, Quantity("J", ge=0), "of something"] = None

    def __post_init__(self) -> None:
        if len(self.levels) != len(self.transmit):
            raise ValueError("one power a level")


@part
class Sheets(_Port):
    """An energy model that rests on one datasheet, on another if it is given, and on a third by default."""

    radio: Annotated[Sheet, "of the radio"]
    spare: Annotated[Sheet | None, "of another"] = None
    beacon: Sheet = Sheet(name="B", rate=1.0, sleep=0.5)

    def check(self, setup: Any) -> Iterator[Issue]:
        if self.radio.sleep > 1:
            yield Issue(("energy", "radio", "sleep"), "sleeps badly")


@part
class Beaconing(_Port):
    """A workload without a target."""

    mechanism: ClassVar[str] = "beacons"


@part
class Trouble(_Port):
    """A fault that is never right after 3 s, nor with a file that is called bad."""

    at: Annotated[float, Quantity("s", ge=0), "when it happens"]
    nodes: tuple[int, ...] | None = None
    path: str = ""

    def __post_init__(self) -> None:
        if self.at == 13:
            raise ValueError("13 s brings bad luck")

    def check(self, setup: Any) -> Iterator[Issue]:
        if self.at > 3:
            yield Issue(("faults", "at"), f"{self.at:g} s is too late for {type(setup).__name__}")
        if self.nodes == ():
            yield Issue(("faults",), "is aimed at nothing")
        if self.nodes == (7,):
            yield Issue(("deploy", "nodes"), "there is no node 7")


@part
class NamelessMac:
    """A MAC that does not name its mechanism."""


@part
class OwnMac:
    """A MAC with a mechanism of its own, and no way to start it."""

    mechanism: ClassVar[str] = "csmaa"


@part
class BorrowingMac:
    """A MAC with a built-in mechanism."""

    mechanism: ClassVar[str] = "ideal"


@part
class Link(_Port):
    """A link."""

    reach: Annotated[float, Quantity("m", gt=0), "nominal range of a link"]
    loss: Annotated[float, Quantity("", ge=0, lt=1), "probability per packet"] = 0.0
    power: Annotated[float | None, Quantity("W", gt=0), "transmit power"] = None


@part
class Plain(_Port):
    """Stands behind roles without parameters."""


@part
class Clusters(_Port):
    """A cluster policy."""

    minimum_active: Annotated[int, Quantity("", ge=1), "members that must sense"] = 3


@part
class Tracker(_Port):
    """A tracker."""

    particles: Annotated[int, Quantity("", ge=1), "particles"] = 400
    measurements: Annotated[Literal["own", "all"], "whose readings a member weighs with"] = "own"
    copy: bool = False


@part
class GainTracker(_Port):
    """A tracker with a field of its own that is called like a short form."""

    gains: Annotated[float, Quantity("", gt=0), "not the filter's belief"] = 3.0


class NoPart(_Port):
    """Lacks the decorator."""


@part
class NoTracker:
    """Lacks a tracker's methods."""


@part
class OddField(_Port):
    """Has a field that no scenario can write."""

    numbers: dict[str, float] | None = None


_BASE = {
    "name": "small",
    "seed": 1,
    "duration": 4.0,
    "prior": {"kind": kind("Prior")},
    "deploy": {"kind": kind("Deploy"), "nodes": 16},
    "motion": {"kind": kind("Motion")},
    "sensor": {"kind": kind("Sensor")},
    "energy": {"kind": kind("Energy")},
    "link": {"kind": kind("Link"), "reach": 75.0},
    "mac": {"kind": kind("Plain")},
    "packing": {"kind": kind("Plain")},
    "cpu": {"kind": kind("Plain")},
    "clock": {"kind": kind("Plain")},
    "detection": {"kind": kind("Plain")},
    "sink": {"kind": kind("Plain")},
    "workload": {"kind": kind("Plain")},
    "routing": {"kind": kind("Plain")},
    "sleep": {"kind": kind("Plain")},
    "wakeup": {"kind": kind("Plain")},
    "clusters": {"kind": kind("Clusters")},
    "acquire": {"kind": kind("Plain")},
    "tracker": {"kind": kind("Tracker")},
}


def base_scenario(**changes: Any) -> dict[str, Any]:
    """A scenario of stand-ins, with top-level keys changed (None removes one)."""
    scenario = copy.deepcopy(_BASE) | changes
    return {key: value for key, value in scenario.items() if value is not None}


def beacon_scenario(**changes: Any) -> dict[str, Any]:
    """A scenario of stand-ins without a target, with top-level keys changed (None removes one)."""
    roles = ("prior", "motion", "sensor", "wakeup", "clusters", "acquire", "detection", "sink", "tracker")
    gone: dict[str, Any] = dict.fromkeys(roles)
    return base_scenario(**gone | {"workload": {"kind": kind("Beaconing")}} | changes)


def faults_of(source: Any, *overrides: str) -> list[str]:
    """Every fault that loading and building a scenario finds, as text without the excerpts."""
    try:
        scenario.build(scenario.load(source, overrides))
    except ScenarioError as error:
        return [str(fault).partition("\n")[0] for fault in error.issues]
    return []
