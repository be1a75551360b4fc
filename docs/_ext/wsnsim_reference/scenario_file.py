"""The page of the scenario file: keys at the top, units, `extends` and overrides."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from wsnsim.scenario.parameter_info import as_written, json_schema, short_number
from wsnsim.scenario.registry import AT_TOP, ROLES
from wsnsim.scenario.texts import template
from wsnsim.scenario.units import PREFIXES, SYMBOLS, WORDS
from wsnsim_reference.markdown import code, escaped, fence, generated, table

TYPES = {
    "array": "list",
    "integer": "whole number",
    "number": "number",
    "string": "text",
    "boolean": "true or false",
    "null": "none",
}
BOUNDS = {"minimum": "≥\u00a0", "exclusiveMinimum": ">\u00a0", "maximum": "≤\u00a0", "exclusiveMaximum": "<\u00a0"}

EXTENDS = """
`extends` names a scenario (a file beside this one, or a shipped scenario) that this file changes. Mappings are merged
key by key. All other values are replaced, lists included, and so is a component whose `kind` changes: its other keys
return to their defaults. Files may extend each other up to 16 times in a row.
"""
OVERRIDES = """
`wsnsim run NAME --set KEY=VALUE` changes a value without a file, and so does `overrides` in Python. Dots lead into
mappings and lists: `--set link.reach='80 m'`, `--set targets.0.bound='150 m'`, `--set tracker.kind=ekf`. A value is
written as in the file.
"""
UNITS = """
A bare number is in SI units. A text with a unit is converted exactly: `60 m`, `50 nJ/bit`, `5 min`, `-85 dBm`,
`30 ppm`, `2 deg`. Quotients and powers compose (`100 pJ/bit/m2`); `m²` and `m^2` are the same as `m2`. A unit of
another dimension is refused with what is expected. In a list whose elements differ in unit, such as `start: [px, vx,
py, vy]` and `prior.sd`, numbers are bare, in the SI units that `wsnsim info` shows (angles in rad). `.inf` stands for
infinity where there is no bound.
"""
EDITORS = """
`wsnsim schema > scenario.schema.json` writes a JSON Schema. An editor with a YAML language server completes and checks
a file that begins with `# yaml-language-server: $schema=scenario.schema.json`. `wsnsim check FILE` finds every error at
once, with line and column, and `wsnsim new NAME` writes a commented scenario to start from:
"""


def page() -> str:
    """Return the text of the page."""
    schema = json_schema()
    top = {key: value for key, value in schema["properties"].items() if key not in AT_TOP}
    roles = [
        [" or ".join(map(code, role.keys)), escaped(role.purpose), code(role.default or ""),
         f"[kinds](kinds/{role.name}.md)"]
        for role in ROLES.values()
    ]  # fmt: skip
    return generated(
        "Scenario file",
        "A scenario is a YAML file. Every key is checked when it is read: an unknown key, a wrong unit or an "
        "impossible combination is an error with its place.",
        "## Keys at the top",
        table(("key", "takes", "default", "meaning"), list(_rows(top, schema["$defs"]))),
        "## Roles",
        "Each role is a mapping with a `kind` and the parameters of that kind; `link: {kind: disk, reach: 60 m}`.",
        table(("key", "decides", "default", ""), roles),
        "## Extending a scenario",
        EXTENDS.strip(),
        "## Overrides",
        OVERRIDES.strip(),
        "## Quantities and units",
        UNITS.strip(),
        table(("unit", "also with the prefixes", "measures"), list(_units())),
        "## Editors, checks and a template",
        EDITORS.strip(),
        fence("yaml", template("mine")),
    )


def _rows(keys: dict[str, Any], definitions: dict[str, Any], prefix: str = "") -> Iterator[list[str]]:
    for name, field in sorted(keys.items(), key=lambda item: item[0] != "extends"):
        inner = _definition(field, definitions)
        words = re.sub(r" \[[^]]*\]$", "", field.get("description", ""))
        if name == "record":
            recorded = ", ".join(code(table) for table, wanted in field["default"].items() if wanted)
            yield [
                code("record.TABLE"),
                "true or false",
                "",
                f"whether a [table](tables.md) is recorded; by default: {recorded}",
            ]
        elif inner is not None:
            yield from _rows(inner["properties"], definitions, f"{prefix}{name}.")
        else:
            default = code(as_written(field["default"])) if field.get("default") is not None else ""
            yield [code(prefix + name), escaped(_takes(field)), default, escaped(words)]


def _definition(field: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    for choice in field.get("anyOf", [field]):
        if "$ref" in choice:
            found: dict[str, Any] = definitions[choice["$ref"].rpartition("/")[2]]
            return found
    return None


def _takes(field: dict[str, Any]) -> str:
    choice = field.get("anyOf", [field])[0]
    if "const" in choice:
        return str(choice["const"])
    unit = re.search(r" \[([^]]*)\]$", field.get("description", ""))
    bounds = [f"{sign}{short_number(choice[name])}" for name, sign in BOUNDS.items() if name in choice]
    types = choice["type"] if isinstance(choice["type"], list) else [choice["type"]]
    kind = " or ".join(TYPES[name] for name in types) + (f" in {unit[1]}" if unit else "")
    return ", ".join([kind, *bounds])


def _units() -> Iterator[list[str]]:
    for symbol, (_, _, prefixes) in SYMBOLS.items():
        yield [code(symbol), ", ".join(code(prefix + symbol) for prefix in prefixes), escaped(_measures(symbol))]
    yield [code("dBm"), "", "power, as a level relative to 1 mW"]
    names = ", ".join(f"{code(prefix)} = {factor}" for prefix, factor in PREFIXES.items())
    yield ["prefixes", names, ""]


def _measures(symbol: str) -> str:
    same = {
        "min": "time", "h": "time", "d": "time", "g": "mass", "B": "amount of data (8 bit)", "deg": "angle",
        "Wh": "energy", "1": "a pure number", "%": "a pure number (0.01)", "ppm": "a pure number (1e-6)",
    }  # fmt: skip
    return same.get(symbol) or WORDS.get(symbol, "")
