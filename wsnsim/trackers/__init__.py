"""Tracking strategies, one per file, under the names of their kinds and under their own names.

from wsnsim.trackers import PsoMhpf, Ekf        the modules are imported at first use
"""

from __future__ import annotations

from wsnsim.base.facades import facade

__getattr__, __dir__ = facade(__name__)
