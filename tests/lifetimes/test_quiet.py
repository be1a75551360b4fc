"""The power of a network without a target: closed forms against long runs."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.base.errors import UsageError
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSES, Memory
from wsnsim.experiment import replicate_of
from wsnsim.lifetimes.quiet import QuietPower, quiet_power
from wsnsim.scenario.build import build

FEW: dict[str, Any] = {
    "name": "quiet", "seed": 3, "step": "2 s", "duration": "1 h",
    "prior": {"sd": [5, 3, 5, 3]},
    "deploy": {"kind": "uniform", "nodes": 6, "width": "120 m", "height": "120 m", "cover": False},
    "motion": {
        "kind": "visits", "times": [], "of": {"kind": "crossing", "width": "120 m", "height": "120 m", "speed": [1, 8]}
    },
    "sensor": {"kind": "range", "reach": "40 m", "sd": "2 m"},
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611", "sensing": "11 uJ"},
    "link": {"kind": "disk", "reach": "80 m"},
    "wakeup": {"kind": "none"},
    "clusters": {"kind": "moving_head", "main": "detection"},
    "acquire": {"kind": "readings", "poll": "1 s"},
    "sink": {"kind": "node", "x": "0 m", "y": "0 m", "every": "10 s", "bits": 88},
    "tracker": {"kind": "ris"},
}  # fmt: skip
MACS: dict[str, dict[str, Any]] = {
    "ideal": {"kind": "ideal"},
    "ideal_rate": {"kind": "ideal", "rate": "250 kbit/s"},
    "csma": {"kind": "csma"},
    "tdma": {"kind": "tdma", "idle_slots": "skipped"},
    "xmac": {"kind": "xmac"},
    "xmac_long": {"kind": "xmac", "interval": "0.5 s", "listen": "4 ms"},
    "contikimac": {"kind": "contikimac"},
    "tsch": {"kind": "tsch"},
}
SLEEP: dict[str, dict[str, Any]] = {
    "event_wake": {"kind": "event_wake"},
    "always_on": {"kind": "always_on"},
    "ris": {"kind": "ris", "period": "2 s"},
    "duty_cycle": {"kind": "duty_cycle", "period": "10 s"},
    "always_awake_duty": {"kind": "duty_cycle", "period": "10 s", "awake_share": 1.0},
}
SYNC: dict[str, dict[str, Any]] = {
    "none": {},
    "ftsp": {"sync": {"kind": "ftsp", "period": "120 s"}, "clock": {"kind": "drift", "sd": "30 ppm"}},
}
ROUTING: dict[str, dict[str, Any]] = {
    "greedy": {"routing": {"kind": "greedy_geographic"}},
    "minimum_energy": {},
    "ctp": {"routing": {"kind": "ctp", "i_min": "2 s", "i_max": "240 s"}},
}
LOSSY = {"link": {"kind": "log_normal", "exponent": 2.4, "loss_at_1m": "55 dB", "sensitivity": "-95 dBm"}}


def setup_of(**changes: Any) -> NetworkSetup:
    setup = build(wsnsim.load({**FEW, **changes}))
    assert isinstance(setup, NetworkSetup)
    return setup


def demand_agreement(closed: QuietPower, measured: QuietPower, each_node: bool = False) -> None:
    """Within 1 %, or within what the run's own error allows (4 standard errors), for the mean node and each cause.

    A cause counts from 0.1 % of the power on: of the others 1 % of that.
    """
    assert closed.measured == ""
    assert measured.measured == "on request"
    size = closed.watts.shape[1]
    total, error = measured.watts.sum(axis=0), np.linalg.norm(measured.error, axis=0)
    power, own_error = total.mean(), np.linalg.norm(error) / size
    assert abs(closed.watts.sum() / size - power) <= 0.01 * power + 4.0 * own_error
    for cause, one, other, its in zip(CAUSES, closed.watts, measured.watts, measured.error, strict=True):
        allowed = 0.01 * max(other.mean(), 1e-3 * power) + 4.0 * np.linalg.norm(its) / size
        assert abs(one.mean() - other.mean()) <= allowed, cause
    if each_node:
        np.testing.assert_allclose(closed.watts.sum(axis=0), total, rtol=0.01)


@pytest.mark.parametrize("sleep", SLEEP)
@pytest.mark.parametrize("mac", MACS)
def test_the_power_of_a_silent_network_is_the_same_in_closed_form_and_in_a_run(mac: str, sleep: str) -> None:
    setup = setup_of(mac=MACS[mac], sleep=SLEEP[sleep])
    closed = quiet_power(setup)
    demand_agreement(closed, quiet_power(setup, run=True), each_node=sleep != "ris")


@pytest.mark.parametrize("mac", ["ideal", "ideal_rate", "csma", "tdma"])
def test_broadcasts_of_synchronisation_cost_what_a_run_says(mac: str) -> None:
    setup = setup_of(mac=MACS[mac], sleep=SLEEP["event_wake"], **SYNC["ftsp"])
    closed = quiet_power(setup)
    silent = quiet_power(setup_of(mac=MACS[mac], sleep=SLEEP["event_wake"]))
    assert closed.watts[CAUSES.index("rx")].sum() > silent.watts.sum() * 1e-6
    demand_agreement(closed, quiet_power(setup, run=True), each_node=True)


@pytest.mark.parametrize("mac", ["xmac", "contikimac", "tsch"])
def test_beacons_of_a_collection_tree_over_radios_that_sleep_cost_what_a_run_says(mac: str) -> None:
    setup = setup_of(mac=MACS[mac], sleep=SLEEP["event_wake"], **ROUTING["ctp"])
    demand_agreement(quiet_power(setup), quiet_power(setup, run=True), each_node=True)


CASES = [
    pytest.param(mac, sync, routing, link, id=f"{mac}-{sync}-{routing}-{'lossy' if link else 'disk'}")
    for mac, sync, routing, link in itertools.product(MACS, SYNC, ROUTING, ({}, LOSSY))
    if (sync != "none" or routing == "ctp") and routing != "greedy"
    and not (routing == "ctp" and link) and not (mac == "tsch" and sync != "none")
]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(("mac", "sync", "routing", "link"), CASES)
def test_closed_forms_hold_for_every_mac_with_every_upkeep(
    mac: str, sync: str, routing: str, link: dict[str, Any]
) -> None:
    deploy = {**FEW["deploy"], "nodes": 10}
    setup = setup_of(deploy=deploy, mac=MACS[mac], sleep=SLEEP["event_wake"], **SYNC[sync], **ROUTING[routing], **link)
    demand_agreement(quiet_power(setup), quiet_power(setup, run=True))


def test_dead_nodes_spend_nothing_and_others_do_not_hear_them() -> None:
    setup = setup_of(mac=MACS["csma"], sleep=SLEEP["event_wake"], **SYNC["ftsp"])
    whole, closed = quiet_power(setup), quiet_power(setup, frozenset({1, 4}))
    measured = quiet_power(setup, frozenset({1, 4}), run=True)
    rx = CAUSES.index("rx")
    assert not closed.watts[:, [1, 4]].any() and not measured.watts[:, [1, 4]].any()
    assert closed.watts[rx].sum() < whole.watts[rx].sum()
    living = [0, 2, 3, 5]
    np.testing.assert_allclose(closed.watts[:, living].sum(axis=0), measured.watts[:, living].sum(axis=0), rtol=1e-3)


def test_a_sink_is_always_awake() -> None:
    closed = quiet_power(setup_of(mac=MACS["xmac"], sleep=SLEEP["ris"]))
    awake = quiet_power(setup_of(mac=MACS["xmac"], sleep=SLEEP["always_on"]))
    same = np.isclose(closed.watts.sum(axis=0), awake.watts.sum(axis=0))
    assert same.sum() == 1


class Unknown:
    """Synchronisation that does not say what it sends."""

    mechanism = "none"


def test_what_has_no_closed_form_is_measured_and_says_so() -> None:
    setup = setup_of(mac=MACS["csma"])
    power = quiet_power(dataclasses.replace(setup, sync=Unknown()), span=60.0)
    assert power.measured == "sync has no closed form here"
    np.testing.assert_allclose(power.watts, quiet_power(setup).watts, rtol=1e-9)
    asleep = setup_of(mac=MACS["csma"], sleep=SLEEP["duty_cycle"], **SYNC["ftsp"])
    assert quiet_power(asleep, span=60.0).measured == "broadcasts wait for nodes that sleep"
    tsch = setup_of(mac=MACS["tsch"], clock={"kind": "drift"})
    assert quiet_power(tsch, span=60.0).measured == "mac has no closed form here"


def test_a_target_that_never_comes_costs_what_the_quiet_network_costs() -> None:
    for presence in (None, []):
        motion = FEW["motion"] if presence is None else {**FEW["motion"]["of"], "presence": []}
        setup, memory = setup_of(mac=MACS["xmac"], motion=motion), Memory({"energy": True, "tracks": True})
        replicate_of(setup, 0, memory)
        watts = memory.table("energy")["joules"].sum() / setup.duration
        assert watts == pytest.approx(quiet_power(setup).watts.sum(), rel=1e-9)
        assert memory.table("tracks")["time_present"].sum() == 0


def test_the_api_gives_a_frame_with_a_row_for_each_node() -> None:
    frame = wsnsim.quiet(FEW, mac="xmac", dead=[2]).frame()
    assert list(frame.index) == list(range(6))
    assert set(frame) == {"idle", "sleep", "switch"}
    assert frame.loc[2].sum() == 0.0 < frame.loc[1].sum()


def test_a_node_that_does_not_exist_and_scenarios_without_a_waiting_network_are_refused() -> None:
    with pytest.raises(UsageError, match="dead: 6 is no node of the network, whose nodes are 0 to 5"):
        wsnsim.quiet(FEW, dead=[6])
    with pytest.raises(UsageError, match="no network that waits for targets"):
        wsnsim.quiet("range_pf")
