"""Result files with random rows, for tests that need no simulation."""

from __future__ import annotations

import json

import numpy as np

from wsnsim.base.tables import KIND, TABLES, columns_of
from wsnsim.recording import ResultFile

PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
LINE = (("px", "m"), ("vx", "m/s"))
ON_A_LINE = {"states": LINE, "place": (0,)}
TRAFFIC_EVENTS = ("send", "receive", "collide", "sense", "wake", "sleep", "death", "crash")
CLUSTER_EVENTS = ("elect", "announce", "join", "join", "join", "lost", "handover", "wake", "sleep", "resume", "death")


def write_result(path, states=PLANE, place=(0, 2), targets=1, runs=1, steps=6, nodes=5, name="synthetic", **options):
    """Write a result with random rows and return its path.

    Further options: `without`: tables that are not recorded; `status`; `first`: the first replicate; `estimates`:
    whether there are any; `delay` of estimates (s); `events`: their kinds, True for `TRAFFIC_EVENTS`.
    """
    rng = np.random.default_rng(2)
    wanted = dict.fromkeys(TABLES, True) | dict.fromkeys(options.get("without", ()), False)
    with ResultFile(path, states, wanted, position=place, status=options.get("status", "complete")) as file:
        file.set_text("scenario/source_yaml", f"name: {name}\n")
        file.set_text("scenario/resolved_json", json.dumps({"name": name, "seed": 1, "step": 0.5, "note": name}))
        file.set_text("provenance_json", json.dumps({"command_line": name, "packages": {"numpy": "2"}}))
        for run in range(options.get("first", 0), options.get("first", 0) + runs):
            row = dict.fromkeys((column.name for column in columns_of("runs")), 0)
            file.write("runs", row | {"replicate": run, "rmse": 1.0 + run, "energy": 2.0 + run})
            for target in range(targets):
                _write_track(file, states, place, {"replicate": run, "target": target}, steps, rng, options)
            places = {"x": rng.uniform(-50, 50, nodes), "y": rng.uniform(-50, 50, nodes)}
            places |= {f"{axis}_assumed": place for axis, place in places.items()}
            charge = {"gain": 1.0, "energy_initial": 2.0, "energy_left": 1.5, "died_at": np.nan}
            file.write("nodes", {"replicate": run, "node": np.arange(nodes), **places, **charge})
            if options.get("events"):
                kinds = TRAFFIC_EVENTS if options["events"] is True else options["events"]
                _write_events(file, run, (steps, nodes, targets), kinds, rng)
    return path


def _write_track(file, states, place, track, steps, rng, options):
    step = np.arange(steps + 1)
    way = {name: rng.normal(0, 20, steps + 1) for name, _ in states}
    if states:
        file.write("truth", {**track, "step": step, "time": 0.5 * step, **way})
    if states and options.get("estimates", True):
        row = dict.fromkeys((column.name for column in columns_of("estimates", states, place)), 0)
        near = {name: values[1:] + rng.normal(0, 1, steps) for name, values in way.items()}
        file.write(
            "estimates",
            {
                **row,
                **track,
                "step": step[1:],
                "time": 0.5 * step[1:],
                **near,
                "error": 1.0,
                "issued": 0.5 * step[1:] + options.get("delay", 0.0),
            },
        )


def _write_events(file, run, sizes, kinds, rng):
    steps, nodes, targets = sizes
    count = 40 * steps
    code = np.array([KIND[kind] for kind in kinds])
    step = np.sort(rng.integers(0, steps + 1, count))
    target = rng.integers(0, targets, count) if targets > 1 else 0
    one = {"replicate": run, "step": step, "time": 0.5 * step, "target": target, "what": file.words.code("reading")}
    node, peer = rng.integers(0, nodes, count), rng.integers(-1, nodes, count)
    kind, frame = code[rng.integers(0, len(code), count)], rng.integers(1, 20, count)
    rest = {"sequence": 0, "packets": 1, "bits": 8, "joules": rng.uniform(0, 1e-3, count), "cause": 1}
    file.write("events", {**one, "node": node, "peer": peer, "kind": kind, "frame": frame, **rest})
