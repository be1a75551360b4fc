"""The queues of a MAC whose nodes send one frame after another: bursts and payloads become frames of their senders."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import simpy

from wsnsim.base.frames import Burst, MacFrame, OfferedFrame, Received
from wsnsim.base.medium_access import FramedMac
from wsnsim.network.radio.mac_services import NetworkMacServices


class QueueingSender(Protocol):
    """A node with frames to send.

    Attributes:
        queue: Frames that wait.
        frame: The frame in progress, or None.
        received: Whether the destination has received the frame, even if its acknowledgement was lost.
        stopped: Whether the node died or crashed.
    """

    queue: deque[MacFrame]
    frame: MacFrame | None
    received: bool
    stopped: bool


Sender = TypeVar("Sender", bound=QueueingSender)


class SenderQueues(Generic[Sender]):
    """The senders of all nodes. A MAC says what a frame waits for: `_enqueue`."""

    def __init__(self, mac: FramedMac, services: NetworkMacServices) -> None:
        self._env = services.radio.env
        self._nodes = services.radio.nodes
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
