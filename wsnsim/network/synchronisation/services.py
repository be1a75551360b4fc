"""The services that the network gives time synchronisation: `base.synchronisation.SyncServices`."""

from __future__ import annotations

from collections.abc import Callable

from wsnsim.base.arrays import Ints
from wsnsim.network.radio.radio_stack import RadioStack


class NetworkSyncServices:
    """What time synchronisation may use of one network. `key` is its random key."""

    def __init__(self, stack: RadioStack, key: int) -> None:
        self._env, self._nodes = stack.radio.env, stack.radio.nodes
        self._mac = stack.mac
        self._clocks = clocks = stack.clocks
        self._word = stack.radio.log.code
        self.key = key
        self.size = self._nodes.size
        self.is_awake: Callable[[int], bool] = self._nodes.is_awake
        self.next_change: Callable[[int], float] = self._nodes.duty_cycles.next_change
        self.clock: Callable[[int], float] = clocks.shows
        self.own_clock: Callable[[int], float] = clocks.own
        self.lasts: Callable[[int, float], float] = clocks.lasts

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return self._env.now

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""
        return bool(self._nodes.alive[node])

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""
        return node in self._nodes.died_at

    def set_clock(self, node: int, shows: float, rate: float) -> None:
        """Correct the clock of a node: it shows `shows` now, and its own clock counts `rate` s per second of it."""
        self._clocks.correct(node, shows - self._clocks.shows(node), rate)

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        timer = self._env.timeout(seconds)
        assert timer.callbacks is not None
        timer.callbacks.append(lambda _: action())

    def broadcast(self, node: int, bits: int, done: Callable[[Ints | None], None]) -> None:
        """Broadcast a message; `done` gets the nodes (n,) that received it, or None if it was not sent."""
        self._mac.offer(node, bits, done, self._word("sync"))
