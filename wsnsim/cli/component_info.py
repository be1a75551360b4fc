"""Values with their units, as `wsnsim info` prints them for a datasheet and for a scenario.

For a datasheet: each value as it is written, and its source. For a scenario: what each role is, and of its energy
model, MAC and link the parameters and the values derived from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.radio import Mode, continuous_power
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import RadioSetup
from wsnsim.cli.listing import paragraph, wrapped_table
from wsnsim.scenario import datasheets
from wsnsim.scenario.kind_info import paragraphs_of
from wsnsim.scenario.texts import find_or_none, find_sheet, sheet_of

PACKET: Final = f"{PACKET_BITS // 8} bytes"


class InfoRow(NamedTuple):
    """One value.

    Attributes:
        name: name of the field.
        shown: the value in the text.
        unit: its unit in the text.
        note: description or source, in the last column.
        value: the value in SI units.
        si: its SI unit.
        description: what a datasheet's field is.
    """

    name: str
    shown: str
    unit: str
    note: str
    value: object
    si: str
    description: str = ""

    def as_json(self) -> dict[str, object]:
        """The value in SI units, its unit and its description."""
        return {"value": self.value, "unit": self.si, "what": self.note}


def _text(title: str, note: str, rows: Sequence[InfoRow], grid: Sequence[InfoRow] = ()) -> str:
    """Rows in a table under a title; `note` heads their last column, and `grid` holds lists of equal length."""
    parts = [paragraph(line) for line in title.splitlines()]
    parts.append(wrapped_table(["", "value", "unit", note], [[*row[:4]] for row in rows]))
    if grid:
        heads = [f"{row.name} [{row.unit}]" for row in grid]
        lines = zip(*(row.shown.split(", ") for row in grid), strict=True)
        parts += ["", wrapped_table(heads, [list(line) for line in lines])]
        parts += [paragraph(f"{row.name}: {row.note}", "  ", "    ") for row in grid]
    return "\n".join(parts)


def what_it_is(source: str) -> str:
    """Return 'datasheet' or 'scenario' if the name is that of one, '' if of neither."""
    file = find_sheet(source, Path())
    if file is not None and sheet_of(file):
        return "datasheet"
    return "scenario" if find_or_none(source) is not None else ""


def describe(source: str, as_json: bool, plugins: bool = False) -> str | dict[str, Any]:
    """The values of a datasheet or of a scenario's radio, by its file or name, as text or in SI units.

    Without `plugins`, none is imported.

    Raises:
        ScenarioError: the file is invalid.
        UsageError: there is no such file.
    """
    file = find_sheet(source, Path())
    if file is not None and sheet_of(file):
        return _describe_datasheet(datasheets.datasheet(file, plugins), as_json)
    return _describe_scenario(source, as_json, plugins)


def _describe_datasheet(sheet: datasheets.Datasheet, as_json: bool) -> str | dict[str, Any]:
    given = {value.field: value for value in sheet.values}
    head = [str(given[name].value) for name in ("name", "source") if name in given]
    rows = [
        InfoRow(
            value.field,
            *_number_and_unit(value.written, value.unit),
            value.source,
            value.value,
            value.unit,
            value.about,
        )
        for value in sheet.values
        if value.field not in ("name", "source")
    ]
    lists = {row.name: len(row.value) for row in rows if isinstance(row.value, tuple)}
    grid = [row for row in rows if row.name in lists] if len(lists) > 1 and len(set(lists.values())) == 1 else []
    title = f"{head[0] if head else sheet.file.stem}: a {sheet.sheet}" + (f", from {head[1]}" if head[1:] else "")
    if not as_json:
        return _text(title, "source", [row for row in rows if row not in grid], grid)
    values = {
        row.name: {"value": row.value, "unit": row.si, "what": row.description, "source": row.note} for row in rows
    }
    plain = {"datasheet": sheet.file.stem, "file": str(sheet.file), "sheet": sheet.sheet, "values": values}
    return plain | {name: given[name].value for name in ("name", "source") if name in given}


def _number_and_unit(written: object, unit: str) -> tuple[str, str]:
    """(number, unit) of a text such as '62 mW', or of a list whose items have one unit."""
    if isinstance(written, list | tuple):
        pairs = [_number_and_unit(item, unit) for item in written]
        if len({name for _, name in pairs}) == 1:
            return ", ".join(number for number, _ in pairs), pairs[0][1]
        return ", ".join(" ".join(pair).strip() for pair in pairs), ""
    if isinstance(written, str):
        number, _, name = written.strip().partition(" ")
        return (number, name.strip()) if name else (number, unit)
    return (f"{written:.12g}" if isinstance(written, float) else _number(written)), unit


def _number(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "-", True: "yes", False: "no"}[value]
    if isinstance(value, tuple):
        return ", ".join(_number(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _describe_scenario(source: str, as_json: bool, plugins: bool) -> str | dict[str, Any]:
    from wsnsim.report.scenario_words import in_words
    from wsnsim.scenario import Plugins, build, load, resolved

    loaded = load(source, plugins=Plugins.ANY if plugins else Plugins.NONE)
    setup = build(loaded)
    values = resolved(loaded)
    words = [f"{loaded.name}, in SI units", *(paragraph(": ".join(row), "  ", "    ") for row in in_words(values))]
    texts, plain = ["\n".join(words)], dict[str, Any](resolved=values)
    if not isinstance(setup, RadioSetup):
        return {"scenario": loaded.name, **plain} if as_json else texts[0]
    components = {"energy": setup.energy, "mac": setup.mac, "link": setup.link}
    for role, component in components.items():
        kind = getattr(loaded, role).kind
        fields, derived = list(_fields(component)), list(DERIVED[role](setup))
        title = f"{role}: {kind}. {(type(component).__doc__ or '').partition(chr(10))[0]}"
        sources = list(paragraphs_of(type(component))[2])
        texts.append(_text("\n".join([title, *sources]), "description", fields))
        if derived:
            texts.append(_text(f"{role}: derived values", "description", derived))
        plain[role] = {
            "kind": kind,
            "sources": sources,
            "values": {row.name: row.as_json() for row in fields},
            "derived": {row.name: row.as_json() for row in derived},
        }
    return {"scenario": loaded.name, **plain} if as_json else "\n\n".join(texts)


def _row(name: str, value: object, unit: str, description: str) -> InfoRow:
    return InfoRow(name, _number(value), unit, description, value, unit, description)


def _fields(component: object, prefix: str = "") -> Iterator[InfoRow]:
    """A component's parameters; those of a nested component have its field's name as a prefix."""
    from wsnsim.scenario.fields import abouts_of, nested_of

    kind: Any = type(component)
    nested = nested_of(kind)
    for name, about in abouts_of(kind).items():
        value = getattr(component, name)
        if name in nested and value is not None:
            yield from _fields(value, f"{prefix}{name}.")
        else:
            yield _row(f"{prefix}{name}", value, about.unit, about.words)


def _attributes(component: object, wanted: Sequence[tuple[str, str, str]]) -> Iterator[InfoRow]:
    """The wanted (name, unit, description) that the component has."""
    for name, unit, description in wanted:
        if hasattr(component, name):
            yield _row(name, getattr(component, name), unit, description)


def _derived_energy(setup: RadioSetup) -> Iterator[InfoRow]:
    energy, bits = setup.energy, _on_air(setup.mac)
    crossover = ("crossover", "m", "d0: distance at which free-space loss changes to multipath loss")
    yield from _attributes(energy, [crossover])
    reach = setup.link.reach
    yield _row("packet sent", sum(energy.transmit(bits, reach)), "J", f"{bits} bits on the air over {reach:.4g} m")
    yield _row("packet received", energy.receive(bits), "J", "the same packet at its receiver")
    model = continuous_power(energy)
    if model is not None:
        for mode in (Mode.DORMANT, Mode.AWAKE, Mode.ASLEEP):
            power = model.mode_power(mode)
            description = f"radio {power.radio:.4g} W, processor {power.processor:.4g} W"
            yield _row(f"power {mode.name.lower()}", power.radio + power.processor, "W", description)


def _derived_mac(setup: RadioSetup) -> Iterator[InfoRow]:
    mac: Any = setup.mac
    sizes = (("payload_bits", "bit", "largest payload of a frame"), ("ack_bits", "bit", "acknowledgement on the air"))
    yield from _attributes(mac, sizes)
    bits = _on_air(mac)
    if hasattr(mac, "bits"):
        yield _row("packet", bits, "bit", f"on the air, with a payload of {PACKET}")
    if getattr(mac, "rate", None):
        yield _row("airtime", bits / mac.rate, "s", f"of a packet with a payload of {PACKET}")
    if hasattr(mac, "slot_needed"):
        yield _row("slot_needed", mac.slot_needed(bits), "s", "slot for this packet, guard times included")


def _derived_link(setup: RadioSetup) -> Iterator[InfoRow]:
    link = setup.link
    if "reach" not in vars(link):
        yield _row("reach", link.reach, "m", "distance at which the mean received power equals the sensitivity")
    if math.isfinite(link.audible):
        yield _row("audible", link.audible, "m", "distance beyond which nothing is received")
    floor = ("floor", "dBm", "weaker frames are neither received nor interfere")
    noise = ("noise", "mW", "noise of the receiver, derived from its sensitivity")
    yield from _attributes(link, [floor, noise, ("rounds", "", "rounds of the recording on this channel")])


def _on_air(mac: Any) -> int:
    """Bits on the air of a packet of 12 bytes; only its payload where the MAC has no frames."""
    return int(mac.bits(PACKET_BITS)) if hasattr(mac, "bits") else PACKET_BITS


DERIVED: Final[dict[str, Callable[[RadioSetup], Iterator[InfoRow]]]] = {
    "energy": _derived_energy,
    "mac": _derived_mac,
    "link": _derived_link,
}
