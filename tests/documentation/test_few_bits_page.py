"""docs/few_bits.md holds what docs/few_bits.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json
import re

from tests.bench.page import spliced
from tests.papers import few_bits_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8"))
TEXT = page.PAGE.read_text(encoding="utf-8")
REGISTERED = study("few_bits").registered


def test_the_page_is_made_from_its_rows_and_shows_its_figure():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.few_bits_page writes it"
    made = page.files(ROWS)
    assert {name: (page.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert all(f"]({name})" in TEXT for name in made)
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", TEXT)
    assert shown and all((page.PAGE.parent / name).stat().st_size > 20_000 for name in shown)


def test_what_was_registered_stands_word_for_word():
    thresholds = json.dumps(REGISTERED, sort_keys=True)
    found = [
        hashlib.sha256(" ".join(each.split()).encode()).hexdigest() for each in (registered("few_bits"), thresholds)
    ]
    assert found == [
        "5bd0dd154c0580917bcdacd0f3649b587757f06c963159951f7395b07b0d204b",
        "317063415eeac06f94d396c62e19f7627df24a48237ec34dce9bd458b1662073",
    ]


def test_every_hypothesis_of_the_page_is_tested_and_the_rows_are_of_the_registered_tests():
    assert (
        set(hypotheses("few_bits"))
        == set(page.by_number(ROWS["tests"]))
        == {test["number"] for test in REGISTERED["tests"]}
    )
    kept = [{key: row[key] for key in test} for row, test in zip(ROWS["tests"], REGISTERED["tests"], strict=True)]
    assert kept == [dict(test) for test in REGISTERED["tests"]]
    assert {row["runs"] for row in ROWS["rows"].values()} == {REGISTERED["runs"]}


def test_a_hypothesis_needs_all_of_its_tests():
    assert [page.answer(each) for each in (("yes", "yes"), ("yes", "undecided"), ("undecided", "no"))] == [
        "yes", "undecided", "no",
    ]  # fmt: skip
