"""The shared channel: all numbers are computed by hand from the lengths of frames."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import EVERYONE, MacFrame
from wsnsim.base.tables import CAUSE
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk, LogNormal
from wsnsim.models.sleep import DutyCycle, EventWake

AIRTIME = 29 * 8 / 250e3
TURNAROUND = 192e-6
BITS = 29 * 8
RX = BITS * 50e-9


class Transmissions:
    """Sends frames at given times, given as (time, source, destination), and keeps who received each."""

    def __init__(self, network, *frames):
        self.network = network
        self.received = {}
        for number, (time, source, to) in enumerate(frames):
            network.at(time, lambda source=source, to=to, number=number: self._send(source, to, number))

    def _send(self, source, to, number):
        frame = MacFrame(to, BITS)
        frame.owner = number
        self.network.mac.channel.transmit(source, frame, self._ended)

    def _ended(self, transmission, received):
        frame = transmission.frame
        self.received[frame.owner] = received.tolist() if frame.to == EVERYONE else received


def play(network, *frames, until=1.0):
    sent = Transmissions(network, *frames)
    network.env.run(until=until)
    return sent


LINE = [(0, 0), (50, 0), (100, 0), (150, 0)]


def test_a_frame_takes_turnaround_and_airtime_and_is_received_within_range():
    network = RadioNetwork(LINE)
    sent = play(network, (0.5, 1, EVERYONE))
    assert sent.received == {0: [0, 2]}
    (sent,) = network.rows("send")
    assert sent["time"] == pytest.approx(0.5 + TURNAROUND + AIRTIME, abs=1e-12)
    assert sent["joules"] == pytest.approx(BITS * (50e-9 + 100e-12 * 75**2), rel=1e-12)
    assert [row["joules"] for row in network.rows("receive")] == [pytest.approx(RX, rel=1e-12)] * 2
    assert network.ledger_adds_up()


def test_hidden_senders_collide_only_where_both_are_heard():
    network = RadioNetwork(LINE)
    sent = play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert sent.received == {0: [], 1: [3]}, "node 1 hears both and gets neither; node 3 hears node 2 alone"
    assert [(row["node"], row["peer"]) for row in network.rows("collide")] == [(1, 0), (1, 2)]
    assert network.counters.collided == 2


def test_a_radio_that_hears_two_frames_pays_for_the_time_once():
    network = RadioNetwork(LINE)
    play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert network.nodes.ledger.joules[CAUSE["rx"], 1] == pytest.approx(1.5 * RX, rel=0.01), "one and a half airtimes"
    assert network.ledger_adds_up()


def test_frames_that_do_not_overlap_in_time_do_not_collide():
    network = RadioNetwork(LINE)
    sent = play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME + 1e-9, 2, EVERYONE))
    assert sent.received == {0: [1], 1: [1, 3]}


def test_a_sending_node_receives_nothing():
    network = RadioNetwork(LINE)
    sent = play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 1, EVERYONE))
    assert sent.received == {0: [], 1: [2]}, "node 1 was sending while node 0 was; node 0 hears node 1 but sends too"
    assert network.nodes.ledger.joules[CAUSE["rx"], 1] == 0.0, "a sender's receiver is off"


def test_far_frames_do_not_disturb_each_other():
    network = RadioNetwork([(0, 0), (50, 0), (400, 0), (450, 0)])
    sent = play(network, (0.1, 0, EVERYONE), (0.1, 2, EVERYONE))
    assert sent.received == {0: [1], 1: [3]}


def test_a_unicast_is_overheard_by_all_nodes_in_range_which_pay_for_it():
    network = RadioNetwork(LINE)
    sent = play(network, (0.1, 1, 2))
    assert sent.received == {0: True}
    assert network.nodes.ledger.joules[CAUSE["overhear"]].tolist() == pytest.approx([RX, 0, 0, 0])
    assert network.nodes.ledger.joules[CAUSE["rx"]].tolist() == pytest.approx([0, 0, RX, 0])
    (overheard,) = network.rows("overhear")
    assert (overheard["node"], overheard["peer"]) == (0, 1)
    assert sum(row["joules"] for row in network.rows()) == pytest.approx(network.nodes.ledger.spent.sum(), rel=1e-12)


def test_with_capture_the_much_stronger_of_two_overlapping_frames_arrives_and_the_weaker_is_lost():
    link = LogNormal(shadowing=0.0, asymmetry=0.0, interference="sinr")
    network = RadioNetwork([(0, 0), (5, 0), (40, 0)], link=link)
    sent = play(network, (0.1, 0, 1), (0.1, 2, 1))
    assert sent.received == {0: True, 1: False}
    network = RadioNetwork([(0, 0), (5, 0), (40, 0)], link=LogNormal(shadowing=0.0, asymmetry=0.0))
    assert play(network, (0.1, 0, 1), (0.1, 2, 1)).received == {0: False, 1: False}, "without capture neither arrives"


def test_the_channel_is_busy_during_a_transmission_of_another_node_or_of_the_node_itself():
    network = RadioNetwork(LINE)
    channel = network.mac.channel
    play(network, (0.1, 0, EVERYONE), until=0.1001)
    assert not channel.is_busy(1), "nothing is on the air during the turnaround"
    network.env.run(until=0.1 + TURNAROUND + AIRTIME / 2)
    assert channel.is_busy(1) and channel.is_busy(0) and not channel.is_busy(3)
    network.env.run(until=0.1 + TURNAROUND + AIRTIME + 100e-6)
    assert channel.is_busy(1), "it was, within the last 128 µs"
    network.env.run(until=0.1 + TURNAROUND + AIRTIME + 129e-6)
    assert not channel.is_busy(1)


def test_a_jammed_node_finds_the_channel_busy_and_receives_nothing():
    network = RadioNetwork(LINE)
    network.nodes.jammed[1] = network.nodes.disturbed = True
    sent = play(network, (0.1, 0, EVERYONE), (0.2, 2, EVERYONE))
    assert sent.received == {0: [], 1: [3]} and network.mac.channel.is_busy(1)


def test_a_loss_at_a_node_applies_to_what_it_receives_and_to_what_it_sends():
    network = RadioNetwork(LINE)
    network.nodes.loss[1], network.nodes.disturbed = 0.5, True
    sent = play(network, *((0.01 * i, 0, 1) for i in range(1, 401)), until=10.0)
    assert 150 < sum(sent.received.values()) < 250, "400 frames at one half: 200 with a deviation of 10"


def test_a_sender_whose_battery_runs_out_during_a_frame_dies_at_that_instant_and_is_not_received():
    cost = BITS * (50e-9 + 100e-12 * 75**2)
    network = RadioNetwork(LINE, energy=FirstOrder(battery=cost / 4))
    sent = play(network, (0.1, 1, EVERYONE))
    assert sent.received == {0: []}
    assert network.died == [(pytest.approx(0.1 + TURNAROUND + AIRTIME / 4), 1)]
    assert network.rows("send")[0]["bits"] == BITS // 4
    assert network.nodes.ledger.spent[0] == 0.0, "a frame that breaks off is not received"
    assert network.ledger_adds_up()


def test_a_receiver_whose_battery_does_not_suffice_dies_without_receiving():
    network = RadioNetwork(LINE, energy=FirstOrder(battery=RX * 0.6, amplifier=0.0, electronics=50e-9))
    network.nodes.ledger.spent[1], network.nodes.ledger.joules[CAUSE["cpu"], 1] = RX * 0.2, RX * 0.2
    network.nodes.ledger.totals[CAUSE["cpu"]] += RX * 0.2
    network.nodes.battery = RX * 1.1
    sent = play(network, (0.1, 0, EVERYONE))
    assert sent.received == {0: []} and network.died and network.died[0][1] == 1
    assert network.ledger_adds_up()


def test_a_node_pays_for_what_it_sent_before_it_was_silenced():
    network = RadioNetwork(LINE)
    network.at(0.1 + TURNAROUND + AIRTIME / 2, lambda: network.mac.silence(1))
    sent = play(network, (0.1, 1, EVERYONE))
    assert sent.received == {0: []}
    assert network.nodes.ledger.spent[1] == pytest.approx(BITS / 2 * (50e-9 + 100e-12 * 75**2), rel=1e-9)


def test_nodes_with_the_radio_off_receive_nothing_and_pay_nothing():
    network = RadioNetwork(LINE)
    network.nodes.living[2] = network.nodes.all_listen = False
    assert play(network, (0.1, 1, EVERYONE)).received == {0: [0]}
    assert network.nodes.ledger.spent[2] == 0.0


def test_broadcasts_are_counted_per_link():
    network = RadioNetwork(LINE, count_links=True)
    play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE), (0.2, 0, EVERYONE))
    rows = network.links.columns()
    found = {(int(s), int(n)): (int(sent), int(got)) for s, n, sent, got in zip(
        rows["source"], rows["node"], rows["sent"], rows["received"], strict=True)}  # fmt: skip
    assert found == {(0, 1): (2, 1), (2, 1): (1, 0), (2, 3): (1, 1)}
    assert rows["distance"].tolist() == [50.0] * 3


def test_a_lossy_disk_loses_its_share_of_frames():
    network = RadioNetwork([(0, 0), (50, 0)], link=Disk(reach=75.0, loss=0.25))
    sent = play(network, *((0.01 * i, 0, EVERYONE) for i in range(1, 801)), until=10.0)
    assert np.mean([len(heard) for heard in sent.received.values()]) == pytest.approx(0.75, abs=0.05)
    assert len(network.rows("drop")) == sum(not received for received in sent.received.values())


@pytest.mark.parametrize("link", [Disk(reach=75.0), LogNormal(shadowing=0.0, asymmetry=0.0, exponent=2.0)])
def test_a_broadcast_counts_as_lost_only_if_a_living_node_in_range_did_not_receive_it(link):
    network = RadioNetwork([(0, 0), (30, 0), (40, 0), (138, 0)], link=link)
    network.nodes.crash(2)
    assert sorted(network.broadcast(0).received) == [1], "one is down, one nearly out of range"
    assert (network.counters.frames_lost, network.counters.in_range, network.counters.delivered) == (0, 1, 1)
    network.nodes.restart(2, network.env.now)
    network.nodes.jammed[2] = network.nodes.disturbed = True
    network.broadcast(0)
    assert network.counters.frames_lost == 1


def test_a_node_that_crashes_during_a_frame_pays_for_what_it_sent_and_frees_the_channel():
    network = RadioNetwork(LINE)
    network.at(0.1 + TURNAROUND + AIRTIME / 2, lambda: (network.mac.silence(0), network.nodes.crash(0)))
    sent = play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME * 0.6, 2, EVERYONE))
    assert network.nodes.ledger.spent[0] == pytest.approx(BITS / 2 * (50e-9 + 100e-12 * 75**2), rel=1e-9)
    assert sent.received == {0: [], 1: [1, 3]}, "the broken frame is off the air when the other begins"


def test_a_node_that_crashes_during_the_turnaround_sends_nothing():
    network = RadioNetwork(LINE)
    network.at(0.1 + TURNAROUND / 2, lambda: (network.mac.silence(0), network.nodes.crash(0)))
    sent = play(network, (0.1, 0, EVERYONE), (0.1 + AIRTIME / 2, 2, EVERYONE))
    assert sent.received[1] == [1, 3] and network.nodes.ledger.spent[0] == 0.0 and not network.mac.channel.is_busy(1)


def test_after_a_restart_all_nodes_listen_again():
    network = RadioNetwork(LINE)
    network.nodes.crash(3)
    assert not network.nodes.all_listen and play(network, (0.1, 2, EVERYONE)).received == {0: [1]}
    network.nodes.restart(3, network.env.now)
    assert network.nodes.all_listen


@pytest.mark.parametrize("sleep", [EventWake(), DutyCycle(period=100.0, awake_share=1.0)], ids=["dormant", "scheduled"])
@pytest.mark.parametrize("link", [Disk(reach=75.0), LogNormal(shadowing=0.0, asymmetry=0.0, interference="sinr")])
def test_a_node_that_restarts_during_a_frame_hears_only_those_that_begin_later(sleep, link):
    network = RadioNetwork([(0, 0), (20, 0), (40, 0)], link=link, sleep=sleep)
    network.nodes.crash(2)
    network.at(0.1 + TURNAROUND + AIRTIME / 2, lambda: network.nodes.restart(2, network.env.now))
    sent = play(network, (0.1, 1, EVERYONE), (0.2, 1, EVERYONE), until=0.3)
    assert sent.received == {0: [0], 1: [0, 2]}
    assert network.counters.in_range == network.counters.delivered == 3
    assert [row["node"] for row in network.rows("receive")] == [0, 0, 2] and not network.rows("drop")


def test_whether_a_frame_arrives_does_not_depend_on_what_was_sent_in_other_steps():
    outcomes = []
    for early in (False, True):
        network = RadioNetwork([(0, 0), (50, 0)], link=Disk(reach=75.0, loss=0.5))
        network.at(1.5, lambda network=network: setattr(network.log, "step", 1))
        frames = [(2.0 + 0.01 * i, 0, EVERYONE) for i in range(40)]
        sent = play(network, *([(0.5, 0, EVERYONE)] if early else []), *frames, until=3.0)
        outcomes.append([sent.received[i + early] for i in range(40)])
    assert outcomes[0] == outcomes[1] and len({len(heard) for heard in outcomes[0]}) == 2
