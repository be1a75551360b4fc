"""Tables as people have them become the files that scenarios read, whatever their form and conventions."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.helpers.commands import run_command
from wsnsim.analysis import notes
from wsnsim.base.errors import ScenarioError, WsnsimError
from wsnsim.interop import field_data
from wsnsim.interop.conventions import Conventions
from wsnsim.interop.tables import read_table
from wsnsim.models.k7file import read_links
from wsnsim.scenario import build, load

TIMES = [0.0, 0.5, 1.25, 2.0]
VALUES = np.array([[1.5, -2.25, 3.125], [4.0, 5.0625, 6.5], [-7.0, 8.75, 9.0], [10.5, 11.0, 12.25]])
NODES = ["a1", "b 2", "007"]
LONG = pd.DataFrame(
    [(time, node, VALUES[i, j]) for i, time in enumerate(TIMES) for j, node in enumerate(NODES)],
    columns=["time", "node", "reading"],
)
WIDE = pd.DataFrame({"time": TIMES, **dict(zip(NODES, VALUES.T, strict=True))})
CANONICAL = LONG.sort_values(["time", "node"], ignore_index=True)


def text(table: pd.DataFrame, sign: str = ",", decimal: str = ".", header: bool = True, end: str = "\n") -> str:
    """A table as a text; a separator of blanks is repeated, and nodes have no blanks then."""
    found = table.to_csv(sep="\t" if sign == "  " else sign, decimal=decimal, header=header, index=False)
    return (
        found.replace("b 2", "b2").replace("\t", "  ").replace("\n", end) if sign == "  " else found.replace("\n", end)
    )


def imported(
    folder: Path, content: str | bytes, kind: str = "readings", name: str = "t.csv", **how: Any
) -> pd.DataFrame:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return getattr(field_data, kind)([str(path)], Conventions(**how)).table


def assert_same(found: pd.DataFrame, wanted: pd.DataFrame = CANONICAL) -> None:
    pd.testing.assert_frame_equal(found, wanted, rtol=0, atol=1e-9, check_dtype=False)


@pytest.mark.parametrize("layout", ["long", "wide", "headerless", "one column more"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("sign", [",", ";", "\t", "|", "  "])
def test_every_separator_and_layout_is_the_same_table(sign: str, decimal: str, layout: str, tmp_path: Path) -> None:
    table = (WIDE if layout == "wide" else LONG).sample(frac=1.0, random_state=3)
    table = table.assign(battery=1) if layout == "one column more" else table
    how = {"columns": list(table.columns)} if layout == "headerless" else {}
    content = text(table, sign, decimal, header=layout != "headerless")
    found = imported(tmp_path, content, **how)
    if layout == "wide" and sign == "  ":
        found = found.sort_values(["time", "node"], ignore_index=True)
    assert_same(found.replace("b2", "b 2").sort_values(["time", "node"], ignore_index=True))


MILLI = LONG.assign(reading=LONG.reading * 1e3)
START, CLOCK = "2024-05-01 10:00:00", "%H:%M:%S.%f"
DATES = pd.to_datetime(LONG.time, unit="s", origin=START)
TWICE = [LONG.assign(reading=LONG.reading + sign) for sign in (1, -1)]
CONVENTIONS: dict[str, tuple[pd.DataFrame, dict[str, Any]]] = {
    "other order of columns and rows": (LONG[["reading", "time", "node"]][::-1], {}),
    "other names": (LONG.rename(columns={"time": "Timestamp", "node": "Receiver", "reading": "Range (m)"}), {}),
    "given names": (LONG.rename(columns={"reading": "wert"}), {"names": {"reading": "wert"}}),
    "millimetres": (MILLI, {"unit": "mm"}),
    "a unit in the header": (MILLI.rename(columns={"reading": "range [mm]"}), {}),
    "a unit at the end of a name": (MILLI.rename(columns={"reading": "distance_mm"}), {}),
    "a unit of times in the header": (LONG.assign(time=LONG.time * 1e3).rename(columns={"time": "time (ms)"}), {}),
    "a number that is no node": (LONG.assign(id=range(len(LONG)), node=LONG.node).rename(columns={"node": "who"}),
                                 {"names": {"node": "who"}}),
    "milliseconds": (LONG.assign(time=LONG.time * 1e3), {"time_format": "ms"}),
    "another origin": (LONG.assign(time=LONG.time + 1.7e9), {"time_origin": "1700000000"}),
    "dates": (LONG.assign(time=DATES.dt.strftime("%Y-%m-%dT%H:%M:%S.%f+00:00")), {"time_origin": START}),
    "dates of two columns": (LONG.assign(date=DATES.dt.date, time=DATES.dt.strftime(CLOCK)), {"time_origin": START}),
    "dates of another form": (LONG.assign(time=DATES.dt.strftime("%d.%m.%Y %H:%M:%S.%f")),
                              {"time_format": "%d.%m.%Y %H:%M:%S.%f", "time_origin": "01.05.2024 10:00:00.0"}),
    "a clock": (LONG.assign(time=pd.to_datetime(LONG.time, unit="s").dt.strftime(CLOCK)), {}),
    "a prefix": (WIDE.rename(columns=lambda name: name if name == "time" else f"r_{name}").assign(x=1, s=3),
                 {"node_prefix": "r_"}),
    "copies": (pd.concat([LONG, LONG[:3]]), {}),
    "marks for nothing": (pd.concat([LONG, LONG[:3].assign(time=9.0, reading=100.0)]), {"missing": ["100", "nan"]}),
    "the first of two": (pd.concat([LONG, LONG[:3].assign(reading=99.0)]), {"repeated": "first"}),
    "the mean of two": (pd.concat(TWICE), {"repeated": "mean"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CONVENTIONS)
def test_every_convention_is_the_same_table(case: str, tmp_path: Path) -> None:
    table, how = CONVENTIONS[case]
    assert_same(imported(tmp_path, text(table), **how))


def test_marks_byte_orders_line_ends_comments_and_compression_change_nothing(tmp_path: Path) -> None:
    plain = text(LONG)
    assert_same(imported(tmp_path, b"\xef\xbb\xbf" + text(LONG, end="\r\n").encode()))
    assert_same(imported(tmp_path, f"# a comment\n\n{plain}\n\n"))
    assert_same(imported(tmp_path, gzip.compress(plain.encode()), name="t.csv.gz"))


@pytest.mark.parametrize("form", ["json", "jsonl", "items.json", "lists.json", "parquet", "xlsx", "mat", "struct.mat"])
def test_every_format_is_the_same_table(form: str, tmp_path: Path) -> None:
    path, records = tmp_path / f"t.{form}", LONG.to_dict("records")
    if form.endswith("mat"):
        from scipy.io import savemat

        columns = {
            "time": LONG.time.to_numpy(),
            "node": LONG.node.to_numpy(dtype=object),
            "reading": LONG.reading.to_numpy(),
        }
        savemat(path, {"data": columns} if form == "struct.mat" else columns)
    elif form == "xlsx":
        LONG.to_excel(path, index=False)
    elif form == "parquet":
        LONG.to_parquet(path)
    else:
        said = {"json": records, "items.json": {"count": 12, "items": records}, "lists.json": LONG.to_dict("list")}
        path.write_text("\n".join(map(json.dumps, records)) if form == "jsonl" else json.dumps(said[form]))
    assert_same(field_data.readings([str(path)]).table)


OTHERS = {
    "nodes": pd.DataFrame(
        {"id": ["a", "b", "c"], "x": [0.5, 12.25, -7.0], "y": [1.0, 2.0, 3.5], "z": [1.5, 2.5, 0.25]}
    ),
    "track": pd.DataFrame({"time": [0.0, 0.5, 1.25], "id": "w", "x": [0.5, 12.25, -7.0], "y": [1.0, 2.0, 3.5]}),
    "links": pd.DataFrame(
        {"src": ["a", "b", "c"], "dst": ["b", "a", "a"], "prr": [0.5, 0.25, 1.0], "power": [-60.5, -71.0, -80.0]}
    ),
}
FORMS = ["plain", "permuted", "crlf", "mark", "decimal commas", "csv.gz", "xlsx", "parquet", "mat", "headerless"]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", OTHERS)
def test_every_form_of_nodes_tracks_and_links_is_the_same_table(kind: str, form: str, tmp_path: Path) -> None:
    table, name, how = OTHERS[kind], f"t.{form if form in ('csv.gz', 'xlsx', 'parquet', 'mat') else 'csv'}", {}
    if form == "permuted":
        table = table[table.columns[::-1]].sample(frac=1.0, random_state=1)
    if form == "xlsx":
        table.to_excel(tmp_path / name, index=False)
    elif form == "parquet":
        table.to_parquet(tmp_path / name)
    elif form == "mat":
        from scipy.io import savemat

        savemat(tmp_path / name, {column: table[column].to_numpy() for column in table})
    content = text(table, ";" if form == "decimal commas" else ",", "," if form == "decimal commas" else ".",
                   form != "headerless", "\r\n" if form == "crlf" else "\n").encode()  # fmt: skip
    content = b"\xef\xbb\xbf" + content if form == "mark" else gzip.compress(content) if form == "csv.gz" else content
    if form == "headerless":
        how = {"columns": list(table.columns)}
    if name in ("t.csv", "t.csv.gz"):
        (tmp_path / name).write_bytes(content)
    found = getattr(field_data, kind)([str(tmp_path / name)], Conventions(**how)).table
    (tmp_path / "w.csv").write_text(text(OTHERS[kind]))
    assert_same(found, getattr(field_data, kind)([str(tmp_path / "w.csv")]).table)
    wanted = OTHERS[kind].iloc[:, -2:].to_numpy(np.float64)
    assert np.allclose(
        found[["x", "y"] if kind == "track" else ["y", "z"] if kind == "nodes" else ["pdr", "mean_rssi"]], wanted
    )


def test_nodes_that_are_renamed_and_other_units_of_places_give_the_same_places(tmp_path: Path) -> None:
    wanted = imported(tmp_path, text(OTHERS["nodes"]), "nodes")
    for unit, factor in (("mm", 1e3), ("cm", 1e2), ("km", 1e-3)):
        scaled = OTHERS["nodes"].assign(**{axis: OTHERS["nodes"][axis] * factor for axis in "xyz"})
        assert_same(imported(tmp_path, text(scaled), "nodes", unit=unit), wanted)
        stated = scaled.set_axis(["id", *(f"{axis}_{unit}" for axis in "xyz")], axis=1)
        assert_same(imported(tmp_path, text(stated), "nodes"), wanted)
    renamed = OTHERS["nodes"].assign(id=["z3", "y2", "x1"])
    assert_same(
        imported(tmp_path, text(renamed), "nodes").drop(columns="id")[::-1].reset_index(drop=True),
        wanted.drop(columns="id"),
    )


def test_a_file_with_several_tables_is_read_by_the_name_of_one(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"TD": LONG[["time", "reading"]].to_numpy(), "TL": np.ones((3, 3)), "offset": 1.0})
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        LONG[["time", "reading"]].to_excel(book, sheet_name="TD", index=False)
        WIDE.to_excel(book, sheet_name="other", index=False)
    (tmp_path / "a.json").write_text(
        json.dumps({"TD": LONG[["time", "reading"]].to_dict("records"), "TL": [{"id": 1}]})
    )
    for name in ("a.mat", "a.xlsx", "a.json"):
        how = {"columns": ["time", "reading"]} if name == "a.mat" else {}
        found = field_data.readings([str(tmp_path / name)], Conventions(table="TD", repeated="first", **how)).table
        assert_same(found.drop(columns="node"), LONG.groupby("time", as_index=False).reading.first())
        with pytest.raises(WsnsimError, match="choose one with --table"):
            field_data.readings([str(tmp_path / name)], Conventions(**how))
    LONG.to_excel(tmp_path / "b.xlsx", index=False, header=False)
    with pytest.raises(WsnsimError, match="no header: name its 3 columns"):
        field_data.readings([str(tmp_path / "b.xlsx")])


def test_rows_of_one_tag_are_chosen_and_rows_without_times_have_a_rate(tmp_path: Path) -> None:
    tags = pd.concat([LONG.assign(tag="07"), LONG.assign(tag="7", reading=99.0)])
    assert_same(imported(tmp_path, text(tags), where={"tag": "07"}).drop(columns="target"))
    found = imported(tmp_path, text(WIDE.drop(columns="time")), rate=4.0)
    assert_same(found, CANONICAL.assign(time=CANONICAL.time.map(dict(zip(TIMES, [0.0, 0.25, 0.5, 0.75], strict=True)))))


def test_an_origin_has_the_unit_that_the_header_states_for_times(tmp_path: Path) -> None:
    rows = "time [ms],node,range\n1500,a,6\n1750,a,7\n"
    assert imported(tmp_path, rows, time_origin="1000").time.tolist() == [0.5, 0.75]


def test_dates_may_have_decimal_commas(tmp_path: Path) -> None:
    rows = "time;node;range\n2026-05-12T14:03:20,2Z;a;6,5\n2026-05-12T14:03:20,45Z;a;7\n"
    assert imported(tmp_path, rows, time_origin="2026-05-12T14:03:20,0Z").time.tolist() == [0.2, 0.45]


def test_a_clock_that_passes_midnight_goes_on(tmp_path: Path) -> None:
    rows = "time,node,reading\n23:59:59,a,1\n00:00:01,a,2\n23:59:00,a,3\n00:00:00,a,4\n"
    assert imported(tmp_path, rows).time.tolist() == [86399.0, 86401.0, 172740.0, 172800.0]


@pytest.mark.parametrize(
    ("rows", "unit", "said"),
    [
        ("time,node,r_1\n0,a,-50\n", "dBm", "all readings are negative"),
        ("time,node,range\n0,a,-1\n1,a,3\n", "", "1 negative reading, which no range has"),
        ("time,node,azimuth_deg\n0,a,90\n", "rad", "--angle clockwise-from-north says otherwise"),
        ("time,id,reading\n" + "".join(f"{i},{i},1\n" for i in range(30)), "", "each row is of another node"),
    ],
)
def test_what_readings_are_taken_for_is_said(rows: str, unit: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(rows)
    found = field_data.readings(
        [str(tmp_path / "t.csv")], Conventions(names={"reading": "r_1"} if "r_1" in rows else {})
    )
    assert found.facts["unit"] == unit and any(said in note for note in found.notes), found.notes


@pytest.mark.parametrize(
    ("kind", "rows", "options", "said"),
    [
        ("readings", "time,node,rssi\n0,a,60\n1,a,61\n", {}, "levels in dBm, though they are positive"),
        ("readings", "time,node,reading\n0,a,60\n", {}, "taken for ranges in m"),
        ("readings", "time,node,reading,mac\n0,a,60,a:1\n", {}, "'mac' may name the node: --column 'node=mac'"),
        ("readings", "time,node,reading\n0,a,60\n", {"missing": ["foo"]}, "--missing foo: no row has it"),
        (
            "readings",
            "time,node,range\n2026-05-12T14:03:20Z,a,6\n",
            {"time_origin": "2025-05-12T14:03:20Z"},
            "all times are 365.0 days or more from --time-origin 2025-05-12T14:03:20Z: another date? The first row has",
        ),
        ("readings", "time,node,range\n1778594600,a,6\n1778594700,a,7\n", {"time_origin": "1778594800"}, "in m"),
        ("nodes", "id,x,y\na,5,5\nb,5,5\n", {}, "all 2 nodes stand at one place"),
        ("nodes", "id,x,y,z\na,5,5,1\nb,6,5,\n", {}, "z is left out of all: 1 row without it"),
        ("links", "src,dst,sent,received\na,b,10,5\n", {}, "ratios are those of received to sent"),
    ],
)
def test_what_is_doubtful_is_said_and_the_rows_are_kept(
    kind: str, rows: str, options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(rows)
    found = getattr(field_data, kind)([str(tmp_path / "t.csv")], Conventions(**options))
    assert len(found.table) == rows.count("\n") - 1 and any(said in note for note in found.notes), found.notes
    if kind == "links":
        assert found.table.pdr.tolist() == [0.5]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_text_that_a_spreadsheet_writes_is_read(encoding: str, tmp_path: Path) -> None:
    found = imported(tmp_path, "time\tnode\treading\n0\tä\t1\n".encode(encoding))
    assert found.to_numpy().tolist() == [[0, "ä", 1]]


def test_files_whose_headers_state_other_units_are_not_joined(tmp_path: Path) -> None:
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file, unit in zip(files, ("mm", "m"), strict=True):
        file.write_text(f"time,range_{unit}\n0,5\n")
    with pytest.raises(WsnsimError, match="'range_m' is 'range_mm' in another file"):
        field_data.readings([*map(str, files)])


def test_files_of_one_node_each_are_joined(tmp_path: Path) -> None:
    files = []
    for node in NODES:
        files.append(str(tmp_path / f"{node}.csv"))
        Path(files[-1]).write_text(text(LONG[LONG.node == node].drop(columns="node")))
    assert_same(field_data.readings(files).table)


def test_angles_powers_and_numbers_of_nodes_are_converted(tmp_path: Path) -> None:
    rows = "time,node,azimuth\n0,1,0\n0,2,90\n0,3,180\n0,4,270\n"
    east = imported(tmp_path, rows, unit="deg", angle="clockwise-from-north").reading
    assert np.exp(1j * east.to_numpy()) == pytest.approx([1j, 1, -1j, -1])
    watts = imported(tmp_path, "time,node,power\n0,1,1\n0,2,0.001\n", unit="mW", names={"reading": "power"})
    assert watts.reading.tolist() == pytest.approx([0.0, -30.0])
    path = tmp_path / "n.json"
    path.write_text('[{"time": 0, "node": 3.0, "reading": 1}, {"time": 1, "node": 4.0, "reading": 1}]')
    assert field_data.readings([str(path)]).table.node.tolist() == ["3", "4"]


def test_what_is_left_out_is_said_and_equal_errors_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(
        "time,node,rssi,seq\n" + "".join(f"{i},a,{'far' if i % 2 else -60},{i}\n" for i in range(10)) + "10,a,,1\n"
    )
    with pytest.raises(WsnsimError) as caught:
        field_data.readings([str(path)])
    said = f"{path}:3: rssi must be a finite number, is 'far' (4 more rows like it; --skip-bad-rows leaves them out)"
    assert str(caught.value) == said
    found = field_data.readings([str(path)], Conventions(skip_bad_rows=True))
    assert len(found.table) == 5 and found.facts["nodes"] == 1 and found.facts["rate"] == 0.5
    assert list(found.notes) == [
        f"{path}: columns not used: 'seq'",
        f"left out: 1 row without reading ({path}:12)",
        f"left out: 5 rows that cannot be used: rssi must be a finite number, is 'far' (the first: {path}:3)",
        "readings called rssi are taken for levels in dBm; --unit says otherwise",
    ]  # fmt: skip


@pytest.mark.parametrize("header", ["time,gateway,rssi", "time,node,RSS"])
def test_readings_called_rssi_are_levels_whatever_their_sign(tmp_path: Path, header: str) -> None:
    path = tmp_path / "long.csv"
    path.write_text(f"{header}\n0,a,-60\n1,a,0\n")
    assert "law: {kind: rssi}" in field_data.readings([str(path)]).block("r.csv")
    path.write_text("time,rssi_a,rssi_b\n0,-60,1\n1,-61,0\n")
    assert field_data.readings([str(path)], Conventions(node_prefix="rssi_")).facts["unit"] == "dBm"


@pytest.mark.parametrize(
    ("times", "given"),
    [
        (["100", "101", "102", "103"], ["101", "102", "100"]),
        (
            [f"2024-05-01T10:00:0{s}" for s in range(4)],
            ["2024-05-01T10:00:01", "2024-05-01T10:00:02", "2024-05-01T10:00:00"],
        ),
    ],
)
def test_from_and_until_are_times_of_the_file_and_its_own_name_is_never_the_default(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    times: list[str],
    given: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("time,x,y\n" + "".join(f"{time},{i},0\n" for i, time in enumerate(times)))
    start, end, origin = given
    command = ["import", "track", "a.csv", "--from", start, "--until", end, "--time-origin", origin]
    assert run_command(capsys, *command).code == 0
    assert Path("a_track.csv").read_text() == "time,id,x,y\n1,a,1,0\n2,a,2,0\n"
    Path("r.csv").write_text("time,node,range\n" + "".join(f"{time},n,{i}\n" for i, time in enumerate(times)))
    assert run_command(capsys, *command[:1], "readings", "r.csv", *command[3:]).code == 0
    assert Path("r_readings.csv").read_text() == "time,node,reading\n1,n,1\n", "the last belongs to what follows"
    again = run_command(capsys, *command)
    assert again.code == 2 and "--out a_track.csv replaces it" in again.err


def test_times_since_1970_are_shown_as_a_date_and_a_span(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("time,x,y\n1714557600,0,0\n1714557619,9,0\n")
    for option in (["--list"], []):
        assert "19 s from 2024-05-01 10:00:00 UTC" in run_command(capsys, "import", "track", "a.csv", *option).out


def test_a_gpx_track_without_a_name_has_that_of_its_file(tmp_path: Path) -> None:
    pytest.importorskip("gpxpy")
    points = "".join(f'<trkpt lat="50" lon="8.{i}"><time>2024-05-01T10:00:0{i}Z</time></trkpt>' for i in range(2))
    track = f"<trk><trkseg>{points}</trkseg></trk>"
    path = tmp_path / "walk.gpx"
    path.write_text(f'<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">{track * 2}</gpx>')
    assert [*dict.fromkeys(read_table(str(path)).frame.id)] == ["walk", "walk_1"]


COOJA = """<simconf><simulation><motetype>x<mote><interface_config>org.contikios.cooja.interfaces.Position
<pos x="1.5" y="-2.0" /></interface_config><interface_config>ID<id>1</id></interface_config></mote></motetype>
<mote><interface_config>se.sics.cooja.interfaces.Position<x>3</x><y>4.5</y><z>0.0</z></interface_config>
<interface_config>ID<id>2</id></interface_config></mote></simulation><plugin>TimeLine<plugin_config><mote>0</mote>
<mote>1</mote></plugin_config></plugin></simconf>"""


def test_nodes_of_cooja_and_of_tables_are_read(tmp_path: Path) -> None:
    found = imported(tmp_path, COOJA.replace("<z>0.0</z>", ""), "nodes", "sim.csc")
    assert found.to_dict("list") == {"id": ["1", "2"], "x": [1.5, 3.0], "y": [-2.0, 4.5]}
    table = imported(tmp_path, "moteid x y\n1 21.5 23\n2 24.5 20\n", "nodes", unit="km")
    assert table.to_dict("list") == {"id": ["1", "2"], "x": [21500.0, 24500.0], "y": [23000.0, 20000.0]}


LON, LAT, SOUTH = 8.601, 50.1003, 0.0005


def test_degrees_become_metres_that_the_ellipsoid_confirms(tmp_path: Path) -> None:
    rows = f"id,lon,lat,height\no,{LON},{LAT},120\ne,{LON + 0.001},{LAT},121\ns,{LON},{LAT - SOUTH},119\n"
    found = imported(tmp_path, rows, "nodes", crs="wgs84", origin=(LON, LAT, 100.0)).set_index("id")
    a, e2, sine = 6378137.0, 0.00669437999014, np.sin(np.radians(LAT))
    normal = a / np.sqrt(1 - e2 * sine**2)
    meridian = normal * (1 - e2) / (1 - e2 * sine**2)
    assert found.x["e"] == pytest.approx(normal * np.cos(np.radians(LAT)) * np.radians(0.001), rel=1e-6)
    assert found.y["s"] == pytest.approx(-meridian * np.radians(SOUTH), rel=1e-5)  # the radius changes on the way
    assert found.loc["o"].tolist() == [0.0, 0.0, 20.0] and found.z["s"] == 19.0


def test_geojson_and_gpx_say_themselves_that_they_are_degrees(tmp_path: Path) -> None:
    shapes = [{"type": "Point", "coordinates": [LON + i / 1e3, LAT]} for i in range(2)]
    points = [{"type": "Feature", "properties": {"name": f"n{i}"}, "geometry": shape} for i, shape in enumerate(shapes)]
    nodes = imported(tmp_path, json.dumps({"type": "FeatureCollection", "features": points}), "nodes", "n.geojson")
    stamps = [f"2024-05-01T10:00:0{i}Z" for i in range(2)]
    line = {"type": "LineString", "coordinates": [[LON + i / 1e3, LAT] for i in range(2)]}
    walk = {"type": "Feature", "properties": {"coordTimes": stamps, "name": "w"}, "geometry": line}
    trail = "".join(f'<trkpt lat="{LAT}" lon="{LON + i / 1e3}"><time>{stamps[i]}</time></trkpt>' for i in range(2))
    gpx = f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><name>w</name><trkseg>{trail}</trkseg></trk></gpx>'
    tracks = [imported(tmp_path, json.dumps(walk), "track", "w.geojson"), imported(tmp_path, gpx, "track", "w.gpx")]
    assert tracks[0].equals(tracks[1]) and np.diff(tracks[0].time).tolist() == [1.0]
    assert np.ptp(nodes.x) == pytest.approx(np.ptp(tracks[0].x)) == pytest.approx(71.54, abs=0.01)


def test_ratios_of_links_are_played_from_a_table_and_from_a_matrix(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("from,to,PRR [%]\n1,2,50\n2,1,75\n2,3,0\n3,1,100\n")
    (tmp_path / "m.csv").write_text("id,1,2,3\n1,1,0.5,0\n2,0.75,1,0\n3,1,0,1\n")
    for name in ("p.csv", "m.csv"):
        found = field_data.links([str(tmp_path / name)])
        (tmp_path / "l.k7").write_text(found.text())
        played = read_links(str(tmp_path / "l.k7"))
        pairs = zip(played.sources.tolist(), played.receivers.tolist(), played.ratios.tolist(), strict=True)
        assert set(pairs) == {(0, 1, 0.5), (1, 0, 0.75), (2, 0, 1.0)} and len(played.nodes) == 3
        assert played.complete[26].tolist() == [True]


MOVERS = "time,tag,x,y\n" + "".join(f"{t},{'ab'[t % 2]},{t + 300 * (t % 2)},5\n" for t in range(8))
WRONG: dict[str, tuple[str, str, str, str]] = {
    "no header": ("readings", "0,a,1\n1,b,2\n", "", "has no header: name its 3 columns"),
    "empty": ("readings", "", "", "contains no"),
    "only a header": ("readings", "time,node,reading\n", "", "contains no rows"),
    "no time": ("readings", "when,node,reading\n0,a,1\n", "", "no column is called time"),
    "no reading": ("readings", "time,node\n0,a\n", "", "no column is called reading"),
    "no node": ("readings", "time,comment\n0,a\n", "", "no column is called node"),
    "two that may be it": ("readings", "time,node,rssi,range\n0,a,1,2\n", "", "'rssi', 'range' may all be"),
    "a name twice": ("readings", "time,node,node,reading\n0,a,b,1\n", "", "names the column 'node' twice"),
    "an unknown column": ("readings", "time,node,reading\n0,a,1\n", "--column reading=level", "no column 'level'"),
    "an unknown name": ("readings", "time,node,reading\n0,a,1\n", "--column redding=reading", "did you mean 'reading'"),
    "no such column form": ("readings", "time,node,reading\n0,a,1\n", "--column reading", "must be OURS=THEIRS"),
    "a long row": ("readings", "time,node,reading\n0,a,1\n1,a,2,3,4\n", "", ":3: has 5 columns"),
    "no number": ("readings", "time,node,reading\n0,a,1\n1,a,x\n", "", ":3: reading must be a finite number, is 'x'"),
    "infinite": ("readings", "time,node,reading\n0,a,1\n1,a,inf\n", "", "must be a finite number, is 'inf'"),
    "no node named": ("readings", "time,node,reading\n0,,1\n1,b,2\n", "", ":2: node must not be empty"),
    "a long name": ("readings", f"time,node,reading\n0,{'a' * 201},1\n", "", "at most 200 characters"),
    "a strange time": ("readings", "time,node,reading\nnoon,a,1\n", "", "a number of seconds or an ISO 8601"),
    "half dates": ("readings", "time,node,reading\n5,a,1\n2024-05-01,a,1\n", "", ":3: time must be"),
    "milliseconds": ("readings", "time,node,reading\n1700000000000,a,1\n", "", "--time-format ms"),
    "another format": ("readings", "time,node,reading\n1.5.24,a,1\n", "--time-format %d.%m.%Y", "a time of the format"),
    "a wrong time unit": ("readings", "time,node,reading\n1,a,1\n", "--time-format kg", "--time-format kg: expected s"),
    "a wrong origin": ("readings", "time,node,reading\n1,a,1\n", "--time-origin never", "--time-origin never: must be"),
    "a clock for dates": ("readings", "time,node,reading\n2026-05-12T14:03:20Z,a,1\n", "--time-origin 14:03:20",
                          "--time-origin 14:03:20: must be a time as the file writes them, such as 2026-05-12T14:03"),
    "a clock for seconds": ("readings", "time,node,reading\n7,a,1\n", "--time-origin 14:03:20", "such as 7"),
    "a date for a clock": ("readings", "time,node,reading\n14:03:20,a,1\n", "--time-origin 2026-05-12", "as 14:03:20"),
    "a clock that begins": ("track", "time,x,y\n2026-05-12,1,1\n2026-05-13,1,2\n", "--from 14:03:20", "--from 14:0"),
    "commas in times": ("readings", "time,node,range\n2026-05-12T14:03:20,2Z,a,5\n2026-05-12T14:03:21,2Z,a,5\n", "",
                        "t.csv:2: has more than the 3 columns of the header: '2026-05-12T14:03:20,2Z,a,5'; a comma in"),
    "a contradiction": ("readings", "time,node,reading\n1,a,1\n1,a,2\n", "", "--repeated first, last or mean"),
    "a wrong unit": ("readings", "time,node,reading\n1,a,1\n", "--unit kg", "--unit kg: expected m or dBm or rad"),
    "no power": ("readings", "time,node,reading\n1,a,0\n", "--unit mW", "must be a positive power"),
    "degrees": ("readings", "time,node,bearing\n1,a,90\n", "", "--unit deg"),
    "degrees of an angle": ("readings", "time,node,reading\n1,a,90\n", "--angle clockwise-from-north", "--unit deg"),
    "a mean of angles": ("readings", "time,node,bearing\n1,a,1\n", "--repeated mean", "give first or last"),
    "all missing": ("readings", "time,node,reading\n1,a,100\n", "--missing 100", "no row can be used"),
    "longitudes": ("nodes", "id,lon,lat\na,8.6,50.1\n", "", "import nodes t.csv --crs wgs84"),
    "no place": ("nodes", "id,x\na,8.6\n", "", "no column is called y"),
    "a node twice": ("nodes", "id,x,y\na,8,5\na,8,6\n", "", ":3: the node 'a' stands at another place"),
    "a percentage": ("links", "src,dst,prr\na,b,90\n", "", "--unit %"),
    "no link": ("links", "src,dst,prr\na,b,0\n", "", "no row can be used"),
    "a channel": ("links", "src,dst,prr,channel\na,b,1,99\n", "", "a channel must be one of 0 to 26"),
    "no matrix": ("links", "id,a,b\na,0,1\n", "", "no column is called src"),
    "two movers": ("track", "time,id,x,y\n0,a,1,1\n1,a,2,2\n0,b,1,1\n", "", "holds 2 nodes"),
    "merged movers": ("track", "time,x,y\n0,1,1\n0,20,2\n1,2,2\n", "", "several movers in one track"),
    "slow degrees": ("track", "time,id,x,y,speed\n0,a,13.4,52.5,10\n1,a,13.400147,52.5,10\n", "", "--crs wgs84"),
    "no span": ("track", "time,id,x,y\n0,a,1,1\n1,a,2,2\n5,b,1,1\n6,b,2,2\n", "--id a --id b --from 3", "no time is"),
    "a strange level": ("readings", "time,node,reading\n0,a,-60\n1,a,100\n", "--unit dBm", "t.csv --missing 100"),
    "no such cell": ("readings", "time,node,tag,reading\n0,a,7,1\n", "--where tag=07", "no row has the tag '07'"),
    "no such column of a cell": ("readings", "time,node,tag,reading\n0,a,7,1\n", "--where tg=7", "did you mean 'tag'"),
    "movers in a column": ("track", MOVERS, "", "'tag' names 2 movers, a, b: give each a file of its own, such as "
                           "wsnsim import track t.csv --column id=tag --id=a --id=b"),
    "movers of an id": ("track", MOVERS.replace("time,", "id,time,").replace("\n", "\nr,")[:-2], "", "names 2 movers"),
    "no times": ("track", "x,y\n1,1\n2,2\n", "", "without times: --rate HZ"),
    "a rate beside times": ("track", "time,x,y\n0,1,1\n1,2,2\n", "--rate 5", "--rate is for files without times"),
    "two units": ("nodes", "id,x [mm],y [mm]\na,8,5\n", "--unit m", "'x [mm]' states mm, --unit m"),
    "a unit of one axis": ("nodes", "id,x [mm],y,z\na,8,5,1\n", "", "'y', 'z' without a unit, others in mm"),
    "no cell": ("readings", "time,node,reading\n0,a,1\n", "--where node", "must be COLUMN=CELL"),
    "microseconds": ("readings", "time,node,reading\n1700000000000000,a,1\n", "", "t.csv --time-format us"),
    "nanoseconds": ("readings", "time,node,reading\n1700000000000000000,a,1\n", "", "t.csv --time-format ns"),
    "morning": ("readings", "time,node,reading\n05/01/2024 10:00:00 AM,a,1\n", "", "%m/%d/%Y %I:%M:%S %p"),
    "thousands": ("readings", 'time,node,reading\n0,a,1\n1,a,"1.234,5"\n', "", "thousands have none"),
    "two decimal marks": ("readings", "time;node;reading\n0;a;1.5\n1;a;1,5\n", "", "a file has one decimal mark"),
    "contradictory links": ("links", "src,dst,prr\na,b,0.9\na,b,0.8\n", "", ":3: the link from 'a' to 'b' has another"),
    "dead links": ("links", "src,dst,prr\na,b,0\nb,a,0\n", "", "all delivery ratios are 0"),
    "a matrix without a header": ("links", "1,0.5\n0.7,1\n", "", "of a matrix of ratios, its nodes"),
    "slow kilometres": ("track", "time,id,x,y,speed\n0,a,0,0,8\n1,a,0.008,0,8\n", "", "in kilometres: --unit km"),
    "other options": ("nodes", "id,x,y\na,8,5\n", "--from 3", "--from has no meaning for nodes"),
    "other options of tracks": ("sumo", "t id x y\n0 a 1 2\n", "--angle clockwise-from-north", "no meaning for sumo"),
    "another ending": ("nodes", "id,x,y\na,8,5\n", "--out x.txt", "ends in .csv"),
    "itself": ("nodes", "id,x,y\na,8,5\n", "--out t.csv", "one of the files that are read"),
    "a bad place": ("nodes", "id,lon,lat\na,8.6,950.1\n", "--crs wgs84", "a longitude and a latitude are expected"),
    "a bad origin": ("nodes", "id,lon,lat\na,8.6,50.1\n", "--crs wgs84 --origin 8", "--origin 8: give two numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_ends_with_one_sentence_and_no_file(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    kind, content, options, words = WRONG[case]
    Path("t.csv").write_text(content)
    answer = run_command(capsys, "import", kind, "t.csv", *options.split())
    assert answer.code and words in answer.err and answer.err.count("\n") <= 2, answer
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"] and Path("t.csv").read_text() == content


ENTITY = b'<!DOCTYPE g [<!ENTITY a "b">]>'
BROKEN = {
    "a.xlsx": b"PK\x03\x04", "a.parquet": b"PAR1", "a.mat": b"MATLAB 5.0", "b.mat": b"", "a.json": b"{",
    "b.json": b"[1, 2]", "c.json": b"[" * 100_000,
    "a.geojson": b'{"type": "FeatureCollection", "features": [{"geometry": {"type": "Polygon"}}]}',
    "b.geojson": b'{"type": "FeatureCollection", "features": 5}',
    "c.geojson": b'{"type": "FeatureCollection", "features": [{"geometry": null}]}',
    "d.csv": "time,node,Größe\n".encode("latin-1"), "a.gpx": b"<gpx>",
    "b.gpx": ENTITY + b"<gpx/>", "a.csc": ENTITY + b"<simconf/>", "b.csc": b"<simconf>",
    "c.csc": b"<simconf/>", "a.csv": "time;node\n".encode("utf-16"), "b.csv": b"\x00" * 50, "a.csv.gz": b"\x1f\x8b\x08",
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_is_damaged_or_defines_entities_is_refused_with_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(BROKEN[name])
    for kind in ("readings", "nodes"):
        with pytest.raises(WsnsimError) as caught:
            getattr(field_data, kind)([str(tmp_path / name)])
        assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)


def test_what_is_imported_is_a_scenario_that_loads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("r.csv").write_text("time;a;b;c\n" + "".join(f"{t};{5 + t};{6 - t};{7 + t}\n" for t in range(5)))
    Path("n.csv").write_text("anchor;x;y\na;0;0\nb;10;0\nc;0;10\n")
    Path("w.csv").write_text("t;x;y\n" + "".join(f"{t};{t},5;{t}\n" for t in range(5)))
    blocks = []
    for kind, file in (("readings", "r.csv"), ("nodes", "n.csv")):
        answer = run_command(capsys, "import", kind, file, "--unit", "m", "--json")
        assert answer.code == 0, answer
        blocks.append(json.loads(answer.out)["block"])
    assert run_command(capsys, "import", "track", "w.csv", "--out", "w2.csv").code == 0
    blocks.append("motion: {kind: recorded_track, path: w2.csv, time_origin: 0}")
    rest = "name: s\nduration: 4 s\nstep: 1 s\nnetwork: none\ntracker: {kind: ekf}\nprior: {sd: [1, 1, 1, 1]}\n"
    Path("s.yaml").write_text(rest + "\n".join(blocks) + "\n")
    setup = build(load(Path("s.yaml")))
    (found,) = setup.recorded.recordings(["a", "b", "c"], 1, 4, 1.0)
    assert found.readings[2].tolist() == [7.0, 4.0, 9.0] and not notes.before_a_run(setup)


DEGREES = """\
name: deg
duration: 20 s
step: 10 s
network: none
prior: {{sd: [5, 1, 5, 1]}}
deploy: {{kind: file, path: n.csv, columns: {{x: {x}, y: {y}}}, fit: true, margin: 20 m, cover: false}}
motion: {{kind: recorded_track, path: w.csv, header: {{x: {x}, y: {y}}}, q: 0.01}}
sensor: {{kind: range, sd: 2 m, reach: {reach}}}
tracker: {{kind: ekf}}
"""


def test_a_check_questions_the_unit_of_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for x, y, reach in (("lon", "lat", "100 m"), ("x", "y", "100 m"), ("x", "y", ".inf")):
        Path("n.csv").write_text(
            f"id,{x},{y}\n" + "".join(f"n{i},{8.6 + i * 4e-4},{50.1 + i % 2 * 3e-4}\n" for i in range(6))
        )
        Path("w.csv").write_text(f"time,{x},{y}\n" + "".join(f"{10 * i},{8.6 + i * 3e-5},50.1001\n" for i in range(3)))
        Path("s.yaml").write_text(DEGREES.format(x=x, y=y, reach=reach))
        if x == "lon":
            with pytest.raises(ScenarioError) as caught:
                build(load(Path("s.yaml")))
            assert str(caught.value).count("--crs wgs84") == 2 and "import track" in str(caught.value)
        else:
            said = [note for note in notes.of_setup(build(load(Path("s.yaml")))) if "--crs wgs84" in note]
            assert [note.split(":")[0] for note in said] == ["deploy.path", "motion.path"]


def test_dates_in_a_file_of_a_scenario_are_one_sentence_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("n.csv").write_text("id,x,y\na,0,0\nb,9,9\n")
    Path("w.csv").write_text("time,x,y\n2024-05-01 10:00:00,1,1\n2024-05-01 10:00:01,2,2\n")
    Path("s.yaml").write_text(DEGREES.format(x="x", y="y", reach="100 m"))
    with pytest.raises(ScenarioError) as caught:
        build(load(Path("s.yaml")))
    (issue,) = caught.value.issues
    assert re.search(
        r"w.csv:2: time must be a finite .*\(1 more row like it\).* wsnsim import readings \(or track\)", issue.message
    )
