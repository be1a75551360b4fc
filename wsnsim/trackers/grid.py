"""The posterior of a scalar state by integration on a grid: the reference that other filters approximate.

Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Member, Send
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.grid import WINDOW, spread, weigh
from wsnsim.trackers.shared.heads import WEIGH_CYCLES, GaussianBelief, HeadFilter
from wsnsim.trackers.shared.readings import gather_readings, moment_packets, number_packets, parcel

SPREAD_CYCLES = 15.0
"""CPU cycles to add a share of one cell's mass to another cell."""
EDGE = Quantity("", ge=-1e9, le=1e9, label="SI")
LEAST_EXTENT = 1e-6


@dataclass(frozen=True, slots=True)
class GridBelief(GaussianBelief):
    """The masses (cells,) of the cells, which sum to one, and their moments."""

    masses: Floats = field(default_factory=lambda: np.empty(0))


@part
class GridFilter(HeadFilter):
    """The exact posterior of a state of one column, up to the width of a cell.

    The mass of a cell moves from the cell's centre by the motion without noise and is then spread by the Gaussian
    process noise. A standard deviation less than the width of a cell, or of the image of its cell, is increased to that
    width: the cells are then too coarse, and the posterior is not exact. Mass that leaves the grid is kept at its edge.
    The default grid contains the univariate growth model with a process variance of 10: its states without noise stay
    below 19, and the accumulated noise has a standard deviation below 4.
    """

    tells_prediction: ClassVar[bool] = True

    cells: Annotated[int, Quantity("", ge=2, le=100_000), "cells of the grid"] = 2000
    low: Annotated[float, EDGE, "lower edge of the grid, in SI units"] = -60.0
    high: Annotated[float, EDGE, "upper edge of the grid, in SI units"] = 60.0

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A state of more than one column; a grid without extent."""
        for motion in setup.filter_motions:
            if len(motion.columns) != 1:
                yield Issue(
                    ("tracker", "kind"),
                    f"grid holds the density of a state of one column, and that of this motion has "
                    f"{len(motion.columns)} ({' '.join(motion.columns)}); use it with ungm",
                )
        if not self.high - self.low >= LEAST_EXTENT:
            yield Issue(("tracker", "high"), f"the grid must reach from low ({self.low:g}) up to high ({self.high:g})")

    @property
    def width(self) -> float:
        """Of a cell."""
        return (self.high - self.low) / self.cells

    @property
    def middles(self) -> Floats:
        """(cells,) the middle of each cell."""
        return self.low + self.width * (np.arange(self.cells, dtype=np.float64) + 0.5)

    def start(self, prior: Estimate, scene: Scene) -> Flow[GridBelief]:
        """The prior's Gaussian on the grid. Raises RunError for a state of more than one column."""
        if prior.mean.size != 1:
            raise RunError(f"grid holds the density of a state of one column, and this one has {prior.mean.size}")
        return self._belief(self._gaussian(prior.mean, prior.cov), scene.head)
        yield  # a flow without requests

    def step(self, belief: GridBelief, scene: Scene) -> Flow[GridBelief]:
        """One step: N_act - 1 readings reach the head, which spreads the density and weighs it."""
        seen = yield from gather_readings(scene, belief=belief)
        yield Compute(self._cycles(len(seen.ids), scene))
        masses = self._moved(belief.masses, scene, scene.since, scene.steps)
        if seen.ids:
            likelihood = scene.sensor.log_likelihood(self.middles[None], seen.readings, seen.positions, seen.traits)
            masses = weigh(masses, likelihood)
        return self._belief(masses, scene.head)

    def hand_over(self, belief: GridBelief, scene: Scene, successor: int) -> Flow[GridBelief | None]:
        """ceil(cells / 4) packets of masses and those of the moments.

        Masses that are lost are read off a line between the nearest that arrived. If none arrived, or only empty cells,
        the moments give a Gaussian; without them, too, the track is lost.
        """
        first = number_packets(self.cells)
        packets = first + moment_packets(belief.mean.size)
        mask = yield Send(successor, parcel((belief.masses, belief.mean, belief.cov), packets, "handover"))
        masses = _arrived_masses(belief.masses, mask[:first])
        if masses is None and not mask[first:].all():
            return None
        return self._belief(self._gaussian(belief.mean, belief.cov) if masses is None else masses, successor)

    def forecast(self, belief: GridBelief, scene: Scene, ahead: int) -> Estimate:
        """The density's moments `ahead` steps on, as the motion spreads it."""
        masses = self._moved(belief.masses, scene, scene.step * scene.dt, ahead)
        return self.estimate(self._belief(masses, scene.head))

    def snapshot(self, belief: GridBelief, members: Sequence[Member]) -> Iterator[tuple[int, Floats, Floats]]:
        """(head, middles (1, n), masses (n,)) of the cells that hold any."""
        holding = belief.masses > 0.0
        yield belief.head, self.middles[None, holding], belief.masses[holding]

    def _belief(self, masses: Floats, head: int) -> GridBelief:
        """The masses with their mean (1,) and variance (1, 1), which is no less than that of a cell."""
        mean = float(masses @ self.middles)
        variance = float(masses @ (self.middles - mean) ** 2)
        cov = np.array([[max(variance, self.width**2 / 12.0)]])
        return GridBelief(np.array([mean]), cov, head, masses=masses)

    def _gaussian(self, mean: Floats, cov: Floats) -> Floats:
        """(cells,) masses of a Gaussian."""
        deviation = np.maximum(np.sqrt(np.diag(cov)), self.width)
        return spread(np.ones(1), np.asarray(mean, dtype=np.float64), deviation, self.low, self.width, self.cells)

    def _moved(self, masses: Floats, scene: Scene, time: float, steps: int) -> Floats:
        """(cells,) masses `steps` steps after `time`.

        They are spread by the process noise, widened to a cell and to its image.
        """
        points = self.middles[None]
        for step in range(steps):
            now = time + step * scene.dt
            moved = np.ascontiguousarray(scene.motion.advance(points, scene.dt, now)[0])
            transitions, noise = scene.motion.matrices(points, scene.dt, now)
            least = self.width * np.maximum(np.abs(transitions[:, 0, 0]), 1.0)
            deviations = np.maximum(least, np.sqrt(noise[0, 0]))
            masses = spread(masses, moved, deviations, self.low, self.width, self.cells)
        return masses

    def _cycles(self, sensors: int, scene: Scene) -> float:
        """Operations of a step: cells times the cells that each is spread over, and cells times readings."""
        noise = scene.motion.matrices(np.zeros((1, 1)), scene.dt, scene.since)[1]
        reached = min(2.0 * WINDOW * max(float(np.sqrt(noise[0, 0])) / self.width, 1.0), self.cells)
        return self.cells * (SPREAD_CYCLES * scene.steps * reached + WEIGH_CYCLES * sensors)


def _arrived_masses(masses: Floats, mask: Bools) -> Floats | None:
    """Masses of which four are in a packet, the lost ones filled in; None if nothing is left to go by."""
    known = np.repeat(mask, 4)[: masses.size]
    if known.all():
        return masses
    if not masses[known].any():
        return None
    cells = np.arange(masses.size)
    filled = np.interp(cells, cells[known], masses[known])
    shares: Floats = filled / filled.sum()
    return shares
