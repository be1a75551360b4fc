"""Workloads: what a network does. It tracks targets, or its nodes send beacons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.access import Framed, IdealMac


@part
class Tracking:
    """The network tracks targets."""

    mechanism: ClassVar[str] = "tracking"


@part
class Periodic:
    """A network without targets: every node broadcasts a beacon once per period, from a random phase on.

    The workload for comparing radios and simulators: what arrives depends on the radio alone.
    """

    mechanism: ClassVar[str] = "beacons"

    period: Annotated[float, Quantity("s", ge=1e-3, le=1e6), "time between a node's beacons, on its own clock"] = 1.0
    bits: Annotated[int, Quantity("", ge=1, le=1_000_000, label="bit"), "payload of a beacon"] = PACKET_BITS

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if a beacon takes longer than its period."""
        mac = setup.mac if isinstance(setup, RadioSetup) else None
        airtime = 0.0
        if isinstance(mac, Framed):
            airtime = mac.airtime(mac.bits(self.bits))
        elif isinstance(mac, IdealMac) and mac.rate is not None:
            airtime = self.bits / mac.rate
        if airtime > self.period:
            yield Issue(
                ("workload", "period"), f"a beacon of {self.bits} bits takes {airtime:g} s, more than its period"
            )
