"""Deprecated alias of `wsnsim.bounds`."""

import warnings

from wsnsim.bounds import GAINS, KINDS, READINGS, Bound, bound, bound_of_run

__all__ = ["GAINS", "KINDS", "READINGS", "Bound", "bound", "bound_of_run"]

warnings.warn("wsnsim.analysis.bounds was renamed to wsnsim.bounds", DeprecationWarning, stacklevel=2)
