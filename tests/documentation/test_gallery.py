"""The scripts of the gallery are many, short and described; `make docs` executes them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[2] / "examples").glob("plot_*.py"))


def test_the_gallery_has_twelve_scripts_at_least():
    assert len(SCRIPTS) >= 12


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_a_script_has_a_title_a_text_and_less_than_forty_lines(script):
    text = script.read_text(encoding="utf-8")
    title, line, *described = (ast.get_docstring(ast.parse(text)) or "").splitlines()
    assert set(line) == {"="} and len(line) == len(title)
    assert len(" ".join(described)) > 80
    assert len(text.splitlines()) < 40
