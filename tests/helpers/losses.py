"""Channels that lose chosen packets, for `wsnsim.offline.loopback.perform` and the clusters of these helpers."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import Parcel

Channel = Callable[[int, int, Parcel], Bools]
EVERY = slice(None)


def losing(
    packets: slice | Sequence[int] = EVERY,
    what: str | None = None,
    sources: Container[int] | None = None,
    to: int | None = None,
) -> Channel:
    """Return a channel that loses these packets of every parcel that matches, and no others.

    Args:
        packets: which packets of a parcel are lost.
        what: content of the parcels; None: any.
        sources: nodes that send them; None: any.
        to: node that they are sent to; None: any.
    """

    def channel(source: int, receiver: int, parcel: Parcel) -> Bools:
        arrived = np.ones(parcel.packets, dtype=bool)
        matches = what in (None, parcel.what) and to in (None, receiver) and (sources is None or source in sources)
        if matches:
            arrived[packets] = False
        return arrived

    return channel
