"""When a frame gets the channel. A MAC is given bursts and gives an event that fires when the last of them has ended.

make_mac(...).send(frames) -> simpy.Event           bursts between nodes
.offer(node, payload_bits, done)                    one broadcast, without an event of its own
.silence(node)                                      the node is dead or down
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import simpy

from wsnsim.base.errors import RunError
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.setups import RadioSetup
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.counters import Counters
from wsnsim.network.radio.csma import CsmaMechanism, nothing_arrives
from wsnsim.network.radio.fragmentation import Fragmentation
from wsnsim.network.radio.ideal_medium import EVERYONE, Burst, IdealMedium, burst
from wsnsim.network.radio.tdma import TdmaMechanism
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transmission import Heard


class Access(Protocol):
    """What the network needs of a MAC."""

    counts: Counters

    def send(self, frames: Sequence[Burst], hub: int | None = None) -> simpy.Event:
        """Bursts under way; the event fires when the last has ended. `hub`: the head in whose cluster they are."""
        ...

    def offer(self, node: int, payload_bits: int, done: Callable[[Heard | None], None], code: int = 0) -> None:
        """Broadcast one payload; `done` is told who heard it, or None if it never got the channel."""
        ...

    def silence(self, node: int) -> None: ...

    def count_links(self) -> None: ...

    def link_rows(self) -> dict[str, Any]: ...


class IdealMechanism:
    """The papers' world: no contention, no loss of its own, delivered within the instant.

    With a `rate` (bit/s) airtime counts: the frames of one batch follow one another; batches do not disturb each other.
    """

    def __init__(self, env: simpy.Environment, medium: IdealMedium, rate: float | None) -> None:
        self._env = env
        self._medium = medium
        self._rate = rate
        self._silenced: dict[int, int] = {}
        self.counts = medium.counts

    def send(self, frames: Sequence[Burst], hub: int | None = None) -> simpy.Event:
        """One event for the whole batch, or one a frame where airtime counts."""
        if self._rate is not None:
            return self._env.process(self._one_by_one(frames, self._rate))
        event = self._env.event()
        assert event.callbacks is not None
        event.callbacks.append(lambda _: self._at_once(frames))
        return event.succeed()

    def offer(self, node: int, payload_bits: int, done: Callable[[Heard | None], None], code: int = 0) -> None:
        """Broadcast one payload, now or after its airtime."""
        frame = burst(node, EVERYONE, Parcel(None, 1, payload_bits, "beacon"), -1)
        event = self.send([frame])
        assert event.callbacks is not None
        event.callbacks.append(lambda _: done(np.array(sorted(frame.heard), dtype=np.int64)))

    def silence(self, node: int) -> None:
        """What a node was sending breaks off, and what it was given to send is not carried."""
        self._silenced[node] = self._silenced.get(node, 0) + 1

    def count_links(self) -> None:
        """Nothing to count where nothing is lost by chance."""

    def link_rows(self) -> dict[str, Any]:
        """No rows."""
        return {}

    def _at_once(self, frames: Sequence[Burst]) -> None:
        for frame in frames:
            self._medium.carry(frame)

    def _one_by_one(self, frames: Sequence[Burst], rate: float) -> Any:
        before = [self._silenced.get(frame.source) for frame in frames]
        for frame, silenced in zip(frames, before, strict=True):
            self._medium.fleet.begin_sending(frame.source)
            yield self._env.timeout(frame.bits / rate)
            if self._silenced.get(frame.source) == silenced:
                self._medium.carry(frame)
            else:
                nothing_arrives(frame)
            self._medium.fleet.end_sending(frame.source)


def make_mac(
    env: simpy.Environment, fleet: Nodes, journal: EventLog, wiring: Topology, parts: RadioSetup, streams: Streams,
    clocks: Clocks,
) -> Access:  # fmt: skip
    """The mechanism behind a scenario's `mac`."""
    part: Any = parts.mac
    counts, key = Counters(), streams.key("link")
    if part.mechanism == "ideal":
        rate = getattr(part, "rate", None)
        return IdealMechanism(env, IdealMedium(env, fleet, journal, parts.energy, wiring, counts, key, rate), rate)
    if part.mechanism not in ("csma", "tdma"):
        raise RunError(f"mac: no mechanism '{part.mechanism}' in this network; known: ideal, csma, tdma")
    channel = Channel(env, fleet, journal, parts.energy, parts.link, wiring, part, counts, key, part.cca)
    bursts = Fragmentation(part, parts.packing, journal)
    contending = CsmaMechanism(env, fleet, channel, bursts, journal, part, streams.key("mac"), clocks)
    if part.mechanism == "csma":
        return contending
    return TdmaMechanism(env, fleet, channel, contending, bursts, journal, part, clocks)
