"""Visits that worker processes simulate, each in a file: what they need, and what they give.

A point of the folder is a network some of whose nodes are dead. Beside its scenario lies `visits.json`: these nodes,
and the number of the run that is the first visit. A visit does not depend on how often visits come.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.lifetimes.library import ARRAYS, Library, make_visit
from wsnsim.lifetimes.planning import lifetime_plan
from wsnsim.recording.arrays import read_arrays, write_arrays
from wsnsim.recording.atomic_files import write_text_atomically
from wsnsim.scenario.build import resolved

VISITS: Final = "visits.json"
_WINDOW: Final = ("lead", "tail")
_COMES: Final = {"rate": None, "profile": None, "path": None, "times": [0.0]}
"""What stands for the times of visits where they have no effect."""


def of_visits(scenario: Any) -> str:
    """The scenario of visits, as JSON: without what has no effect on a visit."""
    values = resolved(scenario)
    asked = values.get("lifetime", {})
    values["lifetime"] = {name: asked[name] for name in _WINDOW if name in asked} | {"times": [0.0]}
    if values["motion"]["kind"] == "visits":
        values["motion"] |= {key: value for key, value in _COMES.items() if key in values["motion"]}
    for key in ("name", "replicates", "record", "lost"):
        values.pop(key, None)
    return json.dumps({"name": "visits", **values}, ensure_ascii=False)


def write_point(folder: Path, dead: Iterable[int], first: int) -> None:
    """Write which nodes are dead in the visits of a point, and the number of the first."""
    write_text_atomically(folder / VISITS, json.dumps({"dead": sorted(dead), "first": first}))


def simulate_visit(scenario: Any, folder: Path, number: int, path: Path) -> None:
    """Simulate a visit of a point, and write its file.

    Raises:
        RunError: the simulation failed. StorageError, ResultError: a file cannot be written or read.
    """
    about = json.loads((folder / VISITS).read_text(encoding="utf-8"))
    setup, plan = lifetime_plan(scenario)
    library = make_visit(setup, plan.visit, about["first"] + number, frozenset(about["dead"]))
    write_arrays(path, {name: getattr(library, name) for name in ARRAYS})


def read_visits(paths: Iterable[Path], dead: frozenset[int]) -> Library:
    """The library of the visits in some files. Raises ResultError if one cannot be used."""
    try:
        found = [read_arrays(path) for path in paths]
        return Library(**{name: np.concatenate([each[name] for each in found]) for name in ARRAYS}, dead=dead)
    except (KeyError, ValueError) as error:
        raise ResultError(f"a file of a visit holds something else: {error}; remove the folder of visits") from error
