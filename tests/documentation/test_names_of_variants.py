"""Variants have one name: the table of networks in docs/papers uses names of scenarios."""

from __future__ import annotations

import re

import pytest

from tests.documentation.pages_of_docs import block
from wsnsim.papers.study import PAPERS, study
from wsnsim.scenario import shipped

NAME = re.compile(r"^`([^`]+)`")


def tables(page: str, *names: str) -> list[list[list[str]]]:
    """Tables that `make readme` wrote: rows of cells, the heading first."""
    blocks = [block(f"docs/papers/{page}.md", name) for name in names]
    rows = [[line.strip().strip("|").split("|") for line in block.splitlines()] for block in blocks]
    return [[[cell.strip() for cell in row] for row in table if not set("".join(row)) <= set("- ")] for table in rows]


def named(table: list[list[str]]) -> list[str]:
    """The names in backticks at the start of a row's first two cells."""
    return [found[1] for row in table[1:] for cell in row[:2] if (found := NAME.match(cell))]


def test_the_commercial_radio_names_scenarios_and_readings_that_are_shipped() -> None:
    (table,) = tables("commercial_radio", "commercial_radio")
    assert len(named(table)) == len(table) - 1
    assert set(named(table)) <= set(shipped())


@pytest.mark.parametrize("name", PAPERS)
def test_a_variant_that_has_the_name_of_a_scenario_is_that_scenario(name: str) -> None:
    """'gmtt' was the paper's form in one place, and the repaired one, the scenario gmtt, in the other."""
    for experiment in study(name).experiments:
        for variant, what in experiment.variants.items():
            plain = re.sub(r", \d+$", "", variant)
            if plain in shipped():
                assert what.scenario == plain, variant
                assert all(each.startswith(("deploy.nodes=", "tracker.particles=")) for each in what.sets), variant
