"""Every parameter of every kind changes some table, is refused, is noted, or stands here with the reason.

Each kind runs in its smallest scenario, shortened: with a network, without one, and without targets. One parameter at a
time gets other values, to one of which a table must answer.
"""

from __future__ import annotations

import copy
import hashlib
import json
import types
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from wsnsim import experiment, scenario
from wsnsim.analysis import notes
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.tables import TABLES, Memory
from wsnsim.scenario.fields import fields_of, nested_of, roles_of
from wsnsim.scenario.kind_info import example_of
from wsnsim.scenario.registry import ROLES, Scope, find, load_class

MODES: Final = {"network": Scope(), "standalone": Scope(network=False), "workload": Scope(targets=False)}
STEPS: Final = 10
FEW_BEACONS: Final = ["deploy.nodes=60", "deploy.width=300 m", "deploy.height=300 m", "duration=8 s"]
FEW_REPORTS: Final = [
    "deploy.nodes=7", "deploy.width=100 m", "deploy.height=100 m", "duration=4 s", "workload.period=1250 ms",
    "workload.start_at=500 ms", "workload.bits=900", "link.interference=sinr", "routing.i_min=512 ms",
    "clock={kind: drift, sd: 30 ppm}",
]  # fmt: skip


def names_in(part: type[Any]) -> list[str]:
    """The parameters of a component, those of datasheets included; of components of a role within it, none."""
    nested, held = nested_of(part), roles_of(part)
    inner = [[f"{name}.{each}" for each in fields_of(nested[name])] if name in nested else [name]
             for name in fields_of(part) if name not in held]  # fmt: skip
    return [name for names in inner for name in names]


CASES: Final = [
    (mode, role.name, row.kind)
    for mode, scope in MODES.items()
    for role in ROLES.values()
    if scope.uses(role) or (role.inner and mode == "network")
    for row in role.kinds
    if names_in(load_class(row)) and (role.name != "workload" or mode == "workload")
]


UNLABELLED: Final[dict[str, Any]] = {
    "name": "scans", "seed": 7, "duration": 14.0, "step": 1.0, "prior": {"sd": [2, 1, 2, 1]},
    "deploy": {"kind": "grid", "nodes": 16, "width": 80.0, "height": 80.0, "cover": False},
    "targets": [
        {"kind": "waypoints", "points": [[0, -30, y], [14, 30, y]], "presence": [[0, 9]]} for y in (-1.5, 1.5)
    ],
    "sensor": {"kind": "range_bearing", "range_sd": 1.0, "bearing_sd": 0.035, "reach": 40.0},
    "detection": {"kind": "unlabelled", "probability": 0.5, "clutter": 4.0}, "clusters": {"kind": "central"},
    "energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": 90.0},
    "tracker": {"kind": "gnn", "filter": {"kind": "ekf"}},
}  # fmt: skip
"""A scenario whose tracker manages tracks: two targets side by side, which leave, amid clutter."""
ENRICHED: Final[dict[tuple[str, str], dict[str, Any]]] = {
    ("motion", "random_waypoint"): {"pause": [0.1, 0.5]},
    ("sensor", "rssi"): {"noise": "student_t", "shadowing": 2.0},
    ("sensor", "range"): {"blocked": 0.3},
    ("detection", "imperfect"): {"stuck": 0.3},
    ("link", "log_normal"): {"interference": "sinr"},
    ("tracker", "lmb"): {"components": 2},
    ("management", "m_of_n"): {"duplicate": 10.0},
    ("management", "sprt"): {"duplicate": 10.0, "false_confirmation": 0.2, "false_deletion": 0.2},
    ("battery", "linear"): {"cut_off": 1.5, "empty": 0.5},
    ("battery", "kinetic"): {"charge": 0.01 / 3.0},
    ("battery", "diffusion"): {"charge": 0.01 / 3.0},
}
"""Values with which other parameters of a kind have an effect."""
REASONS: Final[dict[str, dict[str, str]]] = {
    "deploy": {
        "* cover": "these fields are covered, or may be uncovered, anyway",
        "* draws": "a limit that is not reached",
        "network file count_from": "it names nodes, to which only recorded data refer",
        "standalone file *": "the field of a file matters to clusters, coverage and trackers that use it",
        "workload file *": "the field of a file matters to clusters, coverage and trackers that use it",
        "workload anchors *": "the field of a list matters to clusters, coverage and trackers that use it",
        "standalone anchors *": "the field of a list matters to clusters, coverage and trackers that use it",
    },
    "motion": {
        "* bounded_velocity c[12]": "the target does not reach the bound",
        "* bounded_velocity bound": "the target does not reach it",
        "* draws": "a limit that is not reached",
        "* random_waypoint pause": "the target reaches no point",
        "* waypoints points": "the target does not reach the last point",
        "* skip_bad_rows": "the file has no bad row",
    },
    "sensor": {
        "* rssi floor": "no target is so near",
        "* least": "no target is so near",
        "* recorded several": "the file has one reading of a node at a step",
        "* recorded skip_bad_rows": "the file has no bad row",
        "* recorded in_sample": "the law was not fitted to the file",
        "standalone range beyond": "all sensors are in range",
    },
    "energy": {
        "* radio.turnaround*": "the links and MACs of these scenarios give their own",
        "* radio.wake*": "the radio is not put to sleep, or into one of its listed states",
        "* radio.sleep*": "the radio is not put to sleep, or into one of its listed states",
        "* radio.doze*": "only duty-cycled MACs doze",
        "* radio.sensitivity": "the link gives its own",
        "* radio.noise": "the link gives its own",
        "* radio.modulation": "the link gives its own",
        "* radio.voltage": "said for readers: powers are in W",
        "workload * capacitance": "nodes without targets compute nothing",
        "workload * voltage": "nodes without targets compute nothing",
        "workload * processor.*": "nodes without targets compute nothing and do not sleep",
        "workload * switch": "nodes do not sleep",
        "* sleep": "nodes do not sleep",
    },
    "battery": {"* sink_on_mains": "there is no sink"},
    "link": {
        "* carrier_sense": "nodes within it hear each other anyway",
        "* cca_mode": "no frame is sensed by its energy alone",
        "* interference": "no two frames meet",
        "* capture_margin": "no two frames meet",
        "* recorded *": "the two nodes hear each other throughout the recording",
    },
    "mac": {
        "network tdma contention": "rounds of kept slots are a step apart, which is longer",
        "network * max_psdu": "no frame is so long",
        "* [sl]ifs": "no frame follows another at once",
        "* sifs_bytes": "no frame follows another at once",
        "* max_retries": "no frame is lost so often",
        "network [xc]*mac ack_*": "radios are awake for longer than an acknowledgement takes",
        "workload contikimac ack_wait": "no acknowledgement is late",
        "network [xc]*mac linger": "no frame follows another at once",
        "network contikimac phase_lock": "a run of a few steps ends before receivers are known",
        "network contikimac guard": "a run of a few steps ends before receivers are known",
        "* tsch channels": "the channels are alike",
        "* tsch m??_be": "no two frames meet in a shared cell so often",
        "workload tsch ack_bytes": "no acknowledgement is lost",
        "workload tsch cell_bits": "no frame waits for a cell of its own",
        "workload tsch lease": "no frame waits for a cell of its own",
        "workload tsch eb_*": "nodes know the time, and no beacon is due in a few seconds",
        "workload tsch keep_alive*": "no keep-alive is due in a few seconds",
    },
    "packing": {"* frames *": "no burst is so long"},
    "routing": {
        f"* ctp {name}": "few datagrams, none lost, in a few steps"
        for name in ("retries", "queue", "packet_time", "patience", "places", "candidates", "i_max", "largest_cost")
    },
    "sleep": {"workload *": "nodes that only send beacons do so on schedule"},
    "workload": {"workload collection *": "reports begin when this run ends"},
    "cpu": {"workload *": "nodes without targets compute nothing"},
    "clock": {"workload *": "nothing depends on the time of a clock"},
    "sync": {"* ftsp *": "a run of a few steps ends before the first message"},
    "sink": {f"* {name}": "the node nearest to the point is the same" for name in ("x", "y", "points")},
    "fault": {
        "* link_loss loss": "no frame of a node that is hit is sent while it lasts",
        "* clock_step *": "no reading falls into the jump",
    },
    "wakeup": {
        "* sensitivity": "calls reach all neighbours",
        "* power": "calls reach all neighbours",
        "* path_gain": "calls reach all neighbours",
    },
    "clusters": {
        "* handover_fraction": "no handover in a few steps",
        "* minimum_active": "enough members are active",
        "* successor_rule": "no handover in a few steps",
        "* threshold": "every battery is full",
        "* central [xy]": "the node nearest to the point is the same",
        "* patience": "no head loses its target in a few steps",
        "* share": "enough members are active",
        "* none gateway": "there is no sink",
    },
    "acquire": {"*": "no track is lost in a few steps"},
    "management": {
        "* known *": "no track starts, ends or merges",
        "* sprt false_confirmation": "the evidence of sixteen nodes comes in large steps",
    },
    "tracker": {
        "* ipf threshold": "the cloud stays good",
        "* handover": "no handover in a few steps, and none without a network",
        "* deadline": "every answer is in time",
        "* late": "every reading is in time",
        "* late_window": "every reading is in time",
        "* imm added_sd": "the models have the same columns",
        "standalone * reading_bits": "readings take one packet in any case",
    },
}
"""Role: {mode, kind and parameter: why no table shows it in these short runs}."""
SLEEP: Final = {"kind": "duty_cycle", "period": 0.1, "awake_share": 0.5, "phases": "staggered"}


def base_of(folder: Path, mode: str, role: str, kind: str) -> dict[str, Any]:
    """The values of a short scenario with a kind; the files that it names are put into the folder."""
    if role == "management":
        tracker = UNLABELLED["tracker"] | {"management": {"kind": kind}}
        tracker["management"] |= ENRICHED.get((role, kind), {})
        return scenario.resolved(scenario.load(UNLABELLED | {"tracker": tracker}))
    if role == "trigger":
        trigger = f"tracker.trigger={{kind: {kind}}}"
        return scenario.resolved(scenario.load("event_triggered", ["duration=9 s", "replicates=1", trigger]))
    example, key = example_of(ROLES[role], kind, ()), ROLES[role].listed if ROLES[role].optional else role
    for name, content in example.files.items():
        (folder / name).write_text(content)
    (folder / "x.yaml").write_text(example.text())
    values = scenario.resolved(scenario.load(folder / "x.yaml"))
    if mode == "workload" and (role == "mac" or values.get("workload", {"kind": "tracking"})["kind"] == "tracking"):
        chosen = FEW_BEACONS if role != "mac" else [*FEW_REPORTS, f"mac={json.dumps(values[key])}"]
        other = scenario.resolved(scenario.load("collection" if role == "mac" else "beacons", chosen))
        values = other | ({} if role == "mac" else {key: values[key]})
    if mode == "standalone":
        values = {name: value for name, value in values.items() if name != "until"} | {"network": "none"}
    step = values["step"]
    values["duration"] = min(values["duration"], STEPS * step if mode != "workload" else 12.0)
    for fault in values.get("faults", ()):
        fault.update(at=1.5 * step, nodes=list(range(250 if mode != "workload" else 40)), duration=2 * step)
        if kind == "drain":
            del fault["duration"]
    if role == "mac" and mode == "network":
        values["link"]["loss"] = 0.1
        values["duration"] = min(values["duration"], 6.0)
    if role == "battery":  # small ones, that nodes empty at once or nearly
        values["energy"]["battery"], count = 0.01, values["deploy"]["nodes"]
        values["battery"] |= {
            "residual": [0.0 if node % 5 == 0 else 0.003 + 1e-5 * (node % 50) for node in range(count)],
            "spread": 0.1, "self_discharge": 0.5, "temperature": 0.0, "usable": 0.9,
        }  # fmt: skip
        if values["battery"].get("harvest"):
            values["battery"]["harvest"]["restart"] = 0.5
    if role == "energy" and mode == "network":
        values["sleep"] = SLEEP
    for name, value in ENRICHED.get((role, kind), {}).items():
        holder(values, role, name)[0][name] = value
    return values


def alternatives(value: Any, hint: Any) -> list[Any]:
    """Other values of a parameter, most telling first."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return alternatives(value, arguments[0])
    if origin is Literal:
        return [each for each in arguments if each != value]
    if origin in (Union, types.UnionType):
        return [each for one in arguments if one is not type(None) for each in alternatives(value, one)]
    if hint is bool:
        return [not value]
    if hint in (float, int):
        known = isinstance(value, float | int)
        near = [value * 2, value / 2, value + 60, value + 1, value - 1] if known else [0.5, 1, 5, 0.05, 50]
        return [each for each in dict.fromkeys(hint(each) for each in near) if each != value]
    if origin is tuple and value:
        numbers = isinstance(value[0], float | int)
        scaled = numbers and [
            [2 * each for each in value],
            [0.5 * each for each in value],
            [each + 1 for each in value],
        ]
        return [*(scaled or [value[::-1]]), value[: len(value) // 2], value[:-1]]
    if origin is tuple:
        inner = arguments[0]
        count = 3 if ... in arguments else len(arguments)
        return [[each] * count for each in alternatives(None, inner)[:4]]
    return []


def hint_of(part: type[Any], name: str) -> Any:
    outer, _, inner = name.partition(".")
    return get_type_hints(nested_of(part)[outer])[inner] if inner else get_type_hints(part)[outer]


def holder(values: dict[str, Any], role: str, name: str) -> tuple[Any, str]:
    inner = values["tracker"][role] if role in ("management", "trigger") else None
    top = inner or (values["faults"][0] if role == "fault" else values.get(role) or values["targets"][0])
    outer, _, nested = name.partition(".")
    return (top[outer], nested) if nested else (top, outer)


def outcome(values: dict[str, Any]) -> tuple[str, str]:
    """(digest of all tables, or why there are none; the notes) of a run."""
    try:
        setup = scenario.build(scenario.load(values))
    except ScenarioError as error:
        return "refused", str(error)
    memory = Memory(dict.fromkeys(TABLES, True))
    try:
        experiment.replicate_of(setup, 0, memory)
    except RunError as error:
        return "failed", str(error)
    digest = hashlib.blake2b()
    for table in TABLES:
        for name, column in memory.table(table).items():
            if name != "cpu_seconds":
                digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest(), "\n".join(notes.before_a_run(setup))


def is_silent(base: dict[str, Any], usual: tuple[str, str], role: str, part: type[Any], name: str) -> bool:
    """Whether no value of a parameter changes a table, though some are allowed, and no note says so.

    Texts, such as names of files and columns, are not varied.
    """
    top, key = holder(base, role, name)
    answers = []
    for value in alternatives(top.get(key), hint_of(part, name))[:6]:
        values = copy.deepcopy(base)
        top, _ = holder(values, role, name)
        top[key] = value
        answers.append(outcome(values))
        if answers[-1][0] not in ("refused", usual[0]) or f"{role}.{name}: no effect" in answers[-1][1]:
            return False
    return any(found != "refused" for found, _ in answers)


@pytest.mark.thorough
@pytest.mark.parametrize("role", ROLES)
def test_every_parameter_changes_a_table_is_refused_is_noted_or_has_a_reason(role: str, tmp_path: Path) -> None:
    silent = []
    for mode, _, kind in (case for case in CASES if case[1] == role):
        base = base_of(tmp_path, mode, role, kind)
        usual = outcome(base)
        part = load_class(find(role, kind))
        if usual[0] != "refused":
            silent += [f"{mode} {kind} {name}" for name in names_in(part) if is_silent(base, usual, role, part, name)]
    reasons = REASONS.get(role, {})
    assert [one for one in silent if not any(fnmatch(one, pattern) for pattern in reasons)] == []
