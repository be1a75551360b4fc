"""The reference that is made from the code has every kind, parameter, table, column and command."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from wsnsim.base.tables import TABLES
from wsnsim.cli.shared import every_command
from wsnsim.scenario.datasheets import datasheet
from wsnsim.scenario.kind_info import kind_info
from wsnsim.scenario.parameter_info import json_schema
from wsnsim.scenario.registry import AT_TOP, ROLES
from wsnsim.scenario.texts import shipped_parts

EXTENSIONS = Path(__file__).resolve().parents[2] / "docs" / "_ext"
ROWS = [(role.name, row.kind) for role in ROLES.values() for row in role.kinds]


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    sys.path.insert(0, str(EXTENSIONS))
    try:
        import wsnsim_reference
    finally:
        sys.path.remove(str(EXTENSIONS))
    return dict(wsnsim_reference.pages())


def section(page: str, title: str) -> str:
    """The text of a page below a heading, until the next."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    assert found, title
    return found[1]


def test_every_kind_has_its_section_with_every_parameter(pages: dict[str, str]) -> None:
    for role, kind in ROWS:
        text = section(pages[f"kinds/{role}.md"], kind)
        for one in kind_info(role, kind).parameters:
            where = pages["kinds/tracker.md"] if one.name.startswith("assumes.") else text
            row = next(line for line in where.splitlines() if line.startswith(f"| `{one.name}` |"))
            assert row.count("|") - row.count(r"\|") == 4, row
            assert (f"`{one.default}`" if one.default is not None else "required") in row
        assert f"kind: {kind}" in text


def test_every_page_of_a_role_is_in_the_index(pages: dict[str, str]) -> None:
    index = pages["kinds/index.md"]
    assert {f"kinds/{role}.md" for role in ROLES} < set(pages)
    assert all(f"]({role}.md)" in index and re.search(rf"^{role}$", index, re.MULTILINE) for role in ROLES)


def test_every_column_is_described_with_type_and_unit(pages: dict[str, str]) -> None:
    for table, columns in TABLES.items():
        lines = section(pages["tables.md"], table).splitlines()
        for column in columns:
            assert any(line.startswith(f"| `{column.name}` | ") for line in lines), (table, column.name)


def test_every_command_has_its_options(pages: dict[str, str]) -> None:
    for name, command in every_command().items():
        text = section(pages["commands.md"], name)
        assert text.strip().startswith(f"```text\nwsnsim {name}")
        options = [
            one for one in command.params if one.param_type_name == "option" and not getattr(one, "hidden", False)
        ]
        assert all(one.opts[0] in text for one in options), name


def test_the_scenario_file_has_every_key(pages: dict[str, str]) -> None:
    text = pages["scenario_file.md"]
    for key in json_schema()["properties"]:
        assert f"`{key}`" in text or f"| `{key}." in text, key
    assert all(f"(kinds/{role.name}.md)" in text for role in AT_TOP.values())


def test_every_shipped_datasheet_is_there_with_its_values_and_sources(pages: dict[str, str]) -> None:
    for name, path in shipped_parts().items():
        text = section(pages["datasheets.md"], name)
        for value in datasheet(path).values:
            assert f"| `{value.field}` |" in text or value.written is None or value.field in ("name", "source")


@pytest.mark.parametrize(("role", "kind"), [("link", "disk"), ("motion", "gauss_markov"), ("tracker", "ekf")])
def test_the_schema_and_the_reference_have_the_same_parameters_and_defaults(role: str, kind: str) -> None:
    found = kind_info(role, kind)
    (definition,) = [
        one for one in json_schema()["$defs"].values() if one["properties"].get("kind", {}).get("const") == kind
    ]
    keys = {name for name in definition["properties"] if name not in ("kind", "gains", "inflate", "filter_noise_scale")}
    assert keys == {one.name.partition(".")[0] for one in found.parameters}
    for one in found.parameters:
        if one.unit and "." not in one.name and one.unit != "dimensionless":
            assert definition["properties"][one.name]["description"] == f"{one.meaning} [{one.unit}]"


def test_a_page_is_written_only_when_it_has_changed(tmp_path: Path, pages: dict[str, str]) -> None:
    import wsnsim_reference

    wsnsim_reference.write_pages(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.md")}
    assert len(before) == len(pages)
    (tmp_path / "kinds" / "gone.md").write_text("# a role that was removed\n")
    wsnsim_reference.write_pages(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.md")} == before


def test_the_first_occurrence_of_a_term_on_a_page_explains_itself(pages: dict[str, str]) -> None:
    nodes = pytest.importorskip("docutils.nodes")
    utils = pytest.importorskip("docutils.utils")
    from wsnsim_reference import tooltips

    rows = "| term | meaning | source |\n| --- | --- | --- |\n| medium access (MAC, `mac`) | *runs* it | LEACH |\n"
    assert tooltips.meanings(rows) == {"medium access": "runs it", "MAC": "medium access: runs it"}
    tree = utils.new_document("page")
    tree += nodes.paragraph("", "Cluster heads and a cluster head.")
    app = SimpleNamespace(builder=SimpleNamespace(format="html"), srcdir=EXTENSIONS.parent)
    tooltips.explain(app, tree, "tutorials/first_run")
    (only,) = tree.findall(nodes.abbreviation)
    assert (only.astext(), tree.astext()) == ("Cluster head", "Cluster heads and a cluster head.")
    assert only["explanation"] in (EXTENSIONS.parent / "glossary.md").read_text(encoding="utf-8")
