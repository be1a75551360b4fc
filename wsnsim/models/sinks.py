"""What can be wrong with the sinks of a scenario: reports between steps, and a sink that no node reaches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.deploy import Anchors, Grid
from wsnsim.models.node_file import FromFile

MOST_NODES: Final = 20_000
"""Nodes above which no sink is looked at."""


def sink_issues(setup: Setup, every: float | None, role: str = "sink") -> Iterator[Issue]:
    """Yield an issue for reports at times that are not steps, and for each sink that no route reaches.

    Args:
        setup: The scenario.
        every: Time between reports in s; None: every step.
        role: The role that names the sinks.
    """
    if every is not None:
        steps = every / setup.dt
        if abs(steps - round(steps)) > 1e-9 * steps or round(steps) < 1:
            yield Issue((role, "every"), f"{every:g} s must be a whole number of steps of {setup.dt:g} s")
    yield from _unreachable(setup, role)


def _unreachable(setup: Setup, role: str) -> Iterator[Issue]:
    """Yield an issue for each sink that no other node can reach over one link, where places are fixed."""
    if not isinstance(setup, RadioSetup):
        return
    positions = _fixed_positions(setup)
    if positions is None or not 1 < len(positions) <= MOST_NODES:
        return
    for sink in dict.fromkeys(int(_distances(positions, point).argmin()) for point in setup.sink_points):
        x, y = positions[sink].tolist()
        nearest = float(np.partition(_distances(positions, (x, y)), 1)[1])
        if nearest > setup.link.audible:
            yield Issue(
                (role,),
                f"no route reaches the sink, node {sink} at ({x:g}, {y:g}) m: the nearest other node is {nearest:.4g} m"
                f" away, and {_longest(setup)}",
            )


def _longest(setup: RadioSetup) -> str:
    """How long a link can be, in words."""
    if setup.link.audible == setup.link.reach:
        return f"the communication range is link.reach = {setup.link.reach:g} m"
    return f"no frame is heard beyond {setup.link.audible:.4g} m, even over the strongest link"


def _fixed_positions(setup: RadioSetup) -> Floats | None:
    """(N, 2) positions that are the same in every run, in m; None if they are random, or cannot be read."""
    if not isinstance(setup.deploy, Anchors | Grid | FromFile):
        return None
    try:
        return setup.deploy.draw(setup.link.reach, np.random.default_rng(0))
    except RunError:  # the deployment says so itself
        return None


def _distances(positions: Floats, point: tuple[float, float]) -> Floats:
    distances: Floats = np.hypot(positions[:, 0] - point[0], positions[:, 1] - point[1])
    return distances
