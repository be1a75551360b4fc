"""The study of late readings: shares and ratios of paired runs, pooled over radios, on tables that are made up."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns

late = module("late")
RADIOS = {"xmac": "csma", "tsch": "csma"}
NOISE = np.array([0.02, -0.02, 0.01, -0.01, 0.03, -0.03])


def data(tests, **errors):
    """Six runs of two radios: radios that always listen have an error of 1, those that ignore late readings e."""
    levels = {"ignore": np.exp(1.0 + 10 * NOISE), **errors}
    runs = {
        f"{radio} 500, {way}": pd.DataFrame({"replicate": range(6), "rmse": level, "energy": 2.0})
        for radio in RADIOS for way, level in levels.items()
    }  # fmt: skip
    runs["csma"] = pd.DataFrame({"replicate": range(6), "rmse": 1.0, "energy": 9.0})
    found = TablesOfRuns(runs)
    found.registered = {"level": 0.05, "radios": RADIOS, "tests": tests}
    return found


def test_the_share_is_what_comes_back_of_the_logarithm_of_the_error():
    half = np.exp(0.5 + 10 * NOISE)
    found = late.share(data([], refilter=half), 500, "refilter", list(RADIOS))
    assert found.value == pytest.approx(0.5) and found.low < 0.5 < found.high and found.runs == 6


def test_a_ratio_is_pooled_over_radios_with_students_interval_and_needs_all_of_them():
    one, gone = np.exp(10 * NOISE), np.where(np.arange(6) < 5, np.nan, 1.0)
    found = late.ratio(data([], refilter=one), 500, "refilter", "timely", "error", list(RADIOS))
    assert found == pytest.approx((1.0, *np.exp(stats.t.interval(0.95, 5, 0.0, stats.sem(10 * NOISE))), 6))
    assert np.isnan(late.ratio(data([], refilter=gone), 500, "refilter", "ignore", "error", list(RADIOS)).value)


def test_answers_are_of_holms_family():
    share = {"number": 1, "interval": 500, "measure": "share", "of": "refilter"}
    energy = {"number": 3, "interval": 500, "measure": "error", "of": "refilter", "over": "wait"}
    tests = [share | {"above": 0.3}, share | {"above": 0.9}, energy | {"below": 1.0}]
    wait = np.exp(0.5 + 10 * NOISE) * np.exp(np.array([0.1, -0.1, 0.2, -0.2, 0.3, -0.3]))
    rows = late.tested(data(tests, refilter=np.exp(0.5 + 10 * NOISE), wait=wait))
    assert [row["answer"] for row in rows] == ["yes", "no", "undecided"]
    assert late.words(rows[0]) == "1: at 500 ms: share of the error that comes back by refilter > 0.3"
    assert late.words(rows[2]) == "3: at 500 ms: error of refilter over that of wait < 1"
