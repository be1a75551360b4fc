"""The states of bursty links, against a loop over their changes in Python."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.bench.frames import bursty_links
from wsnsim.base.rng import uniforms
from wsnsim.kernels.bursty_losses import advance


def advance_twin(keys, durations, time, good, until, counts):
    """`advance` with one change after the other, and the numbers of `base.rng`."""
    for i in range(keys.size):
        while until[i] <= time:
            good[i] = not good[i]
            (u,) = uniforms(keys[i : i + 1], int(counts[i])).tolist()
            until[i] += durations[i, 1 if good[i] else 0] * -math.log1p(-u)
            counts[i] += 1
    return until.min(initial=math.inf)


@pytest.mark.parametrize("count", [1, 10])
@pytest.mark.parametrize("time", [0.0, 2.0, 50.0])
def test_the_states_at_a_time_are_those_of_the_twin(count, time):
    mine, twins = bursty_links(count), bursty_links(count)
    following, expected = advance(*mine[:2], time, *mine[3:]), advance_twin(*twins[:2], time, *twins[3:])
    assert following == pytest.approx(expected, rel=1e-12) and following > time
    for one, other in zip(mine[3:], twins[3:], strict=True):
        assert one == pytest.approx(other, rel=1e-12)


def test_a_link_without_an_end_of_its_state_never_changes():
    keys, durations, time, good, until, counts = bursty_links(3)
    until[:] = np.inf
    assert math.isinf(advance(keys, durations, time, good, until, counts))
    assert counts.tolist() == [2, 2, 2] and good.tolist() == [True, False, False]
