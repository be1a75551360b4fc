"""Every promise of docs/security.md has tests that hold it, in docs/security.csv, and they exist."""

from __future__ import annotations

import ast
import csv
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
HELD = list(csv.DictReader((ROOT / "docs" / "security.csv").read_text(encoding="utf-8").splitlines()))


def section(title: str) -> str:
    """The text of a section of the page."""
    (text,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE)
    return text


def promises() -> list[str]:
    """The promises of the page."""
    return re.findall(r"^- (.+\.)$", section("What wsnsim promises"), re.MULTILINE)


@functools.cache
def names_in(path: str) -> frozenset[str]:
    """The names of the test functions of a module."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def test_every_promise_has_tests() -> None:
    assert list(dict.fromkeys(row["promise"] for row in HELD)) == promises()


@pytest.mark.parametrize("test", [row["test"] for row in HELD])
def test_a_test_that_holds_a_promise_exists(test: str) -> None:
    path, name = test.split("::")
    assert name in names_in(path)


def test_the_page_says_who_what_what_not_and_how_to_report_and_is_found() -> None:
    threats = section("Who can harm whom, with what")
    for word in ("scenario", "plug-in", ".h5", "shared disk", "Dask", "HTML", "cache", "directory"):
        assert word in threats, word
    assert len(promises()) >= 10
    assert section("What wsnsim does not promise").count("\n- **") >= 4
    assert "privately" in section("How to report a hole")
    assert "docs/security.md" in (ROOT / "README.md").read_text(encoding="utf-8")
