"""What the energy ledger of a network holds, node by node."""

from typing import Final

import numpy as np

from wsnsim.base.tables import CAUSES
from wsnsim.network.nodes import Nodes

SPENT: Final = len(CAUSES)
"""Index of the sum in an entry of `books`."""


def books(nodes: Nodes) -> dict[int, list[float]]:
    """{node: joules of each cause, then what it spent} of every node that spent something."""
    ledger = nodes.ledger
    touched = np.flatnonzero(ledger.spent)
    columns = np.concatenate([ledger.joules[:, touched], ledger.spent[None, touched]]).T
    return dict(zip(touched.tolist(), columns.tolist(), strict=True))
