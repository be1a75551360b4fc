"""The same charge for several nodes, against array operations."""

from __future__ import annotations

import numpy as np

from wsnsim.base.radio import Mode
from wsnsim.kernels.charging import book, mark_busy

NODES = np.array([1, 4, 5])


def book_twin(nodes, joules, spent, spent_on):
    """`book` in array operations."""
    spent[nodes] += joules
    spent_on[nodes] += joules


def mark_busy_twin(nodes, seconds, busy, modes, counts):
    """`mark_busy` in array operations."""
    busy[nodes] += seconds
    counts[:] = np.bincount(modes[nodes], minlength=counts.size)


def test_a_charge_is_added_to_the_chosen_nodes_on_both_accounts():
    mine, twins = ([np.full(6, 1.0), np.full(6, 0.25)] for _ in range(2))
    book(NODES, 0.1, *mine)
    book_twin(NODES, 0.1, *twins)
    assert np.array_equal(mine, twins) and mine[0].tolist() == [1.0, 1.1, 1.0, 1.0, 1.1, 1.1]


def test_busy_seconds_are_added_and_the_modes_counted():
    modes = np.array([0, 1, 2, 3, 4, 4], dtype=np.int8)
    busy, counts = np.zeros(6), np.full(len(Mode), 9)
    mark_busy(NODES, 0.5, busy, modes, counts)
    assert busy.tolist() == [0.0, 0.5, 0.0, 0.0, 0.5, 0.5] and counts.tolist() == [0, 1, 0, 0, 2]
    twins = np.zeros(6), np.full(len(Mode), 9)
    mark_busy_twin(NODES, 0.5, twins[0], modes, twins[1])
    assert np.array_equal(busy, twins[0]) and np.array_equal(counts, twins[1])
