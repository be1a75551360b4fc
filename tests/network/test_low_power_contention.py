"""Low-power listening under contention, against a second simulation that is plain and shares no code.

Some senders around one receiver offer frames at random times, the same in both. Delivered frames, failures, seconds of
sending and seconds in which radios are on must agree within the Monte Carlo error, that of the mean difference
of pairs of runs, and 2 %. Where nothing is random but the phases, which both are given, every node agrees to 1e-9 s.
"""

import numpy as np
import pytest
from scipy.stats import t

from tests.network import plain_contikimac, plain_xmac
from tests.network.low_power import LISTEN, SEND, TURNAROUND, joules, low_power, phases
from wsnsim.base.frames import full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.low_power_listening import ContikiMac, XMac

SECONDS, INTERVAL = 20.0, 0.125
CELLS = [(XMac, 3, 1.0), (XMac, 8, 1.0), (ContikiMac, 3, 1.0), (ContikiMac, 8, 2.0)]


def offered(senders, rate, seed):
    """For each sender the times (s) at which it offers a frame: a Poisson process."""
    generator = np.random.default_rng([20, seed])
    return [np.sort(generator.uniform(0.0, SECONDS - 2.0, generator.poisson(rate * (SECONDS - 2.0)))).tolist()
            for _ in range(senders)]  # fmt: skip


def network_of(mac, frames, seed):
    """(network, packets that arrived of each burst) after all frames."""
    points = [(0.0, 0.0), *((20.0 * np.cos(i), 20.0 * np.sin(i)) for i in range(len(frames)))]
    network, results = low_power(mac, points, seed=seed, horizon=SECONDS), []

    def offer(node):
        burst = full_burst(node, 0, Parcel("payload", 1, PACKET_BITS, "test"), 0)
        network.mac.send([burst]).callbacks.append(lambda _: results.append(burst.packets))

    for node, times in enumerate(frames, start=1):
        for time in times:
            network.at(time, lambda node=node: offer(node))
    network.env.run(until=SECONDS)
    network.nodes.close()
    assert network.ledger_adds_up()
    return network, results


def seconds_of(network):
    """(N, 2) s of sending and s of listening and receiving."""
    heard = ("idle", "rx", "overhear")
    return np.array([
        (joules(network, "tx_electronics", node) / SEND, sum(joules(network, cause, node) for cause in heard) / LISTEN)
        for node in range(network.nodes.size)
    ])  # fmt: skip


def plain_nodes(kind, frames, seed, **given):
    if kind is XMac:
        return plain_xmac.contention(frames, INTERVAL, SECONDS, seed, **given)
    return plain_contikimac.contention(frames, INTERVAL, SECONDS, seed, **{"locks": True} | given)


def plain_seconds(nodes):
    """The same of the plain simulation. While it turns from receiving to sending and back, a radio does not listen."""
    return np.array([(node.sent, node.on - node.sent - 2 * TURNAROUND * node.count) for node in nodes])


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [XMac, ContikiMac])
def test_without_contention_every_node_sends_and_listens_as_in_the_plain_simulation(kind):
    """One sender, one receiver, and two nodes that overhear them."""
    frames = [[0.3 + 1.37 * i for i in range(12)], [], []]
    given = {} if kind is XMac else {"phase_lock": False}
    for seed in range(2):
        network, results = network_of(kind(first_backoff=0.0, **given), frames, seed)
        choice = {} if kind is XMac else {"locks": False}
        nodes = plain_nodes(kind, frames, seed, phases=phases(network).tolist(), first=0.0, **choice)
        assert results == [1] * 12 and nodes[1].delivered == 12
        assert np.abs(seconds_of(network) - plain_seconds(nodes)).max() < 1e-9


def totals(kind, frames, seed):
    """((delivered, failed, s of sending, s of listening) of the network, the same of the plain simulation)."""
    network, results = network_of(kind(interval=INTERVAL), frames, seed)
    nodes = plain_nodes(kind, frames, seed)
    arrived, plainly = sum(results), sum(node.delivered for node in nodes)
    return (
        (arrived, len(results) - arrived, *seconds_of(network).sum(axis=0)),
        (plainly, sum(node.failed for node in nodes), *plain_seconds(nodes).sum(axis=0)),
    )


def compared(kind, senders, rate, runs):
    return np.array([totals(kind, offered(senders, rate, seed), seed) for seed in range(runs)], dtype=float)


def agree(pairs):
    """(4,) whether the means agree within the Monte Carlo error of 99.9 %, and 2 %."""
    difference, runs = pairs[:, 0] - pairs[:, 1], len(pairs)
    error = difference.std(axis=0, ddof=1) / np.sqrt(runs) * t.ppf(0.9995, runs - 1)
    return np.abs(difference.mean(axis=0)) <= error + 0.02 * pairs[:, 1].mean(axis=0) + 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "senders", "rate"), CELLS[::2])
def test_a_plain_simulation_of_contention_agrees(kind, senders, rate):
    assert agree(compared(kind, senders, rate, 4)).all()


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "senders", "rate"), CELLS)
def test_a_plain_simulation_of_contention_agrees_over_many_runs(kind, senders, rate):
    assert agree(compared(kind, senders, rate, 12)).all()
