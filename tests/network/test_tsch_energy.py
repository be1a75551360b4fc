"""The energy of TSCH: idle cells by the closed form, and each slot with a frame as a hand computes it."""

import numpy as np
import pytest

from tests.helpers.random_setups import PROCESSOR, RADIO
from tests.network.radio_network import RadioNetwork
from tests.network.test_tsch import STAR, gather
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE
from wsnsim.models.energy import States
from wsnsim.models.tsch import Tsch

STATES = States(radio=RADIO, processor=PROCESSOR, battery=1e4)
START, STOP = RADIO.wake * RADIO.wake_power, RADIO.doze * RADIO.doze_power
GUARD, FULL, ANSWER = 1.1e-3, 2.2e-3, 0.2e-3


def network_of(mac, places=STAR, **given):
    return RadioNetwork(places, mac=mac, energy=given.pop("energy", STATES), horizon=1e3, **given)


def joules(network, cause):
    return network.nodes.ledger.joules[CAUSE[cause]]


def listened(network):
    """Seconds of listening of each node until now; ends the run. The processor sleeps meanwhile."""
    network.nodes.close()
    return joules(network, "idle") / RADIO.listen


@pytest.mark.parametrize("mac", [Tsch(), Tsch(slotframe=31), Tsch(shared=5), Tsch(rx_wait=1e-3, slotframe=7)])
def test_the_power_of_idle_cells_is_the_closed_form(mac):
    network = network_of(mac)
    seconds = 40 * mac.interval
    assert network.env.peek() > 10 * seconds, "idle slots are no events"
    network.env.run(until=seconds)
    share = mac.shared * mac.rx_wait / mac.interval
    assert listened(network) / seconds == pytest.approx(share, rel=1e-9)
    per_second = mac.shared / mac.interval
    assert joules(network, "switch") / seconds == pytest.approx(per_second * (START + STOP), rel=1e-9)
    off = 1.0 - share - per_second * (RADIO.wake + RADIO.doze)
    asleep = RADIO.sleep * off + PROCESSOR.sleep
    assert joules(network, "sleep") / seconds == pytest.approx(asleep, rel=1e-9)


def test_an_exchange_in_the_shared_cell_costs_what_a_hand_computes():
    """The sender listens for 0.2 ms before the acknowledgement; all others for half the guard time, then to the end."""
    network = network_of(Tsch(slotframe=31))
    network.unicast(0, 1)
    network.env.run(until=0.31)
    assert listened(network) == pytest.approx([ANSWER] + [GUARD] * 8, rel=1e-9)
    frame, ack = 29 * 8 / 250e3 * RADIO.receive, 19 * 8 / 250e3 * RADIO.receive
    assert joules(network, "rx") == pytest.approx([ack, frame] + [0.0] * 7)
    assert joules(network, "overhear") == pytest.approx([0.0, 0.0] + [frame] * 7)
    assert network.ledger_adds_up()


@pytest.mark.parametrize("senders", [1, 2, 3])
def test_those_who_hear_a_collision_listened_once_and_pay_for_one_frame(senders):
    network = network_of(Tsch(slotframe=31))
    for node in range(1, senders + 1):
        network.mac.send([full_burst(node, EVERYONE, Parcel("reading", 1, PACKET_BITS, "reading"), 0)])
    network.env.run(until=0.31)
    totals = network.nodes.totals_now()
    assert totals[CAUSE["idle"]] / RADIO.listen == pytest.approx((9 - senders) * GUARD, rel=1e-9)
    assert totals[CAUSE["rx"]] / RADIO.receive == pytest.approx((9 - senders) * 29 * 8 / 250e3, rel=1e-9)


def test_a_frame_that_nobody_acknowledges_costs_the_whole_wait():
    network = network_of(Tsch(slotframe=31, max_retries=0), places=STAR[:3])
    network.nodes.crash(1)
    network.unicast(0, 1)
    network.env.run(until=0.31)
    assert listened(network)[[0, 2]] == pytest.approx([0.4e-3, GUARD])


def test_cells_of_ones_own_cost_their_receiver_where_they_are_idle_and_nobody_else():
    """Eight cells are announced in slot 0. Each has one frame, and is taken back with its acknowledgement."""
    mac = Tsch(slotframe=31)
    network = network_of(mac)
    gather(network)
    network.env.run(until=0.62)
    idle = listened(network)
    shared = np.array([0.0] + [GUARD] * 8) + FULL
    members = shared[1:] + ANSWER
    assert idle[1:] == pytest.approx(members, rel=1e-9), "a sender does not listen in its cell but for its answer"
    last = max(int(row["time"] / mac.slot) for row in network.rows("send")) / 31
    assert shared[0] + 8 * GUARD - 8 * FULL <= idle[0] <= shared[0] + 8 * (FULL * last + GUARD)
    assert network.ledger_adds_up()


def test_the_head_pays_for_cells_that_nobody_uses_until_the_lease_is_over():
    mac = Tsch(slotframe=31, lease=4)
    network = network_of(mac)
    network.mac.expect(0, range(3, 9))
    gather(network, sources=(1, 2))
    assert len(network.mac._radios.receiving[0]) == 6
    network.env.run(until=10 * mac.interval)
    own = listened(network)[0] - 9 * FULL
    assert own == pytest.approx(6 * 4 * FULL + 2 * GUARD, rel=0.12), "closed form: the mean over a slotframe"


def test_the_radio_of_a_node_is_on_for_the_share_that_the_duty_says():
    network = network_of(Tsch())
    network.env.run(until=101.0)
    assert network.nodes.consumption.radio_on() == pytest.approx(2.2e-3 / 1.01, rel=1e-9)


@pytest.mark.parametrize("battery", [2e-3, 5e-3])
def test_nodes_die_at_the_instant_that_their_listening_empties_the_battery(battery):
    mac = Tsch(slotframe=5)
    network = network_of(mac, energy=States(radio=RADIO, processor=PROCESSOR, battery=battery))
    network.env.run(until=900.0)
    rate = (mac.rx_wait * RADIO.listen + START + STOP) / mac.interval + PROCESSOR.sleep
    off = 1.0 - (mac.rx_wait + RADIO.wake + RADIO.doze) / mac.interval
    assert [time for time, _ in network.died] == pytest.approx([battery / (rate + RADIO.sleep * off)] * 9, rel=1e-6)
