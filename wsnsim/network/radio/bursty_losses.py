"""Losses in bursts: the Gilbert-Elliott states of the links of one sender.

LinkStates(keys, ratios, losses, since).ratios(time) -> (n,) probability that a frame arrives now
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.radio import BurstyLosses
from wsnsim.base.rng import uniforms
from wsnsim.kernels.reception import advance


class LinkStates:
    """The states of links (n,), good or bad, whose stationary mean is a given ratio.

    The share of time in a good state is (ratio - bad) / (good - bad), and a bad state lasts `bad_time` on average. A
    link whose ratio is not between `bad` and `good` has one state, in which frames arrive with that ratio. The states
    are stationary from the first instant on, and a function of key and time.

    Args:
        keys: (n,) random keys.
        ratios: (n,) mean probability that a frame arrives.
        losses: The model.
        since: The time in s from which on the states are known.
    """

    def __init__(self, keys: Keys, ratios: Floats, losses: BurstyLosses, since: float) -> None:
        shares = (ratios - losses.bad) / (losses.good - losses.bad)
        changing = (shares > 0.0) & (shares < 1.0)
        shares = np.where(changing, shares, 0.5)
        self._keys = keys
        self._durations = np.column_stack([np.ones(keys.size), shares / (1.0 - shares)]) * losses.bad_time
        self._when_good = np.where(changing, losses.good, ratios)
        self._when_bad = np.where(changing, losses.bad, ratios)
        self._good = uniforms(keys, 0) < shares
        first = np.where(self._good, self._durations[:, 1], self._durations[:, 0])
        self._until = np.where(changing, since - first * np.log1p(-uniforms(keys, 1)), np.inf)
        self._counts = np.full(keys.size, 2)
        self._next = -np.inf
        self._ratios = ratios

    def ratios(self, time: float) -> Floats:
        """(n,) probability that a frame arrives that begins at `time` (s), not before that of an earlier call."""
        if time >= self._next:
            self._next = advance(self._keys, self._durations, time, self._good, self._until, self._counts)
            self._ratios = np.where(self._good, self._when_good, self._when_bad)
        return self._ratios
