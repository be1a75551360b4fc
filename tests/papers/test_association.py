"""The study of association: paired ratios and differences, the registered tests and their answers, on made-up runs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns

association = module("association")
SPREAD = np.array([0.98, 1.0, 1.02, 0.99, 1.01])


def data(tests, **levels):
    """Five runs of some variants, with a GOSPA of each level."""
    found = TablesOfRuns({
        name: pd.DataFrame({"replicate": range(5), "gospa": level * SPREAD}) for name, level in levels.items()
    })  # fmt: skip
    found.registered = {"level": 0.05, "tests": tests}
    return found


def test_ratios_are_geometric_means_and_differences_means_of_paired_runs_with_students_interval():
    noisy = 2.0 * np.array([1.1, 0.9, 1.0, 1.2, 0.8])
    both = data([], one=noisy, other=1.0)
    test = {"of": "one", "measure": "gospa", "below": 3.0}
    against, found = association.paired(both, test | {"over": "other"})
    logs = np.log(noisy)
    assert found == pytest.approx(
        (np.exp(logs.mean()), *np.exp(stats.t.interval(0.95, 4, logs.mean(), stats.sem(logs))), 5)
    )
    assert against == pytest.approx(logs - np.log(3.0))
    against, found = association.paired(both, test | {"less": "other"})
    apart = noisy * SPREAD - SPREAD
    assert found == pytest.approx((apart.mean(), *stats.t.interval(0.95, 4, apart.mean(), stats.sem(apart)), 5))
    assert against == pytest.approx(apart - 3.0)


def test_answers_are_of_holms_family_and_none_is_given_without_runs():
    test = {"number": 1, "of": "one", "less": "other", "measure": "gospa"}
    tests = [test | {"above": 0.5}, test | {"below": 0.5}, test | {"above": 1.0}, test | {"of": "none", "above": 1.0}]
    noise = 1.0 + np.array([0.02, -0.02, 0.04, -0.04, 0.0]) + 1.0 / SPREAD
    rows = association.tested(data(tests, one=noise, other=1.0, none=np.full(5, np.nan)))
    assert [row["answer"] for row in rows] == ["yes", "no", "undecided", "undecided"]
    assert rows[0]["p_holm"] == pytest.approx(3.0 * rows[0]["p"])
    assert association.words(rows[0]) == "1: one: gospa less that of other > 0.5"


def test_runs_that_do_not_differ_are_told_from_those_that_do_not_vary():
    assert [association._p(np.full(3, value)) for value in (0.0, 0.2)] == [1.0, 0.0]


def test_traffic_is_what_is_spent_on_the_air_and_latency_the_mean_over_targets():
    causes = ["tx_electronics", "tx_amplifier", "rx", "overhear", "idle", "cpu"]
    energy = pd.DataFrame({"replicate": [0] * 6 + [1], "cause": [*causes, "rx"], "joules": [1, 2, 4, 8, 16, 32, 5.0]})
    assert association.traffic(TablesOfRuns({"one": energy}), "one").to_dict() == {0: 15.0, 1: 5.0}
    tracks = pd.DataFrame({"replicate": [0, 0, 1], "delay": [1.0, np.nan, 3.0]})
    assert association.latency(TablesOfRuns({"one": tracks}), "one").to_dict() == {0: 1.0, 1: 3.0}
