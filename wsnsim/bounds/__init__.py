"""Cramér-Rao bounds on the tracking error: posterior, and conditional on a trajectory.

bound(scenario, replicates, kind, gains, places) -> Bound     of a scenario, as `wsnsim compare` shows
bound_of_run(path, readings, kind, gains) -> Bound            of the readings of recorded runs
bounds_of_run(path, readings, ...) -> [Bound, ...]            of several kinds of readings, together
"""

from wsnsim.bounds.crlb import bound, bound_of_run, bounds_of_run
from wsnsim.bounds.least_errors import GAINS, KINDS, PLACES, READINGS, Bound, BoundQuery

__all__ = ["GAINS", "KINDS", "PLACES", "READINGS", "Bound", "BoundQuery", "bound", "bound_of_run", "bounds_of_run"]
