"""Batteries in runs: deaths against closed forms, stores that are charged again, and a ledger that closes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import CAUSES, KIND, LOSSES, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.batteries import BatteryFields, Diffusion, Kinetic, Linear
from wsnsim.models.energy import FirstOrder
from wsnsim.models.harvest import Harvester
from wsnsim.models.sleep import DutyCycle
from wsnsim.scenario import build, load

PLACES: Final = [(0.0, 0.0), (30.0, 0.0), (0.0, 30.0)]
TRACE: Final = "time,power\n0,0\n3,0.05\n5,0.01\n6.5,0.2\n"
BATTERIES: Final[dict[str, BatteryFields]] = {
    "leaking": Linear(self_discharge=1.0, activation=2e5, temperature=80.0),
    "cut off": Linear(cut_off=2.0),
    "kinetic": Kinetic(rate=0.3, self_discharge=0.1),
    "diffusion": Diffusion(rate=2.0, usable=0.9),
}


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """A file with the powers of a harvester over 8 s."""
    path = tmp_path / "trace.csv"
    path.write_text(TRACE)
    return path


def run_of(values: dict[str, Any], name: str = "pso_mhpf") -> Memory:
    """The tables of a shortened run."""
    memory = Memory()
    replicate_of(
        build(load(name, {"duration": "8 s", "deploy.nodes": 100, "tracker.particles": 20, **values})), 0, memory
    )
    return memory


def demand_closed_ledger(memory: Memory) -> None:
    """At every node, initial and harvested energy is what was spent, lost and left, to 1e-9."""
    nodes, energy = memory.table("nodes"), memory.table("energy")
    booked = np.bincount(energy["node"].astype(int), energy["joules"], len(nodes["node"]))
    had = nodes["energy_initial"] + nodes.get("harvested", 0.0)
    finite = np.isfinite(had)
    np.testing.assert_allclose((booked + nodes["energy_left"])[finite], had[finite], rtol=1e-9, atol=1e-15)
    assert (energy["joules"] > -1e-15).all()
    by_cause = (
        np.bincount(rows["cause"], rows["joules"], len(CAUSES)) for rows in (energy, memory.table("energy_steps"))
    )
    np.testing.assert_allclose(*by_cause, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", BATTERIES)
@pytest.mark.parametrize("spends", [False, True])
def test_a_node_dies_when_the_closed_form_says_so(kind: str, spends: bool) -> None:
    battery, idle, total = BATTERIES[kind], 0.05, 0.3
    network = RadioNetwork(PLACES, energy=FirstOrder(idle=idle, battery=total), battery=battery)
    setup: Any = type("Setup", (), {"energy": FirstOrder(battery=total)})
    state = battery.draw(setup, 3, (), np.random.default_rng(0))
    begun, load = 0.0, np.full(3, idle)
    if spends:  # 10 mJ at once after 0.7 s
        network.at(0.7, lambda: network.nodes.spend(0, CAUSES.index("cpu"), 0.01))
        state = battery.draw_at_once(battery.advance(state, load, 0.7).state, np.array([0.01, 0.0, 0.0]))
        begun = 0.7
    expected = begun + battery.advance(state, load, 100.0).died_after
    network.env.run(until=20.0)
    died = {node: time for time, node in network.died}
    np.testing.assert_allclose([died[node] for node in range(3)], expected, rtol=0.0, atol=1e-7)
    assert network.nodes.ledger.joules.sum(axis=0) == pytest.approx(np.full(3, total), rel=1e-9)


@pytest.mark.parametrize("kind", BATTERIES)
def test_nodes_on_schedules_die_and_their_ledgers_close(kind: str) -> None:
    sleep = DutyCycle(period=0.5, awake_share=0.3)
    network = RadioNetwork(
        PLACES, energy=FirstOrder(idle=0.2, sleep=0.01, switch=1e-3, battery=0.3), battery=BATTERIES[kind], sleep=sleep
    )
    network.env.run(until=20.0)
    assert len(network.died) == 3
    assert network.nodes.ledger.joules.sum(axis=0) == pytest.approx(np.full(3, 0.3), rel=1e-9)


CHARGED: Final = {
    "leaking": {"kind": "linear", "self_discharge": 1.0, "temperature": 90.0, "activation": 3e5},
    "spread": {"kind": "linear", "spread": 0.3, "usable": 0.5},
    "uniform": {"kind": "linear", "spread": 0.3, "law": "uniform", "mains": [4, 17]},
    "residual": {"kind": "linear", "residual": [0.0 if i % 7 == 0 else 0.004 for i in range(100)]},
    "kinetic": {"kind": "kinetic"},
    "diffusion": {"kind": "diffusion"},
}


@pytest.mark.parametrize("battery", CHARGED)
def test_the_ledger_of_every_node_closes(battery: str) -> None:
    memory = run_of({"energy.battery": "5 mJ", "battery": CHARGED[battery]})
    assert memory.table("events")["kind"].tolist().count(KIND["death"]) > 0
    demand_closed_ledger(memory)


def test_harvesting_nodes_close_their_ledgers_and_come_back(trace: Path) -> None:
    harvest = {"path": str(trace), "restart": 0.4}
    memory = run_of({"energy.battery": "2 mJ", "battery": {"kind": "linear", "harvest": harvest}})
    kinds = memory.table("events")["kind"].tolist()
    assert kinds.count(KIND["crash"]) == kinds.count(KIND["restart"]) > 0
    assert KIND["death"] not in kinds
    assert np.isnan(memory.table("nodes")["died_at"]).all()
    demand_closed_ledger(memory)


def test_a_store_empties_and_restarts_at_its_level(trace: Path) -> None:
    harvest = Harvester(path=str(trace), charging=0.8, restart=0.25)
    network = RadioNetwork(PLACES, energy=FirstOrder(idle=0.04, battery=0.1), battery=Linear(harvest=harvest))
    nodes, back = network.nodes, []

    def recharge(node: int) -> None:
        back.append((network.env.now, node))
        nodes.restart(node, network.env.now)

    nodes.on_recharge = recharge
    nodes.on_death = lambda node: network.died.append((network.env.now, node))
    network.env.run(until=9.0)
    # empty after 2.5 s; from 3 s on 0.04 W are stored: 0.025 J at 3.625 s; the load is then as much until 5 s; then it
    # is 0.032 W more: empty at 5.78125 s; 0.008 W to 6.5 s, then 0.16 W: 0.025 J at 6.6203125 s
    assert [time for time, _ in network.died] == pytest.approx([2.5] * 3 + [5.78125] * 3)
    assert [time for time, _ in back] == pytest.approx([3.625] * 3 + [6.6203125] * 3)
    nodes.close()
    stored = nodes.storage.left(np.arange(3), np.zeros(3))
    lost = nodes.ledger.joules.sum(axis=0)
    assert 0.1 + nodes.storage.harvested == pytest.approx(lost + stored, rel=1e-9)


def test_a_fault_keeps_a_charged_node_down_until_it_is_over(trace: Path) -> None:
    crash = {"kind": "crash", "at": "1 s", "duration": "5 s", "fraction": 1.0}
    harvest = {"path": str(trace), "restart": 0.4}
    drain = {"kind": "drain", "at": "0.5 s", "share": 1.0, "fraction": 1.0}
    values = {"energy.battery": "5 mJ", "battery": {"kind": "linear", "harvest": harvest}, "faults": [drain, crash]}
    events = run_of(values).table("events")
    restarts = events["time"][events["kind"] == KIND["restart"]]
    assert restarts.size >= 100
    assert restarts.min() == pytest.approx(6.0)  # the store is full again before


def test_batteries_that_are_alike_leave_a_run_as_it_was() -> None:
    plain = run_of({"energy.battery": "10 mJ"})
    listed = run_of({"energy.battery": "1 J", "battery": {"kind": "linear", "capacities": [0.01] * 100}})
    for table in ("events", "energy", "nodes"):
        for name, column in plain.table(table).items():
            # what is left is found from other sums
            np.testing.assert_allclose(column, listed.table(table)[name], rtol=1e-12 * (name == "energy_left"))


def test_mains_never_end_and_their_joules_are_counted() -> None:
    values = {"energy.battery": "10 mJ", "battery": {"kind": "linear", "mains": list(range(100))}}
    memory = run_of(values)
    free = run_of({"energy.battery": ".inf"})
    assert KIND["death"] not in memory.table("events")["kind"]
    for name, column in memory.table("energy").items():
        np.testing.assert_array_equal(column, free.table("energy")[name])


def test_a_sink_on_mains_outlives_a_network_that_starts_with_nothing() -> None:
    residual = [1e-9] * 100
    values = {"battery": {"kind": "linear", "residual": residual, "sink_on_mains": True}}
    values |= {"sink": {"kind": "node", "x": 0.0, "y": 0.0}}
    nodes = run_of(values).table("nodes")
    assert np.isinf(nodes["energy_initial"]).sum() == 1
    assert nodes["energy_initial"].min() == 1e-9


def test_dead_nodes_at_the_start_book_nothing_and_die_at_once() -> None:
    residual = [0.0] * 10 + [2.0] * 90
    memory = run_of({"battery": {"kind": "linear", "residual": residual}})
    nodes, energy = memory.table("nodes"), memory.table("energy")
    assert (nodes["died_at"][:10] == 0.0).all()
    assert nodes["energy_initial"][:10].tolist() == [0.0] * 10
    assert energy["node"].min() >= 10


def test_batteries_come_from_a_file_by_the_names_of_nodes(tmp_path: Path) -> None:
    (tmp_path / "nodes.csv").write_text("id,x,y\nb,0,0\na,20,0\nc,40,10\n")
    (tmp_path / "batteries.csv").write_text("id,battery,residual\na,2,1.5\nb,3,3\nc,4,0.5\n")
    deploy = {"kind": "file", "path": str(tmp_path / "nodes.csv"), "fit": True, "margin": 10.0, "cover": False}
    values = {"deploy": deploy, "battery": {"kind": "linear", "path": str(tmp_path / "batteries.csv")}}
    memory = Memory()
    replicate_of(build(load("beacons", {"duration": "4 s", **values})), 0, memory)
    assert memory.table("nodes")["energy_initial"].tolist() == [3.0, 1.5, 0.5]


def test_spread_has_a_random_stream_of_its_own_and_the_stated_size() -> None:
    spread, plain = run_of({"battery": {"kind": "linear", "spread": 0.1}}), run_of({})
    initial = spread.table("nodes")["energy_initial"]
    assert initial.std() == pytest.approx(0.2, rel=0.2)
    assert abs(initial.mean() - 2.0) < 0.08
    for name, column in plain.table("events").items():
        np.testing.assert_array_equal(column, spread.table("events")[name])


WRONG: Final = {
    "capacities": ({"capacities": [1.0, 2.0]}, "battery.capacities: error: 2 values for 100 nodes"),
    "residual": ({"residual": [3.0] * 100}, "battery.residual: error: node 0 has 3 J, more than its capacity of 2 J"),
    "mains": ({"mains": [100]}, "battery.mains: error: no node 100: the 100 nodes are numbered from 0"),
    "cut off": ({"cut_off": 3.0}, "battery.cut_off: error: 3 V must be from empty = 0 V to full = 3 V"),
    "restart": ({"usable": 0.5, "harvest": {"path": "x.csv"}}, "harvest.restart: must be above 0.5"),
    "trace": ({"harvest": {"path": "x.csv"}}, "battery.harvest.path: "),
    "file": ({"path": "x.csv"}, "battery.path: "),
}
FILES: Final = {
    "unknown": ("id,battery\n" + "".join(f"{i},1\n" for i in range(99)) + "x,1\n", "'x' is no node"),
    "twice": ("id,battery\n" + "".join(f"{i},1\n" for i in range(100)) + "7,1\n", "'7' has two rows"),
    "missing": ("id,battery\n" + "".join(f"{i},1\n" for i in range(99)), "'99' is missing"),
    "negative": ("id,battery\n" + "".join(f"{i},{5 - i}\n" for i in range(100)), ":7: battery must be above 0 J"),
    "text": ("id,battery\n0,full\n", ":2: "),
}
TRACES: Final = {
    "both": ("time,power,irradiance\n0,1,1\n", "give one of the columns"),
    "none": ("time\n0\n", "give one of the columns"),
    "order": ("time,power\n1,1\n1,2\n", ":3: times must ascend"),
    "below zero": ("time,irradiance\n0,-3\n", ":2: a power is at least 0"),
}


def demand_message(battery: dict[str, Any], message: str) -> None:
    """A scenario with this battery is refused with one message."""
    with pytest.raises(ScenarioError) as refused:
        build(load("pso_mhpf", {"deploy.nodes": 100, "battery": {"kind": "linear", **battery}}))
    assert message in str(refused.value)
    assert len(refused.value.issues) == 1


@pytest.mark.parametrize("case", WRONG)
def test_wrong_parameters_have_one_message_each(case: str) -> None:
    demand_message(*WRONG[case])


@pytest.mark.parametrize("case", [*FILES, *TRACES])
def test_wrong_files_have_one_message_each(case: str, tmp_path: Path) -> None:
    content, message = (FILES | TRACES)[case]
    path = tmp_path / "given.csv"
    path.write_text(content)
    demand_message({"path": str(path)} if case in FILES else {"harvest": {"path": str(path)}}, message)


def test_losses_are_causes_of_their_own_and_not_spent() -> None:
    memory = run_of({"energy.battery": "10 mJ", "battery": {"kind": "kinetic"}})
    energy = memory.table("energy")
    stranded = energy["cause"] == CAUSES.index("stranded")
    assert stranded.any()
    assert set(LOSSES) < set(CAUSES)
