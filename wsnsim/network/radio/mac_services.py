"""The services that the network gives a MAC: `base.mac_mechanisms.MacServices`, on SimPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import Burst, Counters, MacFrame
from wsnsim.base.mac_mechanisms import Listening
from wsnsim.base.medium_access import FramedMac, Packing
from wsnsim.base.rng import Streams
from wsnsim.base.tables import KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import event
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.fragmentation import Fragmentation
from wsnsim.network.radio.link_counters import LinkCounters, NoLinkCounters
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.use_counter import LossSamples, UseCounter

DROP = KIND["drop"]


@dataclass(frozen=True, slots=True)
class NetworkMacServices:
    """Services of one network. Built-in MACs also use `radio` and `clocks` directly, where speed matters.

    `sinks` are the nodes that collect the estimates; none if nobody does.
    """

    radio: RadioServices
    packing: Packing
    clocks: Clocks
    streams: Streams
    links: LinkCounters | NoLinkCounters
    uses: UseCounter = field(default_factory=UseCounter)
    sinks: tuple[int, ...] = ()

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return float(self.radio.env.now)

    @property
    def step(self) -> int:
        """The number of the present step."""
        return self.radio.log.step

    @property
    def counters(self) -> Counters:
        """The counters of the run."""
        return self.radio.counters

    def key(self, stream: str) -> int:
        """Return the key of a random stream."""
        return self.streams.key(stream)

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""
        return bool(self.radio.nodes.alive[node])

    def is_awake(self, node: int) -> bool:
        """Whether a node is up and listens."""
        return bool(self.radio.nodes.is_awake(node))

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, ascending."""
        return self.radio.topology.neighbours(node).ids

    def hold_awake(self, node: int) -> None:
        """Keep a node awake until `release`, because it has a frame to send."""
        self.radio.nodes.begin_sending(node)

    def release(self, node: int) -> None:
        """Let a node follow its schedule again."""
        self.radio.nodes.end_sending(node)

    def lasts(self, node: int, seconds: float) -> float:
        """Return the seconds that pass while a node's clock counts `seconds`."""
        return self.clocks.lasts(node, seconds)

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        timeout = self.radio.env.timeout(seconds)
        timeout.callbacks.append(lambda _: action())

    def signal(self) -> simpy.Event:
        """Return a new signal, for the end of bursts."""
        return self.radio.env.event()

    def open_channel(self, mac: FramedMac, assessment: float, listening: Listening | None = None) -> Channel:
        """Return a channel on which the frames of a MAC take time: one for each physical channel.

        Args:
            mac: The parameters.
            assessment: Duration of a clear channel assessment in s.
            listening: Which radios are on; None: those of all nodes that are awake.
        """
        losses = LossSamples(self.streams.key("link"), self.uses)
        return Channel(self.radio, mac, assessment, losses, self.links, listening)

    def fragmentation(self, mac: FramedMac) -> Fragmentation:
        """Return what splits bursts into the frames of a MAC."""
        return Fragmentation(mac, self.packing, self.radio.log)

    def log_drop(self, node: int, dropped: Burst | MacFrame, reason: str) -> None:
        """Log that a node dropped a burst or a frame without sending it."""
        log = self.radio.log
        log.add(
            event(
                self.radio.env.now, log.step, dropped.target, node, DROP, log.code(reason),
                sequence=dropped.sequence, peer=dropped.to, packets=dropped.packets,
            )
        )  # fmt: skip
