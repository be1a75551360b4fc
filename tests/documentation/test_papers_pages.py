"""The pages of the papers have a row for each main claim, and the tables of networks have theirs."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from tests.documentation.pages_of_docs import block
from tests.papers import verdict_changes
from tests.readme_results import shown_rows
from tests.readme_tables import DENSITIES, RADIO_ROWS, SLEEPERS, commercial_radio, sleeping, sleeping_rarely
from wsnsim.papers.study import PAGES, PAPERS, study


def test_the_tables_of_the_papers_have_a_row_for_each_main_claim_with_what_was_published():
    lines = [
        (f"{name}, {row.experiment}", row.quantity, row.cells["variant"], row.cells.get("published", "-"))
        for name in PAPERS
        for row in shown_rows(name)
    ]
    claimed, orders = set(), 0
    for name in PAPERS:
        for experiment, claim in study(name).main:
            orders += bool(claim.other)
            number = getattr(claim, "published", None)
            published = "-" if number is None else ("about " if claim.read else "") + f"{number:.4g}"
            claimed.add((f"{name}, {experiment.name}", claim.label, claim.variant, published))
    assert set(lines) == claimed
    assert len(lines) == len(claimed) + orders > 50, "an order has a second row: the median of the paired differences"


def test_the_time_that_a_reproduction_takes_is_given_for_each_paper_and_study():
    rows = block("docs/papers/index.md", "run_times").splitlines()[2:]
    assert re.findall(r"reproduce (\w+) --full", "\n".join(rows)) == list(PAGES)


def test_all_experiments_of_all_papers_were_run_by_one_commit():
    lines = re.findall("^- commit .*", block("docs/papers/index.md", "run_times"), re.MULTILINE)
    assert any({*re.findall(r"`(\w+)`(?! \()", line)} >= {*PAPERS} for line in lines)


def test_tables_of_the_commercial_radio_and_of_sleeping_networks_have_a_row_for_each_scenario():
    sleepers = [*SLEEPERS.values()]
    for page, name, labels in (
        ("commercial_radio", "commercial_radio", RADIO_ROWS),
        ("li2012", "sleeping", sleepers * 3),
        ("li2012", "sleeping_rarely", sleepers),
    ):
        rows = block(f"docs/papers/{page}.md", name).splitlines()[2:]
        assert all(f"`{label}`" in row for label, row in zip(labels, rows, strict=True))


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


def test_the_rows_of_sleeping_networks_are_what_a_hand_would_compute():
    points = [(name, nodes, step) for name in SLEEPERS for nodes in DENSITIES for step in (2.0, 10.0)]
    of = [{"scenario": name, "deploy.nodes": nodes, "step": step} for name, nodes, step in points for _ in range(6)]
    runs = pd.DataFrame(of).assign(steps=100)
    tracks = pd.DataFrame(of).assign(
        tracked=0.914, tracked_three=0.625, median_error_three=1.75, delay=0.024, report_delay=np.nan, received=12,
        due=20, ineffective_twenty=24, ineffective=670, dismissed=260, reacquired=12,
    )  # fmt: skip
    lines = sleeping(tracks, runs).splitlines()
    assert lines[2] == "| 200 | `gmtt, literal` | 91.4 [91.4, 91.4] | 62.5 | 1.75 | 24 ms, - | 60 | 24 | 2.6 |"
    assert lines[3].startswith("|  | `gmtt, repaired` | ") and len(lines) == 17
    first = sleeping_rarely(tracks, runs).splitlines()[2]
    assert first == "| `gmtt, literal` | 91.4 [91.4, 91.4] | 62.5 | 1.75 | 12 | 6.7 |"


def test_changes_of_verdicts_between_two_pages_have_their_reasons(monkeypatch):
    def page(quantity, measured, verdict, outcome=""):
        row = f"**{quantity}**\n\n| variant | published | measured [95 %] | verdict |\n| --- | --- | --- | --- |\n"
        claim = f"| {quantity} | pf | {outcome} | 1 | - | contradicted |"
        table = (
            f"### Claims of wei2022, each printed number once\n\n| quantity |\n| --- |\n{claim}\n" if outcome else ""
        )
        return (f"<!-- wei2022: made by make readme -->\n### wei2022, table_1\n\n{row}"
                f"| pf | 1 | {measured} | {verdict} |\n\n{table}\nVerdicts on all claims:\n")  # fmt: skip

    before = page("RMSE (table 1)", "2 [1, 3]", "undecided")
    for after, reason in (
        (page("RMSE (from table 1)", "2 [1, 3]", "undecided", "derived (not counted)"), "counting rule"),
        (page("RMSE (table 1)", "2 [1, 3]", "compatible", "printed numbers"), "counting rule"),
        (page("RMSE (table 1)", "4 [3, 5]", "does not reproduce", "printed numbers"), "new runs"),
        (page("RMSE, N = 5 (table 1)", "4 [3, 5]", "reproduces"), "new reading, or new main row"),
        (page("RMSE (table 1)", "2 [1, 3]", "undecided", "printed numbers"), None),
    ):
        pages = {"old": before, "new": after}
        monkeypatch.setattr(verdict_changes, "text_of", lambda name, revision, of=pages: of[revision])
        monkeypatch.setattr(verdict_changes, "PAPERS", ("wei2022",))
        found = [row[-1] for row in verdict_changes.changes("old", "new")]
        assert found[-1:] == ([reason] if reason else []), found
