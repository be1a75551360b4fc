"""docs/frontier.md holds what docs/frontier.json and the stored sweeps say."""

from __future__ import annotations

import json

from tests.bench.page import spliced
from tests.papers import frontier_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8")) if page.ROWS.exists() else {}
TEXT = page.PAGE.read_text(encoding="utf-8")
REGISTERED = study("frontier").registered


def test_the_page_is_made_from_its_rows():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.frontier_page writes it"


def test_its_files_have_all_rows_and_are_linked():
    made = page.files(ROWS)
    assert {name: (page.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert [name for name in made if f"]({name})" not in TEXT] == []
    assert made["frontier_strategies.csv"].count("\n") == len(ROWS["frontier"]["strategies"]) + 1 > 80


def test_its_hypotheses_have_the_registered_thresholds():
    text = " ".join(registered("frontier").split())
    said = [f"at most {REGISTERED['ideal']:.2f} times the bound", f"at most {REGISTERED['joules']:g} J",
            f"above {REGISTERED['greatest']:g} m", f"below {REGISTERED['near_walls']:g}.",
            f"{REGISTERED['radio_settled']:g} times the bound after 1 s", f"{REGISTERED['radio_whole']:g} times over",
            f"At least {REGISTERED['in_time']:.0%} of the estimates".replace("%", " %"),
            f"within {REGISTERED['published_near']:g} times",
            f"beyond {180 - REGISTERED['walls']['margin']:g} m"]  # fmt: skip
    said += [f"{one['least']:g} to {one['most']:g}" for one in REGISTERED["robust"].values()]
    assert [words for words in said if words not in text] == []


def test_every_hypothesis_is_answered_once_its_experiment_has_been_run():
    answered = {int(each["words"].split(":")[0].split(" ")[0]) for each in page.answers(ROWS)}
    assert answered == set(hypotheses("frontier"))
