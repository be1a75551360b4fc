"""What wakes nodes ahead of a target: messages on the radio, and calls on the wake-up radio. All of it is booked.

    service.start(track, node, message, foreseen)      begins a round; what came of it is noted in `track.round`

A call on the wake-up radio reaches the sleeping nodes at which it arrives with the sensitivity of their wake-up
receivers, on a channel of its own where nothing disturbs it (our choice), and carries the message. A node knows which
of its neighbours sleep and hear its calls, and hears whom others call (our choice).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.mechanisms import HeardMessage, WakeUpMechanism, WakeUpServices
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.sleeping import Decision, Point, WakeUp, WakeUpMessage, WakeUpRadio, WakeUpRound
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.clusters.network_view import NetworkView, WakeIntervals
from wsnsim.network.clusters.track import Track
from wsnsim.network.event_log import EventLog, event, then
from wsnsim.network.mechanisms import NetworkServices, make_mechanism
from wsnsim.network.node_process import FRAME, NodeProcesses
from wsnsim.network.radio.transport import Transport

MESSAGE_NAMES: Final = {"flood": "track", "region": "announce", "invite": "invitation"}
"""The name of each mechanism's message in the event log."""
CALL: Final = KIND["call"]
CALLED: Final = KIND["called"]
DROP: Final = KIND["drop"]
NONE: Final = EVENT_CAUSE["none"]
TX: Final = EVENT_CAUSE["tx"]
RX: Final = EVENT_CAUSE["rx"]


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


class WakeUpService(NetworkServices):
    """Starts wake-up rounds, and performs what the mechanism of the scenario's `wakeup` does in them.

    `key` is the random key of the nodes' chances.
    """

    def __init__(
        self, network: NetworkView, processes: NodeProcesses, transport: Transport, intervals: WakeIntervals,
        clocks: Clocks, event_log: EventLog, key: int,
    ) -> None:  # fmt: skip
        super().__init__(network.clock.env, network.nodes, clocks)
        setup = network.setup
        self._protocol = setup.wakeup
        self._energy = setup.energy
        self._clock = network.clock
        self._processes = processes
        self._transport = transport
        self._intervals = intervals
        self._event_log = event_log
        self._key = key
        self._message_name = MESSAGE_NAMES.get(setup.wakeup.mechanism, "wake")
        rate = getattr(setup.mac, "rate", None)
        self._call_bits = None if rate is None else max(1, round(rate * self._protocol.call))
        self._radio: WakeUpRadio = getattr(setup.wakeup, "radio", WakeUpRadio())
        stronger = 0.0 if self._radio.power is None else self._radio.power - getattr(setup.link, "power", 0.0)
        self._least_power = self._radio.sensitivity - self._radio.path_gain - stronger
        self._calls = 0
        self._mechanism: WakeUpMechanism = make_mechanism("wakeup", setup.wakeup, self)

    def nodes_within(self, centre: Point, radius: float) -> Ints:
        """(n,) the nodes that stand within `radius` m of a point, by the positions that nodes assume."""
        return self._nodes.assumed.grid.within(centre, radius)

    def start(self, track: Track, node: int, message: WakeUpMessage, foreseen: bool) -> None:
        """Begin a round; returns at once."""
        track.round = WakeUpRound(message, node, self._env.now, foreseen)
        track.rounds.append(track.round)
        self._mechanism.begin(track.round)

    def addressed(self, head: int, message: WakeUpMessage) -> list[int]:
        """The nodes, up or down, that the head's map has in the region of a message, and to which it has a link."""
        near = self.nodes_within(message.centre, message.radius).tolist()
        connected = self._transport.connected
        return [node for node in near if node != head and connected(head, node)]

    def call_one(self, node: int, to: int, target: int) -> simpy.Event:
        """Call one sleeping neighbour; the event fires when the call has ended."""
        done = self._env.event()

        def awake(_: Sequence[int]) -> None:
            done.succeed()

        self._call(node, [to], target, PACKET_BITS, awake)
        return done

    def place(self, node: int) -> Point:
        """The assumed position of a node."""
        return self._nodes.assumed.x[node], self._nodes.assumed.y[node]

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, those included that are down."""
        return self._transport.topology.neighbours(node).ids

    def within_call(self, node: int) -> Ints:
        """(n,) the nodes at which a node's calls arrive with the sensitivity of the wake-up receivers, ascending."""
        neighbours = self._transport.topology.neighbours(node)
        return neighbours.ids[neighbours.powers >= self._least_power]

    def sleepers(self, nodes: Ints) -> set[int]:
        """The nodes, out of the given ones, that are up and asleep now."""
        if not self._nodes.follows_schedules:
            return set()
        asleep = self._nodes.living[nodes] & ~self._nodes.hears(nodes, self._env.now)
        return set(nodes[asleep].tolist())

    def broadcast(
        self, round: WakeUpRound, node: int, message: WakeUpMessage, on_heard: HeardMessage, relayed: bool = False
    ) -> None:
        """Broadcast a copy of a message once; `on_heard` is called with each node that heard it."""
        if not self.is_up(node):
            return
        copy = replace(message, sender=node, place=self.place(node))
        parcel = Parcel(copy, 1, copy.bits, self._message_name)
        sequence = round.sequence if relayed else 0
        sent, (burst,) = self._transport.broadcast([node], [parcel], copy.target, sequence, relayed)

        def ended() -> None:
            round.sequence = round.sequence or burst.sequence
            round.forwards += relayed and burst.sent > 0
            for listener in sorted(burst.received):
                on_heard(listener, copy)

        then(sent, ended)

    def call(
        self, round: WakeUpRound, node: int, sleepers: Sequence[int], bits: int, on_awake: Callable[[list[int]], None]
    ) -> None:
        """Call sleeping nodes on the wake-up radio; `on_awake` is called with those that woke."""

        def awake(woken: list[int]) -> None:
            round.called += len(woken)
            round.reached.update(woken)
            on_awake(woken)

        self._call(node, sleepers, round.message.target, bits, awake)

    def track(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Note that a node tracks at the message's step, and keep it awake until then and for the waiting time.

        The node goes by its own clock.
        """
        round.tracking[node] = message
        until = self._clocks.true_time(node, message.due + self._protocol.wait)
        self._processes.of(node).keep_awake(message.target, until, FRAME)
        self._intervals.shorten([node], until)

    def release(self, node: int, target: int) -> None:
        """Let a node follow its schedule again."""
        process = self._processes.find(node)
        if process is not None:
            process.release(target)

    def drop(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Log that a node ignored a message because it had expired."""
        round.expired += 1
        log = self._event_log
        self._log(DROP, node, message.target, message.sender, log.code("expired"), round.sequence)

    def chance(self, node: int, message: WakeUpMessage) -> float:
        """A uniform random number of a node for a message, in [0, 1)."""
        key = derive(self._key, message.target, message.step)
        return float(uniforms(derive_all(key, np.array([node])), 0)[0])

    def _call(
        self, node: int, sleepers: Sequence[int], target: int, bits: int, on_awake: Callable[[list[int]], None]
    ) -> None:
        """Occupy the wake-up radio for a call; at its end both sides pay and the called nodes are awake."""
        ended = self._env.timeout(self._protocol.call)
        then(ended, lambda: on_awake(self._end_call(node, sleepers, target, self._call_bits or bits)))

    def _end_call(self, node: int, sleepers: Iterable[int], target: int, bits: int) -> list[int]:
        """Book a call; return the nodes that it woke."""
        nodes, energy = self._nodes, self._energy
        if not nodes.alive[node]:
            return []
        electronics, amplifier = energy.transmit(bits, nodes.reach)
        sent = nodes.spend_transmit(node, electronics, amplifier, bits, self._protocol.call)
        self._log(CALL, node, target, bits=sent, joules=(electronics + amplifier) * sent / bits, cause=TX)
        woken = []
        for one in self._hear_call(node, sleepers) if sent == bits else ():
            cost = energy.receive(bits)
            paid = nodes.spend_receive(one, cost, bits)
            self._log(CALLED, one, target, node, bits=paid, joules=cost * paid / bits, cause=RX)
            if nodes.alive[one]:
                until = self._env.now + self._clocks.lasts(one, self._protocol.wait)
                self._processes.of(one).keep_awake(target, until, "call")
                self._intervals.shorten([one], until)
                woken.append(one)
        return woken

    def _hear_call(self, node: int, sleepers: Iterable[int]) -> list[int]:
        """The living nodes, out of the given ones, that hear a call of a node."""
        alive, within = self._nodes.alive, set(self.within_call(node).tolist())
        heard = [one for one in sleepers if alive[one] and one in within]
        if not self._radio.loss or not heard:
            return heard
        self._calls += 1
        key = derive(self._key, CALL, node, self._calls)
        lost = uniforms(derive_all(key, np.array(heard)), 0) < self._radio.loss
        return [one for one, missed in zip(heard, lost.tolist(), strict=True) if not missed]

    def _log(  # noqa: PLR0913
        self, kind: int, node: int, target: int, peer: int = -1, what: int = 0, sequence: int = 0, bits: int = 0,
        joules: float = 0.0, cause: int = NONE,
    ) -> None:  # fmt: skip
        now, step = self._env.now, self._clock.step
        row = event(now, step, target, node, kind, what, 0, sequence, peer, int(bits > 0), bits, joules, cause)
        self._event_log.add(row)
