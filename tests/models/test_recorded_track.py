"""Recorded trajectories: interpolation, order of rows, heights, and rows that cannot be used."""

from pathlib import Path

import numpy as np
import pytest

from wsnsim.base.errors import RunError
from wsnsim.models.recorded_track import RecordedTrack, TrackColumns

RNG = np.random.default_rng(0)
TEXT = "time,x,y,z\n10,0,0,1\n12,4,-2,3\n13,4,-2,3\n"
SHIPPED = "scenarios/recorded/ble/straight_04.csv.gz"


def track(tmp_path: Path, text: str = TEXT, **keys: object) -> RecordedTrack:
    """The model of a file with this text."""
    path = tmp_path / "track.csv"
    path.write_text(text)
    return RecordedTrack(path=str(path), **keys)  # type: ignore[arg-type]


def test_places_are_interpolated_linearly_and_rest_before_and_after(tmp_path: Path) -> None:
    found = track(tmp_path, time_origin=9.0).truth(6, 1.0, RNG)
    assert found[:, 0].tolist() == [0, 0, 2, 4, 4, 4, 4]
    assert found[:, 2].tolist() == [0, 0, -1, -2, -2, -2, -2]
    assert found[:, 1].tolist() == [0, 2, 2, 0, 0, 0, 0] and found[:, 3].tolist() == [0, -1, -1, 0, 0, 0, 0]


def test_time_zero_is_that_of_the_first_row_and_heights_follow_the_places(tmp_path: Path) -> None:
    model = track(tmp_path)
    assert model.truth(2, 0.5, RNG)[:, 0].tolist() == [0, 1, 2]
    heights = model.heights(4, 0.5)
    assert heights is not None and heights.tolist() == [1, 1.5, 2, 2.5, 3]


def test_without_a_column_z_the_height_is_unknown(tmp_path: Path) -> None:
    model = track(tmp_path, "t,x,y\n0,0,0\n1,1,1\n", header=TrackColumns(time="t"))
    assert model.heights(1, 1.0) is None and model.truth(1, 1.0, RNG)[:, 0].tolist() == [0, 1]


def test_rows_may_stand_in_any_order_and_repeat_a_place(tmp_path: Path) -> None:
    shuffled = "time,x,y,z\n13,4,-2,3\n10,0,0,1\n12,4,-2,3\n12,4.0004,-2,3\n"
    assert np.array_equal(track(tmp_path, shuffled).truth(6, 0.5, RNG), track(tmp_path).truth(6, 0.5, RNG))


def test_all_rows_that_cannot_be_used_are_named_and_may_be_skipped(tmp_path: Path) -> None:
    text = TEXT + "12,4.5,-2,3\n14,x,0,0\n15,1e12,0,0\n"
    with pytest.raises(RunError, match="3 of 6 rows cannot be used") as caught:
        track(tmp_path, text).truth(1, 1.0, RNG)
    lines = str(caught.value).splitlines()[1:-1]
    assert [line.split(":")[1] for line in lines] == ["5", "6", "7"]
    assert "0.5 m from the place in line 3; at most 0.001 m is allowed" in lines[0]
    assert "x must be a finite number, is 'x'" in lines[1] and "within ±1e+09 m" in lines[2]
    model = track(tmp_path, text, skip_bad_rows=True)
    assert np.array_equal(model.truth(6, 0.5, RNG), track(tmp_path).truth(6, 0.5, RNG))
    skipped = model.skipped_rows(None)
    assert [row.split(":")[:2] for row in skipped] == [["track.csv", line] for line in "567"]
    assert track(tmp_path, skip_bad_rows=True).skipped_rows(None) == []


def test_one_point_is_no_trajectory(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="at least two points of different times are needed"):
        track(tmp_path, "time,x,y\n1,0,0\n1,0,0\n").truth(1, 1.0, RNG)


def test_a_shipped_track_is_interpolated_as_by_hand() -> None:
    rows = np.genfromtxt(SHIPPED, delimiter=",", names=True, dtype=None, encoding="utf-8")
    order = np.argsort(rows["time"], kind="stable")
    model, now = RecordedTrack(path=SHIPPED), np.arange(97) * 0.25
    found, heights = model.truth(96, 0.25, RNG), model.heights(96, 0.25)
    assert heights is not None
    for column, values in (("x", found[:, 0]), ("y", found[:, 2]), ("z", heights)):
        assert np.abs(values - np.interp(now, rows["time"][order], rows[column][order])).max() < 1e-3


def test_two_places_at_nearly_one_time_are_refused_before_a_tracker_meets_their_speed(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text("time,x,y\n5,1,1\n1e-300,3,0\n0,0,0\n1e-9,3,0\n1e16,0,0\n")
    with pytest.raises(RunError) as refused:
        _ = RecordedTrack(path=str(path)).track
    lines = str(refused.value).splitlines()
    assert lines[0].endswith("2 of 5 rows cannot be used:")
    assert lines[1].endswith(":3: is 1e-300 s after line 4; 1e-09 s are the least that is allowed")
    assert lines[2].endswith(":6: x, y and z must be within ±1e+09 m, time within ±1e+15 s")
    kept = RecordedTrack(path=str(path), skip_bad_rows=True).track
    assert kept.times.tolist() == [0.0, 1e-9, 5.0]


def test_several_movers_in_a_file_are_refused_and_receivers_of_one_are_not(tmp_path):
    path = tmp_path / "track.csv"
    rows = [(t, name, x0 + t, 5.0) for t in range(9) for name, x0 in (("car", 0.0), ("bus", 300.0))]
    path.write_text("time,vehicle,x,y\n" + "".join(f"{t},{name},{x},{y}\n" for t, name, x, y in rows))
    with pytest.raises(RunError, match="the column 'vehicle' names 2 movers, car, bus: give each a file of its own"):
        _ = RecordedTrack(path=str(path)).track
    heard = "".join(f"{t},{'ab'[t % 2]},{t},5\n" for t in range(9))
    path.write_text(f"time,receiver,x,y\n{heard}")
    assert len(RecordedTrack(path=str(path)).track.times) == 9
    path.write_text("time,id,x,y\n" + "".join(f"{t},{t},{t},5\n" for t in range(9)))
    assert len(RecordedTrack(path=str(path)).track.times) == 9


def test_with_a_gap_the_target_is_absent_where_the_file_has_no_rows(tmp_path: Path) -> None:
    """Rows at 10, 12, 13 s, and at 20 and 21 s; instants at rows are within."""
    model = track(tmp_path, TEXT + "20,0,0,1\n21,1,0,1\n", time_origin=9.0, gap=2.0)
    found = model.truth(14, 1.0, RNG)
    there = np.isfinite(found).all(axis=1)
    assert np.flatnonzero(there).tolist() == [1, 2, 3, 4, 11, 12]
    assert np.array_equal(
        found[there], track(tmp_path, TEXT + "20,0,0,1\n21,1,0,1\n", time_origin=9.0).truth(14, 1.0, RNG)[there]
    )
    assert model.may_be_absent and not track(tmp_path).may_be_absent
    short = track(tmp_path, TEXT, gap=1.5).truth(6, 0.5, RNG)
    assert np.flatnonzero(np.isfinite(short[:, 0])).tolist() == [0, 4, 5, 6]
