"""What components of a scenario need of each other, where none is wrong by itself.

missing_abilities(scenario, setup) -> issues      impossible_combinations(setup) -> issues: one rule each, in one table

What a component can say about its own values is in its `check`. `docs/combinations.md` has the table for readers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from wsnsim.base.arrays import components_of, is_relative, periods_of
from wsnsim.base.detections import why_no_detections
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.medium_access import is_duty_cycled
from wsnsim.base.network_ports import Deployment
from wsnsim.base.radio import Mode
from wsnsim.base.sensing import HEIGHT, may_have_gains, samples_gains
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.scenario.registry import Plugins, loaded
from wsnsim.scenario.schema import Scenario

MOST_COMPONENTS: Final = 4
"""Components of a reading that fit into its packet, which holds four numbers."""


def missing_abilities(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue for each ability that the tracker needs, or assumes, and the sensor does not have."""
    sensor, tracker = scenario.sensor, scenario.tracker  # type: ignore[attr-defined]
    if getattr(setup.tracker, "headless", False) != (isinstance(setup, NetworkSetup) and setup.headless):
        yield _wrong_about_heads(scenario, setup)
        return
    if setup.unlabelled != getattr(setup.tracker, "multi_target", False):
        yield _wrong_number_of_targets(scenario, setup)
        return
    if setup.unlabelled:
        yield from _inner_filter(scenario)
        if why_no_detections(setup.sensor):
            return
    lacking = [
        one for one in getattr(setup.tracker, "needs", ()) if not callable(getattr(setup.filter_sensor, one, None))
    ]
    for ability in lacking:
        able = _able(scenario, "sensor", ability) or "none that is known"
        yield Issue(
            ("tracker", "kind"),
            f"{tracker.kind} needs a sensor that gives '{ability}', and {sensor.kind} does not; it can use: {able}",
        )
    if not lacking:
        yield from _readings_not_taken(scenario, setup)
    yield from _late_readings_not_used(scenario, setup)
    if tracker.assumes.gains != "known" and not may_have_gains(setup.sensor):
        yield Issue(("tracker", "assumes", "gains"), f"{sensor.kind} has no gains that could be unknown")
    elif tracker.assumes.gains == "estimated":
        yield from _cannot_estimate_gains(scenario, setup)
    elif tracker.assumes.gains == "known" and setup.recorded is not None and samples_gains(setup.sensor):
        keys = [key for key in ("gains", "biases") if hasattr(setup.sensor, key)]
        listed = f"list them (sensor.law.{keys[0]})" if keys else "set sensor.law.gain_spread: 0"
        message = f"the gains of nodes whose readings were recorded are not known: {listed}, or say unknown"
        yield Issue(("tracker", "assumes", "gains"), f"{message} or estimated")
    if HEIGHT in setup.sensor.trait_names and _lacks_heights(setup.deploy):
        able = "kind: file has them, in its column z"
        yield Issue(("deploy",), f"the sensor's law needs the heights of the nodes: {able}")


def _wrong_about_heads(scenario: Scenario, setup: TrackingSetup) -> Issue:
    """The issue of a tracker with a head for a network without one, or the other way round."""
    kind = scenario.tracker.kind  # type: ignore[attr-defined]
    if getattr(setup.tracker, "headless", False):
        message = f"{kind} runs on every participant of a network without a head: it needs clusters: {{kind: none}}"
        return Issue(("tracker", "kind"), message)
    able = _able(scenario, "tracker", "headless")
    return Issue(("tracker", "kind"), f"{kind} needs a cluster head, and clusters: none has none; these do not: {able}")


def _wrong_number_of_targets(scenario: Scenario, setup: TrackingSetup) -> Issue:
    """The issue of a tracker of one target for readings that name none, or the other way round."""
    kind, several = scenario.tracker.kind, _able(scenario, "tracker", "multi_target")  # type: ignore[attr-defined]
    if setup.unlabelled:
        message = f"{kind} follows one target, and detection: unlabelled does not say whose a reading is; these do: "
        return Issue(("tracker", "kind"), f"{message}{several}, each with {{filter: {{kind: {kind}}}}}")
    message = f"{kind} finds out whose detections are, and here each reading names its target: take the filter alone"
    return Issue(("tracker", "kind"), f"{message}, or detection: {{kind: unlabelled}}")


def _inner_filter(scenario: Scenario) -> Iterator[Issue]:
    """Yield an issue for assumptions that stand with the filter of a tracker, where nothing reads them."""
    inner: Any = getattr(scenario.tracker, "filter", None)  # type: ignore[attr-defined]
    # a resolved scenario has the defaults
    if hasattr(inner, "assumes") and inner.assumes != type(inner).model_fields["assumes"].default:
        yield Issue(("tracker", "filter", "assumes"), "what filters assume stands beside the filter: tracker.assumes")
    if getattr(inner, "late", "ignore") != "ignore":
        yield Issue(("tracker", "filter", "late"), "trackers of several targets use no late readings: use ignore")


def _late_readings_not_used(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue if no reading can be late, or the tracker cannot use those that are."""
    path, late, kind = ("tracker", "late"), getattr(setup.tracker, "late", "ignore"), scenario.tracker.kind  # type: ignore[attr-defined]
    if late == "ignore":
        return
    if not isinstance(setup, NetworkSetup):
        yield Issue(path, "without a network no reading is late: use ignore")
    if getattr(setup.filter_sensor, "adapts", False):
        yield Issue(
            path, "thresholds about a prediction are those of one step: use ignore, or thresholds that are fixed"
        )
    if late == "retrodict" and not getattr(setup.tracker, "retrodicts", False):
        able = _able(scenario, "tracker", "retrodicts")
        yield Issue(path, f"{kind} is not one Gaussian that readings update: use refilter, or one of these: {able}")
    elif late == "retrodict" and (is_relative(setup.filter_sensor) or getattr(setup.filter_sensor, "gain_prior", 0.0)):
        message = (
            "it corrects the state by single readings, without gains of sensors and without others to compare with"
        )
        yield Issue(path, f"{message}: use refilter")


def _readings_not_taken(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue for readings of several components, of angles, or in cells, that the scenario cannot do with."""
    sensor, tracker = scenario.sensor, scenario.tracker  # type: ignore[attr-defined]
    names = components_of(setup.filter_sensor)
    needed = [("vector_readings", "readings of several components")] if len(names) > 1 else []
    needed += [("angles", "angles, which are the same after a turn")] if any(periods_of(setup.filter_sensor)) else []
    if is_relative(setup.filter_sensor):
        needed.append(("relative_readings", "readings of which only the differences count"))
    if getattr(setup.filter_sensor, "adapts", False):
        needed.append(("tells_prediction", "thresholds about a prediction, which it would have to send"))
    for ability, what in needed:
        if not getattr(setup.tracker, ability, False):
            able = _able(scenario, "tracker", ability)
            message = f"{tracker.kind} does not take {what} ({sensor.kind}: {', '.join(names)}); these do: {able}"
            yield Issue(("tracker", "kind"), message)
            return
    if len(names) < 2:
        return
    if len(names) > MOST_COMPONENTS:
        message = f"a reading of {len(names)} components does not fit into its packet: at most {MOST_COMPONENTS} do"
        yield Issue(("sensor",), message)
    if setup.recorded is not None:
        message = f"a file has one number in a row, and a reading of this law has {len(names)}: {', '.join(names)}"
        yield Issue(("sensor", "law"), message)
    if getattr(setup.sensor, "shadowing", 0.0):
        yield Issue(("sensor", "shadowing"), "readings of several components cannot be shadowed")
    if isinstance(setup, NetworkSetup) and not hasattr(setup.sensor, "strength"):
        message = f"{sensor.kind} must rank its readings for elections (method strength): they have several components"
        yield Issue(("sensor", "kind"), message)


def _lacks_heights(deploy: Deployment) -> bool:
    """Whether a deployment knows no heights; one whose file cannot be read says so itself."""
    try:
        return getattr(deploy, "heights", None) is None
    except RunError:
        return False


def _cannot_estimate_gains(scenario: Scenario, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue if the tracker does not estimate gains, or the sensor's gains cannot be taken off a reading."""
    sensor, tracker = scenario.sensor, scenario.tracker  # type: ignore[attr-defined]
    path = ("tracker", "assumes", "gains")
    if not getattr(setup.tracker, "estimates_gains", False):
        able = _able(scenario, "tracker", "estimates_gains")
        yield Issue(path, f"{tracker.kind} keeps no gains of sensors beside the state; these do: {able}")
    if not hasattr(setup.filter_sensor, "gain_prior"):
        why = "are factors of the signal, which no filter estimates"
        if hasattr(setup.filter_sensor, "reading_bits"):
            why = "cannot be taken off a reading that names a cell, and no filter estimates them"
        able = _able(scenario, "sensor", "gain_prior")
        yield Issue(path, f"gains and biases of {sensor.kind} {why}; it can with sensor: {able}")


def _able(scenario: Scenario, role: str, ability: str) -> str:
    """Return the kinds with an ability that the scenario's text may name, for messages."""
    return ", ".join(kinds_with(role, ability, scenario.spot(("tracker", "kind")).origin.plugins))


def kinds_with(role: str, ability: str, allowed: Plugins = Plugins.NONE) -> Iterator[str]:
    """Yield the kinds of a role whose class has something of this name, and that the scenario might name."""
    return (info.kind for info, part in loaded(role, allowed > Plugins.NONE) if getattr(part, ability, None))


def impossible_combinations(setup: Setup) -> Iterator[Issue]:
    """Yield an issue for each rule that a scenario breaks."""
    if isinstance(setup, RadioSetup):
        for rule in RULES:
            yield from rule(setup)


def awake_between_wake_ups(setup: RadioSetup) -> Iterator[Issue]:
    """A sleep schedule whose nodes are awake for less than a wake interval: some sleep whenever their radio is due."""
    awake, interval = getattr(setup.sleep, "awake_part", None), setup.hop.unicast
    if awake is not None and is_duty_cycled(setup.mac) and awake < interval:
        yield Issue(
            ("sleep", "period"),
            f"nodes are awake for {awake:.3g} s at a time, and over mac: {setup.mac.mechanism} a node can be reached "
            f"once in {interval:.3g} s: some never could; give a longer period, or a shorter interval of the radio",
        )


def nothing_to_follow(setup: RadioSetup) -> Iterator[Issue]:
    """A short wake interval that no node would ever use, since nothing tells nodes of a target."""
    if getattr(setup.mac, "near", None) is None:
        return
    if not isinstance(setup, NetworkSetup):
        yield Issue(("mac", "near"), "without a target there is nothing that the wake interval could follow")
    elif setup.head_protocol == "open" and setup.wakeup.mechanism == "none":
        yield Issue(
            ("mac", "near"),
            "no node is told of a target: an open cluster announces nothing, and with wakeup: none there are no "
            "messages; leave mac.near out, or choose other clusters or a wakeup",
        )


def woken_too_late(setup: RadioSetup) -> Iterator[Issue]:
    """Wake-up messages that take longer than the step for which they wake nodes, where nobody is called instead."""
    if not isinstance(setup, NetworkSetup) or setup.wakeup.mechanism == "none" or setup.sleep.rest is Mode.SCHEDULED:
        return
    if setup.hop.broadcast >= setup.dt:
        yield Issue(
            ("wakeup", "kind"),
            f"a message takes {setup.hop.broadcast:.3g} s over mac: {setup.mac.mechanism}, and a step lasts "
            f"{setup.dt:g} s: no node would be woken in time, and none sleeps that could be called; give a longer "
            "step, a shorter interval of the radio, or wakeup: none",
        )


def sends_without_end(setup: RadioSetup) -> Iterator[Issue]:
    """A workload whose nodes send more often than one frame takes."""
    workload = getattr(setup, "workload", None)
    period = getattr(workload, "period", None)
    mechanism = getattr(workload, "mechanism", "")
    if mechanism not in ("beacons", "collection") or not isinstance(period, float) or not is_duty_cycled(setup.mac):
        return
    what, takes = ("broadcast", setup.hop.broadcast) if mechanism == "beacons" else ("unicast", setup.hop.unicast)
    if period <= takes:
        yield Issue(
            ("workload", "period"),
            f"{period:g} s is over before a {what} has ended, which takes {takes:.3g} s over mac: "
            f"{setup.mac.mechanism}: frames would queue without end",
        )


def clocks_corrected_twice(setup: RadioSetup) -> Iterator[Issue]:
    """A time synchronisation over a MAC that keeps the clocks together itself: each would undo what the other does."""
    if setup.sync.mechanism != "none" and setup.mac.mechanism == "tsch":
        yield Issue(("sync", "kind"), "mac: tsch keeps the clocks of nodes together itself: use none")


def drift_beyond_guard(setup: RadioSetup) -> Iterator[Issue]:
    """Clocks of which most pairs part by more than the guard of a slot within a step: members miss their slots."""
    guard = getattr(setup.mac, "guard", None)
    if not isinstance(setup, NetworkSetup) or setup.mac.mechanism != "tdma" or guard is None:
        return
    apart = 2.0**0.5 * float(getattr(setup.clock, "sd", 0.0)) * setup.dt
    if apart > guard:
        yield Issue(
            ("mac", "guard"),
            f"in a step of {setup.dt:g} s two clocks drift apart by {apart:.3g} s (standard deviation, by clock.sd), "
            f"more than {guard:g} s: members would miss their slots",
        )


RULES: Final[tuple[Callable[[RadioSetup], Iterator[Issue]], ...]] = (
    awake_between_wake_ups,
    nothing_to_follow,
    woken_too_late,
    sends_without_end,
    clocks_corrected_twice,
    drift_beyond_guard,
)
"""One function for each rule."""
