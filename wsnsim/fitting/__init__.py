"""Laws are fitted to recorded readings.

    found = wsnsim.fit(["straight_01.csv.gz", "straight_02.csv.gz"], nodes="receivers.csv", test=["straight_04.csv.gz"])
    found.sensor        the block `sensor` of a scenario: {"kind": "rssi", "z0": -62.4, ...}

fit(files, nodes, law, test, **options) -> Fit
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from typing import Any, TypeAlias

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.fitting.data_files import ReadingOptions
from wsnsim.fitting.estimation import FitOptions
from wsnsim.fitting.fitted_law import Evaluation, FittedGain, FittedValue
from wsnsim.fitting.laws import LAWS
from wsnsim.fitting.readings import fit_readings
from wsnsim.fitting.result import Fit

__all__ = ["Evaluation", "Fit", "FitOptions", "FittedGain", "FittedValue", "ReadingOptions", "fit"]

Paths: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def fit(files: Paths, nodes: str | os.PathLike[str], law: str = "rssi", test: Paths = (), **options: Any) -> Fit:
    """Fit a law to recorded readings at known places of a target.

    Args:
        files: CSV files with the columns time (s), node, reading, x, y and perhaps z (m); may be compressed (.gz).
        nodes: CSV file with the columns id, x, y and perhaps z (m) of the nodes, in the order of the deployment.
        law: `rssi` (dBm) or `range` (m).
        test: files on which the fitted law is judged.
        **options: fields of `FitOptions` (gains, heights, noise, block, seed, in_sample) and of `ReadingOptions`
            (columns, tracks, skip_bad_rows).

    Returns:
        The fit: `sensor` is the block of a scenario, `values` and `gains` have intervals, `test` the held-out figures.

    Raises:
        UsageError: an option is unknown, or a test file is one of the fitted files and `in_sample` is not said.
        RunError: a file cannot be used, or the readings do not determine the law; the message names file and line.
    """
    if law not in LAWS:
        raise UsageError(f"unknown law '{law}' ({did_you_mean(law, LAWS)})")
    paths = _paths(files)
    if not paths:
        raise UsageError("fit needs at least one file of readings")
    reading, wanted = _split(options)
    return fit_readings(paths, os.fspath(nodes), LAWS[law], _paths(test), reading, wanted)


def _split(options: dict[str, Any]) -> tuple[ReadingOptions, FitOptions]:
    """The options by the class that has them."""
    reading, fitting = ({field.name for field in dataclasses.fields(kind)} for kind in (ReadingOptions, FitOptions))
    for name in options:
        if name not in reading | fitting:
            raise UsageError(f"fit: unknown option '{name}' ({did_you_mean(name, reading | fitting)})")
    options = options | {"tracks": _paths(options.get("tracks", ()))}
    return (
        ReadingOptions(**{name: value for name, value in options.items() if name in reading}),
        FitOptions(**{name: value for name, value in options.items() if name in fitting}),
    )


def _paths(files: Paths) -> list[str]:
    return [os.fspath(files)] if isinstance(files, str | os.PathLike) else [os.fspath(file) for file in files]
