"""Mobility traces of ns-3 and SUMO become the trajectories that those simulators moved their nodes along."""

from __future__ import annotations

import csv
import gzip
import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import wsnsim
from tests.helpers.commands import run_command
from wsnsim.base.errors import RunError, UsageError, WsnsimError, printable
from wsnsim.interop import field_data, ns3, sumo, traces, trajectories
from wsnsim.interop.trajectories import Placement
from wsnsim.models.csvfile import Wanted, read_rows
from wsnsim.models.k7file import read_links
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.row_checks import bad_rows_text
from wsnsim.scenario import build, load

SETDEST = """\
# two nodes
$node_(0) set X_ 0.0
$node_(0) set Y_ 10
$node_(0) set Z_ 1.5
$node_(1) set X_ 5
$node_(1) set Y_ 5
$god_ set-dist 0 1 2
$ns_ at 1.0 "$god_ set-dist 0 1 3"
$ns_ at 1.0 "$node_(0) setdest 100.0 10.0 10.0"
$ns_ at 6.0 "$node_(0) setdest 50.0 60.0 5.0"
$ns_ at 20.0 "$node_(0) setdest 0.0 0.0 0.0"
$ns_ at 30.0 "$node_(0) set X_ 70.0"
"""
COURSES = """\
now=+0ns node=0 pos=0:0:0 vel=1:0:0
now=+1e+10ns node=0 pos=10:0:0 vel=0:2:0
now=+15s node=0 pos=50:0:0 vel=0:-1:0
now=+20s node=1 pos=50:0:0 vel=0:0:0
"""
FCD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
    <timestep time="0.00">
        <vehicle id="bus.1" x="5.10" y="498.35" angle="90.00" speed="0.00" pos="5.10" lane="1fi_0" slope="0.00"/>
    </timestep>
    <timestep time="1.00">
        <vehicle id="bus.1" x="7.02" y="498.35" angle="90.00" speed="1.92" pos="7.02" lane="1fi_0" slope="0.00"/>
        <person id="ann" x="1.00" y="2.00" angle="0" speed="1" pos="0" edge="e"/>
    </timestep>
    <timestep time="2.00"/>
</fcd-export>
"""
FCD_CSV = """\
timestep_time;vehicle_angle;vehicle_id;vehicle_x;vehicle_y;person_id;person_x;person_y
0.00;90;bus.1;5.10;498.35;;;
1.00;90;bus.1;7.02;498.35;;;
1.00;;;;;ann;1.00;2.00
2.00;;;;;;;
"""


def written(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def at(track: np.ndarray, time: float) -> list[float]:
    """The place at a time, interpolated as `recorded_track` does."""
    return [float(np.interp(time, track[:, 0], track[:, column])) for column in (1, 2)]


def test_a_setdest_trace_moves_as_ns_3_moves_it(tmp_path: Path) -> None:
    track = traces.read(written(tmp_path, "a.tcl", SETDEST), ns3, ["0"]).tracks["0"]
    speed = 5.0 / np.hypot(0.0, 50.0)  # from (50, 10), where the second command finds it, straight up
    for time, place in ((0.5, (0, 10)), (3.0, (20, 10)), (6.0, (50, 10)), (8.0, (50, 10 + 2 * speed * 50))):
        assert at(track, time) == pytest.approx(place, abs=1e-9), time
    assert at(track, 18.0) == pytest.approx((50, 60)) and at(track, 29.0) == pytest.approx((50, 60))
    assert at(track, 30.0) == pytest.approx((70, 60)) and set(track[:, 3]) == {1.5}


def test_a_command_that_stops_a_node_on_its_way_leaves_it_there(tmp_path: Path) -> None:
    text = SETDEST.replace("$ns_ at 20.0", "$ns_ at 11.0")
    track = traces.read(written(tmp_path, "a.tcl", text), ns3, ["0"]).tracks["0"]
    assert at(track, 11.0) == pytest.approx((50, 35)) and at(track, 25.0) == pytest.approx((50, 35))


def test_course_changes_are_joined_by_their_velocities_and_jumps_stay_jumps(tmp_path: Path) -> None:
    track = traces.read(written(tmp_path, "b.log", COURSES), ns3, ["0"]).tracks["0"]
    assert at(track, 5.0) == pytest.approx((5, 0)) and at(track, 14.0) == pytest.approx((10, 8))
    assert at(track, 15.0) == pytest.approx((50, 0)) and at(track, 20.0) == pytest.approx((50, -5))


@pytest.mark.parametrize(("name", "text"), [("a.xml", FCD), ("a.csv", FCD_CSV), ("b.csv", FCD_CSV.replace(";", ","))])
def test_floating_car_data_are_read_from_xml_and_csv(name: str, text: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, text)
    found = traces.read(path, sumo, ["bus.1", "ann"])
    assert found.tracks["bus.1"][:, :3].tolist() == [[0.0, 5.1, 498.35], [1.0, 7.02, 498.35]]
    assert at(found.tracks["ann"], 1.0) == [1.0, 2.0] and len(found.tracks["ann"]) == 2
    assert {node: summary.entries for node, summary in found.nodes.items()} == {"bus.1": 2, "ann": 1}
    packed = tmp_path / f"{name}.gz"
    packed.write_bytes(gzip.compress(text.encode()))
    assert np.array_equal(
        traces.read(str(packed), sumo, ["bus.1"]).tracks["bus.1"], found.tracks["bus.1"], equal_nan=True
    )


@pytest.mark.parametrize(
    ("form", "text", "old", "new", "line", "words"),
    [
        (ns3, SETDEST, "100.0 10.0 10.0", "100.0 10.0", 9, "cannot read"),
        (ns3, SETDEST, "set X_ 0.0", "set X_ 1e999", 2, "X_ must be a finite number, is '1e999'"),
        (ns3, SETDEST, "60.0 5.0", "60.0 -5.0", 10, "speed must not be negative"),
        (ns3, SETDEST, '$ns_ at 6.0 "$node_(0) setdest 50.0 60.0 5.0"', "$node_(0) setdest 1 2 3", 10, "needs a time"),
        (ns3, SETDEST, "$node_(0) set Y_ 10\n", "", 2, "no initial Y_"),
        (ns3, COURSES, "now=+15s", "now=+15parsec", 3, "cannot read the time"),
        (ns3, COURSES, "pos=50:0:0 vel=0:-1:0", "pos=50:0 vel=0:-1:0", 3, "pos must be three numbers"),
        (ns3, COURSES, "now=+20s node=1", "$node_(0) set X_ 3\nnow=+20s node=1", 4, "course changes and commands"),
        (sumo, FCD, 'x="7.02"', 'x="7,02"', 7, "x must be a finite number, is '7,02'"),
        (sumo, FCD, 'id="ann" ', "", 8, "person needs an id"),
        (sumo, FCD, "</timestep>", "", 11, "mismatched tag"),
        (sumo, FCD, "<fcd-export", "<!DOCTYPE a [<!ENTITY b 'c'>]><fcd-export", 2, "document type"),
        (sumo, FCD, "<timestep time", "<timestep at", 3, "timestep needs time"),
        (sumo, FCD.replace("fcd-export", "net"), "", "", 2, "root element must be fcd-export"),
        (sumo, FCD, "<fcd-export", '<!-- <fcd-output.geo value="true"/> --><fcd-export', 2, "positions are degrees"),
        (sumo, FCD_CSV, "7.02", "far", 3, "x must be a finite number, is 'far'"),
        (sumo, FCD_CSV, "vehicle_x", "vehicle_lon", 3, None),
        (sumo, FCD_CSV, "timestep_time", "step", 1, "the header must name time"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named_with_its_line(
    form: traces.TraceFormat, text: str, old: str, new: str, line: int, words: str | None, tmp_path: Path
) -> None:
    path = written(tmp_path, "trace", text.replace(old, new) if old else text)
    ids = ["0"] if form is ns3 else ["bus.1"]
    with pytest.raises((RunError, UsageError)) as caught:
        traces.read(path, form, ids)
    if words is None:  # vehicles have no x: there are only persons
        assert "no node 'bus.1'" in str(caught.value)
    else:
        assert str(caught.value).startswith(f"{path}:{line}: ") and words in str(caught.value)


def test_a_choice_is_needed_where_there_are_several_nodes(tmp_path: Path) -> None:
    path = written(tmp_path, "a.tcl", SETDEST)
    with pytest.raises(UsageError, match=r"holds 2 nodes \('0', '1'\): choose with --id"):
        traces.read(path, ns3)
    with pytest.raises(UsageError, match="no node '7'"):
        traces.read(path, ns3, ["7"])
    only = written(tmp_path, "b.tcl", "".join(line for line in SETDEST.splitlines(True) if "(1)" not in line))
    assert list(traces.read(only, ns3).tracks) == ["0"]


def test_units_windows_and_origins_are_applied_in_this_order(tmp_path: Path) -> None:
    read = traces.read(written(tmp_path, "a.xml", FCD), sumo, ["bus.1"])
    how = Placement(metres=1000.0, seconds=60.0, start=15.0, end=45.0, time_origin=15.0, origin=(5000.0, 498000.0))
    track = trajectories.placed(read, how).tracks["bus.1"]
    assert track[:, :3] == pytest.approx(np.array([[0.0, 580.0, 350.0], [30.0, 1540.0, 350.0]]))
    with pytest.raises(UsageError, match="known from 0 to 1 s: no time is left between 2 and 1 s"):
        trajectories.placed(read, Placement(start=2.0))
    centred = trajectories.placed(read, Placement(origin="centre"))
    assert centred.origin == (6.0, 498.0)


def test_the_command_writes_a_track_that_a_scenario_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.tcl", SETDEST)
    answer = run_command(capsys, "import", "ns3", "a.tcl", "--id", "0")
    assert answer.code == 0 and "a_ns3.csv: written" in answer.out
    rows = list(csv.DictReader(Path("a_ns3.csv").read_text().splitlines()))
    assert list(rows[0]) == ["time", "id", "x", "y", "z"] and rows[0]["id"] == "0"
    answer = run_command(capsys, "import", "ns3", "a.tcl", "--id", "0", "--out", "s.yaml", "--json")
    assert answer.code == 0 and json.loads(answer.out)["files"] == ["s_0.csv", "s.yaml"]
    summary = run_command(capsys, "run", "s.yaml", "--set", "duration=4 s", "--quiet", "--out", "s.h5")
    assert summary.code == 0
    targets = wsnsim.read("s.h5", "truth")
    x, y = json.loads(answer.out)["origin"]
    assert targets.px.iloc[3] + x == pytest.approx(20.0) and targets.py.iloc[3] + y == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "x.txt"], "ends in .csv"),
        (["--nodes", "n.csv"], "--nodes goes with a scenario"),
        (["--id", "0", "--out", "x.yaml", "--nodes", "n.csv"], "n.csv: file does not exist"),
        (["--id", "0", "--unit", "s"], "--unit s:"),
        (["--id", "0", "--origin", "1;2"], "--origin 1;2: give two numbers"),
        (["--id", "0", "--time-origin", "nan"], "--time-origin nan: give a finite time"),
        (["--id", "0", "--from", "nan"], "--from nan: give a finite time"),
        (["--id", "0", "--until", "inf"], "--until inf: give a finite time"),
        (["--id", "0", "--list"], "--list shows all nodes"),
        (["--id", "0", "--out", "a.tcl.csv/x.csv"], "folder does not exist"),
        (["--id", "00"], "no node '00'"),
    ],
)
def test_wrong_options_end_with_one_sentence_and_no_file(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.tcl", SETDEST)
    answer = run_command(capsys, "import", "ns3", "a.tcl", *arguments)
    assert answer.code == 2 and words in answer.err and answer.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.tcl"]


def test_nodes_and_tracks_are_shifted_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.tcl", SETDEST)
    nodes = written(tmp_path, "n.csv", 'name,y,x,id,z\nfirst,40,7.5,a,2\nsecond,50,9,"b,1",3\n')
    command = ["import", "ns3", "a.tcl", "--id", "0", "--nodes", "n.csv", "--out", "s.yaml"]
    assert run_command(capsys, *command).code == 0
    assert "path: 'n.csv'" in Path("s.yaml").read_text()
    place = next(csv.DictReader(Path("s_0.csv").read_text().splitlines()))
    before = Path(nodes).read_text()
    answer = run_command(capsys, *command, "--origin", "5,1000", "--json")
    assert json.loads(answer.out)["files"] == ["s_nodes.csv", "s_0.csv", "s.yaml"]
    assert "path: 's_nodes.csv'" in Path("s.yaml").read_text() and Path(nodes).read_text() == before
    assert Path("s_nodes.csv").read_text() == 'id,x,y,z\na,2.5,-960,2\n"b,1",4,-950,3\n'
    shifted = next(csv.DictReader(Path("s_0.csv").read_text().splitlines()))
    assert float(place["x"]) - float(shifted["x"]) == 5.0 and float(place["y"]) - float(shifted["y"]) == 1000.0


def test_shifted_positions_never_replace_their_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.tcl", SETDEST)
    nodes = Path(written(tmp_path, "s_nodes.csv", "x,y\n1,2\n"))
    command = ["import", "ns3", "a.tcl", "--id", "0", "--origin", "5,6", "--out", "s.yaml", "--nodes"]
    answer = run_command(capsys, *command, "s_nodes.csv")
    assert answer.code == 2 and "s_nodes.csv would be replaced by the shifted positions" in answer.err
    assert nodes.read_text() == "x,y\n1,2\n"
    written(tmp_path, "n.csv", "x,y\n1,two\n")
    answer = run_command(capsys, *command, "n.csv")
    assert answer.code != 0 and "n.csv:2: " in answer.err and answer.err.count("\n") == 1
    assert not Path("s.yaml").exists() and not Path("s_0.csv").exists()


@pytest.mark.parametrize("sign", [" ", "   ", "\t", ",", ";"])
def test_a_plain_table_of_samples_is_read_and_ns3_says_who_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], sign: str
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = ["t id x y", "0 a 1 2", "0 b 9 9", "1 a 2.5 3"]
    written(tmp_path, "trace.txt", "".join(f"{row}\n" for row in rows).replace(" ", sign))
    assert run_command(capsys, "import", "sumo", "trace.txt", "--id", "a", "--out", "a.csv").code == 0
    assert Path("a.csv").read_text() == "time,id,x,y\n0,a,1,2\n1,a,2.5,3\n"
    answer = run_command(capsys, "import", "ns3", "trace.txt")
    assert answer.code != 0 and "read by wsnsim import sumo" in answer.err


def test_a_file_that_exists_is_replaced_only_if_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trace = written(tmp_path, "0.csv", "time;id;x;y\n0;0;1;2\n1;0;3;4\n")
    before = Path(trace).read_bytes()
    assert run_command(capsys, "import", "sumo", "0.csv").code == 0
    answer = run_command(capsys, "import", "sumo", "0.csv")
    assert answer.code == 2 and "0_sumo.csv exists: --out FILE.csv names another file" in answer.err
    assert Path(trace).read_bytes() == before


def test_nodes_are_listed_with_their_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "a.xml", FCD)
    lines = run_command(capsys, "import", "sumo", "a.xml", "--list").out.splitlines()
    assert [line.split(maxsplit=2) for line in lines[1:]] == [["bus.1", "2", "0 to 1 s"], ["ann", "1", "1 to 1 s"]]


def fcd(*rows: tuple[float, str, str, float, float]) -> str:
    """Floating car data of rows with time, kind, id, x and y."""
    steps = "".join(f'<timestep time="{t}"><{kind} id="{name}" x="{x}" y="{y}" speed="10"/></timestep>\n'
                    for t, kind, name, x, y in rows)  # fmt: skip
    return f"<fcd-export>\n{steps}</fcd-export>\n"


def test_a_person_with_the_id_of_a_vehicle_is_another_node(tmp_path: Path) -> None:
    rows = [(t, kind, "7", x, y) for t in range(3) for kind, x, y in (("vehicle", 10 * t, 0), ("person", 500, 500 + t))]
    found = traces.read(written(tmp_path, "a.xml", fcd(*rows)), sumo, ["7", "person:7"])
    assert found.tracks["7"][:, 1].tolist() == [0, 10, 20] and found.tracks["person:7"][:, 2].tolist() == [
        500,
        501,
        502,
    ]


@pytest.mark.parametrize("text", [fcd((0, "vehicle", "a", 0, 0), (1, "vehicle", "a", 1, 0), (1, "vehicle", "a", 9, 9)),
                                  "t;id;x;y\n0;a;0;0\n1;a;1;0\n1;a;9;9\n"])  # fmt: skip
def test_two_places_at_one_time_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r":4: 'a' is at another place at the same time, 1 s"):
        traces.read(written(tmp_path, "a.txt", text), sumo)


def test_degrees_are_recognised_by_speeds_and_projected_if_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [(t, "vehicle", "a", 13.4 + t * 1.47e-4, 52.5) for t in range(3)]
    for name, text in (("a.xml", fcd(*rows)), ("b.xml", f'<!-- <fcd-output.geo value="true"/> -->{fcd(*rows)}')):
        written(tmp_path, name, text)
        answer = run_command(capsys, "import", "sumo", name)
        assert answer.code == 1 and f"wsnsim import sumo {name} --crs wgs84" in answer.err
    assert (
        run_command(
            capsys, "import", "sumo", "b.xml", "--crs", "wgs84", "--origin", "13.4,52.5", "--out", "s.yaml"
        ).code
        == 0
    )
    track = np.genfromtxt("s_a.csv", delimiter=",", skip_header=1)[:, 2:]
    assert np.hypot(*np.diff(track, axis=0).T) == pytest.approx(9.98, abs=0.02)
    assert "--origin 13.4,52.5" in Path("s.yaml").read_text()


@pytest.mark.parametrize(
    ("kind", "rows", "said"),
    [
        ("track", "time,x,y\n0,500,0\n1,10,0\n2,20,0\n", "'t' jumps by 490 m in 1 s at 1 s: a wrong row"),
        ("track", "time,id,x,y\n0,7,500,500\n1,7,10,0\n2,7,502,500\n3,7,30,0\n", "several movers in one"),
        ("track", "time,x,y\n0,0,0\n1,1100,0\n2,2200,0\n", "'t' moves at 1.1e+03 m/s: "),
        ("sumo", "time,id,x,y\n0,a,13.4,52.5\n1,a,13.4001,52.5\n", "wsnsim import sumo t.csv --crs wgs84"),
        *(
            (
                kind,
                f"time,id,x,y,speed\n0,a,0,0,{v}\n1,a,9,9,{v}\n2,a,18,18,{v}\n",
                f"'a' moves by 12.7 m a second, and its speeds are {v:.3g} m/s: ",
            )
            for kind in ("track", "sumo")
            for v in (1.0, 45.8)
        ),
    ],
)
def test_places_and_speeds_that_no_track_has_are_said(
    kind: str, rows: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text(rows)
    answer = run_command(capsys, "import", kind, "t.csv", "--out", "u.csv")
    assert answer.code == 0 and said in answer.out, answer


@pytest.mark.parametrize("kind", ["track", "sumo"])
def test_speeds_that_fit_places_within_a_factor_of_two_are_not_questioned(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("time,id,x,y,speed\n0,a,0,0,0\n1,a,9,9,7\n2,a,18,18,7\n3,a,18,18,0\n")
    answer = run_command(capsys, "import", kind, "t.csv", "--out", "u.csv")
    assert answer.code == 0 and "a second" not in answer.out, answer


def test_speeds_of_a_trace_in_other_units_are_not_questioned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("time,id,x,y,speed\n0,a,0,0,8\n1,a,0.008,0,8\n")
    answer = run_command(capsys, "import", "sumo", "t.csv", "--out", "u.csv")
    assert answer.code == 1 and "--unit km" in answer.err
    assert run_command(capsys, "import", "sumo", "t.csv", "--unit", "km", "--out", "u.csv").code == 0
    assert Path("u.csv").read_text().splitlines()[-1] == "1,a,8,0"


def test_each_of_several_targets_is_present_when_the_trace_has_it_and_absences_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    long = [(t, "vehicle", "long", 10.0 * t, 0) for t in range(20) if not 3 < t < 9]
    written(tmp_path, "a.xml", fcd(*long, *((t, "vehicle", "short", 10.0 * t, 30) for t in range(2, 6))))
    answer = run_command(capsys, "import", "sumo", "a.xml", "--id", "long", "--id", "short", "--out", "s.yaml")
    assert answer.code == 0
    assert "'long' is there from 0 to 3 s, 9 to 19 s: its `presence`" in answer.out
    assert "'short' is there from 2 to 5 s: its `presence`" in answer.out
    setup = build(load(Path("s.yaml")))
    assert setup.duration == 20.0 and setup.presence == (((0.0, 3.0), (9.0, 19.0)), ((2.0, 5.0),))
    assert run_command(capsys, "run", "s.yaml", "--quiet", "--out", "s.h5").code == 0
    truth = wsnsim.read("s.h5", "truth").query("target == 1").set_index("time")
    assert truth.px.dropna().index.tolist() == [2.0, 3.0, 4.0, 5.0]
    part = ["import", "sumo", "a.xml", "--id", "long", "--from", "5", "--until", "12", "--time-origin", "5"]
    answer = run_command(capsys, *part, "--out", "p.csv")
    assert "time_origin: 0, q: 1, presence: [[4, 7]]" in answer.out


@pytest.mark.thorough
def test_a_long_trace_is_read_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "long.xml"
    others = "".join(
        f'<vehicle id="v{i}" x="1.00" y="{i}.00" angle="90.00" speed="0.00" lane="e_0"/>\n' for i in range(40)
    )
    with path.open("w") as file:
        file.write("<fcd-export>\n")
        for step in range(600):
            file.write(f'<timestep time="{step}">\n<vehicle id="me" x="{step}" y="0"/>\n{others}</timestep>\n')
        file.write("</fcd-export>\n")
    tracemalloc.start()
    try:
        track = traces.read(str(path), sumo, ["me"]).tracks["me"]
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(track) == 600 and peak < path.stat().st_size / 2


@pytest.mark.parametrize("ids", [[], ["0"]])
def test_the_entries_that_are_kept_and_the_names_of_a_trace_have_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ids: list[str]
) -> None:
    monkeypatch.setattr(traces, "MOST_KEPT", 2)
    samples = "t id x y\n" + "".join(f"{time} 0 1 2\n" for time in range(3))
    with pytest.raises(RunError, match=r":4: more than 2 entries of the chosen nodes: split it$"):
        traces.read(written(tmp_path, "a.txt", samples), sumo, ids)
    names = "t id x y\n" + "".join(f"0 {name} 1 2\n" for name in range(3))
    with pytest.raises(RunError, match=r":4: more than 2 different names: split it$"):
        traces.summarised(written(tmp_path, "b.txt", names), sumo)
    long = f"t id x y\n0 {'a' * 201} 1 2\n"
    with pytest.raises(RunError, match=r":2: a name must have at most 200 characters, has 201$"):
        traces.read(written(tmp_path, "c.txt", long), sumo, ids)


@pytest.mark.parametrize(
    ("rows", "options", "out", "said"),
    [
        ("0 a 1 2\n1e-12 a 1 2\n0.3 a 1 2", [], "s.yaml", ""),
        ("1700000000.25 a 0 0\n1700003600.25 a 9 9", [], "s.yaml", ""),
        ("0 a -9e6 0\n1 a 9e6 9", [], "s.yaml", ""),
        ("0 a\x1b[2J'# 1 2\n9 a\x1b[2J'# 2 3", [], "-ä\x1b's.yaml", ""),
        ("0 a 0 0\n1e-12 a 900 0\n9 a 9 9", [], "s.yaml", "900 m from the place in line 2"),
        ("0 a 0 0\n1e-12 a 900 0\n9 a 9 9", [], "s.csv", "900 m from the place in line 2"),
        ("0 a 0 0\n1e-12 a 0 0\n9 a 9 9", [], "s.csv", ""),
        ("0 a 0 0\n2e7 a 9 9", [], "s.yaml", "10,000,000|1e\\+07 are allowed"),
        ("0 a 0 0\n9e15 a 9 9", [], "s.yaml", "times must be within"),
        ("0 a 0 0\n9 a 9 9", ["--nodes", "one.csv"], "s.yaml", ""),
    ],
)
def test_what_is_imported_loads_or_is_not_written(
    rows: str,
    options: list[str],
    out: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "t\x1b.txt", f"t id x y\n{rows}\n")
    written(tmp_path, "one.csv", "x,y\n1,2\n")
    before = sorted(tmp_path.iterdir())
    answer = run_command(capsys, "import", "sumo", "t\x1b.txt", "--out", out, *options)
    if said:
        assert answer.code and re.search(said, answer.err) and sorted(tmp_path.iterdir()) == before, answer
    else:
        assert answer.code == 0 and "\x1b" not in answer.out, answer
        _ = build(load(Path(out))) if out.endswith(".yaml") else RecordedTrack(path=out).track


HOSTILE = ["9", " ", "[", '"', "(", "\x1b[2J", "a", "\u202e"]
PARSERS = {
    "ns3": lambda path: list(ns3.entries(path)),
    "sumo": lambda path: list(sumo.entries(path)),
    "csv": lambda path: bad_rows_text(
        path, read_rows(path, Wanted({"id": "id"}, {"x": "x"}), "positions").bad, 1
    ).splitlines()[1],
    "links": read_links,
    "table": lambda path: str(field_data.readings([path]).facts),
    "scenario": load,
}
FRAMES = {
    "ns3": ["now=+{}s node=1 pos=0:0:0 vel=0:0:0", "now=+{}parsec node=1 pos=0:0:0 vel=0:0:0", '$ns_ at {} "x"y',
            "now=+1s node=1 pos={} vel=0:0:0", "$node_(0) set X_ {}", "{}"],
    "sumo": ["t id x y\n0 a {} 1", '<fcd-export><timestep time="{}"/></fcd-export>', "t;id;{}\n"],
    "csv": ["id,x\n{},1\n", "id,x\na,{}\n", "{}\n"],
    "table": ["time,node,reading\n0,{},1\n", "time,node,reading\n{},a,1\n", "time,node,{}\n0,a,1\n", "{}\n"],
    "links": ['{{"tx_length": {}, "interframe_duration": 1}}', "{}"],
    "scenario": ["duration: {}\n", "{}: 1\n", "step: 1 {}\n", "tracker: {{kind: {}}}"],
}  # fmt: skip


@pytest.mark.parametrize(("parser", "frame"), [(name, frame) for name, frames in FRAMES.items() for frame in frames])
def test_a_long_text_is_refused_in_a_short_sentence_without_control_characters(
    parser: str, frame: str, tmp_path: Path
) -> None:
    for sign in HOSTILE:
        said = [refusal_of(parser, written(tmp_path, "a.yaml", frame.format(sign * count))) for count in (2_000, 4_000)]
        assert all(len(text) < 4_000 and printable(text) == text for text in said), said
        assert abs(len(said[0]) - len(said[1])) < 20


def refusal_of(parser: str, path: str) -> str:
    """What a parser says of a file; '' if it reads it."""
    try:
        found = PARSERS[parser](path)
    except WsnsimError as error:
        return str(error)
    return found if isinstance(found, str) else ""


def test_nodes_of_ns_3_are_always_there(tmp_path: Path) -> None:
    text = SETDEST + '$ns_ at 40.0 "$node_(1) setdest 500.0 5.0 1.0"\n'
    found = trajectories.placed(traces.read(written(tmp_path, "a.tcl", text), ns3, ["0", "1"]), Placement())
    assert {node: track[-1, 0] for node, track in found.tracks.items()} == {"0": 40.0, "1": 535.0}
    assert not found.presence and not found.notes


@pytest.mark.parametrize("seed", range(10))
def test_presence_holds_every_sample_that_has_a_neighbour_and_no_long_pause(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.5, 1.0, 2.0, 2.0, 30.0], p=[0.3, 0.3, 0.2, 0.17, 0.03], size=60)).round(3)
    rows = "".join(f"{time} a {k} {seed}\n" for k, time in enumerate(times.tolist()))
    trace = traces.read(written(tmp_path, "a.txt", f"t id x y\n{rows}-50 b 0 0\n900 b 1 1\n"), sumo, ["a", "b"])
    spans = trajectories.placed(trace, Placement(sampled=True)).presence["a"]
    near = np.diff(times) < 30.0
    joined = np.append(near, False) | np.insert(near, 0, False)
    inside = np.array([any(begin <= time <= end for begin, end in spans) for time in times])
    assert (inside == joined).all() and all(begin in times and end in times for begin, end in spans)
    assert sum(end - begin for begin, end in spans) == pytest.approx(np.diff(times)[near].sum())
