"""Least squares for the coefficients of a law and the gains of its nodes, with intervals for correlated readings.

The intervals are a sandwich over blocks of time: the scores of a block's readings, of all nodes, are summed before they
are squared, so that any correlation within a block counts. Source: Liang, Zeger (1986), "Longitudinal data analysis
using generalized linear models"; the factor B/(B - 1) and Student's t with B - 1 degrees of freedom for B blocks are
the usual corrections for few blocks (Cameron, Miller 2015, "A practitioner's guide to cluster-robust inference").
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import linalg, stats

from wsnsim.base.arrays import Floats, Ints

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
    heard = np.flatnonzero(np.bincount(nodes, minlength=count)[:count])
    contrasts = np.zeros((count, max(len(heard) - 1, 0)))
    if len(heard) > 1:
        contrasts[heard] = linalg.helmert(len(heard)).T
    matrix = np.column_stack([design, contrasts[nodes]]) if count else design
    inverse = np.linalg.inv(matrix.T @ matrix)
    solution = inverse @ (matrix.T @ response)
    residuals = response - matrix @ solution
    spread, quantile = _sandwich(inverse, matrix * residuals[:, None], blocks)
    gain_errors = np.full(count, np.nan)
    gain_errors[heard] = np.sqrt(np.einsum("ij,jk,ik->i", contrasts, spread[columns:, columns:], contrasts))[heard]
    errors = np.sqrt(np.diag(spread)[:columns])
    return Coefficients(solution[:columns], errors, contrasts @ solution[columns:], gain_errors, quantile)


def _sandwich(inverse: Floats, scores: Floats, blocks: Ints) -> tuple[Floats, float]:
    """Covariance (C, C) of the estimates, and the quantile of Student's t. There must be at least two blocks."""
    count = int(blocks.max()) + 1
    sums = np.zeros((count, scores.shape[1]))
    np.add.at(sums, blocks, scores)
    readings, parameters = scores.shape
    root = sums @ inverse
    factor = count / (count - 1) * (readings - 1) / max(readings - parameters, 1)
    return root.T @ root * factor, float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, count - 1))
