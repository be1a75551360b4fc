"""A result becomes a DataFrame: words instead of codes, files below each other, and a summary that reads little."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from wsnsim.analysis.frames import read
from wsnsim.analysis.result_info import info, info_text
from wsnsim.base.errors import ResultError
from wsnsim.base.tables import DUTY_CYCLED, KINDS, TABLES, UNLABELLED
from wsnsim.recording import ResultFile
from wsnsim.recording.provenance import provenance


@pytest.fixture
def write(tmp_path, states):
    """write(name, words, **{table: rows}): a result file whose events know these words."""

    def write_file(name, words=(), **rows):
        with ResultFile(tmp_path / name, states, dict.fromkeys(TABLES, True)) as file:
            for word in words:
                file.words.code(word)
            for table, columns in rows.items():
                file.write(table, columns)
            file.set_text("scenario/resolved_json", json.dumps({"name": "pso_mhpf", "seed": 20131101}))
            file.set_text("provenance_json", json.dumps(provenance("wsnsim run x.yaml", 20131101)))
        return tmp_path / name

    return write_file


def test_a_table_is_a_frame_with_its_columns_in_order(write, rows_of):
    rows = rows_of("estimates", 20)
    frame = read(write("x.h5", estimates=rows), "estimates")
    assert list(frame) == list(rows)
    for name, values in rows.items():
        np.testing.assert_array_equal(frame[name].to_numpy(), values)
        assert frame[name].dtype == values.dtype


def test_only_the_columns_asked_for_are_read(write, rows_of):
    path = write("x.h5", estimates=rows_of("estimates", 20))
    assert list(read(str(path), "estimates", columns=["error", "time"])) == ["error", "time"]


def test_categories_are_their_words(write, rows_of):
    rows = rows_of("events", 4) | {"kind": [0, 19, 7, 8], "what": [1, 2, 0, 1]}
    frame = read(write("x.h5", ["weights", "local estimate"], events=rows), "events")
    assert isinstance(frame["kind"].dtype, pd.CategoricalDtype)
    assert frame["kind"].tolist() == ["wake", "death", "send", "receive"]
    assert tuple(frame["kind"].cat.categories) == KINDS
    assert frame["what"].tolist() == ["weights", "local_estimate", "none", "weights"]


def test_a_code_without_a_word_is_still_told_apart(write, rows_of):
    frame = read(write("x.h5", ["weights"], events=rows_of("events", 3) | {"what": [1, 3, 0]}), "events")
    assert frame["what"].tolist() == ["weights", "unknown_3", "none"]


def test_a_table_without_rows_is_an_empty_frame_with_its_columns(write):
    frame = read(write("x.h5"), "events")
    assert len(frame) == 0
    assert list(frame)[:3] == ["replicate", "time", "step"]
    assert isinstance(frame["kind"].dtype, pd.CategoricalDtype)


@pytest.mark.thorough
def test_a_pattern_puts_files_below_each_other_and_names_them(tmp_path, write, rows_of):
    for name, count in (("b1.h5", 3), ("b2.h5", 2), ("other.h5", 9)):
        write(name, truth=rows_of("truth", count, seed=count))
    frame = read(tmp_path / "b*.h5", "truth")
    assert frame["file"].tolist() == [str(tmp_path / "b1.h5")] * 3 + [str(tmp_path / "b2.h5")] * 2
    assert frame["px"].tolist() == [*rows_of("truth", 3, seed=3)["px"], *rows_of("truth", 2, seed=2)["px"]]
    assert list(frame.index) == [0, 1, 2, 3, 4]


def test_a_pattern_is_relative_to_where_one_stands(tmp_path, write, rows_of, monkeypatch):
    write("x.h5", truth=rows_of("truth", 1))
    monkeypatch.chdir(tmp_path.parent)
    assert read(f"{tmp_path.name}/?.h5", "truth")["file"].tolist() == [f"{tmp_path.name}/x.h5"]


@pytest.mark.thorough
def test_words_that_files_learnt_in_different_orders_are_the_same_words(tmp_path, write, rows_of):
    write("a.h5", ["weights", "counts"], events=rows_of("events", 2) | {"what": [1, 2]})
    write("b.h5", ["counts", "ack", "weights"], events=rows_of("events", 3) | {"what": [1, 2, 3]})
    frame = read(tmp_path / "*.h5", "events")
    assert frame["what"].tolist() == ["weights", "counts", "counts", "ack", "weights"]
    assert frame["kind"].dtype == read(tmp_path / "a.h5", "events")["kind"].dtype


def test_files_with_other_state_columns_are_not_mixed_unless_columns_are_named(tmp_path, write, rows_of):
    write("a.h5", truth=rows_of("truth", 2))
    with ResultFile(tmp_path / "b.h5", [("x", "m")], {"truth": True}) as file:
        file.write("truth", {"replicate": 0, "target": 0, "step": 1, "time": 0.5, "x": 2.0})
    with pytest.raises(ResultError, match=r"b\.h5: table truth has other columns than in .*a\.h5"):
        read(tmp_path / "*.h5", "truth")
    assert len(read(tmp_path / "*.h5", "truth", ["step", "time"])) == 3


def test_runs_of_duty_cycled_macs_have_columns_that_others_leave_unknown(tmp_path, write, rows_of, states):
    rows = rows_of("runs", 2)
    write("a.h5", runs={name: values for name, values in rows.items() if name not in DUTY_CYCLED})
    with ResultFile(tmp_path / "b.h5", states, {"runs": True}, duty_cycled=True) as file:
        file.write("runs", {**rows, "radio_on": [0.25, 0.5], "hurried": [0.0, 0.1]})
    frame = read(tmp_path / "*.h5", "runs")
    np.testing.assert_array_equal(frame["radio_on"], [np.nan, np.nan, 0.25, 0.5])
    labelled = [column.name for column in TABLES["runs"] if column.name not in UNLABELLED]
    assert [name for name in frame if name != "file"] == labelled


def test_a_file_whose_name_looks_like_a_pattern_is_a_file(write, rows_of):
    path = write("run[1].h5", truth=rows_of("truth", 2))
    assert "file" not in read(path, "truth")


@pytest.mark.parametrize(
    ("name", "table", "columns", "sentence"),
    [
        ("y.h5", "truth", None, "no such file"),
        ("y*.h5", "truth", None, "no file matches"),
        ("x.h5", "estimate", None, "did you mean 'estimates'?"),
        ("*.h5", "truth", ["pxx"], "did you mean 'px'?"),
    ],
)
def test_what_is_not_there_brings_the_nearest(tmp_path, write, rows_of, name, table, columns, sentence):
    write("x.h5", truth=rows_of("truth", 2))
    with pytest.raises(ResultError, match=sentence.replace("?", r"\?")):
        read(tmp_path / name, table, columns)


def runs(rows_of):
    known = {
        "rmse": [1.0, 2.0],
        "lost": [0, 1],
        "losses": [0, 1],
        "energy": [0.5, 0.25],
        "first_death": np.nan,
        "median_error": np.nan,
    }
    return rows_of("runs", 2) | known | {"fingerprint": [5, 2**63 + 1]}


@pytest.mark.thorough
def test_info_says_what_a_file_is_about(write, rows_of):
    path = write("x.h5", runs=runs(rows_of), events=rows_of("events", 300))
    about = info(path)
    assert (about["name"], about["seed"], about["replicates"], about["status"]) == ("pso_mhpf", 20131101, 2, "complete")
    assert about["bytes"] == path.stat().st_size
    assert about["tables"]["events"]["rows"] == 300
    assert about["tables"]["truth"]["rows"] == 0
    assert [about["figures"][name] for name in ("rmse_median", "lost", "energy")] == [1.5, 0.5, 0.375]
    assert not {"rmse", "median_error"} & set(about["figures"]), "no estimates are recorded"
    assert about["fingerprints"] == ["0000000000000005", "8000000000000001"]
    assert about["provenance"]["command_line"] == "wsnsim run x.yaml"
    assert json.loads(json.dumps(about)) == about


@pytest.mark.thorough
def test_info_text_says_it_in_few_lines(write, rows_of):
    text = info_text(write("x.h5", runs=runs(rows_of), events=rows_of("events", 3_000)))
    assert "x.h5: complete, " in text
    assert "pso_mhpf, seed 20131101, 2 Monte Carlo runs" in text
    assert "wsnsim run x.yaml" in text
    assert any(line.split()[:3] == ["events", "3,000", "14"] for line in text.splitlines())
    assert any(line.split() == ["median", "per-run", "RMSE", "1.5000", "m"] for line in text.splitlines())
    assert len(text.splitlines()) < 60  # a line a quantity
    assert max(map(len, text.splitlines())) < 200


def test_info_of_a_bare_file_does_not_stumble(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, {"truth": True}):
        pass
    assert info(tmp_path / "x.h5")["replicates"] is None
    assert "(not stored)" in info_text(tmp_path / "x.h5")


def test_info_of_what_is_no_result_is_one_message(tmp_path):
    (tmp_path / "x.h5").write_text("no")
    with pytest.raises(ResultError, match="is not a wsnsim result"):
        info_text(tmp_path / "x.h5")
