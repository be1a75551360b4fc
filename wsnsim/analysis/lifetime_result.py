"""The file of an estimated lifetime: one JSON object with everything that is printed and drawn of it.

Beside the table of criteria it holds the tables `lifetimes` (path, criterion, time in s) and `deaths` (path, node, time
in s, and whether it came back), as columns.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.base.files import read_regular
from wsnsim.base.version import __version__
from wsnsim.recording.atomic_files import reason, write_text_atomically
from wsnsim.recording.provenance import provenance

FORMAT: Final = "wsnsim lifetimes"
SCHEMA: Final = 1
NEVER: Final = ".inf"
KEYS: Final = frozenset({"name", "horizon", "libraries", "criteria", "baseline", "nodes", "causes", "first", "curves"})


def write(place: Path, points: Sequence[Mapping[str, Any]], command_line: str) -> None:
    """Write the outcomes of one or several scenarios. Raises StorageError."""
    content = {
        "format": FORMAT, "schema_version": SCHEMA, "wsnsim_version": __version__,
        "provenance": provenance(command_line, int(points[0]["seed"])), "points": [_plain(point) for point in points],
    }  # fmt: skip
    write_text_atomically(place, json.dumps(content, ensure_ascii=False, allow_nan=False))


def is_lifetime(word: str) -> bool:
    """Whether a word names the file of a lifetime."""
    if not word.endswith(".json"):
        return False
    try:
        with Path(word).open(encoding="utf-8") as file:
            return FORMAT in file.read(len(FORMAT) + 20)
    except (OSError, ValueError):
        return False


def read(place: Path) -> list[dict[str, Any]]:
    """The outcomes in a file. Raises ResultError if it is none of a lifetime."""
    try:
        content = json.loads(read_regular(place))
        points = content["points"]
        if content["format"] != FORMAT or not points or any(KEYS - point.keys() for point in points):
            raise ValueError("keys are missing")
        if content["schema_version"] > SCHEMA:
            raise ResultError(f"{place}: was written by a later version of wsnsim ({content.get('wsnsim_version')})")
        return [_restored(point) for point in points]
    except OSError as error:
        raise ResultError(f"{place}: cannot be read: {reason(error)}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ResultError(f"{place}: is no file of `wsnsim lifetime`, or is damaged: {error}") from error


def settings(place: Path) -> list[Any]:
    """The scenarios of the outcomes in a file; none if it holds no outcomes."""
    try:
        return [point.get("scenario") for point in read(place)]
    except ResultError:
        return []


def _plain(value: Any) -> Any:
    """The value in JSON: lists for arrays, null for NaN, and '.inf' for infinity."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else NEVER if value > 0 else f"-{NEVER}"
    return value


def _restored(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: inner if key == "scenario" else _restored(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_restored(inner) for inner in value]
    return np.nan if value is None else np.inf if value == NEVER else value
