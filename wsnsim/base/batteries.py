"""The port of batteries: what nodes are supplied from, and how the charge in it changes with the load.

Arrays are over nodes. A battery is empty when nothing can be drawn from it, though charge may be left in it.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from wsnsim.base.arrays import Floats, Ints


class BatteryState(NamedTuple):
    """The batteries of n nodes. Energies are charges times the stated voltage.

    Attributes:
        capacity: (n,) J that each holds at most; infinite on mains.
        reserve: (n,) J of these that can never be drawn.
        leak: (n,) W of self-discharge.
        left: (n,) J in each now, drawable or not; infinite on mains.
        uneven: (M, n) J by which each of M modes of the charge's distribution is away from its equilibrium; (0, n) for
            a battery that gives all its charge at any load.
    """

    capacity: Floats
    reserve: Floats
    leak: Floats
    left: Floats
    uneven: Floats

    def of(self, nodes: Ints | slice) -> BatteryState:
        """The state of some of the nodes."""
        return BatteryState(*(column[..., nodes] for column in self))


class Advance(NamedTuple):
    """What happened to batteries in a span of time. That of a node ends when its battery is empty.

    `state.left` is what was left, plus `harvested`, less `spent`, `leaked`, `unstored` and `surplus`.

    Attributes:
        state: at the end of the span.
        died_after: (n,) s from its beginning until the battery was empty; infinite if it was not.
        spent: (n,) J drawn by the load.
        leaked: (n,) J of self-discharge.
        harvested: (n,) J that the harvester offered.
        unstored: (n,) J of these that were lost when they were stored.
        surplus: (n,) J of these that a full battery could not take.
    """

    state: BatteryState
    died_after: Floats
    spent: Floats
    leaked: Floats
    harvested: Floats
    unstored: Floats
    surplus: Floats


class Income(NamedTuple):
    """What a harvester offers from now on.

    Attributes:
        watts: its power in W.
        until: the time in s at which it changes; infinite if never.
    """

    watts: float
    until: float


class Battery(Protocol):
    """What nodes are supplied from. The components of wsnsim are in `models.batteries`."""

    @property
    def restart(self) -> float | None:
        """Share of the capacity at which a node whose battery was empty starts again; None: empty nodes are dead."""

    @property
    def stored(self) -> float:
        """Share of what is harvested that is stored."""

    def draw(self, setup: Any, size: int, sinks: tuple[int, ...], rng: np.random.Generator) -> BatteryState:
        """The batteries of all nodes at the start of a run.

        Args:
            setup: The scenario.
            size: The number of nodes.
            sinks: Those nodes that are sinks.
            rng: The source of random numbers.

        Raises:
            RunError: a file cannot be used, or a node is not there.
        """

    def drawable(self, state: BatteryState) -> Floats:
        """(n,) J that can be drawn at once; infinite on mains."""

    def draw_at_once(self, state: BatteryState, joules: Floats) -> BatteryState:
        """The state after (n,) joules were drawn in no time; negative ones were put back."""

    def advance(
        self, state: BatteryState, watts: Floats, seconds: Floats | float, income: Floats | float = 0.0
    ) -> Advance:
        """What a span of constant load does.

        Args:
            state: At its beginning.
            watts: (n,) mean load in W.
            seconds: Length in s of the span, (n,) or one for all.
            income: Mean power in W that the harvester offers, (n,) or one for all.
        """

    def income(self, time: float) -> Income:
        """What the harvester offers at a time in s; nothing without one."""
