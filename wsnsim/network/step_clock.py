"""The simulated time of a run and the number of its present step, and the log of protocol events at that time."""

from __future__ import annotations

from dataclasses import dataclass

import simpy

from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog, event


@dataclass(slots=True)
class StepClock:
    """Simulated time in steps of `dt` s. Only `World` advances `step`."""

    env: simpy.Environment
    dt: float
    step: int = 0

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return self.env.now

    @property
    def next_step(self) -> float:
        """The time in s at which the next step begins."""
        return (self.step + 1) * self.dt


class ProtocolLog:
    """Logs what protocols do, at the present time and step. Such an event costs no energy of its own."""

    def __init__(self, clock: StepClock, event_log: EventLog) -> None:
        self._clock = clock
        self._event_log = event_log

    def add(
        self, kind: str, target: int, node: int, what: str = "", peer: int = -1, packets: int = 0, bits: int = 0
    ) -> None:
        """Log one event."""
        clock, log = self._clock, self._event_log
        code = log.code(what)
        log.add(event(clock.env.now, clock.step, target, node, KIND[kind], code, peer=peer, packets=packets, bits=bits))
