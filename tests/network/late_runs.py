"""Runs of scenarios whose hops are late, for tests of what cluster heads wait for."""

from __future__ import annotations

from functools import cache
from typing import cast

import numpy as np

import wsnsim
from tests.helpers import late_mac
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import KIND, Memory
from wsnsim.scenario.build import build

LATE = "mac={{kind: 'tests.helpers.late_mac:LateCsma', rate: 250 kbit/s, interval: {0} s}}"
CALM = (
    "step=1 s", "duration=20 s", "packing={kind: frames}", "motion.c1=0.02", "motion.c2=0.3", "motion.sigma0=0.3",
    "motion.start=[-45,-6,-50,-9]", "sink={kind: none}",
)  # fmt: skip
"""Jiang's field with steps of 1 s, in which a duty-cycled radio can report, and a target that steps of 1 s allow."""
MOVING = "clusters={{kind: moving_head, main: {0}}}"


class Run:
    """A run, its scenario's setup, tables, and what the MAC was told about wake intervals."""

    def __init__(self, name: str, *changes: str) -> None:
        self.memory = Memory()
        scenario = wsnsim.load(name, changes)
        self.setup = cast(NetworkSetup, build(scenario))
        self.summary = wsnsim.experiment.simulate_run(scenario, 0, self.memory)
        self.hurried = late_mac.STARTED[0].hurried if late_mac.STARTED else []
        self.events = self.memory.table("events")
        self.estimates = self.memory.table("estimates")

    def times(self, kind: str, what: str | None = None) -> np.ndarray:
        chosen = self.events["kind"] == KIND[kind]
        if what is not None:
            chosen &= self.events["what"] == self.memory.words.code(what)
        times: np.ndarray = self.events["time"][chosen]
        return times


@cache
def played(name: str, *changes: str) -> Run:
    """A run that several tests look at."""
    return Run(name, *changes)
