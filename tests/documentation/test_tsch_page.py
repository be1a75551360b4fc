"""The figures of docs/tsch.md are those of runs."""

from pathlib import Path

import numpy as np
import pytest

from tests.network.low_power import low_power
from tests.network.plain_shared_cells import throughput
from tests.network.test_tsch import SIMULATOR, saturated
from wsnsim.models.tsch import Tsch

PAGE = Path(__file__).parents[2] / "docs" / "tsch.md"


def table(header):
    """The rows of the table with this first column, as numbers."""
    lines = PAGE.read_text(encoding="utf-8").split(f"| {header} ")[1].splitlines()[2:]
    rows = [line.strip("|").split("|") for line in lines[: lines.index("")]]
    return [[float(value) for value in row] for row in rows]


@pytest.mark.parametrize(("slotframe", "on", "power"), table("slotframe (slots)"))
def test_the_power_of_idle_nodes_is_that_of_runs(slotframe, on, power):
    mac = Tsch(slotframe=int(slotframe))
    network = low_power(mac, horizon=200 * mac.interval)
    network.env.run(until=100 * mac.interval)
    share = network.nodes.consumption.radio_on()
    network.nodes.close()
    assert 100.0 * share == pytest.approx(on, abs=0.00051)
    assert 1e6 * network.nodes.ledger.spent[0] / (100 * mac.interval) == pytest.approx(power, abs=0.51)


def test_the_capacities_of_the_simulator_are_those_of_the_tests():
    shown = {int(senders): others for senders, *_, others in table("senders")}
    assert shown == {senders: pytest.approx(np.mean(found), abs=0.00051) for senders, found in SIMULATOR.items()}


@pytest.mark.thorough
@pytest.mark.parametrize(("senders", "ours", "plain", "simulator"), table("senders")[::2])
def test_the_capacities_are_those_of_runs(senders, ours, plain, simulator):
    """Those of two and four senders are compared in `tests/network/test_tsch.py`."""
    assert saturated(int(senders), 20_000) == pytest.approx(ours, abs=0.00051)
    assert throughput(int(senders), 200_000, seed=int(senders))[0] == pytest.approx(plain, abs=0.00051)
