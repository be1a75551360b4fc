"""Datasheets: files that hold the fields of a component within a component, such as the radio of an energy model.

    with_fields(tree, models) -> (tree with the fields of datasheets in place of their names, issues)
    datasheet(path) -> the values of a datasheet, each with its source

A datasheet is a YAML file whose key `sheet` says what it describes: `radio: cc2420` refers to cc2420.yaml with
`sheet: radio`, beside the scenario or among the datasheets that come with wsnsim. Its key `sources` gives the source of
each value. All other keys are fields of the component. A class whose `sheet` is '' has no datasheets.

    with_radio(scenario) -> the scenario with what the radio's datasheet says of the link and the MAC

This takes the place of defaults that nobody wrote. A value that a scenario writes stays, and the energy model refuses
it if the radio contradicts it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean
from wsnsim.scenario.fields import PartError, PartModel, abouts_of, described, nested_model, nested_of
from wsnsim.scenario.files import content_of, find_sheet, sheets
from wsnsim.scenario.located_values import BROKEN, Keys, LocatedValue, assigned, at, child, mapping, plain
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.reader import origin_of, read
from wsnsim.scenario.registry import AT_TOP, ROLES, kinds, load_class
from wsnsim.scenario.schema import Chosen, InvalidComponent, Scenario, built
from wsnsim.scenario.units import shown

OWN_KEYS: Final = ("sheet", "sources")
"""Keys of a datasheet that are not fields of the component."""


@dataclass(frozen=True)
class SheetValue:
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


@dataclass(frozen=True)
class Datasheet:
    """The content of a datasheet: what it describes (radio, processor, ...), the component and each of its values."""

    sheet: str
    file: Path
    part: Any
    values: tuple[SheetValue, ...]


@dataclass(frozen=True)
class _SheetTree:
    """The tree of a datasheet: the value of `sheet`, the fields, and `sources` (None if missing)."""

    sheet: LocatedValue
    fields: LocatedValue
    sources: LocatedValue | None


def with_fields(tree: LocatedValue, chosen: Chosen) -> tuple[LocatedValue, list[Issue]]:
    """Return the tree with the fields of datasheets in place of their names, and the issues of these datasheets."""
    issues: list[Issue] = []
    for key, models in chosen:
        for i, model in enumerate(models):
            path = (key, i) if key == AT_TOP[key].listed else (key,)
            component: Any = model.part if model else None
            for field, part in nested_of(component).items() if component else ():
                node, sheet = at(tree, (*path, field)), getattr(part, "sheet", field)
                if sheet and node is not None and not isinstance(node.value, dict):
                    fields, found = _fields_of(node, (*path, field), sheet)
                    tree, issues = assigned(tree, (*path, field), fields), issues + found
    return tree, issues


def datasheet(path: Path, plugins: bool = False) -> Datasheet:
    """Return the content of a datasheet.

    Args:
        path: its file.
        plugins: whether it may describe what only installed plug-ins use, which are imported then.

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
        values = model.model_validate(plain(sheet.fields))
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
    texts = plain(sheet.sources) if sheet.sources else {}
    values = []
    for name, about in abouts_of(part).items():
        written = child(sheet.fields, name)
        source = texts.get(name, "the file does not say" if written else "left out")
        as_written = plain(written) if written else getattr(model, name)
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
        return broken, [*issues, node.spot.issue(path, f"{message} ({_known(wanted)})")]
    return sheet.fields, issues + _issues_of_sources(sheet.sources, path, sheet.fields.value)


def _read(file: Path, path: Keys) -> tuple[_SheetTree | None, list[Issue]]:
    """Return the tree of a datasheet, or None if the file is no datasheet, and the issues of the file."""
    content, issues = content_of(file)
    if content is None:
        return None, issues
    tree, issues = read(content, origin_of(file, content, path))
    if tree is None:
        return None, issues
    sheet = child(tree, "sheet")
    if sheet is None or not isinstance(sheet.value, str):
        message = "is not a datasheet: expected a key 'sheet' that says what it describes, such as 'sheet: radio'"
        return None, [*issues, (sheet or tree).spot.issue((*path, "sheet"), message)]
    fields = mapping({key: entry for key, entry in tree.value.items() if key not in OWN_KEYS}, tree.spot)
    return _SheetTree(sheet, fields, child(tree, "sources")), issues


def _issues_of_sources(sources: LocatedValue | None, path: Keys, fields: Any) -> list[Issue]:
    """Return the issues of sources that are not texts or belong to unknown fields."""
    if sources is None or sources.value is BROKEN:
        return []
    here = (*path, "sources")
    if not isinstance(sources.value, dict):
        return [sources.spot.issue(here, f"expected a mapping of fields to texts, got {described(plain(sources))}")]
    issues = []
    for key, entry in sources.value.items():
        if key not in fields:
            issues.append(entry.spot.issue((*here, key), f"unknown field, {did_you_mean(key, fields)}"))
        elif not isinstance(entry.node.value, str) and entry.node.value is not BROKEN:
            issues.append(entry.node.spot.issue((*here, key), f"expected a text, got {described(plain(entry.node))}"))
    return issues


def _known(of: str) -> str:
    return "known: " + (", ".join(sheets(of)) or "none")


def _short(name: str) -> str:
    return shown(name).strip("'")


@functools.cache
def _parts_by_sheet(plugins: bool) -> dict[str, Any]:
    """Return the classes that a datasheet can describe, by the value of `sheet`: those within any kind of any role."""
    found: dict[str, Any] = {}
    for role in ROLES:
        for info in kinds(role).values() if plugins else ROLES[role].kinds:
            try:
                within: Any = load_class(info)
                for field, part in nested_of(within).items():
                    found.setdefault(getattr(part, "sheet", field), part)
            except (ImportError, PartError):
                continue
    found.pop("", None)
    return found


LINK: Final = ("sensitivity", "modulation")
MAC: Final = ("rate", "turnaround")
"""Fields of links and MACs that have the name and the meaning of a value of the datasheet."""
STANDARD_RATE: Final = 250e3
"""The rate in bit/s at which the durations of MACs in symbols (`in_symbols`) have their defaults."""


def with_radio(scenario: Scenario) -> Scenario:
    """Return the scenario with what the radio of its energy model says, where link, MAC and energy model say nothing.

    Durations of the MAC in symbols take as many symbols at the rate of the radio. The output powers of link and energy
    model are one: each follows the other. Where a MAC turns radios off for a shorter time than the usual sleep state
    allows, they are in the state with the least power that they can leave in time.
    """
    energy, link, mac = (getattr(scenario, role, None) for role in ("energy", "link", "mac"))
    radio = getattr(energy, "radio", None)
    rate = getattr(radio, "rate", None)
    if energy is None or link is None or mac is None or not isinstance(rate, float) or rate <= 0.0:
        return scenario
    link = _filled(link, {name: getattr(radio, name, None) for name in LINK})
    mac = _filled(mac, {name: getattr(radio, name, None) for name in MAC})
    link = _filled(link, {"power": getattr(energy, "power", None)})
    energy = _filled(energy, {"power": getattr(link, "power", None)})
    mac = _filled(
        mac, {name: STANDARD_RATE / rate * getattr(mac, name) for name in getattr(mac.part, "in_symbols", ())}
    )
    energy = _in_time(energy, radio, mac)
    return scenario.model_copy(update={"energy": energy, "link": link, "mac": mac})


def _filled(model: PartModel, values: dict[str, Any]) -> PartModel:
    """Return a model with values for the fields that nobody wrote. A default of None means something, and stays."""
    new = {
        name: value
        for name, value in values.items()
        if None not in (value, getattr(model, name, None)) and name not in model.model_fields_set
    }
    return model.model_copy(update=new) if new else model


def _in_time(energy: PartModel, radio: Any, mac: PartModel) -> PartModel:
    """Return an energy model with the sleep state that a MAC needs, unless the usual one will do or one is written."""
    try:
        shortest = getattr(built(mac), "shortest_off", math.inf)
    except InvalidComponent:
        return energy
    states = getattr(radio, "sleep_states", ())
    wakes = dict(zip(states, getattr(radio, "sleep_wakes", ()), strict=False))
    usual = wakes.get(getattr(energy, "sleep_state", None), getattr(radio, "wake", 0.0))
    if not hasattr(energy, "off_state") or "off_state" in energy.model_fields_set or radio.doze + usual <= shortest:
        return energy
    offers = zip(radio.sleep_powers, states, strict=False)
    quick = [offer for offer in offers if radio.doze + wakes.get(offer[1], math.inf) <= shortest]
    return energy.model_copy(update={"off_state": min(quick)[1]}) if quick else energy
