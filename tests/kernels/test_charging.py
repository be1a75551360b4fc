"""The same charge for several nodes, against array operations."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.base.radio import Mode
from wsnsim.kernels.charging import book, mark_busy

NODES = np.array([1, 4, 5])


def book_twin(nodes, joules, spent, spent_on):
    """`book` in array operations."""
    spent[nodes] += joules
    spent_on[nodes] += joules


def mark_busy_twin(nodes, seconds, busy, states, counts, powers, causes, totals):
    """`mark_busy` in array operations."""
    busy[nodes] += seconds
    counts[:] = np.bincount(states[nodes], minlength=counts.size)
    for state, count in enumerate(counts.tolist()):
        totals[causes[state]] -= powers[state] * seconds * count


def test_a_charge_is_added_to_the_chosen_nodes_on_both_accounts():
    mine, twins = ([np.full(6, 1.0), np.full(6, 0.25)] for _ in range(2))
    book(NODES, 0.1, *mine)
    book_twin(NODES, 0.1, *twins)
    assert np.array_equal(mine, twins) and mine[0].tolist() == [1.0, 1.1, 1.0, 1.0, 1.1, 1.1]


def test_busy_seconds_are_added_and_what_they_would_have_cost_is_subtracted():
    states, powers, causes = (
        np.array([0, 1, 2, 3, 4, 4], dtype=np.int16),
        np.linspace(0.1, 0.3, 5),
        np.array([2, 1, 1, 0, 1]),
    )
    mine, twins = ((np.zeros(6), states, np.full(len(Mode), 9), powers, causes, np.full(3, 1.0)) for _ in range(2))
    mark_busy(NODES, 0.5, *mine)
    mark_busy_twin(NODES, 0.5, *twins)
    assert mine[0].tolist() == [0.0, 0.5, 0.0, 0.0, 0.5, 0.5] and mine[2].tolist() == [0, 1, 0, 0, 2]
    assert mine[-1].tolist() == twins[-1].tolist() == pytest.approx([1.0, 1.0 - 0.15 * 0.5 - 0.3 * 0.5 * 2, 1.0])
    assert np.array_equal(mine[0], twins[0]) and np.array_equal(mine[2], twins[2])
