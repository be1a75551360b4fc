"""The names of nodes, by which recorded data refer to them.

node_names(setup, nodes) -> (name, ...)
"""

from __future__ import annotations

from typing import Any

from wsnsim.base.rng import Streams


def node_names(setup: Any, nodes: int | None = None) -> tuple[str, ...]:
    """The name of each node: what the deployment calls it (`NamesNodes`), else its number.

    Args:
        setup: the scenario's setup.
        nodes: how many nodes a run has; None: as many as its first run.

    Raises:
        RunError: the deployment cannot tell, such as a file that cannot be read.
    """
    named: tuple[str, ...] | None = getattr(setup.deploy, "names", None)
    if named is not None:
        return named
    if nodes is None:
        reach = setup.sensor.reach if hasattr(setup, "sensor") else setup.link.reach
        nodes = len(setup.deploy.draw(reach, Streams(setup.seed, 0)("deploy")))
    return tuple(map(str, range(nodes)))
