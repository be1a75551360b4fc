"""TSCH's own synchronisation: corrections, time parents, the guard, and nodes that lose the time and join again."""

from collections import Counter

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.hardware import DriftingClock
from wsnsim.models.tsch import Tsch

PAIR = [(0, 0), (50, 0)]
LINE = [(50.0 * node, 0) for node in range(-2, 3)]
FIELD = np.random.default_rng(3).uniform(0, 150, (25, 2))
UNSYNCHRONISED = {"keep_alive": None, "eb_period": None}


class Rates:
    """Clocks of given rates."""

    def __init__(self, *rates):
        self._rates = np.array(rates)

    def rates(self, keys):
        return self._rates


def sync_of(network):
    return network.mac._sync


def errors(network):
    """(N,) how far clocks are ahead of that of the coordinator, in s."""
    ahead = network.clocks.error(np.arange(network.nodes.size), network.env.now)
    return ahead - ahead[sync_of(network)._coordinator]


def words(network, *kinds):
    names = network.memory.words.all()
    return Counter(names[int(row["what"])] for row in network.rows(*kinds))


def test_perfect_clocks_need_neither_beacons_nor_keep_alives():
    network = RadioNetwork(FIELD, mac=Tsch())
    assert network.env.peek() == float("inf")


@pytest.mark.parametrize("rate", [1.0 + 20e-6, 1.0 - 20e-6])
def test_a_frame_is_received_until_the_clocks_are_apart_by_the_guard(rate):
    """20 ppm against a guard of 1.1 ms: 55 s."""
    mac = Tsch(slotframe=11, max_retries=0, **UNSYNCHRONISED)
    for second, arrives in ((10, 1), (54, 1), (56, 0), (90, 0)):
        network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, rate), horizon=1e3)
        network.env.run(until=float(second))
        assert network.unicast(0, 1).packets == arrives, second


def test_frames_and_acknowledgements_correct_clocks_without_being_asked_for():
    network = RadioNetwork(PAIR, mac=Tsch(slotframe=11, **UNSYNCHRONISED), clock=Rates(1.0, 1 + 40e-6), horizon=1e3)
    arrived = []
    for second in range(10, 210, 10):
        network.env.run(until=float(second))
        arrived.append(network.unicast(0, 1).packets)
    assert arrived == [1] * 20 and set(words(network, "send")) == {"test", "ack"}


def test_beacons_alone_correct_clocks_too():
    mac = Tsch(slotframe=11, keep_alive=None, eb_period=5.0)
    network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, 1 + 40e-6), horizon=1e3)
    network.env.run(until=200.0)
    assert np.abs(errors(network)).max() < 40e-6 * 5.5 + mac.tick
    assert set(words(network, "send")) == {"eb"}


def test_slots_begin_by_the_local_clock():
    network = RadioNetwork(PAIR, mac=Tsch(slotframe=100, **UNSYNCHRONISED), clock=Rates(1.0 - 40e-6, 1.0), horizon=1e3)
    network.env.run(until=20.5)
    network.unicast(0, 1)
    begun = network.rows("send")[0]["time"] - 29 * 8 / 250e3 - 2.12e-3
    assert begun == pytest.approx(21.0 / (1.0 - 40e-6), abs=1e-7), "0.84 ms late"


def test_acknowledgements_keep_a_clock_within_a_tick_and_its_drift():
    """The sink sends nothing; its child asks every five seconds. 60 ppm in 5 s are 0.3 ms."""
    mac = Tsch(slotframe=11, eb_period=None, keep_alive_compensated=None)
    network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, 1.0 + 60e-6), horizon=1e3)
    worst = 0.0
    for second in range(1, 200):
        network.env.run(until=float(second))
        worst = max(worst, float(np.abs(errors(network)).max()))
    assert 0.2e-3 < worst < 60e-6 * (5.0 + 2 * 0.11) + mac.tick
    sent = words(network, "send")
    assert set(sent) == {"keep_alive", "ack"} and 199 / 5.2 <= sent["keep_alive"] <= 199 / 3.75 + 1
    network.nodes.close()
    assert network.nodes.ledger.spent.min() > 0.0, "it is paid"


def test_a_rate_that_is_estimated_makes_keep_alives_rare():
    mac = Tsch(slotframe=11, eb_period=None)
    network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, 1.0 + 60e-6), horizon=1e4)
    network.env.run(until=1200.0)
    assert 1200 / 60 <= words(network, "send")["keep_alive"] <= 1200 / 45 + 1
    assert np.abs(errors(network)).max() < 2 * mac.tick / 5.0 * 60.0


def test_corrections_are_rounded_to_ticks():
    mac = Tsch(slotframe=11, eb_period=None, keep_alive_compensated=None, tick=1e-3 / 3)
    network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, 1.0 + 60e-6), horizon=1e3)
    network.env.run(until=100.0)
    assert np.abs(errors(network)).max() > 1e-4, "a sixth of a millisecond is not seen"


def test_beacons_correct_everybody_who_has_their_sender_as_time_parent():
    mac = Tsch(slotframe=11, eb_period=4.0, keep_alive_compensated=None)
    network = RadioNetwork([(0, 0), (40, 0), (-40, 0)], mac=mac, clock=Rates(1.0, 1 + 50e-6, 1 - 50e-6), horizon=1e3)
    network.env.run(until=300.0)
    assert np.abs(errors(network)).max() < 50e-6 * 5 + mac.tick
    sent = words(network, "send")
    assert sent["eb"] == pytest.approx(3 * 75, abs=3) and sent["keep_alive"] < 30


def test_time_comes_from_the_sink_or_the_middle_over_the_fewest_hops():
    network = RadioNetwork(LINE, mac=Tsch(), clock=DriftingClock())
    assert sync_of(network)._coordinator == 2
    assert sync_of(network)._hops.tolist() == [2, 1, 0, 1, 2]
    assert sync_of(network)._parents.tolist() == [1, 2, -1, 2, 3]


def test_a_network_keeps_the_time_over_several_hops():
    network = RadioNetwork(FIELD, mac=Tsch(slotframe=31), clock=DriftingClock(sd=30e-6), horizon=1e4)
    network.env.run(until=150.0)
    alone = RadioNetwork(FIELD, mac=Tsch(slotframe=31, **UNSYNCHRONISED), clock=DriftingClock(sd=30e-6), horizon=1e4)
    alone.env.run(until=150.0)
    assert np.abs(errors(alone)).max() > 5e-3
    assert np.abs(errors(network)).max() < Tsch().guard
    assert network.ledger_adds_up()


def test_beacons_do_not_pile_up():
    mac = Tsch(slotframe=101, eb_period=0.05)
    network = RadioNetwork(PAIR, mac=mac, clock=Rates(1.0, 1.0 + 1e-6), horizon=1e3)
    network.env.run(until=20.0)
    assert all(len(network.mac._leases.shared_line(node).queue) <= 1 for node in (0, 1))


def test_a_node_whose_time_parent_is_silent_takes_the_next_best():
    places = [(0, 0), (40, 0), (40, 30), (90, 10)]
    network = RadioNetwork(places, mac=Tsch(slotframe=11), clock=DriftingClock(sd=10e-6), horizon=1e4)
    sync = sync_of(network)
    first, child = int(sync._parents[3]), 3
    assert first in (1, 2) and network.topology.connected(child, 3 - first)
    network.nodes.crash(first)
    network.mac.silence(first)
    taken = set()
    for second in range(1, 120):
        network.env.run(until=float(second))
        taken.add(int(sync._parents[child]))
    assert taken >= {first, 3 - first}


def test_a_node_that_was_stepped_loses_the_time_scans_and_joins_by_a_beacon():
    """It scans one of 16 channels, on which each neighbour's beacon falls once in 16 periods."""
    mac = Tsch(slotframe=11, eb_period=2.0)
    network = RadioNetwork(FIELD[:8], mac=mac, clock=DriftingClock(sd=10e-6), horizon=1e4)
    network.env.run(until=10.0)
    node = 7 if sync_of(network)._coordinator != 7 else 6
    network.clocks.step([node], 0.5)
    lost = joined = None
    for tenth in range(101, 3000):
        network.env.run(until=tenth / 10)
        if lost is None and network.mac._radios.is_scanning(node):
            lost = network.env.now
        if lost is not None and not network.mac._radios.is_scanning(node):
            joined = network.env.now
            break
    assert lost is not None and 10.0 < lost < 10.0 + 2.2 * mac.keep_alive_compensated
    assert joined is not None and abs(errors(network)[node]) < mac.guard
    assert words(network, "drop")["no_time"] >= 1
    network.nodes.close()
    assert network.ledger_adds_up()


def test_a_node_without_the_time_sends_nothing_and_its_bursts_end():
    network = RadioNetwork(FIELD[:8], mac=Tsch(slotframe=11), clock=DriftingClock(sd=10e-6), horizon=1e4)
    node = 7 if sync_of(network)._coordinator != 7 else 6
    waits = full_burst(node, EVERYONE, Parcel("reading", 1, PACKET_BITS, "reading"), 0)
    ended = network.mac.send([waits])
    sync_of(network).lose(node)
    network.env.run(until=ended)
    assert waits.received == {} and waits.sent == 0
    assert network.unicast(node, 0 if node else 1).packets == 0
    assert "reading" not in words(network, "send")


@pytest.mark.thorough
def test_clocks_that_begin_wrong_must_join_first():
    mac = Tsch(slotframe=7, eb_period=1.0)
    network = RadioNetwork(FIELD[:6], mac=mac, clock=DriftingClock(sd=10e-6, offset=0.2), horizon=1e4)
    radios = network.mac._radios
    assert sum(radios.is_scanning(node) for node in range(6)) == 5
    network.env.run(until=400.0)
    assert not any(radios.is_scanning(node) for node in range(6))
    assert np.abs(errors(network)).max() < mac.guard


def test_a_node_that_restarts_scans():
    network = RadioNetwork(FIELD[:8], mac=Tsch(slotframe=11), clock=DriftingClock(sd=10e-6), horizon=1e4)
    node = 7 if sync_of(network)._coordinator != 7 else 6
    network.nodes.crash(node)
    network.mac.silence(node)
    network.nodes.restart(node, network.env.now)
    network.mac.restart(node)
    assert network.mac._radios.is_scanning(node)
