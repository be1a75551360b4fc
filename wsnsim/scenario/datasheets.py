"""Data sheets: a part within a part is written as a mapping of its fields, or named by the file that holds them.

    spelt_out(tree, chosen) -> (tree with the sheets' fields in place of their names, faults)    shipped_parts()
    profile(path) -> what a sheet holds, each value with where it comes from

A sheet is a YAML file whose key `sheet` says what of: `radio: cc2420` asks for cc2420.yaml with `sheet: radio`, beside
the scenario or among those that come with wsnsim. Its key `sources` says where each value comes from. The other keys
are the fields of the part.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean
from wsnsim.scenario.load import SUFFIXES, content_of, shipped_parts

TOP: Final = ("sheet", "sources")
"""Keys of a sheet that are no fields of the part."""
SHEET: Final = re.compile(r"^sheet\s*:\s*(\w+)", re.MULTILINE)


@dataclass(frozen=True)
class Value:
    """One value of a sheet: its field, in SI units and as it is written, what it is, and where it comes from."""

    field: str
    value: Any
    unit: str
    written: Any
    about: str
    source: str


@dataclass(frozen=True)
class Profile:
    """What a sheet holds: what of (`sheet`: radio, processor ...), the part, and each of its values."""

    sheet: str
    file: Path
    part: Any
    values: tuple[Value, ...]


def find(name: str | Path, folder: Path) -> Path | None:
    """The file of this name (with or without '.yaml') in a folder, or else the shipped sheet, or else None."""
    start = folder / name
    named = (start,) if start.suffix in SUFFIXES else tuple(Path(f"{start}{suffix}") for suffix in SUFFIXES)
    try:
        found = next((path for path in named if path.is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None
    return found or shipped_parts().get(str(name).removesuffix(".yaml"))


def sheet_of(path: Path) -> str:
    """What a file is a data sheet of; '' if it is none."""
    content, _ = content_of(path)
    said = SHEET.search(content or "")
    return said.group(1) if said else ""


def spelt_out(tree: Any, chosen: Any) -> tuple[Any, list[Issue]]:
    """The tree with the fields of data sheets in place of their names. `chosen`: (key at the top, its models)."""
    from wsnsim.scenario.fields import nested_of
    from wsnsim.scenario.kinds import AT_TOP
    from wsnsim.scenario.located_values import assigned, at

    issues: list[Issue] = []
    for key, models in chosen:
        for i, model in enumerate(models):
            path = (key, i) if key == AT_TOP[key].listed else (key,)
            for field, part in nested_of(model.part).items() if model else ():
                node = at(tree, (*path, field))
                if node is not None and not isinstance(node.value, dict):
                    found, wrong = _in_place_of(node, (*path, field), getattr(part, "sheet", field))
                    tree, issues = assigned(tree, (*path, field), found), issues + wrong
    return tree, issues


def profile(path: Path) -> Profile:
    """What a sheet holds. Raises ScenarioError with every fault of the file."""
    from pydantic import ValidationError

    from wsnsim.scenario.fields import nested_model
    from wsnsim.scenario.located_values import plain
    from wsnsim.scenario.messages import issues_of
    from wsnsim.scenario.schema import Refused, built

    fields, sources, said, issues = _read(path, ())
    if fields is None or issues:
        raise ScenarioError(issues)
    part = _parts_by_sheet().get(said.value)
    if part is None:
        known = did_you_mean(str(said.value), _parts_by_sheet())
        raise ScenarioError([said.spot.issue(("sheet",), f"nothing has a data sheet of this kind ({known})")])
    model = nested_model(part)
    issues = _wrong_sources(sources, (), model.model_fields)
    try:
        values = model.model_validate(plain(fields))
        made = built(values)
    except ValidationError as error:
        raise ScenarioError(issues + issues_of(error, model, fields)) from None
    except Refused as refused:
        raise ScenarioError([*issues, fields.spot.issue((), str(refused))]) from None
    if issues:
        raise ScenarioError(issues)
    return Profile(str(said.value), path, made, _values(part, values, fields, sources))


def _values(part: type[Any], model: Any, fields: Any, sources: Any) -> tuple[Value, ...]:
    """Each value, its source as the file tells it."""
    from wsnsim.scenario.fields import abouts_of
    from wsnsim.scenario.located_values import child, plain

    texts = plain(sources) if sources else {}
    rows = []
    for name, about in abouts_of(part).items():
        written = child(fields, name)
        source = texts.get(name, "the file does not say" if written else "left out")
        as_written = plain(written) if written else getattr(model, name)
        rows.append(Value(name, getattr(model, name), about.unit, as_written, about.words, source))
    return tuple(rows)


def _in_place_of(node: Any, path: Any, wanted: str) -> tuple[Any, list[Issue]]:
    """The fields that a name stands for, or a broken node and why."""
    from wsnsim.scenario.fields import described
    from wsnsim.scenario.located_values import BROKEN, LocatedValue

    broken, name = LocatedValue(BROKEN, node.spot), node.value
    if name is BROKEN or name is None:
        return node, []
    if not isinstance(name, str) or not name:
        said = f"expected the name of a data sheet ({_known(wanted)}) or a mapping, got {described(name)}"
        return broken, [node.spot.issue(path, said)]
    file = find(name, node.spot.text.folder)
    if file is None:
        nearest = did_you_mean(name, sheets(wanted))
        return broken, [node.spot.issue(path, f"there is no data sheet '{_short(name)}' of a {wanted} ({nearest})")]
    fields, sources, said, issues = _read(file, path)
    if fields is None:
        return broken, issues
    if said.value != wanted:
        message = f"'{_short(name)}' is a data sheet of a {_short(said.value)}, expected one of a {wanted}"
        return broken, [*issues, node.spot.issue(path, f"{message} ({_known(wanted)})")]
    return fields, issues + _wrong_sources(sources, path, fields.value)


def _read(file: Path, path: Any) -> tuple[Any, Any, Any, list[Issue]]:
    """(the fields, the sources or None, the node of `sheet`, faults) of a file; no fields if it is no sheet."""
    from wsnsim.scenario.located_values import Text, child, mapping
    from wsnsim.scenario.reader import read

    content, issues = content_of(file)
    if content is None:
        return None, None, None, issues
    tree, issues = read(content, Text(str(file), file.parent, tuple(content.splitlines()) or ("",), path))
    if tree is None:
        return None, None, None, issues
    said = child(tree, "sheet")
    if said is None or not isinstance(said.value, str):
        message = "is no data sheet: expected a key 'sheet' that says what of, such as 'sheet: radio'"
        return None, None, None, [*issues, (said or tree).spot.issue((*path, "sheet"), message)]
    fields = mapping({key: entry for key, entry in tree.value.items() if key not in TOP}, tree.spot)
    return fields, child(tree, "sources"), said, issues


def _wrong_sources(sources: Any, path: Any, fields: Any) -> list[Issue]:
    """Sources that are no texts, or of fields that there are not."""
    from wsnsim.scenario.fields import described
    from wsnsim.scenario.located_values import BROKEN, plain

    if sources is None or sources.value is BROKEN:
        return []
    here = (*path, "sources")
    if not isinstance(sources.value, dict):
        return [sources.spot.issue(here, f"expected a mapping of fields to texts, got {described(plain(sources))}")]
    issues = []
    for key, entry in sources.value.items():
        if key not in fields:
            issues.append(entry.spot.issue((*here, key), f"there is no such field, {did_you_mean(key, fields)}"))
        elif not isinstance(entry.node.value, str) and entry.node.value is not BROKEN:
            said = f"expected a text, got {described(plain(entry.node))}"
            issues.append(entry.node.spot.issue((*here, key), said))
    return issues


def sheets(of: str) -> dict[str, Path]:
    """The shipped sheets of a radio, of a processor ..., by name."""
    return {name: path for name, path in shipped_parts().items() if sheet_of(path) == of}


def _known(of: str) -> str:
    return "known: " + (", ".join(sheets(of)) or "none")


def _short(name: str) -> str:
    from wsnsim.scenario.units import shown

    return shown(name).strip("'")


@functools.cache
def _parts_by_sheet() -> dict[str, Any]:
    """The classes behind data sheets, by what their sheets are of: those within any kind of any role."""
    from wsnsim.scenario.fields import PartError, nested_of
    from wsnsim.scenario.registry import ROLES, kinds, load_class

    found: dict[str, Any] = {}
    for role in ROLES:
        for row in kinds(role).values():
            try:
                within: Any = load_class(row)
                for field, part in nested_of(within).items():
                    found.setdefault(getattr(part, "sheet", field), part)
            except (ImportError, PartError):
                continue
    return found
