"""The MAC of a network: the mechanism that a scenario's `mac` starts, and that of the ideal channel.

The built-in components name their mechanism; MECHANISMS binds the names. A plug-in starts its own mechanism.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.frames import EVERYONE, Burst, Received, full_burst
from wsnsim.base.mac_mechanisms import MacMechanism, StartsMac
from wsnsim.base.medium_access import IdealAccess, Mac
from wsnsim.base.requests import Parcel
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.network.radio.csma import CsmaMechanism
from wsnsim.network.radio.ideal_medium import IdealMedium
from wsnsim.network.radio.lpl.contikimac import ContikiMacMechanism
from wsnsim.network.radio.lpl.xmac import XMacMechanism
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.tdma import TdmaMechanism
from wsnsim.network.radio.tsch.tsch_mechanism import TschMechanism
from wsnsim.network.radio.unicasts import Unicasts


class IdealMechanism:
    """The ideal channel of the papers: no contention, no collision, no loss of its own.

    Without a rate, bursts are delivered within the instant. With a rate (bit/s), the bursts of one batch follow one
    another; different batches do not disturb each other. A burst is delivered at its end, to whom listens then: a node
    that wakes in the middle of it receives it, and a node that falls asleep in the middle does not. On a channel with
    frames (`reception`) it is the other way round: a radio must have listened from the beginning, and then receives the
    frame to its end.
    """

    def __init__(self, mac: IdealAccess, services: NetworkMacServices) -> None:
        self._env = services.radio.env
        self._nodes = services.radio.nodes
        self._log = services.radio.log
        self._rate = mac.rate
        self._medium = IdealMedium(services.radio, services.key("link"), mac.rate)
        self._silenced: dict[int, int] = {}

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Send bursts: one event for all of them, or one per burst if sending takes time."""
        if self._rate is not None:
            return self._env.process(self._one_by_one(bursts, self._rate))
        event = self._env.event()
        event.callbacks.append(lambda _: self._at_once(bursts))
        return event.succeed()

    def send_unicasts(self, unicasts: Unicasts) -> simpy.Event | None:
        """Send unicasts at this instant, by one event; None if sending takes time."""
        if self._rate is not None:
            return None
        event = self._env.event()
        event.callbacks.append(lambda _: self._medium.carry_all(unicasts))
        return event.succeed()

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, now or after its airtime."""
        what = self._log.word(code) or "beacon"
        burst = full_burst(node, EVERYONE, Parcel(None, 1, payload_bits, what), -1)
        event = self.send([burst])
        assert event.callbacks is not None, "a burst ends later than it is sent"
        event.callbacks.append(lambda _: done(np.array(sorted(burst.received), dtype=np.int64)))

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: what it is sending is lost."""
        self._silenced[node] = self._silenced.get(node, 0) + 1

    def _at_once(self, bursts: Sequence[Burst]) -> None:
        for burst in bursts:
            self._medium.carry(burst)

    def _one_by_one(self, bursts: Sequence[Burst], rate: float) -> Generator[simpy.Event, Any, None]:
        before = [self._silenced.get(burst.source) for burst in bursts]
        for burst, silenced in zip(bursts, before, strict=True):
            self._nodes.begin_sending(burst.source)
            yield self._env.timeout(burst.bits / rate)
            if self._silenced.get(burst.source) == silenced:
                self._medium.carry(burst)
            else:
                burst.lose()
            self._nodes.end_sending(burst.source)


MECHANISMS: Final[dict[str, Callable[[Any, NetworkMacServices], MacMechanism]]] = {
    "ideal": IdealMechanism,
    "csma": CsmaMechanism,
    "tdma": TdmaMechanism,
    "xmac": XMacMechanism,
    "contikimac": ContikiMacMechanism,
    "tsch": TschMechanism,
}
"""The built-in mechanisms by name."""


def make_mac(mac: Mac, services: NetworkMacServices) -> MacMechanism:
    """Return the mechanism of a MAC component: its own, or the built-in one that it names.

    Raises:
        RunError: There is neither.
    """
    return make_mechanism("mac", mac, services, StartsMac, ("send", "offer", "silence"), MECHANISMS)
