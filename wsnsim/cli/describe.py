"""What `wsnsim info` prints of a kind, and of a word that names no kind and no file.

described(["coordinated_turn"]) -> [KindInfo]       kinds_text([KindInfo, ...]) -> the text
word_text("rmse") -> text        word_text("nothing") -> ""

Such a word is a table or a column of results, a key of scenarios, or a command.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from wsnsim.base.errors import UsageError
from wsnsim.base.tables import RECORDED_BY_DEFAULT, TABLE_MEANINGS, TABLES, Column
from wsnsim.cli.listing import listed, paragraph, wrapped_table
from wsnsim.cli.shared import group
from wsnsim.scenario.fields import PartError
from wsnsim.scenario.kind_info import KindInfo, kind_info, kinds_named
from wsnsim.scenario.parameter_info import ParameterInfo
from wsnsim.scenario.registry import AT_TOP, ROLES, find, kinds, role_named, search


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


def is_role(word: str) -> bool:
    """Return whether a word is the name of a role, and of no kind."""
    return any(word in (role.name, role.plural) for role in ROLES.values()) and not kinds_named(word)


def role_text(word: str, as_json: bool) -> str | dict[str, Any]:
    """Return the kinds of the role that a word names, as `wsnsim list` shows them."""
    return listed(role_named(word).name, as_json)


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
    yield from _aligned([(one.name, [one.meaning, values_of(one)]) for one in kind.parameters], "  ")
    yield "\n" + paragraph(f"A scenario with it, which `wsnsim check` accepts{_with_files(kind)}:")
    yield textwrap.indent(kind.example.text(f"try_{_file_name(kind.kind)}").rstrip(), "  ")
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


def values_of(one: ParameterInfo) -> str:
    """Return what a parameter takes: 'default 400; whole number (dimensionless), 1 to 1e7'."""
    default = "required" if one.default is None else f"default {one.default}"
    return f"{default}; {one.takes}"


def _with_files(kind: KindInfo) -> str:
    files = " and ".join(kind.example.files)
    return f" (here with {files} beside it)" if files else ""


def _file_name(kind: str) -> str:
    return kind.rpartition(":")[2].lower()


def words_known() -> list[str]:
    """Return the tables, columns and commands. Keys are left out: to find them, every kind is imported."""
    columns = (column.name for columns in TABLES.values() for column in columns)
    return list(dict.fromkeys([*TABLES, *columns, *group.commands]))


def word_text(word: str) -> str:
    """Return what a word is in results, scenarios and on the command line; '' if it is nothing there."""
    return "\n\n".join(part for part in (_table(word), _columns(word), _keys(word), _command(word)) if part)


def _table(word: str) -> str:
    table, _, column = word.partition(".")
    if table not in TABLES:
        return ""
    rows = [[one.name, one.units or "-", _meaning(one)] for one in TABLES[table]]
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
    command = group.commands.get(word)
    return f"{word}: a command: {command.get_short_help_str(100)} See wsnsim {word} --help" if command else ""
