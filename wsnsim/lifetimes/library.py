"""A library of simulated visits: what a visit adds to the energy of each node, and how well it is tracked.

    make_visit(setup, visit, number, dead) -> Library

Each visit is simulated twice with the same seed and run number: with the target, and without it. The difference is what
the visit adds. A window begins with a time in which the network settles, and ends when it has come to rest again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSES, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.batteries import Linear
from wsnsim.models.faults import Crash
from wsnsim.models.visits import Visits

PLENTY: Final = 1e6
"""J of the batteries in simulated visits."""
RECORDED: Final = {"energy": True, "nodes": True, "tracks": True}


class Visit(NamedTuple):
    """The window in which one visit is simulated.

    Attributes:
        visits: when visits come, and how the target moves in one.
        lead: time (s) before the visit, in which the network settles.
        tail: time (s) after the longest visit, in which it comes to rest.
        longest: the longest duration (s) of a visit.
    """

    visits: Visits
    lead: float
    tail: float
    longest: float

    @property
    def window(self) -> float:
        """The duration of the window in s."""
        return self.lead + self.longest + self.tail


@dataclasses.dataclass(frozen=True)
class Library:
    """K visits in a network of N nodes, some of which may be dead.

    Attributes:
        joules: (K, causes, N) what each visit adds to the energy of each node, by cause in J.
        tracked: (K,) share of the steps of each visit with an estimate.
        seconds: (K,) how long the target was there.
        dead: the nodes that were dead.
        false_time: (K,) s for which a track was kept after the target had left.
        rmse: (K,) m over the tracked steps of each visit; NaN without any.
    """

    joules: Floats
    tracked: Floats
    seconds: Floats
    dead: frozenset[int] = frozenset()
    false_time: Floats = dataclasses.field(default_factory=lambda: np.zeros(0))
    rmse: Floats = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def added(self) -> Floats:
        """(K, N) what each visit adds to the energy of each node, in J."""
        added: Floats = self.joules.sum(axis=1)
        return added

    def joined(self, other: Library) -> Library:
        """The visits of two libraries of the same network."""
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in ARRAYS}
        return Library(**both, dead=self.dead)


ARRAYS: Final = tuple(field.name for field in dataclasses.fields(Library) if field.name != "dead")
"""The arrays of a library, which are those of a visit's file."""


def without_failures(setup: NetworkSetup, dead: Iterable[int] = ()) -> NetworkSetup:
    """The setup without faults and with batteries of one kind; the nodes `dead` are down from the start."""
    crashes = (Crash(at=0.0, nodes=tuple(sorted(dead))),) if dead else ()
    return dataclasses.replace(setup, battery=Linear(), faults=crashes, until_clusters=None)


def window_setup(setup: NetworkSetup, visit: Visit, *, present: bool, dead: Iterable[int] = ()) -> NetworkSetup:
    """The setup of one window, with its visit or without; no battery is ever empty, and the nodes `dead` are down."""
    times = (visit.lead,) if present else ()
    motion = dataclasses.replace(visit.visits, rate=None, profile=None, path=None, times=times)
    return dataclasses.replace(
        without_failures(setup, dead),
        motions=(motion,),
        presence=(),
        energy=dataclasses.replace(setup.energy, battery=PLENTY),  # type: ignore[type-var]
        filter_motions=setup.filter_motions[:1],
        steps=round(visit.window / setup.dt) - 1,
    )


def make_visit(setup: NetworkSetup, visit: Visit, number: int, dead: frozenset[int] = frozenset()) -> Library:
    """The library of one visit: that of the run `number`.

    Raises:
        RunError: a simulation failed.
    """
    spent: list[Floats] = []
    rows: Mapping[str, Any] = {}
    for present in (True, False):
        memory = Memory(RECORDED)
        replicate_of(window_setup(setup, visit, present=present, dead=dead), number, memory)
        spent.append(joules_of(memory))
        rows = rows or memory.table("tracks")
    columns = ("tracked", "time_present", "false_time", "rmse")
    tracked, seconds, *more = (np.array(rows[name], np.float64) for name in columns)
    return Library((spent[0] - spent[1])[None], tracked, seconds, dead, *more)


def joules_of(memory: Memory) -> Floats:
    """(causes, N) the energy that each node has spent in a run, by cause in J."""
    rows = memory.table("energy")
    result = np.zeros((len(CAUSES), len(memory.table("nodes")["node"])))
    if rows:
        np.add.at(result, (rows["cause"], rows["node"]), rows["joules"])
    return result
