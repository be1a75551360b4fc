"""Power of a network without a target, by node and cause."""

from __future__ import annotations

import dataclasses

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.lifetimes.library import RECORDED, Visit, joules_of, window_setup

SETTLED, SPAN = 120.0, 3600.0


@dataclasses.dataclass(frozen=True)
class Quiet:
    """Watts of each node by cause: (causes, N), and their standard errors."""

    watts: Floats
    error: Floats


def quiet_power(setup: NetworkSetup, visit: Visit, dead: frozenset[int], number: int = 0) -> Quiet:
    """From a long run."""
    spent = []
    for seconds in (SETTLED, SETTLED + SPAN):
        memory = Memory(RECORDED)
        replicate_of(window_setup(setup, visit._replace(tail=seconds - visit.lead - visit.longest), present=False, dead=dead), number, memory)
        spent.append(joules_of(memory))
    watts = (spent[1] - spent[0]) / SPAN
    return Quiet(watts, np.zeros_like(watts))
