"""Each way in which a recording cannot be meant leads to its own note, and a clean recording to none."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.analysis import recording_notes
from wsnsim.scenario import build, load

PLACES = np.array([(0.0, 0.0), (42.0, 3.0), (37.0, 31.0), (-4.0, 27.0), (19.0, 44.0)])
STEPS = 120
LAWS: dict[str, dict[str, Any]] = {
    "range": {"kind": "range", "sd": 0.3},
    "bearing": {"kind": "bearing", "sd": 0.03, "reach": 200.0},
    "rssi": {"kind": "rssi", "z0": -45.0, "eta": 2.2, "sd": 2.0},
}


def path_at(times: np.ndarray) -> np.ndarray:
    return np.column_stack([20 + 13 * np.cos(times / 11), 17 + 12 * np.sin(times / 7)])


def expected(kind: str, points: np.ndarray, places: np.ndarray) -> np.ndarray:
    dx, dy = (points - places).T
    distances = np.hypot(dx, dy)
    of = {"range": distances, "bearing": np.arctan2(dy, dx), "rssi": -45.0 - 22.0 * np.log10(distances)}
    return of[kind]


class Recording:
    """A recording of five nodes, one reading a second each, at times of their own."""

    def __init__(self, kind: str, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.kind, self.nodes = kind, np.tile(np.arange(len(PLACES)), STEPS)
        self.times = np.repeat(np.arange(STEPS), len(PLACES)) + rng.uniform(0.0, 0.9, len(self.nodes))
        noise = LAWS[kind]["sd"] * rng.standard_normal(len(self.nodes))
        self.readings = expected(kind, path_at(self.times), PLACES[self.nodes]) + noise

    def setup(self, folder: Path) -> Any:
        readings = self.readings
        if self.kind == "bearing":
            readings = (readings + math.pi) % (2 * math.pi) - math.pi
        names = np.array(list("abcde"))
        grid = np.arange(0.0, STEPS + 1.0, 0.5)
        rows = zip(self.times.tolist(), names[self.nodes].tolist(), readings.tolist(), strict=True)
        tables = {
            "r.csv": ("time,node,reading", rows),
            "t.csv": ("time,x,y", ((t, *point) for t, point in zip(grid, path_at(grid).tolist(), strict=True))),
            "n.csv": ("id,x,y", ((name, *place) for name, place in zip("abcde", PLACES.tolist(), strict=True))),
        }
        for name, (header, lines) in tables.items():
            (folder / name).write_text("\n".join([header, *(",".join(map(str, line)) for line in lines)]) + "\n")
        return build(load(self.scenario(folder)))

    def scenario(self, folder: Path) -> dict[str, Any]:
        return {
            "name": "r", "network": "none", "seed": 1, "duration": float(STEPS), "step": 1.0,
            "prior": {"sd": [1.0, 1.0, 1.0, 1.0]}, "tracker": {"kind": "ekf"},
            "deploy": {"kind": "file", "path": str(folder / "n.csv"), "fit": True, "margin": 5.0, "cover": False},
            "motion": {"kind": "recorded_track", "path": str(folder / "t.csv"), "q": 0.1, "time_origin": 0.0},
            "sensor": {"kind": "recorded", "path": str(folder / "r.csv"), "law": LAWS[self.kind], "time_origin": 0.0},
        }  # fmt: skip

    def notes(self, folder: Path) -> list[str]:
        return list(recording_notes.unexplained_readings(self.setup(folder)))


SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(1, 20))]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", LAWS)
def test_a_clean_recording_has_no_note(tmp_path: Path, kind: str, seed: int) -> None:
    assert Recording(kind, seed).notes(tmp_path) == []


def in_millimetres(made: Recording) -> None:
    made.readings *= 1000.0


def clockwise_from_north(made: Recording) -> None:
    made.readings = math.pi / 2 - made.readings


def swapped(made: Recording) -> None:
    made.nodes = np.array([1, 0, 2, 4, 3])[made.nodes]


def biased(made: Recording) -> None:
    made.readings += 6.0 * LAWS[made.kind]["sd"] * np.array([1.0, -0.8, 0.3, -1.3, 0.9])[made.nodes]


def offset(made: Recording) -> None:
    made.readings += 8.0 * LAWS[made.kind]["sd"]


def late(made: Recording) -> None:
    made.times += 8.0
    kept = made.times < STEPS - 1
    made.times, made.nodes, made.readings = (each[kept] for each in (made.times, made.nodes, made.readings))


def clipped(made: Recording) -> None:
    made.readings = np.maximum(made.readings, np.quantile(made.readings, 0.1))


def missing(made: Recording) -> None:
    made.readings[::9] = -100.0 if made.kind == "rssi" else 100.0 if made.kind == "range" else 6.0


def ten_times(made: Recording) -> None:
    made.readings *= 10.0


def struck(made: Recording) -> None:
    made.readings[7] += 60.0 * LAWS[made.kind]["sd"] * (1.0 if made.kind == "range" else -1.0)


CORRUPTIONS = [
    ("range", in_millimetres, "in mm"), ("range", ten_times, "10 times as large"),
    *((kind, struck, "1 outlier, such as ") for kind in ("range", "rssi")),
     ("bearing", clockwise_from_north, "clockwise from north"),
    *((kind, swapped, "a of b, b of a, d of e, e of d") for kind in LAWS),
    *((kind, biased, "a constant of each node, a ") for kind in LAWS),
    *((kind, offset, "of all nodes") for kind in ("range", "rssi")),
    *((kind, late, "s earlier: set time_origin") for kind in ("range", "bearing", "rssi")),
    *((kind, clipped, "the least") for kind in LAWS),
    ("range", missing, "are 100, the greatest"), ("rssi", missing, "are -100, the least"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "corrupt", "said"), CORRUPTIONS)
def test_each_corruption_leads_to_exactly_its_note(tmp_path: Path, kind: str, corrupt: Any, said: str) -> None:
    for seed in range(2):
        made = Recording(kind, seed)
        corrupt(made)
        (note,) = made.notes(tmp_path)
        assert said in note
        if corrupt is late:
            assert float(note.split(" s earlier")[0].split()[-1]) == pytest.approx(8.0, abs=0.5)


def test_residuals_are_stated_with_their_nodes(tmp_path: Path) -> None:
    made = Recording("range", 3)
    made.readings += np.where(made.nodes == 2, 1.0, 0.0)
    (said,) = recording_notes.residuals(made.setup(tmp_path))
    assert said.startswith("595 readings minus law at the trajectory: median 0.1")
    assert "(law: 0.3 m), largest 1.96 m (c)" in said and said.endswith("to 1.01 m (c)")


def test_without_a_recorded_trajectory_readings_are_held_against_the_estimates_after_the_run(tmp_path: Path) -> None:
    made = Recording("range", 3)
    setup, recorded = made.setup(tmp_path), made.scenario(tmp_path)
    assert list(recording_notes.residuals(setup, str(wsnsim.run(recorded).save(tmp_path / "track.h5")))) == []
    points = [[t, *place] for t, place in zip(range(0, STEPS + 1, 4), path_at(np.arange(0, STEPS + 1, 4)), strict=True)]
    scenario = recorded | {"motion": {"kind": "waypoints", "points": points, "q": 0.1}}
    result = wsnsim.run(scenario).save(tmp_path / "run.h5")
    (said,) = recording_notes.residuals(build(load(scenario)), result)
    estimates = wsnsim.read(result, "estimates")
    inside = (made.times >= estimates["time"].min()) & (made.times <= estimates["time"].max())
    there = np.column_stack(
        [np.interp(made.times[inside], estimates["time"], estimates[axis]) for axis in ("px", "py")]
    )
    off = made.readings[inside] - expected("range", there, PLACES[made.nodes[inside]])
    begin = f"{inside.sum()} readings minus law at the estimates of run 0, which follow the readings and are no truth"
    assert said.startswith(f"{begin}: median {np.median(off):.3g} m, ")
    assert f"largest {off[np.abs(off).argmax()]:.3g} m (" in said


def with_law(made: Recording, law: dict[str, Any], folder: Path) -> tuple[list[str], str]:
    """Notes and residuals of readings under another law."""
    made.setup(folder)
    scenario = made.scenario(folder) | {"tracker": {"kind": "central_pf"}}
    scenario["sensor"] |= {"law": law, "several": "last"}
    setup = build(load(scenario))
    (said,) = recording_notes.residuals(setup)
    return list(recording_notes.unexplained_readings(setup)), said


BINARY = {"kind": "binary", "radius": 25.0, "edge": 2.0, "reach": 100.0}
CELLS = {"kind": "quantised", "bits": 3, "law": LAWS["range"]}


@pytest.mark.parametrize("law", [BINARY, CELLS])
def test_readings_in_cells_are_held_against_the_probability_of_cells(tmp_path: Path, law: dict[str, Any]) -> None:
    made = Recording("range", 0)
    ranges = made.readings
    made.readings = np.floor(ranges / 7.5) * 7.5 + 3.75 if law is CELLS else (ranges < 25.0).astype(float)
    notes, said = with_law(made, law, tmp_path)
    assert notes == [] and int(said.split()[0]) < 40, "of 595, 1 in 100 of a detection and 1 in 60 of a Gaussian"
    assert said.endswith("of 595 readings are in cells that are improbable by the law at the trajectory")
    made.readings = np.random.default_rng(1).permutation(made.readings)
    (note,), said = with_law(made, law, tmp_path)
    assert "in cells that are improbable by the law: names" in note and int(said.split()[0]) > 100
    made.readings = ranges
    (note,), _ = with_law(made, law, tmp_path)
    assert "595 of 595 readings are none of the values of cells" in note


def test_readings_with_blocked_lines_of_sight_are_held_against_the_mean_of_their_law(tmp_path: Path) -> None:
    made, rng = Recording("range", 0), np.random.default_rng(2)
    blocked = rng.random(len(made.readings)) < 0.5
    made.readings += blocked * rng.normal(5.0, 2.0, len(blocked))
    notes, said = with_law(made, LAWS["range"] | {"blocked": 0.5, "detour": 5.0, "detour_sd": 2.0}, tmp_path)
    assert notes == [] and "(law: 2.89 m)" in said, "sqrt(0.3² + 0.5 2² + 0.25 5²)"
    assert abs(float(said.split("median ")[1].split()[0])) < 2.5


def test_heavy_tails_have_the_standard_deviation_of_their_law(tmp_path: Path) -> None:
    _, said = with_law(Recording("rssi", 0), LAWS["rssi"] | {"noise": "student_t", "dof": 3.0}, tmp_path)
    assert "(law: 2 dB)" in said


def test_times_of_arrival_are_held_against_their_law_without_the_times_of_emission(tmp_path: Path) -> None:
    made = Recording("range", 0)
    made.times = np.floor(made.times)
    made.readings += 50.0 * np.random.default_rng(3).uniform(1.0, 5.0, STEPS)[made.times.astype(int)]
    still = {"kind": "tdoa", "sd": 0.3}
    notes, said = with_law(made, still, tmp_path)
    assert notes == [] and said.startswith("600 readings minus law") and "(law: 0.268 m)" in said
    made.readings *= 1000.0
    assert with_law(made, still, tmp_path)[0] == ["sensor: readings seem to be in mm: convert them"]


def test_where_nothing_explains_readings_it_is_said_that_they_do_not_follow_the_law(tmp_path: Path) -> None:
    made = Recording("range", 0)
    made.readings = np.random.default_rng(0).uniform(0.0, 40.0, len(made.readings))
    assert made.notes(tmp_path) == [
        "sensor: readings do not follow the law: units, names, targets, times, values of the law?"
    ]


@pytest.mark.parametrize(("late", "said"), [(0.0, []), (0.03, ["add 0.03 s to time_origin"]), (0.5, [])])
def test_readings_just_after_a_step_are_said_to_share_the_next_one(
    late: float, said: list[str], tmp_path: Path
) -> None:
    """Every other round of readings comes late."""
    made = Recording("range", 0)
    made.times = np.floor(made.times) + late * (np.floor(made.times) % 2)
    found = list(recording_notes.late_readings(made.setup(tmp_path)))
    assert len(found) == len(said) and all(words in note for words, note in zip(said, found, strict=True)), found


def test_of_many_readings_some_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_notes, "MOST_READINGS", 100)
    made = Recording("range", 0)
    in_millimetres(made)
    setup = made.setup(tmp_path)
    assert next(recording_notes.residuals(setup)).startswith("100 sampled readings")
    assert list(recording_notes.unexplained_readings(setup)) == ["sensor: readings seem to be in mm: convert them"]


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (slice(None), None),
        (slice(40, None), "1 gap, the first from 0 s to 20 s"),
        (slice(0, 100), "1 gap, the first from 49.5 s to 119 s"),
        (np.r_[0:40, 80:120, 200:241], "2 gaps, the first from 19.5 s to 40 s"),
    ],
)
def test_it_is_said_where_a_recorded_target_is_absent(tmp_path: Path, kept: Any, said: str | None) -> None:
    made = Recording("range", 0)
    made.setup(tmp_path)
    header, *rows = (tmp_path / "t.csv").read_text().splitlines()
    rows = np.array(rows)[kept].tolist()
    (tmp_path / "t.csv").write_text("\n".join([header, *rows]) + "\n")
    found = list(recording_notes.absent_movers(build(load(made.scenario(tmp_path)))))
    assert [note.split("has no row: ")[1] for note in found] == ([said] if said else [])


@pytest.mark.parametrize(
    ("name", "value_of", "noted"),
    [
        ("tag", lambda row, node: "AB"[row // 5 % 2], True),
        ("mac", lambda row, node: f"00:{node}", False),
        ("row_id", lambda row, node: row, False),
        ("rate", lambda row, node: row % 2, False),
    ],
)
def test_a_column_that_may_name_targets_and_is_not_read_is_noted(
    tmp_path: Path, name: str, value_of: Any, noted: bool
) -> None:
    made = Recording("range", 0)
    scenario, _ = made.scenario(tmp_path), made.setup(tmp_path)
    header, *rows = (tmp_path / "r.csv").read_text().splitlines()
    cells = [f"{row},{value_of(number, made.nodes[number])}" for number, row in enumerate(rows)]
    (tmp_path / "r.csv").write_text("\n".join([f"{header},{name}", *cells]) + "\n")
    found = list(recording_notes.unread_identifiers(build(load(scenario))))
    assert [f"'tag' of {tmp_path}/r.csv (A, B) is not read" in note for note in found] == [True] * noted
