"""A MAC for tests whose hops take as long as on a radio that is mostly off: CSMA/CA after a wait for the receiver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, Burst, Received
from wsnsim.base.medium_access import Latency, RadioDuty
from wsnsim.base.part import Quantity, part
from wsnsim.base.rng import derive
from wsnsim.models.access import Csma
from wsnsim.network.radio.csma import CsmaMechanism
from wsnsim.network.radio.mac_services import NetworkMacServices


@part
class LateCsma(Csma):
    """CSMA/CA whose senders first wait for their receivers: up to `interval` s, all of it for a broadcast.

    A node sends one burst after the other. Waiting occupies nobody else's channel.
    """

    mechanism: ClassVar[str] = "late"

    interval: Annotated[float, Quantity("s", gt=0.0), "between two wake-ups of a receiver"] = 0.125
    near: Annotated[float | None, Quantity("s", gt=0.0), "the interval of nodes that are told to hurry"] = None

    @property
    def duties(self) -> tuple[RadioDuty, ...]:
        """Listening for 1 % of the time."""
        return tuple([RadioDuty(each, 1.0, each / 100) for each in (self.interval, self.near or self.interval)])

    def latency(self, bits: int) -> Latency:
        """One wait, backoff and frame."""
        exchange = self.backoff * 2**self.min_be + self.airtime(self.bits(bits)) + self.ack_wait
        return Latency(self.interval + exchange, self.interval + exchange)

    def start(self, services: NetworkMacServices) -> LateMechanism:
        """The mechanism, which `STARTED` keeps for a test to look at."""
        STARTED[:] = [LateMechanism(self, services)]
        return STARTED[0]


@dataclass
class LateMechanism:
    """Waits, then gives a burst to CSMA/CA; `hurried` is what it was told."""

    mac: LateCsma
    services: Any
    hurried: list[tuple[float, tuple[int, ...], float]] = field(default_factory=list)
    free_at: dict[int, float] = field(default_factory=dict)
    until: dict[int, float] = field(default_factory=dict)
    sent: int = 0

    def __post_init__(self) -> None:
        self.csma = CsmaMechanism(self.mac, self.services)

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> Any:
        """Send each burst after the wait for its receiver."""
        signal, left = self.services.signal(), len(bursts)

        def ended(_: Any) -> None:
            nonlocal left
            left -= 1
            if not left:
                signal.succeed()

        def begin(burst: Burst) -> None:
            self.csma.send([burst]).callbacks.append(ended)

        for burst in bursts:
            self.services.call_later(self._wait(burst.source, burst.to), lambda burst=burst: begin(burst))
        return signal if bursts else self.csma.send([])

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload after the wait."""
        self.services.call_later(self._wait(node, EVERYONE), lambda: self.csma.offer(node, payload_bits, done, code))

    def silence(self, node: int) -> None:
        """As CSMA/CA."""
        self.csma.silence(node)

    def use_short_interval(self, nodes: Ints, until: float) -> None:
        """Note that nodes use the short interval until a time."""
        self.hurried.append((self.services.now, tuple(nodes.tolist()), until))
        self.until.update({node: max(until, self.until.get(node, 0.0)) for node in nodes.tolist()})

    def _wait(self, node: int, to: int) -> float:
        """Seconds from now until the receiver of a node's next burst listens."""
        now = self.services.now
        self.sent += 1
        share = derive(self.services.key("mac"), node, self.sent) / 2**64
        near = self.mac.near is not None and self.until.get(to, 0.0) > now
        wait = self.mac.interval if to == EVERYONE else share * (self.mac.near if near else self.mac.interval)
        self.free_at[node] = max(now, self.free_at.get(node, 0.0)) + wait
        return self.free_at[node] - now


STARTED: list[LateMechanism] = []
