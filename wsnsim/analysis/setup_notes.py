"""Rules of `notes.RULES` on values of a scenario that are valid but probably not intended, or have no effect.

Each rule yields a note for what it finds in a setup: the path of a value, what is wrong with it, with the figures, and
the nearest remedy.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, periods_of
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.errors import RunError, counted
from wsnsim.base.initial_conditions import present_at, sample_positions
from wsnsim.base.medium_access import CAP_SHARE, is_duty_cycled
from wsnsim.base.network_ports import FaultEvent, Field
from wsnsim.base.radio import Mode, continuous_power
from wsnsim.base.rng import Streams, derive, derive_all
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models.node_file import FromFile
from wsnsim.models.quantised import Quantised
from wsnsim.models.recorded_links import RecordedLinks
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.unit_checks import other_units, too_close
from wsnsim.network.faults import ROUNDING, places_hit

CROWD: Final = 20
"""Nodes that hear each other, for which beacons are thought to be too many [our choice]."""
SAMPLED: Final = 64
"""Nodes whose sleep schedules are looked at."""
Box = tuple[float, float, float, float]
"""xmin, xmax, ymin, ymax in m."""


def motions_beyond_the_field(setup: TrackingSetup) -> Iterator[str]:
    """Targets whose area reaches beyond the field by more than the sensing range: there no node can measure them."""
    field, reach = setup.deploy.field, setup.sensor.reach
    for i, motion in enumerate(setup.motions):
        found = _area(motion)
        if found is None:
            continue
        key, (left, right, bottom, top) = found
        monitored = _box(field)
        beyond = max(monitored[0] - left, right - monitored[1], monitored[2] - bottom, top - monitored[3])
        if beyond > reach:
            yield (
                f"{_of_target(setup, i)}.{key}: the target moves up to {beyond:g} m beyond {named(field)}, out of the "
                f"sensing range of {reach:g} m of every node; keep it within the field, or enlarge the field"
            )


def targets_that_never_exist(setup: TrackingSetup) -> Iterator[str]:
    """Targets whose intervals of presence hold no instant of the run."""
    times: Floats = np.arange(setup.steps + 1, dtype=np.float64) * setup.dt
    for i, intervals in enumerate(setup.presence):
        if intervals is not None and not present_at(times, intervals).any():
            yield (
                f"{_of_target(setup, i)}.presence: the target never exists at an instant of the run, every "
                f"{setup.dt:g} s up to {times[-1]:g} s"
            )


def steps_across_the_field(setup: TrackingSetup) -> Iterator[str]:
    """Targets that are so fast that one step takes them out of the field."""
    field = setup.deploy.field
    side = max(field.width, field.height) + 2.0 * setup.sensor.reach
    for i, motion in enumerate(setup.motions):
        speed = _greatest_speed(motion)
        if speed * setup.dt > side:
            digit = 10.0 ** math.floor(math.log10(side / speed))
            yield (
                f"{_of_target(setup, i)}: at {speed:g} m/s a target goes {speed * setup.dt:g} m in a step of "
                f"{setup.dt:g} s, across all of {named(field)} and out of the sensing range of every node; give a "
                f"step of at most {math.floor(side / speed / digit) * digit:g} s"
            )


def shadowing_that_filters_ignore(setup: TrackingSetup) -> Iterator[str]:
    """Recorded readings whose law has shadowing, which the filter takes for independent noise, or for none."""
    shadowing = getattr(setup.sensor, "shadowing", 0.0)
    if setup.recorded is not None and shadowing and not getattr(setup.filter_sensor, "inflate", False):
        yield (
            f"sensor.law.shadowing: the filter ignores the {shadowing:g} dB, and its covariances will be too small: "
            "give tracker.assumes.inflate: true"
        )


def gaussian_filter_of_cells(setup: TrackingSetup) -> Iterator[str]:
    """A Kalman filter on readings that take few values, whose likelihood is not Gaussian."""
    bits = getattr(setup.filter_sensor, "reading_bits", None)
    if bits is not None and getattr(setup.tracker, "assumes_gaussian", False):
        yield (
            f"tracker: it takes a reading of {counted(bits, 'bit')} as Gaussian, with its mean and variance at the "
            "prediction; it is in a cell, and far from a threshold it hardly counts: pf and central_pf use the "
            "likelihood of the cell"
        )


def cells_beside_the_readings(setup: TrackingSetup) -> Iterator[str]:
    """Uniform cells that hold less than a tenth of the readings that the law expects between 0.1 m and its range."""
    sensor, field = setup.sensor, setup.deploy.field
    if not isinstance(sensor, Quantised) or sensor.adapts or any(periods_of(sensor)):
        return
    points = np.zeros((len(setup.motions[0].position), 2))
    points[0] = 0.1, min(sensor.law.reach, math.hypot(field.width, field.height))
    low, high = sorted(sensor.law.linearise(points, np.zeros((1, 2)), np.ones((1, len(sensor.trait_names))))[0][0])
    if min(high, sensor.high) - max(low, sensor.low) < 0.1 * (high - low):
        yield (
            f"sensor: cells from {sensor.low:g} to {sensor.high:g} hardly meet the readings of the law, "
            f"from {low:.3g} to {high:.3g} at 0.1 m to {points[0, 1]:.4g} m: give sensor.low and sensor.high"
        )


def places_in_another_unit(setup: TrackingSetup) -> Iterator[str]:
    """Nodes and trajectories of files that are so near to each other that they are in degrees or kilometres."""
    sensor = setup.sensor
    least = getattr(sensor, "least", getattr(sensor, "floor", 0.0))
    with contextlib.suppress(RunError):  # the check says so
        files = []
        if isinstance(setup.deploy, FromFile):
            files.append(
                ("deploy", "nodes", setup.deploy.path, setup.deploy.draw(0.0, np.random.default_rng(0)), least)
            )
        files += [(_of_target(setup, i), "track", motion.path, motion.track.points[:, :2], 0.0)
                  for i, motion in enumerate(setup.motions) if isinstance(motion, RecordedTrack)]  # fmt: skip
        for key, kind, path, points, nearest in files:
            if said := too_close(points, sensor.reach, nearest):
                yield f"{key}.path: {said}; {other_units(path, kind)}"


def sink_outside_the_field(setup: RadioSetup) -> Iterator[str]:
    """A sink whose point is farther outside the field than a frame reaches: the node nearest to it is at the edge."""
    field = setup.deploy.field
    left, right, bottom, top = _box(field)
    for x, y in setup.sink_points:
        away = math.hypot(max(left - x, x - right, 0.0), max(bottom - y, y - top, 0.0))
        if away > setup.link.reach:
            nearest = min(max(x, left), right), min(max(y, bottom), top)
            yield (
                f"sink: ({x:g}, {y:g}) m is {away:.4g} m outside {named(field)}; the sink is the node nearest to it, "
                f"at the edge: the nearest point of the field is ({nearest[0]:g}, {nearest[1]:g}) m"
            )


def sensitivity_beside_a_datasheet(setup: RadioSetup) -> Iterator[str]:
    """A fitted sensitivity of the link that is not that of the radio's datasheet."""
    own, stated = (getattr(part, "sensitivity", None) for part in (setup.link, getattr(setup.energy, "radio", None)))
    if own is not None and stated is not None and own != stated:
        yield f"link.sensitivity: {own:g} dBm counts, not the {stated:g} dBm of the radio's datasheet"


def links_that_are_left_out(setup: RadioSetup) -> Iterator[str]:
    """Rounds and bursts of recorded links that are not played."""
    if isinstance(setup.link, RecordedLinks):
        yield from (f"link.path: {said}" for said in setup.link.recording.left_out(setup.link.channel))


def longer_than_the_run(setup: Setup) -> Iterator[str]:
    """Periods of which the run does not see one whole."""
    lasts = setup.duration
    effects = {
        ("sleep", "period"): "no node changes more than twice",
        ("workload", "period"): "no node sends a second time, and some never",
        ("sink", "every"): "no report is sent",
    }
    for (role, key), effect in effects.items():
        value = getattr(getattr(setup, role, None), key, None)
        last = setup.steps * setup.dt if role == "sink" else lasts  # reports are due at instants
        if isinstance(value, float) and value > last * (1.0 + 1e-9):
            yield (
                f"{role}.{key}: {value:g} s is too long for the run of {lasts:g} s: {effect}; give a shorter one, or a "
                f"longer duration"
            )


def window_out_of_reach(setup: TrackingSetup) -> Iterator[str]:
    """A window of lost tracks that a run can hardly reach."""
    if 2 * setup.lost_window > setup.steps:
        yield (
            f"lost.window: {setup.lost_window * setup.dt:g} s are more than half of the {setup.steps:,} steps of "
            f"{setup.dt:g} s of the run, in which a track is hardly lost by this rule; give a shorter window, or a "
            f"duration of {(2 * setup.lost_window + 1) * setup.dt:g} s"
        )


def sleep_that_costs_more(setup: RadioSetup) -> Iterator[str]:
    """A sleep schedule with which a node consumes more than without: sleep, or changes of mode, are dear."""
    model = continuous_power(setup.energy)
    if model is None or setup.sleep.rest is not Mode.SCHEDULED:
        return
    powers = map(model.mode_power, (Mode.AWAKE, Mode.ASLEEP))
    awake, asleep = (float(power.radio + power.processor) for power in powers)
    change = (model.switching(Mode.AWAKE, Mode.ASLEEP) + model.switching(Mode.ASLEEP, Mode.AWAKE)) / 2.0
    if asleep <= awake and not change:
        return
    lasts = setup.duration
    keys = derive_all(Streams(setup.seed, 0).key("sleep"), np.arange(SAMPLED))
    seconds, changes = (float(each[0]) / SAMPLED for each in setup.sleep.profile(keys, np.array([lasts])))
    mean = (awake * seconds + asleep * (lasts - seconds) + change * changes) / lasts
    if mean > awake:
        why = f"{asleep:g} W asleep" if asleep > awake else f"{changes:.4g} changes of {change:g} J each"
        yield (
            f"sleep: by its schedule a node takes {mean:.4g} W on average, and {awake:g} W if it never slept: {why}; "
            f"give sleep: {{kind: always_on}}, or lower prices of {'sleep' if asleep > awake else 'changes'}"
        )


def steps_shorter_than_a_hop(setup: NetworkSetup) -> Iterator[str]:
    """Steps in which hardly a reading can reach a cluster head: a hop takes longer."""
    if not is_duty_cycled(setup.mac) or setup.dt >= setup.hop.unicast:
        return
    least = math.ceil(setup.hop.unicast * 10.0) / 10.0
    yield (
        f"step: steps of {1000 * setup.dt:g} ms are out of reach of mac: {setup.mac.mechanism}: a unicast waits up to "
        f"{setup.hop.unicast:.3g} s for its receiver; give a step of {least:g} s or more, or a shorter interval of the "
        "radio"
    )


def rounds_longer_than_a_step(setup: NetworkSetup) -> Iterator[str]:
    """Idle slots that are skipped, or kept ones for the nodes around a target that do not fit into a step."""
    if (slots := getattr(setup.mac, "idle_slots", None)) == "skipped":
        yield (
            "mac.idle_slots: skipped is an idealisation: all nodes know for free who has nothing to send, which "
            "decides the order of strategies on a real radio; give kept"
        )
    if slots != "kept":
        return
    field, nodes = setup.deploy.field, getattr(setup.deploy, "nodes", 0)
    members = min(round(nodes * math.pi * setup.sensor.reach**2 / (field.width * field.height)), nodes)
    takes, rest = setup.gathering(members), float(getattr(setup.mac, "contention", 0.0))
    if takes + rest > setup.dt:
        yield (
            f"mac.idle_slots: about {members} nodes are within sensing range of a target; a round with a slot for each "
            f"takes {1000 * takes:.3g} ms, and {1000 * rest:.3g} ms are between rounds, more than a step of "
            f"{1000 * setup.dt:g} ms: readings arrive later from step to step; give a longer step, or skipped"
        )


def messages_after_their_step(setup: NetworkSetup) -> Iterator[str]:
    """Wake-up messages that arrive after the step for which they wake nodes, two hops from a head that waits long."""
    if not is_duty_cycled(setup.mac) or setup.wakeup.mechanism == "none":
        return
    wait, hops = setup.waits.gather or 0.0, 2.0 * setup.hop.broadcast
    if setup.hop.broadcast < setup.dt < wait + hops:
        enough = math.ceil(10.0 * hops / (1.0 - CAP_SHARE)) / 10.0
        yield (
            f"wakeup: over mac: {setup.mac.mechanism} readings take up to {wait:.3g} s and a message of two hops "
            f"{hops:.3g} s, more than a step of {setup.dt:g} s: distant nodes are woken after it; give a step of "
            f"{enough:g} s or more, or a shorter interval of the radio"
        )


def radios_that_save_nothing(setup: RadioSetup) -> Iterator[str]:
    """Radios that are mostly off where listening costs nothing."""
    if not is_duty_cycled(setup.mac):
        return
    model = continuous_power(setup.energy)
    if model is None or not model.mode_power(Mode.AWAKE).radio:
        yield (
            f"mac: {setup.mac.mechanism} turns radios off, and by energy: listening costs nothing: nodes pay for "
            "reaching each other and save nothing; give energy: {kind: states}"
        )


def beacons_that_fill_the_channel(setup: RadioSetup) -> Iterator[str]:
    """Routing beacons that follow each other faster than a neighbourhood of duty-cycled radios can send them."""
    shortest = getattr(setup.routing, "i_min", None)
    if shortest is None or not is_duty_cycled(setup.mac):
        return
    least = CROWD * setup.hop.broadcast
    if shortest < least:
        yield (
            f"routing.i_min: over mac: {setup.mac.mechanism} a beacon takes up to {setup.hop.broadcast:.3g} s, and "
            f"nodes begin with one in {shortest:g} s each: they fill the channel, and routes are found late; give "
            f"{math.ceil(least):g} s or more, and a routing.patience that is longer than the first few intervals"
        )


def _if(other: str, *values: Any) -> Callable[[Any, Setup], bool]:
    """Whether another parameter has one of these values, or any but 0; it does where a plug-in lacks it."""

    def counts(part: Any, _: Setup) -> bool:
        value = getattr(part, other, values[0] if values else True)
        return value in values if values else bool(value)

    return counts


def _with_targets(_: Any, setup: Setup) -> bool:
    return isinstance(setup, TrackingSetup)


def _with_slots(part: Any, setup: Setup) -> bool:
    """Whether a MAC has slots inside clusters, or none of TDMA's parameters for them."""
    return _with_targets(part, setup) or part.mechanism != "tdma"


SLOTS: Final = ("acks", "guard", "slot", "schedule_bits", "contention", "idle_slots")
"""Parameters of TDMA that count only inside clusters."""
CONDITIONS: Final = (
    ("detection", "stuck_at", _if("stuck"), "while no sensor is stuck: give detection.stuck"),
    ("motion", "room", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("motion", "slack", _if("course", "in_room"), "on this course: give motion.course: in_room"),
    ("sensor", "dof", _if("noise", "student_t"), "with this noise: give sensor.noise: student_t"),
    ("sensor", "decorrelation", _if("shadowing"), "without shadowing: give sensor.shadowing"),
    ("sensor", "detour", _if("blocked"), "while no line of sight is blocked: give sensor.blocked"),
    ("link", "capture_margin", _if("interference", "sinr"), "without link.interference: sinr"),
    ("deploy", "position_error", _with_targets, "with a workload without targets"),
    ("energy", "sensing", _with_targets, "with a workload without targets"),
    *(("mac", key, _with_slots, "with a workload without targets") for key in SLOTS),
)
"""(role, parameter, whether it has an effect, what it needs) of parameters that depend on others."""

READINGS: Final = ("stuck", "bias")
LASTING: Final = (*READINGS, "blackout", "link_loss", "clock_step")
"""Mechanisms that do nothing but last, and those of them that concern readings alone."""
OUTAGES: Final = ("crash", "restart")
"""Mechanisms that only stop readings where there is no network."""


def keys_without_effect(setup: Setup) -> Iterator[str]:
    """Keys of the scenario about what this kind of run does not have."""
    if setup.unused:
        why = "network: none" if isinstance(setup, TrackingSetup) else "a workload without targets"
        yield f"{', '.join(setup.unused)}: no effect with {why}"


def parameters_without_effect(setup: Setup) -> Iterator[str]:
    """Parameters with another value than by default that count only with another one, or in another kind of run."""
    for role, key, counts, need in CONDITIONS:
        parts = (
            setup.motions if role == "motion" and isinstance(setup, TrackingSetup) else (getattr(setup, role, None),)
        )
        for part in parts:
            given = getattr(part, key, None) != getattr(type(part), key, None)
            if given and not counts(part, setup):
                yield f"{role}.{key}: no effect {need}"


def faults_that_hit_nobody(setup: Setup) -> Iterator[str]:
    """Faults aimed at a share of so few nodes, at a region or at numbers where there is no node in the first run."""
    aimed = [(number, fault) for number, fault in enumerate(setup.faults) if fault.head is None]
    if not aimed:
        return
    with contextlib.suppress(RunError):  # `notes.of_setup` says so
        positions = sample_positions(setup, covering_range(setup), 0)
        grid, key = CellGrid(positions), Streams(setup.seed, 0).key("faults")
        for number, fault in aimed:
            if not places_hit(fault, derive(key, number), grid):
                yield f"run 0: faults[{number}] ({fault.mechanism}) hits none of the {len(positions)} nodes"


def faults_between_instants(setup: Setup) -> Iterator[str]:
    """Faults whose times forbid an effect: they pass at once, or before or after sensors measure."""
    for number, fault in enumerate(setup.faults):
        standalone = not isinstance(setup, RadioSetup)
        if fault.mechanism not in LASTING + OUTAGES * standalone or _ends_a_crash(fault, setup):
            continue
        searches = isinstance(setup, NetworkSetup) and setup.polls > 1
        sensors_alone = (fault.mechanism in READINGS and not searches) or fault.mechanism in OUTAGES
        end = setup.duration if fault.duration is None else min(fault.at + fault.duration, setup.duration)
        name = f"faults[{number}] ({fault.mechanism}): no effect"
        if fault.duration == 0.0:
            yield f"{name} with a duration of 0 s"
        elif sensors_alone and _instant_from(fault.at, setup) >= min(_instant_from(end, setup), setup.steps + 1):
            last = f"every {setup.dt:g} s, up to {setup.steps * setup.dt:g} s"
            yield f"{name} from {fault.at:g} s to {end:g} s: sensors measure {last}"


def _instant_from(time: float, setup: Setup) -> int:
    """The number of the first instant that is not before a time."""
    return math.ceil(time / setup.dt - ROUNDING)


def _ends_a_crash(fault: FaultEvent, setup: Setup) -> bool:
    """Whether a restart may bring back nodes that are down by a crash."""
    return fault.mechanism == "restart" and any(
        other.mechanism == "crash"
        and other.at <= fault.at <= other.at + (math.inf if other.duration is None else other.duration)
        for other in setup.faults
    )


def covering_range(setup: Setup) -> float:
    """The range that must cover the field: of the sensors, or of the links of a network without targets."""
    if isinstance(setup, TrackingSetup):
        return setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return setup.link.reach


def _area(motion: Any) -> tuple[str, Box] | None:
    """(key, box) of what bounds a trajectory; None if nothing does."""
    if getattr(motion, "course", None) == "in_room":
        return "room", motion.room
    if getattr(motion, "box", None) is not None:
        return "box", motion.box
    bound = getattr(motion, "bound", None)
    if isinstance(bound, float) and math.isfinite(bound):
        return "bound", (-bound, bound, -bound, bound)
    width, height = getattr(motion, "width", None), getattr(motion, "height", None)
    if isinstance(width, float) and isinstance(height, float):
        return "width", _box(Field(width, height, getattr(motion, "centre", (0.0, 0.0))))
    return None


def _greatest_speed(motion: Any) -> float:
    """The greatest speed in m/s that the values of a motion name; 0 if they name none."""
    if isinstance(speed := getattr(motion, "speed", None), tuple):
        return float(max(speed))
    if hasattr(motion, "mean") and hasattr(motion, "sd"):
        return math.hypot(*motion.mean) + 3.0 * float(motion.sd)
    start, columns = getattr(motion, "start", ()), motion.columns
    speeds = [start[columns.index(name)] for name in ("vx", "vy") if name in columns and len(start) == len(columns)]
    return math.hypot(*speeds) if speeds else 0.0


def _of_target(setup: TrackingSetup, target: int) -> str:
    """The key of the motion of a target."""
    return "motion" if len(setup.motions) == 1 else f"targets[{target}]"


def _box(field: Field) -> Box:
    x, y = field.centre
    return x - field.width / 2, x + field.width / 2, y - field.height / 2, y + field.height / 2


def named(field: Field) -> str:
    """The field with its size and centre, as notes name it."""
    return f"the field of {field.width:g} m by {field.height:g} m around ({field.centre[0]:g}, {field.centre[1]:g})"
