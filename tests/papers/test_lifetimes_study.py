"""The measures of the study of lifetimes, on rows whose answers are known."""

from __future__ import annotations

import numpy as np

from tests.papers import lifetimes_study as study


def rows(lives, spent, two_term=1.0):
    """Rows of one deployment: days of each variant at all rates, and joules."""
    names = [variant.name for variant in study.VARIANTS]
    return {
        name: [
            {"run": joules, "tracked": 1.0, "quiet": 1e-4, "visit": 1e-2,
             "life": {f"{rate:g}": {"first_death": 0.5 * days, "half_dead": days, "two_term": two_term * days}
                      for rate in study.RATES}}
        ]
        for name, days, joules in zip(names, lives, spent, strict=True)
    }  # fmt: skip


def test_tau_is_1_where_fewest_joules_live_longest_and_minus_1_where_most_do():
    days = np.arange(9.0) + 1.0
    assert study.taus(rows(days, -days), 1.0) == [1.0]
    assert study.taus(rows(days, days), 1.0) == [-1.0]


def test_the_best_interval_is_that_of_the_longest_life_among_those_of_xmac():
    assert study.best(rows([1, 2, 4, 3, 9, 9, 9, 9, 9], np.ones(9)), 10.0) == ["gmtt, xmac 500"]


def test_two_terms_are_compared_with_half_dead():
    found = study.tests(rows(np.ones(9), np.ones(9), two_term=1.03))[3]
    assert found == [False]
    assert study.tests(rows(np.ones(9), np.ones(9), two_term=1.01))[3] == [True]


def test_a_hypothesis_is_answered_only_if_all_deployments_agree():
    assert [study.answer(each) for each in ([True, True], [True, False], [False, False])] == ["yes", "undecided", "no"]
