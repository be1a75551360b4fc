"""A MAC: pure ALOHA (Abramson, 1970). A node sends each frame after a random delay, without listening before.

    python plugin_name.py           checks the rules of a MAC (wsnsim.testing.check_mac)
    wsnsim run plugin_name.yaml     runs the scenario beside this file

The component below is a frozen bundle of parameters. Its `start` returns the mechanism, which acts in simulated time by
the services of the network: they charge, log and count every frame that is sent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np

from wsnsim import Quantity, part
from wsnsim.plugins import Burst, Framed, MacFrame, MacServices, OfferedFrame, OnAir, Signal, derive, uniforms


@part
class PluginMac(Framed):
    """A node sends each frame after a random delay, without listening; there are no acknowledgements.

    `Framed` gives the parameters of a radio whose frames take time: rate, preamble, headers and largest payload.
    """

    mechanism: ClassVar[str] = "plugin_name"

    acks: Annotated[bool, "whether the receiver acknowledges a unicast"] = False
    delay: Annotated[float, Quantity("s", gt=0, le=1e3), "longest random delay before a frame"] = 20e-3

    def start(self, services: MacServices) -> PluginMacMechanism:
        """Return the mechanism. It is called once, before the simulation starts."""
        return PluginMacMechanism(self, services)


class PluginMacMechanism:
    """When frames are sent: a queue per node, and a random delay before its first frame."""

    def __init__(self, mac: PluginMac, services: MacServices) -> None:
        self.mac, self.services = mac, services
        self.channel = services.open_channel(mac, mac.turnaround)
        self.fragmentation = services.fragmentation(mac)
        self.key = services.key("plugin_name")
        self.queues: dict[int, deque[MacFrame]] = {}
        self.samples = 0

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> Signal:
        """Send bursts, and return a signal that succeeds when the last one has ended."""
        signal, missing = self.services.signal(), len(bursts)

        def ended() -> None:
            nonlocal missing
            missing -= 1
            if missing == 0:
                signal.succeed()

        if not bursts:
            signal.succeed()
        for burst in bursts:
            frames = self.fragmentation.split(burst, ended)
            if not frames or not self.services.is_up(burst.source):
                burst.lose()
                ended()
                continue
            for frame in frames:
                self._enqueue(burst.source, frame)
        return signal

    def offer(self, node: int, payload_bits: int, done: Callable[[Any], None], code: int = 0) -> None:
        """Broadcast one payload; `done` is called with the ids that received it."""
        self._enqueue(node, OfferedFrame(self.mac.bits(payload_bits), code, done))

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost."""
        self.channel.silence(node)
        for frame in self.queues.pop(node, ()):
            frame.finish(None)

    def _enqueue(self, node: int, frame: MacFrame) -> None:
        if node in self.queues:
            self.queues[node].append(frame)
            return
        self.queues[node] = deque([frame])
        self.services.hold_awake(node)
        self._wait(node)

    def _wait(self, node: int) -> None:
        self.samples += 1
        key = derive(self.key, node, self.samples)  # a function of seed, run, node and count: runs can be repeated
        share = float(uniforms(np.array([key], dtype=np.uint64), 0)[0])
        queue = self.queues[node]
        self.services.call_later(share * self.mac.delay, lambda: self._transmit(node, queue))

    def _transmit(self, node: int, queue: deque[MacFrame]) -> None:
        if self.queues.get(node) is queue:  # otherwise the node crashed in the meantime
            queue[0].owner = queue
            self.channel.transmit(node, queue[0], self._ended)

    def _ended(self, transmission: OnAir, received: Any) -> None:
        node, queue = transmission.source, self.queues.get(transmission.source)
        if queue is None or transmission.frame.owner is not queue:
            return
        queue.popleft()
        transmission.frame.finish(received)
        if self.queues.get(node) is not queue:
            return
        if queue:
            self._wait(node)
        else:
            del self.queues[node]
            self.services.release(node)


if __name__ == "__main__":
    from wsnsim.testing import check_mac

    check_mac(PluginMac())
    print("plugin_name: keeps the rules of a MAC")
