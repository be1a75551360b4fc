"""The check that a target of a network starts within the monitored field.

start_issues(motion, setup) -> Iterator[Issue]
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wsnsim.base.arrays import planar
from wsnsim.base.errors import Issue
from wsnsim.base.setups import NetworkSetup, TrackingSetup


def start_issues(motion: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield an issue if the target starts outside the field of a network."""
    if not isinstance(setup, NetworkSetup):
        return
    field = setup.deploy.field
    point = planar(np.array([motion.start[column] for column in motion.position]))
    if not field.contains(point):
        (x, y), (x0, y0) = point, field.centre
        size = f"{field.width:g} m by {field.height:g} m around ({x0:g}, {y0:g})"
        yield Issue(("motion", "start"), f"({x:g}, {y:g}) m is outside the field of {size}")
