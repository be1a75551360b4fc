"""TDMA inside clusters: no collisions and no overhearing among members; CSMA/CA elsewhere."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import full_burst
from wsnsim.base.radio import Mode
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE
from wsnsim.models.access import Csma, Tdma
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk

STAR = [(0, 0), *((30 * np.cos(a), 30 * np.sin(a)) for a in np.linspace(0, 6, 8))]


def gather(network, sources=range(1, 9), packets=1, head=0):
    bursts = [full_burst(node, head, Parcel("reading", packets, PACKET_BITS, "reading"), 0) for node in sources]
    network.env.run(until=network.mac.send(bursts, head))
    return bursts


def test_with_slots_every_reading_arrives_without_collisions():
    slotted, contending = RadioNetwork(STAR, mac=Tdma()), RadioNetwork(STAR, mac=Csma())
    assert all(burst.packets == 1 for burst in gather(slotted))
    assert slotted.counters.collided == 0 and slotted.counters.frames_sent == 9, "the schedule and eight readings"
    gather(contending)
    assert contending.counters.collided > 0


def test_a_round_has_one_slot_per_frame_and_the_schedule_is_announced_once():
    network = RadioNetwork(STAR, mac=Tdma())
    gather(network)
    began = network.env.now
    gather(network)
    assert network.env.now - began == pytest.approx(8 * Tdma().slot_needed(29 * 8), rel=1e-9)
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1
    gather(network, sources=range(1, 5))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1, "fewer members need no new schedule"


def test_members_do_not_overhear_each_other_but_other_nodes_do():
    network = RadioNetwork([*STAR, (10, 10)], mac=Tdma())
    gather(network, sources=range(1, 9))
    overheard = network.nodes.ledger.joules[CAUSE["overhear"]]
    assert (overheard[:9] == 0).all() and overheard[9] == pytest.approx(8 * 29 * 8 * 50e-9)


def test_members_turn_the_radio_off_in_the_slots_of_others():
    network = RadioNetwork(STAR, mac=Tdma(), energy=FirstOrder(idle=0.06, sleep=0.001, battery=100.0))
    gather(network)
    began, before = network.env.now, network.nodes.totals_now()
    gather(network)
    took, spent = network.env.now - began, np.array(network.nodes.totals_now()) - np.array(before)
    slot = Tdma().slot_needed(29 * 8)
    dozing = 7 * 8 * slot
    assert took == pytest.approx(8 * slot)
    assert spent[CAUSE["sleep"]] == pytest.approx(0.001 * dozing, rel=1e-6)
    on_air = 8 * 2 * 29 * 8 / 250e3
    assert spent[CAUSE["idle"]] == pytest.approx(0.06 * (9 * took - dozing - on_air), rel=1e-6)
    network.nodes.close()
    assert network.ledger_adds_up()
    assert network.nodes.ledger.totals == pytest.approx(network.nodes.totals_now(), rel=1e-9)
    assert Mode.ASLEEP == 2


def test_a_member_that_missed_the_schedule_has_no_slot_until_it_receives_the_next_one():
    network = RadioNetwork(STAR, mac=Tdma())
    network.nodes.jammed[3] = network.nodes.disturbed = True
    bursts = gather(network)
    assert [burst.packets for burst in bursts] == [1, 1, 0, 1, 1, 1, 1, 1]
    words = network.memory.words.all()
    assert {words[int(row["what"])] for row in network.rows("drop")} == {"no_schedule"}
    network.nodes.jammed[3] = False
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_member_whose_clock_is_off_by_more_than_the_guard_misses_its_slot_until_the_next_schedule():
    network = RadioNetwork(STAR, mac=Tdma())
    gather(network)
    network.clocks.step([2], 1e-3)
    assert [burst.packets for burst in gather(network)] == [1, 0, 1, 1, 1, 1, 1, 1]
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_frame_without_acknowledgement_gets_another_slot_at_the_end():
    shares = []
    for acks in (True, False):
        network = RadioNetwork(STAR, mac=Tdma(acks=acks), link=Disk(reach=75.0, loss=0.3), seed=5)
        bursts = [burst for _ in range(30) for burst in gather(network)]
        had_slots = len(bursts) - sum(network.memory.words.all()[int(row["what"])] == "no_schedule"
                                      for row in network.rows("drop"))  # fmt: skip
        shares.append(sum(burst.packets for burst in bursts) / had_slots)
    assert shares[0] > 0.95 and shares[1] == pytest.approx(0.7, abs=0.08)


def test_a_burst_has_one_slot_per_frame_and_a_long_frame_several_slots_of_fixed_length():
    network = RadioNetwork(STAR, mac=Tdma())
    assert [burst.packets for burst in gather(network, sources=[1, 2], packets=5)] == [5, 5]
    fixed = RadioNetwork(STAR, mac=Tdma(slot=2e-3))
    gather(fixed, sources=[1])
    began = fixed.env.now
    burst = full_burst(1, 0, Parcel("long", 1, 800, "reading"), 0)
    fixed.env.run(until=fixed.mac.send([burst], 0))
    needed = Tdma().slot_needed(8 * (17 + 100))
    assert fixed.env.now - began == pytest.approx(2e-3 * np.ceil(needed / 2e-3)) and burst.packets == 1


def test_a_round_goes_on_when_its_head_or_a_member_crashes():
    for victim in (0, 4):
        network = RadioNetwork(STAR, mac=Tdma())
        gather(network)
        network.at(network.env.now + 5e-3, lambda network=network, victim=victim: network.nodes.crash(victim))
        network.at(network.env.now + 5e-3, lambda network=network, victim=victim: network.mac.silence(victim))
        began = network.env.now
        bursts = gather(network, packets=3)
        assert network.env.now - began < 24 * Tdma().slot_needed(29 * 8) + 0.1
        assert sum(burst.packets for burst in bursts) < 24


def test_rounds_of_one_head_do_not_overlap():
    network = RadioNetwork(STAR, mac=Tdma())
    gather(network)
    bursts = [[full_burst(n, 0, Parcel("r", 1, PACKET_BITS, "reading"), t) for n in range(1, 9)] for t in (0, 1)]
    events = [network.mac.send(some, 0) for some in bursts]
    network.env.run(until=network.env.all_of(events))
    assert all(burst.packets == 1 for some in bursts for burst in some) and network.counters.collided == 0


@pytest.mark.parametrize("guard", [0.0, 50e-6, 95e-6, 250e-6])
def test_frames_arrive_with_guards_of_any_length(guard):
    network = RadioNetwork(STAR, mac=Tdma(guard=guard))
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_schedule_of_several_frames_is_known_only_after_receiving_all_of_them():
    network = RadioNetwork(STAR, mac=Tdma(schedule_bits=1000), link=Disk(reach=75.0, loss=0.2), seed=2)
    gather(network)
    announced = [row for row in network.rows("receive") if row["peer"] == 0 and row["packets"] == 1]
    pieces = {node: sum(row["node"] == node for row in announced) for node in range(1, 9)}
    sent = sum(row["peer"] == -1 for row in network.rows("send"))
    assert sent > 3 and set(network.mac._schedules[0]) == {node for node, count in pieces.items() if count == sent}


def test_two_clusters_of_one_head_keep_each_others_schedule():
    network = RadioNetwork(STAR, mac=Tdma())
    for _ in range(5):
        gather(network, sources=range(1, 5))
        gather(network, sources=range(5, 9))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 2
