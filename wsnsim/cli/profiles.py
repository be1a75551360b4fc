"""What `wsnsim info` says of a datasheet, and of a scenario's radio: every value with its unit.

    profile(source) -> Profile, with text() and as_json()

Of a datasheet, each value as it is written and where it comes from; of a scenario, the parameters of its energy model,
MAC and link, and what follows from them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.requests import PACKET_BITS
from wsnsim.cli.listing import table
from wsnsim.scenario import datasheets
from wsnsim.scenario.files import find_or_none, find_sheet, sheet_of, shipped, shipped_parts

ROLES: Final = ("energy", "mac", "link")


class Row(NamedTuple):
    """One value: its name, as text prints it, its unit there, and what is said of it; its SI value and SI unit."""

    name: str
    shown: str
    unit: str
    words: str
    value: Any
    si: str
    about: str = ""


@dataclass(frozen=True)
class Section:
    """Rows under a heading; `words` heads their last column; `grid` are columns of equally long lists."""

    title: str
    words: str
    rows: Sequence[Row]
    grid: Sequence[Row] = ()

    def text(self) -> str:
        """The heading and a table; lists of one length as a table of their own."""
        parts = [self.title, table(["", "value", "unit", self.words], [[*row[:4]] for row in self.rows])]
        if self.grid:
            heads = [f"{row.name} [{row.unit}]" for row in self.grid]
            lines = zip(*(row.shown.split(", ") for row in self.grid), strict=True)
            parts += ["", table(heads, [list(line) for line in lines])]
            parts += [f"  {row.name}: {row.words}" for row in self.grid]
        return "\n".join(parts)


@dataclass(frozen=True)
class Profile:
    """What is printed: sections, and the same as plain values."""

    sections: Sequence[Section]
    plain: Mapping[str, Any]

    def text(self) -> str:
        """The sections, one below the other."""
        return "\n\n".join(section.text() for section in self.sections)

    def as_json(self) -> dict[str, Any]:
        """The values in SI units."""
        return dict(self.plain)


def profile(source: str) -> Profile:
    """What is known of a datasheet or of a scenario, by its file or name.

    Raises:
        ScenarioError: with every fault of the file. UsageError: a scenario without a network.
    """
    file = find_sheet(source, Path())
    if file is not None and sheet_of(file):
        return _of_sheet(datasheets.datasheet(file))
    if find_or_none(source) is None:
        nearest = did_you_mean(Path(source).stem, [*shipped(), *shipped_parts()])
        raise UsageError(f"there is no result, scenario or datasheet '{source[:80]}' ({nearest})")
    return _of_scenario(source)


def _of_sheet(sheet: datasheets.Datasheet) -> Profile:
    said = {value.field: value for value in sheet.values}
    head = [str(said[name].value) for name in ("name", "source") if name in said]
    rows = [_sheet_row(value) for value in sheet.values if value.field not in ("name", "source")]
    lists = [row for row in rows if isinstance(row.value, tuple)]
    grid = lists if len(lists) > 1 and len({len(row.value) for row in lists}) == 1 else []
    title = f"{head[0] if head else sheet.file.stem}: a {sheet.sheet}" + (f", from {head[1]}" if head[1:] else "")
    section = Section(title, "where it comes from", [row for row in rows if row not in grid], grid)
    values = {row.name: {"value": row.value, "unit": row.si, "what": row.about, "source": row.words} for row in rows}
    plain = {"part": sheet.file.stem, "file": str(sheet.file), "sheet": sheet.sheet, "values": values}
    return Profile([section], plain | {name: said[name].value for name in ("name", "source") if name in said})


def _sheet_row(value: datasheets.SheetValue) -> Row:
    """A value as the sheet writes it."""
    shown, unit = _written(value.written, value.unit)
    return Row(value.field, shown, unit, value.source, value.value, value.unit, value.about)


def _written(written: Any, unit: str) -> tuple[str, str]:
    """(number, unit) of a text such as '62 mW'; of a list, if all its items have one unit."""
    if isinstance(written, list | tuple):
        pairs = [_written(item, unit) for item in written]
        if len({name for _, name in pairs}) == 1:
            return ", ".join(number for number, _ in pairs), pairs[0][1]
        return ", ".join(" ".join(pair).strip() for pair in pairs), ""
    if isinstance(written, str):
        number, _, name = written.strip().partition(" ")
        return (number, name.strip()) if name else (number, unit)
    return (f"{written:.12g}" if isinstance(written, float) else _number(written)), unit


def _number(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(_number(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _of_scenario(source: str) -> Profile:
    from wsnsim.base.setups import RadioSetup
    from wsnsim.scenario import build, load

    loaded = load(source)
    parts = build(loaded)
    if not isinstance(parts, RadioSetup):
        raise UsageError(f"{source} has no network (network: none): there is no radio to tell of")
    sections, plain = [], {}
    for role in ROLES:
        part, kind = getattr(parts, role), getattr(loaded, role).kind
        fields, derived = list(_fields(part)), list(DERIVED[role](parts))
        title = f"{role}: {kind}. {(type(part).__doc__ or '').partition(chr(10))[0]}"
        sources = _sources(type(part))
        sections.append(Section("\n".join([title, *sources]), "what it is", fields))
        if derived:
            sections.append(Section(f"{role}: what follows", "what it is", derived))
        plain[role] = {
            "kind": kind,
            "sources": sources,
            "values": {row.name: _plain(row) for row in fields},
            "derived": {row.name: _plain(row) for row in derived},
        }
    return Profile(sections, {"scenario": loaded.name, **plain})


def _sources(part: type[Any]) -> list[str]:
    """Where a part's defaults come from: what its docstring says, and those of what it shares with others."""
    paragraphs = (
        " ".join(text.split())
        for owner in part.__mro__
        for text in inspect.cleandoc(vars(owner).get("__doc__") or "").split("\n\n")
    )
    return list(dict.fromkeys(text for text in paragraphs if text.startswith("Source:")))


def _plain(row: Row) -> dict[str, Any]:
    return {"value": row.value, "unit": row.si, "what": row.words}


def _row(name: str, value: Any, unit: str, words: str) -> Row:
    return Row(name, _number(value), unit, words, value, unit, words)


def _fields(part: Any, prefix: str = "") -> Iterator[Row]:
    """A part's parameters, those of parts within it behind the field's name."""
    from wsnsim.scenario.fields import abouts_of, nested_of

    kind: Any = type(part)
    nested = nested_of(kind)
    for name, about in abouts_of(kind).items():
        value = getattr(part, name)
        if name in nested and value is not None:
            yield from _fields(value, f"{prefix}{name}.")
        else:
            yield _row(f"{prefix}{name}", value, about.unit, about.words)


def _of_energy(parts: Any) -> Iterator[Row]:
    energy, bits = parts.energy, _on_air(parts.mac)
    if hasattr(energy, "crossover"):
        yield _row("crossover", energy.crossover, "m", "d0: where free space ends and multipath begins")
    reach = parts.link.reach
    yield _row("packet sent", sum(energy.transmit(bits, reach)), "J", f"{bits} bits on the air over {reach:.4g} m")
    yield _row("packet received", energy.receive(bits), "J", "the same at its receiver")
    if isinstance(energy, ContinuousPower):
        for mode in (Mode.DORMANT, Mode.AWAKE, Mode.ASLEEP):
            draw = energy.draw(mode)
            words = f"radio {draw.radio:.4g} W, processor {draw.processor:.4g} W"
            yield _row(f"draw {mode.name.lower()}", draw.radio + draw.processor, "W", words)


def _of_mac(parts: Any) -> Iterator[Row]:
    mac = parts.mac
    for name, unit, words in (
        ("payload_bits", "bit", "what the longest frame carries"),
        ("ack_bits", "bit", "of an acknowledgement on the air"),
    ):
        if hasattr(mac, name):
            yield _row(name, getattr(mac, name), unit, words)
    bits = _on_air(mac)
    if hasattr(mac, "bits"):
        yield _row("packet", bits, "bit", f"on the air, of a payload of {PACKET_BITS // 8} bytes")
    if getattr(mac, "rate", None):
        yield _row("airtime", bits / mac.rate, "s", f"of a payload of {PACKET_BITS // 8} bytes")
    if hasattr(mac, "slot_needed"):
        yield _row("slot_needed", mac.slot_needed(bits), "s", "slot for it, guards included")


def _of_link(parts: Any) -> Iterator[Row]:
    link = parts.link
    if "reach" not in vars(link):
        yield _row("reach", link.reach, "m", "where the mean received power meets the sensitivity")
    yield _row("audible", link.audible, "m", "beyond it nobody hears anything")
    for name, unit, words in (
        ("floor", "dBm", "weaker frames are neither received nor felt"),
        ("noise", "mW", "of the receiver, which follows from its sensitivity"),
    ):
        if hasattr(link, name):
            yield _row(name, getattr(link, name), unit, words)


def _on_air(mac: Any) -> int:
    """Bits on the air of a packet of 12 bytes: where there are no frames, its payload."""
    return int(mac.bits(PACKET_BITS)) if hasattr(mac, "bits") else PACKET_BITS


DERIVED: Final[dict[str, Callable[[Any], Iterator[Row]]]] = {"energy": _of_energy, "mac": _of_mac, "link": _of_link}
