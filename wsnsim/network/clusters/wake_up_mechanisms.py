"""The built-in wake-up mechanisms: what nodes do with a wake-up message, by the rule of the scenario's `wakeup`.

mechanism = make_wake_up(component, services)      mechanism.begin(round)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from wsnsim.base.mechanisms import StartsWakeUp, WakeUpMechanism, WakeUpServices
from wsnsim.base.sleeping import Decision, WakeUp, WakeUpMessage, WakeUpRound
from wsnsim.network.mechanisms import make_mechanism

MESSAGE_NAMES: Final = {"flood": "track", "region": "announce", "invite": "invitation"}
"""The name of each mechanism's message in the event log."""


class RegionWakeUp:
    """Nodes in the message's region start to track and call their sleeping neighbours there; others may forward it.

    Each node decides once for each message, by the component's `decide`.
    """

    def __init__(self, component: WakeUp, services: WakeUpServices) -> None:
        self._component = component
        self._services = services
        self._decided: dict[tuple[int, int, int], float] = {}

    def begin(self, round: WakeUpRound) -> None:
        """The head decides like every other node, and broadcasts the message."""
        message, services = round.message, self._services
        self._forget_expired()
        round.sleepers = services.sleepers(services.nodes_within(message.centre, message.radius))
        self._decide(round, round.node, message)
        services.broadcast(round, round.node, message, lambda node, copy: self._decide(round, node, copy))

    def _decide(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Let a node decide about a copy of the message that reached it."""
        services = self._services
        if not services.is_up(node):
            return
        key = (node, message.target, message.sequence)
        decision = self._component.decide(
            services.place(node), message, key in self._decided, services.clock(node), self._chance(node, message)
        )
        if decision is Decision.DROP:
            services.drop(round, node, message)
            return
        self._decided[key] = message.expires
        if decision is Decision.TRACK:
            services.track(round, node, message)
            self._call_neighbours(round, node, message)
        elif decision is Decision.FORWARD:
            services.broadcast(round, node, message, lambda other, copy: self._decide(round, other, copy), relayed=True)
        elif node in round.called_nodes and node not in round.tracking:
            services.release(node, message.target)  # it was called, but need not track

    def _call_neighbours(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Call the sleeping neighbours in the region; a call carries the message."""
        sleepers = self._take_sleepers(round, node)
        if sleepers:
            copy = replace(message, sender=node)
            self._services.call(round, node, sleepers, message.bits, lambda woken: self._decide_all(round, woken, copy))

    def _decide_all(self, round: WakeUpRound, nodes: list[int], message: WakeUpMessage) -> None:
        for node in nodes:
            self._decide(round, node, message)

    def _take_sleepers(self, round: WakeUpRound, node: int) -> list[int]:
        """The sleeping nodes within call that have not been called yet, ascending; they count as called now."""
        if not round.sleepers:
            return []
        sleepers = round.sleepers.intersection(self._services.within_call(node).tolist())
        round.sleepers -= sleepers
        round.called_nodes |= sleepers
        return sorted(sleepers)

    def _chance(self, node: int, message: WakeUpMessage) -> float:
        """0: these mechanisms do not decide at random."""
        return 0.0

    def _forget_expired(self) -> None:
        """Forget expired messages: their sequence numbers are used again."""
        now = self._services.now
        if self._decided and min(self._decided.values()) < now:
            self._decided = {key: expires for key, expires in self._decided.items() if expires >= now}


class InvitationWakeUp(RegionWakeUp):
    """The head calls all its sleeping neighbours, then invites all neighbours; each decides by chance."""

    def begin(self, round: WakeUpRound) -> None:
        """Call, then broadcast."""
        message, services, node = round.message, self._services, round.node
        self._forget_expired()
        round.sleepers = services.sleepers(services.neighbours(node))
        services.track(round, node, message)
        sleepers = self._take_sleepers(round, node)
        if sleepers:
            services.call(round, node, sleepers, message.bits, lambda _: self._invite(round))
        else:
            self._invite(round)

    def _invite(self, round: WakeUpRound) -> None:
        self._services.broadcast(round, round.node, round.message, lambda node, copy: self._decide(round, node, copy))

    def _call_neighbours(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Do nothing: only the head calls."""

    def _chance(self, node: int, message: WakeUpMessage) -> float:
        """A random number of the node for the message."""
        return self._services.chance(node, message)


MECHANISMS: Final[Mapping[str, Callable[[WakeUp, WakeUpServices], WakeUpMechanism]]] = {
    "flood": RegionWakeUp,
    "region": RegionWakeUp,
    "invite": InvitationWakeUp,
}
"""The built-in mechanisms by name."""


def make_wake_up(component: WakeUp, services: WakeUpServices) -> WakeUpMechanism:
    """The mechanism of a component: its own, or the built-in one that it names.

    Raises:
        RunError: there is neither.
    """
    return make_mechanism("wakeup", component, services, StartsWakeUp, ("begin",), MECHANISMS, "none")
