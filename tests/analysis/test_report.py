"""The page holds what the tables hold, within its size, escaped, whole; its replay is what a slow loop would draw."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from wsnsim import experiment, read
from wsnsim.analysis import film, replay, report, tally
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import KIND, TABLES, columns_of
from wsnsim.recording import ResultFile
from wsnsim.scenario import load

PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
LINE = (("px", "m"), ("vx", "m/s"))
BY_LINE = {"states": LINE, "place": (0,)}
HOSTILE = "</script><script>alert(1)</script>{{script}}&$\\frac"
VOID = ("meta", "link", "input", "img", "br")
KINDS = {"u1": "u1", "u2": "<u2", "u4": "<u4", "i4": "<i4", "f4": "<f4"}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A real run: a network in which nodes wake, join, sense, send, hand over and sleep."""
    path = tmp_path_factory.mktemp("real") / "real.h5"
    told = ["duration=4 s", "tracker.particles=40", "record.particles=true"]
    experiment.run(load("pso_mhpf", told), replicates=2, out=path)
    return path


@pytest.fixture(scope="module")
def page(result):
    """The page of the real run."""
    out = result.with_suffix(".html")
    report.write([result], out)
    return out.read_text(encoding="utf-8")


def invented(path, states=PLANE, place=(0, 2), targets=1, runs=1, steps=6, nodes=5, name="invented", **said):
    """A result of invented rows. `without`: tables not recorded; `status`; `estimates`, `events`: whether any."""
    rng = np.random.default_rng(2)
    wanted = dict.fromkeys(TABLES, True) | dict.fromkeys(said.get("without", ()), False)
    with ResultFile(path, states, wanted, position=place, status=said.get("status", "complete")) as file:
        file.set_text("scenario/source_yaml", f"name: {name}\n")
        file.set_text("scenario/resolved_json", json.dumps({"name": name, "seed": 1, "step": 0.5, "said": name}))
        file.set_text("provenance_json", json.dumps({"command_line": name, "packages": {"numpy": "2"}}))
        for run in range(runs):
            row = dict.fromkeys((column.name for column in columns_of("runs")), 0)
            file.write("runs", row | {"replicate": run, "rmse": 1.0 + run, "energy": 2.0 + run})
            for target in range(targets):
                _invented_track(file, states, place, {"replicate": run, "target": target}, steps, rng, said)
            places = {"x": rng.uniform(-50, 50, nodes), "y": rng.uniform(-50, 50, nodes)}
            charge = {"gain": 1.0, "energy_initial": 2.0, "energy_left": 1.5, "died_at": np.nan}
            file.write("nodes", {"replicate": run, "node": np.arange(nodes), **places, **charge})
            if said.get("events"):
                _invented_events(file, run, steps, nodes, rng)
    return path


def _invented_track(file, states, place, track, steps, rng, said):
    step = np.arange(steps + 1)
    way = {name: rng.normal(0, 20, steps + 1) for name, _ in states}
    if states:
        file.write("truth", {**track, "step": step, "time": 0.5 * step, **way})
    if states and said.get("estimates", True):
        row = dict.fromkeys((column.name for column in columns_of("estimates", states, place)), 0)
        near = {name: values[1:] + rng.normal(0, 1, steps) for name, values in way.items()}
        file.write("estimates", {**row, **track, "step": step[1:], "time": 0.5 * step[1:], **near, "error": 1.0})


def _invented_events(file, run, steps, nodes, rng):
    count = 40 * steps
    code = np.array([KIND[kind] for kind in ("send", "receive", "collide", "sense", "wake", "sleep", "death", "crash")])
    step = np.sort(rng.integers(0, steps + 1, count))
    one = {"replicate": run, "step": step, "time": 0.5 * step, "target": 0, "what": file.words.code("reading")}
    node, peer = rng.integers(0, nodes, count), rng.integers(-1, nodes, count)
    kind, frame = code[rng.integers(0, len(code), count)], rng.integers(1, 20, count)
    rest = {"sequence": 0, "packets": 1, "bits": 8, "joules": rng.uniform(0, 1e-3, count), "cause": 1}
    file.write("events", {**one, "node": node, "peer": peer, "kind": kind, "frame": frame, **rest})


class Reader(HTMLParser):
    """A page's elements and texts, and whether every element that opens also closes."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.ids = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.ids += [value for name, value in attributes if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        self.texts.append((self.open[-1] if self.open else "", text))


def unpacked(text):
    """Header and columns of a replay, as its description says that they lie."""
    raw = zlib.decompress(base64.b64decode(text))
    size = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4 : 4 + size])
    at = {name: np.frombuffer(raw, KINDS[kind], count, 4 + size + offset)
          for name, (kind, offset, count) in header["columns"].items()}  # fmt: skip
    return header, at


def no_pictures(path, replicate):
    """No figures: they take their time, and are not what is tested."""
    return [], []


def films_of(page):
    return re.findall(r'<script type="text/plain" class="film"[^>]*>([^<]*)</script>', page)


def rows_at(columns, name, frame):
    """The rows of something that happens at some frames only: those of one frame, and of all up to it."""
    ends = np.cumsum(columns[f"{name}_count"])
    return slice(ends[frame] - columns[f"{name}_count"][frame], ends[frame])


# the replay


def test_places_are_those_of_the_tables_to_a_rounding(result, page):
    header, at = unpacked(films_of(page)[0])
    left, bottom, right, top = header["box"]
    truth, guess, nodes = (
        frame[frame.replicate == 0]
        for frame in (read(result, "truth"), read(result, "estimates"), read(result, "nodes"))
    )
    for name, table, columns in (
        ("truth", truth, ("px", "py")),
        ("guess", guess, ("px", "py")),
        ("node", nodes, ("x", "y")),
    ):
        for axis, column, low, high in zip("xy", columns, (left, bottom), (right, top), strict=True):
            shown = low + at[f"{name}_{axis}"][-len(table) :] / 65534 * (high - low)
            np.testing.assert_allclose(shown, table[column].clip(low, high), atol=0.51 * (high - low) / 65534)
    assert at["guess_x"][0] == film.MISSING and len(at["guess_x"]) == header["frames"] == 101
    np.testing.assert_array_equal(at["node"][at["head"][1:]], guess["head"])
    np.testing.assert_allclose(at["error"][1:], guess["error"], rtol=1e-6)


def test_states_and_charges_are_what_a_loop_over_the_log_gives(tmp_path):
    path = invented(tmp_path / "x.h5", events=True, steps=12, nodes=7)
    header, at = unpacked(replay.pack(path, 0, 10**6).text)
    events, nodes = read(path, "events"), read(path, "nodes")
    state, spent = dict.fromkeys(range(7), 0), dict.fromkeys(range(7), 0.0)
    for node in range(7):
        changes = events[(events.node == node) & events.kind.isin(["wake", "sleep", "death", "crash"])]
        state[node] = int(changes.kind.iloc[0] == "sleep")
    booked = events.groupby("node").joules.sum()
    mode, level = at["state"].copy(), at["charge"].copy()
    low, _, levels = header["charge"]
    for frame in range(header["frames"]):
        for row in events[events.step == frame].itertuples():
            state[row.node] = {"wake": 1, "sleep": 0, "death": 2, "crash": 2}.get(row.kind, state[row.node])
            spent[row.node] += row.joules
        for name, values, field in (("turn", mode, "state"), ("drain", level, "level")):
            rows = rows_at(at, name, frame)
            for node, value in zip(at[f"{name}_node"][rows], at[f"{name}_{field}"][rows], strict=True):
                values[node] = value
        assert mode.tolist() == list(state.values())
        even = (nodes.energy_initial - nodes.energy_left - booked) * frame / 12
        share = 1 - (np.array(list(spent.values())) + even) / 2.0
        np.testing.assert_allclose(low + (1 - low) * level / levels, share, atol=0.51 * (1 - low) / levels)


def test_links_are_what_a_loop_over_the_log_gives(tmp_path):
    path = invented(tmp_path / "x.h5", events=True, steps=12, nodes=7)
    header, at = unpacked(replay.pack(path, 0, 10**6).text)
    events = read(path, "events")
    received = set(events[events.kind == "receive"].frame)
    for frame in range(header["frames"]):
        expected, senses, casts = set(), set(), []
        for row in events[events.step == frame].itertuples():
            if row.kind in ("receive", "collide") and row.peer >= 0:
                expected.add((row.peer, row.node, row.kind == "collide"))
            if row.kind == "send" and row.peer >= 0 and row.frame not in received:
                expected.add((row.node, row.peer, True))
            if row.kind == "send" and row.peer < 0:
                casts.append(row.node)
            if row.kind == "sense":
                senses.add(row.node)
        rows = rows_at(at, "link", frame)
        names = ("link_origin", "link_goal", "link_lost")
        assert set(zip(*(at[name][rows].tolist() for name in names), strict=True)) == expected
        assert at["cast_node"][rows_at(at, "cast", frame)].tolist() == casts
        assert set(at["sense_node"][rows_at(at, "sense", frame)].tolist()) == senses


def test_members_are_as_many_as_the_estimates_say_unless_the_cluster_ends_with_the_step(result):
    _, at = unpacked(replay.pack(result, 0, 10**7).text)
    guess = read(result, "estimates").query("replicate == 0").set_index("step")
    events = read(result, "events").query("replicate == 0")
    ended = set(events[events.kind == "handover"].step)
    members, checked = set(), 0
    for frame in range(101):
        rows = rows_at(at, "turn", frame)
        members -= {node for node, to in zip(at["turn_node"][rows], at["turn_state"][rows], strict=True) if to != 1}
        rows = rows_at(at, "join", frame)
        for node, target in zip(at["join_node"][rows], at["join_target"][rows], strict=True):
            members = {node} if target >= replay.ANEW else members | {node}
        if frame and frame not in ended:
            assert len(members) == guess.members[frame]
            checked += 1
    assert checked > 80


def test_particles_are_where_the_table_has_them(result):
    header, at = unpacked(replay.pack(result, 1, 10**7).text)
    cloud = read(result, "particles").query("replicate == 1 and step == 50 and weight > 0")
    rows = rows_at(at, "cloud", 50)
    side = header["box"][2] - header["box"][0]
    shown = header["box"][0] + side * (at["cloud_x_low"][50] + at["cloud_x"][rows] / 255 * at["cloud_x_width"][50])
    assert 0 < shown.size <= len(cloud)
    for x in shown:
        assert np.abs(cloud.px - x).min() < 0.51 * side * at["cloud_x_width"][50] / 255 + 1e-4


def test_what_has_no_room_is_thinned_and_said(tmp_path):
    path = invented(tmp_path / "x.h5", events=True, steps=200, nodes=100)
    whole = replay.pack(path, 0, 10**6)
    part = replay.pack(path, 0, len(whole.text) // 3)
    assert len(part.text) <= len(whole.text) // 3
    assert any("step of 200 is drawn" in note for note in part.notes)
    assert not any("step of" in note for note in whole.notes)
    header, at = unpacked(part.text)
    assert header["stride"] > 1 and header["frames"] == -(-200 // header["stride"]) + 1 == len(at["link_count"])
    none = replay.pack(path, 0, 100)
    assert none.text == "" and "left out" in none.notes[0]


def test_what_is_kept_is_spread_evenly():
    frames = np.repeat([0, 2, 3], [10, 3, 100])
    kept = replay._thinned(frames, 5)
    assert [int(kept[frames == frame].sum()) for frame in (0, 2, 3)] == [5, 3, 5]
    assert np.diff(np.flatnonzero(kept[frames == 3])).tolist() == [20] * 4
    assert film.evenly(10, 5).tolist() == [False, True] * 5
    assert film.evenly(0, 5).size == 0 and film.evenly(3, 5).all()


# the page


def test_a_page_is_whole_and_asks_for_nothing(page):
    read_page = Reader(page)
    tags = [tag for tag, _ in read_page.tags]
    assert not {"iframe", "object", "embed", "base", "form", "audio", "video"} & set(tags)
    assert [at.get("type") for tag, at in read_page.tags if tag == "script"] == ["text/plain", None]
    policy = next(at["content"] for _, at in read_page.tags if at.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    for _, attributes in read_page.tags:
        for name in ("src", "href", "xlink:href", "srcset", "action"):
            assert attributes.get(name, "#").startswith(("#", "data:"))
    assert len(set(read_page.ids)) == len(read_page.ids)
    used = set(re.findall(r'url\(#([^)]+)\)|xlink:href="#([^"]+)"', page))
    assert used and {a or b for a, b in used} <= set(read_page.ids)


def test_the_summary_has_the_means_the_intervals_and_what_was_published(tmp_path):
    path = invented(tmp_path / "x.h5", runs=8)
    table = tally.tally([path], ["x"], lambda scenario: ({"energy": 1.82}, "Jiang 2013"))
    cells = dict(re.findall(r'<th scope="row">([^<]*)</th><td>(.*?)</td>', table))
    assert cells["replicates"] == "8"
    mean, low, high = re.match(r"([\d.]+) m <span[^>]*>\[([\d.]+), ([\d.]+)\]", cells["RMSE of a run"]).groups()
    assert float(mean) == 4.5 and 2.5 < float(low) < 4.5 < float(high) < 6.5
    assert "published 1.82 J (Jiang 2013)" in cells["energy"]
    assert "[" not in re.search(r"<td>(.*?)</td>", tally.tally([invented(tmp_path / "y.h5", runs=4)], ["y"]))[1]


def test_the_same_result_gives_the_same_bytes(tmp_path):
    path = invented(tmp_path / "x.h5", events=True, **BY_LINE)
    for name in ("a.html", "b.html"):
        report.write([path], tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.html", "b.html", "x.h5"]


def test_every_text_of_a_scenario_is_escaped(tmp_path):
    states = ((f"px{HOSTILE}", f"m{HOSTILE}"), ("vx", "m/s"))
    path = invented(tmp_path / "<b>'\".h5", states, (0,), name=HOSTILE)
    report.write([path], tmp_path / "x.html")
    read_page = Reader((tmp_path / "x.html").read_text(encoding="utf-8"))
    tags = [tag for tag, _ in read_page.tags]
    assert tags.count("script") == 2 and "b" not in tags
    shown = [text for tag, text in read_page.texts if HOSTILE in text]
    assert len(shown) >= 5
    header, _ = unpacked(films_of((tmp_path / "x.html").read_text(encoding="utf-8"))[0])
    assert HOSTILE in header["axes"][1]


@pytest.mark.parametrize(
    ("told", "word"),
    [
        ({**BY_LINE, "estimates": False}, "There are no estimates"),
        ({**BY_LINE, "without": ("events",)}, "the event log was not recorded"),
        ({**BY_LINE, "without": ("nodes",)}, "No nodes are drawn"),
        ({"status": "partial", "without": ("runs", "estimates")}, "its run did not end"),
        ({"without": tuple(name for name in TABLES if name != "runs")}, "There is nothing to replay"),
        ({**BY_LINE, "targets": 2}, "track of replicate 0, target 1"),
        ({"states": (), "place": None, "events": True}, "frames sent"),
    ],
)
def test_a_result_that_lacks_something_still_gives_a_sound_page(tmp_path, told, word):
    path = invented(tmp_path / "x.h5", **told)
    report.write([path], tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    Reader(text)
    assert word in text


def test_a_log_without_nodes_draws_nothing_between_them(tmp_path):
    path = invented(tmp_path / "x.h5", events=True, without=("nodes",))
    assert not {"link_count", "join_count", "node_x"} & unpacked(replay.pack(path, 0, 10**6).text)[1].keys()
    bare = invented(tmp_path / "y.h5", events=True, without=("nodes", "truth", "estimates"))
    assert replay.pack(bare, 0, 10**6).text == ""


def test_a_position_on_a_line_is_drawn_over_time_with_its_sensors_at_the_edge(tmp_path):
    path = invented(tmp_path / "x.h5", targets=2, **BY_LINE)
    header, at = unpacked(replay.pack(path, 0, 10**6).text)
    assert header["flat"] and header["targets"] == [0, 1] and header["axes"] == ["time [s]", "px [m]"]
    assert (np.diff(at["truth_x"].astype(int).reshape(2, -1)) > 0).all() and set(at["node_x"]) == {65534}
    shown = header["box"][1] + (header["box"][3] - header["box"][1]) * at["node_y"] / 65534
    np.testing.assert_allclose(shown, read(path, "nodes").x, atol=0.01)


def test_a_hundred_thousand_nodes_fit_and_a_small_page_is_kept_to(tmp_path, monkeypatch):
    path = invented(tmp_path / "x.h5", nodes=100_000, without=("energy_steps",))
    for limit in (report.LIMIT, 400_000):
        if limit < report.LIMIT:
            monkeypatch.setattr(report, "pictures", no_pictures)
        made = report.write([path], tmp_path / "x.html", limit=limit)
        assert made.bytes == (tmp_path / "x.html").stat().st_size <= limit
        thinned = [note for note in made.notes if "of 100,000 nodes are drawn" in note]
        assert bool(thinned) == (limit < report.LIMIT)
        assert all(note in (tmp_path / "x.html").read_text() for note in thinned)


def test_several_results_stand_side_by_side_and_share_the_room(result, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "pictures", no_pictures)
    other = invented(tmp_path / "y.h5", events=True)
    report.write([other, result, other], tmp_path / "x.html", limit=60_000)
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    Reader(text)
    assert len(text.encode()) <= 60_000
    assert re.findall(r'class="film" data-title="([^"]*)"', text) == ["invented, y.h5", "pso_mhpf", "invented, y.h5"]
    assert unpacked(films_of(text)[1])[0]["last"] == 100


def test_another_replicate_is_replayed_and_one_that_is_not_there_is_refused(result, tmp_path):
    one, other = (unpacked(replay.pack(result, run, 10**7).text)[1]["truth_x"] for run in (0, 1))
    assert not np.array_equal(one, other)
    with pytest.raises(UsageError, match="there is no replicate 2; it has 0 … 1"):
        report.write([result], tmp_path / "x.html", 2)
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_written_leaves_nothing(result, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "pictures", no_pictures)
    with pytest.raises(ResultError, match=r"x\.html: cannot be written: No such file"):
        report.write([result], tmp_path / "none" / "x.html")
    (tmp_path / "x.html").mkdir()
    with pytest.raises(ResultError, match="cannot be written"):
        report.write([result], tmp_path / "x.html")
    assert [file.name for file in tmp_path.iterdir()] == ["x.html"]


# the command


@pytest.fixture
def wsnsim(tmp_path, monkeypatch, capsys):
    """wsnsim('report', ...) -> (exit code, stdout, stderr), in a folder of its own."""
    import wsnsim.cli.reporting  # noqa: F401
    from wsnsim.cli import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(report, "pictures", no_pictures)

    def run(*words):
        code = main(["report", *map(str, words)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def test_the_command_writes_beside_the_result_or_where_it_is_told(wsnsim, result):
    invented(Path("x.h5"))
    code, out, err = wsnsim("x.h5")
    assert code == 0 and out.startswith("x.html: 0.0") and err == ""
    assert wsnsim("x.h5", result)[1].startswith("report.html: ")
    assert wsnsim(result, "-o", "y.html", "--replicate", "1", "--megabytes", "0.5")[0] == 0
    assert Path("y.html").stat().st_size <= 500_000


def test_the_command_refuses_what_it_cannot_do_in_one_line(wsnsim):
    invented(Path("x.h5"))
    Path("text.h5").write_text("no result")
    for words, code, message in (
        (["xx.h5"], 1, "xx.h5: no such file, did you mean 'x.h5'?"),
        (["text.h5"], 1, "text.h5: is not a wsnsim result"),
        (["x.h5", "--out", "x.h5"], 2, "x.h5 is the result itself"),
        (["x.h5", "--out", "none/x.html"], 2, "there is no folder none; make it first"),
        (["x.h5", "--replicate", "3"], 2, "there is no replicate 3; it has 0"),
        (["x.h5", "--megabytes", "0"], 2, "'--megabytes'"),
        ([], 2, "Missing argument"),
    ):
        said = wsnsim(*words)
        assert said[0] == code and message in said[2] and said[2].count("\n") == 1, words
    assert sorted(file.name for file in Path().iterdir()) == ["text.h5", "x.h5"]
