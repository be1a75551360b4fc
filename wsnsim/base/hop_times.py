"""How long cluster heads wait for others where a scenario does not say, by how long a hop takes on its MAC.

head_waits(mac, dt) -> HeadWaits

All figures that are no multiple of a latency are those that heads had before MACs said how long they take.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol

from wsnsim.base.medium_access import DutyCycledMac, hop_latency
from wsnsim.base.requests import PACKET_BITS

LEAST_QUIET: Final = 12e-3
LEAST_CAP: Final = 50e-3
"""Waits (s) of moving heads on a radio that always listens (our choice)."""
QUIET_HOPS: Final = 1.5
CAP_HOPS: Final = 4.0
JOIN_HOPS: Final = 2.0
ELECTION_HOPS: Final = 6.0
"""The same waits, and those for joins and candidates, in hops of a radio that is mostly off (our choice)."""
CAP_SHARE: Final = 0.6
JOIN_SHARE: Final = 0.3
ELECTION_SHARE: Final = 0.5
"""Shares of a step that these waits take at most (our choice): the rest is for the estimate and what follows it."""


class HeadWaits(NamedTuple):
    """How long cluster heads wait for others, in s.

    Attributes:
        quiet: without a reading, after which a moving head waits no longer.
        cap: for which a moving head waits at most.
        gather: for the parcels that a tracker gathers without a deadline of its own. None: until all have ended.
        joins: for the joins that answer an announcement. None: until all have ended.
        election: the time over which the candidates of an election spread their broadcasts. None: all begin at once.
        closing: when an election closes at the latest, after its beginning. None: once all broadcasts have ended.
    """

    quiet: float
    cap: float
    gather: float | None = None
    joins: float | None = None
    election: float | None = None
    closing: float | None = None

    @property
    def retries_handover(self) -> bool:
        """Whether a head whose belief did not reach the next one goes on and tries again at the next step."""
        return self.gather is not None


class WaitsInWindow(Protocol):
    """A policy of moving heads, which may leave its waits to the MAC."""

    @property
    def quiet(self) -> float | None: ...

    @property
    def cap(self) -> float | None: ...


def window_of(policy: WaitsInWindow, waits: HeadWaits) -> tuple[float, float]:
    """(quiet, cap) in s of a policy: its own, or those that follow from the MAC."""
    quiet = waits.quiet if policy.quiet is None else policy.quiet
    cap = waits.cap if policy.cap is None else policy.cap
    return (min(quiet, cap) if policy.quiet is None else quiet), cap


def is_duty_cycled(mac: Any) -> bool:
    """Whether the radios of nodes are mostly off on a MAC."""
    return isinstance(mac, DutyCycledMac)


def head_waits(mac: Any, dt: float) -> HeadWaits:
    """How long heads wait on a MAC, where steps last `dt` s.

    A head knows when everything has arrived or is lost (an idealisation of ours). Where radios are mostly off, that may
    take many steps. There heads go on after some hops, at the latest after a share of a step, if a hop is not longer
    than that.
    """
    unicast, broadcast, granted = hop_latency(mac, PACKET_BITS)
    quiet, cap = max(LEAST_QUIET, QUIET_HOPS * unicast, granted), max(LEAST_CAP, CAP_HOPS * unicast, granted)
    if not is_duty_cycled(mac):
        return HeadWaits(quiet, cap)
    cap = min(cap, max(CAP_SHARE * dt, unicast))
    spread = min(ELECTION_HOPS * broadcast, ELECTION_SHARE * dt)
    return HeadWaits(
        quiet=min(quiet, cap),
        cap=cap,
        gather=cap,
        joins=min(JOIN_HOPS * unicast, JOIN_SHARE * dt),
        election=spread,
        closing=spread + 2.0 * broadcast,
    )
