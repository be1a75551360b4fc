"""Filters written here from the raw rows of the recorded tracks give what ours give, and a changed row is noticed.

Nothing of wsnsim takes part in `ekf`, `particle_filter` and what they read: both would fail if readings were simulated
again, or assigned to other steps or receivers.
"""

from __future__ import annotations

import csv
import gzip
import itertools
import math

import numpy as np
import pytest

import wsnsim
from tests.helpers.thorough import first
from wsnsim.analysis.difference import differ
from wsnsim.base.tables import Memory
from wsnsim.scenario.texts import shipped

BLE = shipped()["pso_mhpf"].parent / "recorded" / "ble"
TRACKS = ["straight_04", "rectangular_with_rotation", "straight_01", "straight_02", "straight_05",
          "zigzagging_with_rotation"]  # fmt: skip
STEP, INTENSITY = 0.5, 0.05
PARTICLES, SEEDS = 500, 30
Z0, ETA, SD = -62.0, 1.4, 6.1
PRIOR_SD = np.array([1.0, 0.5, 1.0, 0.5])
PLACE = [0, 2]
MOVE = np.kron(np.eye(2), [[1.0, STEP], [0.0, 1.0]])
PROCESS = INTENSITY * np.kron(np.eye(2), [[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, STEP]])


def raw(path):
    """The rows of a CSV file, as texts."""
    with gzip.open(path, "rt", newline="") if path.suffix == ".gz" else path.open(newline="") as file:
        return list(csv.DictReader(file))


RECEIVERS = raw(BLE / "receivers.csv")
NAMES = [row["receiver"] for row in RECEIVERS]
PLACES = np.array([[float(row["x"]), float(row["y"])] for row in RECEIVERS])


def world(rows):
    """True places (K + 1, 2) and the last reading of each receiver in each step (K + 1, 12); NaN without one."""
    rows = sorted((row for row in rows if float(row["rssi"]) < 0.0), key=lambda row: float(row["time"]))
    times = np.array([float(row["time"]) for row in rows]) - float(rows[0]["time"])
    places = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    steps = math.floor(times[-1] / STEP)
    readings = np.full((steps + 1, len(NAMES)), np.nan)
    for time, row in zip(times, rows, strict=True):
        if (step := max(0, math.ceil(time / STEP - 1e-9))) <= steps:
            readings[step, NAMES.index(row["receiver"])] = float(row["rssi"])
    times, kept = np.unique(times, return_index=True)
    now = np.arange(steps + 1) * STEP
    return np.column_stack([np.interp(now, times, axis[kept]) for axis in places.T]), readings


def ekf(mean, readings, gains):
    """(K, 4) means: predict, then one joint update with all readings of the step, linearised at the prediction."""
    cov, means = np.diag(PRIOR_SD**2), []
    for row in readings[1:]:
        mean, cov = MOVE @ mean, MOVE @ cov @ MOVE.T + PROCESS
        heard = np.isfinite(row)
        apart = mean[PLACE] - PLACES[heard]
        squares = (apart**2).sum(axis=1)
        slopes = np.zeros((heard.sum(), 4))
        slopes[:, PLACE] = -10.0 * ETA / math.log(10.0) * apart / squares[:, None]
        errors = row[heard] - gains[heard] - Z0 + 5.0 * ETA * np.log10(squares)
        gain = np.linalg.solve(slopes @ cov @ slopes.T + SD**2 * np.eye(len(errors)), slopes @ cov).T
        mean, cov = mean + gain @ errors, (np.eye(4) - gain @ slopes) @ cov
        means.append(mean)
    return np.array(means)


def particle_filter(mean, readings, rng, count):
    """(K, 4) means of the bootstrap filter, which resamples systematically at every step."""
    cloud, means = mean + PRIOR_SD * rng.standard_normal((count, 4)), []
    root = np.linalg.cholesky(PROCESS)
    for row in readings[1:]:
        cloud = cloud @ MOVE.T + rng.standard_normal((count, 4)) @ root.T
        heard = np.isfinite(row)
        distances = np.hypot(*(cloud[:, None, PLACE] - PLACES[heard]).transpose(2, 0, 1))
        errors = row[heard] - Z0 + 10.0 * ETA * np.log10(distances)
        logs = -0.5 * (errors**2).sum(axis=1) / SD**2
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        means.append(weights @ cloud)
        drawn = np.searchsorted(np.cumsum(weights), (np.arange(count) + rng.random()) / count)
        cloud = cloud[np.minimum(drawn, count - 1)]
    return np.array(means)


def rmse(means, truth):
    return float(np.sqrt(((means[:, PLACE] - truth[1:]) ** 2).sum(axis=1).mean()))


def scenario(track, tracker, readings=None, **changes):
    """The scenario of a track with these constants; `readings`: another file of them."""
    truth, _ = WORLDS[track]
    path = str(BLE / f"{track}.csv.gz")
    law = {"kind": "rssi", "z0": Z0, "eta": ETA, "sd": SD, **changes.pop("law", {})}
    return {
        "name": track,
        "network": "none",
        "step": STEP,
        "duration": STEP * len(truth),
        "prior": {"mean": start(track).tolist(), "sd": PRIOR_SD.tolist()},
        "deploy": {"kind": "file", "path": str(BLE / "receivers.csv"), "columns": {"id": "receiver"}, "cover": False},
        "motion": {"kind": "recorded_track", "path": path, "q": INTENSITY, "skip_bad_rows": True},
        "sensor": {"kind": "recorded", "path": readings or path, "columns": {"node": "receiver", "reading": "rssi"},
                   "several": "last", "skip_bad_rows": True, "law": law},
        "tracker": tracker,
        **changes,
    }  # fmt: skip


WORLDS = {track: world(raw(BLE / f"{track}.csv.gz")) for track in TRACKS}
GAINS = np.array([0.0, 1.1, 1.8, -1.3, -1.5, 1.4, -7.2, 1.8, 1.2, -4.4, 5.9, 1.1])
"""dB, about what all tracks together give."""


def start(track):
    """The prior's mean: at rest at the true start."""
    (x, y), *_ = WORLDS[track][0].tolist()
    return np.array([x, 0.0, y, 0.0])


def estimates(text):
    """(K, 4) the estimates of a run of ours."""
    recorder = Memory({"estimates": True})
    wsnsim.experiment.simulate_run(text, recorder=recorder)
    return np.column_stack([recorder.table("estimates")[name] for name in ("px", "vx", "py", "vy")])


@pytest.mark.thorough(fast=["straight_04-gains"])
@pytest.mark.parametrize("gains", [None, GAINS], ids=["path loss", "gains"])
@pytest.mark.parametrize("track", TRACKS)
def test_the_extended_kalman_filter_is_that_of_the_raw_rows(track, gains):
    law = {} if gains is None else {"gains": gains.tolist()}
    ours = estimates(scenario(track, {"kind": "ekf"}, law=law))
    theirs = ekf(start(track), WORLDS[track][1], np.zeros(len(NAMES)) if gains is None else gains)
    assert ours.shape == theirs.shape and np.abs(ours - theirs).max() < 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize("track", first(1, TRACKS))
def test_the_particle_filter_is_as_good_as_one_of_the_raw_rows(track, tmp_path):
    truth, readings = WORLDS[track]
    text = scenario(track, {"kind": "pf", "particles": PARTICLES}, seed=1)
    wsnsim.run(text, replicates=SEEDS, out=tmp_path / "pf.h5")
    ours = np.median(wsnsim.read(tmp_path / "pf.h5", "runs")["rmse"])
    rng = np.random.default_rng(1)
    theirs = [rmse(particle_filter(start(track), readings, rng, PARTICLES), truth) for _ in range(SEEDS)]
    assert ours == pytest.approx(np.median(theirs), rel=0.05)


def changed(track, path, change):
    """A file with the rows of a track after a change of them; its path."""
    rows = raw(BLE / f"{track}.csv.gz")
    change(rows)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return str(path)


def stronger(number):
    """A change of rows: one reading is 9 dB higher."""

    def change(rows):
        rows[number]["rssi"] = str(float(rows[number]["rssi"]) + 9.0)

    return change


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", [{"kind": "ekf"}, {"kind": "pf", "particles": 50}], ids=["ekf", "pf"])
def test_after_one_changed_reading_results_part_first_at_its_step_and_node(tracker, tmp_path):
    track, number = "straight_04", 300
    row = raw(BLE / f"{track}.csv.gz")[number]
    other = changed(track, tmp_path / "other.csv", stronger(number))
    for name, path in (("a.h5", None), ("b.h5", other)):
        text = scenario(track, tracker, path, record={"readings": True})
        wsnsim.run(text, replicates=1, out=tmp_path / name)
    (run,) = differ(tmp_path / "a.h5", tmp_path / "b.h5").replicates
    step = math.ceil(float(row["time"]) / STEP - 1e-9)
    value = float(row["rssi"])
    node = NAMES.index(row["receiver"])
    assert run.reading == {"step": step, "target": 0, "node": node, "values": (value, value + 9.0)}
    assert run.truth and run.estimate["step"] == step


@pytest.mark.thorough
def test_in_a_network_too_results_part_first_at_the_step_and_node_of_a_changed_reading(tmp_path):
    track, number = "rectangular_with_rotation", 100
    row = raw(BLE / f"{track}.csv.gz")[number]
    other = changed(track, tmp_path / "other.csv", stronger(number))
    sets = ["duration=8 s", "record.readings=true"]
    for name, more in (("a.h5", []), ("b.h5", [f"sensor.path={other}"])):
        wsnsim.run(wsnsim.load("recorded_network", [*sets, *more]), out=tmp_path / name)
    (run,) = differ(tmp_path / "a.h5", tmp_path / "b.h5").replicates
    step = math.ceil(float(row["time"]) / STEP - 1e-9)
    assert (run.reading["step"], run.reading["node"]) == (step, NAMES.index(row["receiver"]))
    assert run.truth and (run.estimate is None or run.estimate["step"] >= step)


@pytest.mark.thorough
def test_in_the_network_readings_are_those_of_the_rows_and_no_more_reach_the_head(tmp_path):
    wsnsim.run(wsnsim.load("recorded_network", ["record.readings=true"]), out=tmp_path / "x.h5")
    taken, made = (wsnsim.read(tmp_path / "x.h5", table) for table in ("readings", "estimates"))
    readings = WORLDS["rectangular_with_rotation"][1]
    found = np.full_like(readings, np.nan)
    found[taken["step"], taken["node"]] = taken["reading"]
    assert np.array_equal(found, readings, equal_nan=True)
    heard = np.isfinite(readings[1:]).sum(axis=1)
    assert (made["readings"] <= heard).all() and 0.7 < made["readings"].sum() / heard.sum() < 1.0
    tracks = wsnsim.read(tmp_path / "x.h5", "tracks")
    assert tracks["delay"][0] < 0.1 and tracks["received"][0] == len(heard)


def swapped(pair, folder):
    """A file of receivers in which two have changed places."""
    rows = [dict(row) for row in RECEIVERS]
    for one, other in (pair, pair[::-1]):
        rows[one]["receiver"] = NAMES[other]
    path = folder / f"{pair[0]}_{pair[1]}.csv"
    path.write_text("\n".join(map(",".join, [rows[0], *(row.values() for row in rows)])) + "\n")
    return str(path)


@pytest.mark.thorough
@pytest.mark.parametrize("tracks", [TRACKS[:1], TRACKS], ids=len)
def test_swapping_any_two_receivers_changes_every_result_and_nearly_always_for_the_worse(tracks, tmp_path):
    """With the gains of the receivers; each pair, of six tracks every third, in a file of its own."""
    pairs = list(itertools.combinations(range(len(NAMES)), 2))[:: 3 if len(tracks) > 1 else 1]
    law = {"gains": GAINS.tolist()}
    texts = {track: scenario(track, {"kind": "ekf"}, law=law) for track in tracks}
    before = [wsnsim.experiment.simulate_run(text).run["rmse"] for text in texts.values()]
    after = []
    for pair in pairs:
        path = swapped(pair, tmp_path)
        moved = [{**text, "deploy": {**text["deploy"], "path": path}} for text in texts.values()]
        after.append([wsnsim.experiment.simulate_run(text).run["rmse"] for text in moved])
    assert np.shape(after) == (len(pairs), len(tracks)) and (np.array(after) != before).all()
    assert (np.mean(after, axis=1) > np.mean(before)).mean() >= (60 / 66 if len(tracks) > 1 else 50 / 66)
