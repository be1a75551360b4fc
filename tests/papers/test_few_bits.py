"""The study of few bits: ratios of paired runs, the registered tests and their answers, on tables that are made up."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns

few_bits = module("few_bits")
SPREAD = np.array([0.98, 1.0, 1.02, 0.99, 1.01])


def data(tests, **levels):
    """Five runs of some variants, with an RMSE and an energy around each level."""
    runs = {
        name: pd.DataFrame({"replicate": range(5), "rmse": level * SPREAD, "energy": level}) for name, level in
        {"full": 1.0, **levels}.items()
    }  # fmt: skip
    found = TablesOfRuns(runs)
    found.registered = {"level": 0.05, "tests": tests}
    return found


def test_a_ratio_is_the_geometric_mean_of_paired_runs_with_students_interval():
    noisy = 2.0 * np.array([1.1, 0.9, 1.0, 1.2, 0.8])
    found = few_bits.ratio(data([], one=noisy), "one", "full", "error")
    logs = np.log(noisy)
    wanted = stats.t.interval(0.95, 4, logs.mean(), stats.sem(logs))
    assert found == pytest.approx((np.exp(logs.mean()), *np.exp(wanted), 5))


def test_runs_without_a_value_are_left_out_and_too_few_have_no_interval():
    gone = np.where(np.arange(5) < 4, np.nan, 1.0)
    assert few_bits.ratio(data([], one=gone), "one", "full", "error").runs == 1
    assert np.isnan(few_bits.ratio(data([], one=gone), "one", "full", "error").value)


def test_answers_are_of_holms_family_and_none_is_given_without_runs():
    test = {"number": 1, "of": "one", "over": "full", "measure": "error"}
    tests = [test | {"below": 1.5}, test | {"above": 1.5}, test | {"below": 1.0}, test | {"of": "none", "above": 1.0}]
    noise = np.exp(0.02 * np.array([1.0, -1.0, 2.0, -2.0, 0.0]))
    rows = few_bits.tested(data(tests, one=noise, none=np.full(5, np.nan)))
    assert [row["answer"] for row in rows] == ["yes", "no", "undecided", "undecided"]
    assert rows[0]["p_holm"] == pytest.approx(3.0 * rows[0]["p"])
    assert few_bits.words(rows[0]) == "1: one: error over that of full < 1.5"


def test_traffic_is_what_is_spent_on_the_air():
    causes = ["tx_electronics", "tx_amplifier", "rx", "overhear", "idle", "cpu"]
    table = pd.DataFrame({"replicate": [0] * 6 + [1], "cause": [*causes, "rx"], "joules": [1, 2, 4, 8, 16, 32, 5.0]})
    assert few_bits.traffic(TablesOfRuns({"one": table}), "one").to_dict() == {0: 15.0, 1: 5.0}
