"""The contract checks of MAC and wake-up components: `check_mac`, `check_wakeup`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.frames import EVERYONE, Burst, full_burst
from wsnsim.base.mechanisms import StartsWakeUp
from wsnsim.base.medium_access import Mac
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.setups import RadioSetup
from wsnsim.base.sleeping import Decision, WakeUp, WakeUpMessage, WakeUpPlan
from wsnsim.base.tables import KIND, Memory
from wsnsim.network.event_log import EventLog
from wsnsim.network.radio.radio_stack import make_radio_stack
from wsnsim.scenario import build, load
from wsnsim.testing.table import SCENARIOS, demand, demand_same_events, demand_silence_of_the_down, examined, run_with

HEAD: Final = 0
MEMBERS: Final = tuple(range(1, 9))
POSITIONS: Final = np.array([(0.0, 0.0), *((30.0 * np.cos(a), 30.0 * np.sin(a)) for a in MEMBERS), (500.0, 0.0)])
"""A cluster head, eight members around it, and a node out of range."""
PATIENCE: Final = 60.0
"""Seconds after which a burst must have ended."""


def check_mac(mac: Mac) -> None:
    """Check a MAC component against its contract, in a cluster of nine nodes.

    Args:
        mac: The component, built.

    Raises:
        AssertionError: Names the demand that fails. unicast: a burst to a neighbour ends and arrives, and both nodes
            pay. broadcast: all neighbours receive it, a node out of range does not. offer: its result is reported
            once. nothing: no bursts, and bursts without packets, end too. contention: bursts of all members to the
            head at once end, and each says what arrived. dead: a node that is down neither sends nor receives, and
            bursts from and to it end. silence: a node that crashes while it sends loses its frames, its bursts end, and
            it sends new ones after a restart. loss: over lossy links bursts end, and the packets are those of the mask.
            repeatable: the same seed gives the same events.
    """
    mac = examined(mac, Mac)
    for name, check in CHECKS.items():
        with demand(name):
            check(_RadioCluster(mac))
    with demand("loss"):
        _check_loss(_RadioCluster(mac, loss=0.3))
    with demand("repeatable"):
        first, second = _RadioCluster(mac), _RadioCluster(mac)
        _check_contention(first)
        _check_contention(second)
        assert first.log.fingerprint() == second.log.fingerprint(), "the same seed gives other events"


class _RadioCluster:
    """The nodes, their radio stack with the MAC, and the event log."""

    def __init__(self, mac: Mac, loss: float = 0.0) -> None:
        setup = build(load(SCENARIOS / "mac.yaml", {"link.loss": loss}))
        assert isinstance(setup, RadioSetup), "the scenario has a network"
        self._memory = Memory()
        self.log = EventLog(self._memory, 0)
        traits = np.ones((len(POSITIONS), 0))
        stack = make_radio_stack(replace(setup, mac=mac), POSITIONS, traits, Streams(3, 0), self.log)
        self.mac, self.nodes, self.env = stack.mac, stack.radio.nodes, stack.radio.env

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> None:
        """Send bursts, and assert that they end, each with as many packets as its mask says."""
        before = [burst.mask.copy() for burst in bursts]
        signal: Any = self.mac.send(bursts, head)
        self.env.run(until=self.env.any_of([signal, self.env.timeout(PATIENCE)]))
        assert signal.triggered, f"the signal of `send` has not succeeded after {PATIENCE:g} s"
        for burst, mask in zip(bursts, before, strict=True):
            assert burst.packets == burst.mask.sum(), "the number of packets is not that of the mask"
            assert not (burst.mask & ~mask).any(), "a packet arrived that was not sent"

    def events(self, kind: str) -> list[tuple[float, int]]:
        """(time, node) of the events of a kind."""
        self.log.flush(everything=True)
        table = self._memory.table("events")
        if not table:
            return []
        chosen = table["kind"] == KIND[kind]
        return list(zip(table["time"][chosen].tolist(), table["node"][chosen].tolist(), strict=True))


def _burst(source: int, to: int, packets: int = 1) -> Burst:
    return full_burst(source, to, Parcel("payload", packets, PACKET_BITS, "test"), -1)


def _check_unicast(cluster: _RadioCluster) -> None:
    burst = _burst(1, HEAD, packets=3)
    cluster.send([burst])
    assert burst.mask.all() and burst.packets == 3, "the packets do not arrive though nothing disturbs them"
    assert burst.sent >= 3 * PACKET_BITS, "`Burst.sent` does not count the bits that were sent"
    spent = cluster.nodes.ledger.spent
    assert spent[1] > 0.0 and spent[HEAD] > 0.0, "sender and receiver do not pay"


def _check_broadcast(cluster: _RadioCluster) -> None:
    burst = _burst(HEAD, EVERYONE, packets=2)
    cluster.send([burst])
    assert set(burst.received) == set(MEMBERS), f"nodes {sorted(burst.received)} receive it, {MEMBERS} are in range"
    assert all(mask.all() for mask in burst.received.values()), "a neighbour lacks packets"


def _check_offer(cluster: _RadioCluster) -> None:
    results: list[Any] = []
    cluster.mac.offer(HEAD, PACKET_BITS, results.append)
    cluster.env.run(until=PATIENCE)
    assert len(results) == 1, f"the result is reported {len(results)} times"
    assert results[0] is not None, "a free channel was never free"
    assert sorted(results[0].tolist()) == list(MEMBERS), "the neighbours do not receive it"


def _check_nothing(cluster: _RadioCluster) -> None:
    cluster.send([])
    empty = _burst(1, HEAD)
    empty.lose()
    cluster.send([empty])
    assert not empty.packets, "packets arrive that were not sent"


def _check_contention(cluster: _RadioCluster) -> None:
    for head in (HEAD, None):
        bursts = [_burst(node, HEAD, packets=2) for node in MEMBERS]
        cluster.send(bursts, head)
    assert cluster.events("send"), "nothing is sent"
    assert any(burst.packets for burst in bursts), "nothing arrives"


def _check_dead(cluster: _RadioCluster) -> None:
    cluster.nodes.crash(2)
    cluster.mac.silence(2)
    outgoing, incoming = _burst(2, HEAD), _burst(HEAD, 2)
    cluster.send([outgoing, incoming])
    assert not outgoing.packets and not incoming.packets, "a node that is down sends or receives"
    assert 2 not in [node for _, node in cluster.events("send")], "a node that is down sends"


def _check_silence(cluster: _RadioCluster) -> None:
    crash, restart = 5e-3, 10e-3

    def take_down() -> None:
        cluster.nodes.crash(1)
        cluster.mac.silence(1)

    cluster.env.timeout(crash).callbacks.append(lambda _: take_down())
    cluster.env.timeout(restart).callbacks.append(lambda _: cluster.nodes.restart(1, cluster.env.now))
    cluster.send([_burst(1, HEAD, packets=40)])
    cluster.env.run(until=cluster.env.now + 1.0)
    late = [time for time, node in cluster.events("send") if node == 1 and time > crash]
    assert not late, "a node sends after a crash what it had before"
    burst = _burst(1, HEAD)
    cluster.send([burst])
    assert burst.packets == 1, "a node does not send after a restart"


def _check_loss(cluster: _RadioCluster) -> None:
    for _ in range(20):
        cluster.send([_burst(node, HEAD, packets=4) for node in MEMBERS[:2]], HEAD)
        cluster.send([_burst(HEAD, EVERYONE, packets=4)])


CHECKS: Final[dict[str, Callable[[_RadioCluster], None]]] = {
    "unicast": _check_unicast,
    "broadcast": _check_broadcast,
    "offer": _check_offer,
    "nothing": _check_nothing,
    "contention": _check_contention,
    "dead": _check_dead,
    "silence": _check_silence,
}


PLAN: Final = WakeUpPlan(
    target=0, step=7, sequence=300, sender=3, place=(0.0, 0.0), fix=(10.0, 0.0), heading=(1.0, 0.0),
    prediction=(12.0, 0.0), foreseen=True, due=14.0, ahead=2.0, sensing=40.0, reach=80.0, payload_bits=160,
)  # fmt: skip


def check_wakeup(wakeup: WakeUp) -> None:
    """Check a wake-up component against its contract.

    Args:
        wakeup: the component.

    Raises:
        AssertionError: names the demand that fails. message: a message is about the plan's target and step, and its
            numbers are finite; decision: equal arguments give equal decisions; wakes: nodes track in a small network,
            and only nodes that are up send; repeatable: the same seed gives the same run.
    """
    if wakeup.mechanism == "none":
        return
    wakeup = examined(wakeup, WakeUp)
    with demand("message"):
        message = wakeup.compose(PLAN, None)
        _check_message(message)
    with demand("decision"):
        _check_decisions(wakeup, message)
    with demand("wakes"):
        first = _run(wakeup)
        _check_run(first)
    with demand("repeatable"):
        demand_same_events(first, _run(wakeup))


def _check_message(message: WakeUpMessage) -> None:
    assert (message.target, message.step) == (PLAN.target, PLAN.step), "it names another target or step"
    assert message.bits > 0 and message.radius >= 0.0, "its bits or its radius are negative or zero"
    assert message.expires >= message.due == PLAN.due, "it expires before its step"
    numbers = (*message.centre, *message.fix, *message.heading, message.radius, message.expires)
    assert all(map(math.isfinite, numbers)), "it holds a number that is not finite"


def _check_decisions(wakeup: WakeUp, message: WakeUpMessage) -> None:
    """A component without a mechanism of its own decides for every node, by its arguments alone."""
    if isinstance(wakeup, StartsWakeUp):
        return
    for x in (0.0, 12.0, 60.0, 500.0):
        for seen, now in ((False, 13.0), (True, 13.0), (False, message.expires + 1.0)):
            decisions = [wakeup.decide((x, 0.0), message, seen, now, 0.5) for _ in range(2)]
            assert decisions[0] is decisions[1], "equal arguments give different decisions"
            assert isinstance(decisions[0], Decision), f"{decisions[0]!r} is not a Decision"


def _run(wakeup: WakeUp) -> Memory:
    """One run of the small network."""
    main = "detection" if wakeup.mechanism == "invite" else "prediction"
    return run_with("wakeup", {"clusters.main": main}, wakeup=wakeup)


def _check_run(memory: Memory) -> None:
    wakeups = memory.table("wakeups")
    assert wakeups, "no head started a round"
    assert (wakeups["woken"] > 0).any(), "no node tracked at the step that it was woken for"
    demand_silence_of_the_down(memory.table("events"), ("send", "call"))
