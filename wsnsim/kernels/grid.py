"""The density of a state of one column, as masses on the cells of a grid.

    spread(masses, moved, deviations, low, width, cells) -> masses a step on: each cell's as a Gaussian around its image
    weigh(masses, logs) -> masses by Bayes' rule

Cell k reaches from low + k width to low + (k + 1) width; its mass is taken to sit in the middle. What lies beyond the
grid is kept in its edge cells, so that no mass is lost (our choice).
"""

from __future__ import annotations

import math

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.kernels.compilation import kernel
from wsnsim.kernels.elementary import exp, log

WINDOW = 8.0
"""Deviations to either side that a cell's mass is spread over; beyond are 1e-15 of it."""
SLIGHT = 1e-20
"""Part of the whole mass that a cell must hold to be spread."""
LEAST = 1e-300
NOTHING = -690.0


@kernel
def spread(masses: Floats, moved: Floats, deviations: Floats, low: float, width: float, cells: int) -> Floats:
    """(cells,) masses after each of the masses (m,), which sum to one, was spread as N(moved[i], deviations[i]²).

    A Gaussian gives the cells within the window its density at their middles, scaled to the mass that it has on the
    grid: exact to 3e-9 of it where the deviation is a cell's width or more, which is demanded. What has no finite image
    is lost, and made up for by the rest; if there is no rest, all cells get the same.
    """
    result, weights = np.empty(cells), np.empty(cells)
    high, kept = low + cells * width, 0.0
    for k in range(cells):
        result[k] = 0.0
    for i in range(masses.size):
        deviation, centre = deviations[i], moved[i]
        if not (masses[i] > SLIGHT and 0.0 < deviation < np.inf and -np.inf < centre < np.inf):
            continue
        kept += masses[i]
        below = 0.5 * math.erfc((centre - low) / (1.4142135623730951 * deviation))
        above = 0.5 * math.erfc((high - centre) / (1.4142135623730951 * deviation))
        start = (centre - WINDOW * deviation - low) / width
        end = (centre + WINDOW * deviation - low) / width
        first = int(min(max(start, 0.0), cells))
        last = int(min(max(end + 1.0, 0.0), cells))
        scale, total = width / deviation, 0.0
        for k in range(first, last):
            white = (k + 0.5) * scale - (centre - low) / deviation
            weights[k] = exp(-0.5 * white * white)
            total += weights[k]
        if total > LEAST:
            share = masses[i] * max(1.0 - below - above, 0.0) / total
            for k in range(first, last):
                result[k] += share * weights[k]
            result[0] += masses[i] * below
            result[cells - 1] += masses[i] * above
        else:
            result[0 if centre < low else cells - 1] += masses[i]
    for k in range(cells):
        result[k] = result[k] / kept if kept > 0.0 else 1.0 / cells
    return result


@kernel
def weigh(masses: Floats, logs: Floats) -> Floats:
    """(cells,) masses in proportion to masses times likelihoods, given as logs; NaN counts as impossible.

    Where nothing is possible, or something infinitely likely, the masses stay as they are.
    """
    scores, top = np.empty(masses.size), -np.inf
    for k in range(masses.size):
        score = log(masses[k] if masses[k] > LEAST else 1.0) + logs[k]
        scores[k] = score if masses[k] > LEAST else -np.inf
    for k in range(masses.size):
        top = scores[k] if scores[k] > top else top
    if not -np.inf < top < np.inf:
        return masses.copy()
    total = 0.0
    for k in range(masses.size):
        below = scores[k] - top
        scores[k] = exp(below) if below > NOTHING else 0.0
        total += scores[k]
    for k in range(masses.size):
        scores[k] /= total
    return scores
