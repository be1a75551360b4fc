"""The README is short, its figures are computed, and what it names exists."""

from __future__ import annotations

import re

import pytest

from tests import readme_results
from tests.documentation.pages_of_docs import ROOT, block, text
from tests.readme import BLOCKS, spliced
from tests.readme_results import OUTCOMES, PAPERS, counted, listening, measured, outcome_table, results, total
from wsnsim.papers.table import OTHER_BASES

README = text("README.md")
ROWS = [line for line in README.splitlines() if line.startswith("|")]


def test_it_has_at_most_a_thousand_words_and_no_table_is_wider_than_a_screen():
    assert len(README.split()) <= 1000
    assert len(README.splitlines()) <= 200
    assert len(ROWS) >= 10
    assert [row for row in ROWS if len(row) > 100] == []


def test_the_results_are_those_of_the_pages():
    assert block("README.md", "results") == results(), "make readme ARGS=results"
    assert len(re.findall("^- ", results(), re.MULTILINE)) == 5


def test_openings_of_pages_and_the_table_of_papers_are_made_from_the_rows_of_the_pages():
    """The table of a page has as many claims of each outcome that are counted as its line says."""
    for name in ("outcomes", "frontier_opening", *(f"{paper}_counts" for paper in PAPERS)):
        page, made = BLOCKS[name]
        assert block(str(page.relative_to(ROOT)), name) == made(name), f"make readme ARGS={name}"
    for name in PAPERS:
        rows = [line for line in block(f"docs/papers/{name}.md", name).splitlines() if line.startswith("| ")][2:]
        outcomes = [line.strip("| ").split(" | ")[-1] for line in rows]
        outcomes = [each for each in outcomes if not each.endswith(tuple(f"({basis})" for basis in OTHER_BASES))]
        said = counted(name)["printed numbers"] + counted(name)["in words"]
        for word in OUTCOMES:
            members = [each for each in outcomes if each.startswith(word)]
            assert len(members) == said[word]
            assert sum("out of reach" in each for each in members) == said[f"never {word}"]


def test_figures_of_results_are_taken_from_the_pages_as_they_stand():
    assert total(counted("jiang2013")["in words"]) > 5 and total(counted("wei2022")["printed numbers"]) > 9
    rmse = measured("jiang2013", "RMSE, m")
    assert list(rmse)[:3] == ["pso_mhpf", "ipf", "ppf"] and rmse["ppf"] > 10 * rmse["ppf, noise x100"]


def test_outcomes_are_read_from_a_count_line_and_words_that_depend_on_the_reading_have_a_column(monkeypatch):
    line = ("- wei2022: 9 printed numbers: 7 contradicted (3 out of reach), "
            "2 undecided (1 out of reach); "
            "3 in words: 2 undecided, 1 dependent on the reading; 8 readings counted at most")  # fmt: skip
    monkeypatch.setattr(readme_results, "counted_lines", lambda: line)
    monkeypatch.setattr(readme_results, "PAPERS", ("wei2022",))
    numbers, words, derived = counted("wei2022").values()
    assert numbers == {"contradicted": 7, "never contradicted": 3, "undecided": 2, "never undecided": 1}
    assert words == {"undecided": 2, "dependent": 1} and total(numbers) == 9 and not derived
    cells = "9 | 0 | 7 (3) | 2 (1) | 0 | 3 | 0 | 0 | 2 | 1 | 8 |"
    assert outcome_table().splitlines()[-1] == f"| [Wei 2022](wei2022.md) | {cells}"
    outcomes = "7 contradicted (3 out of reach), 2 undecided (1 out of reach)"
    assert f"of 9 printed numbers, {outcomes}; of 3 statements in words, 2" in readme_results.opening("wei2022")
    said = readme_results.reproduction()
    assert "the 9 printed numbers of 1 papers that can be judged, none is reproduced, 7 are contradicted, 2 are" in said
    assert '3 statements such as "A is more accurate than B", none is reproduced, 2 are undecided, 1 is dep' in said


@pytest.mark.parametrize(
    ("usable", "said"), [(2, "times as large: ["), (1, "1 of 2 pairs"), (0, "no interval of X-MAC")]
)
def test_pairs_of_tracker_and_mac_without_a_usable_interval_are_counted(usable, said):
    def row(energy, delivered):
        return {"energy, J": [energy], "latency at the head, s": [energy / 10], "delivered": [delivered],
                "RMSE of a run, m": [2.0]}  # fmt: skip

    li = {"rows": {"gmtt, csma": row(600.0, 0.9), "gmtt, xmac 125": row(20.0, 0.8)}, "best_points": [
        {"tracker": "gmtt", "mac": mac, "csma": "gmtt, csma", "point": "gmtt, xmac 125" if number < usable else ""}
        for number, mac in enumerate(("xmac", "tsch"))
    ]}  # fmt: skip
    sentence = listening(li)
    assert said in sentence and "600 to 600 J" in sentence
    assert ("20 to 20 J" in sentence and "10 to 10 percentage points fewer" in sentence) is (usable > 0)


def test_every_link_leads_to_a_file_that_exists():
    targets = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", README) + re.findall(r"^\[\w+\]: (\S+)", README, re.MULTILINE)
    assert len(targets) > 20
    assert [target for target in targets if not (ROOT / target).exists()] == []


def test_every_picture_that_is_shown_is_there():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert shown and all((ROOT / name).stat().st_size > 20_000 for name in shown)


def test_what_is_validated_names_tests_and_targets_that_exist():
    (section,) = re.findall(r"^## What is validated against what\n(.*?)^## ", README, re.DOTALL | re.MULTILINE)
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    named = re.findall(r"`(tests/[\w/]+(?:\.py)?)`", section)
    targets = re.findall(r"`make (\w+)`", section)
    assert len(rows) >= 9 and all(re.search(r"`tests/|`make |\]", row) for row in rows)
    assert len(named) >= 6 and [name for name in named if not (ROOT / name).exists()] == []
    assert targets and set(targets) <= set(re.findall(r"^(\w+):", text("Makefile"), re.MULTILINE))


def test_it_says_how_to_run_test_install_and_cite():
    for words in ("make run", "make test", "pip install", "CITATION.cff"):
        assert words in README


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_that_make_readme_writes_has_its_marks_once(name):
    page, _ = BLOCKS[name]
    assert "\nanother\n" in spliced(page.read_text(encoding="utf-8"), name, "another")


def test_no_entry_of_the_changelog_and_no_term_of_the_glossary_stands_twice():
    entries = re.findall(r"^- .*", text("CHANGELOG.md"), re.MULTILINE)
    rows = re.findall(r"^\| ([^|(]+?) (?:\([^|]*\) )?\|", text("docs/glossary.md"), re.MULTILINE)
    terms = [term.removesuffix(" of a claim") for term in rows if term not in ("term", "---", "short")]
    assert len(entries) > 10 and len(set(entries)) == len(entries)
    assert len(terms) > 100 and len(set(terms)) == len(terms)
