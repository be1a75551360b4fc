"""The Python reference has an entry for every public name, and each entry says what its parameters and fields are."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import wsnsim

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted((DOCS / "reference" / "python").glob("*.md"))}
DIRECTIVE = re.compile(r"^\.\. (?:autoclass|autofunction|autoexception|py:data):: ([\w.]+)(?:\(\))?$", re.MULTILINE)
ENTRIES = [name for text in PAGES.values() for name in DIRECTIVE.findall(text)]
PUBLIC = ("wsnsim", "wsnsim.plugins", "wsnsim.testing", "wsnsim.bounds", "wsnsim.fitting", "wsnsim.interop.stonesoup")
UNLISTED = {"wsnsim.interop.stonesoup": {"MISSING", "UPDATERS"}}
"""Names that a module does not offer for use."""


def names_of(module: str) -> list[str]:
    """The public names of a module: its `__all__`, or those that it defines itself."""
    found = importlib.import_module(module)
    if module == "wsnsim":
        names = set(dir(found))
    else:
        names = set(getattr(found, "__all__", None) or (name for name in vars(found) if _is_own(found, name)))
    return [f"{module}.{name}" for name in sorted(names - UNLISTED.get(module, set()))]


def _is_own(module: Any, name: str) -> bool:
    kept = getattr(module, name)
    defined = getattr(kept, "__module__", module.__name__ if name.isupper() else "")
    return not name.startswith("_") and (defined == module.__name__ or name == "START")


def named(path: str) -> Any:
    """The object that a dotted name stands for."""
    module, name = path.rsplit(".", 1)
    return getattr(importlib.import_module(module), name)


def without_entry(names: list[str], entries: list[str]) -> list[str]:
    """The names of which neither they nor the same object under another name have an entry."""
    documented = {id(named(entry)): entry for entry in entries}
    return [
        name
        for name in names
        if name not in entries and documented.get(id(named(name)), "").rpartition(".")[2] != name.rpartition(".")[2]
    ]


@pytest.mark.parametrize("module", PUBLIC)
def test_every_public_name_has_an_entry(module: str) -> None:
    assert without_entry(names_of(module), ENTRIES) == []


def test_a_name_without_an_entry_is_found() -> None:
    fewer = [entry for entry in ENTRIES if entry not in ("wsnsim.Scene", "wsnsim.plugins.PACKET_BITS")]
    assert without_entry(names_of("wsnsim"), fewer) == ["wsnsim.Scene"]
    assert without_entry(names_of("wsnsim.plugins"), fewer) == ["wsnsim.plugins.PACKET_BITS", "wsnsim.plugins.Scene"]


def test_each_name_has_one_entry_which_exists() -> None:
    assert sorted(set(ENTRIES)) == sorted(ENTRIES)
    assert [entry for entry in ENTRIES if named(entry) is None] == []


def test_the_overview_leads_to_every_page() -> None:
    overview = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    for page in PAGES:
        assert f"](python/{page})" in overview and f"\npython/{page.removesuffix('.md')}\n" in overview, page


@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if inspect.isfunction(named(entry))])
def test_a_function_describes_each_parameter(entry: str) -> None:
    function = named(entry)
    text = inspect.getdoc(function) or ""
    lacking = [name for name in inspect.signature(function).parameters if not described(name, text)]
    assert lacking == [], f"{entry}: no description of {', '.join(lacking)}"


@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if inspect.isclass(named(entry))])
def test_a_class_describes_its_fields_and_members(entry: str) -> None:
    kind = named(entry)
    text = inspect.getdoc(kind) or ""
    assert text.strip(), entry
    lacking = [name for name in fields_of(kind) if not described(name, text)]
    members = [name for name, member in vars(kind).items() if not name.startswith("_") and is_member(member)]
    lacking += [name for name in members if not inspect.getdoc(getattr(kind, name))]
    assert lacking == [], f"{entry}: no description of {', '.join(lacking)}"


def fields_of(kind: type[Any]) -> list[str]:
    """The fields of a dataclass or NamedTuple that its own docstring must describe."""
    own = getattr(kind, "__annotations__", {})
    if hasattr(kind, "_fields"):
        return list(kind._fields)
    if not dataclasses.is_dataclass(kind):
        return []
    hints = get_type_hints(kind, include_extras=True)
    notes = {name: getattr(hints[name], "__metadata__", ()) for name in own}
    fields = [one.name for one in dataclasses.fields(kind) if one.name in own and not one.name.startswith("_")]
    return [name for name in fields if not any(isinstance(note, str) for note in notes[name])]


def is_member(member: Any) -> bool:
    """Whether it is a method or a property."""
    return inspect.isfunction(member) or isinstance(member, property | classmethod | staticmethod)


def described(name: str, text: str) -> bool:
    """Whether a section of a docstring describes a parameter or field, perhaps together with others."""
    return re.search(rf"^ {{4}}(?:\*{{0,2}}\w+, )*\*{{0,2}}{name}(?:, \w+)*: ", text, re.MULTILINE) is not None


@pytest.mark.parametrize("entry", ENTRIES)
def test_no_example_is_rendered_as_a_quotation(entry: str) -> None:
    found = named(entry)
    members = (
        [getattr(found, name) for name, member in vars(found).items() if is_member(member)]
        if inspect.isclass(found)
        else []
    )
    for one in [found, *members]:
        text = inspect.getdoc(one) or ""
        quoted = re.search(r"^(?!.*::$)\S.*\n\n +\S.*$", text, re.MULTILINE)
        assert quoted is None, f"{entry}: end the line before with '::' to show this as code: {quoted[0]}"


def test_the_page_about_plug_ins_names_no_private_module() -> None:
    text = (DOCS / "plugins.md").read_text(encoding="utf-8")
    assert re.findall(r"`(?:wsnsim\.)?(?:base|models|network|trackers\.shared|kernels)\.[\w.]+`", text) == []


def test_the_promise_of_stability_covers_every_public_module() -> None:
    promised = (DOCS / "reference" / "stability.md").read_text(encoding="utf-8")
    assert [module for module in (*PUBLIC, "wsnsim.models", "wsnsim.trackers") if f"`{module}`" not in promised] == []
    assert wsnsim.MODULES - {"experiment", "scenario"} <= set(re.findall(r"`wsnsim\.(\w+)`", promised))
