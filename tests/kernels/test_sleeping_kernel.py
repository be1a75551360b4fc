"""Which nodes listen, against masks."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.frames import sleepers
from wsnsim.kernels.sleeping import listening


def listening_twin(nodes, time, living, awake, begins, ends, held, since, result):
    """`listening` by masks."""
    result[:] = living & (awake[nodes] | (held[nodes] & (since[nodes] <= time)))
    return int((~((begins[nodes] <= time) & (time < ends[nodes]))).sum())


@pytest.mark.parametrize("count", [1, 7, 60])
def test_who_listens_and_whose_schedule_must_be_asked_are_those_of_the_twin(count):
    mine, twins = sleepers(count), sleepers(count)
    assert listening(*mine) == listening_twin(*twins)
    assert np.array_equal(mine[-1], twins[-1])


def test_a_schedule_is_asked_at_the_end_of_what_it_said_and_not_at_its_beginning():
    *arguments, result = sleepers(1)
    for time, unknown in ((1.0, 0), (2.0, 1)):
        arguments[1], arguments[4][:], arguments[5][:] = time, 1.0, 2.0
        assert listening(*arguments, result) == unknown
