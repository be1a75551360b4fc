"""A campaign read and compared: result files written by hand, every figure reckoned by hand. Nothing is simulated."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from wsnsim.analysis import campaigns, comparison, comparison_text, conclusions, frames, statistics
from wsnsim.analysis.comparison_text import answer
from wsnsim.analysis.phrases import wrapped
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import TABLES
from wsnsim.cli import main
from wsnsim.recording import ResultFile
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk

NAN = float("nan")
KIND, SIZE = "tracker.kind", "tracker.particles"
RMSE = {
    ("pf", 100): [5.0, 6.0, 7.0, 8.0, 9.0, 10.0],
    ("pf", 200): [4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    ("ekf", 100): [6.0, 5.0, 8.0, NAN, 11.0, 12.0],
    ("ekf", 200): [4.0, 5.0, 7.0, 8.0, 9.0, 10.0],
}
ENERGY = {("pf", 100): 2.0, ("pf", 200): 4.0, ("ekf", 100): 1.0, ("ekf", 200): 5.0}
Point = tuple[Mapping[str, Any], str, Mapping[str, Sequence[float]]]


class Place:
    """Makes campaigns' folders."""

    def __init__(self, path: Path, rows_of: Callable[..., dict], states: Any) -> None:
        self.path, self._rows_of, self._states = path, rows_of, states

    def write(self, folder: Folder, point: str, numbers: Sequence[int], **columns: Any) -> None:
        """A result file of these replicates, with random rows but for some columns of `runs`."""
        place = folder.batch(point, numbers[0], numbers[-1])
        place.parent.mkdir(parents=True, exist_ok=True)
        lost = np.asarray(columns.get("lost", 0)).astype(np.int64)
        rows = self._rows_of("runs", len(numbers)) | {"status": 0, "replicate": list(numbers), "losses": lost}
        rows |= {"lost_window": 4.0, "lost_limit": 20.0} | columns
        steps = self._rows_of("estimates", 2 * len(numbers)) | {"replicate": np.repeat(numbers, 2)}
        with ResultFile(place, self._states, {"runs": True, "estimates": True}) as file:
            file.write("runs", rows)
            file.write("estimates", steps)

    def campaign(self, points: Sequence[Point], **about: Any) -> Folder:
        """A campaign of points (settings, world, columns of `runs`), with a replicate for each value."""
        folder, keys = Folder(self.path / "campaign"), {}
        on_disk = []
        for i, (settings, world, columns) in enumerate(points):
            keys |= dict.fromkeys(settings)
            count = len(columns["rmse"])
            on_disk.append(PointOnDisk(f"p{i}", settings, world, max(count, 1)))
            if count:
                self.write(folder, f"p{i}", range(count), **{"lost": 0, "energy": 1.0} | columns)
        folder.write_manifest(
            Manifest(**{"name": "hand", "keys": tuple(keys), "points": tuple(on_disk), "block": 5,
                        "wsnsim_version": "0"} | about)
        )  # fmt: skip
        return folder


@pytest.fixture
def place(tmp_path: Path, rows_of: Any, states: Any) -> Place:
    return Place(tmp_path, rows_of, states)


def four(place: Place, lose: bool = False, **about: Any) -> Folder:
    """Two trackers at two numbers of particles; they lose the runs of the greatest errors if `lose`."""
    points = [
        ({KIND: kind, SIZE: size}, "w", {
            "rmse": rmse, "energy": ENERGY[kind, size] * np.arange(1, 7), "lost": (np.array(rmse) > 8.5) & lose,
        })
        for (kind, size), rmse in RMSE.items()
    ]  # fmt: skip
    return place.campaign(points, **about)


@pytest.mark.thorough
def test_every_figure_of_a_point_is_that_reckoned_by_hand(place: Place) -> None:
    table = comparison.compare(four(place, lose=True), by=[KIND]).table
    assert not table["front"].any()  # all lose more than a twentieth of their runs
    assert table["point"].tolist() == [0, 1, 2, 3]
    assert table[KIND].tolist() == ["pf", "pf", "ekf", "ekf"]
    assert table[SIZE].tolist() == [100, 200, 100, 200]
    assert table["replicates"].tolist() == [6, 6, 6, 6]
    assert table["known"].tolist() == [6, 6, 5, 6]
    assert table["median"].tolist() == [7.5, 6.5, 8.0, 7.5]
    assert table["mean"].tolist() == pytest.approx([7.5, 6.5, 8.4, 43 / 6])
    assert table["lost_fraction"].tolist() == pytest.approx([2 / 6, 1 / 6, 2 / 6, 2 / 6])
    assert table["energy"].tolist() == [7.0, 14.0, 3.5, 17.5]
    for row, ((kind, size), rmse) in zip(table.to_dict("records"), RMSE.items(), strict=True):
        rates = sorted(e / (ENERGY[kind, size] * (i + 1)) for i, e in enumerate(rmse) if not math.isnan(e))
        assert row["error_per_joule"] == pytest.approx(np.median(rates))
        assert (row["median_low"], row["median_high"]) == statistics.median(np.array(rmse))[1:3]
        assert (row["mean_low"], row["mean_high"]) == statistics.mean(np.array(rmse))[1:3]
        share = statistics.share(np.array(rmse) > 8.5)
        assert (row["lost_fraction_low"], row["lost_fraction_high"]) == (share.low, share.high)
        for name in ("median", "mean", "lost_fraction", "energy", "error_per_joule"):
            assert row[f"{name}_low"] <= row[name] <= row[f"{name}_high"]


@pytest.mark.thorough
def test_trackers_are_compared_within_each_value_of_the_other_key(place: Place) -> None:
    found = comparison.compare(four(place), by=[KIND])
    table = found.table
    np.testing.assert_array_equal(table["difference"], [NAN, NAN, 1.0, 1.0])
    np.testing.assert_array_equal(table["pairs"], [NAN, NAN, 5.0, 6.0])
    # differences 1, -1, 1, 2, 2: ranks 2, 2, 2, 4.5, 4.5, of which 13 for and 2 against; then 0, 0, 1, 1, 1, 1
    np.testing.assert_allclose(table["effect"], [NAN, NAN, 11 / 15, 1.0])
    np.testing.assert_allclose(table["p"], [NAN, NAN, 2 * 4 / 32, 2 / 16])
    assert table["difference_low"][3] <= 1.0 <= table["difference_high"][3]
    # a group a number of particles: 100: (7.5, 7) and (8, 3.5);  200: (6.5, 14) and (7.5, 17.5)
    assert table["front"].tolist() == [True, True, True, False]
    assert (found.by, found.unpaired, found.metric, found.keys) == ((KIND,), "", "rmse", (KIND, SIZE))


@pytest.mark.thorough
def test_by_the_other_key_the_other_pairs_are_compared(place: Place) -> None:
    table = comparison.compare(four(place), by=[SIZE]).table
    np.testing.assert_array_equal(table["difference"], [NAN, -1.0, NAN, -2.0])
    np.testing.assert_array_equal(table["effect"][1], -1.0)


@pytest.mark.thorough
def test_by_both_keys_all_are_compared_with_the_first(place: Place) -> None:
    table = comparison.compare(four(place), by=[KIND, SIZE]).table
    np.testing.assert_array_equal(table["difference"], [NAN, -1.0, 1.0, 0.0])
    assert table["front"].tolist() == [True, True, True, False]


@pytest.mark.thorough
def test_without_a_key_to_compare_by_there_is_no_difference_and_one_front(place: Place) -> None:
    found = comparison.compare(four(place))
    assert found.by == ()
    assert "difference" not in found.table
    assert found.table["front"].tolist() == [True, True, True, False]


@pytest.mark.thorough
def test_a_campaign_says_itself_what_it_compares_and_with_whom(place: Place) -> None:
    found = comparison.compare(four(place, by=(KIND,), baseline="ekf"))
    np.testing.assert_array_equal(found.table["difference"], [-1.0, -1.0, NAN, NAN])
    asked = comparison.compare(place.path / "campaign", by=[SIZE])
    np.testing.assert_array_equal(asked.table["difference"], [NAN, -1.0, NAN, -2.0])


@pytest.mark.thorough
def test_a_sweep_over_one_key_is_compared_by_it(place: Place) -> None:
    points: list[Point] = [({SIZE: n}, "w", {"rmse": [float(n)] * 6}) for n in (1, 2, 4)]
    found = comparison.compare(place.campaign(points))
    assert found.by == (SIZE,)
    np.testing.assert_array_equal(found.table["difference"], [NAN, 1.0, 3.0])
    named = comparison.compare(place.campaign(points), baseline="4")
    np.testing.assert_array_equal(named.table["difference"], [-3.0, -2.0, NAN])


def test_points_that_gave_the_same_runs_are_named_whatever_time_they_took(place: Place) -> None:
    rmse = {100: [1.0, 2.0], 200: [3.0, 2.0], 300: [1.0, 2.0]}
    points = [({SIZE: size}, "w", {"rmse": each, "cpu_seconds": [size] * 2}) for size, each in rmse.items()]
    found = comparison.compare(place.campaign(points[:2]))
    assert found.same == "" and "no effect" not in comparison_text.text(found)
    found = comparison.compare(place.campaign(points))
    assert found.same == "the same runs, so that tracker.particles had no effect there: 100 | 300"
    assert found.same in comparison_text.text(found) and comparison.as_json(found)["same"] == found.same


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        ({"sensor": {"kind": "recorded"}, "motion": {"kind": "recorded_track"}}, "recorded readings and trajectory"),
        ({"targets": [{"kind": "recorded_track"}, {"kind": "circle"}]}, "recorded trajectories"),
        ({"sensor": {"kind": "rssi"}, "link": {"kind": "recorded"}}, "recorded links"),
        ({"sensor": {"kind": "rssi"}, "motion": {"kind": "circle"}, "link": {"kind": "disk"}}, ""),
    ],
)
def test_runs_that_replay_one_recording_say_nothing_of_others(place: Place, scenario: Any, said: str) -> None:
    folder = four(place)
    for point in folder.manifest().points:
        folder.write_scenario(point.id, json.dumps(scenario))
    found = comparison.compare(folder, by=[KIND])
    note = f"all runs replay the same {said} and differ in what is sampled beside them alone: p-values and intervals"
    assert found.replayed.startswith(note) if said else found.replayed == ""
    assert comparison.as_json(found)["replayed"] == found.replayed and found.replayed in unwrapped(found)


def unwrapped(found: comparison.Comparison) -> str:
    """The text in one line."""
    return " ".join(comparison_text.text(found).split())


def test_the_baseline_is_found_where_points_have_no_results_yet(place: Place) -> None:
    folder = place.campaign([({KIND: kind}, "w", {"rmse": rmse}) for kind, rmse in (
        ("a", []), ("b", [1.0] * 5), ("c", [3.0] * 5),
    )])  # fmt: skip
    table = comparison.compare(folder, baseline="c").table
    assert table["point"].tolist() == [1, 2]
    np.testing.assert_array_equal(table["difference"], [-2.0, NAN])
    first = comparison.compare(folder)
    assert first.table["difference"].isna().all() and first.unpaired == "the baseline 'a' has no results"
    assert comparison.compare(folder, baseline="a").table["difference"].isna().all()


def test_points_of_different_worlds_are_no_pairs_and_the_reason_is_said(place: Place) -> None:
    folder = place.campaign([
        ({"seed": 1}, "one", {"rmse": [1.0] * 5}),
        ({"seed": 2}, "other", {"rmse": [2.0] * 5}),
    ])  # fmt: skip
    found = comparison.compare(folder)
    assert found.table["difference"].isna().all()
    assert found.unpaired.startswith("2 and 1 differ in seed, deployment, motion, sensor, prior")
    assert found.unpaired in unwrapped(found)


def test_replicates_are_paired_by_their_number_and_not_by_their_place(place: Place) -> None:
    folder = place.campaign([
        ({KIND: "a"}, "w", {"rmse": [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]}),
        ({KIND: "b"}, "w", {"rmse": []}),
    ])  # fmt: skip
    manifest = folder.manifest()
    points = (manifest.points[0], PointOnDisk("p1", {KIND: "b"}, "w", 9))
    folder.write_manifest(Manifest(**{**vars(manifest), "points": points}))
    place.write(folder, "p1", [5, 6, 7, 8], rmse=[51.0, 61.0, 71.0, 81.0], energy=NAN, lost=0)
    place.write(folder, "p1", [1, 2, 3], rmse=[11.0, 21.0, 31.0], energy=NAN, lost=0)
    table = comparison.compare(folder).table
    assert (table["replicates"].tolist(), table["pairs"][1]) == ([7, 7], 5.0)
    assert tuple(table.loc[1, ["difference", "difference_low", "difference_high", "effect"]]) == (1.0, 1.0, 1.0, 1.0)


@pytest.mark.thorough
def test_where_no_energy_is_spent_nothing_is_said_of_it(place: Place) -> None:
    for energy in (NAN, 0.0):
        folder = place.campaign([({SIZE: n}, "w", {"rmse": [1.0] * 5, "energy": energy}) for n in (1, 2)])
        found = comparison.compare(folder)
        assert found.table["error_per_joule"].isna().all()
        assert found.table["front"].tolist() == [energy == 0.0] * 2
        assert "[J]" not in comparison_text.text(found)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"metric": "rsme"}, r"table runs has no metric 'rsme' \(did you mean 'rmse'\?\)"),
        ({"metric": "cpu_seconds"}, "has no metric 'cpu_seconds'"),
        ({"by": ["tracker.knd"]}, r"does not vary 'tracker.knd' \(did you mean 'tracker.kind'\?\)"),
        ({"by": [KIND], "baseline": "ekff"}, r"hand has no point 'ekff' \(did you mean 'ekf'\?\)"),
    ],
)
def test_what_is_not_there_is_refused_with_the_nearest(place: Place, asked: dict[str, Any], message: str) -> None:
    folder = four(place)
    with pytest.raises(UsageError, match=message):
        comparison.compare(folder, **asked)


@pytest.mark.thorough
def test_groups_are_named_in_conclusions(place: Place) -> None:
    said = comparison.compare(four(place), by=[KIND]).table["conclusion"].tolist()
    assert said[:2] == ["", ""]
    assert said[2].startswith("tracker.particles = 100: no difference in per-run RMSE is shown between ekf and pf")
    assert "Holm-corrected, 5 pairs" in said[2]
    text = comparison_text.text(comparison.compare(four(place), by=[KIND]))
    assert all(one in " ".join(text.split()) for one in said)
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.thorough
def test_any_column_of_runs_that_is_a_figure_may_be_compared(place: Place) -> None:
    folder = place.campaign([({SIZE: n}, "w", {"rmse": [1.0] * 5, "handovers": [n, 2, 3, 4, 9]}) for n in (1, 2)])
    assert comparison.compare(folder, "handovers").table["median"].tolist() == [3.0, 3.0]
    lost = comparison.compare(folder, "lost")
    assert "at the end" not in comparison_text.text(lost)


def test_a_folder_without_a_campaign_or_without_results_says_so(place: Place) -> None:
    with pytest.raises(ResultError, match="holds no campaign"):
        comparison.compare(place.path)
    with pytest.raises(ResultError, match="holds no results yet"):
        comparison.compare(place.campaign([({SIZE: 1}, "w", {"rmse": []})]))


@pytest.mark.thorough
def test_the_text_has_a_line_a_point_with_its_figures(place: Place) -> None:
    found = comparison.compare(four(place), by=[KIND])
    text = comparison_text.text(found)
    title, head, *lines = text.splitlines()[len(wrapped(answer(found))) :]
    assert title == "hand: 4 points, 6 runs each"
    assert head.split()[:5] == [KIND, SIZE, "median", "per-run", "RMSE"]
    for line, values in zip(lines, RMSE.items(), strict=False):
        (kind, size), rmse = values
        assert line.split()[:3] == [kind, str(size), f"{np.nanmedian(rmse):.4g}"]
    pairs = [line.split() for line in lines if line.split()[:1] == ["pf"]][2:]
    assert [line[2] for line in pairs] == ["-", "-"], "the baseline has no difference from itself"
    assert "without per-run RMSE: 1 run; medians and means are over the others" in text
    assert all(line == line.rstrip() for line in text.splitlines())


@pytest.mark.thorough
def test_a_comparison_begins_with_the_best_point_of_each_group(place: Place) -> None:
    found = comparison.compare(four(place), by=[KIND])
    assert answer(found).startswith(
        f"{SIZE} = 100: pf has the smallest median per-run RMSE: 7.5 m, but no paired test shows a difference."
    )
    assert f" {SIZE} = 200: pf has the smallest median per-run RMSE: 6.5 m" in answer(found)
    assert answer(found).endswith(", but no paired test shows a difference.")
    assert " ".join(comparison_text.text(found).splitlines()).startswith(answer(found))
    few = dataclasses.replace(
        found, table=found.table.assign(pairs=found.table["pairs"].clip(upper=statistics.LEAST - 1))
    )
    assert answer(few).endswith("overlaps with that of ekf."), "no test decides"
    losing = answer(comparison.compare(four(place, lose=True), by=[KIND]))
    assert (
        "; it loses the target (error above 20 m or no estimate for 4 s) in 33 % of its runs, and no other in fewer. "
        in losing
    )
    assert losing.endswith(" or no estimate for 4 s) in 17 % of its runs, and no other in fewer.")


@pytest.mark.thorough
def test_a_point_that_is_clearly_best_and_points_that_tie_are_told_apart(place: Place) -> None:
    errors = {"pf": np.arange(60.0, 70.0), "ekf": np.arange(1.0, 11.0), "ckf": np.arange(1.0, 11.0)}
    points = [({KIND: kind}, "w", {"rmse": values.tolist()}) for kind, values in errors.items()]
    clear, tied = (comparison.compare(place.campaign(points[:count]), by=[KIND]) for count in (2, 3))
    assert answer(clear) == ("ekf has the smallest median per-run RMSE: 5.5 m, better than pf by the paired tests.")
    assert answer(
        comparison.compare(place.campaign([*points[:2], ({KIND: "ukf"}, "w", {"rmse": [50.0] * 10})]), by=[KIND])
    ) == (
        "ekf has the smallest median per-run RMSE: 5.5 m, better than pf by the paired tests;"
        " --baseline ekf tests it against all."
    )
    assert answer(tied) == "No point alone has the smallest median per-run RMSE: 2 points have 5.5 m."
    assert answer(comparison.compare(place.campaign(points[:1]), by=[KIND])) == ""


def test_many_groups_are_counted(place: Place) -> None:
    points = [
        ({KIND: kind, SIZE: size}, "w", {"rmse": [base + (size if kind == "pf" else 3.0)] * 6})
        for size in (1, 2, 4, 5, 6)
        for kind, base in (("pf", 1.0), ("ekf", 1.0))
    ]
    found = comparison.compare(place.campaign(points), by=[KIND])
    assert answer(found) == f"ekf has the smallest median per-run RMSE at 3 of 5 values of {SIZE}, pf at 2."


def test_the_command_line_gives_the_same_figures_as_json_and_csv(place: Place, monkeypatch: Any) -> None:
    folder = four(place)
    found = comparison.compare(folder, by=[KIND])
    said = comparison.as_json(found)
    assert [row["median"] for row in said["points"]] == [7.5, 6.5, 8.0, 7.5]
    ran = CliRunner().invoke(main_group(), ["collect", str(folder.path), "--json"])
    answer = json.loads(ran.stdout)
    assert ran.exit_code == 0
    assert [row["median"] for row in answer["points"]] == [7.5, 6.5, 8.0, 7.5]
    assert [row[KIND] for row in answer["points"]] == ["pf", "pf", "ekf", "ekf"]
    assert (answer["metric"], answer["keys"]) == ("rmse", [KIND, SIZE])
    found.table.to_csv(place.path / "t.csv", index=False)
    back, words = pd.read_csv(place.path / "t.csv"), ["test", "conclusion", "hint"]
    assert said["conclusions"] == back["conclusion"][2:].tolist() and answer["conclusions"] == []
    assert back["test"][2:].tolist() == ["Wilcoxon signed-rank, exact"] * 2
    numbers = found.table.drop(columns=words)
    pd.testing.assert_frame_equal(
        back.drop(columns=words), numbers, check_dtype=False, rtol=1e-15, atol=0
    )  # pandas 2 reads the last bit wrong


def main_group() -> Any:
    from wsnsim.cli.shared import group

    assert callable(main)
    return group


# Reading ----------------------------------------------------------------------------------------------------------


def test_a_campaign_is_read_by_point_then_by_replicate(place: Place) -> None:
    folder = place.campaign([({SIZE: 200}, "w", {"rmse": []}), ({SIZE: 100}, "w", {"rmse": [0.0, 1.0]})])
    manifest = folder.manifest()
    points = (PointOnDisk("p0", {SIZE: 200}, "w", 7), manifest.points[1])
    folder.write_manifest(Manifest(**{**vars(manifest), "points": points}))
    place.write(folder, "p0", [5, 6], rmse=[5.0, 6.0])
    place.write(folder, "p0", [0, 1], rmse=[0.5, 1.5])
    frame = frames.read(folder.path, "runs", ["rmse", "replicate"])
    assert list(frame) == ["point", SIZE, "rmse", "replicate"]
    assert frame["point"].tolist() == [0, 0, 0, 0, 1, 1]
    assert frame[SIZE].tolist() == [200, 200, 200, 200, 100, 100]
    assert frame["replicate"].tolist() == [0, 1, 5, 6, 0, 1]
    assert frame["rmse"].tolist() == [0.5, 1.5, 5.0, 6.0, 0.0, 1.0]
    steps = frames.read(folder.path, "estimates")
    assert steps["replicate"].tolist() == [0, 0, 1, 1, 5, 5, 6, 6, 0, 0, 1, 1]
    one, seen = campaigns.metric(folder, "p0", "rmse", 7)
    assert seen.tolist() == [True, True, False, False, False, True, True]
    np.testing.assert_array_equal(one, [0.5, 1.5, NAN, NAN, NAN, 5.0, 6.0])


def test_a_replicate_that_stands_in_two_files_is_read_once_and_one_that_nobody_asks_for_never(place: Place) -> None:
    folder = place.campaign([({SIZE: 1}, "w", {"rmse": [0.0, 1.0, 2.0]})])
    place.write(folder, "p0", [1, 2, 3, 4], rmse=[9.0] * 4)
    place.write(folder, "p0", [7, 8], rmse=[9.0] * 2)
    frame = frames.read(folder.path, "runs", ["replicate", "rmse"])
    assert frame["rmse"].tolist() == [0.0, 1.0, 2.0]
    assert frame["replicate"].tolist() == [0, 1, 2]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("settings", "dtype", "expected"),
    [
        ([1, 2], "int64", [1, 2]),
        ([1, None], "Int64", [1, pd.NA]),
        ([1.0, 2.5], "float64", [1.0, 2.5]),
        ([1, 2.5], "float64", [1.0, 2.5]),
        ([1.5, None], "float64", [1.5, NAN]),
        ([True, False], "bool", [True, False]),
        ([True, None], "boolean", [True, pd.NA]),
        (["pf", "ekf"], "category", ["pf", "ekf"]),
        (["pf", None], "category", ["pf", NAN]),
        ([".inf", 2.0], "category", [".inf", "2.0"]),
        ([True, 1], "category", ["True", "1"]),
        ([2**40, 1], "int64", [2**40, 1]),
    ],
)
def test_a_swept_parameter_is_a_column_of_its_own_type(
    place: Place, settings: list[Any], dtype: str, expected: list[Any]
) -> None:
    points: list[Point] = [
        ({"a.b": value, "seed": i} if value is not None else {"seed": i}, "w", {"rmse": [1.0]})
        for i, value in enumerate(settings)
    ]
    column = frames.read(place.campaign(points).path, "runs")["a.b"]
    assert str(column.dtype) == dtype
    for value, wanted in zip(column.tolist(), expected, strict=True):
        assert (pd.isna(value) and pd.isna(wanted)) or (value == wanted and type(value) is type(wanted))


@pytest.mark.parametrize("columns", [None, ["error"], ["error", "step"]])
def test_a_key_that_is_also_a_column_is_named_apart_whatever_columns_are_read(place: Place, columns: Any) -> None:
    folder = place.campaign([({"step": 0.5, "seed": 3}, "w", {"rmse": [1.0]})])
    frame = frames.read(folder.path, "estimates", columns)
    assert list(frame)[:3] == ["point", "set.step", "seed"]
    assert frame["set.step"].tolist() == [0.5, 0.5]
    assert "step" in frames.read(folder.path, "runs"), "runs has no such column"


def test_what_cannot_be_read_is_named(place: Place) -> None:
    folder = place.campaign([({SIZE: 1}, "w", {"rmse": [1.0]})])
    with pytest.raises(ResultError, match="rnus"):
        frames.read(folder.path, "rnus")
    with pytest.raises(ResultError, match="rsme"):
        frames.read(folder.path, "runs", ["rsme"])
    folder.batch("p0", 0, 0).write_bytes(b"no result")
    with pytest.raises(ResultError, match=r"r00000-00000\.h5"):
        frames.read(folder.path, "runs")


@pytest.mark.thorough
def test_parquet_gives_back_what_is_read(place: Place) -> None:
    pytest.importorskip("pyarrow")
    folder = place.campaign([
        ({KIND: "pf", SIZE: 100, "step": 0.5, "deploy.cover": True}, "w", {"rmse": [1.0, NAN]}),
        ({KIND: "ekf", "step": 1.0, "deploy.cover": False}, "w", {"rmse": [2.0]}),
    ])  # fmt: skip
    written = frames.parquet(folder.path, place.path / "out")
    assert [(file.name, rows) for file, rows in written] == [("runs.parquet", 3), ("estimates.parquet", 6)]
    for file, _ in written:
        pd.testing.assert_frame_equal(pd.read_parquet(file), frames.read(folder.path, file.stem))
    assert sorted(path.name for path in (place.path / "out").iterdir()) == ["estimates.parquet", "runs.parquet"]


def test_parquet_says_what_it_cannot_write(place: Place) -> None:
    pytest.importorskip("pyarrow")
    folder = place.campaign([({SIZE: 1}, "w", {"rmse": [1.0]})])
    with pytest.raises(UsageError, match=r"holds no table 'rnus' .*did you mean 'runs'"):
        frames.parquet(folder.path, place.path / "out", ["rnus"])
    (place.path / "file").write_text("")
    with pytest.raises(ResultError, match="cannot be written"):
        frames.parquet(folder.path, place.path / "file", ["runs"])


def test_a_campaign_without_results_has_no_tables_to_write(place: Place) -> None:
    pytest.importorskip("pyarrow")
    with pytest.raises(ResultError, match="holds no results yet"):
        frames.parquet(place.campaign([({SIZE: 2}, "w", {"rmse": []})]).path, place.path / "out")
    assert not (place.path / "out").exists()


def test_every_figure_that_can_be_compared_is_a_column_of_runs() -> None:
    names = {column.name for column in TABLES["runs"]}
    assert set(comparison.MEASURED) <= names


def test_what_holds_for_many_points_is_one_sentence_and_a_hint_stands_once(place: Place) -> None:
    far = [float(n) for n in range(1, 13)]
    points = [({SIZE: n}, "w", {"rmse": [value + (n > 103) * 50.0 for value in far]}) for n in range(100, 108)]
    folder = place.campaign(points)
    found = comparison.compare(folder)
    assert comparison_text.conclusions(found) == [
        "no difference from tracker.particles = 100 in per-run RMSE is shown: 101, 102, 103",
        "worse than tracker.particles = 100 in per-run RMSE: 104, 105, 106, 107",
    ]
    few = comparison.compare(place.campaign([(settings, world, {"rmse": [1.0, 2.0]}) for settings, world, _ in points]))
    assert comparison_text.conclusions(few) == [
        "fewer than 5 pairs, too few to compare with tracker.particles = 100 in per-run RMSE:"
        " 101, 102, 103, 104, 105, 106, 107"
    ]
    late = [f"{conclusions.PACKETS_DECIDED}{n}: late; 100: in time" if n else "" for n in range(8)]
    hinted = dataclasses.replace(found, table=found.table.assign(hint=late))
    assert comparison_text.conclusions(hinted)[2:] == [
        "hint: packets, not the filter, may have decided: 1: late; 100: in time; 2: late; and 5 more points"
    ]


def test_a_table_of_long_names_has_100_columns_and_its_latex_every_value(place: Place) -> None:
    key, other = "clusters.handover_fraction", "tracker." + "very_" * 12 + "long"
    points = [({key: n / 7, other: "value_" * 30 + str(n)}, "w", {"rmse": [n + 0.5] * 6, "energy": 1.0, "lost": 1})
              for n in range(1, 4)]  # fmt: skip
    found = comparison.compare(place.campaign(points), by=[other])
    for explain in (False, True):
        assert max(map(len, comparison_text.text(found, explain).splitlines())) <= 100
    table = comparison_text.latex(found)
    assert table.startswith("\\begin{tabular}{ll") and table.endswith("\\bottomrule\n\\end{tabular}\n")
    rows = [line.removesuffix(r" \\").split(" & ") for line in table.splitlines() if line.endswith(r"\\")]
    assert rows[0][2:] == ["median RMSE [m]", "ever lost", "energy [J]"] and len(rows) == 4
    assert rows[1][1] == r"value\_" * 30 + "1" and "100 \\%" in rows[1][3]


def test_consistency_is_compared_without_a_pareto_front_since_neither_more_nor_less_is_better(place: Place) -> None:
    points = [
        ({KIND: kind}, "w", {"rmse": [1.0] * 6, "nees": [nees] * 6, "energy": 2.0})
        for kind, nees in (("pf", 1.0), ("ekf", 4.0))
    ]
    found = comparison.compare(place.campaign(points), "nees", by=[KIND])
    assert found.table["median"].tolist() == [1.0, 4.0] and found.table["difference"].tolist()[1] == 3.0
    assert not found.table["front"].any()
    shown = comparison_text.text(found, explain=True)
    assert "median NEES" in shown and "1 is consistent" in shown and "Pareto" not in shown and "NEES/J" not in shown
