"""The rows of a campaign's files in one file: as if they were read one by one, and never those of former files."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from wsnsim.base.errors import ResultError, StorageError
from wsnsim.recording import ResultFile, kept, read_table
from wsnsim.recording.kept import read_consolidated


@pytest.fixture
def write(tmp_path, states, rows_of, monkeypatch):
    """write(name, seed): a file with five rows of `runs`. Files count as old at once."""
    monkeypatch.setattr(kept, "SETTLED", -1)

    def written(name: str, seed: int) -> Path:
        path = tmp_path / "point" / name
        path.parent.mkdir(exist_ok=True)
        with ResultFile(path, states, {"runs": True}) as file:
            file.write("runs", rows_of("runs", 5, seed))
        return path

    return written


@pytest.fixture
def files(write) -> list[Path]:
    return [write(f"r{5 * i:05d}-{5 * i + 4:05d}.h5", i) for i in range(3)]


def assert_rows(found, files) -> None:
    """That these are the rows of the files as they are now."""
    assert found is not None
    (records, words), counts = found
    assert counts.tolist() == [5] * len(files)
    held = [read_table(file, "runs") for file in files]
    assert list(records.dtype.names) == list(held[0])
    for name in held[0]:
        assert records[name].tobytes() == np.concatenate([columns[name] for columns in held]).tobytes()
    assert words == {"status": ("complete", "partial", "failed")}


def kept_in(folder: Path) -> Path:
    return folder / "consolidated" / "runs.rows"


def test_the_second_reading_opens_no_result_file(tmp_path, files, monkeypatch):
    assert_rows(read_consolidated(tmp_path, "runs", files), files)
    monkeypatch.setattr(kept, "read_packed_rows", None)
    assert_rows(read_consolidated(tmp_path, "runs", files), files)
    assert [path.name for path in kept_in(tmp_path).parent.iterdir()] == ["runs.rows"]


@pytest.mark.thorough
def test_a_replaced_an_added_and_a_missing_file_are_noticed(tmp_path, files, write):
    for change in (
        lambda: write(files[1].name, 9),
        lambda: files.append(write("r00015-00019.h5", 3)),
        lambda: files.pop(0),
    ):
        before = read_consolidated(tmp_path, "runs", files)
        assert_rows(before, files)
        change()
        assert_rows(read_consolidated(tmp_path, "runs", files), files)


def test_a_file_changed_in_place_with_its_size_and_times_put_back_is_noticed(tmp_path, files, write):
    read_consolidated(tmp_path, "runs", files)
    other, times = write("other.h5", 7).read_bytes(), files[0].stat()
    assert len(other) == times.st_size
    files[0].write_bytes(other)
    os.utime(files[0], ns=(times.st_atime_ns, times.st_mtime_ns))
    assert_rows(read_consolidated(tmp_path, "runs", files), files)


@pytest.mark.thorough(fast=["0.0"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.99])
def test_what_is_kept_is_not_believed_when_damaged(tmp_path, files, share):
    read_consolidated(tmp_path, "runs", files)
    intact = kept_in(tmp_path).read_bytes()
    place = int(share * len(intact))
    for damaged in (intact[:place], intact[:place] + bytes([intact[place] ^ 0xFF]) + intact[place + 1 :]):
        kept_in(tmp_path).write_bytes(damaged)
        assert_rows(read_consolidated(tmp_path, "runs", files), files)


@pytest.mark.parametrize(
    "change",
    [
        {"types": [["seed", "O"]]},
        {"types": [["seed", "V0"]]},
        {"types": 5},
        {"counts": [2**70]},
        {"counts": "x"},
        {"words": []},
        {"stamp": ""},
    ],
    ids=str,
)
def test_no_entry_that_was_changed_with_its_digest_is_believed_or_stops_the_reading(tmp_path, files, change):
    read_consolidated(tmp_path, "runs", files)
    _, head, rows = kept_in(tmp_path).read_bytes().split(b"\n", 2)
    content = json.dumps(json.loads(head) | change).encode() + b"\n" + rows
    kept_in(tmp_path).write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
    assert_rows(read_consolidated(tmp_path, "runs", files), files)


def test_a_damaged_result_file_is_found_whatever_is_kept(tmp_path, files):
    read_consolidated(tmp_path, "runs", files)
    files[1].write_bytes(files[1].read_bytes()[:-300])
    with pytest.raises(ResultError, match=f"{files[1].name}: cannot be read"):
        read_consolidated(tmp_path, "runs", files)


def test_a_folder_that_cannot_be_written_is_read_all_the_same(tmp_path, files, monkeypatch):
    def refuse(*_):
        raise StorageError("read-only")

    monkeypatch.setattr(kept, "write_atomically", refuse)
    assert_rows(read_consolidated(tmp_path, "runs", files), files)
    assert not kept_in(tmp_path).exists()


def test_files_that_may_still_change_unnoticed_are_not_kept(tmp_path, files, monkeypatch):
    monkeypatch.setattr(kept, "SETTLED", 10**12)
    assert_rows(read_consolidated(tmp_path, "runs", files), files)
    assert not kept_in(tmp_path).exists()


def test_files_with_other_columns_are_not_put_together(tmp_path, files, monkeypatch, states, rows_of):
    from wsnsim.base import tables

    with monkeypatch.context() as patch:
        patch.setitem(tables.TABLES, "runs", tables.TABLES["runs"][:-1])
        with ResultFile(tmp_path / "point" / "old.h5", states, {"runs": True}) as file:
            file.write("runs", rows_of("runs", 5))
    assert read_consolidated(tmp_path, "runs", [*files, tmp_path / "point" / "old.h5"]) is None
