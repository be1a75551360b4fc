"""Tables are exported as MATLAB and CSV files that hold the values of the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

import wsnsim
from tests.helpers.commands import run_command
from wsnsim.analysis import frames
from wsnsim.analysis.frames import legal_names
from wsnsim.base.errors import StorageError, UsageError

SCENARIO = {
    "name": "small", "seed": 2, "duration": 2.0, "step": 0.5, "prior": {"sd": [4.0, 2.0, 4.0, 2.0]},
    "deploy": {"kind": "grid", "nodes": 16, "width": 120.0, "height": 120.0, "cover": False},
    "motion": {"kind": "waypoints", "points": [[0.0, -20.0, 0.0], [2.0, 20.0, 0.0]], "q": 1.0},
    "sensor": {"kind": "range", "sd": 1.0, "reach": 60.0}, "energy": {"kind": "first_order"},
    "link": {"kind": "disk", "reach": 90.0}, "tracker": {"kind": "ekf"}, "record": {"events": True},
}  # fmt: skip


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of two short runs."""
    from wsnsim import experiment

    path = tmp_path_factory.mktemp("result") / "small.h5"
    experiment.run(SCENARIO, replicates=2, out=path)
    return path


@pytest.mark.thorough
def test_matlab_reads_what_pandas_reads(result: Path, tmp_path: Path) -> None:
    file = tmp_path / "small.mat"
    written = dict(frames.matlab(result, file))
    content = loadmat(file, squeeze_me=False)
    assert set(written) == set(frames.tables_of(result)) and str(content["wsnsim"]["version"][0, 0][0])
    for table, rows in written.items():
        frame, struct = wsnsim.read(result, table), content[table][0, 0]
        assert len(frame) == rows and set(struct.dtype.names) == set(frame.columns)
        for name in frame:
            values, expected = struct[name], frame[name]
            assert values.shape == (rows, 1)
            if expected.dtype.kind in "biuf":
                assert np.array_equal(values[:, 0], expected.to_numpy(), equal_nan=expected.dtype.kind == "f")
            else:
                texts = [cell[0] if cell.size else "" for cell in values[:, 0]]
                assert texts == [str(value) for value in expected]
    assert len(content["events"][0, 0]["kind"]) > 0


def test_csv_files_give_back_every_float(result: Path, tmp_path: Path) -> None:
    written = frames.csv(result, tmp_path / "out", ["estimates", "runs"])
    assert [file.name for file, _ in written] == ["estimates.csv", "runs.csv"]
    frame = wsnsim.read(result, "estimates")
    again = pd.read_csv(tmp_path / "out" / "estimates.csv", converters={"px": float})
    assert list(again) == list(frame) and again["px"].tolist() == frame["px"].tolist()


def test_names_become_those_that_matlab_allows() -> None:
    long = "x" * 70
    names = ["px", "tracker.particles", "tracker_particles", "2nd", "end", "_a", "größe", long, long + "y"]
    legal = legal_names(names)
    assert legal[:6] == ["px", "tracker_particles", "tracker_particles_2", "x_2nd", "x_end", "x__a"]
    assert len(set(legal)) == len(names) and all(len(name) <= 63 and name.isascii() for name in legal)


def test_columns_of_mixed_values_become_texts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = pd.DataFrame({"tracker.kind": ["ekf", None, "pf"], "n": [1, 2, 3], "mixed": [1, "a", 2.5]})
    monkeypatch.setattr(frames, "read_tables", lambda *_: [("runs", frame)])
    frames.matlab(tmp_path, tmp_path / "x.mat")
    struct = loadmat(tmp_path / "x.mat")["runs"][0, 0]
    assert [cell[0] if cell.size else "" for cell in struct["tracker_kind"][:, 0]] == ["ekf", "", "pf"]
    assert [cell[0] for cell in struct["mixed"][:, 0]] == ["1", "a", "2.5"]


def test_a_table_that_the_format_cannot_hold_is_refused_before_anything_is_written(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frames, "LARGEST", 10)
    with pytest.raises(UsageError, match=r"small.h5: column .*, a MATLAB file holds 2.1 GB a variable"):
        frames.matlab(result, tmp_path / "x.mat")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named(result: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(StorageError, match=r"out/runs.csv: cannot be written"):
        frames.csv(result, tmp_path / "out", ["runs"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "say what to write: --csv DIR, --parquet DIR or --mat FILE.mat"),
        (["--mat", "x.txt"], "ends in .mat"),
        (["--mat", "missing/x.mat"], "folder does not exist: missing"),
        (["--mat", "x.mat", "--table", "estimate"], "did you mean 'estimates'?"),
    ],
)
def test_wrong_options_are_one_sentence(
    arguments: list[str],
    words: str,
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run_command(capsys, "export", str(result), *arguments)
    assert answer.code == 2 and words in answer.err and answer.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_all_formats_at_once(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run_command(capsys, "export", str(result), "--csv", "out", "--mat", "x.mat", "--table", "runs")
    assert answer.code == 0 and answer.out.splitlines() == ["out/runs.csv: 2 rows", "x.mat: runs: 2 rows"]
