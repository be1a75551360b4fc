"""What `wsnsim info` prints of a kind, a result, a campaign, a datasheet, and a word that names none of these.

answer(["ekf"], plugins, as_json) -> text or plain values
described(["coordinated_turn"]) -> [KindInfo]       kinds_text([KindInfo, ...]) -> the text
word_text("rmse") -> text        word_text("nothing") -> ""

Such a word is a table or a column of results, a key of scenarios, or a command.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from wsnsim.analysis import campaign_info, lifetime_result, lifetime_text
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.tables import RECORDED_BY_DEFAULT, TABLE_MEANINGS, TABLES, Column
from wsnsim.cli import component_info
from wsnsim.cli.listing import listed, paragraph, wrapped_table
from wsnsim.cli.shared import every_command, is_campaign, reading
from wsnsim.recording.folder import Folder
from wsnsim.scenario.fields import PartError
from wsnsim.scenario.kind_info import KindInfo, kind_info, kinds_named
from wsnsim.scenario.registry import AT_TOP, ROLES, find, kinds, role_named, search
from wsnsim.scenario.texts import is_result, shipped, shipped_parts

Answer = str | dict[str, Any]


def answer(words: Sequence[str], plugins: bool, as_json: bool) -> Answer:
    """Return what the words of `wsnsim info` name, as a text or as plain values."""
    if len(words) == 2 and words[0] not in ("scenario", "datasheet"):
        return _kinds(words, as_json) or ""
    return _what(words[-1], plugins, as_json, only_files=len(words) == 2)


def _what(word: str, plugins: bool, as_json: bool, only_files: bool) -> Answer:
    if is_campaign(word):
        return campaign_info.info(word) if as_json else campaign_info.info_text(word)
    if word.endswith(".h5") or is_result(word):
        from wsnsim.analysis import result_info

        with reading(path := Path(word)):
            return result_info.info(path, plugins) if as_json else result_info.info_text(path, plugins)
    if lifetime_result.is_lifetime(word):
        points = lifetime_result.read(Path(word))
        return {"points": points} if as_json else lifetime_text.text(points)
    kinds_found = None if only_files else _kinds((word,), as_json)
    return _file(word, plugins, as_json, only_files) if kinds_found is None else kinds_found


def citing(word: str) -> str:
    """Return the BibTeX entries for a result, a campaign's folder or a scenario."""
    from wsnsim.analysis.citing import bibtex
    from wsnsim.analysis.plot_data import stored_json
    from wsnsim.recording import attributes
    from wsnsim.scenario import load, resolved

    if is_campaign(word):
        manifest = (folder := Folder(word)).manifest()
        return bibtex((json.loads(folder.scenario(point.id)) for point in manifest.points), manifest.wsnsim_version)
    if is_result(word):
        path = Path(word)
        with reading(path):
            return bibtex([stored_json(path, "scenario/resolved_json")], attributes(path)["wsnsim_version"])
    return bibtex([resolved(load(word))])


def _kinds(words: Sequence[str], as_json: bool) -> Answer | None:
    """What the kinds or the role are that words name; None if there are none."""
    if len(words) == 1:
        if _is_path(words[0]):
            return None
        if any(words[0] in (role.name, role.plural) for role in ROLES.values()) and not kinds_named(words[0]):
            return listed(role_named(words[0]).name, as_json)
    found = described(words)
    if not found:
        return None
    what = component_info.what_it_is(words[0]) if len(words) == 1 else ""
    if as_json:
        more: Any = component_info.describe(words[0], as_json) if what else {}
        return {"kinds": [kind.as_json() for kind in found], **more}
    other = f"\n\nThere is also a {what} of this name: wsnsim info {what} {words[0]}" if what else ""
    return kinds_text(found) + other


def _is_path(word: str) -> bool:
    return "/" in word or word.endswith((".yaml", ".yml"))


def _file(word: str, plugins: bool, as_json: bool, only_files: bool) -> Answer:
    if component_info.what_it_is(word):
        return component_info.describe(word, as_json, plugins)
    if text := "" if _is_path(word) else word_text(word):
        return {"word": word, "text": text} if as_json else text
    names = [kind for role in ROLES for kind in kinds(role)]
    columns = (column.name for columns in TABLES.values() for column in columns)
    # keys are left out: to find them, every kind is imported
    names += [*shipped(), *shipped_parts(), *ROLES, *dict.fromkeys([*TABLES, *columns, *every_command()])]
    if (known := in_known_case(word, [*names, *_longer_names()])) != word:
        return _what(known, plugins, as_json, only_files)
    nearest = did_you_mean(Path(word).stem, names, "see `wsnsim list`")
    raise UsageError(f"unknown kind, scenario, datasheet or result '{word[:80]}' ({nearest})")


def _longer_names() -> Iterator[str]:
    """Yield the other names of kinds and roles: 'role.kind', the names of classes, and plurals."""
    for role in ROLES.values():
        yield role.plural
        for row in kinds(role.name).values():
            yield f"{role.name}.{row.kind}"
            yield row.path.rpartition(":")[2]


def described(words: Sequence[str]) -> list[KindInfo]:
    """Return the descriptions of the kinds that one word names ('KIND', 'ROLE.KIND'), or two ('ROLE', 'KIND').

    Raises:
        UsageError: the role or the kind is unknown, or the class of a plug-in cannot be described.
    """
    if len(words) == 1:
        return [_described(role, kind) for role, kind in kinds_named(words[0])]
    role = role_named(words[0].lower() if words[0].lower() in ROLES else words[0]).name
    return [_described(role, in_known_case(words[1], kinds(role)))]


def in_known_case(word: str, names: Iterable[str]) -> str:
    """Return the one of the names that a word is in another case ('ekf' for 'EKF'); the word if there is none."""
    alike = {name for name in names if name.casefold() == word.casefold()}
    return alike.pop() if len(alike) == 1 else word


def _described(role: str, kind: str) -> KindInfo:
    if ":" in kind:
        search([""])
    try:
        find(role, kind)
        return kind_info(role, kind)
    except (LookupError, ImportError, PartError) as error:
        raise UsageError(str(error.args[0]) if isinstance(error, LookupError) else str(error)) from None


def kinds_text(infos: Sequence[KindInfo]) -> str:
    """Return the descriptions as text, one below the other."""
    return "\n\n".join("\n".join(_sections(kind)) for kind in infos)


def _sections(kind: KindInfo) -> Iterator[str]:
    default = ", the default" if kind.default else ""
    plugin = f" (plug-in of {kind.plugin})" if kind.plugin else ""
    yield paragraph(f"{kind.kind}: {kind.idea}{plugin}")
    yield paragraph(f"A kind of the role {kind.role} ({kind.purpose}){default}.")
    for text in [*kind.method, *kind.notes]:
        if text:
            yield f"\n{paragraph(text)}"
    for one in kind.citations:
        yield paragraph(one.text(), "  ")
    if kind.facts:
        yield ""
        yield from _aligned([(f"{name}:", [text]) for name, text in kind.facts], "")
    yield "\nParameters:" if kind.parameters else "\nNo parameters."
    defaults = ["required" if one.default is None else f"default {one.default}" for one in kind.parameters]
    pairs = zip(kind.parameters, defaults, strict=True)
    yield from _aligned([(one.name, [one.meaning, f"{default}; {one.takes}"]) for one, default in pairs], "  ")
    files = " and ".join(kind.example.files)
    beside = f" (here with {files} beside it)" if files else ""
    yield "\n" + paragraph(f"A scenario with it, which `wsnsim check` accepts{beside}:")
    yield textwrap.indent(kind.example.text(f"try_{kind.kind.rpartition(':')[2].lower()}").rstrip(), "  ")
    for name, content in kind.example.files.items():
        yield f"{name}:\n{textwrap.indent(content.rstrip(), '  ')}"
    yield f"In Python:\n  {kind.import_line}"


def _aligned(items: Sequence[tuple[str, Sequence[str]]], indent: str) -> Iterator[str]:
    """Yield each name with its texts beside it, one below the other, wrapped."""
    size = max((len(name) for name, _ in items), default=0) + 2
    for name, texts in items:
        for i, text in enumerate(texts):
            start = indent + (name if i == 0 else "").ljust(size)
            yield paragraph(text, start, " " * len(start))


def word_text(word: str) -> str:
    """Return what a word is in results, scenarios and on the command line; '' if it is nothing there."""
    return "\n\n".join(part for part in (_table(word), _columns(word), _keys(word), _command(word)) if part)


def _table(word: str) -> str:
    table, _, column = word.partition(".")
    rows = [[one.name, one.units or "-", _meaning(one)] for one in TABLES.get(table, ())]
    found = [row for row in rows if column in ("", row[0])]
    if not found:
        return ""
    recorded = "recorded by default" if RECORDED_BY_DEFAULT[table] else f"recorded with `record: {{{table}: true}}`"
    head = f"{table}: a table of results, one row per {TABLE_MEANINGS[table]} ({recorded})"
    return f"{paragraph(head)}\n{wrapped_table(['column', 'unit', 'meaning'], found)}"


def _columns(word: str) -> str:
    rows = [
        [table, column.units or "-", _meaning(column)]
        for table, columns in TABLES.items()
        for column in columns
        if column.name == word
    ]
    return f"{word}: a column of results\n{wrapped_table(['table', 'unit', 'meaning'], rows)}" if rows else ""


def _meaning(column: Column) -> str:
    return column.description + (f": {', '.join(column.meanings)}" if column.meanings else "")


def _keys(word: str) -> str:
    rows = [*_rows_at_top(word), *_rows_of_key(word)]
    return f"{word}: a parameter\n{wrapped_table(['of', 'default', 'meaning'], rows)}" if rows else ""


def _rows_at_top(word: str) -> Iterator[list[str]]:
    """A key at the top of a scenario that is no role, such as `seed`."""
    from wsnsim.scenario.parameter_info import json_schema

    field = json_schema()["properties"].get(word)
    if field is not None and word not in AT_TOP and "description" in field:
        default = field.get("default")
        shown = "" if isinstance(default, Mapping) else "required" if default is None else str(default)
        yield ["scenario", shown, field["description"]]


def _rows_of_key(word: str) -> Iterator[list[str]]:
    for role in ROLES.values():
        for row in role.kinds:
            for one in kind_info(role.name, row.kind).parameters:
                if word in (one.name, f"{role.name}.{one.name}", f"{row.kind}.{one.name}"):
                    default = "required" if one.default is None else one.default
                    yield [f"{role.name} {row.kind}", default, f"{one.meaning} ({one.takes})"]


def _command(word: str) -> str:
    command = every_command().get(word)
    return f"{word}: a command: {command.get_short_help_str(100)} See wsnsim {word} --help" if command else ""
