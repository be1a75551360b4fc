"""Batteries of sleeping nodes: deaths against a closed form; nobody spends more than it has, whatever is dearest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.helpers.sleeping_networks import Run, scenario
from tests.network.radio_network import RadioNetwork
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.sleeping import SleepSchedule
from wsnsim.base.tables import CAUSES
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import FirstOrder, States
from wsnsim.models.sleep import DutyCycle, EventWake, RandomIndependent
from wsnsim.network.energy.ledger import affordable

PLACES = [(0.0, 0.0), (30.0, 0.0), (0.0, 30.0)]
SEED, HORIZON = 11, 10.0
SYNCHRONOUS = DutyCycle(period=1.0, awake_share=0.5, phases="synchronous")
IDLE, SLEEP, SWITCH = (CAUSES.index(name) for name in ("idle", "sleep", "switch"))


def spells(schedule: SleepSchedule, node: int) -> Iterator[tuple[float, float, bool]]:
    """(begin, end, awake) of all spells of a node in which its schedule does not change."""
    key = derive_all(Streams(SEED, 0).key("sleep"), np.array([node]))
    begin, end, awake = 0.0, 0.0, bool(schedule.awake(key, 0.0)[0])
    while end < HORIZON:
        end = float(schedule.state(key, end)[2][0])
        after = bool(schedule.awake(key, end)[0])
        if after != awake or end >= HORIZON:
            yield begin, end, awake
            begin, awake = end, after


def death(schedule: SleepSchedule, node: int, awake: float, asleep: float, change: float, battery: float) -> float:
    """When a node that only sleeps and wakes is out of charge, spell by spell: powers in W, the rest in J."""
    for begin, end, is_awake in spells(schedule, node):
        power = awake if is_awake else asleep
        if power * (end - begin) >= battery:
            return begin + battery / power
        battery -= power * (end - begin) + change
        if battery <= 0.0:
            return end
    return np.inf


def assert_deaths(energy: Any, schedule: SleepSchedule, awake: float, asleep: float, change: float) -> None:
    """The nodes of a network without any traffic die when the closed form says so, and spend no more than they have."""
    network = RadioNetwork(PLACES, seed=SEED, horizon=HORIZON, energy=energy, sleep=schedule)
    network.env.run(until=HORIZON)
    died = {node: time for time, node in network.died}
    for node in range(len(PLACES)):
        earliest, latest = (
            death(schedule, node, awake, asleep, change, energy.battery * share) for share in (1.0 - 1e-9, 1.0 + 1e-9)
        )
        if latest < HORIZON:
            assert earliest - 2e-9 <= died[node] <= latest + 2e-9
        assert node not in died or earliest <= HORIZON
    totals = network.nodes.totals_now() + network.nodes.consumption.network.scheduled(np.array([HORIZON]))[0]
    network.nodes.close()
    spent = network.nodes.ledger.spent
    assert (spent <= energy.battery * (1.0 + 1e-9)).all() and network.ledger_adds_up()
    spells_at_most = 2 * len(PLACES) * (HORIZON / schedule.period + 1)  # each one's ends are times up to the horizon
    rounding = np.finfo(float).eps * HORIZON * spells_at_most * max(awake, asleep)
    assert totals == pytest.approx(network.nodes.ledger.totals, rel=1e-6, abs=1e-7 * spent.sum() + rounding)


def price(low: float, high: float) -> st.SearchStrategy[float]:
    """Nothing, or any price between these."""
    return st.just(0.0) | st.floats(np.log10(low), np.log10(high)).map(lambda power: 10.0**power)


WATTS, JOULES, SECONDS = price(1e-4, 1.0), price(1e-5, 0.3), price(1e-4, 2e-2)
BATTERIES = st.floats(-3.0, 0.3).map(lambda power: 10.0**power)
SCHEDULES = st.one_of(
    st.builds(DutyCycle, period=st.floats(0.05, 4.0), awake_share=st.floats(0.01, 1.0),
              phases=st.sampled_from(["synchronous", "staggered"])),
    st.builds(RandomIndependent, period=st.floats(0.05, 4.0), probability=st.floats(0.0, 1.0)),
)  # fmt: skip


@given(st.builds(FirstOrder, idle=WATTS, sleep=WATTS, switch=JOULES, battery=BATTERIES), SCHEDULES)
@example(FirstOrder(battery=0.1, sleep=0.05), DutyCycle(period=1.0, awake_share=0.3))
@example(FirstOrder(battery=0.1, idle=0.01, sleep=0.05), DutyCycle(period=1.0, awake_share=0.3))
@example(FirstOrder(battery=0.1, sleep=0.05), RandomIndependent(period=0.4, probability=0.5))
@example(FirstOrder(battery=0.1, idle=1.0, switch=0.04), DutyCycle(period=2.0, awake_share=0.01))
@example(FirstOrder(battery=1.0, sleep=1.0), DutyCycle(period=1.0, awake_share=1.0 - 1e-16))
@example(FirstOrder(battery=1.0, sleep=0.9), DutyCycle(period=0.1, awake_share=1.0 - 1e-16))
def test_nodes_that_only_sleep_and_wake_die_when_their_schedule_has_used_their_charge(energy, schedule):
    assert_deaths(energy, schedule, energy.idle, energy.sleep, energy.switch)


@st.composite
def datasheets(draw: st.DrawFn, switching: st.SearchStrategy[float] = SECONDS) -> States:
    """Any prices of every state of a radio and a processor, and times of changes between them."""
    watts, seconds = lambda: draw(WATTS), lambda: draw(switching)
    radio = RadioSheet(
        name="any", source="none", rate=250e3, receive=watts(), listen=watts(), levels=(0.0,), transmit=(watts(),),
        sleep=watts(), wake=seconds(), wake_power=watts(), doze=seconds(), doze_power=watts(), turnaround=192e-6,
        turnaround_power=watts(), sensitivity=-95.0, noise=-100.0,
    )  # fmt: skip
    rate = 10.0 ** draw(st.floats(4.0, 7.0))
    processor = ProcessorSheet(
        name="any", source="none", rate=rate, run=watts(), idle=watts(), sleep=watts(), wake=seconds()
    )
    return States(radio=radio, processor=processor, battery=draw(BATTERIES), sensing=draw(price(1e-6, 3e-2)))


@pytest.mark.thorough
@given(datasheets(), SCHEDULES)
def test_by_datasheets_too_whichever_state_is_the_dearest(energy, schedule):
    radio, processor = energy.radio, energy.processor
    changes = radio.wake * radio.wake_power + radio.doze * radio.doze_power + processor.wake * processor.run
    assert_deaths(energy, schedule, radio.listen + processor.idle, radio.sleep + processor.sleep, changes / 2.0)


def test_a_radio_that_sleeps_for_a_slot_at_a_higher_price_brings_death_forward():
    energy = FirstOrder(battery=0.3, idle=0.06, sleep=0.6)
    network = RadioNetwork(PLACES, energy=energy, sleep=EventWake())
    network.at(4.0, lambda: network.nodes.sleep_radios(np.array([0]), 0.05))
    network.env.run(until=HORIZON)
    assert {node: time for time, node in network.died} == {
        0: pytest.approx(4.05 + (0.3 - 4.0 * 0.06 - 0.05 * 0.6) / 0.06), 1: pytest.approx(5.0), 2: pytest.approx(5.0),
    }  # fmt: skip


def test_a_frame_dearer_than_a_battery_is_paid_from_what_the_time_before_has_left():
    network = RadioNetwork(PLACES, energy=FirstOrder(battery=1.0, switch=0.01), sleep=SYNCHRONOUS)
    bits = []
    network.at(4.2, lambda: bits.append(network.nodes.spend_transmit(0, 5.0, 0.0, 100)))
    network.at(4.2, lambda: bits.append(network.nodes.spend_receive(1, 5.0, 100)))
    network.env.run(until=5.0)
    assert bits == [18, 18], "eight changes of mode leave 0.92 J for a frame of 5 J"
    assert network.nodes.ledger.joules[SWITCH, :2].tolist() == pytest.approx([0.08, 0.08])


def test_of_a_change_that_a_node_cannot_pay_nothing_is_taken_from_what_lasted_before():
    assert affordable([(IDLE, 2.0), (SWITCH, 5.0)], 3.0) == ((IDLE, 2.0), (SWITCH, pytest.approx(1.0)))
    assert affordable([(IDLE, 2.0), (SLEEP, 2.0), (SWITCH, 5.0)], 3.0) == ((IDLE, 1.5), (SLEEP, 1.5), (SWITCH, 0.0))


QUICK = price(1e-6, 5e-4)
"""Times of changes (s) that leave a radio on in time for every slot, call and schedule of `networks`."""
PRICED = ("receive", "listen", "sleep", "wake", "wake_power", "doze", "doze_power", "turnaround_power", "run", "idle")
ROLES_OF_TARGETS = ("motion", "sensor", "lost", "wakeup", "clusters", "acquire", "sink", "tracker", "cpu")
LAWS = st.sampled_from([{"kind": "always_on"}, {"kind": "event_wake"}]) | st.one_of(
    st.fixed_dictionaries({"kind": st.just("duty_cycle"), "period": st.floats(0.1, 3.0),
                           "awake_share": st.floats(0.1, 0.98) | st.just(1.0),
                           "phases": st.sampled_from(["synchronous", "staggered"])}),
    st.fixed_dictionaries({"kind": st.just("ris"), "period": st.floats(0.1, 3.0), "probability": st.floats(0.0, 1.0)}),
)  # fmt: skip
PRICES = st.fixed_dictionaries({
    "kind": st.just("first_order"), "battery": BATTERIES, "idle": WATTS, "sleep": WATTS, "switch": JOULES,
    "sensing": price(1e-6, 3e-2), "electronics": price(1e-9, 1e-5), "amplifier": price(1e-13, 1e-9),
    "capacitance": price(1e-11, 1e-7),
})  # fmt: skip
FAULTS = st.lists(st.sampled_from([
    {"kind": "drain", "fraction": 0.5, "share": 0.7}, {"kind": "drain", "fraction": 0.5, "joules": 0.01},
    {"kind": "crash", "fraction": 0.5, "duration": 1.0}, {"kind": "restart", "fraction": 0.5, "duration": 0.1},
]), max_size=2)  # fmt: skip
MACS = st.sampled_from(
    [{"kind": "csma"}, {"kind": "tdma", "idle_slots": "skipped"}, {"kind": "ideal"}, {"kind": "ideal", "rate": 250e3}]
)


def states(energy: States) -> dict[str, Any]:
    """The energy model as a scenario says it."""
    sheets = {"radio": energy.radio, "processor": energy.processor}
    fields = {role: {key: value for key, value in asdict(sheet).items() if value} for role, sheet in sheets.items()}
    return {"kind": "states", "battery": energy.battery, "sensing": energy.sensing} | {
        role: {key: 0.0 for key in type(sheets[role]).__annotations__ if key in PRICED} | fields[role]
        for role in sheets
    }


def without_targets(said: dict[str, Any], step: float) -> dict[str, Any]:
    """The same network, whose nodes broadcast beacons."""
    kept = {key: value for key, value in said.items() if key not in ROLES_OF_TARGETS}
    kept["faults"] = [{**fault, "at": fault["at"] * 50 * step} for fault in said.get("faults", [])]
    return kept | {"workload": {"kind": "beacons", "period": 0.05, "bits": 96}, "duration": 200 * step, "step": step}


@st.composite
def networks(draw: st.DrawFn) -> dict[str, Any]:
    """Small networks that sleep, with any prices of whatever costs energy: trackers with wake-ups, and beacons."""
    energy = draw(PRICES | datasheets(QUICK).map(states))
    said = scenario(
        draw(st.sampled_from(["gmtt", "tsstp", "cluster", "ris"])),
        seed=draw(st.integers(1, 99)), duration=4.0, step=draw(st.sampled_from([1.0, 2.0])),
        energy=energy, sleep=draw(LAWS), mac=draw(MACS),
        cpu={"rate": energy.get("processor", {"rate": 1e6})["rate"], "cycles_per_flop": 3.5},
        deploy={"kind": "uniform", "nodes": 8, "width": 80.0, "height": 80.0, "cover": False},
        motion={"kind": "random_waypoint", "width": 60.0, "height": 60.0}, lost={"window": 2.0},
    )  # fmt: skip
    said["faults"] = [{**fault, "at": draw(st.floats(0.0, 3.99))} for fault in draw(FAULTS)]
    beacons = said["mac"]["kind"] != "tdma" and draw(st.booleans())
    return without_targets(said, draw(st.sampled_from([0.001, 0.02]))) if beacons else said


def energy_of(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """The joules that each node spent (N,), and the joules of the rows of `energy_steps`."""
    table, rows = run.table("energy"), run.table("energy_steps")
    size = run.table("nodes")["node"].size
    spent = np.bincount(table["node"].astype(int), table["joules"], size) if table else np.zeros(size)
    return spent, rows["joules"] if rows else np.zeros(1)


@pytest.mark.thorough
@given(networks())
def test_nobody_spends_more_than_its_battery_and_no_step_gives_energy_back(said):
    run = Run(said)
    spent, rows = energy_of(run)
    assert (spent <= run.table("nodes")["energy_initial"] * (1.0 + 1e-9)).all()
    assert rows.min() >= -1e-12 * spent.sum()
    assert rows.sum() == pytest.approx(spent.sum(), rel=1e-9, abs=1e-12)


def test_a_frame_under_way_at_the_end_of_a_step_gives_no_energy_back():
    energy = {"kind": "first_order", "battery": 2.0, "idle": 0.06}
    said = without_targets(scenario(energy=energy, sleep={"kind": "event_wake"}), step=1e-3)
    said["deploy"] = {"kind": "uniform", "nodes": 3, "width": 40.0, "height": 40.0, "cover": False}
    spent, rows = energy_of(Run(said))
    assert rows.min() >= 0.0 and rows.sum() == pytest.approx(spent.sum(), rel=1e-12)
