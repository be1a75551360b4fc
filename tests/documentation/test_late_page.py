"""docs/late.md holds what docs/late.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json
import re

from tests.bench.page import spliced
from tests.papers import late_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8"))
TEXT = page.PAGE.read_text(encoding="utf-8")
REGISTERED = study("late").registered


def test_the_page_is_made_from_its_rows_and_shows_its_figure():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.late_page writes it"
    (shown,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", TEXT)
    assert (page.PAGE.parent / shown).stat().st_size > 10_000


def test_what_was_registered_stands_word_for_word():
    thresholds = json.dumps(REGISTERED, sort_keys=True)
    found = [hashlib.sha256(" ".join(each.split()).encode()).hexdigest() for each in (registered("late"), thresholds)]
    assert found == [
        "2fa2186bc987563d8ce9b3552154b7cdccc8a5db028aad2d70d852c4b621317a",
        "897cde0d760ad4761c36fbea95eb31a73a0e7b5699fb0d5c7fdebf7bb828f903",
    ]


def test_every_hypothesis_of_the_page_is_tested_with_the_registered_number_of_runs():
    assert list(hypotheses("late")) == [row["number"] for row in ROWS["tests"]]
    kept = [{key: row[key] for key in test} for row, test in zip(ROWS["tests"], REGISTERED["tests"], strict=True)]
    assert kept == [dict(test) for test in REGISTERED["tests"]]
    assert {row["runs"] for row in ROWS["rows"].values()} == {REGISTERED["runs"]}
