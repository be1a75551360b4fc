"""The registry: the roles of a scenario, every kind of each with plug-ins, its class, and which texts may name it.

Nothing heavy is imported here. A kind comes from the rows of kinds.table, from an installed package (entry-point groups
`wsnsim.trackers`, `wsnsim.motions`, ...: `Role.group`), or from a dotted path given as the kind itself
(`kind: mylab.trackers:Mine`). If names collide, the table wins.

    ROLES: {role name: Role}    AT_TOP: {key at the top of a scenario: Role}
    load_class(find("tracker", "pso_mhpf")) -> the class
    demand_class("tracker", "mylab:Mine", Plugins.ANY, folder)      imports it, if a text may name it

A permission belongs to a text (`texts.Origin`): what the caller writes may name any module, what a result or a
campaign's folder holds may name kinds of installed packages, and a text that is only to be shown may name none. Only
this module decides which plug-ins may be imported.
"""

from __future__ import annotations

import contextlib
import enum
import functools
import importlib
import importlib.machinery
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import UsageError, did_you_mean, nearest, shortened
from wsnsim.base.files import read_sections
from wsnsim.base.plugin_code import PluginImport, announce, note_plugin, plugin_fault
from wsnsim.base.process import streams_kept_open

OFFLINE_ROLES: Final = ("prior", "deploy", "motion", "sensor", "detection", "fault", "tracker")
TARGET_ROLES: Final = (
    "prior", "motion", "sensor", "wakeup", "clusters", "acquire", "detection", "sink", "tracker",
)  # fmt: skip


class Kind(NamedTuple):
    """The description of one kind.

    Attributes:
        kind: Name in a scenario.
        path: Module and class, 'package.module:Class'.
        idea: Description in one line.
        paper: Source.
        state: What a tracker keeps between steps, and where.
        messages: What a tracker sends in a step.
        variants: The options of a tracker that change the method.
        plugin: Name and version of the package that adds the kind; '' if it comes with wsnsim.
    """

    kind: str
    path: str
    idea: str
    paper: str = ""
    state: str = ""
    messages: str = ""
    variants: str = ""
    plugin: str = ""


class Role(NamedTuple):
    """A role of a scenario.

    Attributes:
        name: the role's name, and its key in a scenario.
        purpose: what the role decides.
        port: name of the Protocol that its components satisfy.
        default: the kind of a role that is left out; None: the role must be given.
        kinds: the kinds that come with wsnsim.
        listed: the key of a list of several components, instead of one under the role's name; '' if not allowed.
        optional: the components stand in a list only, and the list may be empty.
        inner: the components stand within others only, such as the management of tracks within a tracker.
    """

    name: str
    purpose: str
    port: str
    default: str | None
    kinds: tuple[Kind, ...]
    listed: str = ""
    optional: bool = False
    inner: bool = False

    @property
    def of_network(self) -> bool:
        """Whether only scenarios with a network use the role."""
        return self.name not in OFFLINE_ROLES

    @property
    def of_targets(self) -> bool:
        """Whether only scenarios with targets use the role."""
        return self.name in TARGET_ROLES

    @property
    def offline_default(self) -> str | None:
        """The kind of the role in a scenario without a network. Default deployment: one node at the origin."""
        return "anchors" if self.name == "deploy" else self.default

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of a scenario under which components of the role stand."""
        return tuple(key for key in ("" if self.optional or self.inner else self.name, self.listed) if key)

    @property
    def plural(self) -> str:
        """The plural of the role's name: trackers, energies, clusters."""
        special = {"energy": "energies", "battery": "batteries"}
        return special.get(self.name) or self.name.removesuffix("s") + "s"

    @property
    def group(self) -> str:
        """The entry-point group through which packages add kinds to the role."""
        return f"wsnsim.{self.plural}"


def _read() -> dict[str, Role]:
    """Return every role by name."""
    found = {}
    for (name, *cells), rows in read_sections(Path(__file__).with_name("kinds.table")):
        purpose, port, default, listed, only, *_ = (*cells, "", "", "")
        kinds = tuple(Kind(*row) for row in rows)
        found[name] = Role(name, purpose, port, default or None, kinds, listed, only == "only", only == "inner")
    return found


ROLES: Final = _read()
AT_TOP: Final = {key: role for role in ROLES.values() for key in role.keys}
"""The role of each key at the top of a scenario."""


class Scope(NamedTuple):
    """Which roles a scenario uses: with or without a network, with or without targets."""

    network: bool = True
    targets: bool = True

    def uses(self, role: Role) -> bool:
        """Return whether a run builds components of the role."""
        scoped = (self.network or not role.of_network) and (self.targets or not role.of_targets)
        return scoped and not role.inner

    def default(self, role: Role) -> str | None:
        """Return the kind of a role that is left out; None: the role must be given."""
        return role.default if self.network else role.offline_default


SEARCHED: Final[list[str]] = []
"""The folders that `search` added to Python's path."""


def role_named(word: str, others: Sequence[str] = ()) -> Role:
    """Return the role of this name, singular or plural. `others`: what else the word may mean.

    Raises:
        UsageError: there is none; the message names the nearest.
    """
    for role in ROLES.values():
        if word in (role.name, role.plural):
            return role
    names = [*(role.plural for role in ROLES.values()), *others]
    near = [ROLES[name].plural if name in ROLES else name for name in nearest(word, [*names, *ROLES])]
    raise UsageError(f"unknown role '{word}' ({did_you_mean(near[0] if near else word, names)})")


def kinds(role: str) -> dict[str, Kind]:
    """Return every kind of a role by name, installed plug-ins included, without importing any of them."""
    own = {info.kind: info for info in ROLES[role].kinds}
    return own | {info.kind: info for info in _installed().get(ROLES[role].group, ()) if info.kind not in own}


def find(role: str, kind: str) -> Kind:
    """Return the description of a kind, or of the class at a dotted path.

    Raises:
        LookupError: there is none; the message names the nearest.
    """
    if ":" in kind:
        return Kind(kind, kind, "")
    own = {info.kind: info for info in ROLES[role].kinds}
    known = own if kind in own else kinds(role)  # only the latter reads what is installed
    if kind not in known:
        raise LookupError(f"unknown {role} '{shortened(kind)}' ({did_you_mean(kind, known)})")
    return known[kind]


def load_class(info: Kind) -> type[Any]:
    """Return the class of a kind.

    Raises:
        ImportError: the import fails, with its reason in one line, or finds something that is not a class.
    """
    module, _, name = info.path.partition(":")
    named = info.path if info.kind == info.path else f"'{info.kind}' ({info.path})"
    note_plugin(module)
    try:
        with contextlib.nullcontext() if module in sys.modules else streams_kept_open():
            found: Any = importlib.import_module(module)
        for step in name.split("."):
            found = getattr(found, step)
    except (Exception, SystemExit) as error:  # whatever a plug-in's module may raise
        reason = plugin_fault(error) or f"{type(error).__name__}: {' '.join(str(error).split())}"
        if isinstance(error, AttributeError) and error.obj is sys.modules.get(module, error):
            classes = [each for each, value in vars(error.obj).items() if isinstance(value, type)]
            reason = f"it has no class {error.name} ({did_you_mean(str(error.name), classes)})"
        if module == "__main__":
            reason = "worker processes cannot see a notebook's classes: give workers=0, or put it into a module"
        raise ImportError(f"{named} cannot be imported: {reason}") from error
    if not isinstance(found, type):
        raise ImportError(f"{named} is not a class")
    return found


def search(folders: Iterable[str]) -> None:
    """Add folders to the end of Python's path, for modules of plug-ins; '' is the working directory."""
    for folder in folders:
        with contextlib.suppress(OSError):  # the working directory may be gone
            path = str(Path(folder).resolve())
            if path not in sys.path:
                sys.path.append(path)
                SEARCHED.append(path)


@functools.cache
def _installed() -> dict[str, tuple[Kind, ...]]:
    """Return the kinds that installed packages add, by group; what lies in a searched folder is not installed."""
    import importlib.metadata  # slow to import, and not needed for the help of a command

    groups: dict[str, tuple[Kind, ...]] = {}
    installed = importlib.metadata.entry_points()  # reads the metadata of every installed package
    for group in (role.group for role in ROLES.values()):
        points = sorted(filter(_is_installed, installed.select(group=group)), key=lambda point: point.name)
        if points:
            groups[group] = tuple(map(_info, points))
    return groups


def _is_installed(point: importlib.metadata.EntryPoint) -> bool:
    return point.dist is None or str(Path(str(point.dist.locate_file(""))).resolve()) not in SEARCHED


def _info(point: importlib.metadata.EntryPoint) -> Kind:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "an installed package"
    return Kind(point.name, point.value, f"plug-in of {package}", plugin=package)


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


def demand_class(role: str, kind: str, plugins: Plugins, folder: Path, of_file: bool = False) -> None:
    """Import the class of a kind that a text in a folder names, if a text that may name `plugins` may name it.

    The folder and the working directory are searched after Python's path, so that no file there can stand
    in for a module of Python or of an installed package.

    Raises:
        PluginRefused: the text may not name it.
        LookupError: there is no such kind.
        ImportError: it cannot be imported, or another module would be than that beside the text (`of_file`).
    """
    needed, module = _needed(role, kind)
    if needed > plugins:
        raise PluginRefused(_refusal(kind))
    top = module.partition(".")[0]
    if needed is Plugins.ANY:
        search([str(folder), ""])
        if of_file:
            _demand_unambiguous(kind, top, folder)
    if needed is not Plugins.NONE:
        announce(PluginImport(role, kind, module, _file_of(top)))
    try:
        load_class(find(role, kind))
    except ImportError as error:
        if _is_missing(kind, error.__cause__):
            raise ImportError(_not_found(kind, folder)) from error
        raise


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


def _is_missing(kind: str, error: BaseException | None) -> bool:
    """Return whether an import failed because the module of a 'module:Class' does not exist."""
    missing = getattr(error, "name", None) if isinstance(error, ModuleNotFoundError) else None
    return ":" in kind and missing is not None and f"{kind.partition(':')[0]}.".startswith(f"{missing}.")


def _not_found(kind: str, folder: Path) -> str:
    """Return where a module was looked for that does not exist."""
    place, module = folder.resolve(), kind.partition(":")[0]
    beside = "" if place == Path.cwd() else f"beside the scenario ({place}), "
    suffix = "; a module is named without .py" * module.endswith(".py")
    return f"{kind}: there is no module '{module}' {beside}in the working directory or on Python's path{suffix}"


def _needed(role: str, kind: str) -> tuple[Plugins, str]:
    """Return the permission that a kind needs, and its module; NONE for a built-in kind and for an unknown one."""
    if ":" in kind:
        return Plugins.ANY, kind.partition(":")[0]
    if any(info.kind == kind for info in ROLES[role].kinds):
        return Plugins.NONE, ""
    info = kinds(role).get(kind)
    return (Plugins.INSTALLED, info.path.partition(":")[0]) if info else (Plugins.NONE, "")


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
