"""What autodoc shows of the entries of the Python reference: fields of components, and signatures that can be read."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import Any, Final, get_type_hints

from sphinx.util.inspect import TypeAliasForwardRef, signature, stringify_signature
from sphinx.util.typing import stringify_annotation

from wsnsim.base.part import Quantity

COLON: Final = "\ue000"
"""Stands for a colon while Napoleon works: a character of the private use area, which no docstring has."""
ATTRIBUTES: Final = ("property", "attribute", "data")


class Shown:
    """A default value that is shown as this text."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def setup(app: Any) -> None:
    """Connect the handlers to the events of autodoc. Napoleon has the priority 500."""
    app.connect("autodoc-skip-member", skip_tuple_fields)
    app.connect("autodoc-process-signature", readable_signature)
    app.connect("autodoc-process-docstring", add_fields_of_component, priority=400)
    app.connect("autodoc-process-docstring", hide_colons, priority=400)
    app.connect("autodoc-process-docstring", show_colons, priority=600)
    app.connect("autodoc-process-docstring", shorten_types, priority=600)
    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    TypeAliasForwardRef.__getitem__ = subscripted  # type: ignore[attr-defined]


def subscripted(alias: TypeAliasForwardRef, of: Any) -> TypeAliasForwardRef:
    """Return an alias with an argument, such as `Flow[Belief]`: Sphinx only knows aliases without one."""
    return TypeAliasForwardRef(f"{alias.name}[{stringify_annotation(of, 'smart')}]")


def hide_colons(_app: Any, what: str, _name: str, _found: Any, _options: Any, lines: list[str]) -> None:
    """Hide the colons in the first line about a property: Napoleon takes what is before one for a type."""
    if what in ATTRIBUTES and lines:
        lines[0] = lines[0].replace(": ", f"{COLON} ")


def show_colons(_app: Any, what: str, _name: str, _found: Any, _options: Any, lines: list[str]) -> None:
    """Undo `hide_colons`."""
    if what in ATTRIBUTES:
        lines[:] = [line.replace(COLON, ":") for line in lines]


def shorten_types(_app: Any, _what: str, _name: str, _found: Any, _options: Any, lines: list[str]) -> None:
    """Show the types of fields without their modules: Sphinx does so where `~` is before a name."""
    typed = re.compile(r"(?<![\w.~])(?=[a-z]\w*\.[\w.]+)")
    lines[:] = [typed.sub("~", line) if line.startswith(":vartype ") else line for line in lines]


def skip_tuple_fields(_app: Any, _what: str, _name: str, member: Any, _skip: bool, _options: Any) -> bool | None:
    """Leave out the fields of a NamedTuple: its docstring describes them."""
    return True if type(member).__name__ == "_tuplegetter" else None


def readable_signature(
    app: Any, what: str, _name: str, found: Any, _options: Any, given: str | None, _returned: str | None
) -> tuple[str, str] | None:
    """Return the signature of a class: none of one that nobody constructs, and of others without long defaults."""
    if what != "class" or given == "()":
        return None
    if getattr(found, "_is_protocol", False) or hasattr(found, "__members__"):
        return "", ""
    if not dataclasses.is_dataclass(found):
        return None
    whole = signature(found, type_aliases=app.config.autodoc_type_aliases)
    short = [one.replace(default=_short(one.default)) for one in whole.parameters.values()]
    annotated = not list(described_fields(found))
    shown = whole.replace(parameters=short, return_annotation=whole.empty)
    return stringify_signature(shown, show_annotation=annotated, unqualified_typehints=True), ""


def _short(default: Any) -> Any:
    """A default value as it is shown: `...` stands for a function, an object or a factory."""
    plain = default is None or isinstance(default, str | int | float | tuple | type)
    return default if plain else Shown("...")


def add_fields_of_component(_app: Any, what: str, _name: str, found: Any, _options: Any, lines: list[str]) -> None:
    """Append the fields of a component to its docstring, with units and bounds from their annotations."""
    fields = list(described_fields(found)) if what == "class" else []
    if fields:
        lines += ["", *(f":param {name}: {meaning}" for name, meaning in fields), ""]


def described_fields(found: Any) -> Iterator[tuple[str, str]]:
    """Yield the fields of a component whose annotations describe them: the name and the meaning, with its limits."""
    if not dataclasses.is_dataclass(found):
        return
    hints = get_type_hints(found, include_extras=True)
    for field in dataclasses.fields(found):
        notes = getattr(hints[field.name], "__metadata__", ())
        meaning = next((note for note in notes if isinstance(note, str)), "")
        if meaning:
            quantity = next((note for note in notes if isinstance(note, Quantity)), Quantity())
            yield field.name, f"{meaning}{_limits(quantity)}"


def _limits(quantity: Quantity) -> str:
    """The unit and the bounds of a field: ' (m, > 0)'."""
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    bounds = [
        f"{sign} {getattr(quantity, name):g}" for name, sign in signs.items() if getattr(quantity, name) is not None
    ]
    said = [text for text in (quantity.label or quantity.unit, *bounds) if text]
    return f" ({', '.join(said)})" if said else ""
