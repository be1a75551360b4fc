"""docs/association.md holds what its CSV files say, and what was registered."""

from __future__ import annotations

import hashlib
import json
import re

from tests.bench.page import spliced
from tests.papers import association_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS, TESTS = page.read()
TEXT = page.PAGE.read_text(encoding="utf-8")
STUDY = study("association")
REGISTERED = STUDY.registered


def test_the_page_is_made_from_its_rows_and_shows_its_figure():
    for name, block in page.blocks(ROWS, TESTS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.association_page writes it"
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", TEXT)
    assert shown and all((page.PAGE.parent / name).stat().st_size > 20_000 for name in shown)


def test_what_was_registered_stands_word_for_word():
    thresholds = json.dumps(REGISTERED, sort_keys=True)
    found = [
        hashlib.sha256(" ".join(each.split()).encode()).hexdigest() for each in (registered("association"), thresholds)
    ]
    assert found == [
        "83c24f55557c0f2cd62db0b41b8b75c2467a16c843f9e0c976972ac125a4a372",
        "bcb5c9d657c4ab89e14ce930910d461d74aaec4d5f713bd5418311990f1643b7",
    ]


def test_the_rows_are_of_all_variants_and_the_tests_those_that_were_registered():
    assert set(hypotheses("association")) == set(TESTS["number"]) == set(page.SAID) == set(page.DECIDES)
    kept = [
        {key: row[key] for key in test} for row, test in zip(TESTS.to_dict("records"), REGISTERED["tests"], strict=True)
    ]
    assert kept == [dict(test) for test in REGISTERED["tests"]]
    (experiment,) = STUDY.experiments
    assert list(dict.fromkeys(ROWS["variant"])) == list(experiment.variants)
    assert set(ROWS["runs"][ROWS["measure"] == "gospa"]) == set(TESTS["runs"]) == {REGISTERED["runs"]}
