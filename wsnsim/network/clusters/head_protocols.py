"""The head protocols by the name that a cluster policy gives in `protocol`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from wsnsim.base.errors import RunError
from wsnsim.network.clusters.appointing import AppointingProtocol
from wsnsim.network.clusters.head_protocol import HeadProtocol, HeadServices
from wsnsim.network.clusters.moving_head import MovingHeadProtocol
from wsnsim.network.clusters.open_cluster import OpenClusterProtocol
from wsnsim.network.clusters.standing_cluster import ElectingClusterProtocol, StandingClusterProtocol

PROTOCOLS: Final[Mapping[str, Callable[[HeadServices], HeadProtocol]]] = {
    "standing": StandingClusterProtocol,
    "electing": ElectingClusterProtocol,
    "open": OpenClusterProtocol,
    "moving": MovingHeadProtocol,
    "appointing": AppointingProtocol,
}


def make_head_protocol(services: HeadServices) -> HeadProtocol:
    """The head protocol of a scenario's cluster policy.

    Raises:
        RunError: there is none of that name.
    """
    name = services.network.setup.head_protocol
    if name not in PROTOCOLS:
        raise RunError(f"clusters: no head protocol '{name}' in this network; known: {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name](services)
