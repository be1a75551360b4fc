"""Readers answer with arrays, or with one clear message."""

from __future__ import annotations

import h5py
import pytest

from wsnsim.base.errors import ResultError
from wsnsim.recording import ResultFile, attributes, meanings, read_table, read_text, tables


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


def test_a_result_of_a_newer_wsnsim_is_named_so(result):
    with h5py.File(result, "r+") as file:
        file.attrs["schema_version"] = 2
    with pytest.raises(ResultError, match="was written by a newer wsnsim"):
        tables(result)


def test_a_truncated_result_is_named_so(result):
    result.write_bytes(result.read_bytes()[:-2_000])
    with pytest.raises(ResultError, match="cannot be read: truncated file"):
        read_table(result, "truth")


def test_damaged_values_are_never_read_as_values(result):
    with h5py.File(result) as file:
        place = file["truth/px"].id.get_chunk_info(0)
    damaged = bytearray(result.read_bytes())
    damaged[place.byte_offset + place.size // 2] ^= 0xFF
    result.write_bytes(damaged)
    with pytest.raises(ResultError, match="cannot be read"):
        read_table(result, "truth")
    assert len(read_table(result, "truth", ["time"])["time"]) == 40
