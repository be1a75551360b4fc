"""A result that was changed after its run does not repeat, whatever was changed, and `verify` says what."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import wsnsim
from tests.helpers.thorough import first
from wsnsim import cli, scenario
from wsnsim.base.tables import TABLES
from wsnsim.verification import verify
from wsnsim.verification.repetition import compare_source

Change = Callable[[h5py.File], Any]
EVERYTHING = [f"record.{name}=true" for name in TABLES if name != "runs"]
ANOTHER_PYTHON = {"python": "3.11.0"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short runs with all tables."""
    overrides = [
        *EVERYTHING,
        "duration=0.8 s",
        "tracker.particles=40",
    ]
    out = tmp_path_factory.mktemp("verified") / "ipf.h5"
    wsnsim.run(scenario.load("ipf", overrides), replicates=2, out=out)
    return out


@pytest.fixture
def copy(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the result, whose runs are repeated by another copy, to save the time of a run."""
    monkeypatch.setattr("wsnsim.experiment.run", lambda *_, out, **__: shutil.copy(made, out))
    return Path(shutil.copy(made, tmp_path / "copy.h5"))


def changed(path: Path, change: Change, **origin: Any) -> Path:
    """The file after a change; `origin` replaces entries of its provenance."""
    with h5py.File(path, "r+") as file:
        change(file)
        if origin:
            write_text(file, "provenance_json", json.dumps(json.loads(file["provenance_json"][()]) | origin))
    return path


def write_text(file: h5py.File, name: str, text: str) -> None:
    """Replace a text of a result."""
    del file[name]
    file[name] = text


def add(column: str, amount: float = 1.0) -> Change:
    """A change of the first finite value of a column."""

    def change(file: h5py.File) -> None:
        values = file[column][...]
        row = int(np.flatnonzero(np.isfinite(values))[0]) if values.dtype.kind == "f" else 0
        file[column][row] = values[row] + np.asarray(amount).astype(values.dtype)

    return change


@pytest.mark.thorough
def test_what_was_not_changed_repeats_and_it_says_what_was_compared(made: Path) -> None:
    answer = verify(made)
    assert answer.ok and not answer.faults, answer.text
    held = {name for name in TABLES if name in (answer.compared or {})}
    assert {"runs", "truth", "estimates", "tracks", "nodes", "energy", "events"} <= held
    assert all(row["equal"] and not row["differing"] for row in answer.rows)
    assert "runs.cpu_seconds" in answer.left and "not compared: runs.cpu_seconds; the provenance's" in answer.text


@pytest.mark.thorough(fast=["runs/energy-the same versions"])
@pytest.mark.parametrize("origin", first(1, [{}, ANOTHER_PYTHON]), ids=["the same versions", "another Python"])
@pytest.mark.parametrize(
    "column",
    ["tracks/rmse", "energy/joules", "energy_steps/joules", "truth/px", "nodes/x", "runs/handovers", "events/node",
     "estimates/error", "clusters/head", "runs/energy"],
)  # fmt: skip
def test_a_changed_value_does_not_repeat_whatever_the_version(copy: Path, column: str, origin: dict[str, str]) -> None:
    answer = verify(changed(copy, add(column), **origin))
    assert not answer.ok and column.replace("/", ".") in answer.text, answer.text
    assert sum(not row["close"] for row in answer.rows) == 1


@pytest.mark.thorough
@pytest.mark.parametrize("column", ["runs/fingerprint", "runs/event_fingerprint"])
def test_another_version_does_not_excuse_a_false_fingerprint_of_equal_values(copy: Path, column: str) -> None:
    answer = verify(changed(copy, add(column), **ANOTHER_PYTHON))
    assert not answer.ok and "runs.fingerprint" in answer.text


@pytest.mark.thorough
def test_another_version_excuses_rounding_and_the_fingerprint_that_comes_with_it(copy: Path) -> None:
    def change(file: h5py.File) -> None:
        file["estimates/error"][3] *= 1 + 1e-12
        rows = file["runs"].attrs["rows"]
        rows["fingerprint"][0] += np.uint64(1)
        file["runs"].attrs.modify("rows", rows)
        file["runs/fingerprint"][0] = rows["fingerprint"][0]

    assert not verify(changed(copy, change)).ok
    answer = verify(changed(copy, lambda file: None, **ANOTHER_PYTHON))
    assert answer.ok and "values may differ by rounding" in answer.text and answer.rows[0]["close"], answer.text


@pytest.mark.thorough
@pytest.mark.parametrize("table", ["runs", "truth", "clusters", "nodes"])
def test_an_empty_or_missing_table_is_a_difference(copy: Path, table: str) -> None:
    def empty(file: h5py.File) -> None:
        for name in list(file[table]):
            attributes = dict(file[table][name].attrs)
            kind = file[table][name].dtype
            del file[table][name]
            file[table].create_dataset(name, data=np.empty(0, kind)).attrs.update(attributes)

    answer = verify(changed(copy, empty, **ANOTHER_PYTHON))
    assert not answer.ok and f"{table} " in answer.text, answer.text

    def remove(file: h5py.File) -> None:
        del file[table]

    if table != "runs":
        answer = verify(changed(copy, remove))
        assert not answer.ok and f"has no table {table}, which its scenario records" in answer.faults


@pytest.mark.thorough
def test_what_a_run_does_not_write_and_other_meanings_are_differences(copy: Path, tmp_path: Path) -> None:
    other = Path(shutil.copy(copy, tmp_path / "other.h5"))

    def rename(file: h5py.File) -> None:
        words = str(file["events/kind"].attrs["flag_meanings"])
        file["events/kind"].attrs["flag_meanings"] = words.replace("receive", "collide_").replace("send", "receive")

    assert "events.kind" in verify(changed(copy, rename)).text

    def add_column(file: h5py.File) -> None:
        file["tracks"]["better"] = np.zeros(2)
        file["tracks"].attrs["columns"] = [*file["tracks"].attrs["columns"], "better"]

    assert verify(changed(other, add_column)).faults == ("has a column tracks.better, which a run does not write",)


@pytest.mark.thorough
def test_rows_in_one_piece_that_differ_from_the_columns_are_a_difference(copy: Path) -> None:
    def change(file: h5py.File) -> None:
        rows = file["tracks"].attrs["rows"]
        rows["rmse"][0] += 1
        file["tracks"].attrs.modify("rows", rows)

    answer = verify(changed(copy, change))
    assert not answer.ok and "two different columns tracks.rmse" in answer.text


@pytest.mark.thorough
def test_rows_of_runs_that_are_not_listed_are_a_difference(copy: Path) -> None:
    def change(file: h5py.File) -> None:
        file["truth/replicate"][3] = 7

    answer = verify(changed(copy, change))
    assert not answer.ok and "table truth has 1 rows of runs that are not in the table runs" in answer.faults


@pytest.mark.thorough
def test_another_source_text_is_a_difference(copy: Path) -> None:
    def change(file: h5py.File) -> None:
        text = file["scenario/source_yaml"].asstr()[()]
        write_text(file, "scenario/source_yaml", text + "\nseed: 99\n")

    answer = verify(changed(copy, change, **ANOTHER_PYTHON))
    assert not answer.ok and "seed: its source text says 99, the stored scenario 20131101" in " ".join(answer.faults)


def test_a_source_that_extends_a_file_of_its_own_is_compared_as_far_as_it_goes(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("extends: ipf\nseed: 3\n")
    (tmp_path / "mine.yaml").write_text("extends: base.yaml\nname: mine\nduration: 2 s\n")
    loaded = scenario.load(tmp_path / "mine.yaml", ["duration=4 s"])
    said = compare_source(loaded.source_yaml, loaded.overrides, scenario.resolved(loaded))
    assert said[0] == [] and "'base.yaml', a file that does not come with wsnsim" in said[1][0]
    said = compare_source(loaded.source_yaml, (), scenario.resolved(loaded))
    assert said[0] == ["duration: its source text says 2.0, the stored scenario 4.0"]
    for text, word in (("[1]", "not a scenario"), ("extends: ipf\ntracker: {kind: none_such}", "not a valid scenario")):
        assert word in compare_source(text, (), scenario.resolved(loaded))[0][0]


@pytest.mark.parametrize("command", ["verify", "check", "run"])
def test_no_file_is_opened_that_a_stored_scenario_extends(
    command: str, copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("secret.yaml").write_text("password: hunter2\n")

    def change(file: h5py.File) -> None:
        resolved = json.loads(file["scenario/resolved_json"][()])
        write_text(file, "scenario/resolved_json", json.dumps({**resolved, "extends": "secret.yaml"}))

    assert cli.main([command, str(changed(copy, change))]) == 1
    said = capsys.readouterr()
    assert "its stored scenario extends another file" in said.err and "hunter2" not in said.err + said.out


@pytest.mark.parametrize("command", ["verify", "check", "run"])
def test_what_is_wrong_with_a_stored_scenario_is_said_with_the_name_of_the_file(
    command: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(file: h5py.File) -> None:
        resolved = json.loads(file["scenario/resolved_json"][()])
        write_text(file, "scenario/resolved_json", json.dumps({**resolved, "no_key": 1, "x": 3}))

    path = changed(copy, change)
    assert cli.main([command, str(path)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and all(line.startswith(f"{path}: ") for line in said)


def test_what_is_wrong_with_an_override_of_a_stored_scenario_is_said_with_the_override(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["run", str(copy), "--set", "step=one yard"]) == 2
    assert capsys.readouterr().err.startswith("--set step: error: ")


@pytest.mark.thorough
def test_the_command_answers_in_json_and_with_the_exit_code(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["verify", str(copy), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] and answer["compared"]["runs"] == 2 and answer["left"]
    assert cli.main(["verify", str(changed(copy, add("tracks/rmse")))]) == 1
    assert "DOES NOT REPEAT" in capsys.readouterr().out
