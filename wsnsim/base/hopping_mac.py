"""The port of time-slotted channel hopping: what a MAC component must offer for the mechanism `tsch`."""

from __future__ import annotations

from typing import Final, Protocol

from wsnsim.base.medium_access import FramedMac

MOST_CELLS: Final = 64
"""The largest number of cells in which a node receives beside the shared ones (our choice)."""


class HoppingMac(FramedMac, Protocol):
    """Slots of a slotframe that repeats, and channels that change from slot to slot.

    Attributes:
        slotframe: Slots in a slotframe.
        slot: Length of a slot in s.
        channels: The channels, in the order of hopping.
        min_be: Back-off exponent BE after the first failure: 0 to 2^BE - 1 shared cells are skipped.
        max_be: Largest back-off exponent.
        tx_offset: Seconds from the start of a slot to that of its frame.
        rx_wait: How long a receiver waits for a frame to begin, in s.
        tx_ack_delay: Seconds from the end of a frame to its acknowledgement.
        rx_ack_delay: Seconds from the end of a frame until its sender listens.
        cell_bits: Bits that announce a cell.
        lease: Slotframes after which a cell is taken back.
        eb_bytes: Bytes of the payload of an enhanced beacon.
        eb_period: Seconds between the enhanced beacons of a node; None: it sends none.
        keep_alive: Seconds without correction after which a node asks its time parent; None: never.
        keep_alive_compensated: The same once the rate of its clock is known; None: rates are not estimated.
        tick: Resolution of time stamps in s.
    """

    slotframe: int
    slot: float
    channels: tuple[int, ...]
    min_be: int
    max_be: int
    tx_offset: float
    rx_wait: float
    tx_ack_delay: float
    rx_ack_delay: float
    cell_bits: int
    lease: int
    eb_bytes: int
    eb_period: float | None
    keep_alive: float | None
    keep_alive_compensated: float | None
    tick: float

    @property
    def shared_slots(self) -> tuple[int, ...]:
        """The slots of the shared cells, ascending."""

    @property
    def guard(self) -> float:
        """By how many seconds a frame may be early or late."""

    @property
    def rx_offset(self) -> float:
        """Seconds from the start of a slot until a receiver listens."""
