"""Information from a campaign's folder: progress, settings, baseline, the runs that points need, and code changes.

info(path) -> dict        info_text(path) -> str        as `wsnsim info DIR` shows them
baseline_point(manifest, by, wanted) -> its label      label(values) -> text
code_json(folder) -> dict        code_lines(folder) -> [str, ...], both empty unless a change of the code was accepted
ReplicateCounts(folder, manifest): a fixed number of runs, or until the median of a metric is precise enough

A baseline is the point with which others are compared. Modules that are slow to import are imported where needed.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from pathlib import Path
from typing import Any, Final, final

import numpy as np

from wsnsim.analysis.phrases import fitting
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.recording import read_text
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.scenario.sweep_schema import Plan, StoppingRule

SCENARIO: Final = "scenario"
"""The swept key of a sweep over several scenarios."""


def baseline_point(manifest: Plan | Manifest, by: Sequence[str], wanted: str | None) -> str | None:
    """The wanted baseline, or else the campaign's first point; None if nothing is compared.

    Raises:
        UsageError: there is no such point, or a baseline is wanted and nothing is compared.
    """
    names = [label(point.settings.get(key) for key in by) for point in manifest.points]
    if wanted is None:
        return names[0] if by else None
    if not by:
        raise UsageError(f"a baseline requires a key to compare by: --by {' or '.join(manifest.keys)}")
    if wanted not in names:
        raise UsageError(f"{manifest.name} has no point '{wanted}' ({did_you_mean(wanted, set(names))})")
    return wanted


def keys_by_default(keys: Sequence[str]) -> tuple[str, ...]:
    """The keys compared by default: the scenarios if there are several, or else the only swept key."""
    return (SCENARIO,) if SCENARIO in keys else tuple(keys) if len(keys) == 1 else ()


def label(values: Iterable[Any]) -> str:
    """Values of settings as a short text."""
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


def point_name(keys: Sequence[str], values: Sequence[Any]) -> str:
    """A point in a sentence: its values of these keys, and the keys themselves if it would begin with a number."""
    text = label(values)
    return f"{', '.join(keys)} = {text}" if text[:1].isdigit() else text


UNKNOWN: Final = "unknown"
MAX_NAMED: Final = 8
"""Changed files that a line names."""


def code_json(folder: Folder) -> dict[str, Any]:
    """The accepted changes of the code and {digest of the code: number of runs}; {} if there was no change."""
    changes = folder.manifest().code_changes
    if not changes:
        return {}
    found: Counter[str] = Counter()
    for batch in (batch for point in folder.manifest().points for batch in folder.batches(point.id)):
        found[_code_of(batch.path)] += batch.last - batch.first + 1
    return {"code_changes": [dict(change) for change in changes], "runs_by_code": dict(found)}


def code_lines(folder: Folder) -> list[str]:
    """Lines on the accepted changes of the code, and on how many runs each code made."""
    about = code_json(folder)
    if not about:
        return []
    runs = ", ".join(f"{count} by code {code}" for code, count in about["runs_by_code"].items())
    found = [f"code         accepted changes; runs: {runs}"]
    for change in about["code_changes"]:
        files = change.get("changed") or ["unknown files"]
        found.append(f"  {change.get('time')}: {change.get('before')} to {change.get('after')}: {shortened(files)}")
    return found


def shortened(names: Sequence[str]) -> str:
    """The names in one line; of many, the first ones."""
    more = len(names) - MAX_NAMED
    return ", ".join(names[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")


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
        **{key: getattr(manifest, key) for key in ("block", "until", "timeout", "wsnsim_version")},
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
    for point in points[:MAX_LINES]:
        settings = ", ".join(f"{key} = {label([value])}" for key, value in point["settings"].items())
        runs = f"{point['done']:>5} of {point['replicates']:<5}"
        lines.append(f"  {point['id']}  {runs}  {settings or 'the scenario unchanged'}")
    if len(points) > MAX_LINES:
        lines.append(f"  and {len(points) - MAX_LINES} more points")
    failed = list(about["failed"].items())
    lines += [f"  failed: {task}: {why.splitlines()[0] if why else ''}" for task, why in failed[:MAX_LINES]]
    return fitting(lines, " " * 13)


PATIENCE: Final = 60.0
"""Seconds to wait for a file that another machine wrote; network file systems may take tens of seconds."""
POLL: Final = 0.5
"""Seconds between two attempts to find it."""


@final
class ReplicateCounts:
    """The number of runs that each point is to have, from the files on disk alone."""

    def __init__(self, folder: Folder, manifest: Manifest) -> None:
        self._folder = folder
        self._rule = StoppingRule.model_validate(manifest.until) if manifest.until else None

    def first(self, point: PointOnDisk) -> int:
        """The number of runs before the first decision."""
        return self._rule.at_least if self._rule else point.replicates

    def next(self, point: str, replicates: int) -> int:
        """The number of runs that the point is to have, given that it has `replicates`; if equal, these are enough.

        The metric of failed runs does not count. If more than half failed, no more are made: they would fail as well.

        Raises:
            ResultError: a run cannot be read.
        """
        if self._rule is None or replicates >= self._rule.at_most:
            return replicates
        failed = {number for number in self._folder.given_up(point) if number < replicates}
        if 2 * len(failed) > replicates:
            return replicates
        from wsnsim.analysis import statistics  # slow to import, and only a rule needs it

        median, low, high, _ = statistics.median(self._values(point, replicates, failed))
        is_precise = 0.5 * (high - low) <= self._rule.half_width * abs(median)
        return replicates if is_precise else self._rule.next_look(replicates)

    def wanted(self, point: PointOnDisk) -> int:
        """The number of runs that the point is to have, as far as the files on disk decide it."""
        target = self.first(point)
        # only when all runs up to the target are done or have failed can the rule decide on more
        while self._folder.given_up(point.id).issuperset(self._folder.missing(point.id, target)):
            more = self.next(point.id, target)
            if more == target:
                break
            target = more
        return target

    def missing(self, point: PointOnDisk) -> list[int]:
        """The numbers of the runs that are missing on disk."""
        return self._folder.missing(point.id, self.wanted(point))

    def _values(self, point: str, replicates: int, failed: Set[int]) -> Floats:
        """The metric of every run that did not fail, once all of their files are visible."""
        from wsnsim.analysis import campaigns  # slow to import, and only a rule needs it

        assert self._rule is not None
        until = time.monotonic() + PATIENCE
        counted = np.array([number not in failed for number in range(replicates)])
        while True:
            values, seen = campaigns.metric(self._folder, point, self._rule.metric, replicates)
            if seen[counted].all():
                return np.asarray(values[counted])
            if time.monotonic() > until:
                raise ResultError(
                    f"{self._folder.path / point}: replicate {int(np.argmax(counted & ~seen))} is missing"
                )
            time.sleep(POLL)
