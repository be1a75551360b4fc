"""Invented results, and readers of what is made of results: a page's elements, a replay's columns."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser

import numpy as np

from wsnsim.base.tables import KIND, TABLES, columns_of
from wsnsim.recording import ResultFile

PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
LINE = (("px", "m"), ("vx", "m/s"))
BY_LINE = {"states": LINE, "place": (0,)}
VOID = ("meta", "link", "input", "img", "br", "wbr")
KINDS = {"u1": "u1", "u2": "<u2", "u4": "<u4", "i4": "<i4", "f4": "<f4"}
OF_EVENTS = ("send", "receive", "collide", "sense", "wake", "sleep", "death", "crash")
OF_CLUSTERS = ("elect", "announce", "join", "join", "join", "lost", "handover", "wake", "sleep", "resume", "death")


def invented(path, states=PLANE, place=(0, 2), targets=1, runs=1, steps=6, nodes=5, name="invented", **said):
    """A result of invented rows. `without`: tables not recorded; `status`; `first`: its first replicate.

    `estimates`: whether any; `events`: their kinds, True for those that are sent, sensed and slept.
    """
    rng = np.random.default_rng(2)
    wanted = dict.fromkeys(TABLES, True) | dict.fromkeys(said.get("without", ()), False)
    with ResultFile(path, states, wanted, position=place, status=said.get("status", "complete")) as file:
        file.set_text("scenario/source_yaml", f"name: {name}\n")
        file.set_text("scenario/resolved_json", json.dumps({"name": name, "seed": 1, "step": 0.5, "said": name}))
        file.set_text("provenance_json", json.dumps({"command_line": name, "packages": {"numpy": "2"}}))
        for run in range(said.get("first", 0), said.get("first", 0) + runs):
            row = dict.fromkeys((column.name for column in columns_of("runs")), 0)
            file.write("runs", row | {"replicate": run, "rmse": 1.0 + run, "energy": 2.0 + run})
            for target in range(targets):
                _invented_track(file, states, place, {"replicate": run, "target": target}, steps, rng, said)
            places = {"x": rng.uniform(-50, 50, nodes), "y": rng.uniform(-50, 50, nodes)}
            charge = {"gain": 1.0, "energy_initial": 2.0, "energy_left": 1.5, "died_at": np.nan}
            file.write("nodes", {"replicate": run, "node": np.arange(nodes), **places, **charge})
            if said.get("events"):
                kinds = OF_EVENTS if said["events"] is True else said["events"]
                _invented_events(file, run, (steps, nodes, targets), kinds, rng)
    return path


def _invented_track(file, states, place, track, steps, rng, said):
    step = np.arange(steps + 1)
    way = {name: rng.normal(0, 20, steps + 1) for name, _ in states}
    if states:
        file.write("truth", {**track, "step": step, "time": 0.5 * step, **way})
    if states and said.get("estimates", True):
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
                "issued": 0.5 * step[1:] + said.get("delay", 0.0),
            },
        )


def _invented_events(file, run, sizes, kinds, rng):
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


class Reader(HTMLParser):
    """A page's elements and texts, and whether every element that opens also closes."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.ids = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.ids += [value for name, value in attributes if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        self.texts.append((self.open[-1] if self.open else "", text))


def unpacked(text):
    """Header and columns of a replay, as its description says that they lie."""
    raw = zlib.decompress(base64.b64decode(text))
    size = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4 : 4 + size])
    at = {name: np.frombuffer(raw, KINDS[kind], count, 4 + size + offset)
          for name, (kind, offset, count) in header["columns"].items()}  # fmt: skip
    return header, at


def no_pictures(path, replicate):
    """No figures: they take their time, and are not what is tested."""
    return [], []


def films_of(page):
    return re.findall(r'<script type="text/plain" class="film"[^>]*>([^<]*)</script>', page)


def rows_at(columns, name, frame):
    """The rows of something that happens at some frames only: those of one frame, and of all up to it."""
    ends = np.cumsum(columns[f"{name}_count"])
    return slice(ends[frame] - columns[f"{name}_count"][frame], ends[frame])
