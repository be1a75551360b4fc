"""Allocation (Jiang 2013, eq. 25)."""

from __future__ import annotations

from fractions import Fraction
from math import floor

import numpy as np
import pytest

from wsnsim.kernels.allocation import allocate


@pytest.mark.thorough
def test_shares_sum_to_the_total_and_differ_by_one_at_most_for_every_number_of_particles_and_members() -> None:
    for active in range(1, 61):
        shares = np.array([allocate(total, active) for total in range(2001)])
        assert np.array_equal(shares.sum(axis=1), np.arange(2001))
        assert np.all(shares.max(axis=1) - shares.min(axis=1) <= 1)
        assert np.all(np.diff(shares, axis=1) >= 0)


def test_shares_follow_the_printed_recursion() -> None:
    for total, active in ((400, 17), (7, 3), (2, 5), (0, 4), (1600, 59)):
        dealt, expected = 0, []
        for i in range(1, active + 1):
            expected.append(floor(Fraction(total - dealt, active - (i - 1))))
            dealt += expected[-1]
        assert allocate(total, active).tolist() == expected


def test_nobody_gets_nothing() -> None:
    assert allocate(400, 0).size == 0
