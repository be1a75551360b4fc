"""TDMA inside clusters: no collisions and no overhearing among members; CSMA/CA elsewhere, outside the slots."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim import load
from wsnsim.base.frames import full_burst
from wsnsim.base.radio import Mode
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE, KIND, Memory
from wsnsim.experiment import simulate_run
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
    took = Tdma().contention + 8 * Tdma().slot_needed(29 * 8)
    assert network.env.now - began == pytest.approx(took, rel=1e-9)
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1
    gather(network, sources=range(1, 5))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1, "fewer members need no new schedule"


def test_members_that_the_head_expects_have_slots_from_the_first_schedule_on():
    network = RadioNetwork(STAR, mac=Tdma())
    network.mac.expect(0, [0, *range(1, 9)])
    gather(network, sources=(1, 2))
    (first,) = [row for row in network.rows("send") if row["peer"] == -1]
    headers = 6 + 11
    assert first["bits"] == headers * 8 + 8 * Tdma().schedule_bits
    gather(network, sources=range(1, 9))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1, "none of them needs another schedule"


def test_members_do_not_overhear_each_other_but_other_nodes_do():
    network = RadioNetwork([*STAR, (10, 10)], mac=Tdma())
    gather(network, sources=range(1, 9))
    overheard = network.nodes.ledger.joules[CAUSE["overhear"]]
    assert (overheard[:9] == 0).all() and overheard[9] == pytest.approx(8 * 29 * 8 * 50e-9)


def test_members_turn_the_radio_off_in_the_slots_of_others():
    network = RadioNetwork(STAR, mac=Tdma(contention=0.0), energy=FirstOrder(idle=0.06, sleep=0.001, battery=100.0))
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


def test_a_member_that_corrects_its_clock_keeps_its_slot():
    network = RadioNetwork(STAR, mac=Tdma())
    network.clocks.step([3], 1e-4)  # clocks that are perfect are not corrected
    gather(network)
    network.clocks.correct(2, 5e-3)
    assert all(burst.packets == 1 for burst in gather(network))
    network.clocks.step([2], 1e-3)
    assert [burst.packets for burst in gather(network)] == [1, 0, 1, 1, 1, 1, 1, 1]


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
    fixed = RadioNetwork(STAR, mac=Tdma(slot=2e-3, contention=0.0))
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


def joins(network, sources, head=0):
    """Send a join from each source, outside slots."""
    bursts = [full_burst(node, head, Parcel(None, 1, PACKET_BITS, "join"), 0) for node in sources]
    network.env.run(until=network.mac.send(bursts))
    return bursts


def test_joins_contend_with_acknowledgements_and_retries_though_slots_have_none():
    ring = [(0, 0), *((40 * np.cos(a), 40 * np.sin(a)) for a in np.linspace(0, 6, 16))]
    arrived = {}
    for mac in (Tdma(), Csma(acks=False), Csma()):
        networks = [RadioNetwork(ring, mac=mac, seed=seed) for seed in range(10)]
        arrived[mac] = sum(burst.packets for network in networks for burst in joins(network, range(1, 17)))
    assert arrived[Tdma()] > 140 > 100 > arrived[Csma()] > arrived[Csma(acks=False)], "of 160"
    network = RadioNetwork(ring, mac=Tdma())
    gather(network, range(1, 17))
    assert not any(network.memory.words.all()[int(row["what"])] == "ack" for row in network.rows("send"))


CHAIN = [*STAR, (0, 60), (0, 120)]
"""A cluster around node 0; node 9 hears its head, node 10 hears node 9 but not the head."""


def relayed_during_a_round(mac, source, to, **components):
    """A network whose members send readings in slots while `source` sends frames to `to` all the time."""
    network = RadioNetwork(CHAIN, mac=mac, **components)
    gather(network)
    relayed = []
    for at in np.arange(0.0, 0.1, 2e-3):
        burst = full_burst(source, to, Parcel(None, 1, PACKET_BITS, "report"), 0)
        relayed.append(burst)
        network.at(network.env.now + at, lambda burst=burst: network.mac.send([burst]))
    network.at(network.env.now + 0.05, lambda: None)
    rounds = [gather(network) for _ in range(5)]
    network.env.run(until=network.env.now + 0.3)
    return network, [burst.packets for readings in rounds for burst in readings], [b.packets for b in relayed]


@pytest.mark.parametrize(("source", "to"), [(9, 10), (1, 9), (0, 9)], ids=["neighbour", "member", "head"])
def test_relays_wait_for_the_end_of_a_round_and_get_through_between_rounds(source, to):
    network, readings, relayed = relayed_during_a_round(Tdma(), source, to)
    assert all(readings) and network.counters.collided == 0
    assert sum(relayed) >= 48, "of 50: rounds that follow each other leave a contention period"


def test_only_nodes_in_range_of_the_head_or_a_member_hold_frames_back():
    ends = []
    for source in (9, 11):
        network = RadioNetwork([*CHAIN, (0, 180)], mac=Tdma())
        gather(network)
        report = full_burst(source, 10, Parcel(None, 1, PACKET_BITS, "report"), 0)
        network.env.run(until=network.env.now + 0.1)
        began = network.env.now
        gathering = network.mac.send(
            [full_burst(node, 0, Parcel("reading", 1, PACKET_BITS, "reading"), 0) for node in range(1, 9)], 0
        )
        network.env.run(until=network.mac.send([report]))
        ends.append(network.env.now - began)
        network.env.run(until=gathering)
        assert report.packets == 1
    round_ = 8 * Tdma().slot_needed(29 * 8)
    assert ends[0] > round_ > 5e-3 > ends[1]


def test_a_round_begins_after_the_exchange_that_is_under_way():
    network = RadioNetwork(CHAIN, mac=Tdma(contention=0.0, min_be=0))
    gather(network)
    began, report = network.env.now, full_burst(9, 10, Parcel(None, 1, PACKET_BITS, "report"), 0)
    network.mac.send([report])
    network.env.run(until=began + 1e-3)
    assert all(burst.packets for burst in gather(network)) and report.packets == 1
    mac, slots = Tdma(), 8 * Tdma().slot_needed(29 * 8)
    exchange = mac.cca + mac.turnaround + mac.airtime(29 * 8) + mac.ack_wait
    assert network.env.now - began == pytest.approx(exchange + slots, rel=1e-6)


def test_joins_of_a_tracking_network_arrive_and_no_frame_collides_in_a_slot():
    memory = Memory({"events": True, "clusters": True})
    simulate_run(load("ekf_real", ["duration=3 s"]), recorder=memory)
    events, words = memory.table("events"), memory.words.all()
    what = np.array([words[int(code)] for code in events["what"]])
    kinds = {name: events["kind"] == KIND[name] for name in ("send", "join", "collide")}
    wanted = len(np.unique(events["sequence"][kinds["send"] & (what == "join")]))
    members = memory.table("clusters")["members"]
    assert kinds["join"].sum() >= 0.9 * wanted > 0 and members.mean() > 7
    assert (kinds["collide"] & (what == "reading")).sum() <= 0.002 * (kinds["send"] & (what == "reading")).sum()


def test_a_member_of_two_clusters_with_slots_at_the_same_time_sends_in_one_and_logs_that_it_missed_the_other():
    network = RadioNetwork([(0, 0), (40, 0), (20, 0)], mac=Tdma(acks=False, contention=0.0))
    for head in (0, 1):
        gather(network, sources=[2], head=head)  # the member learns both schedules
    both = [full_burst(2, head, Parcel("reading", 1, PACKET_BITS, "reading"), 0) for head in (0, 1)]
    network.env.run(until=network.env.all_of([network.mac.send([burst], burst.to) for burst in both]))
    assert [burst.packets for burst in both] == [1, 0]
    (row,) = network.rows("drop")
    assert (row["node"], row["peer"], row["frame"], row["packets"]) == (2, 1, 0, 1)
    assert network.memory.words.all()[row["what"]] == "slot_taken" and network.counters.frames_lost == 1
