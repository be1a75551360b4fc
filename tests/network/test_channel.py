"""The air when it takes time: every figure here is counted by hand from the lengths of frames."""

import numpy as np
import pytest

from tests.network.places import Place
from wsnsim.base.tables import CAUSE
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk, LogNormal
from wsnsim.network.radio.ideal_medium import EVERYONE
from wsnsim.network.radio.transmission import MacFrame

AIRTIME = 29 * 8 / 250e3
TURNAROUND = 192e-6
BITS = 29 * 8
RX = BITS * 50e-9


class Tape:
    """Puts frames on the air at given times, and keeps who heard them."""

    def __init__(self, place, *frames):
        self.place = place
        self.channel = place.mac._channel
        self.heard = {}
        for number, (time, source, to) in enumerate(frames):
            place.at(time, lambda source=source, to=to, number=number: self._send(source, to, number))

    def _send(self, source, to, number):
        self.channel.transmit(source, MacFrame(to, BITS), number, self._landed)

    def _landed(self, one, heard):
        self.heard[one.owner] = heard.tolist() if one.message.to == EVERYONE else heard


def play(place, *frames, until=1.0):
    tape = Tape(place, *frames)
    place.env.run(until=until)
    return tape


LINE = [(0, 0), (50, 0), (100, 0), (150, 0)]


def test_a_frame_takes_turnaround_and_airtime_and_is_heard_within_reach():
    place = Place(LINE)
    tape = play(place, (0.5, 1, EVERYONE))
    assert tape.heard == {0: [0, 2]}
    (sent,) = place.rows("send")
    assert sent["time"] == pytest.approx(0.5 + TURNAROUND + AIRTIME, abs=1e-12)
    assert sent["joules"] == pytest.approx(BITS * (50e-9 + 100e-12 * 75**2), rel=1e-12)
    assert [row["joules"] for row in place.rows("receive")] == [pytest.approx(RX, rel=1e-12)] * 2
    assert place.closes()


def test_hidden_senders_collide_where_both_are_heard_and_only_there():
    place = Place(LINE)
    tape = play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert tape.heard == {0: [], 1: [3]}, "node 1 hears both and gets neither; node 3 hears node 2 alone"
    assert [(row["node"], row["peer"]) for row in place.rows("collide")] == [(1, 0), (1, 2)]
    assert place.mac.counts.collided == 2


def test_a_radio_that_hears_two_frames_pays_for_the_time_once():
    place = Place(LINE)
    play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert place.fleet.ledger.joules[CAUSE["rx"], 1] == pytest.approx(1.5 * RX, rel=0.01), "one and a half airtimes"
    assert place.closes()


def test_frames_that_do_not_overlap_in_time_do_not_collide():
    place = Place(LINE)
    tape = play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME + 1e-9, 2, EVERYONE))
    assert tape.heard == {0: [1], 1: [1, 3]}


def test_who_sends_hears_nothing():
    place = Place(LINE)
    tape = play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 1, EVERYONE))
    assert tape.heard == {0: [], 1: [2]}, "node 1 was sending while node 0 was; node 0 hears node 1 but sends too"
    assert place.fleet.ledger.joules[CAUSE["rx"], 1] == 0.0, "a sender's receiver is off"


def test_far_frames_do_not_disturb_each_other():
    place = Place([(0, 0), (50, 0), (400, 0), (450, 0)])
    tape = play(place, (0.1, 0, EVERYONE), (0.1, 2, EVERYONE))
    assert tape.heard == {0: [1], 1: [3]}


def test_a_unicast_is_overheard_at_a_price_by_everyone_in_range():
    place = Place(LINE)
    tape = play(place, (0.1, 1, 2))
    assert tape.heard == {0: True}
    assert place.fleet.ledger.joules[CAUSE["overhear"]].tolist() == pytest.approx([RX, 0, 0, 0])
    assert place.fleet.ledger.joules[CAUSE["rx"]].tolist() == pytest.approx([0, 0, RX, 0])
    (overheard,) = place.rows("overhear")
    assert (overheard["node"], overheard["peer"]) == (0, 1)
    assert sum(row["joules"] for row in place.rows()) == pytest.approx(place.fleet.ledger.spent.sum(), rel=1e-12)


def test_of_two_overlapping_frames_the_much_stronger_is_captured_and_the_weaker_lost():
    link = LogNormal(shadowing=0.0, asymmetry=0.0, interference="sinr")
    place = Place([(0, 0), (5, 0), (40, 0)], link=link)
    tape = play(place, (0.1, 0, 1), (0.1, 2, 1))
    assert tape.heard == {0: True, 1: False}
    place = Place([(0, 0), (5, 0), (40, 0)], link=LogNormal(shadowing=0.0, asymmetry=0.0))
    assert play(place, (0.1, 0, 1), (0.1, 2, 1)).heard == {0: False, 1: False}, "without capture neither arrives"


def test_the_channel_is_busy_in_the_window_of_a_frame_and_of_the_own_sending():
    place = Place(LINE)
    channel = place.mac._channel
    play(place, (0.1, 0, EVERYONE), until=0.1001)
    assert not channel.is_busy(1), "nothing is on the air during the turnaround"
    place.env.run(until=0.1 + TURNAROUND + AIRTIME / 2)
    assert channel.is_busy(1) and channel.is_busy(0) and not channel.is_busy(3)
    place.env.run(until=0.1 + TURNAROUND + AIRTIME + 100e-6)
    assert channel.is_busy(1), "it was, within the last 128 µs"
    place.env.run(until=0.1 + TURNAROUND + AIRTIME + 129e-6)
    assert not channel.is_busy(1)


def test_a_jammed_node_finds_the_channel_busy_and_gets_nothing():
    place = Place(LINE)
    place.fleet.jammed[1] = place.fleet.disturbed = True
    tape = play(place, (0.1, 0, EVERYONE), (0.2, 2, EVERYONE))
    assert tape.heard == {0: [], 1: [3]} and place.mac._channel.is_busy(1)


def test_a_loss_at_a_node_thins_what_it_gets_and_what_it_sends():
    place = Place(LINE)
    place.fleet.loss[1], place.fleet.disturbed = 0.5, True
    tape = play(place, *((0.01 * i, 0, 1) for i in range(1, 401)), until=10.0)
    assert 150 < sum(tape.heard.values()) < 250, "400 frames at one half: 200 with a deviation of 10"


def test_a_sender_whose_charge_ends_in_mid_frame_dies_at_that_instant_and_is_not_heard():
    cost = BITS * (50e-9 + 100e-12 * 75**2)
    place = Place(LINE, energy=FirstOrder(battery=cost / 4))
    tape = play(place, (0.1, 1, EVERYONE))
    assert tape.heard == {0: []}
    assert place.died == [(pytest.approx(0.1 + TURNAROUND + AIRTIME / 4), 1)]
    assert place.rows("send")[0]["bits"] == BITS // 4
    assert place.fleet.ledger.spent[0] == 0.0, "a frame that breaks off is not received"
    assert place.closes()


def test_a_receiver_whose_charge_does_not_suffice_dies_and_has_not_received():
    place = Place(LINE, energy=FirstOrder(battery=RX * 0.6, amplifier=0.0, electronics=50e-9))
    place.fleet.ledger.spent[1], place.fleet.ledger.joules[CAUSE["cpu"], 1] = RX * 0.2, RX * 0.2
    place.fleet.ledger.totals[CAUSE["cpu"]] += RX * 0.2
    place.fleet.battery = RX * 1.1
    tape = play(place, (0.1, 0, EVERYONE))
    assert tape.heard == {0: []} and place.died and place.died[0][1] == 1
    assert place.closes()


def test_what_a_node_sent_before_it_fell_silent_is_paid_in_part():
    place = Place(LINE)
    place.at(0.1 + TURNAROUND + AIRTIME / 2, lambda: place.mac.silence(1))
    tape = play(place, (0.1, 1, EVERYONE))
    assert tape.heard == {0: []}
    assert place.fleet.ledger.spent[1] == pytest.approx(BITS / 2 * (50e-9 + 100e-12 * 75**2), rel=1e-9)


def test_nodes_with_the_radio_off_hear_nothing_and_pay_nothing():
    place = Place(LINE)
    place.fleet.living[2] = place.fleet.all_listen = False
    assert play(place, (0.1, 1, EVERYONE)).heard == {0: [0]}
    assert place.fleet.ledger.spent[2] == 0.0


def test_links_are_counted_frame_by_frame():
    place = Place(LINE)
    place.mac.count_links()
    play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE), (0.2, 0, EVERYONE))
    rows = place.mac.link_rows()
    found = {(int(s), int(n)): (int(sent), int(got)) for s, n, sent, got in zip(
        rows["source"], rows["node"], rows["sent"], rows["received"], strict=True)}  # fmt: skip
    assert found == {(0, 1): (2, 1), (2, 1): (1, 0), (2, 3): (1, 1)}
    assert rows["distance"].tolist() == [50.0] * 3


def test_a_lossy_disk_loses_its_share_of_frames():
    place = Place([(0, 0), (50, 0)], link=Disk(reach=75.0, loss=0.25))
    tape = play(place, *((0.01 * i, 0, EVERYONE) for i in range(1, 801)), until=10.0)
    assert np.mean([len(heard) for heard in tape.heard.values()]) == pytest.approx(0.75, abs=0.05)
    assert len(place.rows("drop")) == sum(not heard for heard in tape.heard.values())


@pytest.mark.parametrize("link", [Disk(reach=75.0), LogNormal(shadowing=0.0, asymmetry=0.0, exponent=2.0)])
def test_a_broadcast_counts_as_lost_only_where_a_living_node_in_range_did_not_get_it(link):
    place = Place([(0, 0), (30, 0), (40, 0), (138, 0)], link=link)
    place.fleet.crash(2)
    assert sorted(place.broadcast(0).heard) == [1], "one is down, one nearly out of range"
    assert (place.mac.counts.frames_lost, place.mac.counts.in_range, place.mac.counts.delivered) == (0, 1, 1)
    place.fleet.restart(2)
    place.fleet.jammed[2] = place.fleet.disturbed = True
    place.broadcast(0)
    assert place.mac.counts.frames_lost == 1


def test_a_crash_in_mid_frame_pays_for_what_was_sent_and_frees_the_air():
    place = Place(LINE)
    place.at(0.1 + TURNAROUND + AIRTIME / 2, lambda: (place.mac.silence(0), place.fleet.crash(0)))
    tape = play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME * 0.6, 2, EVERYONE))
    assert place.fleet.ledger.spent[0] == pytest.approx(BITS / 2 * (50e-9 + 100e-12 * 75**2), rel=1e-9)
    assert tape.heard == {0: [], 1: [1, 3]}, "the broken frame is off the air when the other begins"


def test_a_crash_during_the_turnaround_leaves_no_trace_on_the_air():
    place = Place(LINE)
    place.at(0.1 + TURNAROUND / 2, lambda: (place.mac.silence(0), place.fleet.crash(0)))
    tape = play(place, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert tape.heard[1] == [1, 3] and place.fleet.ledger.spent[0] == 0.0 and not place.mac._channel.is_busy(1)


def test_a_node_that_came_back_hears_again_at_full_speed():
    place = Place(LINE)
    place.fleet.crash(3)
    assert not place.fleet.all_listen and play(place, (0.1, 2, EVERYONE)).heard == {0: [1]}
    place.fleet.restart(3)
    assert place.fleet.all_listen


def test_whether_a_frame_arrives_does_not_depend_on_what_was_sent_in_other_steps():
    outcomes = []
    for early in (False, True):
        place = Place([(0, 0), (50, 0)], link=Disk(reach=75.0, loss=0.5))
        place.at(1.5, lambda place=place: setattr(place.journal, "step", 1))
        frames = [(2.0 + 0.01 * i, 0, EVERYONE) for i in range(40)]
        tape = play(place, *([(0.5, 0, EVERYONE)] if early else []), *frames, until=3.0)
        outcomes.append([tape.heard[i + early] for i in range(40)])
    assert outcomes[0] == outcomes[1] and len({len(heard) for heard in outcomes[0]}) == 2


@pytest.mark.parametrize("seed", range(3))
def test_the_quick_ways_and_the_general_way_find_the_same(seed):
    points = np.random.default_rng(seed).uniform(0, 200, (25, 2))
    ledgers = []
    for quick in (True, False):
        place = Place(points, seed=seed)
        if not quick:
            place.mac._channel._reception._receive_all = place.mac._channel._reception._part = lambda one: None
        times = np.random.default_rng(seed + 9).uniform(0, 0.2, 120)
        for i, time in enumerate(times):
            place.at(float(time), lambda place=place, i=i: place.mac.offer(i % 25, 96, lambda heard: None))
        place.env.run(until=1.0)
        ledgers.append((place.fleet.ledger.joules.copy(), place.mac.counts, place.journal.fingerprint()))
    assert np.allclose(ledgers[0][0], ledgers[1][0], rtol=1e-12) and ledgers[0][1:] == ledgers[1][1:]
    assert ledgers[0][1].collided > 20
