"""docs/lifetimes.md holds what docs/lifetimes.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json

from tests.bench.page import spliced
from tests.lifetimes import validation
from tests.papers import lifetimes_study as study
from tests.papers.page_files import hypotheses, registered

ROWS = json.loads(study.ROWS.read_text(encoding="utf-8"))
TEXT = study.PAGE.read_text(encoding="utf-8")


def test_the_page_is_made_from_its_rows_and_shows_its_figure():
    for name, block in study.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.lifetimes_study writes it"
    held = json.loads(validation.HELD.read_text(encoding="utf-8"))
    assert spliced(TEXT, "validation", validation.markdown(held)) == TEXT
    assert "](lifetimes.png)" in TEXT and "](lifetimes.csv)" in TEXT
    made = study.files(ROWS)
    assert {name: (study.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert study.FIGURE.stat().st_size > 20_000


def test_what_was_registered_stands_word_for_word():
    found = hashlib.sha256(" ".join(registered("lifetimes").split()).encode()).hexdigest()
    assert found == "b802578ff33bc71ba37f7c7e599bf88539d618a024c5b2551fd329ba2451ff8a"


def test_every_hypothesis_of_the_page_is_answered_from_all_variants_and_deployments():
    assert set(hypotheses("lifetimes")) == set(study.tests(ROWS))
    assert set(ROWS) == {variant.name for variant in study.VARIANTS}
    assert {len(each) for each in ROWS.values()} == {len(study.DEPLOYMENTS)}
