"""The combinations of docs/combinations.md work, or are refused with the reason that the page gives."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from wsnsim import load
from wsnsim.base.errors import ScenarioError
from wsnsim.base.medium_access import (
    CAP_HOPS,
    CAP_SHARE,
    ELECTION_HOPS,
    JOIN_HOPS,
    JOIN_SHARE,
    LEAST_CAP,
    LEAST_QUIET,
    QUIET_HOPS,
)
from wsnsim.experiment import simulate_run
from wsnsim.scenario import build

PAGE = (Path(__file__).parents[2] / "docs" / "combinations.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (\w+) \| (`.*`) \| (.+) \|$", PAGE.partition("## Combinations")[2], re.MULTILINE)


def test_the_page_has_rows_of_both_kinds():
    works = [result == "works" for _, _, result in ROWS]
    assert len(works) == PAGE.partition("## Combinations")[2].count("\n| ") - 2
    assert sum(works) >= 5 and len(works) - sum(works) >= 6


@pytest.mark.parametrize(("name", "values", "result"), ROWS)
def test_a_combination_does_what_the_page_says(name, values, result):
    changes = [*re.findall(r"`([^`]+)`", values), "duration=4 s"]
    if result == "works":
        assert simulate_run(load(name, changes)).run["frames_sent"] > 0
        return
    with pytest.raises(ScenarioError) as refused:
        build(load(name, changes))
    assert result in str(refused.value)


def test_the_waits_of_the_page_are_those_of_the_code():
    said = {
        "(`clusters.quiet`)": f"{QUIET_HOPS:g} hops | {1000 * LEAST_QUIET:g} ms",
        "(`clusters.cap`)": f"{CAP_HOPS:g} hops, at most {CAP_SHARE:g} of a step | {1000 * LEAST_CAP:g} ms",
        "joins after": f"{JOIN_HOPS:g} hops, at most {JOIN_SHARE:g} of a step",
        "candidates": f"spread over {ELECTION_HOPS:g} hops, at most half a step",
    }
    for start, text in said.items():
        (row,) = [line for line in PAGE.splitlines() if line.startswith("| ") and start in line]
        assert text in row
