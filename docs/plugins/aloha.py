"""A MAC: pure ALOHA (Abramson 1970), without listening and without acknowledgement."""

from collections import deque
from typing import Annotated

import numpy as np

from wsnsim import Quantity, part
from wsnsim.plugins import Framed, OfferedFrame, derive, uniforms


@part
class PureAloha(Framed):
    """A node sends each frame after a random delay, without listening. There are no acknowledgements."""

    mechanism = "pure_aloha"
    acks: bool = False
    delay: Annotated[float, Quantity("s", gt=0.0), "largest delay before a frame"] = 20e-3

    def start(self, services):
        return Aloha(self, services)


class Aloha:
    def __init__(self, mac, services):
        self.mac, self.services = mac, services
        self.channel = services.open_channel(mac, mac.turnaround)
        self.fragmentation = services.fragmentation(mac)
        self.key = services.key("aloha")
        self.queues = {}
        self.samples = 0

    def send(self, bursts, head=None):
        signal, missing = self.services.signal(), len(bursts)

        def ended():
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
                self.enqueue(burst.source, frame)
        return signal

    def offer(self, node, payload_bits, done, code=0):
        self.enqueue(node, OfferedFrame(self.mac.bits(payload_bits), code, done))

    def silence(self, node):
        self.channel.silence(node)
        for frame in self.queues.pop(node, ()):
            frame.finish(None)

    def enqueue(self, node, frame):
        if node not in self.queues:
            self.queues[node] = deque()
            self.services.hold_awake(node)
            self.wait(node)
        self.queues[node].append(frame)

    def wait(self, node):
        self.samples += 1
        sample = float(uniforms(np.array([derive(self.key, node, self.samples)], dtype=np.uint64), 0)[0])
        queue = self.queues[node]
        self.services.call_later(sample * self.mac.delay, lambda: self.transmit(node, queue))

    def transmit(self, node, queue):
        if self.queues.get(node) is queue:  # otherwise the node crashed in the meantime
            queue[0].owner = queue
            self.channel.transmit(node, queue[0], self.ended)

    def ended(self, transmission, received):
        node, queue = transmission.source, transmission.frame.owner
        if self.queues.get(node) is not queue:
            return
        queue.popleft()
        transmission.frame.finish(received)
        if self.queues.get(node) is not queue:
            return
        if queue:
            self.wait(node)
        else:
            del self.queues[node]
            self.services.release(node)
