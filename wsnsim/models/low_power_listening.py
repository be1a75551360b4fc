"""Low-power listening: the parameters that X-MAC and ContikiMAC share, whose radios are off most of the time.

A node turns its radio on once an interval, at a phase of its own, and hears whether somebody wants it. A sender repeats
something short until its destination is awake. Both rest on the frame format of `access.Framed`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import log2
from typing import Annotated, Final

from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import off_time
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import Setup
from wsnsim.models.access import Framed

INTERVAL: Final = Quantity("s", ge=1e-3, le=60.0)
SHORT: Final = Quantity("s", ge=0.0, le=1.0)
ROUNDING: Final = 1e-12
"""Rounding may change the number of periods in an interval by this."""


@part
class LowPowerListening(Framed):
    """What both protocols share: the wake interval, and how a sender gets the channel.

    A node with a frame waits for a random time below `first_backoff`, or for as long as its radio takes to turn off
    and on again if that is longer and the radio is off (our choice: the stop counts in any case). It listens for so
    long that it hears any train of strobes under way. If the channel is busy, it waits for a random time below
    `backoff` with the radio off, and listens again. After `max_backoffs` more attempts the frame is dropped. A frame
    without acknowledgement is sent again after such a wait, up to `max_retries` times. These waits are our choice:
    the papers leave them to the layer above. Contiki's CSMA layer also waits for times in the order of the wake
    interval; 10 ms is the initial back-off of TinyOS on a CC2420.
    """

    interval: Annotated[float, INTERVAL, "wake interval: from one wake-up of a node to the next"] = 0.125
    near: Annotated[
        float | None,
        Quantity("s", ge=1e-3, le=60.0),
        "wake interval of nodes that expect a target: `interval` divided by a power of two; left out: the same",
    ] = None
    first_backoff: Annotated[float, SHORT, "longest random wait before a sender first listens"] = 10e-3
    backoff: Annotated[
        float | None,
        Quantity("s", ge=0.0, le=60.0),
        "longest random wait after a busy channel or a missing acknowledgement; left out: one interval",
    ] = None
    max_backoffs: Annotated[int, Quantity("", ge=0, le=100), "attempts after the first before a frame is dropped"] = 7

    @cached_property
    def congestion(self) -> float:
        """The longest random wait after a busy channel or a missing acknowledgement, in s."""
        return self.interval if self.backoff is None else self.backoff

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield the issues of `Framed`; also missing acknowledgements and a `near` that is no part of the interval."""
        yield from Framed.check(self, setup)
        if not self.acks:
            yield Issue(("mac", "acks"), "a sender must learn that its destination is awake: acks: true is needed")
        if self.near is not None:
            parts = self.interval / self.near
            halvings = max(round(log2(parts)), 0)
            if abs(parts - 2**halvings) > 1e-9 * parts:
                yield Issue(
                    ("mac", "near"),
                    f"{self.near:g} s is not mac.interval = {self.interval:g} s divided by a power of two "
                    f"(nearest: {self.interval / 2**halvings:g} s)",
                )

    def intervals(self) -> list[float]:
        """The wake intervals of a node: the usual one, and the one near a target if there is one."""
        return [self.interval] if self.near is None else [self.interval, self.near]

    def too_short(self, on: float, what: str, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for each interval that leaves no time between wake-ups of `on` seconds."""
        start = off_time(getattr(setup, "energy", None))
        for key, interval in zip(("interval", "near"), self.intervals(), strict=False):
            if interval <= on + start:
                turning_on = f" and turning the radio off and on ({start:g} s)" if start else ""
                yield Issue(
                    ("mac", key),
                    f"{interval:g} s is not longer than {what} of {on:g} s{turning_on}: the radio would never be off",
                )
