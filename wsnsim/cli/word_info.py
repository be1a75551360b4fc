"""What a word is that names no kind and no file: a table or a column of results, a key of scenarios, a command.

word_text("rmse") -> text        word_text("nothing") -> ""
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from wsnsim.base.tables import RECORDED_BY_DEFAULT, TABLE_MEANINGS, TABLES, Column
from wsnsim.cli.listing import paragraph, wrapped_table
from wsnsim.cli.shared import group
from wsnsim.scenario.kind_info import kind_info
from wsnsim.scenario.registry import AT_TOP, ROLES


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
    from wsnsim.scenario.json_schema import json_schema

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
