"""`wsnsim trace` and `wsnsim diff` on simulated results."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

import wsnsim
from wsnsim.cli import main

QUICK = ("--set", "duration=0.44 s", "--set", "tracker.particles=40", "--quiet")


@pytest.fixture(autouse=True)
def _undone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undo changes to the process."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A run, its repetition, a run with lossy links, one without events, and one without a network."""
    folder = tmp_path_factory.mktemp("results")
    runs = {
        "one": ("pso_mhpf",),
        "again": ("pso_mhpf",),
        "lossy": ("pso_mhpf", "--set", "link.loss=0.2"),
        "silent": ("pso_mhpf", "--set", "record.events=false"),
    }
    for name, words in runs.items():
        assert main(["run", *words, *QUICK, "--out", str(folder / f"{name}.h5")]) == 0
    bench = ["run", "ungm_pf", "--replicates", "1", "--set", "duration=5 s", "--quiet"]
    assert main([*bench, "--out", str(folder / "bench.h5")]) == 0
    return {name: folder / f"{name}.h5" for name in (*runs, "bench")}


@pytest.mark.thorough
def test_a_step_is_told_with_its_sensing_nodes_its_messages_and_its_cost(results, capsys) -> None:
    assert main(["trace", str(results["one"]), "--step", "3"]) == 0
    said = capsys.readouterr().out
    events = wsnsim.read(results["one"], "events")
    sensing = int(((events["step"] == 3) & (events["kind"] == "sense")).sum())
    assert f"{sensing} nodes sensed: " in said
    assert "members sent their estimate to cluster head" in said and "the network spent" in said


@pytest.mark.thorough
def test_the_cost_in_json_is_that_of_the_events(results, capsys) -> None:
    assert main(["trace", str(results["one"]), "--step", "3", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    events = wsnsim.read(results["one"], "events")
    of_step = events[events["step"] == 3]
    assert sum(told["energy_of_events"].values()) == pytest.approx(of_step["joules"].sum(), rel=1e-12)
    assert sum(told["energy"].values()) == pytest.approx(of_step["joules"].sum(), rel=1e-9)
    sends = of_step[of_step["kind"].isin(["send", "relay"])]
    assert sum(len(message["frames"]) for message in told["messages"]) == len(sends)


@pytest.mark.thorough
def test_a_run_over_links_that_lose_says_what_was_lost(results, capsys) -> None:
    events = wsnsim.read(results["lossy"], "events")
    lost = events[(events["kind"] == "drop") & (events["what"] == "estimate")]
    step = int(lost["step"].iloc[0])
    assert main(["trace", str(results["lossy"]), "--step", str(step), "--limit", "0"]) == 0
    assert f"{int((lost['step'] == step).sum())} lost on the way" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("name", "words", "code", "said"),
    [
        ("one", ["--step", "99"], 2, "has steps 0 to 10, not 99"),
        ("one", ["--step", "1", "--replicate", "2"], 2, "no replicate 2; it has 0"),
        ("silent", ["--step", "1"], 1, "record.events=true"),
    ],
)
def test_a_step_that_cannot_be_told_says_why(results, capsys, name, words, code, said) -> None:
    assert main(["trace", str(results[name]), *words]) == code
    assert said in capsys.readouterr().err


def test_a_result_without_a_network_is_told_too(results, capsys) -> None:
    assert main(["trace", str(results["bench"]), "--step", "2"]) == 0
    assert "no network" in capsys.readouterr().out


@pytest.mark.thorough
def test_the_same_run_twice_is_the_same(results, capsys) -> None:
    assert main(["diff", str(results["one"]), str(results["again"])]) == 0
    assert "are equal bit for bit" in capsys.readouterr().out


@pytest.mark.thorough
def test_runs_over_other_links_part_on_the_same_truth_and_network(results, capsys) -> None:
    assert main(["diff", str(results["one"]), str(results["lossy"]), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["settings"] == {"link.loss": [0.0, 0.2]}
    (run,) = found["replicates"]
    assert run["truth"] and run["network"] and not run["tables"]["events"]
    number, one, other = run["event"]
    events = [wsnsim.read(results[name], "events").iloc[: number + 1] for name in ("one", "lossy")]
    assert events[0].iloc[:-1].astype(str).equals(events[1].iloc[:-1].astype(str))
    assert not events[0].iloc[-1:].astype(str).equals(events[1].iloc[-1:].astype(str))
    assert one != other


def test_a_result_that_cannot_be_read_is_no_difference(results, capsys, tmp_path) -> None:
    assert main(["diff", str(results["one"]), str(tmp_path / "none.h5")]) == 2
    assert "no such file" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_first_differing_reading_is_named_with_its_step_and_node(capsys, tmp_path) -> None:
    recorded = ["run", "pso_mhpf", *QUICK, "--set", "record.readings=true"]
    assert main([*recorded, "--out", str(tmp_path / "a.h5")]) == 0
    readings = wsnsim.read(tmp_path / "a.h5", "readings")
    at = readings[readings["step"] == 5].iloc[0]
    fault = f"faults=[{{kind: bias, offset: 7, nodes: [{int(at['node'])}], at: 0.18 s, duration: 0.1 s}}]"
    assert main([*recorded, "--set", fault, "--out", str(tmp_path / "b.h5")]) == 0
    capsys.readouterr()
    assert main(["diff", str(tmp_path / "a.h5"), str(tmp_path / "b.h5")]) == 1
    value = at["reading"]
    words = f"step 5, node {int(at['node'])}, target 0: A {value:.6g}, B {value + 7.0:.6g}"
    assert f"  first differing reading: {words}" in capsys.readouterr().out
    assert main(["diff", str(tmp_path / "a.h5"), str(tmp_path / "b.h5"), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["replicates"][0]["reading"]
    assert (found["step"], found["node"], found["target"]) == (5, at["node"], 0)


@pytest.mark.thorough
def test_recorded_readings_are_those_that_estimates_count_in_the_network_and_without(tmp_path) -> None:
    for name, words in {"pso_mhpf": ("duration=0.4 s", "tracker.particles=40"), "indoor_pf": ()}.items():
        scenario = wsnsim.load(name, [*words, "record.readings=true"])
        wsnsim.run(scenario, replicates=2, out=tmp_path / f"{name}.h5")
        readings, estimates = (wsnsim.read(tmp_path / f"{name}.h5", table) for table in ("readings", "estimates"))
        counts = readings.groupby(["replicate", "step"]).size()
        wanted = estimates.set_index(["replicate", "step"])["active"]
        assert (counts.reindex(wanted.index).fillna(0) >= wanted).all() and counts.max() > 2
        assert (readings["step"] == 0).any() and readings["reading"].notna().all()
        assert not readings.duplicated(["replicate", "target", "step", "node"]).any()
    other = wsnsim.load("indoor_pf", ["record.readings=false"])
    wsnsim.run(other, replicates=2, out=tmp_path / "batch.h5")
    alone = wsnsim.read(tmp_path / "batch.h5", "estimates")
    assert alone.equals(estimates), "the batch engine and single runs give the same"
