"""docs/duty_cycles.md holds what docs/duty_cycles.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json
import re

from tests.bench.page import spliced
from tests.papers import duty_cycles_page as page
from wsnsim.papers.paper import paper

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8")) if page.ROWS.exists() else {}
TEXT = page.PAGE.read_text(encoding="utf-8")
REGISTERED = paper("duty_cycles").published["registered"]


def test_the_page_is_made_from_its_rows():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.duty_cycles_page writes it"


def test_every_figure_of_the_page_is_there():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", TEXT)
    assert shown and all((page.PAGE.parent / name).stat().st_size > 20_000 for name in shown)


def test_definitions_and_hypotheses_stand_word_for_word_as_they_were_when_the_replication_was_registered():
    registered = TEXT[TEXT.index("**Definitions.**") : TEXT.index("**Departures from the registration**")]
    digest = hashlib.sha256(" ".join(registered.split()).encode()).hexdigest()
    assert digest == "bf71f7044945b2bc9488decb6b6849c33b6da2fbe3bb821cd57e6755b4901e35"


def test_its_hypotheses_have_the_registered_thresholds():
    text, spread, slow = " ".join(TEXT.split()), REGISTERED["spread"], REGISTERED["slow"]
    found, usable = REGISTERED["found"], REGISTERED["usable"]
    said = [f"at least {usable['in_time']:g} times that of the same tracker",
            f"at most {usable['error']:g} times the least",
            f"the spread is below {spread['csma']['below']:g}", f"it is above {spread['xmac 125']['above']:g}",
            f"on X-MAC at 500 ms above {spread['xmac 500']['above']:g}", f"at least {REGISTERED['in_time']:g} times",
            f"at most {REGISTERED['error']:g} times that on CSMA", f"more than {REGISTERED['lifetime']['days']:g} days",
            f"less than {REGISTERED['radio_on']['xmac 125']:.0%} of".replace("%", " %"),
            f"less than {REGISTERED['radio_on']['contikimac 125']:.0%} on".replace("%", " %"),
            f"at least {REGISTERED['latency']['head']:g} times", f"a step, {REGISTERED['latency']['sink']:g} s",
            f"at least {REGISTERED['delivered']:g} times those", f"at most {REGISTERED['follows']['energy']:g} times",
            f"more than {found['energy']:g} times", f"at least {found['delivered']:g} times",
            f"the spread is below {slow['spread']['csma']['below']:g}",
            f"less than {slow['expert']:g} times"]  # fmt: skip
    assert [words for words in said if words not in text] == []


def test_every_hypothesis_is_answered_once_both_fields_have_been_run():
    numbers = set(re.findall(r"^(\d+)\. ", TEXT, re.MULTILINE))
    answered = {
        each["words"].partition(":")[0] for name in page.FIELDS if name in ROWS for each in ROWS[name]["answers"]
    }
    assert answered <= numbers and (answered == numbers or not {*page.FIELDS} <= {*ROWS})
