"""Time synchronisation: how nodes keep their clocks together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Final

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.access import Framed
from wsnsim.models.hardware import PerfectClock

MESSAGE_BITS: Final = 72
"""Bits of a message: root and sender, 16 each, sequence number 8, global time 32 (the TinyOS implementation)."""


@part
class NoSync:
    """Clocks are never corrected: they drift apart, unless the MAC keeps them together."""

    mechanism: ClassVar[str] = "none"


@part
class Ftsp:
    """The Flooding Time Synchronization Protocol (FTSP): all nodes follow the clock of the root, the one of lowest id.

    Every node broadcasts a message once per period: the id of the root, a sequence number, and its estimate of the
    root's time at the instant at which the message is sent. A node that receives a new sequence number notes a
    reference point, (its own clock, the root's time), and fits a line through the last eight: offset and skew. Nodes
    that have heard of no root for `root_timeout` periods declare themselves the root, and give way to one of lower id.

    Messages are broadcast through the MAC: they wait for the channel, collide, are paid for and logged ("sync"). A time
    stamp of the MAC layer is wrong by N(0, jitter²), independently for every reception; 1.5 µs is our choice (Mica2
    motes count in steps of about 1 µs). Propagation takes no time. A node that sleeps sends in its next awake spell, at
    a random time, and receives what it is awake for. The root's clock is not corrected: the network agrees, and is as
    far from true time as the root.

    Source: Maróti, Kusy, Simon, Lédeczi (2004), "The flooding time synchronization protocol", SenSys; defaults from
    its implementation in TinyOS (TimeSyncP.nc), the period from the paper (30 s), where TinyOS has 10 s.
    """

    mechanism: ClassVar[str] = "ftsp"

    period: Annotated[
        float, Quantity("s", ge=0.01, le=1e6), "time between the messages of a node, on its own clock"
    ] = 30.0
    bits: Annotated[int, Quantity("", ge=1, le=1_000_000, label="bit"), "payload of a message"] = MESSAGE_BITS
    jitter: Annotated[float, Quantity("s", ge=0.0, le=1.0), "standard deviation of a time stamp"] = 1.5e-6
    entries: Annotated[int, Quantity("", ge=2, le=1000), "reference points in the regression"] = 8
    entries_to_send: Annotated[int, Quantity("", ge=1, le=1000), "reference points that a node needs to send"] = 3
    entries_to_sync: Annotated[
        int, Quantity("", ge=1, le=1000), "reference points that a node needs to correct its clock"
    ] = 4
    root_timeout: Annotated[
        int, Quantity("", ge=1, le=1000), "periods without a message of the root until a node declares itself the root"
    ] = 5
    ignore_root: Annotated[
        int, Quantity("", ge=0, le=1000), "periods for which a new root ignores messages of other roots"
    ] = 4
    outlier: Annotated[
        float, Quantity("s", gt=0.0, le=1e6), "error from which on a reference point is not used; four in a row reset"
    ] = 500e-6

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for clocks that need no synchronisation, and for limits or messages that cannot be kept."""
        if not isinstance(setup, RadioSetup):
            return
        stepped = any(fault.mechanism == "clock_step" for fault in setup.faults)
        if isinstance(setup.clock, PerfectClock) and not stepped:
            message = (
                "every clock shows the true time (clock: perfect): there is nothing to synchronise; use clock drift"
            )
            yield Issue(("sync", "kind"), message)
        for name in ("entries_to_send", "entries_to_sync"):
            if getattr(self, name) > self.entries:
                message = f"a node never has {getattr(self, name)} reference points: sync.entries is {self.entries}"
                yield Issue(("sync", name), message)
        if isinstance(setup.mac, Framed):
            yield from self._unsendable(setup.mac)

    def _unsendable(self, mac: Framed) -> Iterator[Issue]:
        """Yield an issue for a message that fits no frame, or that takes longer than its period."""
        if self.bits > mac.payload_bits:
            yield Issue(("sync", "bits"), f"a frame holds at most {mac.payload_bits} bits, and a message {self.bits}")
        elif (airtime := mac.airtime(mac.bits(self.bits))) > self.period:
            yield Issue(("sync", "period"), f"a message takes {airtime:g} s, more than its period")
