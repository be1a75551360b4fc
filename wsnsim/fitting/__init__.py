"""Fits of laws to recorded readings, and of a link model to recorded links.

    found = wsnsim.fit(["straight_01.csv.gz", "straight_02.csv.gz"], nodes="receivers.csv", test=["straight_04.csv.gz"])
    found.sensor        the block `sensor` of a scenario: {"kind": "rssi", "z0": -62.4, ...}

fit(files, nodes, law, test, **options) -> Fit | LinkFit
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from typing import Any, Final, Literal, TypeAlias, overload

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.fitting.data_files import ReadingOptions
from wsnsim.fitting.estimation import FitOptions, fit_readings
from wsnsim.fitting.fitted_law import LAWS, UNFITTED, Evaluation, FittedGain, FittedValue
from wsnsim.fitting.links import LinkFit, LinkOptions, fit_links
from wsnsim.fitting.result import Fit

__all__ = [
    "Evaluation", "Fit", "FitOptions", "FittedGain", "FittedValue", "LinkFit", "LinkOptions", "ReadingOptions", "fit",
]  # fmt: skip

Paths: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
LINKS: Final = "log_normal"
"""The `law` that stands for a fit of links."""


@overload
def fit(
    files: Paths,
    nodes: str | os.PathLike[str] | None = None,
    law: Literal["rssi", "range"] = "rssi",
    test: Paths = (),
    **options: Any,
) -> Fit: ...
@overload
def fit(
    files: Paths,
    nodes: str | os.PathLike[str] | None = None,
    *,
    law: Literal["log_normal"],
    test: Paths = (),
    **options: Any,
) -> LinkFit: ...
@overload
def fit(
    files: Paths, nodes: str | os.PathLike[str] | None = None, law: str = "rssi", test: Paths = (), **options: Any
) -> Fit | LinkFit: ...
def fit(
    files: Paths, nodes: str | os.PathLike[str] | None = None, law: str = "rssi", test: Paths = (), **options: Any
) -> Fit | LinkFit:
    """Fit a law to recorded readings at known places of a target, or the link `log_normal` to recorded links.

    Args:
        files: CSV files with the columns time (s), node, reading, x, y and perhaps z (m); for links, K7 files. They may
            be compressed (.gz).
        nodes: CSV file with the columns id, x, y and perhaps z (m) of the nodes, in the order of the deployment. For
            links it may be left out: then no path loss is fitted.
        law: `rssi` (dBm), `range` (m) or `log_normal`, the link.
        test: files on which the fitted law is judged.
        **options: for readings, fields of `FitOptions` (gains, heights, noise, block, seed, in_sample) and of
            `ReadingOptions` (columns, tracks, skip_bad_rows); for links, of `LinkOptions` (power, frame, columns,
            skip_bad_rows, seed, in_sample).

    Returns:
        A `Fit`, whose `sensor` is the block of a scenario, or a `LinkFit`, whose `link` is. Their `values` have
        intervals, and `test` has the held-out figures.

    Raises:
        UsageError: an option is unknown, or a test file is one of the fitted files and `in_sample` is not set.
        RunError: a file cannot be used, or the readings do not determine the law; the message names file and line.
    """
    paths = _paths(files)
    if not paths:
        raise UsageError("fit needs at least one file")
    nodes_path = None if nodes is None else os.fspath(nodes)
    if law == LINKS:
        (link_options,) = _split(options, LinkOptions)
        return fit_links(paths, nodes_path, _paths(test), link_options)
    if law in UNFITTED:
        raise UsageError(f"law {law} cannot be fitted: {UNFITTED[law]}; these can: {', '.join([*LAWS, LINKS])}")
    if law not in LAWS:
        raise UsageError(f"unknown law '{law}' ({did_you_mean(law, [*LAWS, LINKS])})")
    if nodes_path is None:
        raise UsageError(f"law {law} needs the file of the nodes: nodes")
    options |= {"tracks": _paths(options.get("tracks", ()))}
    reading_options, fit_options = _split(options, ReadingOptions, FitOptions)
    return fit_readings(paths, nodes_path, LAWS[law], _paths(test), reading_options, fit_options)


def _split(options: dict[str, Any], *kinds: type[Any]) -> tuple[Any, ...]:
    """The options as objects of these classes: each object gets the options that are fields of its class."""
    known = [{field.name for field in dataclasses.fields(kind)} for kind in kinds]
    names = set().union(*known)
    for name in options:
        if name not in names:
            raise UsageError(f"fit: unknown option '{name}' ({did_you_mean(name, names)})")
    return tuple(
        kind(**{name: value for name, value in options.items() if name in own})
        for kind, own in zip(kinds, known, strict=True)
    )


def _paths(files: Paths) -> list[str]:
    return [os.fspath(files)] if isinstance(files, str | os.PathLike) else [os.fspath(file) for file in files]
