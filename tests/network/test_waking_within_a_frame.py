"""Who hears a frame that begins or ends while its receiver wakes or falls asleep: differently on each channel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.radio import Mode
from wsnsim.models.access import Csma, IdealMac

WAKES, FALLS_ASLEEP = 1.0, 2.0
RATE = 192.0
"""Bit/s at which a packet of 96 bits takes half a second."""


class AwakeOnce:
    """A schedule by which every node is awake once."""

    rest = Mode.SCHEDULED

    def state(self, keys: Any, time: float) -> Any:
        """Awake from WAKES to FALLS_ASLEEP."""
        edges = [0.0, WAKES, FALLS_ASLEEP, math.inf]
        at = int(np.searchsorted(edges, time, side="right")) - 1
        return np.full(keys.size, at == 1), np.full(keys.size, edges[at]), np.full(keys.size, edges[at + 1])


def heard(mac: Any, begin: float) -> bool:
    """Whether a broadcast that begins then reaches a neighbour."""
    network = RadioNetwork([(0, 0), (10, 0)], mac=mac, sleep=AwakeOnce())
    network.nodes.keep_awake(0)
    network.env.run(until=begin)
    return 1 in network.broadcast(0).received


@pytest.mark.parametrize(
    ("begin", "reaches"),
    [(0.2, False), (0.7, True), (1.2, True), (1.7, False)],
    ids=["asleep", "wakes in the middle", "awake throughout", "falls asleep in the middle"],
)
def test_on_the_ideal_channel_a_node_hears_what_ends_while_it_listens(begin: float, reaches: bool) -> None:
    assert heard(IdealMac(rate=RATE), begin) is reaches


@pytest.mark.parametrize(
    ("begin", "reaches"),
    [(0.5, False), (1.1, True), (1.5, True), (2.1, False)],
    ids=["wakes in the middle", "awake throughout", "falls asleep in the middle", "asleep"],
)
def test_on_a_channel_with_frames_a_node_hears_what_begins_while_it_listens(begin: float, reaches: bool) -> None:
    """The broadcast begins some milliseconds later, after an assessment and up to seven backoff periods."""
    mac = Csma(rate=256.0)
    assert mac.airtime(mac.bits(96)) == pytest.approx(0.9, abs=0.01)
    assert heard(mac, begin) is reaches
