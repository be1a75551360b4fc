"""Errors: their texts, suggestions, and characters that are escaped."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsnsim.base.errors import Issue, ScenarioError, did_you_mean, printable, printable_json, shortened


def test_a_fault_says_where_what_and_shows_the_line():
    fault = Issue(("deploy", "heigth"), "unknown key, did you mean 'height'?", "bad.yaml:3:24", "  heigth: 3\n  ^")
    assert str(fault) == "bad.yaml:3:24: error: deploy.heigth: unknown key, did you mean 'height'?\n  heigth: 3\n  ^"
    assert ScenarioError([fault]).exit_code == 2


def test_the_nearest_name_is_offered_or_else_all_of_them():
    assert did_you_mean("pso_mhfp", ["pso_mhpf", "ipf"]) == "did you mean 'pso_mhpf'?"
    assert did_you_mean("zzz", ["pso_mhpf", "ipf"]) == "known: ipf, pso_mhpf"
    assert did_you_mean("zzz", []) == "none is known"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("x\x1b[2Jy", r"x\x1b[2Jy"),
        ("a\rb\x07", r"a\rb\x07"),
        ("\u202egpj.exe", r"\u202egpj.exe"),
        ("\x9b31m\x7f", r"\x9b31m\x7f"),
        ("a\u2028b\ufeff", r"a\u2028b\ufeff"),
        ("\udcff.yaml", r"\udcff.yaml"),
        ("µ × 5 ± 2σ\u00a0m, two\nlines\tand a tab", "µ × 5 ± 2σ\u00a0m, two\nlines\tand a tab"),
        ("", ""),
    ],
)
def test_what_steers_a_terminal_is_an_escape_and_the_rest_as_it_was(text: str, shown: str) -> None:
    assert printable(text) == shown


@pytest.mark.thorough
@given(st.text())
def test_nothing_but_visible_characters_spaces_tabs_and_ends_of_lines_is_left(text: str) -> None:
    shown = printable(text)
    assert all(c.isprintable() or c in "\n\t" or c.isspace() for c in shown)
    assert not any(c in shown for c in "\x1b\r\x7f\x85\x9b\u2028\u202e\u2066")
    assert printable(shown) == shown


@given(st.text())
def test_a_json_text_keeps_its_values(text: str) -> None:
    written = printable_json(json.dumps({text: [text]}, ensure_ascii=False, indent=1))
    assert json.loads(written) == {text: [text]}
    assert printable(written) == written


def test_a_long_text_is_shortened_in_its_middle() -> None:
    assert shortened("x" * 60) == "x" * 60
    assert len(shortened("x" * 61)) == 60 and "…" in shortened("x" * 61)
