"""Damaged and hostile result files: every reader answers with values of the right size or with one sentence."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import wsnsim
from tests.fuzz.hdf5_checksums import lookup3, with_checksums
from tests.fuzz.hdf5_edits import EDITS
from tests.fuzz.hdf5_mutants import edited, edited_mutants, long_text, random_mutants
from tests.fuzz.hdf5_session import answers
from wsnsim.base.errors import ResultError
from wsnsim.cli import main
from wsnsim.recording import ResultFile, attributes, read_table, read_text, read_with_meanings, tables
from wsnsim.recording.rows import TEXTS, read_packed_rows

TOO_MUCH = 50_000_000
"""Bytes that no column of the small file or of its mutants takes."""
EDITED = {"runs", "truth", "estimates"}
"""The tables that the edits change."""
REFUSED = (
    "external link", "external table", "soft link", "dangling link", "external text", "virtual", "external storage",
    "nested column", "huge, nothing stored", "huge, chunks missing", "huge chunk", "wide table", "shorter column",
    "texts as values", "records as values", "references", "lists as values", "negative runs", "real steps", "lzf",
    "checksummed", "short chunk", "unfiltered chunk", "short plain chunk", "group as column", "type as column",
    "thousands of objects", "columns thousands", "columns none", "columns doubled", "rows many", "rows of texts",
    "rows negative", "words of reals", "position outside", "states fewer", "schema a text", "text an array",
)  # fmt: skip


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A result of one run of a standalone filter, 20 kB."""
    path = tmp_path_factory.mktemp("intact") / "x.h5"
    wsnsim.run(wsnsim.load("rkf", ["duration=3 s"]), replicates=1, out=path)
    return path.read_bytes()


@pytest.fixture(autouse=True)
def _alone(fresh_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


def write_edited(intact: bytes, name: str) -> None:
    """Write x.h5, the file with one of the `EDITS`."""
    Path("x.h5").write_bytes(edited(intact, name))


def everything(path: Path) -> list[str]:
    """Read all that a file holds; the messages of what is refused. Any other error is a fault."""
    said = []

    def tried(read, *what):
        try:
            return read(path, *what)
        except ResultError as error:
            said.append(str(error))
            return None

    tried(attributes)
    sizes = tried(tables) or {}
    tables_read = [(read_with_meanings, table) for table in sorted(EDITED & sizes.keys())]
    for read, table in [*tables_read, (read_table, "runs"), (read_table, "truth")]:
        found = tried(read, table) or {}
        columns = found[0] if isinstance(found, tuple) else found
        assert sum(values.nbytes for values in columns.values()) < TOO_MUCH
    for name in TEXTS:
        tried(read_text, name)
    read_packed_rows(path, "runs")
    assert all(message.startswith(str(path)) and "\n" not in message for message in said)
    return said


@pytest.mark.thorough
def test_a_file_that_was_edited_is_read_or_refused_with_one_sentence(intact: bytes) -> None:
    refused = set()
    for mutant in edited_mutants(intact):
        path = Path(f"{mutant.name}.h5")
        path.write_bytes(mutant.content)
        if everything(path):
            refused.add(mutant.name)
    assert set(REFUSED) <= refused and len(refused) < len(EDITS)


@pytest.mark.thorough
def test_a_file_with_damaged_bytes_is_read_or_refused_with_one_sentence(intact: bytes) -> None:
    """These are the random mutants that libhdf5 survives: the cut ones, and those that a checksum tells."""
    told, number = 0, 0
    for mutant in random_mutants(intact, 22):
        if mutant.name.startswith(("cut", "spliced", "filled", "flipped")) and b"OHDR" in mutant.content:
            number += 1
            Path("x.h5").write_bytes(mutant.content)
            told += bool(everything(Path("x.h5")))
        if number == 60:
            break
    assert told > 10


def test_a_text_that_states_four_gigabytes_is_refused_before_they_are_allocated(intact: bytes) -> None:
    Path("x.h5").write_bytes(long_text(intact))
    with pytest.raises(ResultError, match="the text 'provenance_json' states 4294967295 bytes"):
        read_text("x.h5", "provenance_json")


@pytest.mark.parametrize("holder", ["/", "runs"])
def test_an_attribute_that_states_four_gigabytes_is_refused_before_they_are_allocated(
    intact: bytes, holder: str
) -> None:
    """The header's checksum is right: a stranger can compute it."""
    name, value = ("status", "x" * 4321) if holder == "/" else ("columns", ["replicate" * 500])
    memory = io.BytesIO(intact)
    with h5py.File(memory, "r+", libver=("v108", "latest")) as file:
        file[holder].attrs[name] = value
    raw = bytearray(memory.getvalue())
    length = (4321 if holder == "/" else 4500).to_bytes(4, "little")
    at = raw.index(length)
    while raw[at + 7 : at + 12] != bytes(5):  # a length, an address of less than 16 MB, an index
        at = raw.index(length, at + 1)
    raw[at : at + 4] = b"\xff\xff\xff\xff"
    Path("x.h5").write_bytes(with_checksums(raw))
    with pytest.raises(ResultError, match="an attribute states a text of 4294967295 bytes"):
        tables("x.h5")


def test_the_texts_of_an_attribute_are_bounded_together_before_they_are_allocated(intact: bytes) -> None:
    """A thousand texts of a fixed length of a megabyte each would be a gigabyte; these have two megabytes."""
    Path("x.h5").write_bytes(intact)
    with h5py.File("x.h5", "r+", libver="latest") as file:
        file["runs"].attrs["columns"] = np.full(1_000, b"replicate", dtype="S2000")
    with pytest.raises(ResultError, match="the attribute 'columns' is too long"):
        tables("x.h5")


@pytest.mark.thorough
@pytest.mark.parametrize("column", ["time", "px"])
def test_an_index_of_very_many_chunks_is_refused_before_hdf5_visits_each(intact: bytes, column: str) -> None:
    """The column states few rows, and its index, as HDF5 writes it when the column was shortened, all of before."""
    Path("x.h5").write_bytes(intact)
    with h5py.File("x.h5", "r+", libver="latest") as file:
        table = file["truth"]
        rows, kept = table[column].size, dict(table[column].attrs)
        del table[column]
        options = {"dtype": "f8", "maxshape": (None,), "chunks": (rows,), "compression": "gzip"}
        table.create_dataset(column, shape=(rows * 10**8,), **options)[-1] = 1.0
        table[column].resize((rows,))
        table[column][...] = 1.0
        table[column].attrs.update(kept)
    for read in (tables, lambda path: read_table(path, "truth"), lambda path: read_with_meanings(path, "truth")):
        with pytest.raises(ResultError, match=r"x\.h5: cannot be read: values are stored in a newer way than wsnsim"):
            read("x.h5")


def test_a_heap_of_texts_that_has_no_end_is_refused(intact: bytes) -> None:
    """HDF5 went from an object that states no size to itself, for ever."""
    raw, at = bytearray(intact), intact.find(b"GCOL")
    assert at > 0
    while at > 0:
        raw[at + 16 : at + 32] = bytes(16)
        at = raw.find(b"GCOL", at + 1)
    Path("x.h5").write_bytes(raw)
    for read in (tables, lambda path: read_text(path, "provenance_json")):
        with pytest.raises(ResultError, match=r"x\.h5: .*the place of a text is damaged"):
            read("x.h5")


@pytest.mark.thorough
@pytest.mark.parametrize("column", ["time", "px"])
def test_an_index_whose_branches_are_shared_is_refused_before_hdf5_visits_each(intact: bytes, column: str) -> None:
    """Five nodes, each with 32 times the next one, name 32 million chunks; a sixth would take minutes."""
    Path("x.h5").write_bytes(intact)
    before = Path("x.h5").stat().st_size
    with h5py.File("x.h5", "r+") as file:
        kept = dict(file["truth"][column].attrs)
        del file["truth"][column]
        dataset = file["truth"].create_dataset(column, shape=(4_096,), dtype="f8", maxshape=(None,), chunks=(1,))
        dataset[...] = 1.0
        dataset.attrs.update(kept)
    raw = bytearray(Path("x.h5").read_bytes())
    nodes = [at for at in range(before, len(raw)) if raw[at : at + 5] == b"TREE\1"]
    root = max(nodes, key=lambda at: raw[at + 5])
    leaves = [at for at in nodes if raw[at + 5] == 0]
    chain = [root, *leaves[1:5]]
    for level, at, child in zip((4, 3, 2, 1), chain, [*chain[1:4], leaves[0]], strict=False):
        raw[at + 5 : at + 8] = bytes([level, 32, 0])
        for entry in range(at + 48, at + 48 + 32 * 32, 32):  # after the node's head and the first key
            raw[entry : entry + 8] = child.to_bytes(8, "little")
    Path("x.h5").write_bytes(raw)
    for read in (tables, lambda path: read_table(path, "truth", [column])):
        with pytest.raises(ResultError, match=rf"truth\.{column}: its index names more chunks than the file can hold"):
            read("x.h5")


@pytest.mark.parametrize("name", ["external link", "external storage", "external table", "virtual"])
def test_no_export_holds_another_file(intact: bytes, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    write_edited(intact, name)
    assert main(["export", "x.h5", "--parquet", "out"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("wsnsim: error: x.h5: cannot be read: ") and said.count("\n") == 1
    assert not any(b"root:" in file.read_bytes() for file in Path("out").glob("*"))


@pytest.mark.thorough(
    fast=[
        "words2-columns missing",
        "words3-scenario of lists",
        "words4-scenario without step",
        "words5-wide table",
        "words7-states unknown",
        "words8-steps extreme",
        "words9-text deep",
        "words10-text a list",
    ]
)
@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["info", "x.h5"], "text not JSON"),
        (["info", "x.h5"], "provenance of others"),
        (["info", "x.h5"], "columns missing"),
        (["trace", "x.h5", "--step", "1"], "scenario of lists"),
        (["trace", "x.h5", "--step", "1"], "scenario without step"),
        (["trace", "x.h5", "--step", "1"], "wide table"),
        (["plot", "x.h5"], "huge, chunks missing"),
        (["report", "x.h5"], "states unknown"),
        (["plot", "x.h5"], "steps extreme"),
        (["verify", "x.h5"], "text deep"),
        (["run", "x.h5", "--out", "y.h5"], "text a list"),
        (["recover", "x.h5", "--out", "y.h5"], "no scenario"),
    ],
)
def test_a_command_says_one_sentence_about_a_damaged_file(
    intact: bytes, words: list[str], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_edited(intact, name)
    assert main(words) == 1
    said = capsys.readouterr().err
    assert said.startswith("wsnsim: error: x.h5: ") and said.count("\n") == 1
    assert [path.name for path in Path().iterdir()] == ["x.h5"]


@pytest.mark.thorough
def test_control_characters_of_a_file_are_shown_as_escapes(intact: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("status hostile", "scenario hostile"):
        write_edited(intact, name)
        for words in (["info", "x.h5"], ["info", "x.h5", "--json"], ["trace", "x.h5", "--step", "1"]):
            assert main(words) == 0
            said = "".join(capsys.readouterr())
            assert all(c.isprintable() or c in "\n" for c in said)


def test_what_a_chunk_lacks_is_not_filled_from_memory(intact: bytes) -> None:
    """HDF5 itself gives the bytes of its heap for it."""
    write_edited(intact, "short plain chunk")
    with pytest.raises(ResultError, match=r"truth\.time: a chunk of \d+ bytes cannot be stored in 9"):
        read_table("x.h5", "truth", ["time"])


@pytest.mark.thorough
def test_a_shuffled_and_a_plain_chunk_are_read_as_hdf5_reads_them(tmp_path: Path, states, rows_of) -> None:
    with ResultFile(tmp_path / "x.h5", states, {"truth": True}) as file:
        file.write("truth", rows_of("truth", 70_000))
    read = read_table(tmp_path / "x.h5", "truth")
    part = read_table(tmp_path / "x.h5", "truth", rows=slice(65_000, 66_000))
    with h5py.File(tmp_path / "x.h5") as plain:
        assert {dataset.shuffle for dataset in plain["truth"].values()} == {True, False}
        for name, values in read.items():
            np.testing.assert_array_equal(values, plain["truth"][name][...])
            np.testing.assert_array_equal(part[name], values[65_000:66_000])


def test_the_checksum_is_that_of_hdf5(intact: bytes) -> None:
    assert lookup3(b"Four score and seven years ago") == 0x17770551  # the example of its author
    assert bytes(with_checksums(bytearray(intact))) == intact


@pytest.mark.thorough
def test_commands_survive_random_mutants(intact: bytes) -> None:
    """In a process of their own with limits of memory and time: some of them end libhdf5."""
    commands = []
    for number, mutant in zip(range(160), random_mutants(intact, 7), strict=False):
        Path(f"{mutant.name}.h5").write_bytes(mutant.content)
        words = (["info"], ["export", "--parquet", "out"], ["trace", "--step", "1"], ["recover", "--out", "y.h5"])
        first, *rest = words[number % 4]
        commands.append([first, f"{mutant.name}.h5", *rest])
    assert [answer for answer in answers(commands, Path.cwd()) if answer.code >= 0 and answer.fault()] == []
