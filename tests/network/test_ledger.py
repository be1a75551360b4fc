"""The energy ledger against sums by hand."""

import numpy as np
import pytest

from wsnsim.base.tables import CAUSE
from wsnsim.network.energy.ledger import EnergyLedger

CPU, RX, IDLE = CAUSE["cpu"], CAUSE["rx"], CAUSE["idle"]


def adds_up(ledger):
    per_node = np.allclose(ledger.joules.sum(axis=0), ledger.spent, rtol=1e-12, atol=0.0)
    return per_node and ledger.totals == pytest.approx(ledger.joules.sum(axis=1).tolist(), rel=1e-12)


@pytest.mark.parametrize("size", [3, 56])
def test_every_way_of_booking_adds_to_the_node_the_cause_and_the_total(size):
    ledger, nodes = EnergyLedger(size), np.arange(size)
    ledger.book(0, CPU, 0.5)
    ledger.book_transmission(1, 0.25, 0.125)
    ledger.book_charges(2, [(CPU, 0.5), (IDLE, 0.25)])
    ledger.book_same(nodes, RX, 0.0625)
    ledger.book_each(nodes[:2], IDLE, np.array([1.0, 2.0]))
    assert ledger.spent[:3].tolist() == [1.5625, 2.4375, 0.8125] and adds_up(ledger)
    assert ledger.joules[RX].tolist() == [0.0625] * size and ledger.totals[CPU] == 1.0


def test_the_last_charges_of_a_node_and_the_rest_empty_its_battery():
    ledger = EnergyLedger(2)
    ledger.book(0, CPU, 0.5)
    assert ledger.book_last(0, [(RX, 0.25)], battery=1.0) == 0.25
    assert ledger.spent.tolist() == [1.0, 0.0] and ledger.joules[IDLE, 0] == 0.25 and adds_up(ledger)


def test_the_ceiling_is_never_below_what_a_living_node_has_spent_and_comes_down_when_recomputed():
    ledger, living = EnergyLedger(3), np.array([True, True, False])
    ledger.book(2, CPU, 5.0)
    for _ in range(4):
        ledger.book_same(np.array([0, 1]), RX, 1.0)
    assert ledger.ceiling == 9.0
    assert ledger.lower_ceiling(living) == 4.0 == ledger.ceiling


@pytest.mark.parametrize("size", [3, 56])
def test_all_below_compares_the_listed_nodes_alone(size):
    ledger, nodes = EnergyLedger(size + 1), np.arange(size)
    ledger.book(size, CPU, 5.0)
    assert ledger.all_below(1.0, nodes)
    ledger.book(0, CPU, 1.0)
    assert not ledger.all_below(1.0, nodes)
