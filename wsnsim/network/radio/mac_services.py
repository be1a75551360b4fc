"""What a MAC gets (`base.mac_mechanisms.MacServices`), and what several share: queues and contention periods."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import SEND, Burst, MacFrame, OfferedFrame, Received
from wsnsim.base.mac_mechanisms import Listening
from wsnsim.base.medium_access import FramedMac, Packing
from wsnsim.base.rng import GOLDEN, MASK, Streams, derive, mix
from wsnsim.network.clocks import Clocks
from wsnsim.network.mechanisms import NetworkServices
from wsnsim.network.radio.topology import RadioServices
from wsnsim.network.radio.transmission import LinkCounters, UseCounter

if TYPE_CHECKING:
    from wsnsim.network.radio.channel import Channel
    from wsnsim.network.radio.fragmentation import Fragmentation


class NetworkMacServices(NetworkServices):
    """Services of one network. Built-in MACs also use `radio` and `clocks` directly, where speed matters.

    `sinks` are the nodes that collect the estimates; none if nobody does.
    """

    def __init__(
        self, radio: RadioServices, packing: Packing, clocks: Clocks, streams: Streams,
        links: LinkCounters | None, sinks: tuple[int, ...] = (),
    ) -> None:  # fmt: skip
        super().__init__(radio.env, radio.nodes, clocks)
        self.radio, self.clocks, self.sinks = radio, clocks, sinks
        self._packing, self.links = packing, links
        self._losses = UseCounter(streams.key("link"))
        self.counters, self.key = radio.counters, streams.key
        self.hold_awake, self.release, self.signal = radio.nodes.begin_sending, radio.nodes.end_sending, radio.env.event

    @property
    def step(self) -> int:
        """The number of the present step."""
        return self.radio.log.step

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, ascending."""
        return self.radio.topology.neighbours(node).ids

    def open_channel(self, mac: FramedMac, assessment: float, listening: Listening | None = None) -> Channel:
        """Return a channel on which the frames of a MAC take time: one for each physical channel.

        Args:
            mac: The parameters.
            assessment: Duration of a clear channel assessment in s.
            listening: Which radios are on; None: those of all nodes that are awake.
        """
        from wsnsim.network.radio.channel import Channel

        return Channel(self.radio, mac, assessment, self._losses, self.links, listening)

    def fragmentation(self, mac: FramedMac) -> Fragmentation:
        """Return what splits bursts into the frames of a MAC."""
        from wsnsim.network.radio.fragmentation import Fragmentation

        return Fragmentation(mac, self._packing, self.radio.log)

    def log_drop(self, node: int, dropped: Burst | MacFrame, reason: str) -> None:
        """Log that a node dropped a burst or a frame without sending it."""
        self.radio.log.drop(
            self.radio.env.now, dropped.target, node, reason, dropped.to, dropped.packets, dropped.sequence
        )


@dataclass(slots=True, eq=False)
class FrameSender:
    """A node with frames to send.

    Attributes:
        node: The node.
        queue: Frames that wait.
        frame: The frame in progress, or None.
        received: Whether the destination has received the frame, even if its acknowledgement was lost.
        stopped: Whether the node died or crashed.
        state, step: Its random number generator, and the step for which it is seeded.
    """

    node: int
    queue: deque[MacFrame] = field(default_factory=deque)
    frame: MacFrame | None = None
    received: bool = False
    stopped: bool = False
    state: int = 0
    step: int = -1

    @property
    def current(self) -> MacFrame:
        """The frame in progress."""
        assert self.frame is not None, "a sender that acts has a frame"
        return self.frame

    def draw(self, key: int, step: int) -> int:
        """Return 64 random bits. The generator is seeded for each step, independently of earlier steps."""
        if self.step != step:
            self.step, self.state = step, derive(key, self.node, step)
        self.state = (self.state + GOLDEN) & MASK
        return mix(self.state)


def control_frame(about: MacFrame, to: int, bits: int, code: int, owner: Any) -> MacFrame:
    """Return a frame without packets that a MAC sends for another one, such as an acknowledgement."""
    frame = MacFrame(to, bits, 0, about.target, code, SEND, about.sequence)
    frame.owner = owner
    return frame


class MacPart:
    """The base of a MAC mechanism and of its parts: what they use of the network."""

    def __init__(self, services: NetworkMacServices) -> None:
        self._services, self._clocks = services, services.clocks
        self._env, self._nodes, self._topology, _, self._log, self._counters = services.radio

    def _repeats(self, frame: MacFrame, most: int) -> bool:
        """Count that a frame is sent once more; false if it has been repeated `most` times."""
        if frame.retries >= most:
            return False
        frame.retries += 1
        self._counters.retries += 1
        return True


Sender = TypeVar("Sender", bound=FrameSender)


class SenderQueues(MacPart, Generic[Sender]):
    """The senders of all nodes. A MAC says what a frame waits for: `_enqueue`."""

    def __init__(self, mac: FramedMac, services: NetworkMacServices) -> None:
        super().__init__(services)
        self._bits = mac.bits
        self._senders: dict[int, Sender] = {}
        self.fragmentation = services.fragmentation(mac)

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Queue bursts at their senders; the event fires when the last burst has ended."""
        return self.fragmentation.send_all(bursts, self._env.event(), self._is_up, self._enqueue)

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, then call `done` with the receivers, or with None if it never got the channel."""
        self._enqueue(node, OfferedFrame(self._bits(payload_bits), code, done))

    def _enqueue(self, node: int, frame: MacFrame) -> None:
        raise NotImplementedError

    def _is_up(self, burst: Burst) -> bool:
        return bool(self._nodes.alive[burst.source])

    def _stop(self, node: int) -> None:
        """Forget the sender of a node that died or crashed. Its frame is cut, and those in its queue are lost."""
        sender = self._senders.pop(node, None)
        if sender is None:
            return
        sender.stopped = True
        if sender.frame is None:
            return
        result = self._result_of_cut(sender)
        current, sender.frame = sender.frame, None
        current.finish(result)
        for frame in sender.queue:
            frame.finish(None)

    def _result_of_cut(self, sender: Sender) -> Received | None:
        """The result of the frame of a sender that is cut."""
        return True if sender.received else None


class ContentionPeriods:
    """Which nodes hold frames back, until when, and which exchanges are under way.

        periods.closed_until(node) -> event or None      periods.close(head) -> s until the round may begin

    A round of slots closes the contention period of the nodes in range of its head or of a member with a slot: they
    hear frames that say how long the round will last, as the duration field of IEEE 802.11 does. They hold frames
    outside slots back until the round has ended. An exchange that is under way, a frame and its acknowledgement, delays
    the round. That all of these nodes know a round from its first instant on is an idealisation of ours. A node out of
    range of all of them may still disturb a member that receives.
    """

    def __init__(self, env: simpy.Environment) -> None:
        self._env = env
        self._informed: dict[int, set[int]] = {}
        """{head: the nodes that hear its rounds, and the head itself}"""
        self._rounds: dict[int, simpy.Event] = {}
        """{head with a round under way: fires at its end}"""
        self._ended: dict[int, float] = {}
        """{head: the end of its last round in s}"""
        self._exchanges: dict[int, float] = {}
        """{node: the end of its last exchange outside slots in s}"""

    def inform(self, head: int, nodes: set[int]) -> None:
        """Set which nodes hear the rounds of a head."""
        self._informed[head] = nodes | {head}

    def closed_until(self, node: int) -> simpy.Event | None:
        """The end of a round that a node hears; None: it may contend."""
        for head, ended in self._rounds.items():
            if node in self._informed[head]:
                return ended
        return None

    def note_exchange(self, nodes: Iterable[int], seconds: float) -> None:
        """Note that nodes exchange a frame and its acknowledgement, from now on for `seconds`."""
        for node in nodes:
            self._exchanges[node] = self._env.now + seconds

    def left(self, head: int, shortest: float) -> float:
        """Seconds that remain of the contention period after a head's last round, if it lasts `shortest` s."""
        ended = self._ended.get(head)
        return 0.0 if ended is None else max(ended + shortest - self._env.now, 0.0)

    def close(self, head: int) -> float:
        """Close the period for the nodes that hear a head's rounds; seconds until their exchanges are over."""
        self._rounds[head] = self._env.event()
        exchanges, now = self._exchanges, self._env.now
        informed = self._informed.setdefault(head, {head})
        return max(
            (exchanges[node] - now for node in informed & exchanges.keys() if exchanges[node] > now), default=0.0
        )

    def reopen(self, head: int) -> None:
        """End a head's round; the frames that were held back contend."""
        self._ended[head] = self._env.now
        self._rounds.pop(head).succeed()
