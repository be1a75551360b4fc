"""What is wrong with a deployment: nodes outside the field, too few of them, or a field that they do not cover."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue
from wsnsim.base.ports import Field
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models.coverage import coverage, covers, nodes_needed

ASSUMED: Final = "sd per axis of the nodes' assumed positions, which filters and heads use; 0: known exactly"


def outside(place: tuple[float, float], field: Field) -> str:
    """The message about a position outside the field."""
    return (
        f"({place[0]:g}, {place[1]:g}) m is outside the field of {field.width:g} m by {field.height:g} m around "
        f"({field.centre[0]:g}, {field.centre[1]:g})"
    )


def _covering(setup: Setup) -> tuple[str, float]:
    """The name and length of the range that must cover the field: of the sensors, or of the links without sensors."""
    if isinstance(setup, TrackingSetup):
        return "a sensing range", setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return "a communication range", setup.link.reach


def too_few(part: Any, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if a deployment has fewer nodes than its field or a cluster needs."""
    what, reach = _covering(setup)
    needed = nodes_needed(reach, part.width, part.height)
    if part.cover and part.nodes < needed:
        yield Issue(
            ("deploy", "cover"),
            f"{part.nodes:g} nodes with {what} of {reach:g} m cannot cover {part.width:g} m by "
            f"{part.height:g} m: at least {needed:g} are needed, or cover: false",
        )
    yield from too_few_for_a_cluster(part.nodes, "nodes", setup)


def too_few_for_a_cluster(nodes: int, key: str, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if a network has fewer nodes than a cluster needs."""
    minimum = setup.clusters.minimum_active if isinstance(setup, NetworkSetup) else 0
    if nodes < minimum:
        yield Issue(
            ("deploy", key), f"{nodes} nodes cannot form a cluster of clusters.minimum_active = {minimum} members"
        )


def uncovered(part: Any, positions: Floats, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if fixed positions do not cover the field, though their number might suffice."""
    (what, reach), width, height = _covering(setup), part.field.width, part.field.height
    about = positions - np.array(part.field.centre)
    if part.cover and len(about) >= nodes_needed(reach, width, height) and not covers(about, reach, width, height):
        share = coverage(about, reach, width, height)
        yield Issue(
            ("deploy", "cover"),
            f"these {len(about)} nodes with {what} of {reach:g} m leave about "
            f"{100 * (1 - share):.2g} % of the field uncovered; use more nodes, a longer range, or cover: false",
        )
