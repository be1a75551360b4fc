"""The pages of the papers have a row for each counted claim, the files beside them all rows."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from tests.documentation.pages_of_docs import block, text
from tests.papers import verdict_changes
from tests.readme_results import rows_of
from tests.readme_tables import RADIO_ROWS, commercial_radio
from wsnsim.papers.counts import OUTCOMES
from wsnsim.papers.study import PAGES, PAPERS, study
from wsnsim.papers.table import OTHER_BASES


@pytest.mark.parametrize("name", PAPERS)
def test_the_file_of_a_paper_has_rows_for_each_claim_with_what_was_published(name):
    found = pd.read_csv(rows_of(name)).fillna({"published": 0.0, "where": ""})
    kept = zip(found["experiment"], found["variant"], found["quantity"], found["published"].map("{:.4g}".format),
               strict=True)  # fmt: skip
    shown = [(one.name, claim) for one in study(name).experiments for claim in one.claims if claim.shown]
    assert {*kept} == {(one, claim.variant, claim.label, f"{float(f'{claim.published or 0.0:.6g}'):.4g}")
                        for one, claim in shown}  # fmt: skip
    assert len(found) == len(shown) + sum(bool(claim.other) for _, claim in shown), "an order has a second row"


@pytest.mark.parametrize("name", PAPERS)
def test_the_page_of_a_paper_has_a_row_for_each_counted_claim_and_counts_the_others(name):
    lines = block(f"docs/papers/{name}.md", name).splitlines()
    rows = [line for line in lines if line.startswith("| ")]
    others = " ".join(line for line in lines if " not counted, in " in line)
    found = pd.read_csv(rows_of(name), keep_default_na=False)
    judged = found[(found["literal"] == True) & (found["paired"] == False)]  # noqa: E712 (columns of pandas)
    judged = judged[judged["verdict"].isin(OUTCOMES) & ~judged["kind"].str.startswith("derived")]
    claims = judged.drop_duplicates(["where", "quantity", "variant", "basis"])
    shown = [any(f"({basis}) |" in row for basis in OTHER_BASES) for row in rows[2:]]
    assert shown.count(False) == (claims["basis"] == "evidence").sum() > 2
    apart = sum(map(int, re.findall(r"(\d+) [a-z]+", others.partition(": ")[2])))
    assert shown.count(True) + apart == (claims["basis"] != "evidence").sum()
    assert f"({name}.csv)" in text(f"docs/papers/{name}.md")


def test_the_time_that_a_reproduction_takes_is_given_for_each_paper_and_study():
    rows = block("docs/papers/index.md", "run_times").splitlines()[2:]
    assert re.findall(r"reproduce (\w+) --full", "\n".join(rows)) == list(PAGES)


def test_all_experiments_of_all_papers_were_run_by_one_commit():
    lines = re.findall("^- commit .*", block("docs/papers/index.md", "run_times"), re.MULTILINE)
    assert any({*re.findall(r"`(\w+)`(?! \()", line)} >= {*PAPERS} for line in lines)


def test_the_table_of_the_commercial_radio_has_a_row_for_each_scenario():
    rows = block("docs/papers/commercial_radio.md", "commercial_radio").splitlines()[2:]
    assert all(f"`{label}`" in row for label, row in zip(RADIO_ROWS, rows, strict=True))


def test_the_row_of_a_scenario_on_the_commercial_radio_is_what_a_hand_would_compute():
    runs = pd.DataFrame({"scenario": name, "steps": 700, "rmse": float(i), "energy": 440.0 + i}
                        for name in RADIO_ROWS for i in range(6))  # fmt: skip
    tracks = pd.DataFrame({"scenario": name, "reports": 690, "late": 12, "delay": 0.004 + i / 1000, "lost": i == 5,
                           "losses": int(i > 3)} for name in RADIO_ROWS for i in range(6))  # fmt: skip
    lines = commercial_radio(tracks, runs).splitlines()
    assert "steps with an estimate, of 700" in lines[0] and len(lines) == 9
    cells = lines[-1].strip("| ").split(" | ")
    assert cells[0].startswith("`ekf_real`") and cells[1:4] == ["690", "2", "6.5 ms"]
    assert cells[4].startswith("2.5 [") and cells[5:] == ["1, 2 of 6", "442"]


def test_changes_of_verdicts_between_two_revisions_have_their_reasons(monkeypatch):
    def rows(measured, verdict, quantity="RMSE (table 1)", published=1.0):
        content = [("table_1", quantity, "pf", "printed numbers", True, False, published, measured, verdict)]
        return pd.DataFrame(content, columns=verdict_changes.COLUMNS)

    before = rows(2.0, "undecided")
    for after, reason in (
        (rows(2.0, "compatible"), "rule"),
        (rows(4.0, "does not reproduce"), "new runs"),
        (rows(4.0, "reproduces", published=2.0), "the published value is read differently"),
        (rows(4.0, "reproduces", "RMSE (table 2)"), "new row"),
        (before, None),
    ):
        both = {"old": before, "new": after}
        monkeypatch.setattr(verdict_changes, "rows", lambda name, revision, of=both: of[revision])
        monkeypatch.setattr(verdict_changes, "PAPERS", ("wei2022",))
        found = [row[-1] for row in verdict_changes.changes("old", "new")]
        assert found[-1:] == ([reason] if reason else []), found
