"""Access by contention: acknowledgements, repetitions, giving up, falling silent; bursts cut into frames."""

import itertools

import numpy as np
import pytest

from tests.network.places import Place
from wsnsim.base.requests import PACKET_BITS
from wsnsim.models.access import Csma
from wsnsim.models.hardware import Frames
from wsnsim.models.links import Disk
from wsnsim.network.radio.ideal_medium import EVERYONE

AIRTIME, ACK, TURNAROUND, UNIT, CCA = 29 * 8 / 250e3, 11 * 8 / 250e3, 192e-6, 320e-6, 128e-6
PAIR = [(0, 0), (50, 0)]


def test_a_unicast_is_acknowledged_and_takes_backoff_assessment_airtime_and_answer():
    place = Place(PAIR)
    frame = place.unicast(0, 1)
    assert frame.packets == 1 and frame.mask.all() and frame.sent == 29 * 8
    slots = (place.env.now - (CCA + TURNAROUND + AIRTIME + TURNAROUND + ACK)) / UNIT
    assert slots == pytest.approx(round(slots), abs=1e-6) and 0 <= round(slots) <= 7
    sends = place.rows("send")
    assert [row["node"] for row in sends] == [0, 1], "the frame, and its acknowledgement"
    assert sends[1]["bits"] == 88 and sends[1]["packets"] == 0
    assert (place.mac.counts.frames_sent, place.mac.counts.numbers) == (1, 2)
    assert place.closes()


def test_a_frame_is_sent_four_times_in_vain_and_then_lost():
    place = Place(PAIR, link=Disk(reach=75.0))
    place.fleet.living[1] = place.fleet.all_listen = False
    frame = place.unicast(0, 1)
    assert frame.packets == 0 and not frame.mask.any()
    assert len(place.rows("send")) == 4 and place.mac.counts.retries == 3
    assert frame.sent == 4 * 29 * 8
    times = [row["time"] for row in place.rows("send")]
    waits = (np.diff(times) - 864e-6 - CCA - TURNAROUND - AIRTIME) / UNIT
    assert waits == pytest.approx(np.round(waits), abs=1e-6), "the wait for an answer, then a new backoff"


def test_a_frame_whose_acknowledgement_is_lost_has_arrived_all_the_same():
    place = Place(PAIR)
    place.at(1e-9, lambda: None)
    original = place.mac._channel.transmit

    def only_data(source, message, owner, landed, asleep=None):
        if message.packets == 0:
            place.fleet.jammed[0] = place.fleet.disturbed = True
        else:
            place.fleet.jammed[0] = place.fleet.disturbed = False
        return original(source, message, owner, landed, asleep)

    place.mac._channel.transmit = only_data
    place.mac._channel.is_busy = lambda node: False
    frame = place.unicast(0, 1)
    assert frame.packets == 1, "its receiver has it; the sender tried in vain to learn of it"
    assert place.mac.counts.retries == 3


def test_a_node_gives_up_a_channel_that_is_never_free():
    place = Place(PAIR)
    place.fleet.jammed[0] = place.fleet.disturbed = True
    frame = place.unicast(0, 1)
    assert frame.packets == 0 and frame.sent == 0 and place.mac.counts.access_failures == 1
    (drop,) = place.rows("drop")
    assert place.memory.words.all()[int(drop["what"])] == "no_channel"
    longest = 5 * CCA + (7 + 15 + 31 + 31 + 31) * UNIT
    assert place.env.now <= longest


def test_a_burst_is_as_many_frames_as_packets_and_fewer_where_packets_are_packed():
    place = Place(PAIR)
    assert place.unicast(0, 1, packets=20).packets == 20
    assert place.mac.counts.frames_sent == 20
    packed = Place(PAIR, packing=Frames())
    frame = packed.unicast(0, 1, packets=20)
    assert frame.packets == 20 and packed.mac.counts.frames_sent == 3, "nine packets of 12 bytes fit 116 bytes"
    assert frame.sent == 8 * (3 * 17 + 20 * 12)
    assert packed.env.now < place.env.now / 3


def test_a_packet_that_fits_no_frame_is_sent_in_parts_and_arrives_only_whole():
    place = Place(PAIR)
    frame = place.unicast(0, 1, packets=2, bits=2000)
    assert frame.packets == 2 and place.mac.counts.frames_sent == 6, "928 + 928 + 144 bits, twice"
    lossy = Place(PAIR, link=Disk(reach=75.0, loss=0.3), mac=Csma(acks=False))
    outcomes = [lossy.unicast(0, 1, packets=2, bits=2000).mask.mean() for _ in range(200)]
    assert np.mean(outcomes) == pytest.approx(0.7**3, abs=0.06)


def test_a_broadcast_of_several_frames_tells_each_listener_which_packets_it_has():
    place = Place([(0, 0), (50, 0), (-50, 0)], link=Disk(reach=75.0, loss=0.4))
    frame = place.broadcast(0, packets=30)
    masks = np.array([frame.heard[node] for node in (1, 2)])
    assert masks.shape == (2, 30) and not np.array_equal(masks[0], masks[1])
    received = {node: sum(row["node"] == node for row in place.rows("receive")) for node in (1, 2)}
    assert [mask.sum() for mask in masks] == [received[1], received[2]]


def test_a_node_that_falls_silent_loses_what_it_had_to_send_and_nobody_waits_for_it():
    place = Place(PAIR)
    place.at(5e-3, lambda: place.fleet.crash(0))
    place.at(5e-3, lambda: place.mac.silence(0))
    frame = place.unicast(0, 1, packets=50)
    assert place.env.now == pytest.approx(5e-3) and 0 < frame.packets < 10
    place.fleet.restart(0)
    assert place.unicast(0, 1).packets == 1, "after a restart it sends again"


def test_a_dead_sender_sends_nothing_and_the_event_still_fires():
    place = Place(PAIR)
    place.fleet.crash(0)
    assert place.unicast(0, 1).packets == 0 and place.broadcast(0).heard == {}
    assert place.rows("send") == []


def test_frames_of_one_sender_are_spaced_and_keep_their_order():
    place = Place(PAIR, mac=Csma(acks=False))
    place.unicast(0, 1, packets=5)
    ends = [row["time"] for row in place.rows("send")]
    gaps = np.diff(ends) - AIRTIME
    assert (gaps >= 640e-6 + CCA + TURNAROUND - 1e-12).all(), "LIFS after a PSDU of 23 bytes"


def test_a_burst_without_packets_ends_at_once():
    place = Place(PAIR)
    frame = place.unicast(0, 1)
    frame.mask, frame.packets = np.zeros(1, dtype=bool), 0
    place.env.run(until=place.mac.send([frame]))
    place.env.run(until=place.mac.send([]))
    assert len(place.rows("send")) == 2


def test_what_a_node_draws_does_not_depend_on_who_else_sends():
    alone, together = Place([*PAIR, (500, 0), (550, 0)]), Place([*PAIR, (500, 0), (550, 0)])
    together.at(1e-4, lambda: together.mac.offer(2, PACKET_BITS, lambda heard: None))
    assert alone.unicast(0, 1).packets == together.unicast(0, 1).packets == 1
    assert alone.env.now == together.env.now


def test_an_offered_payload_is_told_who_heard_it_or_that_it_never_got_the_channel():
    place = Place([(0, 0), (50, 0), (60, 0)])
    told = []
    place.mac.offer(0, PACKET_BITS, lambda heard: told.append(heard.tolist()))
    place.env.run(until=1.0)
    place.fleet.jammed[0] = place.fleet.disturbed = True
    place.mac.offer(0, PACKET_BITS, told.append)
    place.env.run(until=2.0)
    assert told == [[1, 2], None]
    assert place.rows("send")[0]["peer"] == EVERYONE


def test_backoffs_are_of_the_node_and_the_step_and_not_of_what_it_sent_before():
    ends = []
    for early in (False, True):
        place = Place(PAIR)
        if early:
            place.unicast(0, 1)
        place.env.run(until=1.0)
        place.journal.step = 7
        place.unicast(0, 1)
        ends.append(place.env.now)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


def test_a_radio_that_is_sending_neither_acknowledges_nor_sends_another_frame():
    place = Place([(0, 0), (50, 0), (100, 0)])
    sending = place.mac._channel._sending
    place.at(1e-3, lambda: place.mac.offer(1, 800, lambda heard: None))
    place.unicast(0, 1, packets=5)
    place.unicast(2, 1, packets=5)
    rows = sorted((row["time"] - row["bits"] / 250e3, row["time"], row["node"]) for row in place.rows("send"))
    for node in range(3):
        mine = [(began, ended) for began, ended, who in rows if who == node]
        assert all(later[0] >= before[1] - 1e-12 for before, later in itertools.pairwise(mine))
    assert not sending
