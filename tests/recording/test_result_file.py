"""The writer: rows are read back as written, files with a final name are complete, and small files stay small."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import KINDS, TABLES, columns_of
from wsnsim.recording import ResultFile, attributes, meanings, read_table, read_text, tables
from wsnsim.recording.rows import SCHEMA_VERSION

EVERYTHING = dict.fromkeys(TABLES, True)


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_every_table_comes_back_as_it_was_written(tmp_path, states, rows_of):
    written = {table: rows_of(table, 30) for table in TABLES}
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        for table, rows in written.items():
            file.write(table, rows)
    assert names_in(tmp_path) == ["x.h5"]
    for table, rows in written.items():
        read = read_table(tmp_path / "x.h5", table)
        assert list(read) == [column.name for column in columns_of(table, states)]
        for column in columns_of(table, states):
            assert read[column.name].dtype == column.dtype
            np.testing.assert_array_equal(read[column.name], rows[column.name])


@pytest.mark.thorough
def test_rows_written_in_pieces_keep_their_order_over_chunks(tmp_path, states, rows_of):
    rows = rows_of("events", 150_000)
    rows["frame"] = np.arange(150_000, dtype="u4")
    cuts = [0, 1, 65_535, 65_537, 140_000, 150_000]
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        for start, end in pairwise(cuts):
            file.write("events", {name: values[start:end] for name, values in rows.items()})
    read = read_table(tmp_path / "x.h5", "events")
    for name, values in rows.items():
        np.testing.assert_array_equal(read[name], values)
    with h5py.File(tmp_path / "x.h5") as file:
        assert {file["events"][name].chunks for name in rows} == {(65_536,)}


def test_whole_chunks_reach_the_disk_while_the_run_goes_on(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, {"events": True}) as file:
        (tmp,) = tmp_path.iterdir()
        before = tmp.stat().st_size
        file.write("events", rows_of("events", 65_535))
        assert tmp.stat().st_size == before
        file.write("events", rows_of("events", 1))
        assert tmp.stat().st_size > before + 500_000
        assert not (tmp_path / "x.h5").exists()


@pytest.mark.thorough
@given(
    st.lists(
        st.lists(
            st.tuples(
                st.integers(0, 2**32 - 1),
                st.integers(-(2**31), 2**31 - 1),
                st.floats(width=64),
                st.integers(0, 2**64 - 1),
                st.integers(0, 2**16 - 1),
            ),
            max_size=12,
        ),
        max_size=6,
    ),
    st.booleans(),
)
def test_any_columns_in_any_pieces_come_back_bit_by_bit(tmp_path_factory, pieces, as_lists):
    path = tmp_path_factory.mktemp("any") / "x.h5"
    names = ("cluster", "head", "formed", "handover_bits", "members")
    types = {column.name: column.dtype for column in columns_of("clusters")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wsnsim.recording.rows.CHUNK", 8)
        with ResultFile(path, (), {"clusters": True}) as file:
            for piece in pieces:
                values = zip(*piece, strict=True) if piece else [()] * len(names)
                rows = {name: 1 for name in types if name not in names}
                for name, column in zip(names, values, strict=True):
                    rows[name] = list(column) if as_lists else np.array(column, types[name])
                file.write("clusters", rows)
    read = read_table(path, "clusters")
    whole = [row for piece in pieces for row in piece]
    for index, name in enumerate(names):
        expected = np.array([row[index] for row in whole], dtype=types[name])
        assert read[name].tobytes() == expected.tobytes()
    assert read["target"].tolist() == [1] * len(whole)


def test_scalars_are_repeated_and_lists_are_taken(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, {"energy": True}) as file:
        file.write("energy", {"replicate": 3, "node": [4, 5], "cause": np.uint8(1), "joules": [0.25, 0.5]})
        file.write("energy", {"replicate": 4, "node": 6, "cause": 0, "joules": 1.0})
    read = read_table(tmp_path / "x.h5", "energy")
    assert read["replicate"].tolist() == [3, 3, 4]
    assert read["node"].tolist() == [4, 5, 6]
    assert read["cause"].tolist() == [1, 1, 0]
    assert read["joules"].tolist() == [0.25, 0.5, 1.0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"jouls": 1.0}, "has no column jouls"),
        ({"joules": None}, "lack column joules"),
        ({"joules": np.ones(3)}, "differ in length"),
        ({"node": 2**31}, "do not fit int32"),
        ({"node": 0.5}, "do not fit int32"),
        ({"cause": -1}, "do not fit uint8"),
        ({"replicate": float("nan")}, "do not fit uint32"),
        ({"joules": np.ones((2, 2))}, "a vector"),
    ],
)
def test_rows_that_the_table_cannot_hold_are_refused_with_a_sentence(tmp_path, states, change, sentence):
    rows = {"replicate": 0, "node": np.arange(2), "cause": 0, "joules": 1.0} | change
    rows = {name: value for name, value in rows.items() if value is not None}
    with pytest.raises(AssertionError, match=sentence), ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        file.write("energy", rows)


def test_a_table_that_nobody_has_heard_of_is_refused(tmp_path, states):
    with pytest.raises(AssertionError, match="unknown table"), ResultFile(tmp_path / "x.h5", states, {}) as file:
        file.write("event", {})
    with pytest.raises(AssertionError, match="unknown tables"):
        ResultFile(tmp_path / "x.h5", states, {"event": True})


def test_rows_of_tables_that_are_not_wanted_are_dropped(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, {"truth": True, "events": False}) as file:
        assert file.wants("truth")
        assert not file.wants("events")
        assert not file.wants("energy")
        file.write("events", rows_of("events", 5))
    assert list(tables(tmp_path / "x.h5")) == ["truth"]


def test_a_wanted_table_without_rows_has_all_its_columns_empty(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, {"truth": True, "events": True}):
        pass
    read = read_table(tmp_path / "x.h5", "truth")
    assert list(read) == ["replicate", "target", "step", "time", "px", "vx", "py", "vy"]
    assert all(values.shape == (0,) for values in read.values())
    assert meanings(tmp_path / "x.h5", "events", "kind") == KINDS


def test_columns_are_described_so_that_plain_h5py_needs_nothing_else(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        file.write("events", rows_of("events", 30))
        file.write("truth", rows_of("truth", 3_000))
    with h5py.File(tmp_path / "x.h5") as file:
        assert (file.attrs["status"], file.attrs["schema_version"]) == ("complete", SCHEMA_VERSION)
        time, kind, speed = file["events/time"], file["events/kind"], file["truth/vx"]
        assert list(file["events"].attrs["columns"]) == [column.name for column in columns_of("events")]
        assert (time.attrs["units"], time.attrs["description"]) == ("s", "simulated time")
        assert (speed.attrs["units"], speed.shuffle) == ("m/s", True)
        chunks = speed.chunks, speed.compression, speed.compression_opts
        assert chunks == ((3_000,), "gzip", 1)
        assert not file["truth/step"].shuffle
        assert time.chunks is None, "short columns are stored with their description"
        assert kind.attrs["flag_values"].tolist() == list(range(len(KINDS)))
        assert kind.attrs["flag_values"].dtype == kind.dtype
        assert kind.attrs["flag_meanings"].split(" ") == list(KINDS)
        assert "flag_values" not in time.attrs


def test_plain_h5py_and_pandas_read_a_table_in_two_lines(tmp_path, states, rows_of):
    rows = rows_of("estimates", 30)
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        file.write("estimates", rows)
    with h5py.File(tmp_path / "x.h5") as file:
        frame = pd.DataFrame({name: file["estimates"][name][:] for name in file["estimates"].attrs["columns"]})
    assert list(frame) == list(rows)
    np.testing.assert_array_equal(frame["error"], rows["error"])


@pytest.mark.thorough
def test_the_words_of_a_run_are_the_meanings_of_what(tmp_path, states, rows_of):
    rows = rows_of("events", 3)
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        codes = [file.words.code(word) for word in ("", "local estimate", "local_estimate", "weights")]
        file.write("events", rows_of("events", 65_536))
        file.words.code("none")
        file.write("events", rows | {"what": codes[1:]})
    words = meanings(tmp_path / "x.h5", "events", "what")
    assert words == ("none", "local_estimate", "local_estimate_2", "weights", "none_4")
    assert read_table(tmp_path / "x.h5", "events", ["what"])["what"][-3:].tolist() == [1, 2, 3]


def test_texts_come_back_and_provenance_learns_when_the_run_ended(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, {}) as file:
        file.set_text("scenario/source_yaml", "name: naïve  # 5 µs\n")
        file.set_text("scenario/resolved_json", "{}")
        file.set_text("provenance_json", json.dumps({"start": "then"}))
        with pytest.raises(AssertionError, match="unknown text"):
            file.set_text("scenario/source", "")
    assert read_text(tmp_path / "x.h5", "scenario/source_yaml") == "name: naïve  # 5 µs\n"
    assert read_text(tmp_path / "x.h5", "scenario/resolved_json") == "{}"
    made = json.loads(read_text(tmp_path / "x.h5", "provenance_json"))
    assert made["start"] == "then"
    assert made["end"].endswith("+00:00")
    assert attributes(tmp_path / "x.h5")["states"] == states


def test_small_files_stay_small(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "all.h5", states, EVERYTHING) as file:
        for table in TABLES:
            file.write(table, rows_of(table, 30))
    with ResultFile(tmp_path / "summary.h5", states, {"runs": True, "tracks": True}) as file:
        for table in ("runs", "tracks"):
            file.write(table, rows_of(table, 30))
    for name, chosen in (("all.h5", TABLES), ("summary.h5", ("runs", "tracks"))):
        columns = sum(len(columns_of(table, states)) for table in chosen)
        assert (tmp_path / name).stat().st_size < 1_000 * columns, "a column needs no chunk index, which takes 2 kB"


def test_the_file_of_a_block_takes_less_than_60_kb(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, {"runs": True, "tracks": True}) as file:
        for text in ("scenario/source_yaml", "scenario/resolved_json"):
            file.set_text(text, "x" * 6_000)
        for table in ("runs", "tracks"):
            file.write(table, rows_of(table, 5))
    assert (tmp_path / "x.h5").stat().st_size < 60_000


def test_the_file_has_a_superblock_with_a_checksum_that_hdf5_1_8_reads(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING):
        pass
    start = (tmp_path / "x.h5").read_bytes()[:9]
    assert start == b"\x89HDF\r\n\x1a\n\x02"


@pytest.mark.thorough
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_what_was_there_before(tmp_path, states, rows_of, error):
    (tmp_path / "x.h5").write_text("of old")
    with pytest.raises(error), ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        file.write("events", rows_of("events", 70_000))
        raise error
    assert names_in(tmp_path) == ["x.h5"]
    assert (tmp_path / "x.h5").read_text() == "of old"


def test_ctrl_c_while_the_file_is_being_finished_leaves_nothing(tmp_path, states, rows_of, monkeypatch):
    def interrupt(path):
        raise KeyboardInterrupt

    monkeypatch.setattr("wsnsim.recording.atomic_files._synchronise", interrupt)
    with pytest.raises(KeyboardInterrupt), ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
        file.write("events", rows_of("events", 10))
    assert names_in(tmp_path) == []


@pytest.mark.thorough
def test_a_complete_file_takes_the_place_of_an_older_one(tmp_path, states, rows_of):
    for count in (3, 5):
        with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as file:
            file.write("truth", rows_of("truth", count))
        assert tables(tmp_path / "x.h5")["truth"].rows == count


@pytest.mark.thorough
def test_writers_of_one_name_do_not_meet(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as first:
        with ResultFile(tmp_path / "x.h5", states, EVERYTHING) as second:
            assert len(list(tmp_path.iterdir())) == 2
            second.write("truth", rows_of("truth", 5))
        first.write("truth", rows_of("truth", 3))
        assert tables(tmp_path / "x.h5")["truth"].rows == 5
    assert tables(tmp_path / "x.h5")["truth"].rows == 3
    assert names_in(tmp_path) == ["x.h5"]


def test_what_a_killed_run_of_the_same_process_id_left_is_not_overwritten(tmp_path, states):
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING):
        (tmp,) = tmp_path.iterdir()
    tmp.write_text("precious")
    with ResultFile(tmp_path / "x.h5", states, EVERYTHING):
        pass
    assert tmp.read_text() == "precious"
    assert names_in(tmp_path) == sorted([tmp.name, "x.h5"])


@pytest.mark.parametrize("place", ["missing/x.h5", "file/x.h5", "folder", f"{'n' * 250}.h5"])
def test_a_place_that_cannot_be_written_is_named(tmp_path, states, place):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ResultError, match="cannot be written") as caught, ResultFile(tmp_path / place, states, {}):
        pass
    assert str(caught.value).startswith(str(tmp_path / place))
    assert names_in(tmp_path) == ["file", "folder"]


FILLS_THE_DISK = """
import resource, sys
from pathlib import Path
from wsnsim.base.errors import ResultError
from wsnsim.recording import ResultFile
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with ResultFile(Path(sys.argv[1]), (), {"energy": True}) as file:
        for i in range(5):
            file.write("energy", {"replicate": i, "node": list(range(40_000)), "cause": 0, "joules": i * 0.1})
except ResultError as error:
    print(error)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("limit", [100, 10_000, 100_000])
def test_a_full_disk_is_an_error_with_its_reason_and_leaves_nothing(tmp_path, limit):
    command = [sys.executable, "-c", FILLS_THE_DISK, str(tmp_path / "x.h5"), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.lower() == f"{tmp_path / 'x.h5'}: cannot be written: file too large\n".lower()
    assert done.stderr == ""
    assert names_in(tmp_path) == []


@pytest.mark.thorough
def test_two_processes_write_one_name_at_a_time_and_the_last_to_end_stays(tmp_path, states, rows_of):
    script = f"""
from pathlib import Path
from wsnsim.recording import ResultFile
with ResultFile(Path({str(tmp_path / "x.h5")!r}), (), {{"energy": True}}) as file:
    file.write("energy", {{"replicate": 0, "node": [1, 2], "cause": 0, "joules": 1.0}})
"""
    with ResultFile(Path(tmp_path / "x.h5"), states, {"truth": True}) as file:
        subprocess.run([sys.executable, "-c", script], check=True, timeout=60)
        assert list(tables(tmp_path / "x.h5")) == ["energy"]
        file.write("truth", rows_of("truth", 2))
    assert list(tables(tmp_path / "x.h5")) == ["truth"]
    assert names_in(tmp_path) == ["x.h5"]


def test_temporary_names_cannot_be_foreseen_and_follow_no_link(tmp_path, monkeypatch):
    """Somebody else who may write into the folder has put links under the names that used to be taken."""
    from wsnsim.recording import atomic_files

    victim = tmp_path / "victim"
    victim.write_text("mine")
    tokens = iter(["guessed", "other"])
    monkeypatch.setattr(atomic_files.secrets, "token_hex", lambda _: next(tokens))
    place = tmp_path / "x.txt"
    (tmp_path / f"x.txt.{atomic_files.host()}.{os.getpid()}-guessed.tmp").symlink_to(victim)
    atomic_files.write_text_atomically(place, "yours")
    assert victim.read_text() == "mine" and place.read_text() == "yours"


@pytest.mark.thorough
def test_a_file_has_one_writer_at_a_time_until_that_is_killed(tmp_path):
    from wsnsim.base.errors import UsageError
    from wsnsim.recording.atomic_files import sole_writer

    place = tmp_path / "x.h5"
    text = "import pathlib, sys, time\nfrom wsnsim.recording.atomic_files import sole_writer\n"
    text += "with sole_writer(pathlib.Path(sys.argv[1])):\n    print('locked', flush=True)\n    time.sleep(600)\n"
    with subprocess.Popen([sys.executable, "-c", text, str(place)], stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"locked\n"
        with pytest.raises(UsageError, match="another run is writing"), sole_writer(place):
            pass
        other.kill()
    with sole_writer(place):
        pass
    assert list(tmp_path.iterdir()) == []
