"""When a frame gets the channel. A MAC is given frames and gives an event that fires when the last of them has ended.

make_mac(env, medium, part).send(frames) -> simpy.Event
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import simpy

from wsnsim.base.errors import RunError
from wsnsim.base.ports import Mac
from wsnsim.network.medium import Frame, Medium


class IdealMac:
    """The papers' world: no contention, no loss of its own, delivered within the instant.

    With a `rate` (bit/s) airtime counts: the frames of one batch follow one another; batches do not disturb each other.
    """

    def __init__(self, env: simpy.Environment, medium: Medium, rate: float | None) -> None:
        self._env = env
        self._medium = medium
        self._rate = rate

    def send(self, frames: Sequence[Frame]) -> simpy.Event:
        """One event for the whole batch, or one a frame where airtime counts."""
        if self._rate is not None:
            return self._env.process(self._one_by_one(frames, self._rate))
        event = self._env.event()
        assert event.callbacks is not None
        event.callbacks.append(lambda _: self._at_once(frames))
        return event.succeed()

    def _at_once(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self._medium.carry(frame)

    def _one_by_one(self, frames: Sequence[Frame], rate: float) -> Any:
        for frame in frames:
            yield self._env.timeout(frame.bits / rate)
            self._medium.carry(frame)


def make_mac(env: simpy.Environment, medium: Medium, part: Mac) -> IdealMac:
    """The mechanism behind a scenario's `mac`."""
    if part.mechanism != "ideal":
        raise RunError(f"mac: no mechanism '{part.mechanism}' in this network; known: ideal")
    return IdealMac(env, medium, getattr(part, "rate", None))
