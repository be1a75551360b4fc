"""Small networks with appointed clusters, tracked by the centroid."""

from __future__ import annotations

from typing import Any

from tests.helpers.centroid_network import Run, network_setup, passing, standing
from wsnsim.models.appointed import Appointed
from wsnsim.models.energy import FirstOrder

TRIANGLE = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0), (150.0, 150.0)]
LINE = [(20.0 * i, 5.0 * (-1) ** i) for i in range(20)]


def three(**changes: Any) -> Run:
    """Nodes 0, 1, 2 sense a target at rest at (5, 5); node 3 is out of range of all others."""
    steps = changes.pop("steps", 4)
    changes = {"energy": FirstOrder(battery=2.0), "clusters": Appointed(), **changes}
    return Run(network_setup(steps=steps, **changes), TRIANGLE, [standing((5.0, 5.0), steps)])


def along(**changes: Any) -> Run:
    """A target that passes twenty nodes in a line, at 60 m/s."""
    changes = {"steps": 100, "clusters": Appointed(), "energy": FirstOrder(battery=2.0), **changes}
    return Run(network_setup(**changes), LINE, [passing((0.0, 0.0), (60.0, 0.0), changes["steps"])])
