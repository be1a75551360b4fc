"""Every promise of docs/security.md names the tests that hold it, and they exist."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def section(title: str) -> str:
    """The text of a section of the page."""
    (text,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE)
    return text


def promises() -> list[tuple[str, str]]:
    """Each promise, and the cell that names its tests."""
    rows = [line.strip("| ").split(" | ") for line in section("What wsnsim promises").splitlines() if "|" in line]
    return [(promise, held) for promise, held in rows[2:]]


@functools.cache
def names_in(path: str) -> frozenset[str]:
    """The names of the test functions of a module."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


@pytest.mark.parametrize(("promise", "held"), promises())
def test_a_promise_names_tests_that_exist(promise: str, held: str) -> None:
    named = TEST.findall(held)
    assert promise.endswith(".") and named
    assert not TEST.sub("", held).strip(", "), "a row holds nothing but names of tests"
    assert [name for path, name in named if name not in names_in(path)] == []


def test_the_page_says_who_what_what_not_and_how_to_report_and_is_found() -> None:
    threats = section("Who can harm whom, with what")
    for word in ("scenario", "plug-in", ".h5", "shared disk", "Dask", "HTML", "cache", "directory"):
        assert word in threats, word
    assert len(promises()) >= 10
    assert section("What wsnsim does not promise").count("\n- **") >= 4
    assert "privately" in section("How to report a hole")
    assert "docs/security.md" in (ROOT / "README.md").read_text(encoding="utf-8")
