"""Random cases of each kind: `case(kind, number)` is a function of its arguments, so that a long run can be resumed."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

import click
import yaml

from tests.fuzz.hdf5_edits import EDITS
from tests.fuzz.hdf5_mutants import edited, random_mutants
from tests.fuzz.judge import PROPERTIES, Case
from tests.fuzz.mutation import CONTROL, NASTY, mutated_bytes, mutated_text
from tests.fuzz.plugins import plugin
from tests.fuzz.random_scenarios import sampled
from tests.fuzz.small_result import small_result
from wsnsim.cli.shared import every_command

SCENARIOS: Final = Path(__file__).parents[2] / "scenarios"
SMALL: Final = """\
name: small
network: none
seed: 1
duration: 3 s
step: 1 s
prior: {sd: [2, 1, 2, 1]}
deploy: {kind: anchors, places: [[0, 0], [200, 0], [0, 200]]}
motion: {kind: constant_velocity, noise_input: diagonal, variances: [0.5], start: [70, 5, 21, 8]}
sensor: {kind: range, sd: 1 m, reach: .inf}
tracker: {kind: pf, particles: 20}
"""
SWEEP: Final = """\
name: some
scenario: small.yaml
set: {tracker.threshold: 0.5}
grid:
  tracker.particles: [10, 20]
  sensor.sd: {from: 1 m, to: 4 m, count: 2, scale: log}
zip: {seed: [1, 2], prior.sd: [[1, 1, 1, 1], [2, 2, 2, 2]]}
random: {points: 2, seed: 3, over: {deploy.places: [[[0, 0], [9, 9], [9, 0]]]}}
replicates: 2
block: 1
timeout: 10 s
"""
NODES: Final = "x,y,name\n" + "".join(f"{10 * i}.5,{-7 * i},n{i}\n" for i in range(-6, 7))
POINTS: Final = "t,x,y\n0,0,0\n1.5,3,4\n2,3,5\n9,-8,1\n"
ENDLESS: Final = ("reproduce", "sweep", "compare", "watch")
"""Commands that start other processes or take minutes: of these only what fails at once is tried."""

READERS: Final[tuple[tuple[str, ...], ...]] = (
    ("info", "x.h5"), ("plot", "x.h5", "--out", "x.png"), ("trace", "x.h5", "--step", "1"), ("check", "x.h5"),
    ("export", "x.h5", "--parquet", "out"), ("export", "x.h5", "--csv", "out", "--mat", "x.mat"),
    ("diff", "x.h5", "x.h5"), ("verify", "x.h5"),
    ("recover", "x.h5", "--out", "y.h5"),
)  # fmt: skip
"""Commands that read a result."""


@cache
def _shipped() -> tuple[str, ...]:
    """The texts of the shipped scenarios, those that extend another one included."""
    return tuple(path.read_text(encoding="utf-8") for path in sorted(SCENARIOS.glob("*.yaml")))


def of_scenario(rng: random.Random) -> Case:
    """A mutated scenario: shipped, sampled, or the smallest."""
    how = rng.random()
    text = rng.choice(_shipped()) if how < 0.5 else SMALL
    if how < 0.3:
        text = yaml.safe_dump(sampled(rng.randrange(1000)), sort_keys=False, default_flow_style=None)
    return Case(("check", "x.yaml"), {"x.yaml": mutated_text(text, rng)})


def of_sweep(rng: random.Random) -> Case:
    """A mutated sweep."""
    files = {"x.yaml": mutated_text(SWEEP, rng), "small.yaml": SMALL.encode()}
    return Case(("sweep", "x.yaml", "--dry-run", "-o", "out", "--quiet"), files)


def of_csv(rng: random.Random) -> Case:
    """Mutated positions of nodes, or waypoints, in a scenario that is run."""
    nodes, points = (mutated_text(text, rng) if rng.random() < 0.7 else text.encode() for text in (NODES, POINTS))
    roles = {
        "deploy": {"kind": "file", "path": "nodes.csv", "cover": False, "width": "999 m", "height": "999 m"},
        "motion": {"kind": "waypoints", "path": "points.csv"},
    }
    text = yaml.safe_dump(yaml.safe_load(SMALL) | roles)
    files = {"x.yaml": text.encode(), "nodes.csv": nodes, "points.csv": points}
    return Case(("run", "x.yaml", "--quiet", "--out", "x.h5"), files)


def of_command(rng: random.Random) -> Case:
    """A random command line."""
    name = rng.choice([*every_command(), *every_command(), "", "--version", "-h", "nonsense", rng.choice(NASTY)])
    words = [name]
    if name in every_command():
        words += _words_of(every_command()[name], rng)
    if name in ENDLESS:
        words += ["--no-such-option"]
    if name == "run":
        words += ["--set", "duration=2 s", "--replicates", "1", "--quiet"]
    files = {"small.yaml": SMALL.encode(), "x.h5": small_result(), "x.csv": NODES.encode()}
    return Case(tuple(word.replace("\x00", "") for word in words), files)


def _words_of(command: click.Command, rng: random.Random) -> list[str]:
    words = []
    for parameter in command.params:
        if isinstance(parameter, click.Argument):
            words += [_word(rng) for _ in range(rng.choice([1, 1, 1, 0, 2]))]
        elif rng.random() < 0.25:
            words.append(rng.choice(parameter.opts))
            if not getattr(parameter, "is_flag", False):
                words.append(_value(parameter, rng))
    return words


def _word(rng: random.Random) -> str:
    usual = ("small.yaml", "small.yaml", "x.h5", "x.h5", "x.csv", ".", "..", "none.h5", "trackers", "pf", "-", "--", "")
    return rng.choice(usual) if rng.random() < 0.8 else rng.choice(NASTY + CONTROL)


def _value(parameter: click.Parameter, rng: random.Random) -> str:
    if isinstance(parameter.type, click.Choice) and rng.random() < 0.8:
        return str(rng.choice(list(parameter.type.choices)))
    if "--set" in parameter.opts:
        key = rng.choice(["seed", "step", "sensor.sd", "tracker.kind", "a.b", "deploy.places.0", ""])
        return f"{key}={rng.choice(NASTY)}"
    usual = ("0", "1", "2", "-1", "1.5", "x", "rmse", "error", "nan", "out.h5", "out", "estimates", "seed=1", "1/2")
    return rng.choice(usual) if rng.random() < 0.8 else rng.choice(NASTY + CONTROL)


def of_hdf5(rng: random.Random) -> Case:
    """A result with damaged bytes."""
    return Case(rng.choice(READERS), {"x.h5": mutated_bytes(small_result(), rng)})


def of_mutant(rng: random.Random) -> Case:
    """A result that somebody edited who knows HDF5, or with a damaged header whose checksum is right."""
    if rng.random() < 0.5:
        content = edited(small_result(), rng.choice(list(EDITS)))
    else:
        content = next(random_mutants(small_result(), rng.randrange(2**32))).content
    return Case(rng.choice(READERS), {"x.h5": content}, fragile=True)


def of_plugin(rng: random.Random) -> Case:
    """A tracker of somebody else's with a fault, which the message must name."""
    module = f"theirs{rng.randrange(10**9)}"
    values: dict[str, Any] = yaml.safe_load(SMALL) | {"tracker": {"kind": f"{module}:Theirs"}}
    files = {"x.yaml": yaml.safe_dump(values).encode(), f"{module}.py": plugin(rng).encode()}
    return Case(("run", "x.yaml", "--quiet", "--out", "x.h5"), files, names="theirs")


def of_run(rng: random.Random) -> Case:
    """A random scenario, whose run is checked for what must hold in every run."""
    return Case((PROPERTIES,), {"x.json": json.dumps(sampled(rng.randrange(10**9))).encode()})


KINDS: Final[dict[str, Callable[[random.Random], Case]]] = {
    "scenario": of_scenario, "sweep": of_sweep, "csv": of_csv, "command": of_command, "hdf5": of_hdf5,
    "plugin": of_plugin, "run": of_run, "mutant": of_mutant,
}  # fmt: skip


def case(kind: str, number: int, seed: int = 0) -> Case:
    """The case of a kind with a number."""
    return KINDS[kind](random.Random(f"{seed} {kind} {number}"))
