"""The wake-up radio: calls have a link of their own, and the receivers of sleeping nodes take power."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.sleeping_networks import Run, scenario
from tests.network.radio_network import RadioNetwork
from tests.network.test_sleeping import places
from wsnsim import scenario as scenarios
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.tables import KIND
from wsnsim.models.links import LogNormal
from wsnsim.network.clusters.wake_up_service import WakeUpService

FAR = {"kind": "waypoints", "points": [[0, 5000, 5000], [60, 5000, 5000]]}
EQUIVALENT = -72.6 - 10.0 - 9.0
"""Received power in dBm of a frame at 0 dBm over a link over which a call is just heard."""


def calls_of(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(node called, caller) of every call that woke a node."""
    rows = run.events("called")
    return np.array([row["node"] for row in rows]), np.array([row["peer"] for row in rows])


@pytest.mark.thorough
@pytest.mark.parametrize("wakeup", ["directed_flood", "experience_zones"])
def test_a_call_reaches_nodes_at_which_it_arrives_with_the_sensitivity(wakeup):
    """Before, calls reached links over which the same message arrives in less than one case of a hundred."""
    run = Run(scenario(duration=40.0, link={"kind": "log_normal", "exponent": 2.13}, wakeup={"kind": wakeup}))
    topology = RadioNetwork(places(run), seed=5, link=LogNormal(exponent=2.13)).topology
    called, callers = calls_of(run)
    assert called.size > 20
    for node, caller in zip(called.tolist(), callers.tolist(), strict=True):
        neighbours = topology.neighbours(caller)
        assert neighbours.powers[neighbours.index(node)] >= EQUIVALENT
        assert topology.probability(caller, node) > 0.99


@pytest.mark.thorough
def test_the_range_of_a_call_is_that_of_its_link_budget():
    """Without shadowing: 10 dBm + 9 dB - 55 dB - 21.3 log10(d) = sensitivity."""
    link = {"kind": "log_normal", "exponent": 2.13, "shadowing": 0.0, "asymmetry": 0.0}
    for sensitivity, reach in ((-72.6, 52.3), (-60.0, 13.4)):
        run = Run(scenario(duration=40.0, link=link, wakeup={"kind": "experience_zones", "sensitivity": sensitivity}))
        called, callers = calls_of(run)
        points = places(run)
        longest = np.hypot(*(points[called] - points[callers]).T).max()
        assert reach == pytest.approx(10 ** ((19.0 - 55.0 - sensitivity) / 21.3), abs=0.1)
        assert 0.85 * reach < longest <= reach


def test_on_a_link_without_powers_a_call_reaches_the_range():
    run = Run(scenario(duration=40.0, wakeup={"kind": "experience_zones", "sensitivity": 0.0}))
    called, callers = calls_of(run)
    points = places(run)
    assert 60.0 < np.hypot(*(points[called] - points[callers]).T).max() <= 80.0


@pytest.mark.thorough
def test_calls_are_lost_at_random_and_alike_in_every_run(monkeypatch):
    heard, hear = [0, 0], WakeUpService._hear_call

    def count(self, node, sleepers):
        woken = hear(self, node, sleepers)
        heard[0], heard[1] = heard[0] + len(list(sleepers)), heard[1] + len(woken)
        return woken

    monkeypatch.setattr(WakeUpService, "_hear_call", count)
    said = scenario(duration=60.0, wakeup={"kind": "experience_zones", "loss": 0.3})
    prints = {Run(said).summary.run["fingerprint"] for _ in range(2)}
    assert len(prints) == 1
    assert heard[1] / heard[0] == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / (heard[0] / 2)))


def test_the_receivers_of_sleeping_nodes_take_standby_power():
    run = Run(scenario(motion=FAR, sink={"kind": "none"}))
    keys = derive_all(Streams(5, 0).key("sleep"), np.arange(200))
    seconds, _ = scenarios.build(scenarios.load(scenario())).sleep.tally(keys, np.zeros(200), 62.0)
    asleep = 200 * 62.0 - seconds.sum()
    assert run.summary.joules["sleep"] == pytest.approx(asleep * (66e-6 + 3 * 5.1e-6 + 6.9e-6), rel=1e-9)
    run.books()


@pytest.mark.thorough
def test_where_sleeping_costs_nothing_so_does_the_wake_up_receiver():
    said = [scenario(duration=40.0, energy={"kind": "first_order"}, wakeup={"kind": "directed_flood", "standby": watts})
            for watts in (0.0, 1e-3)]  # fmt: skip
    free, charged = map(Run, said)
    assert "sleep" not in charged.summary.joules
    assert free.summary.run["fingerprint"] == charged.summary.run["fingerprint"]
    assert KIND["called"] in charged.table("events")["kind"]
