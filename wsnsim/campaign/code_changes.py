"""The code that makes a campaign's runs: its digests in the manifest, and what happens when it has changed.

    settled(folder, manifest, before, accept) -> Manifest       the manifest with today's code, or an error
    demand_same_code(folder, manifest, accept)                  of a campaign that is resumed from its folder
    differing_code(manifest) -> str                             in words, what differs

Results of different code are only put together if the user accepts the change, and the manifest notes it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Final

from wsnsim.analysis.campaign_info import shortened
from wsnsim.base.errors import UsageError
from wsnsim.recording.folder import Folder, Manifest
from wsnsim.recording.provenance import PACKAGE, digest_of, module_digests, package_digests
from wsnsim.scenario.fields import roles_of
from wsnsim.scenario.registry import AT_TOP, ROLES, find, load_class
from wsnsim.scenario.sweep_schema import Plan

Code = Mapping[str, Mapping[str, str]]
HOW_TO_ACCEPT: Final = (
    "give another folder with --out, or accept the change with --accept-code-change (in Python:"
    " accept_code_change=True), for example if only comments or texts changed"
)


def code_of_plan(plan: Plan) -> Code:
    """The digests of the code that makes the runs of a sweep, which was checked in this process."""
    return code_of_resolved(json.loads(point.resolved) for point in plan.points)


def code_of_resolved(scenarios: Iterable[Mapping[str, Any]]) -> Code:
    """The digests of the code that makes the runs of resolved scenarios."""
    return code_of({module for resolved in scenarios for module in _plugin_modules(resolved)})


def code_of(plugins: Iterable[str], known: Code | None = None) -> Code:
    """The digests of wsnsim and of the modules of plug-ins. `known` stands in for modules that are not found here."""
    found = {module: module_digests(module) or (known or {}).get(module, {}) for module in sorted(plugins)}
    return {PACKAGE: package_digests(), **found}


def code_id(code: Code) -> str:
    """A digest of all digests, '' if there are none."""
    return digest_of(sorted((part, sorted(files.items())) for part, files in code.items())) if code else ""


def settled(folder: Folder, manifest: Manifest, before: Manifest | None, accept: bool) -> Manifest:
    """The manifest of a campaign that is prepared, with the changes of its code.

    Args:
        folder: the campaign's folder.
        manifest: the new manifest, with today's code.
        before: the manifest that is there, if one is.
        accept: whether a change of the code is accepted.

    Raises:
        UsageError: there are results of other code, and the change is not accepted.
    """
    if before is None:
        return manifest
    manifest = replace(manifest, code_changes=before.code_changes)
    if code_id(before.code) == code_id(manifest.code) or not folder.holds_results(before):
        return manifest
    if not accept:
        raise UsageError(f"{folder.path}: {_why(before.code, manifest.code)}: {HOW_TO_ACCEPT}")
    return noted(manifest, before.code, manifest.code)


def demand_same_code(folder: Folder, manifest: Manifest, is_complete: Callable[[], bool], accept: bool) -> None:
    """Check the code of a campaign that is resumed from its folder, and note an accepted change in its manifest.

    A complete campaign is only shown, whatever its code: see `differing_code`.

    Raises:
        UsageError: the code is another, runs are missing, and the change is not accepted.
    """
    now = code_of(set(manifest.code) - {PACKAGE}, manifest.code)
    if code_id(now) == code_id(manifest.code):
        return
    if not folder.holds_results(manifest):
        folder.write_manifest(replace(manifest, code=now))
    elif accept:
        folder.write_manifest(noted(replace(manifest, code=now), manifest.code, now))
    elif not is_complete():
        raise UsageError(f"{folder.path}: {_why(manifest.code, now)}: {HOW_TO_ACCEPT}")


def differing_code(manifest: Manifest) -> str:
    """In words, how the code that made a campaign's runs differs from that of this process; '' if it does not."""
    now = code_of(set(manifest.code) - {PACKAGE}, manifest.code)
    return "" if code_id(now) == code_id(manifest.code) else _why(manifest.code, now)


def noted(manifest: Manifest, before: Code, after: Code) -> Manifest:
    """The manifest with one more accepted change."""
    change: dict[str, Any] = {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "changed": changed_files(before, after),
        "before": code_id(before),
        "after": code_id(after),
    }
    return replace(manifest, code_changes=(*manifest.code_changes, change))


def changed_files(before: Code, after: Code) -> list[str]:
    """The files that differ: 'wsnsim/trackers/ekf.py', 'mylab.py (new)', 'helper.py (gone)'. Plug-ins come first."""
    was, now = _files(before), _files(after)
    ending = {name: " (new)" if name not in was else " (gone)" if name not in now else "" for name in was | now}
    differing = [name for name in ending if was.get(name) != now.get(name)]
    return [f"{name}{ending[name]}" for name in sorted(differing, key=lambda name: (name.startswith(PACKAGE), name))]


def _why(before: Code, now: Code) -> str:
    return f"its runs were made by other code; changed since: {shortened(changed_files(before, now))}"


def _files(code: Code) -> dict[str, str]:
    return {name: digest for files in code.values() for name, digest in files.items()}


def _plugin_modules(resolved: Mapping[str, Any]) -> set[str]:
    """The modules of the plug-ins that a scenario names."""
    modules = set()
    for key, role in AT_TOP.items():
        held = resolved.get(key)
        for component in held if isinstance(held, list) else [held]:
            modules |= _modules_in(role.name, component)
    return {module for module in modules if module.partition(".")[0] != PACKAGE}


def _modules_in(role: str, component: Any) -> set[str]:
    """The modules of a component's kind and of those of the components within it, if they are plug-ins."""
    kind = component.get("kind") if isinstance(component, dict) else None
    if not isinstance(kind, str):
        return set()
    info = find(role, kind)
    modules = set() if info in ROLES[role].kinds else {info.path.partition(":")[0]}
    if any(isinstance(value, dict | list) for value in component.values()):
        for field, inner in roles_of(load_class(info)).items():
            held = component.get(field)
            for one in held if isinstance(held, list) else [held]:
                modules |= _modules_in(inner.role, one)
    return modules
