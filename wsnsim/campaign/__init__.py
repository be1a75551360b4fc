"""Many points, many replicates: begun, gone on with, divided, and brought together; on disk exactly once.

    folder = begin(load_sweep("particles"), "results/particles")     the manifest and the scenarios are on disk
    ended = drive(folder, LocalPool(2))                              what is missing is run
    collect([Folder("a"), Folder("b")], Folder("all"))               the parts of other machines

What a campaign needs to go on after any death of any process is on disk; see `recording.folder`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from wsnsim.analysis.stopping import ReplicateCounts
from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.campaign.accounts import ALL, Ended, Part, Progress
from wsnsim.campaign.drive import drive
from wsnsim.recording import provenance
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk, runs_of
from wsnsim.recording.layout import reason
from wsnsim.scenario.sweep_schema import Plan

__all__ = [
    "ALL",
    "Ended",
    "Part",
    "Progress",
    "begin",
    "collect",
    "drive",
    "earlier",
    "go_on",
    "missing",
    "missing_words",
    "sweep",
]


def begin(
    plan: Plan, path: str | Path, *, by: Sequence[str] = (), baseline: str | None = None, command_line: str = ""
) -> Folder:
    """The folder of a campaign, its manifest and scenarios in place. What an earlier campaign left in it is kept.

    Raises:
        UsageError: the folder cannot be written, holds something else, or was begun by another wsnsim.
    """
    folder = Folder(path)
    before = earlier(folder, plan.name)
    _demand_writable(folder.path)
    points = tuple(PointOnDisk(point.id, point.settings, point.world, plan.replicates) for point in plan.points)
    manifest = Manifest(
        name=plan.name,
        keys=plan.keys,
        points=points,
        block=before.block if before else plan.block,
        wsnsim_version=__version__,
        by=tuple(by),
        baseline=baseline,
        until=plan.until.model_dump() if plan.until else None,
        timeout=plan.timeout,
        source=plan.source,
        provenance=provenance(command_line, 0),
    )
    for point in plan.points:
        folder.write_scenario(point.id, point.resolved)
    folder.write_manifest(manifest)
    return folder


def go_on(path: str | Path) -> Folder:
    """The folder of a campaign that was begun.

    Raises:
        ResultError: it holds none. UsageError: it was begun by another wsnsim, or cannot be written.
    """
    folder = Folder(path)
    _demand_version(folder, folder.manifest())
    _demand_writable(folder.path)
    return folder


def sweep(
    source: str | Path | Mapping[str, Any] | Sequence[str],
    *,
    out: str | Path,
    vary: Sequence[str] = (),
    overrides: Sequence[str] = (),
    replicates: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Ended:
    """Run a sweep, or go on with it, from Python; `wsnsim.read(out, "runs")` and `wsnsim.compare(out)` give results.

    `source` is a sweep's file or shipped name, a dict that says the same ({"scenario": "pso_mhpf", "grid":
    {"tracker.particles": [100, 200]}}), or scenarios, with axes in `vary`. In a script, call it under
    `if __name__ == "__main__":`, as worker processes import the script.

    Raises:
        ScenarioError, UsageError: nothing was run. What fails later is in what is returned.
    """
    import multiprocessing

    from wsnsim.campaign.cluster import DaskCluster
    from wsnsim.campaign.local import LocalPool, cores
    from wsnsim.scenario.sweep import load_sweep

    if multiprocessing.parent_process() is not None:
        raise UsageError("a worker process imports this script: call wsnsim.sweep under if __name__ == '__main__':")
    plan = load_sweep(source, vary, overrides, replicates=replicates)
    folder = begin(plan, out, command_line="wsnsim.sweep")
    engine = DaskCluster(folder.path, scheduler) if scheduler else LocalPool(workers or cores())
    return drive(folder, engine, watch=progress)


def collect(parts: Sequence[Folder], into: Folder) -> Manifest:
    """Bring the results of campaigns' folders together in one; what is there already is not touched.

    Raises:
        UsageError: a folder holds another campaign, or its results are of another wsnsim.
        StorageError: they cannot be written.
    """
    manifests = [part.manifest() for part in parts]
    first = into.manifest() if into.holds_campaign() else manifests[0]
    for part, manifest in zip(parts, manifests, strict=True):
        for what, one, other in _identity(first, manifest):
            if one != other:
                raise UsageError(
                    f"{part.path} holds another campaign: its {what} differ ({_short(other)}, not {_short(one)})"
                )
    if not into.holds_campaign():
        _demand_free(into)
    _demand_writable(into.path)
    most = {point.id: max(m.point(point.id).replicates for m in [first, *manifests]) for point in first.points}
    for part in parts:
        for point in first.points:
            _take_over(part, into, point.id)
    points = tuple(replace(point, replicates=most[point.id]) for point in first.points)
    merged = replace(first, points=points)
    into.write_manifest(merged)
    return merged


def missing(folder: Folder) -> dict[str, list[int]]:
    """What a campaign lacks, by point: a point's replicates, or those that its stopping rule asks for."""
    manifest = folder.manifest()
    rule = ReplicateCounts(folder, manifest)
    found = {point.id: rule.missing(point) for point in manifest.points}
    return {point: numbers for point, numbers in found.items() if numbers}


def missing_words(missing: Mapping[str, Iterable[int]], manifest: Manifest, most: int = 10) -> list[str]:
    """A line a point: which of its replicates are missing."""
    lines = []
    for point, numbers in list(missing.items())[:most]:
        said = ", ".join(f"{key} = {value}" for key, value in manifest.point(point).settings.items())
        spans = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs_of(sorted(numbers), 10**9))
        lines.append(f"  {said or point}: replicates {spans}")
    if len(missing) > most:
        lines.append(f"  and {len(missing) - most} points more")
    return lines


def earlier(folder: Folder, name: str) -> Manifest | None:
    """The manifest of the campaign of this name that the folder holds; None if it holds nothing.

    Raises:
        UsageError: it holds something else, or was begun by another wsnsim.
    """
    if not folder.holds_campaign():
        try:
            _demand_free(folder)
        except UsageError:
            if not folder.holds_campaign():  # another part may have begun it in this moment
                raise
        return None if not folder.holds_campaign() else earlier(folder, name)
    manifest = folder.manifest()
    if manifest.name != name:
        raise UsageError(
            f"{folder.path} holds the campaign '{manifest.name}', not '{name}'; give another folder with --out"
        )
    _demand_version(folder, manifest)
    return manifest


def _demand_free(folder: Folder) -> None:
    """The folder holds nothing; or scenarios alone, of a campaign that was killed before it had a manifest."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is a file; a campaign needs a folder")
    if path.is_dir() and not folder.is_bare():
        raise UsageError(f"{path} is not empty, and holds no campaign; give a new folder with --out")


def _demand_version(folder: Folder, manifest: Manifest) -> None:
    if manifest.wsnsim_version != __version__:
        raise UsageError(
            f"{folder.path} was begun by wsnsim {manifest.wsnsim_version}, and this is {__version__}: their results are"
            " not to be mixed; give another folder with --out"
        )


def _demand_writable(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise UsageError(f"cannot write {path}: {reason(error)}") from None


def _identity(one: Manifest, other: Manifest) -> list[tuple[str, object, object]]:
    """What must be equal for two folders to hold parts of one campaign."""
    names = ("name", "block", "until", "wsnsim_version")
    pairs: list[tuple[str, object, object]] = [(name, getattr(one, name), getattr(other, name)) for name in names]
    points: tuple[object, ...] = tuple([point.id for point in manifest.points] for manifest in (one, other))
    return [*pairs, ("points", *points)]  # type: ignore[list-item]


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) < 60 else f"{text[:56]} ..."


def _take_over(part: Folder, into: Folder, point: str) -> None:
    """Copy a point's files that are not there yet, each whole or not at all."""
    if part.path.resolve() == into.path.resolve():
        return
    into.write_scenario(point, part.scenario(point))
    done = into.done(point)
    for batch in part.batches(point):
        if done >= set(range(batch.first, batch.last + 1)):
            continue
        into.copy_in(batch, point)
