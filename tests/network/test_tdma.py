"""TDMA inside clusters: no collisions and no overhearing among members; CSMA/CA elsewhere, outside the slots."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim import load
from wsnsim.base.errors import ScenarioError
from wsnsim.base.frames import full_burst
from wsnsim.base.radio import Mode
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE, KIND, Memory
from wsnsim.experiment import simulate_run
from wsnsim.models.access import Csma, Tdma
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk
from wsnsim.scenario import build

STAR = [(0, 0), *((30 * np.cos(a), 30 * np.sin(a)) for a in np.linspace(0, 6, 8))]


def skipping(**options):
    """Slots in rounds of those that have something to send."""
    return Tdma(idle_slots="skipped", **options)


def gather(network, sources=range(1, 9), packets=1, head=0):
    bursts = [full_burst(node, head, Parcel("reading", packets, PACKET_BITS, "reading"), 0) for node in sources]
    network.env.run(until=network.mac.send(bursts, head))
    return bursts


def test_with_slots_every_reading_arrives_without_collisions():
    slotted, contending = RadioNetwork(STAR, mac=skipping()), RadioNetwork(STAR, mac=Csma())
    assert all(burst.packets == 1 for burst in gather(slotted))
    assert slotted.counters.collided == 0 and slotted.counters.frames_sent == 9, "the schedule and eight readings"
    gather(contending)
    assert contending.counters.collided > 0


def test_a_round_has_one_slot_per_frame_and_the_schedule_is_announced_once():
    network = RadioNetwork(STAR, mac=skipping())
    gather(network)
    began = network.env.now
    gather(network)
    took = Tdma().contention + 8 * Tdma().slot_needed(29 * 8)
    assert network.env.now - began == pytest.approx(took, rel=1e-9)
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1
    gather(network, sources=range(1, 5))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1, "fewer members need no new schedule"


def test_members_that_the_head_expects_have_slots_from_the_first_schedule_on():
    network = RadioNetwork(STAR, mac=skipping())
    network.mac.expect(0, [0, *range(1, 9)])
    gather(network, sources=(1, 2))
    (first,) = [row for row in network.rows("send") if row["peer"] == -1]
    headers = 6 + 11
    assert first["bits"] == headers * 8 + 8 * Tdma().schedule_bits
    gather(network, sources=range(1, 9))
    assert sum(row["peer"] == -1 for row in network.rows("send")) == 1, "none of them needs another schedule"


def test_members_do_not_overhear_each_other_but_other_nodes_do():
    network = RadioNetwork([*STAR, (10, 10)], mac=skipping())
    gather(network, sources=range(1, 9))
    overheard = network.nodes.ledger.joules[CAUSE["overhear"]]
    assert (overheard[:9] == 0).all() and overheard[9] == pytest.approx(8 * 29 * 8 * 50e-9)


def test_members_turn_the_radio_off_in_the_slots_of_others():
    network = RadioNetwork(STAR, mac=skipping(contention=0.0), energy=FirstOrder(idle=0.06, sleep=0.001, battery=100.0))
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
    network = RadioNetwork(STAR, mac=skipping())
    network.nodes.jammed[3] = network.nodes.disturbed = True
    bursts = gather(network)
    assert [burst.packets for burst in bursts] == [1, 1, 0, 1, 1, 1, 1, 1]
    words = network.memory.words.all()
    assert {words[int(row["what"])] for row in network.rows("drop")} == {"no_schedule"}
    network.nodes.jammed[3] = False
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_member_whose_clock_is_off_by_more_than_the_guard_misses_its_slot_until_the_next_schedule():
    network = RadioNetwork(STAR, mac=skipping())
    gather(network)
    network.clocks.step([2], 1e-3)
    assert [burst.packets for burst in gather(network)] == [1, 0, 1, 1, 1, 1, 1, 1]
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_member_that_corrects_its_clock_keeps_its_slot():
    network = RadioNetwork(STAR, mac=skipping())
    network.clocks.step([3], 1e-4)  # clocks that are perfect are not corrected
    gather(network)
    network.clocks.correct(2, 5e-3)
    assert all(burst.packets == 1 for burst in gather(network))
    network.clocks.step([2], 1e-3)
    assert [burst.packets for burst in gather(network)] == [1, 0, 1, 1, 1, 1, 1, 1]


def test_a_frame_without_acknowledgement_gets_another_slot_at_the_end():
    shares = []
    for acks in (True, False):
        network = RadioNetwork(STAR, mac=skipping(acks=acks), link=Disk(reach=75.0, loss=0.3), seed=5)
        bursts = [burst for _ in range(30) for burst in gather(network)]
        had_slots = len(bursts) - sum(network.memory.words.all()[int(row["what"])] == "no_schedule"
                                      for row in network.rows("drop"))  # fmt: skip
        shares.append(sum(burst.packets for burst in bursts) / had_slots)
    assert shares[0] > 0.95 and shares[1] == pytest.approx(0.7, abs=0.08)


def test_a_burst_has_one_slot_per_frame_and_a_long_frame_several_slots_of_fixed_length():
    network = RadioNetwork(STAR, mac=skipping())
    assert [burst.packets for burst in gather(network, sources=[1, 2], packets=5)] == [5, 5]
    fixed = RadioNetwork(STAR, mac=skipping(slot=2e-3, contention=0.0))
    gather(fixed, sources=[1])
    began = fixed.env.now
    burst = full_burst(1, 0, Parcel("long", 1, 800, "reading"), 0)
    fixed.env.run(until=fixed.mac.send([burst], 0))
    needed = Tdma().slot_needed(8 * (17 + 100))
    assert fixed.env.now - began == pytest.approx(2e-3 * np.ceil(needed / 2e-3)) and burst.packets == 1


def test_a_round_goes_on_when_its_head_or_a_member_crashes():
    for victim in (0, 4):
        network = RadioNetwork(STAR, mac=skipping())
        gather(network)
        network.at(network.env.now + 5e-3, lambda network=network, victim=victim: network.nodes.crash(victim))
        network.at(network.env.now + 5e-3, lambda network=network, victim=victim: network.mac.silence(victim))
        began = network.env.now
        bursts = gather(network, packets=3)
        assert network.env.now - began < 24 * Tdma().slot_needed(29 * 8) + 0.1
        assert sum(burst.packets for burst in bursts) < 24


def test_rounds_of_one_head_do_not_overlap():
    network = RadioNetwork(STAR, mac=skipping())
    gather(network)
    bursts = [[full_burst(n, 0, Parcel("r", 1, PACKET_BITS, "reading"), t) for n in range(1, 9)] for t in (0, 1)]
    events = [network.mac.send(some, 0) for some in bursts]
    network.env.run(until=network.env.all_of(events))
    assert all(burst.packets == 1 for some in bursts for burst in some) and network.counters.collided == 0


@pytest.mark.parametrize("guard", [0.0, 50e-6, 95e-6, 250e-6])
def test_frames_arrive_with_guards_of_any_length(guard):
    network = RadioNetwork(STAR, mac=skipping(guard=guard))
    assert all(burst.packets == 1 for burst in gather(network))


def test_a_schedule_of_several_frames_is_known_only_after_receiving_all_of_them():
    network = RadioNetwork(STAR, mac=skipping(schedule_bits=1000), link=Disk(reach=75.0, loss=0.2), seed=2)
    gather(network)
    announced = [row for row in network.rows("receive") if row["peer"] == 0 and row["packets"] == 1]
    pieces = {node: sum(row["node"] == node for row in announced) for node in range(1, 9)}
    sent = sum(row["peer"] == -1 for row in network.rows("send"))
    assert sent > 3 and set(network.mac._schedules[0]) == {node for node, count in pieces.items() if count == sent}


def test_two_clusters_of_one_head_keep_each_others_schedule():
    network = RadioNetwork(STAR, mac=skipping())
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
    for mac in (skipping(), Csma(acks=False), Csma()):
        networks = [RadioNetwork(ring, mac=mac, seed=seed) for seed in range(10)]
        arrived[mac] = sum(burst.packets for network in networks for burst in joins(network, range(1, 17)))
    assert arrived[skipping()] > 140 > 100 > arrived[Csma()] > arrived[Csma(acks=False)], "of 160"
    network = RadioNetwork(ring, mac=skipping())
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
    network, readings, relayed = relayed_during_a_round(skipping(), source, to)
    assert all(readings) and network.counters.collided == 0
    assert sum(relayed) >= 48, "of 50: rounds that follow each other leave a contention period"


def test_only_nodes_in_range_of_the_head_or_a_member_hold_frames_back():
    ends = []
    for source in (9, 11):
        network = RadioNetwork([*CHAIN, (0, 180)], mac=skipping())
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
    network = RadioNetwork(CHAIN, mac=skipping(contention=0.0, min_be=0))
    gather(network)
    began, report = network.env.now, full_burst(9, 10, Parcel(None, 1, PACKET_BITS, "report"), 0)
    network.mac.send([report])
    network.env.run(until=began + 1e-3)
    assert all(burst.packets for burst in gather(network)) and report.packets == 1
    mac, slots = Tdma(), 8 * Tdma().slot_needed(29 * 8)
    exchange = mac.cca + mac.turnaround + mac.airtime(29 * 8) + mac.ack_wait
    assert network.env.now - began == pytest.approx(exchange + slots, rel=1e-6)


@pytest.mark.thorough
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
    network = RadioNetwork([(0, 0), (40, 0), (20, 0)], mac=skipping(acks=False, contention=0.0))
    for head in (0, 1):
        gather(network, sources=[2], head=head)  # the member learns both schedules
    both = [full_burst(2, head, Parcel("reading", 1, PACKET_BITS, "reading"), 0) for head in (0, 1)]
    network.env.run(until=network.env.all_of([network.mac.send([burst], burst.to) for burst in both]))
    assert [burst.packets for burst in both] == [1, 0]
    (row,) = network.rows("drop")
    assert (row["node"], row["peer"], row["frame"], row["packets"]) == (2, 1, 0, 1)
    assert network.memory.words.all()[row["what"]] == "slot_taken" and network.counters.frames_lost == 1


def kept(positions=STAR, members=range(1, 9), **components):
    """A network whose head 0 has announced a schedule of these members; idle slots are kept."""
    options = components.pop("options", {})
    network = RadioNetwork(positions, mac=Tdma(**options), **components)
    network.mac.expect(0, list(members))
    gather(network, sources=())
    network.env.run(until=network.env.now + 0.1)
    return network


SLOT = Tdma().slot_needed(29 * 8)


def arrivals(network, since):
    return {row["node"]: row["time"] - since for row in network.rows("send") if row["time"] >= since}


@pytest.mark.parametrize("sources", [(5,), (2, 8), (8, 2, 3), range(1, 9), ()])
def test_a_member_sends_in_its_own_slot_whoever_else_sends_and_a_round_takes_as_long_as_its_schedule(sources):
    network = kept()
    began = network.env.now
    bursts = gather(network, sources)
    assert network.env.now - began == pytest.approx(8 * SLOT, rel=1e-9)
    assert all(burst.packets == 1 for burst in bursts)
    guard, turnaround = Tdma().guard, Tdma().turnaround
    first = max(guard - turnaround, 0.0)
    sent = arrivals(network, began)
    assert sent.keys() == set(sources)
    for node, delay in sent.items():
        begins = (node - 1) * SLOT + first
        assert begins <= delay + 1e-12 <= begins + SLOT - guard, "the k-th slot begins k slot lengths after the first"
        assert delay == pytest.approx(sent[min(sources)] + (node - min(sources)) * SLOT, abs=1e-9)


def test_kept_slots_take_eight_times_as_long_for_one_frame_as_skipped_ones():
    took = []
    for idle in ("kept", "skipped"):
        network = RadioNetwork(STAR, mac=Tdma(idle_slots=idle, contention=0.0))
        network.mac.expect(0, range(1, 9))
        gather(network)
        began = network.env.now
        gather(network, sources=[3])
        took.append(network.env.now - began)
    assert took == pytest.approx([8 * SLOT, SLOT], rel=1e-9)


def test_a_schedule_of_kept_slots_is_announced_before_the_first_gathering_though_nobody_sends():
    network = kept()
    (schedule,) = network.rows("send")
    assert schedule["peer"] == -1 and schedule["bits"] == 17 * 8 + 8 * Tdma().schedule_bits
    assert network.mac._orders[0] == tuple(range(1, 9))


def test_a_new_schedule_replaces_the_one_before():
    network = kept()
    network.mac.expect(0, [2, 4])
    gather(network, sources=[4])
    assert network.mac._orders[0] == (2, 4) and network.mac._schedules[0].keys() == {2, 4}
    gather(network, sources=[7])
    network.env.run(until=network.env.now + 0.1)
    gather(network, sources=[7])
    assert network.mac._orders[0] == (2, 4, 7), "whose frame came without a slot has one in the next schedule"
    network.env.run(until=network.env.now + 0.1)
    began = network.env.now
    gather(network, sources=[7])
    assert network.env.now - began == pytest.approx(3 * SLOT, rel=1e-9)


@pytest.mark.parametrize("packets", [1, 2, 5])
def test_further_frames_of_a_member_go_into_further_rounds_of_the_same_length(packets):
    network = kept()
    began = network.env.now
    bursts = gather(network, sources=(1, 6), packets=packets)
    assert network.env.now - began == pytest.approx(packets * 8 * SLOT, rel=1e-9)
    assert [burst.packets for burst in bursts] == [packets] * 2


def test_a_frame_without_acknowledgement_is_sent_again_in_the_next_round():
    acknowledged = {"acks": True, "max_retries": 2}
    network = kept(options=acknowledged)
    network.nodes.jammed[0] = network.nodes.disturbed = True
    began = network.env.now
    (burst,) = gather(network, sources=(3,))
    slot = Tdma(acks=True).slot_needed(29 * 8)
    assert network.env.now - began == pytest.approx(3 * 8 * slot, rel=1e-9), "the first round and two more"
    assert burst.packets == 0 and network.counters.retries == 2


def test_frames_of_the_head_stand_in_the_slot_of_the_member_to_whom_they_are():
    network = kept()
    began = network.env.now
    bursts = [full_burst(0, node, Parcel("order", 1, PACKET_BITS, "order"), 0) for node in (7, 2)]
    network.env.run(until=network.mac.send(bursts, 0))
    sent = {row["peer"]: row["time"] - began for row in network.rows("send") if row["time"] >= began}
    assert sent[7] - sent[2] == pytest.approx(5 * SLOT, rel=1e-9) and [b.packets for b in bursts] == [1, 1]
    assert network.env.now - began == pytest.approx(8 * SLOT, rel=1e-9)


def test_the_head_listens_in_idle_slots_and_members_have_the_radio_off_in_all_slots_but_their_own():
    network = kept(energy=FirstOrder(idle=0.06, sleep=0.001, battery=100.0))
    began, before = network.env.now, network.nodes.totals_now()
    gather(network, sources=[4])
    took, spent = network.env.now - began, np.array(network.nodes.totals_now()) - np.array(before)
    assert took == pytest.approx(8 * SLOT)
    off = 8 * 8 * SLOT - SLOT
    assert spent[CAUSE["sleep"]] == pytest.approx(0.001 * off, rel=1e-6)
    on_air = 2 * 29 * 8 / 250e3
    assert spent[CAUSE["idle"]] == pytest.approx(0.06 * (9 * took - off - on_air), rel=1e-6), "8 slots of it the head's"
    network.nodes.close()
    assert network.ledger_adds_up()


def test_a_member_that_dies_keeps_its_slot_since_nobody_knows():
    for at in (0.0, 1.5 * SLOT):
        network = kept()
        began = network.env.now
        network.at(began + at + 1e-6, lambda network=network: network.nodes.crash(5))
        network.at(began + at + 1e-6, lambda network=network: network.mac.silence(5))
        bursts = gather(network, sources=(1, 5, 8))
        assert [burst.packets for burst in bursts] == [1, 0, 1]
        assert network.env.now - began == pytest.approx(8 * SLOT, rel=1e-9)


def test_a_member_that_did_not_hear_the_schedule_has_an_idle_slot():
    network = RadioNetwork(STAR, mac=Tdma())
    network.nodes.jammed[3] = network.nodes.disturbed = True
    network.mac.expect(0, range(1, 9))
    gather(network, sources=())
    assert network.mac._orders[0] == tuple(range(1, 9)) and 3 not in network.mac._schedules[0]


HOP = Tdma().latency(PACKET_BITS).unicast


def planned(nodes=(2, 5), **components):
    """A network whose head 0 has eight members, and slots only for some of them; the first round has ended."""
    network = kept(**components)
    network.mac.schedule(0, nodes)
    gather(network, sources=())
    network.env.run(until=network.env.now + 0.1)
    return network


def test_a_plan_has_slots_for_those_alone_that_are_expected_to_send_and_its_bits_are_paid():
    network = planned()
    schedule = [row for row in network.rows("send") if row["peer"] == -1][-1]
    assert schedule["bits"] == 17 * 8 + 2 * Tdma().schedule_bits and schedule["joules"] > 0.0
    began = network.env.now
    assert [burst.packets for burst in gather(network, sources=(2, 5))] == [1, 1]
    assert network.env.now - began == pytest.approx(2 * SLOT + HOP, rel=1e-9), "it listens for a frame more"
    began = network.env.now + 0.1
    network.env.run(until=began)
    gather(network, sources=())
    assert network.env.now - began == pytest.approx(2 * SLOT + HOP, rel=1e-9), "silence is as long"


@pytest.mark.parametrize(("nodes", "announced"), [((2, 5), 0), ((2,), 0), ((5, 6), 1), ((), 1), (range(1, 9), 1)])
def test_a_plan_is_announced_again_only_if_somebody_lacks_a_slot_or_most_slots_would_be_idle(nodes, announced):
    network = planned()
    before = sum(row["peer"] == -1 for row in network.rows("send"))
    network.mac.schedule(0, nodes)
    gather(network, sources=())
    assert sum(row["peer"] == -1 for row in network.rows("send")) - before == announced


def test_a_member_outside_the_plan_sends_after_the_round_and_has_a_slot_in_the_next_schedule():
    network = planned()
    began = network.env.now
    slotted, other = gather(network, sources=(2, 7))
    sent = arrivals(network, began)
    assert slotted.packets == other.packets == 1 and sent[2] < 2 * SLOT < sent[7]
    words = network.memory.words.all()
    assert sum(words[int(row["what"])] == "ack" for row in network.rows("send")) == 1, "it contends, acknowledged"
    gather(network, sources=(7,))
    assert network.mac._orders[0] == (2, 5, 7)


def test_many_members_outside_the_plan_contend_and_get_through():
    network = planned(nodes=())
    bursts = gather(network, sources=range(1, 9))
    assert sum(burst.packets for burst in bursts) >= 7 and network.mac._orders[0] == ()


def test_a_member_that_missed_a_schedule_of_all_sends_too_late_for_the_head_which_gives_it_a_slot():
    network = RadioNetwork(STAR, mac=Tdma())
    network.nodes.jammed[3] = network.nodes.disturbed = True
    network.mac.expect(0, range(1, 9))
    gather(network, sources=())
    network.nodes.jammed[3] = False
    network.env.run(until=network.env.now + 0.1)
    began = network.env.now
    slotted, late = gather(network, sources=(2, 3))
    assert slotted.packets == 1 and late.packets == 0 and late.heard is None
    assert network.env.now - began == pytest.approx(8 * SLOT, rel=1e-9), "it waits for nobody"
    network.env.run(until=network.env.now + 0.1)
    assert arrivals(network, began)[3] > 8 * SLOT, "the frame is sent and paid"
    assert late.heard.all() and late.heard_at - began > 8 * SLOT, "a head that uses late readings finds it"
    assert [burst.packets for burst in gather(network, sources=(2, 3))] == [1, 1]


def test_a_head_that_crashed_and_leads_again_announces_a_schedule_though_it_expects_the_same_members():
    network = kept()
    network.nodes.crash(0)
    network.mac.silence(0)
    network.nodes.restart(0, network.env.now)
    network.mac.expect(0, range(1, 9))
    assert [burst.packets for burst in gather(network)] == [1] * 8


@pytest.mark.parametrize("outage", [0.0, 1e-4, 3e-3, 8e-3])
@pytest.mark.parametrize("at", np.linspace(0.0, 0.04, 9))
def test_rounds_end_whenever_the_head_crashes_in_them_and_however_soon_it_is_back(at, outage):
    network = RadioNetwork(STAR, mac=Tdma())
    network.mac.expect(0, range(1, 9))
    parcel = Parcel("parcel", 1, PACKET_BITS, "parcel")
    bursts = [full_burst(*ends, parcel, 0) for node in range(1, 9) for ends in ((0, node), (node, 0))]

    def crash():
        network.nodes.crash(0)
        network.mac.silence(0)

    network.at(at, crash)
    network.at(at + outage, lambda: network.nodes.restart(0, network.env.now))
    network.env.run(until=network.env.all_of([network.mac.send(bursts[:5], 0), network.mac.send(bursts[5:], 0)]))
    network.mac.expect(0, range(1, 9))
    network.env.run(until=network.env.now + 0.1)
    assert [burst.packets for burst in gather(network)] == [1] * 8 and network.ledger_adds_up()


def test_who_contended_has_a_slot_in_the_next_schedule_though_the_plan_does_not_expect_it():
    network = planned()
    gather(network, sources=(7,))
    network.mac.schedule(0, (2, 5))
    gather(network, sources=())
    assert network.mac._orders[0] == (2, 5, 7)
    network.mac.schedule(0, (3, 4))
    gather(network, sources=())
    assert network.mac._orders[0] == (3, 4), "once announced it is as expected as others"


def test_who_missed_a_schedule_has_a_slot_in_the_next_one_though_the_plan_names_the_same_members():
    network = RadioNetwork(STAR, mac=Tdma())
    network.nodes.jammed[3] = network.nodes.disturbed = True
    network.mac.expect(0, range(1, 9))
    gather(network, sources=())
    network.nodes.jammed[3] = False
    arrived = []
    for _ in range(3):
        network.mac.schedule(0, (2, 3, 4, 5))
        arrived.append([burst.packets for burst in gather(network, sources=(2, 3))])
        network.env.run(until=network.env.now + 0.1)
    assert arrived == [[1, 0], [1, 1], [1, 1]]


def test_a_head_that_sends_to_a_member_outside_its_plan_gives_it_a_slot():
    network = kept()
    network.mac.schedule(0, (2,))
    burst = full_burst(0, 5, Parcel("parcel", 1, PACKET_BITS, "parcel"), 0)
    network.env.run(until=network.mac.send([burst], 0))
    assert burst.packets == 1 and network.mac._orders[0] == (2, 5)


def test_a_head_without_members_listens_for_a_frame_and_pays_for_it():
    network = RadioNetwork(STAR, mac=Tdma(), energy=FirstOrder(idle=0.06, battery=100.0))
    before = np.array(network.nodes.totals_now())
    gather(network, sources=())
    spent = np.array(network.nodes.totals_now()) - before
    assert network.env.now == pytest.approx(HOP, rel=1e-9) and not network.rows("send")
    assert spent[CAUSE["idle"]] == pytest.approx(0.06 * 9 * HOP, rel=1e-6)


def test_scenarios_whose_rounds_cannot_fit_are_refused():
    for changes, says in (
        (["mac.slot=35 ms"], "a round of one slot of 0.035 s and mac.contention = 0.00704 s are longer than a step"),
        (["clusters={kind: moving_head}"], "would wait for a whole round"),
    ):
        with pytest.raises(ScenarioError, match=says):
            build(load("ekf_real", changes))


@pytest.mark.thorough
def test_a_head_waits_for_a_round_of_kept_slots_though_no_member_senses():
    ends = {}
    for idle in ("skipped", "kept"):
        memory = Memory({"events": True, "estimates": True})
        changes = ["duration=2 s", f"mac.idle_slots={idle}", "detection={kind: imperfect, missed: 0.9}"]
        simulate_run(load("information_driven_real", changes), recorder=memory)
        found = memory.table("estimates")
        alone = found["readings"] <= 1
        assert alone.any()
        ends[idle] = (found["issued"] - 0.04 * found["step"])[alone]
    assert np.nanmedian(ends["skipped"]) < 0.01 < 0.012 < np.nanmedian(ends["kept"])
