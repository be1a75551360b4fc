"""What is valid in a scenario and yet hardly meant: each note says why, with the figures and the nearest remedy.

before_a_run(setup) -> notes        in_a_check(setup) -> notes

They follow from the values of the scenario, by one table of rules. Nodes are placed only where links may be too short,
or something fails.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from wsnsim.analysis import connectivity
from wsnsim.analysis.effect_notes import (
    covering_range,
    faults_between_instants,
    faults_that_hit_nobody,
    keys_without_effect,
    parameters_without_effect,
)
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import sample_positions
from wsnsim.base.medium_access import CAP_SHARE, is_duty_cycled
from wsnsim.base.network_ports import Field
from wsnsim.base.radio import Mode, RecordsLinks, continuous_power
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup

SURELY_LINKED: Final = 3.0
"""With more expected neighbours than this (mean over the field), some nodes are surely within range of another."""
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


def steps_across_the_field(setup: TrackingSetup) -> Iterator[str]:
    """Targets that are so fast that one step takes them out of the field."""
    field = setup.deploy.field
    side = max(field.width, field.height) + 2.0 * setup.sensor.reach
    for i, motion in enumerate(setup.motions):
        speed = _greatest_speed(motion)
        if speed * setup.dt > side:
            yield (
                f"{_of_target(setup, i)}: at {speed:g} m/s a target goes {speed * setup.dt:g} m in a step of "
                f"{setup.dt:g} s, across all of {named(field)} and out of the sensing range of every node; give a "
                f"step of at most {_rounded_down(side / speed)} s"
            )


def links_that_reach_nobody(setup: RadioSetup) -> Iterator[str]:
    """A communication range within which no node has another, in the first run; looked for where nodes are sparse."""
    if isinstance(setup.link, RecordsLinks):
        return
    field, reach = setup.deploy.field, setup.link.reach
    if getattr(setup.deploy, "nodes", 0) * math.pi * reach**2 > SURELY_LINKED * field.width * field.height:
        return
    with contextlib.suppress(RunError):  # `notes.of_setup` says so
        positions = sample_positions(setup, covering_range(setup), 0)
        if len(positions) > 1 and (said := connectivity.nobody(positions, reach)):
            yield f"run 0: {said}"


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
    awake, asleep = (_power(model, mode) for mode in (Mode.AWAKE, Mode.ASLEEP))
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
    """Kept slots for the nodes around a target that do not fit into a step."""
    if getattr(setup.mac, "idle_slots", "skipped") != "kept":
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


Rule = tuple[type[Setup], Callable[[Any], Iterator[str]]]
RULES: Final[tuple[Rule, ...]] = (
    (Setup, keys_without_effect),
    (Setup, parameters_without_effect),
    (Setup, faults_that_hit_nobody),
    (Setup, faults_between_instants),
    (TrackingSetup, motions_beyond_the_field),
    (TrackingSetup, steps_across_the_field),
    (RadioSetup, sink_outside_the_field),
    (Setup, longer_than_the_run),
    (RadioSetup, sleep_that_costs_more),
    (NetworkSetup, steps_shorter_than_a_hop),
    (NetworkSetup, rounds_longer_than_a_step),
    (NetworkSetup, messages_after_their_step),
    (RadioSetup, radios_that_save_nothing),
    (RadioSetup, beacons_that_fill_the_channel),
)
"""(setups that a rule is about, what it notes of one): the path of a value, what is wrong, and the nearest remedy."""
BEFORE_A_RUN: Final[tuple[Rule, ...]] = (*RULES, (RadioSetup, links_that_reach_nobody))
"""A check looks at the whole graph of links instead."""
IN_A_CHECK: Final[tuple[Rule, ...]] = (*RULES, (TrackingSetup, window_out_of_reach))
"""A short run, to try things, is meant to be short."""


def before_a_run(setup: Setup) -> list[str]:
    """What the values of a scenario make hardly meant, a sentence each, and whether no node can reach another."""
    return _found(BEFORE_A_RUN, setup)


def in_a_check(setup: Setup) -> list[str]:
    """What the values of a scenario make hardly meant, and what is so only in a run that is no trial."""
    return _found(IN_A_CHECK, setup)


def _found(rules: tuple[Rule, ...], setup: Setup) -> list[str]:
    return [note for about, rule in rules if isinstance(setup, about) for note in rule(setup)]


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


def _power(model: Any, mode: Mode) -> float:
    """Power in W of a node in a mode."""
    power = model.mode_power(mode)
    return float(power.radio + power.processor)


def _of_target(setup: TrackingSetup, target: int) -> str:
    """The key of the motion of a target."""
    return "motion" if len(setup.motions) == 1 else f"targets[{target}]"


def _box(field: Field) -> Box:
    x, y = field.centre
    return x - field.width / 2, x + field.width / 2, y - field.height / 2, y + field.height / 2


def named(field: Field) -> str:
    """The field with its size and centre, as notes name it."""
    return f"the field of {field.width:g} m by {field.height:g} m around ({field.centre[0]:g}, {field.centre[1]:g})"


def _rounded_down(value: float) -> str:
    """A value with one significant digit, not above it."""
    unit = 10.0 ** math.floor(math.log10(value))
    return f"{math.floor(value / unit) * unit:g}"
