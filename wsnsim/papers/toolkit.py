"""What a study's Python files may import: the names of this module, `wsnsim` itself, `wsnsim.fitting`, and libraries.

data      Data and measures of it                        arrays        Floats, Ints, Bools
bounds    `bounds.bound`, bound_from_events, load        resampling    sample, weights, resamples, interval
answers   Answer, Interval, word, both                   figures       plotting, COLOURS, band, ...
metrics, statistics, campaigns: the modules that the package's own tables are computed with
"""

from __future__ import annotations

from typing import Final

import wsnsim.bounds as bounds
from wsnsim.analysis import campaigns, statistics
from wsnsim.analysis.consistency import state_nees
from wsnsim.analysis.figure_style import BLUE, BOUND, COLOURS, VERMILLION, band, quartiles, runs_text
from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.campaign.code_changes import code_id
from wsnsim.models.csvfile import open_text
from wsnsim.papers import plotting
from wsnsim.papers.measures import Data, OwnMeasure, computing, measured, sample
from wsnsim.papers.resampling import weights
from wsnsim.papers.rows import UNKNOWN, Answer, Interval, both, bound_from_events, ends, interval, resamples, word
from wsnsim.papers.study import Study
from wsnsim.papers.verdicts import TAIL
from wsnsim.recording import read_table
from wsnsim.scenario import Plugins, load

ALLOWED: Final = ("wsnsim", "wsnsim.papers.toolkit", "wsnsim.fitting")
"""Modules of wsnsim that a study's Python files may import; of a package, its modules too."""
__all__ = [
    "BLUE", "BOUND", "COLOURS", "TAIL", "UNKNOWN", "VERMILLION", "Answer", "Bools", "Data", "Floats", "Interval",
    "Ints", "OwnMeasure", "Plugins", "ResultError", "Study", "UsageError", "band", "both", "bound_from_events",
    "bounds", "campaigns", "code_id", "computing", "ends", "interval", "load", "measured", "metrics", "open_text",
    "plotting", "quartiles", "read_table", "resamples", "runs_text", "sample", "state_nees", "statistics",
    "weights", "word",
]  # fmt: skip
