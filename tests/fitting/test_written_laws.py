"""What a fit writes is what filters believe: it passes the check, and filters are consistent with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import wsnsim
from tests.helpers.recorded_walks import Walks
from wsnsim.base.errors import RunError, UsageError
from wsnsim.cli import main
from wsnsim.fitting import Fit
from wsnsim.scenario import load

PLACES = np.array([(0.0, 0.0, 3.0), (20.0, 0.0, 2.5), (20.0, 15.0, 3.0), (0.0, 15.0, 2.0), (10.0, 7.0, 4.0)])
DT = 0.5


class Recording(NamedTuple):
    """A law to be recorded: white noise, shadowing over 2 m, a constant of each node, heights, times this distance."""

    law: str = "rssi"
    sd: float = 1.5
    shadowing: float = 0.0
    dof: float = np.inf
    spread: float = 0.0
    heights: bool = False
    scale: float = 1.0
    eta: float = 2.2
    steps: int = 300

    def write(self, folder: Path, seed: int = 1) -> tuple[str, str]:
        """The file of readings, which has the trajectory, and that of the nodes."""
        rng = np.random.default_rng(seed)
        times = np.arange(self.steps) * DT
        columns = 10 + 8 * np.cos(times / 13), 7 + 6 * np.sin(times / 9), np.full(self.steps, 1.0)
        points, places = self.scale * np.column_stack(columns), self.scale * PLACES
        apart = (points[:, None] - places)[:, :, : 3 if self.heights else 2]
        distances = np.sqrt((apart**2).sum(axis=2))
        process = rng.normal(0.0, 1.0, distances.shape)
        along = np.exp(-np.hypot(*np.diff(points[:, :2], axis=0).T) / 2.0)
        for k, rho in enumerate(along, start=1):
            process[k] = rho * process[k - 1] + np.sqrt(1 - rho**2) * process[k]
        normal = np.isinf(self.dof)
        white = rng.normal(size=distances.shape) if normal else rng.standard_t(self.dof, distances.shape)
        expected = distances if self.law == "range" else -45 - 10 * self.eta * np.log10(np.maximum(distances, 0.05))
        readings = expected + rng.normal(0.0, self.spread, len(places)) + self.shadowing * process
        readings = readings + self.sd * white * (1.0 if normal else np.sqrt(1 - 2 / self.dof))
        z = ",z" if self.heights else ""
        rows = [
            f"{times[k]},{node},{readings[k, i]:.6f}," + ",".join(f"{v:.4f}" for v in points[k][: 3 if z else 2])
            for k in range(self.steps) for i, node in enumerate("abcde")
        ]  # fmt: skip
        (folder / "r.csv").write_text("\n".join([f"time,node,reading,x,y{z}", *rows]) + "\n")
        nodes = [
            f"{node},{','.join(map(str, place[: 3 if z else 2]))}" for node, place in zip("abcde", places, strict=True)
        ]
        (folder / "nodes.csv").write_text("\n".join([f"id,x,y{z}", *nodes]) + "\n")
        return str(folder / "r.csv"), str(folder / "nodes.csv")


RECORDINGS = {
    "rssi": (Recording(), {"gains": False}),
    "rssi with gains in space": (Recording(spread=4.0, heights=True), {}),
    "rssi with shadowing": (Recording(shadowing=4.0), {"gains": False}),
    "rssi with shadowing and heavy tails": (Recording(shadowing=2.0, sd=3.0, dof=4.0), {"noise": "student_t"}),
    "rssi in the plane of recordings in space": (Recording(heights=True), {"heights": False}),
    "range": (Recording("range", sd=0.05), {"gains": False}),
    "range with biases in space": (Recording("range", sd=0.05, spread=0.5, heights=True), {}),
    "range with shadowing": (Recording("range", sd=0.1, shadowing=0.3), {}),
    "range with heavy tails": (Recording("range", sd=0.3, dof=4.0), {}),
    "range in the plane of recordings in space": (Recording("range", sd=0.5, heights=True), {"heights": False}),
    "range beyond 400 m": (Recording("range", sd=2.0, scale=50.0), {}),
}  # fmt: skip


def scenario(folder: Path, found: Fit, tracker: str = "ekf", scale: float = 1.0) -> Path:
    """The file of a scenario that extends a written law, and judges it on the readings that were fitted."""
    recorded = found.recorded_sensor(folder / "r.csv", folder, in_sample=True)
    (folder / "law.yaml").write_text(found.yaml(recorded))
    file = folder / "run.yaml"
    file.write_text(
        f"extends: law.yaml\nname: run\nnetwork: none\nseed: 1\nduration: 149 s\nstep: {DT} s\n"
        f"prior: {{sd: [{scale}, {scale / 2}, {scale}, {scale / 2}]}}\n"
        "deploy: {kind: file, path: nodes.csv, fit: true, margin: 2 m, cover: false}\n"
        f"motion: {{kind: recorded_track, path: r.csv, q: {0.1 * scale**2}}}\ntracker: {{kind: {tracker}}}\n"
    )
    return file


@pytest.mark.thorough(fast=["rssi with shadowing", "range with biases in space"])
@pytest.mark.parametrize("name", RECORDINGS)
def test_a_filter_believes_the_law_that_was_fitted(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, options = RECORDINGS[name]
    file, nodes = recording.write(tmp_path)
    found = wsnsim.fit(file, nodes, law=recording.law, **options)
    run = scenario(tmp_path, found, scale=recording.scale)
    assert main(["check", str(run)]) == 0, capsys.readouterr().err
    nis = wsnsim.run(str(run)).estimates["nis"]
    assert 0.5 < nis.mean() / 5.0 < 2.0


@pytest.mark.thorough(fast=["range with shadowing", "rssi with shadowing"])
@pytest.mark.parametrize("name", RECORDINGS)
def test_the_interval_beside_a_written_value_holds_it(name: str, tmp_path: Path) -> None:
    recording, options = RECORDINGS[name]
    file, nodes = recording.write(tmp_path)
    found = wsnsim.fit(file, nodes, law=recording.law, **options)
    recorded = found.recorded_sensor(file, tmp_path, in_sample=True)
    marked = [
        line.split() for text in (found.yaml(), found.yaml(recorded)) for line in text.splitlines() if "95 %" in line
    ]
    assert {row[0] for row in marked} >= {"sd:"}
    for _, value, *_, low, _, high in ([word for word in row if word != "(approximate)"] for row in marked):
        assert float(low) <= float(value) <= float(high)


def test_a_law_that_is_sampled_has_filters_that_take_its_shadowing_into_account(tmp_path: Path) -> None:
    file, nodes = Recording(shadowing=4.0, steps=150).write(tmp_path)
    found = wsnsim.fit(file, nodes, gains=False)
    (tmp_path / "law.yaml").write_text(found.yaml())
    (tmp_path / "run.yaml").write_text("extends: law.yaml\ntracker: {kind: ekf}\nname: run\nnetwork: none\n"
        "deploy: {kind: file, path: nodes.csv, fit: true, margin: 2 m, cover: false}\nduration: 4 s\nstep: 1 s\n"
        "motion: {kind: waypoints, points: [[0, 1, 1], [9, 5, 5]]}\n")  # fmt: skip
    read: Any = load(str(tmp_path / "run.yaml"))
    assert read.tracker.kind == "ekf" and read.tracker.assumes.inflate
    assert read.sensor.shadowing == found.sensor["shadowing"] > 0.0
    assert found.law["sd"] == pytest.approx(np.hypot(found.sensor["sd"], found.sensor["shadowing"]), rel=1e-5)


def test_what_can_hardly_be_meant_is_said_and_no_law_is_written_that_a_scenario_refuses(tmp_path: Path) -> None:
    file, nodes = Recording(eta=-2.0).write(tmp_path)
    found = wsnsim.fit(file, nodes, gains=False)
    assert "Implausible: strength grows with distance" in found.text()
    for recorded in (None, found.recorded_sensor(file, tmp_path, in_sample=True)):
        with pytest.raises(RunError, match=r"No scenario can have this law: .*eta"):
            found.yaml(recorded)
    exact = [f"{k},{node},{k},{k},0" for k in range(1, 100) for node in "ab"]
    Path(nodes).write_text("id,x,y\na,0,0\nb,0,0\n")
    Path(file).write_text("\n".join(["time,node,reading,x,y", *exact]))
    with pytest.raises(RunError, match="follow the law to 1e-06 m"):
        wsnsim.fit(file, nodes, law="range")
    with pytest.raises(UsageError, match="the sensor `range` has normal noise alone"):
        wsnsim.fit(file, nodes, law="range", noise="student_t")


def test_ranges_in_the_plane_of_nodes_above_the_target_are_doubted(tmp_path: Path) -> None:
    file, nodes = Recording("range", sd=0.01, heights=True).write(tmp_path)
    assert (
        "Implausible: the white part of the noise is nearly zero"
        in wsnsim.fit(file, nodes, law="range", heights=False).text()
    )
    assert "Implausible" not in wsnsim.fit(file, nodes, law="range").text()


def test_a_target_whose_height_changes_is_said_to_have_one_in_filters(tmp_path: Path) -> None:
    file, nodes = Recording("range", sd=0.01, heights=True, steps=120).write(tmp_path)
    rows = [line.split(",") for line in Path(file).read_text().splitlines()]
    lifted = [rows[0], *([*row[:5], f"{1.0 + 0.005 * k % 2:.3f}"] for k, row in enumerate(rows[1:]))]
    Path(file).write_text("\n".join(map(",".join, lifted)))
    assert "Filters take the target's height as 1" in wsnsim.fit(file, nodes, law="range", gains=False).text()


def test_nodes_and_readings_may_name_the_same_column_differently(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, nodes = Recording().write(tmp_path)
    wanted = wsnsim.fit(file, nodes).sensor
    Path(file).write_text(Path(file).read_text().replace("x,y", "tx,ty", 1).replace("reading", "level", 1))
    renamed = {"x": "tx", "y": "ty", "reading": "level"}
    assert wsnsim.fit(file, nodes, columns=renamed).sensor | {"fitted_on": 0} == wanted | {"fitted_on": 0}
    Path(nodes).write_text(Path(nodes).read_text().replace("id,x", "anchor,x", 1))
    given = [word for ours, theirs in renamed.items() for word in ("--column", f"{ours}={theirs}")]
    assert main(["fit", file, "--nodes", nodes, *given, "--node-column", "id=anchor"]) == 0
    capsys.readouterr()
    assert main(["fit", file, "--nodes", nodes, *given, "--column", "id=anchor"]) == 2
    assert "columns: unknown column 'id'" in capsys.readouterr().err


def test_a_trajectory_may_call_time_as_usual_where_readings_do_not(tmp_path: Path) -> None:
    (file, *_), nodes = Walks(tracks=1).write(tmp_path, 1)
    track = tmp_path / "track.csv"
    track.write_text(Path(file).read_text())
    wanted = wsnsim.fit(file, nodes).values
    Path(file).write_text(Path(file).read_text().replace("time", "at", 1))
    assert wsnsim.fit(file, nodes, tracks=track, columns={"time": "at"}).values == wanted
