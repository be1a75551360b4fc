"""What nodes spend and have left, without background consumption."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.network.ledgers import SPENT, books
from wsnsim.base.tables import CAUSES
from wsnsim.models.links import Disk
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.topology import Topology


def nodes_in_a_line(battery: float = 1.0, count: int = 5) -> Nodes:
    positions = np.column_stack([np.arange(count) * 10.0, np.zeros(count)])
    return Nodes(positions, np.ones((count, 1)), battery, 15.0)


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 8), st.floats(0, 0.4)), max_size=60))
@example([(0, 0, 1 / 3)] * 3)  # 1 - 2/3 is more than 1/3, and yet the sum is 1
def test_the_sum_over_causes_is_what_a_node_spent_and_never_more_than_its_battery(charges):
    nodes = nodes_in_a_line()
    for node, cause, joules in charges:
        if nodes.alive[node]:
            nodes.spend(node, cause, joules)
    for node, book in books(nodes).items():
        assert sum(book[:SPENT]) == pytest.approx(book[SPENT], rel=1e-9, abs=1e-15)
        assert book[SPENT] <= 1.0
        assert nodes.alive[node] == (book[SPENT] < 1.0)
    assert sum(nodes.ledger.totals) == pytest.approx(
        sum(book[SPENT] for book in books(nodes).values()), rel=1e-9, abs=1e-15
    )


def test_a_cost_above_the_residual_energy_is_paid_in_part_and_the_node_dies():
    died = []
    nodes = nodes_in_a_line(battery=1.0)
    nodes.on_death = died.append
    assert nodes.spend(2, CAUSES.index("cpu"), 0.75) == 0.75
    assert nodes.spend_transmit(2, 0.3, 0.2, bits=7) == 3, "half of seven bits, whole ones only"
    assert died == [2]
    book = dict(zip(CAUSES, books(nodes)[2], strict=False))
    assert book["tx_electronics"] == pytest.approx(0.3 * 3 / 7)
    assert book["tx_amplifier"] == pytest.approx(0.2 * 3 / 7)
    assert book["idle"] == pytest.approx(0.25 - 0.5 * 3 / 7), "less than a bit's worth is lost"
    assert nodes.residual_energy(2) == 0.0
    assert nodes.spend_receive(1, 0.25, bits=8) == 8 and nodes.spend_receive(1, 1.5, bits=8) == 4
    assert died == [2, 1]


def test_reading_energy_changes_nothing_in_the_ledger():
    nodes = nodes_in_a_line()
    assert nodes.residual_energy(3) == 1.0
    assert nodes.able(0.5).all()
    assert nodes.residual_energies().tolist() == [1.0] * 5
    assert books(nodes) == {}


def test_neighbours_are_those_within_reach_without_oneself():
    graph = Topology(nodes_in_a_line(), Disk(reach=15.0), 1, 96)
    assert graph.neighbours(0).id_list == [1]
    assert graph.neighbours(2).id_list == [1, 3]
