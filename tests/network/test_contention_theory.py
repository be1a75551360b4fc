"""CSMA/CA compared with a renewal analysis, with an independent simulation, and with numbers computed by hand.

All n nodes are within range of each other. Each always has a frame with b bytes of payload to broadcast.

The analysis joins two published parts. The channel is a renewal process, as in Kleinrock and Tobagi (1975), "Packet
switching in radio channels, part I", IEEE Trans. Communications 23(12), nonpersistent CSMA: an idle period, a first
frame, the frames of other nodes that begin before they can sense it, and the busy time after the last one. The node
is a chain of backoff stages that finds the channel busy with the same probability at every stage, as in Bianchi
(2000), IEEE JSAC 18(3), here with the stages of IEEE 802.15.4-2006, 7.5.1.4. Their combination is ours:

    mean assessments per frame M(α) = 1 + α + ... + α⁴
    rate of a waiting node     λ = M / (S + Σ αⁱ (E[Wᵢ] B + C))
    start of the last frame    last = T − (1 − e^(−gT)) / g,  g = (n − 1) λ       after that of the first
    frames per busy period     1 + K,  K = (n − 1)(1 − e^(−λT))
    channel cycle              Z = 1 / (nλ) + T + last + A + C
    assessments found busy     β = λ (A + C + last) (n − 1 − K),  α = β / (β + 1 + K)

with slot B, assessment C, turnaround T, airtime A, spacing S. Frames without collision: e^(−gT) / Z per second; all
frames: (1 + K) / Z; dropped: α⁵ of all. A transmission cannot be sensed for T, because a node that found the channel
free starts to send only T later. The channel is busy for C after the end of a frame, because an assessment takes C.

Approximations: attempts are a Poisson process (in truth they lie on a lattice of 320 µs), and all nodes have the same
rate at all times, whatever their stage. If few frames collide, the error is a few per cent. With 20 nodes gT is near 1
and its spread matters: nodes wait in stages of 8 to 32 periods, and by Jensen's inequality the probability that no
other node begins is higher than at the mean rate. The analysis is then too low, by 3 to 10 %. The tolerances are 5 %
up to 10 nodes and 15 % at 20. The independent simulation must agree within the Monte Carlo error.
"""

from __future__ import annotations

import heapq
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chisquare

from tests.helpers.thorough import thorough
from tests.network.radio_network import RadioNetwork
from wsnsim.base.tables import CAUSE
from wsnsim.models.access import Csma
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import FirstOrder, States

SLOT, CCA, TURNAROUND, ACK, SIFS, LIFS = 320e-6, 128e-6, 192e-6, 88 / 250e3, 192e-6, 640e-6
STAGES = (8, 16, 32, 32, 32)
SECONDS = {2: 30, 5: 20, 10: 12, 20: 8}
FEW = [(2, 12), (10, 12), (5, 100), (20, 100)]
CELLS = [pytest.param(*cell, marks=() if cell in FEW else pytest.mark.thorough) for cell in product(SECONDS, (12, 100))]
PAIR = [(0, 0), (50, 0)]
AT_ONCE = Csma(min_be=0, max_be=0)
CC2420 = RadioSheet(
    name="CC2420", source="SWRS041", rate=250e3, receive=62e-3, listen=62e-3, levels=(0.0,), transmit=(57.42e-3,),
    sleep=1.4e-3, wake=0.194e-3, wake_power=62e-3, doze=0.05e-3, doze_power=1.4e-3, turnaround=TURNAROUND,
    turnaround_power=60e-3, sensitivity=-95.0, noise=-100.0,
)  # fmt: skip
PROCESSOR = ProcessorSheet(
    name="MSP430", source="SLAS368", rate=8e6, run=5.4e-3, idle=163.5e-6, sleep=15.3e-6, wake=6e-6
)


def airtime(payload):
    return (17 + payload) * 8 / 250e3


def ring(nodes):
    """Nodes on a circle of 30 m: all of them hear each other."""
    angles = 2 * np.pi * np.arange(nodes) / nodes
    return 30 * np.column_stack([np.cos(angles), np.sin(angles)])


def phases(nodes):
    """When nodes begin, in s: at random, since waits are multiples of 32 µs, and rounding would decide ties."""
    return np.random.default_rng(nodes).uniform(0.0, 0.01, nodes).tolist()


def saturated_network(nodes, seconds):
    """Nodes on a circle, with infinite batteries."""
    return RadioNetwork(ring(nodes), energy=FirstOrder(battery=float("inf")), horizon=seconds)


def saturate(network, nodes, payload, seconds):
    """(time, clean, collided, dropped) of every frame; each node always has another frame to send."""
    fates = []

    def offer(node):
        network.mac.offer(node, 8 * payload, lambda received: ended(node, received))

    def ended(node, received):
        clean = received is not None and len(received) == nodes - 1
        fates.append((network.env.now, clean, received is not None and not clean, received is None))
        offer(node)

    for node, phase in enumerate(phases(nodes)):
        network.at(phase, lambda node=node: offer(node))
    network.env.run(until=seconds)
    return np.array(fates, dtype=float)


def per_second(fates, seconds):
    """(seconds - 1, 3) frames that were clean, collided or dropped in each second after the first."""
    edges = np.arange(1, seconds + 1)
    return np.column_stack([np.histogram(fates[:, 0], edges, weights=fates[:, 1 + i])[0] for i in range(3)])


@cache
def ours(nodes, payload):
    network = saturated_network(nodes, SECONDS[nodes])
    return per_second(saturate(network, nodes, payload, SECONDS[nodes]), SECONDS[nodes])


def independent_simulation(nodes, payload, seconds, rng):
    """The protocol implemented independently, with a heap: (time, clean, collided, dropped) of every frame."""
    fates, air, stage = [], [], [0] * nodes
    assessments = [(at + CCA + SLOT * int(rng.integers(STAGES[0])), node) for node, at in enumerate(phases(nodes))]
    heapq.heapify(assessments)
    while assessments[0][0] < seconds:
        now, node = heapq.heappop(assessments)
        air = [frame for frame in air if frame[1] > now - CCA]
        wait = now
        if any(start < now for start, _, _ in air):
            stage[node] += 1
            if stage[node] == len(STAGES):
                fates.append([now, 0, 0, 1])
                stage[node], wait = 0, now + LIFS
        else:
            start = now + TURNAROUND
            end = start + airtime(payload)
            fate = [end, 1, 0, 0]
            for _, until, other in air:
                if until > start:
                    fate[1:3] = other[1:3] = 0, 1
            air.append((start, end, fate))
            fates.append(fate)
            stage[node], wait = 0, end + LIFS
        heapq.heappush(assessments, (wait + CCA + SLOT * int(rng.integers(STAGES[stage[node]])), node))
    return np.array(fates, dtype=float)


def cycle(nodes, rate, frame, assessment):
    """(frames/s without collision, frames per busy period, `last`, Z) of a channel that n nodes assess at a rate."""
    others = (nodes - 1) * rate
    last = TURNAROUND + np.expm1(-others * TURNAROUND) / others
    frames = 1 - (nodes - 1) * np.expm1(-rate * TURNAROUND)
    length = 1 / (nodes * rate) + TURNAROUND + last + frame + assessment
    return np.exp(-others * TURNAROUND) / length, frames, last, length


def analysis(nodes, payload):
    """(frames/s without collision, all frames/s, share dropped): the fixed point of the analysis."""
    frame, means = airtime(payload), (np.array(STAGES) - 1) / 2

    def at(busy):
        powers = busy ** np.arange(5)
        rate = powers.sum() / (LIFS + powers @ (means * SLOT + CCA))
        return rate, cycle(nodes, rate, frame, CCA)

    def excess(busy):
        rate, (_, frames, last, _) = at(busy)
        refused = rate * (frame + CCA + last) * (nodes - frames)
        return refused / (refused + frames) - busy

    busy = brentq(excess, 1e-9, 1 - 1e-9)
    _, (clean, frames, _, length) = at(busy)
    return clean, frames / length, busy**5


def test_the_analysis_is_kleinrock_and_tobagis_for_many_nodes_that_assess_in_no_time():
    """S = G e^(-aG) / (G (1 + 2a) + e^(-aG)), time in frames; a transmission cannot be sensed for the time a."""
    frame = airtime(12)
    a = TURNAROUND / frame
    for offered in (0.1, 1.0, 5.0):
        clean = cycle(10**7, offered / frame / 10**7, frame, 0.0)[0]
        blind = np.exp(-a * offered)
        assert clean * frame == pytest.approx(offered * blind / (offered * (1 + 2 * a) + blind), rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize(("nodes", "payload"), CELLS)
def test_saturated_throughput_is_what_the_renewal_analysis_says(nodes, payload):
    clean, spoilt, given_up = ours(nodes, payload).mean(axis=0)
    expected, sent, share = analysis(nodes, payload)
    assert clean == pytest.approx(expected, rel=0.05 if nodes <= 10 else 0.15)
    assert clean + spoilt == pytest.approx(sent, rel=0.05 if nodes <= 10 else 0.10)
    assert given_up / (clean + spoilt + given_up) == pytest.approx(share, abs=0.035)


@pytest.mark.thorough
@pytest.mark.parametrize(("nodes", "payload"), CELLS)
def test_saturated_throughput_is_that_of_a_second_simulation_within_monte_carlo_error(nodes, payload):
    """Means over seconds differ by less than 4 standard errors; seconds are almost independent of each other."""
    seconds = SECONDS[nodes]
    found = ours(nodes, payload)
    again = per_second(independent_simulation(nodes, payload, seconds, np.random.default_rng(nodes * payload)), seconds)
    for one, other in zip(found.T, again.T, strict=True):
        error = np.sqrt((one.var(ddof=1) + other.var(ddof=1)) / (seconds - 1))
        assert abs(one.mean() - other.mean()) < 4 * error
        assert error < 0.05 * max(one.mean(), 200), "enough frames for the comparison to mean something"


@pytest.mark.thorough
@pytest.mark.parametrize("payload", [100, *thorough([12])])
def test_payload_throughput_rises_with_neither_nodes_nor_beyond_one_frame_at_a_time(payload):
    clean = [ours(nodes, payload)[:, 0].mean() for nodes in (5, 10, 20)]
    assert clean == sorted(clean, reverse=True)
    assert max(clean) * (airtime(payload) + TURNAROUND + CCA) < 1, "a frame, and what goes before it"


@pytest.mark.thorough(fast=["100"])
@pytest.mark.parametrize("payload", [12, 100])
def test_a_lone_saturated_sender_sends_one_frame_per_mean_backoff(payload):
    network = saturated_network(1, 30.0)
    sent = len(saturate(network, 1, payload, 30.0))
    mean = 3.5 * SLOT + CCA + TURNAROUND + airtime(payload) + LIFS
    spread = SLOT * np.sqrt((64 - 1) / 12)
    assert abs(sent * mean / 30.0 - 1) < 4 * spread / mean / np.sqrt(sent)


@pytest.mark.thorough
def test_frames_on_the_air_begin_after_a_free_channel_or_together_and_are_lost_when_they_overlap():
    nodes, payload = 8, 12
    network = saturated_network(nodes, 5.0)
    fates = saturate(network, nodes, payload, 5.0)
    ends = np.array([row["time"] for row in network.rows("send")])
    starts = ends - airtime(payload)
    groups = [[0]]
    for i in range(1, len(ends)):
        if starts[i] < ends[groups[-1][-1]]:
            groups[-1].append(i)
        else:
            groups.append([i])
    assert len(groups) > 1000 and max(map(len, groups)) > 2
    assert all(starts[group[-1]] - starts[group[0]] <= TURNAROUND + 1e-12 for group in groups)
    silences = [starts[after[0]] - ends[before[-1]] for before, after in pairwise(groups)]
    assert min(silences) >= CCA + TURNAROUND - 1e-12
    assert sum(len(group) == 1 for group in groups) == fates[:, 1].sum()
    taken = sum(ends[group[-1]] - starts[group[0]] for group in groups)
    assert taken + sum(silences) <= 5.0 and len(ends) * airtime(payload) > taken


@pytest.mark.thorough
def test_the_first_backoff_is_uniform_over_eight_periods():
    network = saturated_network(1, 12.0)
    saturate(network, 1, 12, 12.0)
    gaps = np.diff([row["time"] for row in network.rows("send")]) - (LIFS + CCA + TURNAROUND + airtime(12))
    slots = np.round(gaps / SLOT)
    assert gaps == pytest.approx(slots * SLOT, abs=1e-9)
    counts = np.bincount(slots.astype(int))
    assert len(counts) == 8 and chisquare(counts).pvalue > 1e-3


@pytest.mark.thorough
def test_the_range_of_the_backoff_doubles_to_thirty_two_periods_while_the_channel_is_busy():
    network, times = saturated_network(1, 60.0), []
    network.mac.channel.is_busy = lambda node: bool(times.append(network.env.now)) or True
    fates = saturate(network, 1, 12, 60.0)
    frames = len(fates)
    assert fates[:, 3].all() and network.counters.access_failures == frames > 2000
    assessed = np.array(times[: 5 * frames]).reshape(frames, 5)
    before = np.column_stack([np.concatenate([phases(1), assessed[:-1, -1] + LIFS]), assessed[:, :-1]])
    slots = np.round((assessed - before - CCA) / SLOT).astype(int)
    assert assessed == pytest.approx(before + CCA + slots * SLOT, abs=1e-9)
    for column, stage in zip(slots.T, STAGES, strict=True):
        counts = np.bincount(column)
        assert len(counts) == stage and chisquare(counts).pvalue > 1e-3
    assert abs(np.corrcoef(slots.T) - np.eye(5)).max() < 4 / np.sqrt(frames), "stages are drawn apart"


@pytest.mark.parametrize(("payload", "spacing"), [(7, SIFS), (8, LIFS), (12, LIFS), (116, LIFS)])
@pytest.mark.parametrize("acks", [False, True])
def test_without_backoff_frames_follow_each_other_by_the_clock(payload, spacing, acks):
    network = RadioNetwork(PAIR, mac=Csma(min_be=0, max_be=0, acks=acks))
    network.unicast(0, 1, packets=4, bits=8 * payload)
    ends = [row["time"] for row in network.rows("send") if row["node"] == 0]
    first = CCA + TURNAROUND + airtime(payload)
    answer = TURNAROUND + ACK if acks else 0.0
    assert ends == pytest.approx([first + i * (first + answer + spacing) for i in range(4)], abs=1e-12)
    assert network.env.now == pytest.approx(ends[-1] + answer, abs=1e-12)


def exchange(energy):
    """The nodes after one second, in which a frame of 12 bytes and its acknowledgement crossed 50 m."""
    network = RadioNetwork(PAIR, mac=AT_ONCE, energy=energy, horizon=1.0)
    assert network.unicast(0, 1).packets == 1
    network.env.run(until=1.0)
    network.nodes.close()
    assert network.ledger_adds_up()
    return network.nodes


def test_an_acknowledged_frame_costs_both_its_nodes_what_the_first_order_model_says():
    nodes = exchange(FirstOrder())
    send, receive = 50e-9 + 100e-12 * 50**2, 50e-9
    assert nodes.ledger.spent == pytest.approx([232 * send + 88 * receive, 232 * receive + 88 * send], rel=1e-12)


def test_an_acknowledged_frame_costs_both_its_nodes_what_the_datasheet_says():
    nodes = exchange(States(radio=CC2420, processor=PROCESSOR))
    frame = airtime(12)
    expected = {
        "tx_electronics": [57.42e-3 * frame, 57.42e-3 * ACK],
        "rx": [62e-3 * ACK, 62e-3 * frame],
        "switch": [2 * 60e-3 * TURNAROUND] * 2,
        "sleep": [15.3e-6] * 2,
    }
    for cause, joules in expected.items():
        assert nodes.ledger.joules[CAUSE[cause]] == pytest.approx(joules, rel=1e-12)
    rest = nodes.ledger.joules[CAUSE["idle"]] / 62e-3
    assert rest == pytest.approx([1 - frame - ACK] * 2, abs=3 * TURNAROUND)


def test_a_radio_does_not_listen_during_its_turnaround():
    nodes = exchange(States(radio=CC2420, processor=PROCESSOR))
    rest = 1 - airtime(12) - ACK - 2 * TURNAROUND
    assert nodes.ledger.joules[CAUSE["idle"]] == pytest.approx([62e-3 * rest] * 2, rel=1e-12)
