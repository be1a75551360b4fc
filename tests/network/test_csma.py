"""CSMA/CA: acknowledgements, retransmissions, channel-access failures, crashes; fragmentation of bursts."""

import itertools

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import EVERYONE
from wsnsim.base.requests import PACKET_BITS
from wsnsim.models.access import Csma
from wsnsim.models.hardware import Frames
from wsnsim.models.links import Disk

AIRTIME, ACK, TURNAROUND, UNIT, CCA = 29 * 8 / 250e3, 11 * 8 / 250e3, 192e-6, 320e-6, 128e-6
PAIR = [(0, 0), (50, 0)]


def test_a_unicast_is_acknowledged_and_takes_backoff_assessment_airtime_and_acknowledgement():
    network = RadioNetwork(PAIR)
    burst = network.unicast(0, 1)
    assert burst.packets == 1 and burst.mask.all() and burst.sent == 29 * 8
    slots = (network.env.now - (CCA + TURNAROUND + AIRTIME + TURNAROUND + ACK)) / UNIT
    assert slots == pytest.approx(round(slots), abs=1e-6) and 0 <= round(slots) <= 7
    sends = network.rows("send")
    assert [row["node"] for row in sends] == [0, 1], "the frame, and its acknowledgement"
    assert sends[1]["bits"] == 88 and sends[1]["packets"] == 0
    assert (network.counters.frames_sent, network.counters.transmissions) == (1, 2)
    assert network.ledger_adds_up()


def test_a_frame_without_acknowledgement_is_sent_four_times_and_then_lost():
    network = RadioNetwork(PAIR, link=Disk(reach=75.0))
    network.nodes.living[1] = network.nodes.all_listen = False
    burst = network.unicast(0, 1)
    assert burst.packets == 0 and not burst.mask.any()
    assert len(network.rows("send")) == 4 and network.counters.retries == 3
    assert burst.sent == 4 * 29 * 8
    times = [row["time"] for row in network.rows("send")]
    waits = (np.diff(times) - 864e-6 - CCA - TURNAROUND - AIRTIME) / UNIT
    assert waits == pytest.approx(np.round(waits), abs=1e-6), "the wait for an answer, then a new backoff"


def test_a_frame_whose_acknowledgement_is_lost_has_arrived():
    network = RadioNetwork(PAIR)
    original = network.mac.channel.transmit

    def only_data(source, frame, on_end, asleep=None):
        if frame.packets == 0:
            network.nodes.jammed[0] = network.nodes.disturbed = True
        else:
            network.nodes.jammed[0] = network.nodes.disturbed = False
        return original(source, frame, on_end, asleep)

    network.mac.channel.transmit = only_data
    network.mac.channel.is_busy = lambda node: False
    burst = network.unicast(0, 1)
    assert burst.packets == 1, "its receiver has it; the sender tried again because it does not know"
    assert network.counters.retries == 3


def test_a_node_drops_a_frame_if_the_channel_is_always_busy():
    network = RadioNetwork(PAIR)
    network.nodes.jammed[0] = network.nodes.disturbed = True
    burst = network.unicast(0, 1)
    assert burst.packets == 0 and burst.sent == 0 and network.counters.access_failures == 1
    (drop,) = network.rows("drop")
    assert network.memory.words.all()[int(drop["what"])] == "no_channel"
    longest = 5 * CCA + (7 + 15 + 31 + 31 + 31) * UNIT
    assert network.env.now <= longest


def test_a_burst_has_one_frame_per_packet_and_fewer_with_packing():
    network = RadioNetwork(PAIR)
    assert network.unicast(0, 1, packets=20).packets == 20
    assert network.counters.frames_sent == 20
    packed = RadioNetwork(PAIR, packing=Frames())
    burst = packed.unicast(0, 1, packets=20)
    assert burst.packets == 20 and packed.counters.frames_sent == 3, "nine packets of 12 bytes fit 116 bytes"
    assert burst.sent == 8 * (3 * 17 + 20 * 12)
    assert packed.env.now < network.env.now / 3


def test_a_packet_longer_than_a_frame_is_fragmented_and_needs_all_its_fragments():
    network = RadioNetwork(PAIR)
    burst = network.unicast(0, 1, packets=2, bits=2000)
    assert burst.packets == 2 and network.counters.frames_sent == 6, "928 + 928 + 144 bits, twice"
    lossy = RadioNetwork(PAIR, link=Disk(reach=75.0, loss=0.3), mac=Csma(acks=False))
    outcomes = [lossy.unicast(0, 1, packets=2, bits=2000).mask.mean() for _ in range(200)]
    assert np.mean(outcomes) == pytest.approx(0.7**3, abs=0.06)


def test_a_broadcast_of_several_frames_has_one_mask_per_receiver():
    network = RadioNetwork([(0, 0), (50, 0), (-50, 0)], link=Disk(reach=75.0, loss=0.4))
    burst = network.broadcast(0, packets=30)
    masks = np.array([burst.received[node] for node in (1, 2)])
    assert masks.shape == (2, 30) and not np.array_equal(masks[0], masks[1])
    received = {node: sum(row["node"] == node for row in network.rows("receive")) for node in (1, 2)}
    assert [mask.sum() for mask in masks] == [received[1], received[2]]


def test_a_node_that_crashes_loses_its_queue_and_its_bursts_end():
    network = RadioNetwork(PAIR)
    network.at(5e-3, lambda: network.nodes.crash(0))
    network.at(5e-3, lambda: network.mac.silence(0))
    burst = network.unicast(0, 1, packets=50)
    assert network.env.now == pytest.approx(5e-3) and 0 < burst.packets < 10
    network.nodes.restart(0, network.env.now)
    assert network.unicast(0, 1).packets == 1, "after a restart it sends again"


def test_a_dead_sender_sends_nothing_and_the_event_still_fires():
    network = RadioNetwork(PAIR)
    network.nodes.crash(0)
    assert network.unicast(0, 1).packets == 0 and network.broadcast(0).received == {}
    assert network.rows("send") == []


def test_frames_of_one_sender_are_spaced_and_keep_their_order():
    network = RadioNetwork(PAIR, mac=Csma(acks=False))
    network.unicast(0, 1, packets=5)
    ends = [row["time"] for row in network.rows("send")]
    gaps = np.diff(ends) - AIRTIME
    assert (gaps >= 640e-6 + CCA + TURNAROUND - 1e-12).all(), "LIFS after a PSDU of 23 bytes"


def test_a_burst_without_packets_ends_at_once():
    network = RadioNetwork(PAIR)
    burst = network.unicast(0, 1)
    burst.lose()
    network.env.run(until=network.mac.send([burst]))
    network.env.run(until=network.mac.send([]))
    assert len(network.rows("send")) == 2


def test_the_backoffs_of_a_node_do_not_depend_on_other_senders():
    alone, together = RadioNetwork([*PAIR, (500, 0), (550, 0)]), RadioNetwork([*PAIR, (500, 0), (550, 0)])
    together.at(1e-4, lambda: together.mac.offer(2, PACKET_BITS, lambda received: None))
    assert alone.unicast(0, 1).packets == together.unicast(0, 1).packets == 1
    assert alone.env.now == together.env.now


def test_the_result_of_an_offered_payload_is_its_receivers_or_none_without_a_channel():
    network = RadioNetwork([(0, 0), (50, 0), (60, 0)])
    results = []
    network.mac.offer(0, PACKET_BITS, lambda received: results.append(received.tolist()))
    network.env.run(until=1.0)
    network.nodes.jammed[0] = network.nodes.disturbed = True
    network.mac.offer(0, PACKET_BITS, results.append)
    network.env.run(until=2.0)
    assert results == [[1, 2], None]
    assert network.rows("send")[0]["peer"] == EVERYONE


def test_backoffs_depend_on_node_and_step_and_not_on_earlier_steps():
    ends = []
    for early in (False, True):
        network = RadioNetwork(PAIR)
        if early:
            network.unicast(0, 1)
        network.env.run(until=1.0)
        network.log.step = 7
        network.unicast(0, 1)
        ends.append(network.env.now)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


def test_a_radio_that_is_sending_neither_acknowledges_nor_sends_another_frame():
    network = RadioNetwork([(0, 0), (50, 0), (100, 0)])
    sending = network.mac.channel._sending
    network.at(1e-3, lambda: network.mac.offer(1, 800, lambda received: None))
    network.unicast(0, 1, packets=5)
    network.unicast(2, 1, packets=5)
    rows = sorted((row["time"] - row["bits"] / 250e3, row["time"], row["node"]) for row in network.rows("send"))
    for node in range(3):
        mine = [(began, ended) for began, ended, who in rows if who == node]
        assert all(later[0] >= before[1] - 1e-12 for before, later in itertools.pairwise(mine))
    assert not sending
