"""The folder of a campaign: prepared, reopened, merged from shards, and searched for missing replicates."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from wsnsim.analysis.campaign_info import ReplicateCounts, shortened
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.version import __version__
from wsnsim.campaign.code_changes import (
    changed_files,
    code_id,
    code_of_plan,
    demand_same_code,
    noted,
    settled,
)
from wsnsim.recording.atomic_files import reason
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk, consecutive
from wsnsim.recording.provenance import provenance
from wsnsim.scenario.registry import Plugins, refused
from wsnsim.scenario.sweep_schema import Plan

MAX_SHOWN: Final = 56
"""Characters of a differing value in a message."""


def prepare(
    plan: Plan,
    path: str | Path,
    *,
    by: Sequence[str] = (),
    baseline: str | None = None,
    command_line: str = "",
    accept_code_change: bool = False,
) -> Folder:
    """Write the manifest and the scenarios of a campaign. Results of the same campaign in the folder are kept.

    Args:
        plan: the sweep.
        path: the campaign's folder.
        by: keys whose values are to be compared.
        baseline: value from which differences are taken.
        command_line: command line, for the provenance.
        accept_code_change: whether runs may be added to those of other code; the manifest notes it.

    Raises:
        UsageError: the folder cannot be written, holds something else, belongs to another version of wsnsim, or has
            runs of other code, of wsnsim or of a plug-in.
    """
    folder = Folder(path)
    before = existing_manifest(folder, plan.name)
    demand_writable(folder.path)
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
        code=code_of_plan(plan),
    )
    manifest = settled(folder, manifest, before, accept_code_change)
    for point in plan.points:
        folder.write_scenario(point.id, point.resolved)
    folder.write_manifest(manifest)
    return folder


def reopen(path: str | Path, accept_code_change: bool = False) -> Folder:
    """The folder of an existing campaign, checked so that the campaign can be resumed.

    Raises:
        ResultError: the folder holds no campaign.
        UsageError: the campaign belongs to another version of wsnsim, or runs are missing, and the folder cannot be
            written or the others were made by other code.
    """
    folder = Folder(path)
    manifest = folder.manifest()
    _check_version(folder, manifest)
    if not _is_complete(folder):
        demand_writable(folder.path)
    demand_same_code(folder, manifest, lambda: _is_complete(folder), accept_code_change)
    return folder


def collect(shards: Sequence[Folder], into: Folder, accept_code_change: bool = False) -> Manifest:
    """Merge the results of several folders of one campaign. Existing results in `into` are kept.

    Args:
        shards: the folders.
        into: where the results are put together.
        accept_code_change: whether runs of different code may be put together; the manifest notes it.

    Returns:
        The manifest of the merged campaign.

    Raises:
        UsageError: a folder holds another campaign, or results of another version of wsnsim or of other code.
        StorageError: the results cannot be written.
    """
    manifests = [shard.manifest() for shard in shards]
    first = into.manifest() if into.holds_campaign() else manifests[0]
    for shard, manifest in zip(shards, manifests, strict=True):
        _check_same_campaign(first, manifest, shard.path)
        _check_same_code(first, manifest, shard.path, accept_code_change)
    if not into.holds_campaign():
        _check_free(into)
    demand_writable(into.path)
    most = {point.id: max(m.point(point.id).replicates for m in [first, *manifests]) for point in first.points}
    for shard in shards:
        for point in first.points:
            _copy_point(shard, into, point.id)
    points = tuple(replace(point, replicates=most[point.id]) for point in first.points)
    merged = _with_changes(replace(first, points=points), manifests)
    into.write_manifest(merged)
    return merged


def demand_permitted(folder: Folder, plugins: Plugins) -> None:
    """Raise UsageError if runs are missing, and a point's scenario names a plug-in that may not be imported."""
    why = _refused_plugin(folder, plugins)
    if why and missing(folder):
        raise UsageError(f"{folder.path}: {why}")


def needs_permission(folder: Folder) -> bool:
    """Whether a campaign can only be resumed from its folder with the permission to import any plug-in."""
    return bool(_refused_plugin(folder, Plugins.INSTALLED))


def _refused_plugin(folder: Folder, plugins: Plugins) -> str:
    """Why the first point that cannot be loaded with a permission cannot; '' if all can."""
    contents = (json.loads(folder.scenario(point.id)) for point in folder.manifest().points)
    return next(filter(None, (refused(content, plugins) for content in contents)), "")


def missing(folder: Folder) -> dict[str, list[int]]:
    """The missing replicates by point, of a fixed number or of the number that the stopping rule wants."""
    manifest = folder.manifest()
    rule = ReplicateCounts(folder, manifest)
    found = {point.id: rule.missing(point) for point in manifest.points}
    return {point: numbers for point, numbers in found.items() if numbers}


def describe_missing(missing: Mapping[str, Iterable[int]], manifest: Manifest, most: int = 10) -> list[str]:
    """One line per point: its missing replicates."""
    lines = [f"  {_replicates(manifest, point, numbers)}" for point, numbers in list(missing.items())[:most]]
    return [*lines, f"  and {len(missing) - most} more points"] if len(missing) > most else lines


def describe_failed(failed: Mapping[str, str], manifest: Manifest) -> list[str]:
    """One line per point and reason: the replicates that failed. `failed`: {task or point: reason}."""
    found: dict[tuple[str, str], list[int]] = {}
    for task, why in failed.items():
        point, _, span = task.partition(".r")
        number = [int(span.partition("-")[0])] if span else []
        alike = why.replace(f", replicate {number[0]})", ")") if number else why
        found.setdefault((point, alike), []).extend(number)
    return [f"{_replicates(manifest, point, numbers)} failed: {why}" for (point, why), numbers in found.items()]


def _replicates(manifest: Manifest, point: str, numbers: Iterable[int]) -> str:
    """The settings of a point with some of its replicates: 'deploy.nodes = 25: replicates 0-2'."""
    settings = ", ".join(f"{key} = {value}" for key, value in manifest.point(point).settings.items())
    spans = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in consecutive(sorted(numbers), 10**9))
    return f"{settings or point}{f': replicates {spans}' if spans else ''}"


def existing_manifest(folder: Folder, name: str) -> Manifest | None:
    """The manifest of the campaign of this name in the folder, None if the folder is empty.

    Raises:
        UsageError: the folder holds something else, or a campaign of another version of wsnsim.
    """
    if not folder.holds_campaign():
        try:
            _check_free(folder)
        except UsageError:
            if not folder.holds_campaign():  # another process may have just prepared it
                raise
        return None if not folder.holds_campaign() else existing_manifest(folder, name)
    manifest = folder.manifest()
    if manifest.name != name:
        raise UsageError(
            f"{folder.path} holds the campaign '{manifest.name}', not '{name}'; give another folder with --out"
        )
    _check_version(folder, manifest)
    return manifest


def _check_free(folder: Folder) -> None:
    """Raise UsageError unless the folder is empty, or holds only scenarios of a campaign killed at its start."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is a file; a campaign needs a folder")
    if path.is_dir() and not folder.holds_only_scenarios():
        raise UsageError(f"{path} is not empty and holds no campaign; give a new folder with --out")


def _check_version(folder: Folder, manifest: Manifest) -> None:
    if manifest.wsnsim_version != __version__:
        raise UsageError(
            f"{folder.path} was started with wsnsim {manifest.wsnsim_version}, but this is {__version__}: results of"
            " different versions are not mixed; give another folder with --out"
        )


def demand_writable(path: Path, option: str = "") -> None:
    """Create a folder if there is none. Raises UsageError if that fails, or nothing can be written there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise UsageError(f"cannot write {option}{path}: {reason(error)}") from None


def _check_same_campaign(one: Manifest, other: Manifest, path: Path) -> None:
    """Raise UsageError if the manifests of two folders belong to different campaigns."""
    pairs: dict[str, tuple[object, object]] = {
        "name": (one.name, other.name),
        "block": (one.block, other.block),
        "until": (one.until, other.until),
        "wsnsim_version": (one.wsnsim_version, other.wsnsim_version),
        "points": ([point.id for point in one.points], [point.id for point in other.points]),
    }
    for what, (expected, found) in pairs.items():
        if found != expected:
            raise UsageError(
                f"{path} holds another campaign: {what} differs ({_short(found)} instead of {_short(expected)})"
            )


def _check_same_code(one: Manifest, other: Manifest, path: Path, accept: bool) -> None:
    if not accept and code_id(one.code) != code_id(other.code):
        what = shortened(changed_files(one.code, other.code))
        raise UsageError(
            f"{path}: its runs were made by other code than those of the other folders ({what}): accept it with"
            " --accept-code-change (in Python: accept_code_change=True), for example if only comments or texts differ"
        )


def _with_changes(merged: Manifest, shards: Sequence[Manifest]) -> Manifest:
    """The merged manifest with the accepted changes of all shards, and with those between them."""
    changes = {json.dumps(change): change for shard in [merged, *shards] for change in shard.code_changes}
    merged = replace(merged, code_changes=tuple(sorted(changes.values(), key=lambda change: str(change.get("time")))))
    for code in {code_id(shard.code): shard.code for shard in shards}.values():
        known = {change.get(end) for change in merged.code_changes for end in ("before", "after")}
        if code_id(code) != code_id(merged.code) and code_id(code) not in known:
            merged = noted(merged, code, merged.code)
    return merged


def _is_complete(folder: Folder) -> bool:
    try:
        return not missing(folder)
    except ResultError:  # a damaged file, whose runs will be repeated
        return False


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]} ..."


def _copy_point(shard: Folder, into: Folder, point: str) -> None:
    """Copy the files of a point whose replicates are missing in `into`, each as a whole or not at all."""
    if shard.path.resolve() == into.path.resolve():
        return
    into.write_scenario(point, shard.scenario(point))
    done = into.done(point)
    for batch in shard.batches(point):
        if not done >= set(range(batch.first, batch.last + 1)):
            into.copy_in(batch, point)
