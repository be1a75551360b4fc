"""Rows of variants that were run later join those that docs/frontier.json has, and the table shows all of them."""

from __future__ import annotations

import pandas as pd

from tests.papers.frontier_merge import merged, merged_strategies
from tests.papers.frontier_table import followers, rows_of
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


def test_the_table_has_those_that_follow_near_the_bound_by_error_and_the_file_has_all():
    part = {"bound": 0.1, "strategies": [
        row("ideal: ekf, fair", 0.14, 0.2, lost=0.1), row("ideal: gpf", 0.14, 0.4), row("slots: ukf", 0.11, 441.2),
        row("ideal: pf, fair", 0.12, 0.5), row("ideal: ppf, own readings", float("nan"), 1.0),
        row("ideal: rkf", 0.2, 1.0),
    ]}  # fmt: skip
    assert followers(part).splitlines()[2:] == [
        "| ideal | `pf` | fair | 0.12 [0.06, 0.24] | 1.20 | 0.5 |",
        "| ideal | `gpf` | defaults | 0.14 [0.07, 0.28] | 1.40 | 0.4 |",
        "| slots | `ukf` | defaults = fair | 0.11 [0.06, 0.22] | 1.10 | 441 |",
    ]
    rows = [*rows_of(part)]
    assert [one["strategy"] for one in rows] == ["ekf", "gpf", "ukf", "pf", "ppf, own readings", "rkf"]
    assert [one["follows"] for one in rows[:3]] == [False, True, True] and rows[0]["setting"] == "fair"


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
