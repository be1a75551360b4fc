"""How many nodes a deployment has, for the checks of components that list something for each node."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wsnsim.base.errors import RunError


def number_of_nodes(deploy: Any) -> int | None:
    """The number of nodes of a deployment; None if they cannot be placed, which the deployment says itself."""
    count = getattr(deploy, "nodes", None)
    if count is not None:
        return int(count)
    try:
        return len(deploy.draw(math.inf, np.random.default_rng(0)))
    except RunError:
        return None
