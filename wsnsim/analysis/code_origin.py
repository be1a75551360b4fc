"""Which code made the runs of a campaign, if a change of the code was accepted.

as_json(folder) -> dict        lines(folder) -> [str, ...]
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import ResultError
from wsnsim.recording import read_text
from wsnsim.recording.folder import Folder

UNKNOWN: Final = "unknown"
MAX_NAMED: Final = 8
"""Changed files that a line names."""


def as_json(folder: Folder) -> dict[str, Any]:
    """The accepted changes of the code and {digest of the code: number of runs}; {} if there was no change."""
    changes = folder.manifest().code_changes
    if not changes:
        return {}
    return {"code_changes": [dict(change) for change in changes], "runs_by_code": dict(_runs_by_code(folder))}


def lines(folder: Folder) -> list[str]:
    """Lines on the accepted changes of the code, and on how many runs each code made."""
    about = as_json(folder)
    if not about:
        return []
    runs = ", ".join(f"{count} by code {code}" for code, count in about["runs_by_code"].items())
    found = [f"code         accepted changes; runs: {runs}"]
    for change in about["code_changes"]:
        files = change.get("changed") or ["unknown files"]
        named = ", ".join(files[:MAX_NAMED]) + (f" and {len(files) - MAX_NAMED} more" if len(files) > MAX_NAMED else "")
        found.append(f"  {change.get('time')}: {change.get('before')} to {change.get('after')}: {named}")
    return found


def _runs_by_code(folder: Folder) -> Counter[str]:
    found: Counter[str] = Counter()
    for point in folder.manifest().points:
        for batch in folder.batches(point.id):
            found[_code_of(batch.path)] += batch.last - batch.first + 1
    return found


def _code_of(path: Path) -> str:
    """The digest of the code that made a result file."""
    try:
        return str(json.loads(read_text(path, "provenance_json")).get("code", UNKNOWN))
    except (ResultError, ValueError, AttributeError):
        return UNKNOWN
