"""Readers answer with arrays, or with one clear message."""

from __future__ import annotations

import h5py
import pytest

import wsnsim
from wsnsim.base.errors import ResultError
from wsnsim.base.tables import columns_of
from wsnsim.recording import ResultFile, attributes, meanings, read_table, read_text, read_with_meanings, tables
from wsnsim.recording.rows import read_packed_rows
from wsnsim.verification import verify


@pytest.fixture
def result(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "pso_mhpf.h5", states, {"truth": True, "estimates": True, "energy": True}) as file:
        file.write("truth", rows_of("truth", 40))
        file.write("energy", rows_of("energy", 7))
        file.set_text("scenario/source_yaml", "name: x")
    return tmp_path / "pso_mhpf.h5"


def test_columns_come_in_the_order_asked_for(result, rows_of):
    read = read_table(str(result), "truth", ["py", "time"])
    assert list(read) == ["py", "time"]
    assert read["py"].tolist() == rows_of("truth", 40)["py"].tolist()


def test_a_range_of_rows_is_that_part_of_the_table(result, rows_of):
    whole = rows_of("truth", 40)
    part = read_table(result, "truth", rows=slice(7, 12))
    assert {name: values.tolist() for name, values in part.items()} == {
        name: values[7:12].tolist() for name, values in whole.items()
    }
    assert read_table(result, "truth", ["time"], slice(38, 99))["time"].tolist() == whole["time"][38:].tolist()
    assert read_table(result, "truth", ["time"], slice(40, 50))["time"].size == 0


def test_tables_say_how_much_they_hold(result):
    sizes = tables(result)
    assert {name: size.rows for name, size in sizes.items()} == {"truth": 40, "estimates": 0, "energy": 7}
    assert sizes["energy"].columns == ("replicate", "node", "cause", "joules")
    assert 40 < sizes["truth"].stored_bytes < 3_000


def test_only_categories_have_meanings(result):
    assert meanings(result, "energy", "cause")[:2] == ("tx_electronics", "tx_amplifier")
    assert meanings(result, "energy", "joules") == ()


@pytest.mark.parametrize(
    ("read", "sentence"),
    [
        (lambda path: read_table(path, "thruth"), "has no table 'thruth' (did you mean 'truth'?)"),
        (lambda path: read_table(path, "events"), "has no table 'events' (known: energy, estimates, truth)"),
        (lambda path: read_table(path, "scenario"), "has no table 'scenario'"),
        (lambda path: read_table(path, "truth", ["tme"]), "table truth has no column 'tme' (did you mean 'time'?)"),
        (lambda path: meanings(path, "energy", "cuase"), "table energy has no column 'cuase' (did you mean 'cause'?)"),
        (lambda path: read_text(path, "provenance_json"), "has no text 'provenance_json'"),
        (lambda path: tables(path.with_name("pso_mhfp.h5")), "no such file, did you mean '{folder}/pso_mhpf.h5'?"),
        (lambda path: tables(path.with_name("elsewhere.h5")), "no such file"),
        (lambda path: tables(path.with_name("x" * 300) / "elsewhere.h5"), "no such file"),
        (lambda path: tables(path.parent), "is a folder, not a result"),
    ],
)  # fmt: skip
def test_a_name_that_is_not_there_brings_the_nearest(result, read, sentence):
    with pytest.raises(ResultError) as caught:
        read(result)
    assert sentence.format(folder=result.parent) in str(caught.value)
    assert str(caught.value).startswith(str(result.parent))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"name: a scenario\n", b"\x00" * 5_000, b"\x89HDF\r\n\x1a\n" + b"\x00" * 900])
def test_what_is_not_hdf5_is_named_so(tmp_path, content):
    (tmp_path / "x.h5").write_bytes(content)
    for read in (tables, attributes):
        with pytest.raises(ResultError, match=r"x\.h5: (is not a wsnsim result|cannot be read): \w"):
            read(tmp_path / "x.h5")


def test_an_hdf5_file_of_somebody_else_is_named_so(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["truth"] = [1.0, 2.0]
    with pytest.raises(ResultError, match="is an HDF5 file, but not a wsnsim result"):
        read_table(tmp_path / "x.h5", "truth")


@pytest.mark.parametrize(("schema", "age"), [(1, "an older"), (99, "a newer")])
@pytest.mark.parametrize("read", [tables, wsnsim.load, lambda path: wsnsim.read(path, "runs"), verify])
def test_a_result_of_another_version_and_its_scenario_are_refused_in_one_sentence(result, schema, age, read):
    with h5py.File(result, "r+") as file:
        file.attrs.update({"schema_version": schema, "wsnsim_version": "7.6"})
    sentence = (
        rf"written by {age} wsnsim \(7\.6\), whose files this one \(\S+\) does not read: use that version, or make .*$"
    )
    with pytest.raises(ResultError, match=sentence):
        read(result)


def test_a_truncated_result_is_named_so(result):
    result.write_bytes(result.read_bytes()[:-2_000])
    with pytest.raises(ResultError, match="cannot be read: truncated file"):
        read_table(result, "truth")


@pytest.mark.parametrize("rows", [40, 4_000])
def test_damaged_values_are_never_read_as_values(tmp_path, states, rows_of, rows):
    """40 values are stored with the description of their column, 4,000 in a compressed chunk."""
    result, written = tmp_path / "x.h5", rows_of("truth", rows)
    with ResultFile(result, states, {"truth": True}) as file:
        file.write("truth", written)
    damaged = bytearray(result.read_bytes())
    if rows == 40:
        damaged[damaged.index(written["px"].tobytes()) + 8] ^= 0xFF
    else:
        with h5py.File(result) as file:
            place = file["truth/px"].id.get_chunk_info(0)
        damaged[place.byte_offset + place.size // 2] ^= 0xFF
    result.write_bytes(damaged)
    with pytest.raises(ResultError, match="cannot be read"):
        read_table(result, "truth")
    assert len(read_table(result, "truth", ["time"])["time"]) == rows


@pytest.mark.thorough
def test_no_damaged_byte_of_a_block_changes_a_value_unnoticed(tmp_path, states, rows_of):
    """Every 499th byte of the file of a campaign's task: rows are read as written, or not at all."""
    result, written = tmp_path / "x.h5", rows_of("runs", 5)
    with ResultFile(result, states, {"runs": True}) as file:
        file.write("runs", written)
    intact, found = result.read_bytes(), {"read": 0, "refused": 0}
    for place in range(0, len(intact), 499):
        result.write_bytes(intact[:place] + bytes([intact[place] ^ 0xFF]) + intact[place + 1 :])
        for read in (read_table, lambda *at: read_with_meanings(*at)[0]):
            try:
                columns = read(result, "runs")
            except ResultError:
                found["refused"] += 1
            else:
                found["read"] += 1
                assert all(columns[name].tobytes() == values.tobytes() for name, values in written.items())
    assert min(found.values()) >= 10


@pytest.mark.thorough
def test_packed_rows_hold_what_the_columns_hold(tmp_path, states, rows_of):
    written = {table: rows_of(table, 5) for table in ("runs", "tracks")}
    with ResultFile(tmp_path / "x.h5", states, dict.fromkeys(written, True)) as file:
        for table, rows in written.items():
            file.write(table, rows)
    for table, rows in written.items():
        packed, columns = read_packed_rows(tmp_path / "x.h5", table), read_table(tmp_path / "x.h5", table)
        assert packed is not None and list(packed.records.dtype.names) == list(columns) == list(rows)
        for name, values in columns.items():
            assert packed.records[name].dtype == values.dtype
            assert packed.records[name].tobytes() == values.tobytes()
            assert packed.words.get(name, ()) == meanings(tmp_path / "x.h5", table, name)


def test_many_rows_and_other_tables_are_not_packed(tmp_path, states, rows_of):
    with ResultFile(tmp_path / "x.h5", states, {"runs": True, "tracks": True, "truth": True}) as file:
        file.write("runs", rows_of("runs", 100))
        file.write("truth", rows_of("truth", 5))
    for table in ("runs", "tracks", "truth"):
        assert read_packed_rows(tmp_path / "x.h5", table) is None
        assert len(read_with_meanings(tmp_path / "x.h5", table)[0]) == len(columns_of(table, states))
