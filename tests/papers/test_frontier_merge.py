"""Rows of variants that were run later join those that docs/frontier.json has, and the table shows all of them."""

from __future__ import annotations

import pandas as pd

from tests.papers.frontier_merge import merged, merged_strategies, of_row
from tests.papers.frontier_table import frontier_table
from tests.papers.studies import module
from wsnsim.papers.rows import Interval
from wsnsim.papers.study import study

hypotheses = module("frontier", "hypotheses")

REGISTERED = study("frontier").registered


def answer(words, said="yes"):
    return {"words": words, "found": [], "answer": said}


def row(variant, rmse, energy, lost=0.0, in_time=1.0):
    return {"variant": variant, "rmse": rmse, "low": rmse / 2.0, "high": 2.0 * rmse, "energy": energy, "lost": lost,
            "in_time": in_time, "runs": 10}  # fmt: skip


def test_new_rows_and_answers_replace_those_of_the_same_variant_and_leave_the_others():
    before = {"rows": {"a": {"runs": 50}, "b": {"runs": 60}},
              "answers": [answer("3 (2): no run of 60 loses"), answer("3 (3): no run of 50 loses", "no")]}  # fmt: skip
    new = {"rows": {"a": {"runs": 60}, "c": {"runs": 5}},
           "answers": [answer("3 (3): no run of 60 loses"), answer("4 (3): x")]}  # fmt: skip
    found = merged(before, new)
    assert found["rows"] == {"a": {"runs": 60}, "b": {"runs": 60}, "c": {"runs": 5}}
    assert [(one["words"], one["answer"]) for one in found["answers"]] == [
        ("3 (2): no run of 60 loses", "yes"), ("3 (3): no run of 60 loses", "yes"), ("4 (3): x", "yes"),
    ]  # fmt: skip


def test_answers_on_strategies_follow_from_all_of_them_and_those_on_pairs_stay():
    before = {"strategies": [row("ideal: information_driven", 0.1, 1.0), row("ideal: gpf, fair", 0.13, 2.0)],
              "answers": [answer("15: median"), answer("13: on the ideal radio", "no")]}  # fmt: skip
    new = {"strategies": [row("ideal: imm", 0.14, 0.5)], "bound": 0.1, "answers": []}
    found = merged_strategies(before, new, REGISTERED)
    assert [one["variant"] for one in found["strategies"]][-1] == "ideal: imm" and found["bound"] == 0.1
    cheapest = next(one for one in found["answers"] if one["words"].startswith("13:"))
    assert "it is ideal: imm" in cheapest["words"] and cheapest["answer"] == "no"
    assert [one["words"] for one in found["answers"] if one["words"].startswith("15")] == ["15: median"]


def test_the_table_is_sorted_by_error_and_names_the_setting():
    part = {"bound": 0.1, "strategies": [
        row("ideal: ekf, fair", 0.3, 0.2, lost=0.1), row("ideal: gpf", 0.2, 0.4), row("slots: ukf", 150.0, 441.2),
        row("ideal: ppf, own readings", float("nan"), 1.0),
    ]}  # fmt: skip
    lines = [line for line in frontier_table(part).splitlines() if line.startswith("| ") and "---" not in line]
    assert lines[1] == "| `gpf` | defaults | 0.20 [0.10, 0.40] | 2.00 | 0.4 | 0 of 10 | 100% | **yes** |"
    assert lines[2] == "| `ekf` | fair | 0.30 [0.15, 0.60] | 3.00 | 0.2 | 1 of 10 | 100% | no |"
    assert "own readings" in lines[3]
    assert lines[5].startswith("| slots | `ukf` | defaults = fair | 150 [75.00, 300] |")
    assert of_row(part["strategies"][0]).follows is False


def test_hypothesis_8_is_answered_from_the_runs_that_were_lost():
    ours, rival = "2 % awake: information_driven", "2 % awake: gpf, fair"
    lost = {ours: pd.Series([0.0, 1.0, 0.0, 0.0]), rival: pd.Series([1.0] * 4)}
    worse, timely = hypotheses.of_losses(lost, Interval(0.9, 0.85, 0.95), 0.8)
    assert worse.found[0].value == 0.75 and rival in worse.words
    assert timely.answer == "yes"
    equal, _ = hypotheses.of_losses({**lost, rival: lost[ours]}, Interval(0.9, 0.85, 0.95), 0.8)
    assert equal.answer == "undecided" and equal.found[0].value == 0.0


def test_runs_that_only_one_of_the_two_has_are_not_compared():
    ours, rival = "2 % awake: information_driven", "2 % awake: ekf, fair"
    lost = {ours: pd.Series({"0": 0.0, "1": 1.0, "2": 0.0}), rival: pd.Series({"1": 1.0, "2": 1.0, "7": 1.0})}
    worse, _ = hypotheses.of_losses(lost, Interval(0.9, 0.85, 0.95), 0.8)
    assert worse.found[0].value == 0.5
