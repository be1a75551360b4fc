"""What is valid and hardly meant is said by `check` and before a run; of shipped scenarios there is nothing to say."""

from __future__ import annotations

import functools
import json
from typing import Any

import pytest

from tests.helpers.sleeping_networks import scenario
from wsnsim import experiment, load
from wsnsim.analysis.notes import before_a_run
from wsnsim.base.tables import TABLES, Memory
from wsnsim.cli import main
from wsnsim.scenario import build
from wsnsim.scenario.texts import shipped

XMAC = "mac={kind: xmac, interval: 125 ms}"
SPARSE = "deploy={kind: anchors, places: [[0, 0], [30, 0], [0, 30]], width: 400 m, height: 400 m, centre: [0, 0]}"
LATE_0_6 = "mac={kind: 'tests.helpers.late_mac:LateCsma', rate: 250 kbit/s, interval: 600 ms}"
WINDOW = "clusters={kind: moving_head, main: prediction}"
LATE = "mac={kind: 'tests.helpers.late_mac:LateCsma', rate: 250 kbit/s}"


def notes(name: Any, *overrides: str) -> list[str]:
    """The notes of a scenario, a file or a plain dict, with overrides."""
    return before_a_run(build(load(name, list(overrides))))


@pytest.mark.parametrize(
    "name, overrides, starts",
    [
        ("gmtt", ["motion.width=900 m"], "motion.width: the target moves up to 200 m beyond the field of 500 m"),
        ("pso_mhpf", ["motion.bound=500 m"], "motion.bound: the target moves up to 300 m beyond the field of 400 m"),
        ("gmtt", ["motion.speed=[400, 500]"], "motion: at 500 m/s a target goes 1000 m in a step of 2 s, across all"),
        ("pso_mhpf", [SPARSE, "link.reach=20 m"], "run 0: no node is within the communication range"),
        ("beacons", ["link.reach=0.001 m"], "run 0: no node is within the communication range of 0.001 m of another"),
        ("pso_mhpf", ["sink={kind: node, x: 1000 m}"], "sink: (1000, 0) m is 800 m outside the field"),
        ("gmtt", ["sleep.period=300 s"], "sleep.period: 300 s is too long for the run of 202 s: no node changes"),
        ("gmtt", ["sink.every=202 s"], "sink.every: 202 s is too long for the run of 202 s: no report is sent"),
        ("beacons", ["workload.period=30 s"], "workload.period: 30 s is too long for the run of 20 s: no node sends"),
        ("ekf_real", [LATE], "step: steps of 40 ms are out of reach of mac: late: a unicast waits up to 0.129 s"),
        ("ekf_real", ["step=20 ms", "duration=4 s"], "mac.idle_slots: about 18 nodes are within sensing range"),
        ("ekf_real", ["mac.idle_slots=skipped"], "mac.idle_slots: skipped is an idealisation"),
        ("ekf_real", ["link.sensitivity=-91.7 dBm", "link.fitted_on=[a]"],
         "link.sensitivity: -91.7 dBm counts, not the -95 dBm of"),
        ("ekf_real", ["sensor={kind: binary}"], "tracker: it takes a reading of 1 bit as Gaussian, with its mean"),
        ("gmtt", [LATE_0_6, WINDOW], "wakeup: over mac: late readings take up to 1.2 s and a message of two"),
        ("collection", [XMAC], "routing.i_min: over mac: xmac a beacon takes up to 0.14 s"),
        ("pso_mhpf", [LATE, "step=1 s", "duration=9 s"],
         "mac: late turns radios off, and by energy: listening costs nothing"),
        ("ekf_real", ["network=none"], "energy, link, mac, "),
        ("ekf_real", ["detection={kind: imperfect, missed: 0.1, stuck_at: 7}"], "detection.stuck_at: no effect while"),
        ("beacons", ["deploy.position_error=1 m"], "deploy.position_error: no effect with a workload without"),
        ("collection", ["mac={kind: tdma, max_retries: 0, slot: 9 ms}"], "mac.slot: no effect with a workload without"),
        ("beacons", ["sensor={kind: range}"], "sensor: no effect with a workload without targets"),
        ("ekf_real", ["faults=[{kind: crash, at: 1, region: [200, 200, 1 mm]}]"], "run 0: faults[0] (crash) hits none"),
    ],
)  # fmt: skip
def test_values_that_are_hardly_meant_are_said_with_their_figures(name, overrides, starts):
    (note,) = notes(name, *overrides)
    assert note.startswith(starts)


@pytest.mark.parametrize("aim", ["fraction: 0.1", "region: [100, 100, 9]"])
def test_a_fault_that_hits_none_of_few_nodes_is_said_with_and_without_a_network(tmp_path, aim):
    (tmp_path / "nodes.csv").write_text("node,x,y\n" + "".join(f"{i},{20 * i},0\n" for i in range(4)))
    changes = [f"deploy={{kind: file, path: {tmp_path}/nodes.csv}}", f"faults=[{{kind: stuck, at: 0.2, {aim}}}]"]
    for mode in ([], ["network=none"]):
        found = notes("pso_mhpf", "duration=0.4 s", "tracker.kind=ekf", *changes, *mode)
        assert "run 0: faults[0] (stuck) hits none of the 4 nodes" in found
    assert not [note for note in notes("pso_mhpf", *changes[:1], "faults=[{kind: crash, at: 0, nodes: [3]}]")
                if "hits none" in note]  # fmt: skip


FIVE_STEPS = ["step=0.2 s", "duration=1 s", "tracker.kind=ekf", "deploy.nodes=100"]
QUIET = [
    ("network=none", "crash", {"at": 0.22, "duration": 0.16}, "no effect from 0.22 s to 0.38 s: sensors measure"),
    ("network=none", "crash", {"at": 0.22, "duration": 0.2}, ""),
    ("network=none", "crash", {"at": 0.4, "duration": 0.0}, "no effect with a duration of 0 s"),
    ("network=none", "crash", {"at": 0.85}, "no effect from 0.85 s to 1 s: sensors measure every 0.2 s, up to 0.8 s"),
    ("network=none", "restart", {"at": 0.4}, "no effect with a duration of 0 s"),
    ("network=none", "restart", {"at": 0.3, "duration": 0.2}, ""),
    ("network=none", "bias", {"at": 0.5, "duration": 0.1, "offset": 9}, "no effect from 0.5 s to 0.6 s"),
    ("network=none", "stuck", {"at": 0.6, "duration": 0.1, "value": 0}, ""),
    ("record.events=false", "bias", {"at": 0.5, "duration": 0.1, "offset": 9}, "no effect from 0.5 s to 0.6 s"),
    ("record.events=false", "stuck", {"at": 0.6, "duration": 0.1, "value": 0}, ""),
    ("record.events=false", "stuck", {"at": 0.81}, "no effect from 0.81 s to 1 s"),
    ("record.events=false", "crash", {"at": 0.4, "duration": 0.0}, ""),
    ("record.events=false", "restart", {"at": 0.4}, ""),
    ("record.events=false", "blackout", {"at": 0.4, "duration": 0.0}, "no effect with a duration of 0 s"),
    ("record.events=false", "link_loss", {"at": 0.4, "duration": 0.0, "loss": 1.0}, "no effect with a duration of 0 s"),
    ("record.events=false", "clock_step", {"at": 0.4, "duration": 0.0, "offset": 0.1}, "no effect with"),
    ("record.events=false", "blackout", {"at": 0.39, "duration": 0.15}, ""),
]  # fmt: skip
"""A mode, a fault of all nodes in five steps of 0.2 s, and what is noted if no result differs."""


@pytest.mark.parametrize("mode, kind, values, says", QUIET)
def test_a_fault_is_noted_if_and_only_if_its_times_forbid_an_effect(mode, kind, values, says):
    overrides = [*FIVE_STEPS, mode]
    usual = tables_of(tuple(overrides))
    overrides.append(f"faults=[{json.dumps({'kind': kind, 'fraction': 1.0} | values)}]")
    found = [note for note in notes("pso_mhpf", *overrides) if note.startswith("faults[0]")]
    assert [note.startswith(f"faults[0] ({kind}): {says}") for note in found] == [True] * bool(says)
    assert (tables_of(tuple(overrides)) == usual) == bool(says)


def test_a_restart_of_no_duration_that_ends_a_crash_is_not_noted():
    faults = "faults=[{kind: crash, at: 0.2, fraction: 1.0}, {kind: restart, at: 0.5, fraction: 1.0}]"
    assert not [note for note in notes("pso_mhpf", *FIVE_STEPS, "network=none", faults)
                if note.startswith("faults")]  # fmt: skip


@functools.cache
def tables_of(overrides: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """The tables of a run, without processor time and the digest of the event log."""
    memory = Memory(dict.fromkeys(TABLES, True))
    experiment.replicate_of(build(load("pso_mhpf", list(overrides))), 0, memory)
    kept = [name for name in TABLES if name != "events"]
    return {
        table: {name: column.tobytes() for name, column in memory.table(table).items()
                if name != "cpu_seconds" and "fingerprint" not in name}
        for table in kept
    }  # fmt: skip


@pytest.mark.parametrize(
    "prices, says",
    [
        ({"idle": 0.01, "sleep": 0.05}, "0.05 W asleep; give sleep: {kind: always_on}, or lower prices of sleep"),
        ({"idle": 0.01, "switch": 0.5}, "0.5 J each; give sleep: {kind: always_on}, or lower prices of changes"),
    ],
)
def test_sleep_that_costs_more_than_it_saves_is_said(prices, says):
    energy = {"kind": "first_order", **prices}
    (note,) = notes(scenario(energy=energy))
    assert note.startswith("sleep: by its schedule a node takes 0.0") and note.endswith(says)
    assert "and 0.01 W if it never slept" in note
    assert notes(scenario(energy={**energy, "idle": 5.0})) == []


@pytest.mark.parametrize(
    "name, overrides",
    [
        ("gmtt", ["motion.width=560 m"]),
        ("pso_mhpf", ["sink={kind: node, x: 210 m}"]),
        ("gmtt", ["sink.every=200 s"]),
        ("gmtt", ["sleep.period=202 s"]),
        ("gmtt", ["motion.speed=[100, 200]"]),
        ("pso_mhpf", ["duration=0.4 s"]),
        ("collection", [XMAC, "routing.i_min=3 s"]),
        ("ekf_real", ["detection={kind: imperfect, stuck: 0.1, stuck_at: 7}"]),
    ],
)
def test_what_still_makes_sense_is_not_noted(name, overrides):
    assert notes(name, *overrides) == []


@pytest.mark.thorough
def test_shipped_scenarios_are_meant_as_they_are():
    found = {name: said for name in shipped() if (said := notes(name))}
    empty = found.pop("scans_empty")  # there is no target, on purpose
    assert len(empty) == 1 and empty[0].startswith("motion.presence: the target never exists")
    assert found == {}


@pytest.mark.thorough
def test_a_run_says_it_before_it_starts_and_check_says_the_same(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    long = ["--set", "duration=4 s", "--set", "sink={kind: node, every: 5 s}", "--set", "lost={window: 1 s}"]
    assert main(["check", "pso_mhpf", *long]) == 0
    said = [line.removeprefix("  note: ") for line in capsys.readouterr().out.splitlines()[1:]]
    assert len(said) == 1 and said[0].startswith("sink.every: 5 s is too long for the run of 4 s")
    assert main(["run", "pso_mhpf", *long, "--progress", "plain", "-o", "x.h5"]) == 0
    assert capsys.readouterr().err.splitlines()[0] == f"wsnsim: note: {said[0]}"
    assert main(["run", "pso_mhpf", *long, "--quiet", "-o", "x.h5"]) == 0
    assert capsys.readouterr().err == ""


def test_check_notes_a_window_of_losses_that_the_run_can_hardly_reach(capsys):
    for changes, count in ((["lost.window=50 s"], 0), (["lost.window=51 s"], 1), (["duration=7 s"], 1)):
        assert main(["check", "ungm_pf", *(word for each in changes for word in ("--set", each))]) == 0
        said = [line for line in capsys.readouterr().out.splitlines() if "lost.window" in line]
        assert len(said) == count, (changes, said)
    assert said == ["  note: lost.window: 4 s are more than half of the 6 steps of 1 s of the run, in which a track is "
                    "hardly lost by this rule; give a shorter window, or a duration of 9 s"]  # fmt: skip


def test_shadowing_of_recorded_readings_that_the_filter_ignores_is_noted() -> None:
    shadowed = "sensor.law.shadowing=3"
    (said,) = notes("recorded_track", shadowed)
    assert said.startswith("sensor.law.shadowing: the filter ignores the 3 dB") and "inflate: true" in said
    assert notes("recorded_track") == notes("recorded_track", shadowed, "tracker.assumes.inflate=true") == []
