"""Which plug-ins may be imported for the kinds that a text names. Only this module decides.

    permit("tracker", "mylab:Mine", Plugins.ANY, folder)      raises PluginRefused, or makes the module findable

A permission belongs to a text (`located_values.Origin`): what the caller writes may name any module, what a result or a
campaign's folder holds may name kinds of installed packages, and a text that is only to be shown may name none.
"""

from __future__ import annotations

import contextlib
import enum
import importlib.machinery
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.plugin_code import PluginImport, announce
from wsnsim.scenario.registry import AT_TOP, ROLES, SEARCHED, kinds, search


class Plugins(enum.IntEnum):
    """Which plug-ins a text may name: none, kinds that installed packages offer, or also any 'module:Class'."""

    NONE = 0
    INSTALLED = 1
    ANY = 2


class PluginAccess(NamedTuple):
    """The permission of a campaign's workers, and folders in which they also look for modules."""

    plugins: Plugins = Plugins.INSTALLED
    folders: tuple[str, ...] = ()


ACCESS_OF_FILES: Final = PluginAccess()
"""What a scenario may import that comes from a folder or a result."""


class PluginRefused(LookupError):
    """A text names a plug-in that it may not name."""


def permit(role: str, kind: str, plugins: Plugins, folder: Path, of_file: bool = False) -> None:
    """Make sure that a text in a folder, which may name `plugins`, may name a kind, and that its module can be found.

    The folder and the working directory are searched after Python's path, so that no file there can stand
    in for a module of Python or of an installed package.

    Raises:
        PluginRefused: the text may not name it.
        ImportError: another module of the same name would be imported than that beside the text, which is `of_file`.
    """
    needed, module = _needed(role, kind)
    if needed is Plugins.NONE:
        return
    if needed > plugins:
        raise PluginRefused(_refusal(kind))
    top = module.partition(".")[0]
    if needed is Plugins.ANY:
        search([str(folder), ""])
        if of_file:
            _demand_unambiguous(kind, top, folder)
    announce(PluginImport(role, kind, module, _file_of(top)))


def access(plugins: Plugins) -> PluginAccess:
    """Return a permission for workers, with the folders that this process searches."""
    if plugins is Plugins.ANY:
        search([""])
    return PluginAccess(plugins, tuple(SEARCHED) if plugins is Plugins.ANY else ())


def refused(resolved: Mapping[str, Any], plugins: Plugins) -> str:
    """Return why a scenario's values cannot be loaded with a permission; '' if they can. Nothing is imported."""
    for key, role in AT_TOP.items():
        held = resolved.get(key)
        for component in held if isinstance(held, list | tuple) else [held]:
            kind = component.get("kind") if isinstance(component, Mapping) else None
            if isinstance(kind, str) and _needed(role.name, kind)[0] > plugins:
                return f"{key}.kind: {_refusal(kind)}"
    return ""


def _refusal(kind: str) -> str:
    return f"needs plug-in {kind}; --plugins allows it (in Python: plugins=True)"


def is_missing(kind: str, error: BaseException | None) -> bool:
    """Return whether an import failed because the module of a 'module:Class' does not exist."""
    missing = getattr(error, "name", None) if isinstance(error, ModuleNotFoundError) else None
    return ":" in kind and missing is not None and f"{_module(kind)}.".startswith(f"{missing}.")


def not_found(kind: str, folder: Path) -> str:
    """Return where a module was looked for that does not exist."""
    place = folder.resolve()
    beside = "" if place == Path.cwd() else f"beside the scenario ({place}), "
    return f"{kind}: there is no module '{_module(kind)}' {beside}in the working directory or on Python's path"


def _module(kind: str) -> str:
    return kind.partition(":")[0]


def _needed(role: str, kind: str) -> tuple[Plugins, str]:
    """Return the permission that a kind needs, and its module; NONE for a built-in kind and for an unknown one."""
    if ":" in kind:
        return Plugins.ANY, _module(kind)
    if any(info.kind == kind for info in ROLES[role].kinds):
        return Plugins.NONE, ""
    info = kinds(role).get(kind)
    return (Plugins.INSTALLED, _module(info.path)) if info else (Plugins.NONE, "")


def _demand_unambiguous(kind: str, top: str, folder: Path) -> None:
    found, beside = _file_of(top), None
    with contextlib.suppress(OSError, ValueError):  # a name that no file can have
        named = (folder / f"{top}.py", folder / top / "__init__.py")
        beside = next((path.resolve() for path in named if path.is_file()), None)
    if beside and found and beside != Path(found).resolve():
        raise ImportError(f"{kind}: Python imports {found}, not {beside} beside the scenario: rename the latter")


def _file_of(top: str) -> str:
    """Return the file of a module without dots, '' if it is unknown. Nothing is imported."""
    spec: Any = None
    with contextlib.suppress(Exception):  # finders of other packages, and names that no module can have
        spec = sys.modules[top].__spec__ if top in sys.modules else importlib.machinery.PathFinder.find_spec(top)
    return str(getattr(spec, "origin", None) or "")
