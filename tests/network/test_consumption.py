"""What time costs, against hand counts; death by idling at its instant; reading changes nothing."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.radio import Mode
from wsnsim.base.tables import CAUSE
from wsnsim.models.energy import FirstOrder

IDLE, SLEEP, CPU, SWITCH = (CAUSE[name] for name in ("idle", "sleep", "cpu", "switch"))
PAIR = [(0, 0), (50, 0)]


def place(battery=100.0, horizon=10.0, **changes):
    return RadioNetwork(PAIR, energy=FirstOrder(battery=battery, idle=0.06, sleep=0.002, **changes), horizon=horizon)


def test_a_node_that_does_nothing_pays_for_listening_when_somebody_looks():
    here = place()
    here.env.run(until=4.0)
    assert here.nodes.ledger.spent.tolist() == [0.0, 0.0], "nothing is booked before it must be"
    assert here.nodes.residual_energy(0) == pytest.approx(100.0 - 4 * 0.06)
    assert here.nodes.totals_now()[IDLE] == pytest.approx(2 * 4 * 0.06)
    here.nodes.close()
    assert here.nodes.ledger.joules[IDLE].tolist() == pytest.approx([0.24, 0.24]) and here.ledger_adds_up()


def test_reading_energy_at_any_time_changes_nothing_to_the_last_bit():
    books = []
    for looks in (False, True):
        here = place()
        for time in np.linspace(0.1, 5, 40) if looks else ():
            here.at(
                float(time),
                lambda here=here: (
                    here.nodes.residual_energy(0),
                    here.nodes.residual_energies(),
                    here.nodes.totals_now(),
                ),
            )
        here.at(2.0, lambda here=here: here.nodes.spend(0, CPU, 1e-3))
        here.unicast(0, 1)
        here.env.run(until=6.0)
        here.nodes.close()
        books.append(here.nodes.ledger.joules.copy())
    assert np.array_equal(*books)


def test_a_radio_does_not_idle_while_it_sends_or_receives():
    here = place()
    here.unicast(0, 1)
    here.env.run(until=1.0)
    here.nodes.close()
    on_air = (29 + 11) * 8 / 250e3
    assert here.nodes.ledger.joules[IDLE].tolist() == pytest.approx([0.06 * (1.0 - on_air)] * 2, rel=1e-12)
    assert here.nodes.totals_now()[IDLE] == pytest.approx(here.nodes.ledger.totals[IDLE], rel=1e-12)


def test_modes_are_paid_for_as_long_as_they_last_and_changes_cost_their_switch():
    here = place(switch=0.01)
    here.at(1.0, lambda: here.nodes.set_mode(0, Mode.ASLEEP))
    here.at(4.0, lambda: here.nodes.set_mode(0, Mode.AWAKE))
    here.env.run(until=5.0)
    here.nodes.close()
    assert here.nodes.ledger.joules[IDLE, 0] == pytest.approx(0.06 * 2.0)
    assert here.nodes.ledger.joules[SLEEP, 0] == pytest.approx(0.002 * 3.0)
    assert here.nodes.ledger.joules[SWITCH, 0] == pytest.approx(0.02)
    assert here.nodes.totals_now() == pytest.approx(here.nodes.ledger.totals, rel=1e-12)


def test_a_node_dies_of_idling_at_the_instant_its_charge_is_gone():
    here = place(battery=0.3)
    here.at(2.0, lambda: here.nodes.spend(1, CPU, 0.06))
    here.env.run(until=10.0)
    assert here.died == [(pytest.approx(4.0), 1), (pytest.approx(5.0), 0)]
    assert here.nodes.ledger.spent.tolist() == [0.3, 0.3] and here.ledger_adds_up()
    assert here.nodes.totals_now() == pytest.approx(here.nodes.ledger.totals, rel=1e-9)


def test_what_the_radio_pays_elsewhere_delays_a_death_by_idling():
    idle, busy = place(battery=0.3), place(battery=0.3)
    for i in range(200):
        busy.at(0.01 * i + 1e-6, lambda: busy.mac.offer(1, 800, lambda heard: None))
    idle.env.run(until=10.0)
    busy.env.run(until=10.0)
    heard = 200 * 117 * 8 / 250e3
    assert {node: time for time, node in idle.died}[0] == pytest.approx(5.0)
    received = 200 * 117 * 8 * 50e-9
    expected = (0.3 - received) / 0.06 + heard
    assert {node: time for time, node in busy.died}[0] == pytest.approx(expected, rel=1e-6)


def test_a_node_that_is_down_draws_nothing_and_goes_on_from_the_charge_it_had():
    here = place(battery=0.3)
    here.at(1.0, lambda: here.nodes.crash(0))
    here.at(7.0, lambda: here.nodes.restart(0))
    here.env.run(until=9.0)
    assert here.nodes.residual_energy(0) == pytest.approx(0.3 - 3 * 0.06)
    here.nodes.close()
    assert here.ledger_adds_up()


def test_a_battery_that_outlasts_the_run_needs_no_alarm():
    here = place(battery=100.0)
    assert here.env.peek() == float("inf"), "no event waits in the queue"


def test_a_model_without_a_draw_has_no_drain():
    assert RadioNetwork(PAIR, energy=FirstOrder()).nodes.consumption.most == 0.0


def test_changes_of_mode_cost_even_where_waiting_does_not():
    here = RadioNetwork(PAIR, energy=FirstOrder(switch=0.01))
    here.nodes.set_mode(0, Mode.AWAKE)
    here.nodes.set_mode(0, Mode.DORMANT)
    assert here.nodes.ledger.joules[SWITCH, 0] == pytest.approx(0.02)


def test_what_is_paid_in_advance_stays_paid_when_the_mode_changes_in_mid_frame():
    here = place()
    here.mac.offer(0, 800, lambda heard: None)
    here.at(3e-3, lambda: here.nodes.set_mode(0, Mode.ASLEEP))
    here.at(3e-3, lambda: here.nodes.set_mode(1, Mode.ASLEEP))
    here.env.run(until=1.0)
    before = here.nodes.totals_now()
    here.nodes.close()
    assert before == pytest.approx(here.nodes.ledger.totals, rel=1e-6) and here.ledger_adds_up()


def test_many_spends_of_a_node_that_runs_dry_set_few_alarms():
    here = place(battery=0.3)
    for i in range(2000):
        here.at(0.001 * i + 1e-6, lambda: here.nodes.spend(0, CPU, 1e-6))
    here.env.run(until=1.9999)
    assert len(here.nodes.consumption.timers) < 60
    here.env.run(until=10.0)
    assert {node: time for time, node in here.died}[0] == pytest.approx((0.3 - 0.002) / 0.06, rel=1e-9)
