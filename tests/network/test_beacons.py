"""Networks without targets: the counters agree with the event log, and the log with the radio model."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from wsnsim.base.rng import Streams
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import CAUSE, KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.batteries import Linear
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.deploy import Uniform
from wsnsim.models.energy import FirstOrder, States
from wsnsim.models.faults import Blackout, Crash
from wsnsim.models.hardware import DriftingClock, NoPacking, NoSync, PerfectClock, Processor
from wsnsim.models.links import Disk, MinimumEnergy
from wsnsim.models.sleep import EventWake
from wsnsim.models.workloads import Periodic
from wsnsim.network.workload_world import WorkloadWorld

REACH, AIRTIME, TURNAROUND = 75.0, 29 * 8 / 250e3, 192e-6
SEND, RECEIVE, COLLIDE, DROP = (KIND[name] for name in ("send", "receive", "collide", "drop"))
RADIO = RadioSheet(
    name="X", source="none", rate=250e3, receive=62e-3, listen=62e-3, levels=(0.0,), transmit=(57.42e-3,), sleep=0.0,
    wake=0.0, wake_power=0.0, doze=0.0, doze_power=0.0, turnaround=0.0, turnaround_power=0.0, sensitivity=-95.0,
    noise=-100.0,
)  # fmt: skip
PROCESSOR = ProcessorSheet(name="X", source="none", rate=8e6, run=5.4e-3, idle=0.0, sleep=0.0, wake=0.0)


def beacon_setup(**changes):
    """The set-up of the comparison of simulators: 12 bytes per second for 20 s in an 800 m square."""
    values = {
        "name": "beacons",
        "seed": 3,
        "steps": 19,
        "dt": 1.0,
        "deploy": Uniform(nodes=400, width=800.0, height=800.0),
        "energy": FirstOrder(),
        "link": Disk(reach=REACH),
        "mac": Csma(),
        "packing": NoPacking(),
        "routing": MinimumEnergy(),
        "sleep": EventWake(),
        "cpu": Processor(),
        "clock": PerfectClock(),
        "sync": NoSync(),
        "battery": Linear(),
        "workload": Periodic(),
    }
    return BeaconSetup(**{**values, **changes})


def run_of(made):
    """One run: its outcome, event log, tables and node positions."""
    streams, memory = Streams(made.seed, 0), Memory({**RECORDED_BY_DEFAULT, "links": True})
    positions = made.deploy.draw(REACH, streams("deploy"))
    world = WorkloadWorld(made, 0, positions, streams, memory)
    outcome = world.run()
    return SimpleNamespace(
        setup=made,
        outcome=outcome,
        beacons=world.workload.sent,
        memory=memory,
        log=memory.table("events"),
        positions=positions,
    )


@cache
def cross_check():
    return run_of(beacon_setup())


def small_network(**changes):
    """The same with 40 nodes at the same density."""
    return beacon_setup(**{"deploy": Uniform(nodes=40, width=250.0, height=250.0), **changes})


def in_range(run):
    """(N, N) whether two nodes are within communication range of each other."""
    apart = run.positions[:, None] - run.positions[None]
    near = (apart**2).sum(axis=2) <= REACH**2
    np.fill_diagonal(near, False)
    return near


def events_of_kind(run, kind):
    chosen = run.log["kind"] == kind
    return {name: column[chosen] for name, column in run.log.items()}


@pytest.mark.thorough
def test_the_packet_delivery_ratio_is_that_of_other_simulators():
    """97 to 99.5 %: ns-3.37 98.5, Castalia 3.3 98.8, wsnsimpy 97.0 %, for other samples of the same network."""
    counters = cross_check().outcome.counters
    assert 0.97 < counters.delivered / counters.in_range < 0.995
    near = in_range(cross_check())
    assert counters.in_range == pytest.approx(20 * near.sum(), rel=2e-3)


@pytest.mark.thorough
def test_the_counts_are_those_of_the_event_log():
    run = cross_check()
    counters, sends = run.outcome.counters, events_of_kind(run, SEND)
    neighbours = in_range(run).sum(axis=1)
    received, collided = (len(events_of_kind(run, kind)["time"]) for kind in (RECEIVE, COLLIDE))
    assert counters.in_range == neighbours[sends["node"]].sum() == received + collided
    assert (counters.delivered, counters.collided) == (received, collided)
    assert counters.frames_sent == counters.packets_sent == counters.transmissions == len(sends["time"])
    given_up = events_of_kind(run, DROP)
    assert set(given_up["what"].tolist()) <= {run.memory.words.code("no_channel")}
    assert counters.access_failures == len(given_up["time"])
    under_way = run.beacons - counters.frames_sent - counters.access_failures
    assert run.beacons == 8000 and 0 <= under_way < 20
    spoilt = set(events_of_kind(run, COLLIDE)["frame"].tolist())
    assert counters.frames_lost == len(spoilt)


def test_a_beacon_arrives_where_no_other_frame_is_heard_meanwhile():
    """Check every frame at every neighbour, from the times of sending alone."""
    run = cross_check()
    near, sends = in_range(run), events_of_kind(run, SEND)
    ends, sources = sends["time"], sends["node"]
    expected = 0
    for i, (end, source) in enumerate(zip(ends, sources, strict=True)):
        spoilt = np.zeros(len(near), dtype=bool)
        first, last = np.searchsorted(ends, [end - AIRTIME, end + AIRTIME])
        for j in range(first, last):
            if j != i and abs(ends[j] - end) < AIRTIME - 1e-12:
                spoilt |= near[sources[j]]
                spoilt[sources[j]] = True
        expected += int((near[source] & ~spoilt).sum())
    assert run.outcome.counters.delivered == expected


def test_the_links_add_up_to_the_counts():
    run = cross_check()
    links, counters = run.memory.table("links"), run.outcome.counters
    assert (links["sent"].sum(), links["received"].sum()) == (counters.in_range, counters.delivered)
    near = in_range(run)
    pairs = set(zip(links["source"].tolist(), links["node"].tolist(), strict=True))
    assert pairs == {(int(a), int(b)) for a, b in np.argwhere(near)}
    assert (links["chance"] == 1.0).all() and (links["received"] <= links["sent"]).all()
    sent = np.bincount(events_of_kind(run, SEND)["node"], minlength=len(near))
    assert np.array_equal(links["sent"], sent[links["source"]])
    apart = run.positions[links["source"]] - run.positions[links["node"]]
    assert links["distance"] == pytest.approx(np.hypot(*apart.T))


def test_the_ledger_closes_and_follows_from_the_bits_sent():
    run = cross_check()
    sensor_nodes, sends = run.outcome.nodes, events_of_kind(run, SEND)
    sent = np.bincount(sends["node"], minlength=sensor_nodes.size)
    assert sensor_nodes.ledger.joules.sum(axis=0) == pytest.approx(sensor_nodes.ledger.spent, rel=1e-9)
    assert sensor_nodes.ledger.joules[CAUSE["tx_electronics"]] == pytest.approx(sent * 232 * 50e-9, rel=1e-9)
    assert sensor_nodes.ledger.joules[CAUSE["tx_amplifier"]] == pytest.approx(sent * 232 * 100e-12 * REACH**2, rel=1e-9)
    received = np.bincount(events_of_kind(run, RECEIVE)["node"], minlength=sensor_nodes.size) * 232 * 50e-9
    heard = sensor_nodes.ledger.joules[CAUSE["rx"]]
    collided = np.bincount(events_of_kind(run, COLLIDE)["node"], minlength=sensor_nodes.size) * 232 * 50e-9
    assert (heard >= received * (1 - 1e-9)).all() and (heard <= (received + collided) * (1 + 1e-9)).all()
    assert run.log["joules"].sum() == pytest.approx(sensor_nodes.ledger.spent.sum(), rel=1e-9)
    assert run.memory.table("energy_steps")["joules"].sum() == pytest.approx(sensor_nodes.ledger.spent.sum(), rel=1e-9)


def test_a_radio_with_a_datasheet_consumes_its_power_in_every_second():
    """Listening and receiving take 62 mW, sending 57.42 mW, and everything else nothing."""
    run = run_of(small_network(energy=States(radio=RADIO, processor=PROCESSOR)))
    sent = np.bincount(events_of_kind(run, SEND)["node"], minlength=40)
    assert run.outcome.nodes.ledger.spent == pytest.approx(62e-3 * 20 - sent * AIRTIME * (62e-3 - 57.42e-3), rel=1e-9)


def test_without_contention_every_beacon_reaches_all_nodes_in_range():
    run = run_of(beacon_setup(mac=IdealMac(), steps=4))
    counters = run.outcome.counters
    assert counters.delivered == counters.in_range == 5 * in_range(run).sum()
    assert counters.collided == counters.access_failures == counters.frames_lost == 0
    assert counters.frames_sent == run.beacons == 5 * 400


def test_a_node_that_is_down_sends_no_beacons_and_keeps_its_phase():
    calm = run_of(small_network())
    run = run_of(small_network(faults=(Crash(at=5.0, duration=7.0, nodes=(3, 4)),)))
    times = {node: run.log["time"][(run.log["kind"] == SEND) & (run.log["node"] == node)] for node in (3, 4)}
    for node, own in times.items():
        assert not ((own > 5.0) & (own < 12.0)).any() and len(own) == 13, f"node {node}"
        phases = np.mod(own, 1.0)
        assert np.ptp(phases) < 0.05, "contention alone moves a beacon within its second"
    assert run.beacons == calm.beacons - 2 * 7
    heard = run.log["time"][(run.log["kind"] == RECEIVE) & (run.log["node"] == 3)]
    assert not ((heard > 5.0) & (heard < 12.0)).any() and (heard > 12.0).any()


def test_a_crash_and_a_restart_are_one_row_each():
    run = run_of(small_network(steps=4, faults=(Crash(at=1.0, duration=2.0, nodes=(3, 4)),)))
    for kind, time in (("crash", 1.0), ("restart", 3.0)):
        rows = events_of_kind(run, KIND[kind])
        assert (rows["time"].tolist(), rows["node"].tolist()) == ([time, time], [3, 4])


def test_a_run_equals_the_run_without_the_fault_until_the_fault_begins():
    calm, run = run_of(small_network()), run_of(small_network(faults=(Crash(at=5.0, nodes=(3,)),)))
    before = [{name: column[one.log["time"] < 5.0] for name, column in one.log.items()} for one in (calm, run)]
    assert len(before[0]["time"]) > 500
    for name in ("time", "node", "kind", "peer", "bits", "joules"):
        assert np.array_equal(before[0][name], before[1][name])
    assert run.outcome.counters.delivered < calm.outcome.counters.delivered


def test_in_a_blackout_of_all_nodes_every_beacon_fails_to_get_the_channel():
    run = run_of(small_network(faults=(Blackout(at=4.0, duration=10.0, fraction=1.0),)))
    sends = events_of_kind(run, SEND)["time"]
    assert not ((sends > 4.0 + TURNAROUND + AIRTIME) & (sends < 14.0)).any() and (sends > 14.0).any()
    assert run.outcome.counters.access_failures == pytest.approx(10 * 40, abs=8)
    assert run.outcome.nodes.ledger.joules.sum(axis=0) == pytest.approx(run.outcome.nodes.ledger.spent, rel=1e-9)


def test_a_fast_clock_sends_beacons_faster_by_its_rate():
    true, off = (
        run_of(small_network(mac=IdealMac(), clock=clock)) for clock in (PerfectClock(), DriftingClock(sd=0.01))
    )
    rates = np.empty(40)
    for node in range(40):
        own, there = (run.log["time"][(run.log["kind"] == SEND) & (run.log["node"] == node)] for run in (true, off))
        assert np.diff(own) == pytest.approx(1.0, rel=1e-12) and there[0] == pytest.approx(own[0])
        periods = np.diff(there)
        assert periods == pytest.approx(periods[0], rel=1e-9)
        rates[node] = 1 / periods[0]
    assert abs(rates - 1).max() <= 0.03
    assert abs(rates.mean() - 1) < 4 * 0.01 / np.sqrt(40)
    assert 0.006 < rates.std() < 0.014, "0.01, four standard errors either way"
