"""CSV files: plain or compressed, and everything that may be wrong with them."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from wsnsim.base import gzip_content
from wsnsim.base.errors import RunError
from wsnsim.models.csvfile import BadRow, Wanted, bad_rows_text, demand_digest, read_columns, read_rows

WANTED = Wanted({"node": "receiver"}, {"time": "time", "reading": "rssi", "z": "z"}, optional=("z",))
TEXT = "rssi,receiver,time,more\n-70,a,0.5,x\n\n-71, b ,0.25,y\n"


def written(tmp_path: Path, text: str, name: str = "data.csv") -> str:
    """The path of a file with this text, compressed if its name says so."""
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return str(path)


@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz"])
def test_columns_are_found_by_the_names_of_the_header_and_keep_the_lines(tmp_path: Path, name: str) -> None:
    rows = read_rows(written(tmp_path, TEXT, name), WANTED, "readings")
    assert rows.lines.tolist() == [2, 4] and rows.texts == {"node": ["a", "b"]} and rows.bad == ()
    assert rows.numbers["time"].tolist() == [0.5, 0.25] and rows.numbers["reading"].tolist() == [-70.0, -71.0]
    assert "z" not in rows.numbers


def test_compressed_data_are_known_by_their_content(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(gzip.compress(b"x,y\n1,2\n"))
    assert read_columns(str(path), ("x", "y"), "positions") == [(f"{path}:2", (1.0, 2.0))]


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
        ("time,receiver\n0,a\n", ":1: .* is 'time,receiver'$"),
        ("time,receiver,rssi\n", ": contains no readings"),
    ],
)
def test_a_file_without_readings_is_refused_in_words(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RunError, match=message):
        read_rows(written(tmp_path, text), WANTED, "readings")


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


def test_at_most_fifty_rows_are_printed() -> None:
    words = bad_rows_text("b/a.csv", [BadRow(line, "is wrong") for line in range(2, 102)], 500)
    assert words.startswith("b/a.csv: 100 of 500 rows cannot be used:\n  a.csv:2: is wrong\n")
    assert len(words.splitlines()) == 52 and words.endswith("\n  and 50 more")


def test_a_file_that_changed_or_is_gone_is_refused_by_its_digest(tmp_path: Path) -> None:
    from wsnsim.base.regular_files import file_digest

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
    assert rows.texts["node"] == [line.split(",")[1] for line in lines]
    assert np.array_equal(rows.numbers["reading"], [float(line.split(",")[2]) for line in lines])


@pytest.mark.thorough
def test_a_small_file_that_holds_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gzip_content, "MOST_BYTES", 2_000_000)
    path = tmp_path / "much.csv.gz"
    path.write_bytes(gzip.compress(b"x,y\n" + b"1,2\n" * 600_000))
    with pytest.raises(RunError, match=r"much\.csv\.gz: cannot be read: it is more than 2 MB when decompressed"):
        read_columns(str(path), ("x", "y"), "positions")
