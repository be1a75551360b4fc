"""What the papers print, for the set-ups that are theirs.

    published(resolved scenario) -> (figures, source)

Figures are 'rmse' (the time mean of the per-step RMSE over runs), 'energy', 'clusters', and 'rmse_px' and the like for
the root mean square error of a state column.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wsnsim.papers import jiang2013, ruan2020, wei2022

PAPERS = (jiang2013, wei2022, ruan2020)


def published(resolved: Mapping[str, Any]) -> tuple[dict[str, float], str]:
    """The figures of the paper whose set-up a resolved scenario is, and the paper's name; empty if it is nobody's."""
    for paper in PAPERS:
        figures = paper.published(resolved)
        if figures:
            return figures, paper.SOURCE
    return {}, ""
