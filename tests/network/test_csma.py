"""Access by contention: acknowledgements, repetitions, giving up, falling silent; bursts cut into frames."""

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


def test_a_unicast_is_acknowledged_and_takes_backoff_assessment_airtime_and_answer():
    network = RadioNetwork(PAIR)
    frame = network.unicast(0, 1)
    assert frame.packets == 1 and frame.mask.all() and frame.sent == 29 * 8
    slots = (network.env.now - (CCA + TURNAROUND + AIRTIME + TURNAROUND + ACK)) / UNIT
    assert slots == pytest.approx(round(slots), abs=1e-6) and 0 <= round(slots) <= 7
    sends = network.rows("send")
    assert [row["node"] for row in sends] == [0, 1], "the frame, and its acknowledgement"
    assert sends[1]["bits"] == 88 and sends[1]["packets"] == 0
    assert (network.counters.frames_sent, network.counters.transmissions) == (1, 2)
    assert network.ledger_adds_up()


def test_a_frame_is_sent_four_times_in_vain_and_then_lost():
    network = RadioNetwork(PAIR, link=Disk(reach=75.0))
    network.nodes.living[1] = network.nodes.all_listen = False
    frame = network.unicast(0, 1)
    assert frame.packets == 0 and not frame.mask.any()
    assert len(network.rows("send")) == 4 and network.counters.retries == 3
    assert frame.sent == 4 * 29 * 8
    times = [row["time"] for row in network.rows("send")]
    waits = (np.diff(times) - 864e-6 - CCA - TURNAROUND - AIRTIME) / UNIT
    assert waits == pytest.approx(np.round(waits), abs=1e-6), "the wait for an answer, then a new backoff"


def test_a_frame_whose_acknowledgement_is_lost_has_arrived_all_the_same():
    network = RadioNetwork(PAIR)
    network.at(1e-9, lambda: None)
    original = network.mac.channel.transmit

    def only_data(source, frame, ended, asleep=None):
        if frame.packets == 0:
            network.nodes.jammed[0] = network.nodes.disturbed = True
        else:
            network.nodes.jammed[0] = network.nodes.disturbed = False
        return original(source, frame, ended, asleep)

    network.mac.channel.transmit = only_data
    network.mac.channel.is_busy = lambda node: False
    frame = network.unicast(0, 1)
    assert frame.packets == 1, "its receiver has it; the sender tried in vain to learn of it"
    assert network.counters.retries == 3


def test_a_node_gives_up_a_channel_that_is_never_free():
    network = RadioNetwork(PAIR)
    network.nodes.jammed[0] = network.nodes.disturbed = True
    frame = network.unicast(0, 1)
    assert frame.packets == 0 and frame.sent == 0 and network.counters.access_failures == 1
    (drop,) = network.rows("drop")
    assert network.memory.words.all()[int(drop["what"])] == "no_channel"
    longest = 5 * CCA + (7 + 15 + 31 + 31 + 31) * UNIT
    assert network.env.now <= longest


def test_a_burst_is_as_many_frames_as_packets_and_fewer_where_packets_are_packed():
    network = RadioNetwork(PAIR)
    assert network.unicast(0, 1, packets=20).packets == 20
    assert network.counters.frames_sent == 20
    packed = RadioNetwork(PAIR, packing=Frames())
    frame = packed.unicast(0, 1, packets=20)
    assert frame.packets == 20 and packed.counters.frames_sent == 3, "nine packets of 12 bytes fit 116 bytes"
    assert frame.sent == 8 * (3 * 17 + 20 * 12)
    assert packed.env.now < network.env.now / 3


def test_a_packet_that_fits_no_frame_is_sent_in_parts_and_arrives_only_whole():
    network = RadioNetwork(PAIR)
    frame = network.unicast(0, 1, packets=2, bits=2000)
    assert frame.packets == 2 and network.counters.frames_sent == 6, "928 + 928 + 144 bits, twice"
    lossy = RadioNetwork(PAIR, link=Disk(reach=75.0, loss=0.3), mac=Csma(acks=False))
    outcomes = [lossy.unicast(0, 1, packets=2, bits=2000).mask.mean() for _ in range(200)]
    assert np.mean(outcomes) == pytest.approx(0.7**3, abs=0.06)


def test_a_broadcast_of_several_frames_tells_each_listener_which_packets_it_has():
    network = RadioNetwork([(0, 0), (50, 0), (-50, 0)], link=Disk(reach=75.0, loss=0.4))
    frame = network.broadcast(0, packets=30)
    masks = np.array([frame.received[node] for node in (1, 2)])
    assert masks.shape == (2, 30) and not np.array_equal(masks[0], masks[1])
    received = {node: sum(row["node"] == node for row in network.rows("receive")) for node in (1, 2)}
    assert [mask.sum() for mask in masks] == [received[1], received[2]]


def test_a_node_that_falls_silent_loses_what_it_had_to_send_and_nobody_waits_for_it():
    network = RadioNetwork(PAIR)
    network.at(5e-3, lambda: network.nodes.crash(0))
    network.at(5e-3, lambda: network.mac.silence(0))
    frame = network.unicast(0, 1, packets=50)
    assert network.env.now == pytest.approx(5e-3) and 0 < frame.packets < 10
    network.nodes.restart(0)
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
    frame = network.unicast(0, 1)
    frame.mask, frame.packets = np.zeros(1, dtype=bool), 0
    network.env.run(until=network.mac.send([frame]))
    network.env.run(until=network.mac.send([]))
    assert len(network.rows("send")) == 2


def test_what_a_node_draws_does_not_depend_on_who_else_sends():
    alone, together = RadioNetwork([*PAIR, (500, 0), (550, 0)]), RadioNetwork([*PAIR, (500, 0), (550, 0)])
    together.at(1e-4, lambda: together.mac.offer(2, PACKET_BITS, lambda heard: None))
    assert alone.unicast(0, 1).packets == together.unicast(0, 1).packets == 1
    assert alone.env.now == together.env.now


def test_an_offered_payload_is_told_who_heard_it_or_that_it_never_got_the_channel():
    network = RadioNetwork([(0, 0), (50, 0), (60, 0)])
    told = []
    network.mac.offer(0, PACKET_BITS, lambda heard: told.append(heard.tolist()))
    network.env.run(until=1.0)
    network.nodes.jammed[0] = network.nodes.disturbed = True
    network.mac.offer(0, PACKET_BITS, told.append)
    network.env.run(until=2.0)
    assert told == [[1, 2], None]
    assert network.rows("send")[0]["peer"] == EVERYONE


def test_backoffs_are_of_the_node_and_the_step_and_not_of_what_it_sent_before():
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
    network.at(1e-3, lambda: network.mac.offer(1, 800, lambda heard: None))
    network.unicast(0, 1, packets=5)
    network.unicast(2, 1, packets=5)
    rows = sorted((row["time"] - row["bits"] / 250e3, row["time"], row["node"]) for row in network.rows("send"))
    for node in range(3):
        mine = [(began, ended) for began, ended, who in rows if who == node]
        assert all(later[0] >= before[1] - 1e-12 for before, later in itertools.pairwise(mine))
    assert not sending
