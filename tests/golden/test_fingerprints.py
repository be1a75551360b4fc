"""Every shipped scenario has a stored fingerprint, and a change of its results is found."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from tests.golden.__main__ import record, verify
from tests.golden.fingerprints import (
    DURATIONS,
    FOLDER,
    SENSITIVE,
    Machine,
    differences,
    measured,
    shipped,
    stored,
    this_machine,
)  # fmt: skip

HERE = Machine("cpu A", {"python": "3.11", "numpy": "2"})
ELSEWHERE = Machine("cpu B", HERE.versions)
FOUND = {"tables": {"runs": "11", "tracks": "22"}, "metrics": {"rmse": 2.0, "energy": None}}


def changed(**metrics: float) -> dict[str, Any]:
    """Other bits and other metrics than those of FOUND."""
    found = copy.deepcopy(FOUND)
    found["tables"]["runs"] = "33"
    found["metrics"] |= metrics
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    record([("one", FOUND)], HERE, 1, lambda _: None, tmp_path)
    return tmp_path


def test_every_shipped_scenario_has_an_entry_and_no_other_has_one() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.json")) == shipped()
    assert [name for name in shipped() if not stored(name)] == []
    assert set(DURATIONS) | set(SENSITIVE) <= set(shipped())
    assert all(one["tables"].keys() >= {"runs"} for name in shipped() for one in stored(name).values())


def test_a_scenario_gives_what_is_stored() -> None:
    assert differences("ungm_pf", stored("ungm_pf"), measured("ungm_pf"), this_machine()) == []


def test_on_the_same_machine_every_bit_counts(folder: Path) -> None:
    assert differences("one", stored("one", folder), FOUND, HERE) == []
    assert differences("one", stored("one", folder), changed(), HERE) == ["tables that differ: runs"]
    lines = differences("one", stored("one", folder), changed(rmse=2.5), HERE)
    assert lines == ["tables that differ: runs", "rmse: 2.0 -> 2.5"]


@pytest.mark.parametrize("machine", [ELSEWHERE, Machine(HERE.kind, {**HERE.versions, "numpy": "3"})])
def test_on_another_machine_or_with_other_versions_metrics_are_close(folder: Path, machine: Machine) -> None:
    before = stored("one", folder)
    assert differences("one", before, changed(rmse=2.0 + 1e-9), machine) == []
    assert differences("one", before, changed(rmse=2.0 + 1e-4), machine) == ["rmse: 2.0 -> 2.0001"]
    assert differences("one", before, changed(energy=1.0), machine) == ["energy: None -> 1.0"]


def test_on_another_machine_the_nees_of_a_collapsed_cloud_is_not_compared(folder: Path) -> None:
    record([("one", changed(nees=1e38))], HERE, 1, lambda _: None, folder)
    before = stored("one", folder)
    assert differences("one", before, changed(nees=2e38), ELSEWHERE) == []
    assert differences("one", before, changed(nees=4.0), ELSEWHERE) == ["nees: 1e+38 -> 4.0"]


def test_what_differs_is_said_and_counted(folder: Path) -> None:
    said: list[str] = []
    found = [("one", changed(rmse=3.0)), ("two", FOUND)]
    assert verify(found, HERE, 2, said.append, folder) == 2
    assert said[0] == "  1 of 2  one: DIFFERS\n    tables that differ: runs\n    rmse: 2.0 -> 3.0"
    assert "has no stored fingerprint" in said[1] and said[-1].startswith("0 of 2 scenarios are as stored")
    assert verify([("one", FOUND)], ELSEWHERE, 1, said.append, folder) == 0
    assert "compared by their metrics" in said[-3] and "cpu B with python 3.11, numpy 2" in said[-2]


def test_recording_keeps_other_machines_unless_results_changed(folder: Path) -> None:
    said: list[str] = []
    assert record([("one", changed(rmse=2.0 + 1e-9))], ELSEWHERE, 1, said.append, folder) == 0
    assert sorted(stored("one", folder)) == ["cpu A", "cpu B"] and "as before" in said[0]
    text = (folder / "one.json").read_text()
    assert record([("one", FOUND)], HERE, 1, said.append, folder) == 0
    assert (folder / "one.json").read_text() == text
    assert record([("one", changed(rmse=3.0))], HERE, 1, said.append, folder) == 1
    assert "rmse: 2.0 -> 3.0" in said[-2] and "say why" in said[-1]
    assert list(stored("one", folder)) == ["cpu A"]


def test_a_fingerprint_of_another_duration_is_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(DURATIONS, "one", "1 s")
    assert stored("one", folder) == {}
