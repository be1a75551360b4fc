"""What one packet costs over a distance: a tracker weighs a reading against it, see `Scene.packet_joules`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.radio import EnergyModel
from wsnsim.base.requests import PACKET_BITS


@dataclass(frozen=True, slots=True)
class PacketJoules:
    """The energy of one packet of `PACKET_BITS` by an energy model, at the sender and at one receiver."""

    energy: EnergyModel

    def __call__(self, distances: Floats) -> Floats:
        """(n,) J that a packet costs over distances (n,) in m; headers of frames and acknowledgements excluded."""
        transmit, received = self.energy.transmit, self.energy.receive(PACKET_BITS)
        spent = [sum(transmit(PACKET_BITS, distance)) + received for distance in distances.tolist()]
        return np.array(spent, dtype=np.float64)


def free_packets(distances: Floats) -> Floats:
    """(n,) zeros: without a network a packet costs nothing."""
    return np.zeros(len(distances))
