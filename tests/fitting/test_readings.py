"""Laws that are fitted to readings: known ones are recovered, and nothing is judged on what it was fitted to."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import wsnsim
from tests.helpers.recorded_walks import HEIGHT, Walks
from wsnsim.base.errors import RunError, ScenarioError, UsageError
from wsnsim.fitting import Fit
from wsnsim.fitting.data_files import ReadingOptions, read_nodes, read_sample
from wsnsim.fitting.fitted_law import LAWS
from wsnsim.fitting.located_readings import LocatedReadings, NodeTable
from wsnsim.scenario import build, load
from wsnsim.scenario.texts import shipped

BLE = next(iter(shipped().values())).parent / "recorded" / "ble"
TRACKS = ("straight_01", "straight_02", "straight_04", "straight_05", "zigzagging_with_rotation")
ALL = (*TRACKS, "rectangular_with_rotation")


def ble(*names: str) -> list[str]:
    return [str(BLE / f"{name}.csv.gz") for name in names]


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], str]:
    return Walks().write(tmp_path_factory.mktemp("walks"), 1)


def covered(fit: Fit, true: Walks) -> dict[str, bool]:
    """Which parameters lie in their intervals."""
    found = {name: value.low <= getattr(true, name) <= value.high for name, value in fit.values.items()}
    gains = true.nodes()[1]
    return found | {g.node: g.low <= gain <= g.high for g, gain in zip(fit.gains, gains, strict=True)}


@pytest.mark.thorough
def test_every_parameter_of_a_known_law_lies_in_its_interval_for_most_seeds(tmp_path: Path) -> None:
    true = Walks(dof=6.0)
    names = ("z0", "eta", "sd", "dof", "shadowing", "decorrelation")
    seeds = 12
    hits = dict.fromkeys(names, 0)
    gains = 0
    for seed in range(seeds):
        files, nodes = true.write(tmp_path, seed)
        found = covered(wsnsim.fit(files, nodes), true)
        hits = {name: hits[name] + found.get(name, False) for name in names}
        gains += sum(found[f"n{i}"] for i in range(8))
    # 95 % intervals: fewer than 8 of 12 have a probability below 1e-4 at a coverage of 90 %
    assert min(hits.values()) >= 8, hits
    assert gains >= 0.84 * 8 * seeds


def test_independent_normal_noise_is_found_to_be_that(tmp_path: Path) -> None:
    files, nodes = Walks(shadowing=0.0).write(tmp_path, 3)
    found = wsnsim.fit(files, nodes)
    assert found.sensor.keys() == {"kind", "z0", "eta", "d0", "sd", "gains", "nodes", "target_height", "fitted_on"}
    assert found.sensor["target_height"] == HEIGHT
    assert abs(found.sensor["sd"] - 4.0) < 0.2


def test_an_outlier_is_named_with_its_node_time_and_file(walks: tuple[list[str], str], tmp_path: Path) -> None:
    files, nodes = walks
    header, *rows = Path(files[0]).read_text().splitlines()
    time, node, reading, *place = rows[100].split(",")
    rows[100] = ",".join([time, node, str(float(reading) - 90.0), *place])
    (tmp_path / "one.csv").write_text("\n".join([header, *rows]))
    said = wsnsim.fit(tmp_path / "one.csv", nodes).text()
    row = rf"reading -\S+ dBm of {node} at {float(time):g} s in .*one.csv:102"
    assert re.search(rf"The largest residual: -\S+ dB, {row}. An outlier\? Delete this row, .* --out .*one.csv", said)


def test_the_coefficients_are_those_of_an_independent_least_squares(walks: tuple[list[str], str]) -> None:
    files, nodes = walks
    found = wsnsim.fit(files[:1], nodes)
    table = np.genfromtxt(files[0], delimiter=",", skip_header=1, converters={1: lambda text: float(text[1:])})
    places = np.genfromtxt(nodes, delimiter=",", skip_header=1)[:, 1:]
    node = table[:, 1].astype(int)
    distances = np.linalg.norm(table[:, 3:6] - places[node], axis=1)
    matrix = np.column_stack([node[:, None] == np.arange(8), -10 * np.log10(distances)])
    *constants, eta = np.linalg.lstsq(matrix, table[:, 2], rcond=None)[0]
    np.testing.assert_allclose(found.values["eta"].value, eta, rtol=1e-6)
    np.testing.assert_allclose(found.values["z0"].value, np.mean(constants), rtol=1e-6)
    np.testing.assert_allclose([g.value for g in found.gains], constants - np.mean(constants), atol=1e-5)


def test_intervals_are_those_of_a_leverage_corrected_sandwich_over_blocks(walks: tuple[list[str], str]) -> None:
    """An independent computation with whole matrices, and dummy variables for all nodes, z0 being their mean."""
    files, nodes = walks
    found = wsnsim.fit(files[:1], nodes, block=5.0)
    table = np.genfromtxt(files[0], delimiter=",", skip_header=1, converters={1: lambda text: float(text[1:])})
    places = np.genfromtxt(nodes, delimiter=",", skip_header=1)[:, 1:]
    node, block = table[:, 1].astype(int), (table[:, 0] // 5.0).astype(int)
    matrix = np.column_stack([
        node[:, None] == np.arange(8), -10 * np.log10(np.linalg.norm(table[:, 3:6] - places[node], axis=1)),
    ])  # fmt: skip
    to_estimates = np.linalg.pinv(matrix)
    maker = np.eye(len(matrix)) - matrix @ to_estimates
    of_gains = np.column_stack([np.eye(8) - 1 / 8, np.zeros(8)])
    wanted = np.vstack([of_gains, np.eye(9)[8]]) @ to_estimates
    combined = np.zeros((9, 12, len(matrix)))
    for b in range(12):
        own = np.flatnonzero(block == b)
        values, vectors = np.linalg.eigh(maker[np.ix_(own, own)])
        root = vectors / np.sqrt(values) @ vectors.T
        combined[:, b] = wanted[:, own] @ root @ maker[own]
    half = []
    for rows in combined:
        covariance = rows @ rows.T  # of the blocks' contributions, were the readings independent
        dof = np.trace(covariance) ** 2 / (covariance**2).sum()
        half.append(stats.t.ppf(0.975, dof) * np.linalg.norm(rows @ table[:, 2]))
    noise = found.model.noise
    ratio = np.hypot(*np.diff(table[::8, 3:5], axis=0).T).sum() / 12 / found.values["decorrelation"].value
    white = (noise.sd / noise.shadowing) ** 2 * 12 / 120
    between = (white + 2 / ratio) / (white + 2 * (ratio - 1 + np.exp(-ratio)) / ratio**2)
    values = [*found.gains, found.values["eta"]]
    np.testing.assert_allclose([v.high - v.value for v in values], np.array(half) * np.sqrt(between), rtol=1e-6)


def still(nodes: str, stays: list[tuple[float, float, int]], folder: Path) -> str:
    """A file of readings of a target that stays at each place for so many seconds, and walks 1 m a second between."""
    rng, place, now, rows = np.random.default_rng(1), np.array(stays[0][:2]), 0, ["time,node,reading,x,y,z"]
    ids = [line.split(",")[0] for line in Path(nodes).read_text().splitlines()[1:]]
    for x, y, seconds in stays:
        steps = [place + np.array([x - place[0], y - place[1]]) * k / 5 for k in range(1, 5)] if now else []
        place = np.array([x, y])
        for point in [*steps, *[place] * seconds]:
            rows += [f"{now},{name},{rng.normal(-70, 3):.2f},{point[0]},{point[1]},{HEIGHT}" for name in ids]
            now += 1
    file = folder / "still.csv"
    file.write_text("\n".join(rows) + "\n")
    return str(file)


def test_a_stay_is_never_cut_and_the_output_says_which_blocks_were_used(
    walks: tuple[list[str], str], tmp_path: Path
) -> None:
    _, nodes = walks
    file = still(nodes, [(2.0, 3.0, 40), (7.0, 3.0, 70), (7.0, 8.0, 25)], tmp_path)
    sample = read_sample([file], read_nodes(nodes, {}), LAWS["rssi"], ReadingOptions())
    blocks = sample.blocks(10.0)
    for place in ((2.0, 3.0), (7.0, 3.0), (7.0, 8.0)):
        assert len(set(blocks[(sample.points[:, :2] == place).all(axis=1)])) == 1
    assert "3 blocks of 8 links, of at least 10 s" in wsnsim.fit(file, nodes).text()
    single = [still(nodes, [stay], tmp_path / name) for name, stay in places_of_stays(tmp_path)]
    text = wsnsim.fit(single, nodes).text()
    assert "intervals come from 3 stays of 8 links" in text and "The target never moves" in text
    assert "Approximate intervals" in text and "sd: 3 blocks are fewer than 10." in text
    assert wsnsim.fit(single, nodes).as_json()["blocks"]["stays"] == 3


def places_of_stays(folder: Path) -> list[tuple[str, tuple[float, float, int]]]:
    """Four stays at three places, each with a folder of its own."""
    stays = [(2.0, 3.0, 40), (7.0, 3.0, 70), (7.0, 8.0, 25), (2.0, 3.0, 30)]
    for number in range(len(stays)):
        (folder / str(number)).mkdir()
    return [(str(number), stay) for number, stay in enumerate(stays)]


def test_the_same_files_give_the_same_fit_in_any_order_of_rows(walks: tuple[list[str], str], tmp_path: Path) -> None:
    files, nodes = walks
    head, *rows = Path(files[0]).read_text().splitlines()
    shuffled = tmp_path / "shuffled.csv"
    shuffled.write_text("\n".join([head, *rows[::-1]]) + "\n")
    assert wsnsim.fit(shuffled, nodes).values == wsnsim.fit(files[0], nodes).values


def test_columns_may_have_other_names_and_the_trajectory_may_be_a_file_of_its_own(
    walks: tuple[list[str], str], tmp_path: Path
) -> None:
    files, nodes = walks
    rows = [line.split(",") for line in Path(files[0]).read_text().splitlines()[1:]]
    readings, track = tmp_path / "readings.csv.gz", tmp_path / "track.csv"
    text = "\n".join(["at,who,dbm", *(",".join(row[:3]) for row in rows)])
    readings.write_bytes(gzip.compress(text.encode()))
    track.write_text("\n".join(["at,x,y,z", *(f"{row[0]},{row[3]},{row[4]},{row[5]}" for row in rows)]))
    columns = {"time": "at", "node": "who", "reading": "dbm"}
    apart = wsnsim.fit(readings, nodes, tracks=[track], columns=columns, node_columns={"id": "id"})
    assert apart.sensor | {"fitted_on": []} == wsnsim.fit(files[0], nodes).sensor | {"fitted_on": []}


def test_the_rows_of_a_trajectory_may_stand_in_any_order_and_bad_ones_are_skipped(
    walks: tuple[list[str], str], tmp_path: Path
) -> None:
    files, nodes = walks
    head, *rows = Path(files[0]).read_text().splitlines()
    track = tmp_path / "track.csv"
    track.write_text("\n".join([head, *rows[::-1]]))
    whole = wsnsim.fit(files[0], nodes)
    assert wsnsim.fit(files[0], nodes, tracks=track).values == whole.values
    track.write_text("\n".join([head, *rows, "0.000,n0,-60,99,0,0", "nan,n0,-60,1,1,1"]))
    with pytest.raises(
        RunError, match=r"m from the place in line 2; at most 0\.001 m is allowed[\s\S]*--skip-bad-rows"
    ):
        wsnsim.fit(files[0], nodes, tracks=track)
    found = wsnsim.fit(files[0], nodes, tracks=track, skip_bad_rows=True)
    assert found.values == whole.values
    lines = [row.removeprefix(f"{track}:").partition(":")[0] for row in found.sample.files[0].bad_rows]
    assert lines == [str(len(rows) + 2), str(len(rows) + 3)]


@pytest.mark.thorough(fast=["straight_04"])
@pytest.mark.parametrize("name", ALL)
def test_each_shipped_track_may_be_the_trajectory_of_its_readings(name: str) -> None:
    nodes, how = read_nodes(str(BLE / "receivers.csv"), {}), ReadingOptions(tracks=ble(name), skip_bad_rows=True)
    apart = read_sample(ble(name), nodes, LAWS["rssi"], how)
    own = read_sample(ble(name), nodes, LAWS["rssi"], ReadingOptions(skip_bad_rows=True))
    assert abs(len(apart.times) - len(own.times)) <= 2


def test_a_file_with_readings_of_two_targets_is_refused(tmp_path: Path) -> None:
    (tmp_path / "nodes.csv").write_text("id,x,y\na,0,0\nb,10,0\n")
    rows = [f"{k},{node},-60,{k},{4 if node == 'a' else 5},{k % 2}" for k in range(20) for node in "ab"]
    (tmp_path / "two.csv").write_text("\n".join(["time,node,reading,x,y,target", *rows]))
    with pytest.raises(
        RunError, match=r"of 2 targets: give a file for each, such as .*two.csv --where target=0 --out target_0.csv"
    ):
        wsnsim.fit(tmp_path / "two.csv", tmp_path / "nodes.csv")


@pytest.mark.thorough
def test_a_long_recording_has_a_bounded_number_of_pairs_over_the_same_lags() -> None:
    count = 200_000
    columns = (np.arange(count, dtype=float), np.zeros(count, int), np.zeros(count), np.zeros((count, 3)))
    table = NodeTable(("a",), np.zeros((1, 3)))
    first, second = LocatedReadings(*columns, np.zeros(count, int), table, (), np.arange(count)).pairs
    assert 4_500_000 < len(first) <= 5_000_000
    assert set(np.unique(second - first).tolist()) >= {1, 60}


def test_the_law_of_distances_has_the_biases_of_nodes(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    (tmp_path / "nodes.csv").write_text("id,x,y\na,0,0\nb,10,0\n")
    x = np.linspace(0.0, 10.0, 400)
    lines = ["time,node,range,x,y"]
    lines += [f"{k},a,{np.hypot(v, 3.0) + 0.5 + rng.normal(0, 1.0)},{v},3" for k, v in enumerate(x)]
    lines += [f"{k},b,{np.hypot(v - 10.0, 3.0) - 1.5 + rng.normal(0, 1.0)},{v},3" for k, v in enumerate(x)]
    (tmp_path / "ranges.csv").write_text("\n".join(lines))
    found = wsnsim.fit(tmp_path / "ranges.csv", tmp_path / "nodes.csv", law="range")
    assert found.values["bias"].low < -0.5 < found.values["bias"].high
    assert found.sensor.keys() == {"kind", "sd", "biases", "nodes", "fitted_on"}
    np.testing.assert_allclose(found.sensor["biases"], [0.5, -1.5], atol=0.2)
    assert abs(found.sensor["sd"] - 1.0) < 0.1
    common = wsnsim.fit(tmp_path / "ranges.csv", tmp_path / "nodes.csv", law="range", gains=False)
    np.testing.assert_allclose(common.sensor["biases"], [-0.5, -0.5], atol=0.2)
    assert abs(common.sensor["sd"] - np.sqrt(2.0)) < 0.1
    (tmp_path / "ranges.csv").write_text("\n".join([*lines, "400,a,-500,1,3"]))
    with pytest.raises(RunError, match=r"ranges\.csv:802: reading -500 m must be between -100 and 1e\+07"):
        wsnsim.fit(tmp_path / "ranges.csv", tmp_path / "nodes.csv", law="range")


@pytest.mark.thorough
def test_the_shipped_tracks_have_correlated_nearly_normal_residuals_and_receivers_with_gains() -> None:
    for name in ALL:
        found = wsnsim.fit(ble(name), BLE / "receivers.csv", skip_bad_rows=True)
        fitted, plain = found.train
        assert 3.0 < plain.kurtosis < 4.3 and 3.0 < fitted.kurtosis < 4.3
        assert 0.30 < plain.correlation < 0.45
        assert 0.12 < fitted.correlation < 0.26
        gains = [gain.value for gain in found.gains]
        assert -8.0 < min(gains) < -5.0 and 4.0 < max(gains) < 7.5
        assert abs(sum(gains)) < 1e-6
        assert fitted.skewness < -0.1  # fades are deeper than peaks are high


@pytest.mark.thorough
def test_gains_predict_a_track_that_was_not_fitted() -> None:
    for test in ALL:
        train = [name for name in ALL if name != test]
        (row,) = wsnsim.fit(ble(*train), BLE / "receivers.csv", test=ble(test), skip_bad_rows=True).test
        assert not row.in_sample
        assert row.fitted.rmse < 0.95 * row.plain.rmse
        assert row.fitted.log_likelihood > row.plain.log_likelihood


@pytest.mark.thorough
def test_a_corrupt_row_is_refused_or_skipped_and_named() -> None:
    with pytest.raises(RunError, match=r"straight_05\.csv\.gz:176: reading 42 dBm must be between -200 and 0"):
        wsnsim.fit(ble("straight_05"), BLE / "receivers.csv")
    (file,) = wsnsim.fit(ble("straight_05"), BLE / "receivers.csv", skip_bad_rows=True).sample.files
    assert [row.rpartition(":")[0].rpartition(":")[2] for row in file.bad_rows] == ["176", "2004"]
    assert file.readings == 3463


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1.0,nobody,-60,1,1,1.8", "node 'nobody' has no position in "),
        ("0.000,n0,-60,1,1,1.8", "node 'n0' has a reading at 0 s in line 2 already"),
        ("1.05,n0,nan,1,1,1.8", "reading must be a finite number, is 'nan'"),
        ("1.05,n0,-60,,1,1.8", "x must be a finite number"),
    ],
)
def test_a_bad_row_is_named_with_its_line(walks: tuple[list[str], str], tmp_path: Path, line: str, said: str) -> None:
    files, nodes = walks
    bad = tmp_path / "bad.csv"
    bad.write_text(Path(files[0]).read_text() + line + "\n")
    number = len(bad.read_text().splitlines())
    with pytest.raises(RunError) as error:
        wsnsim.fit(bad, nodes)
    assert f"bad.csv:{number}: {said}" in str(error.value)
    (file,) = wsnsim.fit(bad, nodes, skip_bad_rows=True).sample.files
    assert len(file.bad_rows) == 1


@pytest.mark.thorough
def test_a_law_is_not_judged_on_what_it_was_fitted_to(walks: tuple[list[str], str], tmp_path: Path) -> None:
    files, nodes = walks
    packed = tmp_path / "other_name.csv.gz"
    packed.write_bytes(gzip.compress(Path(files[0]).read_bytes()))
    head, *rows = Path(files[0]).read_text().splitlines()
    part = tmp_path / "part.csv"
    part.write_text("\n".join([head, *rows[: len(rows) // 3]]))
    for same in (files[0], packed, part):
        with pytest.raises(UsageError, match="must not be judged on what it was fitted to"):
            wsnsim.fit(files, nodes, test=same)
        (row,) = wsnsim.fit(files, nodes, test=same, in_sample=True).test
        assert row.in_sample
    assert [row.in_sample for row in wsnsim.fit(files[1:], nodes, test=files[0]).test] == [False]
    assert [row.in_sample for row in wsnsim.fit(files[:2], nodes, in_sample=True).test] == [True, True]


def test_neither_file_may_hold_a_hundredth_of_the_other(walks: tuple[list[str], str], tmp_path: Path) -> None:
    files, nodes = walks
    head, *rows = Path(files[0]).read_text().splitlines()
    others = Path(files[1]).read_text().splitlines()[1:]
    start, mixed = tmp_path / "start.csv", tmp_path / "mixed.csv"
    start.write_text("\n".join([head, *rows[:299]]))
    mixed.write_text("\n".join([head, *others[300:], *rows[:12]]))
    for train, test in ((start, files[0]), (mixed, files[0]), (files[0], mixed)):
        with pytest.raises(UsageError, match=rf"{test} and {train} share .* must not be judged"):
            wsnsim.fit(train, nodes, test=test)


def test_walks_on_one_grid_of_times_with_whole_readings_are_told_apart(tmp_path: Path) -> None:
    files, nodes = Walks(tracks=2, seconds=30.0).write(tmp_path, 4)
    for file in files:
        head, *rows = (line.split(",") for line in Path(file).read_text().splitlines())
        for row in rows:
            row[2] = f"{float(row[2]):.0f}"
        Path(file).write_text("\n".join(map(",".join, [head, *rows])))
    (row,) = wsnsim.fit(files[0], nodes, test=files[1]).test
    assert not row.in_sample


def test_a_scenario_that_judges_a_law_on_its_own_readings_is_refused(tmp_path: Path) -> None:
    law = wsnsim.fit(ble("straight_02"), BLE / "receivers.csv", noise="student_t").sensor
    assert {"gains", "target_height", "dof", "shadowing", "decorrelation", "fitted_on"} <= law.keys()
    repacked = tmp_path / "mine.csv.gz"
    repacked.write_bytes(gzip.compress(gzip.decompress((BLE / "straight_02.csv.gz").read_bytes()), mtime=7))
    for path, allowed, issues in ((repacked, False, 1), (repacked, True, 0), (BLE / "straight_01.csv.gz", False, 0)):
        overrides = [f"sensor.path={path}", f"sensor.in_sample={str(allowed).lower()}", f"motion.path={path}"]
        overrides += [f"sensor.law.{key}={json.dumps(value)}" for key, value in law.items()]
        found = load("recorded_track", overrides)
        if not issues:
            build(found)
            continue
        with pytest.raises(ScenarioError, match="among those that the law was fitted to"):
            build(found)


def test_readings_that_do_not_determine_the_law_are_refused(tmp_path: Path) -> None:
    (tmp_path / "nodes.csv").write_text("id,x,y\na,0,0\nb,10,0\n")
    rows = [f"{k},{node},-60,3,{4 if node == 'a' else 5}" for k in range(20) for node in "ab"]
    (tmp_path / "rest.csv").write_text("\n".join(["time,node,reading,x,y", *rows]))
    with pytest.raises(RunError, match="eta is not determined; without gains"):
        wsnsim.fit(tmp_path / "rest.csv", tmp_path / "nodes.csv")
    files, nodes = Walks(tracks=1).write(tmp_path, 1)
    with pytest.raises(RunError, match="within one block of 1000 s"):
        wsnsim.fit(files, nodes, block=1000.0)
    (tmp_path / "nodes.csv").write_text("id,x,y\na,0,0\nb,10,0\n")
    (tmp_path / "few.csv").write_text("time,node,reading,x,y\n0,a,-60,1,1\n")
    with pytest.raises(RunError, match="1 readings cannot determine this law"):
        wsnsim.fit(tmp_path / "few.csv", tmp_path / "nodes.csv")


def test_options_and_laws_that_do_not_exist_are_refused_with_the_nearest(walks: tuple[list[str], str]) -> None:
    files, nodes = walks
    with pytest.raises(UsageError, match="did you mean 'rssi'"):
        wsnsim.fit(files, nodes, law="rsi")
    with pytest.raises(UsageError, match="did you mean 'gains'"):
        wsnsim.fit(files, nodes, gain=True)
    with pytest.raises(UsageError, match="columns: unknown column 'tim'"):
        wsnsim.fit(files, nodes, columns={"tim": "t"})


@pytest.mark.thorough
def test_texts_name_train_and_test_and_the_figure_is_written(walks: tuple[list[str], str], tmp_path: Path) -> None:
    files, nodes = walks
    found = wsnsim.fit(files[:3], nodes, test=files[3:])
    for file in found.sample.files:
        assert file.path in found.text() and f"train: {file.path}" in found.yaml() and file.digest in found.yaml()
    assert f"test: {files[3]}" in found.yaml()
    assert found.as_json()["test"][0]["in_sample"] is False
    assert found.plot(tmp_path / "residuals.png").stat().st_size > 10_000


ANCHORS = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 12.0), (0.0, 12.0)])


def ranges(
    folder: Path, reading: float = 1.0, node: float = 1.0, place: float = 1.0, bias: float = 0.2, start: float = 0.0
) -> tuple[Path, Path, Path]:
    """Files of ranges, anchors and a track; in m, but for these factors. Ranges begin at a time, the track at 0 s."""
    times = np.arange(120) / 5
    walk = np.column_stack([10 + 8 * np.cos(times / 2), 6 + 4 * np.sin(times)])
    noise = np.random.default_rng(1).normal(bias, 0.1, (120, 4))
    distances = np.linalg.norm(walk[:, None] - ANCHORS, axis=2) + noise
    tables = {
        "r.csv": ["time,node,range", *(f"{start + time},a{i},{reading * distances[k, i]}"
                                       for k, time in enumerate(times) for i in range(4))],
        "n.csv": ["id,x,y", *(f"a{i},{node * x},{node * y}" for i, (x, y) in enumerate(ANCHORS))],
        "w.csv": ["time,x,y", *(f"{time},{place * x},{place * y}"
                                for time, (x, y) in zip(times, walk, strict=True))],
    }  # fmt: skip
    for name, lines in tables.items():
        (folder / name).write_text("\n".join(lines) + "\n")
    return folder / "r.csv", folder / "n.csv", folder / "w.csv"


UNITS: dict[str, tuple[dict[str, float], str]] = {
    "ranges in mm": ({"reading": 1e3}, "must be in m, seem to be in mm: readings. Write: wsnsim import readings {0}"),
    "ranges in cm": ({"reading": 1e2}, "must be in m, seem to be in cm: readings. Write: wsnsim import readings {0}"),
    "anchors in mm": ({"node": 1e3}, "must be in m, seem to be in mm: nodes. Write: wsnsim import nodes {1} --unit mm"),
    "track in cm": ({"place": 1e2}, "must be in m, seem to be in cm: track. Write: wsnsim import track {2} --unit cm"),
    "places in mm": ({"node": 1e3, "place": 1e3}, "import nodes {1} --unit mm and wsnsim import track {2} --unit"),
}  # fmt: skip


@pytest.mark.parametrize("case", UNITS)
def test_ranges_and_places_in_other_units_are_refused_with_the_command_that_converts_them(
    case: str, tmp_path: Path
) -> None:
    factors, said = UNITS[case]
    files = ranges(tmp_path, **factors)
    with pytest.raises(RunError) as caught:
        wsnsim.fit(files[0], files[1], law="range", tracks=[files[2]])
    assert said.format(*files) in str(caught.value)
    (tmp_path / "good").mkdir()
    good = ranges(tmp_path / "good")
    if case.startswith("ranges"):
        with pytest.raises(RunError) as caught:
            wsnsim.fit([good[0], files[0]], good[1], law="range", tracks=[good[2]])
        assert said.format(*files) in str(caught.value)


@pytest.mark.parametrize("bias", [0.0, -3.0, 50.0])
def test_biased_ranges_in_metres_are_fitted_and_their_text_has_one_form_of_numbers(bias: float, tmp_path: Path) -> None:
    files = ranges(tmp_path, bias=bias)
    found = wsnsim.fit(files[0], files[1], law="range", tracks=[files[2]])
    assert abs(found.values["bias"].value - bias) < 0.05
    assert "480 readings of 1 track:" in found.text() and "inf" not in found.text()
    rows = re.findall(r"^a\d +(\S+) +(\S+) to (\S+) +120$", found.text(), re.M)
    assert len(rows) == 4 and all(f"{float(each):.4g}" == each for row in rows for each in row), found.text()


def test_what_no_row_of_a_file_has_is_said_with_what_helps(tmp_path: Path) -> None:
    files = ranges(tmp_path)
    for skip in (False, True):
        with pytest.raises(RunError) as caught:
            wsnsim.fit(files[0], files[1], tracks=[files[2]], skip_bad_rows=skip)
        assert "; --law range is for ranges in m, rssi (the default) for levels (479 more rows" in str(caught.value)
        assert "--skip-bad-rows" not in str(caught.value)
    files = ranges(tmp_path, start=1778594600.0)
    with pytest.raises(RunError, match=r"does not reach 1778594600 s; give both the same --time-origin") as caught:
        wsnsim.fit(files[0], files[1], law="range", tracks=[files[2]])
    assert "--skip-bad-rows" not in str(caught.value)


def test_a_node_without_a_position_is_named_with_the_file_that_lacks_it(tmp_path: Path) -> None:
    files = ranges(tmp_path)
    files[1].write_text("id,x,y\na0,0,0\na1,20,0\na2,20,12\n")
    with pytest.raises(RunError, match=r"r.csv:5: node 'a3' has no position in .*n.csv \(which has a0, a1, a2\)"):
        wsnsim.fit(files[0], files[1], law="range", tracks=[files[2]])


def test_readings_at_the_ends_of_a_trajectory_may_be_rounded(tmp_path: Path) -> None:
    files = ranges(tmp_path, start=4e-7)
    assert wsnsim.fit(files[0], files[1], law="range", tracks=[files[2]]).sample.files[0].readings == 480
