"""Background consumption against sums by hand; the instant of a death by idling; reading energy changes nothing."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.radio import Mode
from wsnsim.base.tables import CAUSE
from wsnsim.models.energy import FirstOrder

IDLE, SLEEP, CPU, SWITCH = (CAUSE[name] for name in ("idle", "sleep", "cpu", "switch"))
PAIR = [(0, 0), (50, 0)]


def idle_pair(battery=100.0, horizon=10.0, **changes):
    return RadioNetwork(PAIR, energy=FirstOrder(battery=battery, idle=0.06, sleep=0.002, **changes), horizon=horizon)


def test_an_idle_node_pays_for_listening_when_its_energy_is_read():
    network = idle_pair()
    network.env.run(until=4.0)
    assert network.nodes.ledger.spent.tolist() == [0.0, 0.0], "nothing is booked before it must be"
    assert network.nodes.residual_energy(0) == pytest.approx(100.0 - 4 * 0.06)
    assert network.nodes.totals_now()[IDLE] == pytest.approx(2 * 4 * 0.06)
    network.nodes.close()
    assert network.nodes.ledger.joules[IDLE].tolist() == pytest.approx([0.24, 0.24]) and network.ledger_adds_up()


def test_reading_energy_at_any_time_changes_nothing_to_the_last_bit():
    books = []
    for looks in (False, True):
        network = idle_pair()
        for time in np.linspace(0.1, 5, 40) if looks else ():
            network.at(
                float(time),
                lambda network=network: (
                    network.nodes.residual_energy(0),
                    network.nodes.residual_energies(),
                    network.nodes.totals_now(),
                ),
            )
        network.at(2.0, lambda network=network: network.nodes.spend(0, CPU, 1e-3))
        network.unicast(0, 1)
        network.env.run(until=6.0)
        network.nodes.close()
        books.append(network.nodes.ledger.joules.copy())
    assert np.array_equal(*books)


def test_a_radio_does_not_idle_while_it_sends_or_receives():
    network = idle_pair()
    network.unicast(0, 1)
    network.env.run(until=1.0)
    network.nodes.close()
    on_air = (29 + 11) * 8 / 250e3
    assert network.nodes.ledger.joules[IDLE].tolist() == pytest.approx([0.06 * (1.0 - on_air)] * 2, rel=1e-12)
    assert network.nodes.totals_now()[IDLE] == pytest.approx(network.nodes.ledger.totals[IDLE], rel=1e-12)


def test_each_mode_is_paid_for_its_duration_and_each_change_for_its_switch():
    network = idle_pair(switch=0.01)
    network.at(1.0, lambda: network.nodes.set_mode(0, Mode.ASLEEP))
    network.at(4.0, lambda: network.nodes.set_mode(0, Mode.AWAKE))
    network.env.run(until=5.0)
    network.nodes.close()
    assert network.nodes.ledger.joules[IDLE, 0] == pytest.approx(0.06 * 2.0)
    assert network.nodes.ledger.joules[SLEEP, 0] == pytest.approx(0.002 * 3.0)
    assert network.nodes.ledger.joules[SWITCH, 0] == pytest.approx(0.02)
    assert network.nodes.totals_now() == pytest.approx(network.nodes.ledger.totals, rel=1e-12)


def test_a_node_dies_of_idling_at_the_instant_its_charge_is_gone():
    network = idle_pair(battery=0.3)
    network.at(2.0, lambda: network.nodes.spend(1, CPU, 0.06))
    network.env.run(until=10.0)
    assert network.died == [(pytest.approx(4.0), 1), (pytest.approx(5.0), 0)]
    assert network.nodes.ledger.spent.tolist() == [0.3, 0.3] and network.ledger_adds_up()
    assert network.nodes.totals_now() == pytest.approx(network.nodes.ledger.totals, rel=1e-9)


def test_time_in_which_the_radio_is_busy_delays_a_death_by_idling():
    idle, busy = idle_pair(battery=0.3), idle_pair(battery=0.3)
    for i in range(200):
        busy.at(0.01 * i + 1e-6, lambda: busy.mac.offer(1, 800, lambda heard: None))
    idle.env.run(until=10.0)
    busy.env.run(until=10.0)
    heard = 200 * 117 * 8 / 250e3
    assert {node: time for time, node in idle.died}[0] == pytest.approx(5.0)
    received = 200 * 117 * 8 * 50e-9
    expected = (0.3 - received) / 0.06 + heard
    assert {node: time for time, node in busy.died}[0] == pytest.approx(expected, rel=1e-6)


def test_a_node_that_is_down_consumes_nothing_and_keeps_its_charge():
    network = idle_pair(battery=0.3)
    network.at(1.0, lambda: network.nodes.crash(0))
    network.at(7.0, lambda: network.nodes.restart(0, 7.0))
    network.env.run(until=9.0)
    assert network.nodes.residual_energy(0) == pytest.approx(0.3 - 3 * 0.06)
    network.nodes.close()
    assert network.ledger_adds_up()


def test_a_battery_that_outlasts_the_run_needs_no_timer():
    network = idle_pair(battery=100.0)
    assert network.env.peek() == float("inf"), "no event waits in the queue"


def test_a_model_in_which_time_costs_nothing_has_no_background_consumption():
    assert RadioNetwork(PAIR, energy=FirstOrder()).nodes.consumption.most == 0.0


def test_changes_of_mode_cost_even_where_waiting_does_not():
    network = RadioNetwork(PAIR, energy=FirstOrder(switch=0.01))
    network.nodes.set_mode(0, Mode.AWAKE)
    network.nodes.set_mode(0, Mode.DORMANT)
    assert network.nodes.ledger.joules[SWITCH, 0] == pytest.approx(0.02)


def test_a_frame_paid_in_advance_stays_paid_when_the_mode_changes_during_it():
    network = idle_pair()
    network.mac.offer(0, 800, lambda heard: None)
    network.at(3e-3, lambda: network.nodes.set_mode(0, Mode.ASLEEP))
    network.at(3e-3, lambda: network.nodes.set_mode(1, Mode.ASLEEP))
    network.env.run(until=1.0)
    before = network.nodes.totals_now()
    network.nodes.close()
    assert before == pytest.approx(network.nodes.ledger.totals, rel=1e-6) and network.ledger_adds_up()


def test_a_node_that_spends_often_before_it_runs_out_sets_few_timers():
    network = idle_pair(battery=0.3)
    for i in range(2000):
        network.at(0.001 * i + 1e-6, lambda: network.nodes.spend(0, CPU, 1e-6))
    network.env.run(until=1.9999)
    assert len(network.nodes.consumption.battery_watch.timers) < 60
    network.env.run(until=10.0)
    assert {node: time for time, node in network.died}[0] == pytest.approx((0.3 - 0.002) / 0.06, rel=1e-9)
