"""docs/duty_cycles.md holds what docs/duty_cycles.json says, and what was registered."""

from __future__ import annotations

import hashlib
import json
import re

from tests.bench.page import spliced
from tests.papers import duty_cycles_page as page
from tests.papers.page_files import hypotheses, registered
from wsnsim.papers.study import study

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8")) if page.ROWS.exists() else {}
TEXT = page.PAGE.read_text(encoding="utf-8")
WORDS = registered("duty_cycles")
REGISTERED = study("duty_cycles").registered


def test_the_page_is_made_from_its_rows():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.duty_cycles_page writes it"


def test_its_files_have_all_rows_and_are_linked():
    made = page.files(ROWS)
    assert {name: (page.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert [name for name in made if f"]({name})" not in TEXT] == []
    assert made["duty_cycles_rows.csv"].count("\n") > 150 and "\nli_again," in made["duty_cycles_rows.csv"]


def test_every_figure_of_the_page_is_there():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", TEXT)
    assert shown and all((page.PAGE.parent / name).stat().st_size > 20_000 for name in shown)


def test_definitions_and_hypotheses_stand_word_for_word_as_they_were_when_the_replication_was_registered():
    words = WORDS[WORDS.index("**Definitions.**") : WORDS.index("**Departures from the registration**")]
    digest = hashlib.sha256(" ".join(words.split()).encode()).hexdigest()
    assert digest == "bf71f7044945b2bc9488decb6b6849c33b6da2fbe3bb821cd57e6755b4901e35"


def test_its_hypotheses_have_the_registered_thresholds():
    text, spread, slow = " ".join(WORDS.split()), REGISTERED["spread"], REGISTERED["slow"]
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
    numbers = set(hypotheses("duty_cycles"))
    answered = {page.number(words) for words, *_ in page.compared(ROWS)}
    assert answered <= numbers and (answered == numbers or not {*page.FIELDS} <= {*ROWS})


def test_the_replication_answers_the_hypotheses_of_the_first_study_on_the_seeds_that_the_page_names():
    pairs = page.compared(ROWS)
    run = {name for name in page.FIELDS if ROWS.get(name + page.AGAIN, {}).get("answers")}
    fields = {each["words"]: name for name in page.FIELDS for each in ROWS[name]["answers"]}
    again = {page.ASIDE.sub("", words): name for words, name in fields.items()}
    assert all((found is not None) == (again[words] in run) for words, _, found in pairs)
    assert re.search(r"20261123 on Li's field, 20261124 on Jiang's", WORDS)
    least = {name: min(row["runs"] for row in ROWS[name]["rows"].values()) for name in page.LEAST_RUNS if name in ROWS}
    answered = {name for name in least if ROWS[name]["answers"]}
    assert answered == {name for name, count in least.items() if count >= page.LEAST_RUNS[name]}


def study(answers, name="li"):
    """Rows of an experiment with these {words: answer}."""
    said = [{"words": words, "found": [(1.0, 0.9, 1.1)], "answer": answer} for words, answer in answers.items()]
    return {name: {"answers": said}}


def test_answers_that_changed_are_counted_and_named():
    first = {"10: a > 1": "yes", "2: b > 1": "yes", "3: c > 1": "no"}
    again = {"10: a > 1": "no", "2: b > 1": "undecided", "3: c > 1 (no interval is usable)": "no"}
    text = page._changed(study(first) | study(again, "li_again"))
    assert text == "Of 3 answers the replication repeats 1; 2 are others (hypotheses 2, 10), 1 of them the opposite."


def test_answers_without_a_replication_are_counted():
    found = study({"2: b > 1": "yes"}) | study({"15: a > 1": "yes"}, "jiang") | study({"2: b > 1": "yes"}, "li_again")
    assert page._changed(found) == (
        "Of 1 answers the replication repeats 1. 1 answers have no replication: their points are missing."
    )
    found |= {"jiang_again": {"answers": [], "too_few": {"ekf, csma": 4}}}
    assert page._changed(found).endswith(
        " Of `jiang_again`, which needs 6 runs of each point, these have fewer: ekf, csma (4)."
    )
    assert page.files(found)["duty_cycles_answers.csv"].splitlines()[-1] == '15: a > 1,"1 [0.9, 1.1]",yes,-,not run'
    answered = page.files(found)["duty_cycles_hypotheses.csv"].splitlines()
    assert answered[15].startswith("15,") and answered[15].endswith(",yes,-")
    assert (
        page.blocks(found)["counts"].splitlines()[1] == "- replication: Of 1 hypotheses: 1 yes (2), 0 no, 0 undecided."
    )
