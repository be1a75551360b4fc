"""CSV files: plain or compressed, and everything that may be wrong with them."""

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsnsim.base import files
from wsnsim.base.errors import RunError
from wsnsim.models import csvfile, row_checks
from wsnsim.models.csvfile import (
    Wanted,
    demand_digest,
    identifiers,
    only_rows,
    read_rows,
)
from wsnsim.models.row_checks import BadRow, bad_rows_text, first_of_equal

WANTED = Wanted({"node": "receiver"}, {"time": "time", "reading": "rssi", "z": "z"}, optional=("z",))
PLACES = Wanted(numbers={"x": "x", "y": "y"})
TEXT = "rssi,receiver,time,more\n-70,a,0.5,x\n\n-71, b ,0.25,y\n"


def written(tmp_path: Path, text: str, name: str = "data.csv") -> str:
    """The path of a file with this text, compressed if its name says so."""
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return str(path)


@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz"])
def test_columns_are_found_by_the_names_of_the_header_and_keep_the_lines(tmp_path: Path, name: str) -> None:
    rows = read_rows(written(tmp_path, TEXT, name), WANTED, "readings")
    assert rows.lines.tolist() == [2, 4] and rows.texts["node"].names == ("a", "b") and rows.bad == ()
    assert rows.numbers["time"].tolist() == [0.5, 0.25] and rows.numbers["reading"].tolist() == [-70.0, -71.0]
    assert "z" not in rows.numbers


def test_compressed_data_are_known_by_their_content(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(gzip.compress(b"x,y\n1,2\n"))
    assert read_rows(str(path), PLACES, "positions").numbers == {"x": [1.0], "y": [2.0]}


def test_all_rows_with_a_wrong_cell_are_found_at_once(tmp_path: Path) -> None:
    text = "time,receiver,rssi\n0,a,nan\n1,,-70\n2,a,-71\ninf,a,-72\n3,a\n4,b,1_0\n"
    rows = read_rows(written(tmp_path, text), WANTED, "readings")
    assert rows.lines.tolist() == [4]
    assert [row.line for row in rows.bad] == [2, 3, 5, 6, 7]
    assert rows.bad[0].reason == "rssi must be a finite number, is 'nan'"
    assert rows.bad[1].reason == "node must not be empty" and "is ''" in rows.bad[3].reason


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: the header must name the columns receiver, time and rssi, .*, the file is empty"),
        ("time;receiver;rssi\n0;a;-70\n", ":1: the header must name .*it seems to use semicolons, only commas"),
        ("time,receiver\n0,a\n", ":1: .* is 'time,receiver'; a table of another form: wsnsim import readings .*csv$"),
        ("time,receiver,rssi\n", ": contains no readings"),
    ],
)
def test_a_file_without_readings_is_refused_in_words(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RunError, match=message):
        read_rows(written(tmp_path, text), WANTED, "readings")


def test_readings_without_places_are_sent_to_the_option_of_their_trajectory(tmp_path: Path) -> None:
    placed = Wanted(WANTED.texts, WANTED.numbers | PLACES.numbers, WANTED.optional)
    with pytest.raises(RunError, match=r"time, rssi, x and y, .*; a trajectory in a file of its own: --track FILE$"):
        read_rows(written(tmp_path, TEXT), placed, "readings")


def test_wrong_or_damaged_gzip_is_refused_in_words(tmp_path: Path) -> None:
    plain, cut, spoilt = (tmp_path / f"{name}.csv.gz" for name in ("plain", "cut", "spoilt"))
    content = gzip.compress((TEXT * 100).encode())
    plain.write_text(TEXT)
    cut.write_bytes(content[:-12])
    spoilt.write_bytes(content[:20] + b"\xff" * 20 + content[40:])
    for path, reason in ((plain, "it is not gzip data"), (cut, "damaged or cut off"), (spoilt, "damaged or cut off")):
        with pytest.raises(RunError, match=f"{path.name}: cannot be read: .*{reason}"):
            read_rows(str(path), WANTED, "readings")


def test_bytes_that_are_no_text_are_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(b"time,receiver,rssi\n0,\xff\xfe,-70\n")
    with pytest.raises(RunError, match="cannot be read: not a CSV text"):
        read_rows(str(path), WANTED, "readings")


def test_equal_errors_are_one_line_and_at_most_fifty_kinds_are_printed() -> None:
    cells = ["'nan'", "'7,02'", '"it\'s"', "-1.5e+07"]
    bad = [BadRow(line, f"rssi must be a finite number, is {cells[line % 4]}") for line in range(2, 1206)]
    words = bad_rows_text("b/a.csv", [*bad, BadRow(1300, "node must not be empty")], 5000, "do this")
    assert words.splitlines() == [
        "b/a.csv: 1,205 of 5,000 rows cannot be used:",
        '  a.csv:2: rssi must be a finite number, is "it\'s" (1,203 more rows like it)',
        "  a.csv:1300: node must not be empty",
        "  do this",
    ]
    kinds = [BadRow(line, f"is wrong {'x' * line}") for line in range(2, 102)]
    assert bad_rows_text("b/a.csv", kinds, 500).splitlines()[51:] == ["  and 50 other kinds of errors"]


def test_a_file_in_which_no_row_may_be_bad_says_how_many_are(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r":3: x must be a finite number, is 'b' \(1 more row like it\)$"):
        only_rows(written(tmp_path, "x,y\n1,2\nb,2\nc,2\n"), PLACES, "positions")


def test_a_file_that_changed_or_is_gone_is_refused_by_its_digest(tmp_path: Path) -> None:
    from wsnsim.base.files import file_digest

    path = Path(written(tmp_path, TEXT))
    digest = file_digest(path)
    demand_digest(str(path), digest)
    demand_digest(str(tmp_path / "none.csv"), "")
    path.write_text(TEXT.replace("-71", "-72"))
    with pytest.raises(RunError, match=f"the file has changed: its digest is {file_digest(path)}, .* {digest}$"):
        demand_digest(str(path), digest)
    path.unlink()
    with pytest.raises(RunError, match="cannot be read: No such file"):
        demand_digest(str(path), digest)


def test_shipped_tracks_are_read_as_they_are_written() -> None:
    """Against a reading by hand of the decompressed text."""
    path = "scenarios/recorded/ble/straight_04.csv.gz"
    lines = gzip.decompress(Path(path).read_bytes()).decode().split()[1:]
    rows = read_rows(path, WANTED, "readings")
    names, codes = rows.texts["node"]
    assert [names[code] for code in codes] == [line.split(",")[1] for line in lines]
    assert np.array_equal(rows.numbers["reading"], [float(line.split(",")[2]) for line in lines])


@pytest.mark.thorough
def test_a_small_file_that_holds_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MOST_BYTES", 2_000_000)
    path = tmp_path / "much.csv.gz"
    path.write_bytes(gzip.compress(b"x,y\n" + b"1,2\n" * 600_000))
    with pytest.raises(RunError, match=r"much\.csv\.gz: cannot be read: it is more than 2 MB when decompressed"):
        read_rows(str(path), PLACES, "positions")


@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz"])
def test_rows_are_counted_while_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(csvfile, "MOST_ROWS", 3)
    good = written(tmp_path, "x,y\n1,2\n\n1,2\n1,2\n", name)
    assert len(read_rows(good, PLACES, "positions").lines) == 3
    path = written(tmp_path, "x,y\n1,2\n\nfour\n1,2\n1,2\n1,2\n", name)
    with pytest.raises(RunError, match=rf"{name}:6: has more than 3 rows: split it, or thin it out$"):
        read_rows(path, PLACES, "positions")


def test_bad_rows_are_kept_up_to_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(row_checks, "MOST_BAD", 2)
    with pytest.raises(
        RunError, match=r"more than 2 rows cannot be used:\n  data\.csv:2: .* \(2 more rows like it\)\n  and more$"
    ):
        read_rows(written(tmp_path, "x,y\na,2\nb,2\nc,2\n1,2\n"), PLACES, "positions")


def test_long_lines_and_names_are_refused_and_long_cells_are_shortened(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"cannot be read: a line has more than 1,000,000 characters$"):
        read_rows(written(tmp_path, "x,y\n1," + "," * 1_000_000 + "\n"), PLACES, "positions")
    (bad,) = read_rows(written(tmp_path, f"time,receiver,rssi\n0,{'a' * 201},1\n"), WANTED, "readings").bad
    assert bad == BadRow(2, "node must have at most 200 characters")
    with pytest.raises(RunError, match=f":2: x must be a finite number, is '{'9' * 60}'$"):
        only_rows(written(tmp_path, f"x,y\n{'9' * 400},1\n"), PLACES, "positions")


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([-0.0, 0.0, 1.0]), st.integers(0, 1))))
def test_the_first_of_equal_rows_is_that_of_a_dictionary(rows: list[tuple[bool, float, int]]) -> None:
    first: dict[tuple[float, int], int] = {}
    expected = [first.setdefault(tuple(key), i) if used else i for i, (used, *key) in enumerate(rows)]
    used, *keys = (np.array([row[column] for row in rows]) for column in range(3))
    assert first_of_equal(used.astype(np.bool_), *keys).tolist() == expected


def test_a_row_of_readings_takes_bytes_not_objects(tmp_path: Path) -> None:
    """277 kB of gzip with readings took 12.5 GB: some 380 bytes a row, of which those that repeat others have most."""
    read_rows(written(tmp_path, "x,y\n1,2\n"), PLACES, "positions")  # imports pandas
    path = tmp_path / "many.csv.gz"
    path.write_bytes(gzip.compress(b"time,node,reading\n" + b"1,1,1\n" * 10_000 + b"2,2,2\n"))
    tracemalloc.start()
    rows = read_rows(str(path), Wanted({"node": "node"}, {"time": "time", "reading": "reading"}), "readings")
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(rows.lines) == 10_001 and held < 10_000 * 40 and peak < 10_000 * 100 + 300_000


def test_a_header_that_names_a_column_twice_is_refused_where_the_column_is_read(tmp_path):
    path = tmp_path / "twice.csv"
    path.write_text("x,y,x,more,more\n1,2,3,4,5\n")
    with pytest.raises(RunError, match=r"twice.csv:1: the header names the column 'x' twice"):
        read_rows(str(path), Wanted(numbers={"x": "x"}), "positions")
    assert read_rows(str(path), Wanted(numbers={"y": "y"}), "positions").numbers["y"].tolist() == [2.0]


def test_columns_that_look_like_identifiers_have_such_names_and_whole_numbers_or_words(tmp_path):
    path = tmp_path / "some.csv"
    path.write_text("x,moteid,mac,tag,rate,node\n1,7,a:1,0.5,3,\n2,8,a:2,1.5,4,b\n\n")
    assert identifiers(str(path), ()) == {"moteid": ["7", "8"], "mac": ["a:1", "a:2"]}
    assert identifiers(str(path), ("mac",)) == {"moteid": ["7", "8"]}
