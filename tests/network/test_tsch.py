"""TSCH: frames in slots, back-off in shared cells, channels, and cells that heads give and take back."""

import itertools
from operator import itemgetter

import numpy as np
import pytest

from tests.network.plain_shared_cells import throughput
from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE
from wsnsim.models.hardware import Frames
from wsnsim.models.links import Disk, LogNormal
from wsnsim.models.tsch import Tsch
from wsnsim.network.radio.tsch.cell_leases import Cell

STAR = [(0, 0), *((30 * np.cos(a), 30 * np.sin(a)) for a in np.linspace(0, 6, 8))]
AIRTIME, ACK, TX = 29 * 8 / 250e3, 19 * 8 / 250e3, 2.12e-3
SHORT = Tsch(slotframe=31)


def bursts_to(head, sources, packets=1):
    return [full_burst(node, head, Parcel("reading", packets, PACKET_BITS, "reading"), 0) for node in sources]


def gather(network, sources=range(1, 9), packets=1, head=0):
    bursts = bursts_to(head, sources, packets)
    network.env.run(until=network.mac.send(bursts, head))
    return bursts


def words(network, *kinds):
    names = network.memory.words.all()
    return [names[int(row["what"])] for row in network.rows(*kinds)]


def slots_of(network, mac, what):
    """(ASN, sender) of each frame of this word."""
    names = network.memory.words.all()
    rows = [row for row in network.rows("send") if names[int(row["what"])] == what]
    return [(int(row["time"] / mac.slot), row["node"]) for row in rows]


@pytest.mark.parametrize("offered", [0.0, 0.004, 0.1, 0.3, 0.309])
def test_a_unicast_waits_for_the_next_shared_cell_and_is_acknowledged_in_the_same_slot(offered):
    network = RadioNetwork([(0, 0), (50, 0)], mac=SHORT)
    network.env.run(until=1e-9 + offered) if offered else None
    burst = network.unicast(0, 1)
    waited = -offered % SHORT.interval
    assert burst.packets == 1
    data, ack = network.rows("send")
    assert data["time"] - offered == pytest.approx(waited + TX + AIRTIME, abs=1e-8)
    assert ack["time"] - data["time"] == pytest.approx(1e-3 + ACK)
    assert network.env.now == ack["time"], "the burst has ended with its acknowledgement"


def test_latency_in_the_shared_cell_is_uniform_over_a_slotframe():
    network = RadioNetwork([(0, 0), (50, 0)], mac=SHORT)
    times = (np.arange(100) + 0.5) / 100 * SHORT.interval
    delays = []
    for number, time in enumerate(times):
        begins = 2 * number * SHORT.interval + time
        network.env.run(until=begins)
        network.unicast(0, 1)
        delays.append(network.env.now - begins)
    exchange = TX + AIRTIME + 1e-3 + ACK
    assert np.mean(delays) == pytest.approx(SHORT.interval / 2 + exchange, rel=0.01)
    assert sorted(delays) == pytest.approx(times + exchange, abs=1e-6)


def test_more_shared_cells_halve_the_wait():
    network = RadioNetwork([(0, 0), (50, 0)], mac=Tsch(slotframe=30, shared=2))
    network.env.run(until=0.01)
    network.unicast(0, 1)
    assert network.rows("send")[0]["time"] == pytest.approx(0.15 + TX + AIRTIME)


def test_a_broadcast_is_sent_once_and_reaches_all_in_range():
    network = RadioNetwork(STAR, mac=SHORT)
    burst = network.broadcast(3)
    assert sorted(burst.received) == [0, 1, 2, 4, 5, 6, 7, 8]
    assert len(network.rows("send")) == 1 and network.ledger_adds_up()


def test_frames_that_collide_are_sent_again_after_a_number_of_shared_cells():
    network = RadioNetwork(STAR, mac=Tsch(slotframe=5))
    bursts = bursts_to(0, (1, 2))
    network.env.run(until=network.mac.send(bursts))
    sent = slots_of(network, SHORT, "reading")
    assert {asn for asn, _ in sent[:2]} == {0}, "both in the first shared cell"
    assert all(asn % 5 == 0 for asn, _ in sent)
    assert network.counters.retries == len(sent) - 2 > 0
    for node in (1, 2):
        own = [asn // 5 for asn, sender in sent if sender == node]
        for failures, (before, after) in enumerate(itertools.pairwise(own)):
            assert 1 <= after - before <= 2 ** (failures + 1), "BE is 1 after the first failure, then 2, then 3"


def test_a_frame_that_nobody_acknowledges_is_sent_four_times():
    network = RadioNetwork([(0, 0), (50, 0)], mac=Tsch(slotframe=5))
    network.nodes.living[1] = network.nodes.all_listen = False
    burst = network.unicast(0, 1)
    assert burst.packets == 0 and burst.sent == 4 * 29 * 8 and network.counters.retries == 3


def test_channels_follow_the_hopping_sequence_and_do_not_disturb_each_other():
    """Two members send in the same slot, with different channel offsets: with one channel both frames are lost."""
    places = [(0, 0), (10, 0), (0, 10), (10, 10)]
    lost = {}
    for channels in ((11,), Tsch().channels):
        network = RadioNetwork(places, mac=Tsch(slotframe=3, channels=channels, lease=1))
        for head, member in ((0, 1), (2, 3)):
            network.mac._leases._begin(head, one_cell(head, member), {member}, waiting(network, head, member))
        network.env.run(until=0.03)
        lost[len(channels)] = network.counters.frames_lost
    assert lost == {1: 2, 16: 0}


def one_cell(head, member):
    return [Cell(1, head, member, head)]


def waiting(network, head, member):
    (burst,) = bursts_to(head, [member])
    return {(member, head): network.mac._fragmentation.split(burst, lambda: None)}


def test_a_gathering_takes_one_announcement_and_a_cell_for_each_frame():
    network = RadioNetwork(STAR, mac=SHORT)
    bursts = gather(network)
    assert all(burst.packets == 1 for burst in bursts)
    assert network.counters.collided == 0 and network.counters.frames_sent == 8, "the cells do not count"
    announced, *_ = network.rows("send")
    assert (announced["peer"], announced["bits"]) == (-1, (6 + 11) * 8 + 8 * 48)
    cells = slots_of(network, SHORT, "reading")
    assert len({asn for asn, _ in cells}) == 8 and all(asn % 31 for asn, _ in cells)
    assert network.env.now < 2 * SHORT.interval, "at most a slotframe for the announcement, and one for the cells"


def test_what_is_heard_in_a_cell_is_heard_by_its_receiver_alone():
    network = RadioNetwork(STAR, mac=SHORT)
    gather(network)
    assert network.nodes.ledger.joules[CAUSE["overhear"]].sum() == 0.0


def test_latency_in_a_cell_of_ones_own_is_its_position():
    network = RadioNetwork(STAR, mac=SHORT)
    bursts, cells = gather(network), sorted(slots_of(network, SHORT, "reading"), key=itemgetter(1))
    for burst, (asn, node) in zip(bursts, cells, strict=True):
        assert burst.source == node
        assert burst.heard_at == pytest.approx(asn * SHORT.slot + TX + AIRTIME)


def test_cells_are_given_for_each_frame_of_a_burst_and_taken_back_after_the_last():
    network = RadioNetwork(STAR, mac=SHORT)
    bursts = gather(network, sources=(1, 2), packets=3)
    assert all(burst.packets == 3 for burst in bursts)
    assert len(slots_of(network, SHORT, "reading")) == 6
    assert network.mac._radios.receiving == {}, "all were acknowledged"
    gather(network, sources=(1, 2))
    assert words(network, "send").count("cells") == 2, "each gathering has cells of its own"


def test_a_single_frame_uses_the_shared_cell():
    network = RadioNetwork(STAR, mac=SHORT)
    gather(network, sources=(4,))
    assert "cells" not in words(network, "send")


def test_a_head_sends_to_its_members_in_cells_too():
    network = RadioNetwork(STAR, mac=SHORT)
    bursts = [full_burst(0, node, Parcel("plan", 1, PACKET_BITS, "plan"), 0) for node in range(1, 9)]
    network.env.run(until=network.mac.send(bursts, 0))
    assert all(burst.packets == 1 for burst in bursts) and words(network, "send").count("cells") == 1
    assert network.mac._radios.receiving == {}


def test_a_member_that_missed_the_announcement_uses_the_shared_cells():
    network = RadioNetwork(STAR, mac=Tsch(slotframe=31))
    network.nodes.jammed[3] = network.nodes.disturbed = True
    event = network.mac.send(bursts := bursts_to(0, range(1, 9)), 0)
    network.env.run(until=5e-3)
    network.nodes.jammed[3] = False
    network.env.run(until=event)
    assert all(burst.packets == 1 for burst in bursts)
    ((late, _),) = [each for each in slots_of(network, SHORT, "reading") if each[1] == 3]
    assert late % 31 == 0


def test_members_that_a_head_expects_have_cells_until_the_lease_is_over():
    network = RadioNetwork(STAR, mac=SHORT)
    network.mac.expect(0, [0, *range(1, 9)])
    gather(network, sources=(1, 2))
    assert network.rows("send")[0]["bits"] == (6 + 11) * 8 + 8 * 48
    assert len(network.mac._radios.receiving[0]) == 6
    gather(network, sources=(3, 4))
    assert words(network, "send").count("cells") == 1
    network.env.run(until=(SHORT.lease + 1) * SHORT.interval + 0.01)
    assert network.mac._radios.receiving == {}
    gather(network, sources=(7, 8))
    assert words(network, "send").count("cells") == 2, "theirs have ended with the lease"


def test_frames_in_cells_that_were_taken_back_wait_for_the_shared_ones():
    network = RadioNetwork(STAR, mac=Tsch(slotframe=31, lease=1, max_retries=5), link=Disk(reach=75.0))
    event = network.mac.send(bursts := bursts_to(0, (1, 2)), 0)
    network.env.run(until=5e-3)
    network.nodes.jammed[1] = network.nodes.jammed[2] = network.nodes.disturbed = True
    network.env.run(until=0.32)
    network.nodes.jammed[:] = False
    network.env.run(until=event)
    assert all(burst.packets == 1 for burst in bursts)
    assert all(asn % 31 == 0 for asn, _ in slots_of(network, SHORT, "reading")[2:])


def test_gatherings_faster_than_slotframes_use_the_cells_that_there_are():
    """Every half second, with a slotframe of one: no member has two lines, and nothing is lost or sent twice."""
    network = RadioNetwork(STAR, mac=Tsch())
    rounds = []
    for number in range(8):
        network.at(0.5 * number + 0.01, lambda: rounds.append(send_all(network)))
    network.env.run(until=30.0)
    assert all(burst.packets == 1 for bursts in rounds for burst in bursts)
    assert len(slots_of(network, SHORT, "reading")) == 8 * 8 + network.counters.retries
    assert network.mac._radios.receiving == {} and network.mac._leases._lines == {}


def send_all(network):
    bursts = bursts_to(0, range(1, 9))
    network.mac.expect(0, range(1, 9))
    network.mac.send(bursts, 0)
    return bursts


def test_frames_that_wait_for_cells_do_not_survive_a_crash():
    network = RadioNetwork(STAR, mac=SHORT)
    network.env.run(until=0.05)
    event = network.mac.send(bursts := bursts_to(0, range(1, 9)), 0)
    network.env.run(until=0.1)
    network.nodes.crash(3)
    network.mac.silence(3)
    network.nodes.restart(3, network.env.now)
    network.env.run(until=event)
    assert [burst.packets for burst in bursts] == [1, 1, 0, 1, 1, 1, 1, 1]
    assert 3 not in {node for _, node in slots_of(network, SHORT, "reading")}


def test_more_frames_than_slots_share_what_is_left():
    network = RadioNetwork(STAR, mac=Tsch(slotframe=5))
    bursts = gather(network)
    assert all(burst.packets for burst in bursts[:4]), "four free slots"
    assert network.env.now < 10 and network.ledger_adds_up()


def test_a_node_that_dies_loses_its_frames_and_ends_their_bursts():
    network = RadioNetwork(STAR, mac=SHORT)
    event = network.mac.send(bursts := bursts_to(0, range(1, 9)), 0)
    network.at(0.05, lambda: (network.nodes.crash(5), network.mac.silence(5)))
    network.env.run(until=event)
    assert [burst.packets for burst in bursts] == [1, 1, 1, 1, bursts[4].packets, 1, 1, 1]


def test_a_head_that_dies_is_sent_to_in_vain():
    network = RadioNetwork(STAR, mac=SHORT)
    event = network.mac.send(bursts := bursts_to(0, range(1, 9)), 0)
    network.at(1e-4, lambda: (network.nodes.crash(0), network.mac.silence(0)))
    network.env.run(until=event)
    assert not any(burst.packets for burst in bursts)


def test_a_head_that_dies_before_its_announcement_sends_nothing():
    network = RadioNetwork(STAR, mac=SHORT)
    network.env.run(until=0.05)
    bursts = [full_burst(0, node, Parcel("plan", 1, PACKET_BITS, "plan"), 0) for node in range(1, 9)]
    ended = network.mac.send(bursts, 0)
    network.env.run(until=0.1)
    network.nodes.crash(0)
    network.mac.silence(0)
    network.env.run(until=ended)
    network.nodes.restart(0, network.env.now)
    network.env.run(until=network.env.now + 10 * SHORT.interval)
    assert network.counters.transmissions == 0 and not any(burst.packets for burst in bursts)


def test_each_frame_has_one_slot_with_packing_and_interference_too():
    network = RadioNetwork(
        STAR, mac=SHORT, link=LogNormal(interference="sinr", shadowing=0.0, asymmetry=0.0), packing=Frames()
    )
    bursts = gather(network, packets=20)
    assert sum(burst.packets for burst in bursts) > 100
    sends = [row for row in network.rows("send") if row["peer"] != EVERYONE]
    assert all(row["time"] % SHORT.slot <= SHORT.slot_needed(133 * 8) for row in sends)


def saturated(senders, slotframes):
    """Frames delivered per slotframe, of senders in range of each other that always have a frame for node 0."""
    mac, delivered = Tsch(slotframe=2), 0
    network = RadioNetwork([(0, 0), *((10.0, float(node)) for node in range(senders))], mac=mac, horizon=1e6)

    def send(node):
        burst = full_burst(node, 0, Parcel("reading", 1, PACKET_BITS, "reading"), 0)
        network.mac.send([burst]).callbacks.append(lambda _: again(node, burst))

    def again(node, burst):
        nonlocal delivered
        delivered += burst.packets
        send(node)

    for node in range(1, senders + 1):
        send(node)
    network.env.run(until=slotframes * mac.interval)
    return delivered / slotframes


SIMULATOR = {1: (0.9991, 0.9991), 2: (0.5616, 0.5539), 3: (0.3797, 0.3826), 4: (0.2902, 0.2844), 5: (0.2058,)}
"""{senders: frames per slotframe} of the 6TiSCH simulator: two runs (one for 5 senders) of 6000 slotframes of 5 slots,
3 retries, neither beacons nor routing messages, links without loss (our runs of its published code)."""


@pytest.mark.thorough
@pytest.mark.parametrize("senders", [1, 2, 4])
def test_the_throughput_of_a_shared_cell_is_that_of_a_plain_simulation_and_of_the_6tisch_simulator(senders):
    ours, (plain, _) = saturated(senders, 20_000), throughput(senders, 200_000, seed=senders)
    assert ours == pytest.approx(plain, abs=0.0 if senders == 1 else 0.012)
    assert ours == pytest.approx(np.mean(SIMULATOR[senders]), abs=0.02)


@pytest.mark.thorough
def test_a_single_sender_uses_every_shared_cell_and_several_less_than_two_thirds():
    assert saturated(1, 200) == 1.0
    assert saturated(3, 600) == pytest.approx(throughput(3, 50_000, seed=1)[0], abs=0.08)
