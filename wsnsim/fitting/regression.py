"""Least squares for the coefficients of a law and the gains of its nodes, with intervals for correlated readings.

The intervals are a sandwich over blocks of time: the scores of a block's readings, of all nodes, are summed before they
are squared, so that any correlation within a block counts. Source: Liang, Zeger (1986), "Longitudinal data analysis
using generalized linear models"; the factor B/(B - 1) and Student's t with B - 1 degrees of freedom for B blocks are
the usual corrections for few blocks (Cameron, Miller 2015, "A practitioner's guide to cluster-robust inference").
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from wsnsim.base.arrays import Floats, Ints

RIDGE: Final = 1e-9
"""Weight of the gains' squares, relative to the readings: it makes their sum 0, and its shrinkage is negligible."""
CONFIDENCE: Final = 0.95


class Coefficients(NamedTuple):
    """Estimates with their standard errors.

    Attributes:
        values: (C,) coefficients of the law.
        errors: (C,) their standard errors.
        gains: (S,) of the nodes, with sum 0 over the nodes with readings; empty if none are fitted.
        gain_errors: (S,) their standard errors.
        quantile: standard errors from an estimate to the end of its interval.
    """

    values: Floats
    errors: Floats
    gains: Floats
    gain_errors: Floats
    quantile: float


def least_squares(design: Floats, response: Floats, nodes: Ints, count: int, blocks: Ints) -> Coefficients:
    """The coefficients that minimise the squares of the residuals.

    Args:
        design: (n, C) columns of the coefficients.
        response: (n,) readings without what has no coefficient.
        nodes: (n,) index of the node of each reading.
        count: number of nodes with a gain; 0 to fit none.
        blocks: (n,) number of the block of each reading.
    """
    columns = design.shape[1]
    indicators = nodes[:, None] == np.arange(count)
    matrix = np.column_stack([design, indicators])
    normal = matrix.T @ matrix
    normal[columns:, columns:] += RIDGE * len(matrix) * np.eye(count)
    inverse = np.linalg.pinv(normal, hermitian=True) if count == 0 else np.linalg.inv(normal)
    solution = inverse @ (matrix.T @ response)
    residuals = response - matrix @ solution
    errors, quantile = _sandwich(inverse, matrix * residuals[:, None], blocks, len(solution))
    heard = np.bincount(nodes, minlength=count)[:count] > 0
    level = float(solution[columns:][heard].mean()) if count else 0.0
    gains = np.where(heard, solution[columns:] - level, 0.0)
    values = solution[:columns] + level * (np.arange(columns) == 0)
    return Coefficients(values, errors[:columns], gains, np.where(heard, errors[columns:], np.nan), quantile)


def _sandwich(inverse: Floats, scores: Floats, blocks: Ints, parameters: int) -> tuple[Floats, float]:
    """Standard errors (C,) and the quantile of Student's t; infinite for a single block."""
    count = int(blocks.max()) + 1
    if count < 2:
        return np.full(len(inverse), np.inf), 1.0
    sums = np.zeros((count, scores.shape[1]))
    np.add.at(sums, blocks, scores)
    readings = len(blocks)
    factor = count / (count - 1) * (readings - 1) / max(readings - parameters, 1)
    spread = inverse @ (sums.T @ sums) @ inverse * factor
    return np.sqrt(np.maximum(np.diag(spread), 0.0)), float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, count - 1))
