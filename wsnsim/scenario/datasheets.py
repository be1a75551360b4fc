"""Datasheets: files that hold the fields of a component within a component, such as the radio of an energy model.

    with_fields(tree, chosen) -> (tree with the fields of datasheets in place of their names, issues)
    datasheet(path) -> the values of a datasheet, each with its source

A datasheet is a YAML file whose key `sheet` says what it describes: `radio: cc2420` refers to cc2420.yaml with
`sheet: radio`, beside the scenario or among the datasheets that come with wsnsim. Its key `sources` gives the source of
each value. All other keys are fields of the component. A class whose `sheet` is '' has no datasheets.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean
from wsnsim.scenario.fields import PartModel, abouts_of, nested_model, nested_of
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.reader import origin_of, read
from wsnsim.scenario.registry import AT_TOP, ROLES, loaded
from wsnsim.scenario.schema import Chosen, InvalidComponent, built
from wsnsim.scenario.texts import BROKEN, Keys, LocatedValue, content_of, find_sheet, sheets
from wsnsim.scenario.units import described, shown

OWN_KEYS: Final = ("sheet", "sources")
"""Keys of a datasheet that are not fields of the component."""


class SheetValue(NamedTuple):
    """One value of a datasheet.

    Attributes:
        field: name of the component's field.
        value: the value in SI units.
        unit: the SI unit; '' for a pure number or a text.
        written: the value as the file writes it.
        about: what the value is.
        source: where the value comes from.
    """

    field: str
    value: Any
    unit: str
    written: Any
    about: str
    source: str


class Datasheet(NamedTuple):
    """The content of a datasheet: what it describes (radio, processor, ...), the component and each of its values."""

    sheet: str
    file: Path
    part: Any
    values: tuple[SheetValue, ...]


class _SheetTree(NamedTuple):
    """The tree of a datasheet: the value of `sheet`, the fields, and `sources` (None if missing)."""

    sheet: LocatedValue
    fields: LocatedValue
    sources: LocatedValue | None


def with_fields(tree: LocatedValue, chosen: Chosen) -> tuple[LocatedValue, list[Issue]]:
    """Return the tree with the fields of datasheets in place of their names, and the issues of these datasheets."""
    issues: list[Issue] = []
    for key, models in chosen:
        for i, model in enumerate(models):
            path = (key, i) if key == AT_TOP[key].listed else (key,)  # roles such as targets are lists
            component: Any = model.part if model else None
            for field, part in nested_of(component).items() if component else ():
                node, sheet = tree.at((*path, field)), getattr(part, "sheet", field)
                if sheet and node is not None and not isinstance(node.value, dict):
                    fields, found = _fields_of(node, (*path, field), sheet)
                    tree, issues = tree.assigned((*path, field), fields), issues + found
    return tree, issues


def datasheet(path: Path, plugins: bool = False) -> Datasheet:
    """Return the content of a datasheet.

    Args:
        path: its file.
        plugins: whether it may describe a component of an installed plug-in; plug-ins are imported then.

    Raises:
        ScenarioError: with every issue of the file.
    """
    sheet, issues = _read(path, ())
    if sheet is None or issues:
        raise ScenarioError(issues)
    known_parts = _parts_by_sheet(plugins)
    part = known_parts.get(sheet.sheet.value)
    if part is None:
        known = did_you_mean(str(sheet.sheet.value), known_parts)
        raise ScenarioError([sheet.sheet.spot.issue(("sheet",), f"unknown kind of datasheet ({known})")])
    model = nested_model(part)
    issues = _issues_of_sources(sheet.sources, (), model.model_fields)
    try:
        values = model.model_validate(sheet.fields.plain())
        instance = built(values)
    except ValidationError as error:
        raise ScenarioError(issues + issues_of(error, model, sheet.fields)) from None
    except InvalidComponent as error:
        raise ScenarioError([*issues, sheet.fields.spot.issue(error.path, str(error))]) from None
    if issues:
        raise ScenarioError(issues)
    return Datasheet(str(sheet.sheet.value), path, instance, _values(part, values, sheet))


def _values(part: type[Any], model: PartModel, sheet: _SheetTree) -> tuple[SheetValue, ...]:
    """Return each value with its source."""
    texts = sheet.sources.plain() if sheet.sources else {}
    values = []
    for name, about in abouts_of(part).items():
        written = sheet.fields.child(name)
        source = texts.get(name, "the file does not say" if written else "left out")
        as_written = written.plain() if written else getattr(model, name)
        values.append(SheetValue(name, getattr(model, name), about.unit, as_written, about.words, source))
    return tuple(values)


def _fields_of(node: LocatedValue, path: Keys, wanted: str) -> tuple[LocatedValue, list[Issue]]:
    """Return the fields of the datasheet that a node names, or a broken node and the reason."""
    broken, name = LocatedValue(BROKEN, node.spot), node.value
    if name is BROKEN or name is None:
        return node, []
    if not isinstance(name, str) or not name:
        message = f"expected the name of a datasheet ({_known(wanted)}) or a mapping, got {described(name)}"
        return broken, [node.spot.issue(path, message)]
    file = find_sheet(name, node.spot.origin.folder)
    if file is None:
        nearest = did_you_mean(name, sheets(wanted))
        return broken, [node.spot.issue(path, f"there is no datasheet '{_short(name)}' of a {wanted} ({nearest})")]
    sheet, issues = _read(file, path)
    if sheet is None:
        return broken, issues
    if sheet.sheet.value != wanted:
        message = f"'{_short(name)}' is a datasheet of a {_short(sheet.sheet.value)}, expected one of a {wanted}"
        return broken, [*issues, node.spot.issue(path, f"{message} ({did_you_mean(name, sheets(wanted))})")]
    return sheet.fields, issues + _issues_of_sources(sheet.sources, path, sheet.fields.value)


def _read(file: Path, path: Keys) -> tuple[_SheetTree | None, list[Issue]]:
    """Return the tree of a datasheet, or None if the file is no datasheet, and the issues of the file."""
    content, issues = content_of(file)
    if content is None:
        return None, issues
    tree, issues = read(content, origin_of(file, content, path))
    if tree is None:
        return None, issues
    sheet = tree.child("sheet")
    if sheet is None or not isinstance(sheet.value, str):
        message = "is not a datasheet: expected a key 'sheet' that says what it describes, such as 'sheet: radio'"
        return None, [*issues, (sheet or tree).spot.issue((*path, "sheet"), message)]
    fields = LocatedValue({key: entry for key, entry in tree.value.items() if key not in OWN_KEYS}, tree.spot)
    return _SheetTree(sheet, fields, tree.child("sources")), issues


def _issues_of_sources(sources: LocatedValue | None, path: Keys, fields: Any) -> list[Issue]:
    """Return the issues of sources that are not texts or belong to unknown fields."""
    if sources is None or sources.value is BROKEN:
        return []
    here = (*path, "sources")
    if not isinstance(sources.value, dict):
        return [sources.spot.issue(here, f"expected a mapping of fields to texts, got {described(sources.plain())}")]
    issues = []
    for key, entry in sources.value.items():
        if key not in fields:
            issues.append(entry.spot.issue((*here, key), f"unknown field, {did_you_mean(key, fields)}"))
        elif not isinstance(entry.node.value, str) and entry.node.value is not BROKEN:
            issues.append(entry.node.spot.issue((*here, key), f"expected a text, got {described(entry.node.plain())}"))
    return issues


def _known(wanted: str) -> str:
    """The names of the datasheets of this kind, for a message."""
    return "known: " + (", ".join(sheets(wanted)) or "none")


def _short(name: str) -> str:
    """A name from a file as a message shows it: without control characters, and cut if long."""
    return shown(name).strip("'")


@functools.cache
def _parts_by_sheet(plugins: bool) -> dict[str, Any]:
    """Return {value of `sheet`: class} of the components within any kind of any role, which datasheets can describe."""
    found: dict[str, Any] = {}
    for role in ROLES:
        for _, component in loaded(role, plugins):
            for field, part in nested_of(component).items():
                found.setdefault(getattr(part, "sheet", field), part)
    found.pop("", None)
    return found
