"""A text becomes a scenario: find the file, lay it on what it extends, lay `--set` on that, check it all.

    load('pso_mhpf', ['link.reach=80 m']) -> Scenario

Nothing heavy is imported before it is used: `wsnsim list` passes through here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean
from wsnsim.scenario.build import resolved

if TYPE_CHECKING:
    from wsnsim.scenario.located_values import LocatedValue, Text
    from wsnsim.scenario.schema import Scenario

Assignment: TypeAlias = "tuple[tuple[str | int, ...], LocatedValue]"
"""A path of keys, and what is laid there."""
LARGEST_FILE: Final = 10_000_000
SUFFIXES: Final = (".yaml", ".yml")


def load(source: str | Path | Mapping[str, Any] | Scenario, overrides: Iterable[str] = ()) -> Scenario:
    """The scenario that a file, a shipped scenario's name or a dict says; a Scenario is given back as it is.

    `overrides`, such as 'link.reach=80 m', are laid on it.

    Raises:
        ScenarioError: with every fault found, each at its place.
    """
    from wsnsim.scenario.schema import Scenario

    if isinstance(source, Scenario):
        return source if not overrides else load(resolved(source), overrides)
    text = gathered(source)
    if text.tree is None:
        raise ScenarioError(text.issues)
    assignments, wrong = assignments_of(overrides)
    return finished(text, assignments, wrong)


class Gathered(NamedTuple):
    """A scenario's text before it is checked: its tree (None if it cannot be read), and where it comes from."""

    tree: LocatedValue | None
    issues: list[Issue]
    origin: tuple[str, str]


def gathered(source: str | Path | Mapping[str, Any]) -> Gathered:
    """The text of a scenario, laid on what it extends; nothing is checked yet."""
    return Gathered(*(_from_dict(source) if isinstance(source, Mapping) else _from_file(source)))


def finished(text: Gathered, assignments: Iterable[Assignment], wrong: Iterable[Issue] = ()) -> Scenario:
    """The scenario that a text says once values are laid on it. Many may be made of one text.

    Raises:
        ScenarioError: with every fault found, those in `wrong` among them.
    """
    from wsnsim.scenario.check import validate
    from wsnsim.scenario.located_values import in_order

    assert text.tree is not None
    changed, unfit = _laid(text.tree, assignments)
    scenario, found = validate(changed)
    issues = [*text.issues, *wrong, *unfit, *found]
    if scenario is None or issues:
        raise ScenarioError(in_order(issues))
    scenario._source = text.origin
    return scenario


def shipped() -> dict[str, Path]:
    """The scenarios that come with wsnsim, by name."""
    return _shipped("*.yaml")


def shipped_parts() -> dict[str, Path]:
    """The data sheets that come with wsnsim, by name."""
    return _shipped("parts/*.yaml")


def shipped_sweeps() -> dict[str, Path]:
    """The sweeps that come with wsnsim, by name."""
    return _shipped("sweeps/*.yaml")


def find(source: str | Path, folder: Path | None = None) -> Path | None:
    """The file of this name (from `folder`, with or without '.yaml'), or else the shipped scenario, or else None."""
    start = Path(source) if folder is None else folder / source
    for path in (start, *(start.with_name(start.name + suffix) for suffix in SUFFIXES if start.name)):
        if path.exists() and not path.is_dir():
            return path
    known = shipped().get(str(source).removesuffix(".yaml"))
    return known or (start if start.is_dir() else None)


def _from_file(source: str | Path) -> tuple[LocatedValue | None, list[Issue], tuple[str, str]]:
    from wsnsim.scenario.located_values import Text

    path = find_or_none(source)
    if path is None:
        return None, [_nowhere(source, Text(str(source), Path()))], ("", "")
    content, issues = content_of(path)
    if content is None:
        return None, issues, ("", "")
    tree, issues = _gathered(path, content, ())
    return tree, issues, (str(path), content)


def _shipped(pattern: str) -> dict[str, Path]:
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "_scenarios", package.parent / "scenarios"):
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob(pattern))}
    return {}


def find_or_none(source: str | Path, folder: Path | None = None) -> Path | None:
    """`find`, where a name that no file can have is one that is not found."""
    try:
        return find(source, folder)
    except (OSError, ValueError):
        return None


def _nowhere(source: str | Path, text: Text) -> Issue:
    from wsnsim.scenario.located_values import Spot

    return Spot(text).issue((), f"there is no such file, and no shipped scenario of this name ({_nearest(source)})")


def _nearest(source: str | Path) -> str:
    return did_you_mean(Path(source).stem, shipped())


def content_of(path: Path) -> tuple[str | None, list[Issue]]:
    """The text of a file; None and a fault if it is no text."""
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST_FILE + 1)
    except IsADirectoryError:
        return None, [Issue((), "is a folder, expected a scenario file", str(path))]
    except OSError as error:
        return None, [Issue((), f"cannot be read: {error.strerror}", str(path))]
    if len(raw) > LARGEST_FILE:
        return None, [Issue((), f"is larger than {LARGEST_FILE // 1_000_000} MB, which no scenario is", str(path))]
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        return None, [Issue((), "is a binary file (or not UTF-8), expected YAML text", str(path))]
    return text, []


def _gathered(path: Path, content: str, through: tuple[Path, ...]) -> tuple[LocatedValue | None, list[Issue]]:
    """The tree of a file, laid on that of the file it extends. `through`: the files that led here."""
    from wsnsim.scenario.located_values import Text
    from wsnsim.scenario.reader import read

    text = Text(str(path), path.parent, tuple(content.splitlines()) or ("",))
    tree, issues = read(content, text)
    if tree is None or not isinstance(tree.value, dict) or "extends" not in tree.value:
        return tree, issues
    return _extended(tree, issues, path.parent, (*through, path.resolve()))


def _extended(
    tree: LocatedValue, issues: list[Issue], folder: Path, through: tuple[Path, ...]
) -> tuple[LocatedValue | None, list[Issue]]:
    from wsnsim.scenario.located_values import mapping, merged

    own = mapping({key: entry for key, entry in tree.value.items() if key != "extends"}, tree.spot)
    node = tree.value["extends"].node
    path = find_or_none(node.value, folder) if isinstance(node.value, str) and node.value else None
    if path is None:
        said = (
            f"there is no scenario {node.value!r}" if isinstance(node.value, str) else "expected the name of a scenario"
        )
        return own, [*issues, node.spot.issue(("extends",), f"{said} ({_nearest(str(node.value))})")]
    if path.resolve() in through:
        return own, [*issues, node.spot.issue(("extends",), f"{path} extends itself")]
    content, wrong = content_of(path)
    base, found = (None, wrong) if content is None else _gathered(path, content, through)
    return (own if base is None else merged(base, own)), [*issues, *found]


def _from_dict(source: Mapping[str, Any]) -> tuple[LocatedValue | None, list[Issue], tuple[str, str]]:
    import yaml

    from wsnsim.scenario.located_values import BROKEN, Text, plain
    from wsnsim.scenario.reader import of_dict

    tree, issues = of_dict(source, Text("", Path.cwd()))
    if tree.value is BROKEN or issues:
        return tree, issues, ("", "")
    written = yaml.safe_dump(plain(tree), sort_keys=False, allow_unicode=True)
    if "extends" not in tree.value:
        return tree, issues, ("", written)
    return *_extended(tree, issues, Path.cwd(), ()), ("", written)


def assignments_of(overrides: Iterable[str]) -> tuple[list[Assignment], list[Issue]]:
    """What 'a.b.c=value' assigns, for each that can be read, and what is wrong with the others."""
    read = [_assignment(override) for override in overrides]
    return [(keys, node) for keys, node, _ in read if node is not None], [
        issue for *_, wrong in read for issue in wrong
    ]


def _laid(tree: LocatedValue, assignments: Iterable[Assignment]) -> tuple[LocatedValue, list[Issue]]:
    """The tree with each value laid on it: whole roles and kinds first, since they replace what a role said before."""
    from wsnsim.scenario.check import with_sheets
    from wsnsim.scenario.located_values import assigned

    issues: list[Issue] = []
    for keys, node in sorted(assignments, key=lambda pair: len(pair[0]) > 1 and pair[0][-1] != "kind"):
        if not isinstance(tree.value, dict):
            continue
        if len(keys) > 2:  # it may reach into a data sheet
            tree = with_sheets(tree)
        try:
            tree = assigned(tree, keys, node)
        except LookupError as error:
            issues.append(node.spot.issue(keys, str(error.args[0])))
    return tree, issues


def _assignment(override: str) -> tuple[tuple[str | int, ...], LocatedValue | None, list[Issue]]:
    from wsnsim.scenario.located_values import Text, dotted
    from wsnsim.scenario.reader import read

    written, sign, value = override.partition("=")
    keys = keys_of(written)
    if not sign or not keys or not value.strip():
        return (), None, [Issue((), "expected KEY=VALUE, such as link.reach='80 m'", f"--set {override}")]
    if keys[0] == "extends":
        return (), None, [Issue((), "'extends' can be written in a file only", f"--set {written}")]
    node, issues = read(value, Text(f"--set {dotted(keys)}", Path.cwd(), (), keys))
    return keys, node, issues


def keys_of(written: str) -> tuple[str | int, ...]:
    """The path that 'targets.0.bound' names; () if it names none."""
    pieces = [piece.strip() for piece in written.split(".")]
    if not all(pieces):
        return ()
    return tuple(int(piece) if piece.isascii() and piece.isdigit() and len(piece) < 10 else piece for piece in pieces)
