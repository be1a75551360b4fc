"""docs/headless.md holds what docs/headless.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json

from tests.bench.page import spliced
from tests.papers import headless_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8"))
TEXT = page.PAGE.read_text(encoding="utf-8")
REGISTERED = study("headless").registered


def test_the_page_is_made_from_its_rows():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.headless_page writes it"
    made = page.files(ROWS)
    assert {name: (page.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert all(f"]({name})" in TEXT for name in made)


def test_what_was_registered_stands_word_for_word():
    thresholds = json.dumps(REGISTERED, sort_keys=True)
    found = [
        hashlib.sha256(" ".join(each.split()).encode()).hexdigest() for each in (registered("headless"), thresholds)
    ]
    assert found == [
        "50ae169c1bea29b47d238da75a475e5bc7e81b57399b9020359bef2aae58614f",
        "74932c2f2a868255b77defa252206f9a7695aea385b1b88581c697838cef8bbd",
    ]
    numbered = list(hypotheses("headless"))
    assert numbered == [test["number"] for test in REGISTERED["tests"]] == [row["number"] for row in ROWS["tests"]]
    assert {row["runs"] for row in ROWS["rows"].values()} == {REGISTERED["runs"]}
