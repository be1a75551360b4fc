"""The progress and settings of a campaign, as `wsnsim info DIR` shows them, and which code made its runs.

info(path) -> dict        info_text(path) -> str
code_json(folder) -> dict        code_lines(folder) -> [str, ...], empty unless a change of the code was accepted
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any, Final

from wsnsim.analysis.baselines import label
from wsnsim.analysis.stopping import ReplicateCounts
from wsnsim.base.errors import ResultError
from wsnsim.recording import read_text
from wsnsim.recording.folder import Folder

UNKNOWN: Final = "unknown"
MAX_NAMED: Final = 8
"""Changed files that a line names."""


def code_json(folder: Folder) -> dict[str, Any]:
    """The accepted changes of the code and {digest of the code: number of runs}; {} if there was no change."""
    changes = folder.manifest().code_changes
    if not changes:
        return {}
    return {"code_changes": [dict(change) for change in changes], "runs_by_code": dict(_runs_by_code(folder))}


def code_lines(folder: Folder) -> list[str]:
    """Lines on the accepted changes of the code, and on how many runs each code made."""
    about = code_json(folder)
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


MAX_LINES: Final = 20
"""The largest number of points, and of failures, that are printed."""


def info(path: str | Path) -> dict[str, Any]:
    """The progress and settings of a campaign as plain values.

    Keys: folder, name, keys, by, points (settings, id, replicates, done), replicates, done, failed ({task: why}),
    files, bytes, block, until, timeout, wsnsim_version, provenance; after an accepted change of the code, code_changes
    and runs_by_code.
    """
    folder = Folder(path)
    manifest = folder.manifest()
    rule = ReplicateCounts(folder, manifest)
    points, files, size = [], 0, 0
    for point in manifest.points:
        batches = folder.batches(point.id)
        files += len(batches)
        size += sum(batch.path.stat().st_size for batch in batches)
        wanted = rule.wanted(point)
        done = wanted - len(folder.missing(point.id, wanted))
        points.append({"settings": point.settings, "id": point.id, "replicates": wanted, "done": done})
    return {
        "folder": str(folder.path),
        "name": manifest.name,
        "keys": list(manifest.keys),
        "by": list(manifest.by),
        "points": points,
        "replicates": sum(point["replicates"] for point in points),
        "done": sum(point["done"] for point in points),
        "failed": folder.failures(),
        "files": files,
        "bytes": size,
        "block": manifest.block,
        "until": manifest.until,
        "timeout": manifest.timeout,
        "wsnsim_version": manifest.wsnsim_version,
        "provenance": dict(manifest.provenance),
        **code_json(folder),
    }


def info_text(path: str | Path) -> str:
    """The progress and settings of a campaign for a terminal."""
    about = info(path)
    provenance, points = about["provenance"], about["points"]
    state = "complete" if about["done"] == about["replicates"] else "incomplete"
    lines = [
        f"{about['folder']}: the campaign {about['name']}, {state}",
        f"runs         {about['done']} of {about['replicates']} done, at {len(points)} points, {about['files']} files,"
        f" {about['bytes'] / 1e6:.1f} MB",
        f"axes         {', '.join(about['keys']) or 'none'}",
        f"made by      wsnsim {about['wsnsim_version']}, Python {provenance.get('python')}",
        f"command      {provenance.get('command_line')}",
        *code_lines(Folder(path)),
        "",
    ]
    lines += [_point_line(point) for point in points[:MAX_LINES]]
    if len(points) > MAX_LINES:
        lines.append(f"  and {len(points) - MAX_LINES} more points")
    failed = list(about["failed"].items())
    lines += [f"  failed: {task}: {why.splitlines()[0] if why else ''}" for task, why in failed[:MAX_LINES]]
    return "\n".join(lines)


def _point_line(point: dict[str, Any]) -> str:
    settings = (
        ", ".join(f"{key} = {label([value])}" for key, value in point["settings"].items()) or "the scenario unchanged"
    )
    return f"  {point['id']}  {point['done']:>5} of {point['replicates']:<5}  {settings}"
