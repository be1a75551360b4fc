"""Recorded readings: the step of each, several in a step, names, order, and rows that cannot be used."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wsnsim.base.errors import RunError
from wsnsim.models.bearing import Bearing
from wsnsim.models.ranging import Range, Rssi
from wsnsim.models.recorded_readings import ReadingColumns, RecordedSensor, RepeatedReadings

NAN = np.nan
NAMES = ("a", "b")


def sensor(tmp_path: Path, rows: str, **keys: Any) -> RecordedSensor:
    """The sensor of a file with these rows: time, node, reading."""
    path = tmp_path / "readings.csv"
    path.write_text(rows if rows.startswith("time") else f"time,node,reading\n{rows}")
    return RecordedSensor(**{"path": str(path), "law": Range(), "time_origin": 0.0, **keys})


def steps_of(model: RecordedSensor, steps: int = 4, dt: float = 0.5, names: tuple[str, ...] = NAMES) -> Any:
    """The readings of the only target, (steps + 1, N), as lists."""
    (recording,) = model.recordings(names, 1, steps, dt)
    return recording.readings.tolist()


def equal(found: Any, expected: Any) -> bool:
    """Whether readings are equal; NaN equals NaN."""
    return bool(np.array_equal(np.array(found), np.array(expected), equal_nan=True))


def test_a_reading_counts_at_the_first_step_that_is_not_before_it(tmp_path: Path) -> None:
    model = sensor(tmp_path, "-3,a,1\n0,b,2\n2e-6,b,3\n0.5,a,4\n0.5000005,b,9\n0.51,a,5\n2.0,b,6\n2.1,b,7\n")
    assert equal(steps_of(model), [[1, 2], [4, 6], [5, NAN], [NAN, NAN], [NAN, 6]])


def test_steps_that_no_binary_number_holds_do_not_move_a_reading(tmp_path: Path) -> None:
    """k dt of a decimal time is below or above it by rounding."""
    rows = "".join(f"{k}.{j},a,{10 * k + j}\n" for k in range(3) for j in range(10))
    found = np.array(steps_of(sensor(tmp_path, rows), 29, 0.1, ("a",)))[:, 0]
    assert found.tolist() == list(range(30))


def test_several_readings_of_a_node_in_a_step_are_averaged_or_the_last_counts(tmp_path: Path) -> None:
    rows = "0.4,a,5\n0.1,a,1\n0.2,a,3\n0.3,b,8\n"
    assert steps_of(sensor(tmp_path, rows), 1)[1] == [3, 8]
    assert steps_of(sensor(tmp_path, rows, several="last"), 1)[1] == [5, 8]
    (recording,) = sensor(tmp_path, rows).recordings(NAMES, 1, 1, 0.5)
    assert recording.counts.tolist() == [[0, 0], [3, 1]]


def test_the_order_of_rows_and_columns_and_further_columns_do_not_matter(tmp_path: Path) -> None:
    there = "time,node,reading\n0,a,1\n0.3,b,2\n0.5,a,3\n"
    again = "time,more,value,node\n0.5,x,3,a\n0,,1,a\n0.3,y,2,b\n"
    first, other = sensor(tmp_path, there), None
    expected = steps_of(first)
    other = sensor(tmp_path, again, columns=ReadingColumns(reading="value"))
    assert equal(steps_of(other), expected)


def test_time_zero_is_that_of_the_first_reading_unless_it_is_given(tmp_path: Path) -> None:
    rows = "1700000000.5,a,2\n1700000000.0,a,1\n"
    assert equal(steps_of(sensor(tmp_path, rows, time_origin=None), 1), [[1, NAN], [2, NAN]])
    assert equal(steps_of(sensor(tmp_path, rows, time_origin=1700000000.5), 1), [[1.5, NAN], [NAN, NAN]])


def test_each_target_has_the_readings_of_its_number(tmp_path: Path) -> None:
    model = sensor(tmp_path, "time,node,reading,target\n0,a,1,1\n0,a,2,0\n0.5,b,3,1\n")
    one, other = model.recordings(NAMES, 2, 1, 0.5)
    assert equal(one.readings, [[2, NAN], [NAN, NAN]]) and equal(other.readings, [[1, NAN], [NAN, 3]])


BAD = """time,node,reading
0,a,-70
1,b,42
1,c,-70
2,a,nan
0,a,-71
3,b,-300
4,a,-60
"""


def test_every_row_that_cannot_be_used_is_named_at_once(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="5 of 7 rows cannot be used") as caught:
        sensor(tmp_path, BAD, law=Rssi()).recordings(NAMES, 1, 4, 1.0)
    places = [line.split("readings.csv:")[1] for line in str(caught.value).splitlines()[1:-1]]
    assert places == [
        "3: reading must be between -200 and 0, is 42 (1 more row like it)",
        "4: the deployment has no node 'c' (its nodes: a, b)",
        "5: reading must be a finite number, is 'nan'",
        "6: repeats time, node and target of line 2",
    ]


def test_rows_that_are_skipped_leave_the_others_as_they_are(tmp_path: Path) -> None:
    model = sensor(tmp_path, BAD, law=Rssi(), skip_bad_rows=True)
    assert equal(steps_of(model, 4, 1.0), [[-70, NAN], [NAN, NAN], [NAN, NAN], [NAN, NAN], [-60, NAN]])


def test_a_target_that_there_is_not_and_one_that_is_no_number_are_named(tmp_path: Path) -> None:
    rows = "time,node,reading,target\n0,a,1,2\n1,a,1,0.5\n2,a,1,0\n3,a,1,-1\n"
    with pytest.raises(RunError, match="3 of 4 rows") as caught:
        sensor(tmp_path, rows).recordings(NAMES, 2, 4, 1.0)
    text = str(caught.value)
    assert ":2: there is no target 2: allowed are 0 to 1 (1 more row like it)" in text
    assert ":3: target must be a whole number, is 0.5" in text


def test_bearings_in_degrees_are_refused_with_the_command_that_converts_them(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"rad; degrees\? Write: wsnsim import readings"):
        sensor(tmp_path, "0,a,90\n1,a,180\n", law=Bearing()).recordings(NAMES, 1, 4, 1.0)


def test_a_range_may_be_negative_by_noise_alone(tmp_path: Path) -> None:
    model = sensor(tmp_path, "0,a,-4.9\n1,a,9e6\n2,a,-5.1\n3,a,-500\n4,a,2e7\n", law=Range(sd=0.5))
    with pytest.raises(RunError, match="3 of 5 rows") as caught:
        model.recordings(NAMES, 1, 4, 1.0)
    assert "readings.csv:4: reading must be between -5 and 1e+07, is -5.1" in str(caught.value)


def test_a_file_of_bad_rows_alone_is_refused_even_if_they_are_skipped(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="1 of 1 rows cannot be used"):
        sensor(tmp_path, "0,a,42\n", law=Rssi(), skip_bad_rows=True).recordings(NAMES, 1, 1, 1.0)


def test_a_recording_is_no_law_of_a_recording(tmp_path: Path) -> None:
    inner = sensor(tmp_path, "0,a,1\n")
    with pytest.raises(ValueError, match="not recorded readings"):
        RecordedSensor(path=inner.path, law=inner)


def test_filters_are_given_the_law(tmp_path: Path) -> None:
    law = Rssi(gain_spread=3.0)
    model = sensor(tmp_path, "0,a,-50\n", law=law)
    assert model.assumed("known", False) is law
    assert model.assumed("unknown", True) == law.assumed("unknown", True)
    assert model.trait_names == law.trait_names and model.reach == law.reach


def test_bearings_of_a_node_in_a_step_have_their_mean_direction_in_any_order(tmp_path: Path) -> None:
    """170°, 10° and −170° point to 170° together; the values nearest to the first of them, to 3°, 123° or -117°."""
    degrees, law = [10.0, 170.0, -170.0], {"law": Bearing()}
    for order in itertools.permutations(np.radians(degrees).tolist()):
        rows = "".join(f"0.{k},a,{value!r}\n" for k, value in enumerate(order, 1))
        (mean,) = np.degrees(steps_of(sensor(tmp_path, f"0,b,0\n{rows}", **law), 1, 1.0)[1])[:1]
        assert mean % 360.0 == pytest.approx(170.0)


def test_means_of_sampled_bearings_stay_near_the_target_across_the_cut() -> None:
    """A target behind the node, at ±180°: means of 100 bearings deviate by a tenth of the law's deviation."""
    model = RepeatedReadings(law=Bearing(sd=0.1))
    noise = np.random.default_rng(3).normal(size=400)
    points, places = np.tile([[-10.0], [0.0]], 400).T, np.zeros((400, 2))
    found = model.measure(points, places, np.full((400, 1), 100.0), noise)
    assert np.std(found % (2.0 * np.pi)) == pytest.approx(0.01, rel=0.1)


def test_names_that_do_not_meet_are_both_shown_with_the_column_that_has_them(tmp_path: Path) -> None:
    model = sensor(tmp_path, "time,node,mac,reading\n0,1,a,3\n1,2,b,4\n")
    with pytest.raises(RunError) as caught:
        model.recordings(NAMES, 1, 1, 0.5)
    said = str(caught.value).split("readings.csv ")[1]
    assert said == "and the deployment have no name of a node in common: 1, 2; a, b; the column 'mac' has some"


def test_the_order_of_the_nodes_in_their_file_does_not_matter(tmp_path: Path) -> None:
    model = sensor(tmp_path, "0,a,1\n0,b,2\n0.5,c,3\n")
    for names in itertools.permutations("abc"):
        found = np.array(steps_of(model, 1, names=names))
        assert equal(found[:, [names.index(name) for name in "abc"]], [[1, 2, NAN], [NAN, NAN, 3]])
