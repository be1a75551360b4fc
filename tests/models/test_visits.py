"""Targets that come and go: crossings of an area, and visits at random or listed times."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from tests.helpers.thorough import thorough
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.visits import Crossing, Visits
from wsnsim.scenario import build, load

HOUR: Final = 3600.0
AREA: Final = Crossing(width=200.0, height=120.0, centre=(10.0, -20.0), speed=(5.0, 8.0))
WORKDAY: Final = (0.0,) * 8 + (3.0,) * 8 + (1.0,) * 8


def stays_of(motion: Visits, steps: int, dt: float, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The first and the last step of each visit."""
    there = np.isfinite(motion.truth(steps, dt, np.random.default_rng(seed))[:, 0])
    edges = np.flatnonzero(np.diff(there, prepend=False, append=False)).reshape(-1, 2)
    return edges[:, 0], edges[:, 1] - 1


def scenario(values: dict[str, Any], **others: Any) -> Any:
    """A small scenario with a motion."""
    return build(load("pso_mhpf", {"deploy.nodes": 100, "tracker.particles": 20, "motion": values, **others}))


@pytest.mark.parametrize("seed", range(20))
def test_a_crossing_goes_straight_from_one_side_to_another_and_leaves(seed: int) -> None:
    dt = 0.25
    states = AREA.truth(400, dt, np.random.default_rng(seed))
    there = np.isfinite(states[:, 0])
    last = int(there.sum()) - 1
    assert there[: last + 1].all() and 0 < last * dt <= AREA.longest
    places, velocity = states[: last + 1, [0, 2]], states[0, [1, 3]]
    np.testing.assert_allclose(places, places[0] + np.arange(last + 1)[:, None] * dt * velocity, atol=1e-9)
    assert 5.0 <= np.hypot(*velocity) <= 8.0
    from_middle = np.abs(places - AREA.centre) / (AREA.width / 2, AREA.height / 2)
    assert from_middle.max() <= 1.0 + 1e-9
    assert from_middle[0].max() == pytest.approx(1.0)
    assert (np.abs(places[-1] + dt * velocity - AREA.centre) > (AREA.width / 2, AREA.height / 2)).any()


@pytest.mark.parametrize("rate", [1.0, 20.0, *thorough([5.0, 60.0])])
@pytest.mark.parametrize("profile", [None, WORKDAY])
@pytest.mark.parametrize("of", [{}, {"lasting": 7.0}])
def test_visits_come_at_their_rate_in_the_long_run(rate: float, profile: Any, of: dict[str, Any]) -> None:
    motion, dt, days = Visits(rate=rate / HOUR, profile=profile, of=AREA, **of), 2.0, max(round(60 / rate), 4)
    first, last = stays_of(motion, round(days * 24 * HOUR / dt), dt)
    expected = rate * 24 * days
    # the intervals between visits spread by less than those of a Poisson process
    assert abs(len(first) - expected) < 4.0 * np.sqrt(expected)
    assert (first[1:] > last[:-1] + 1).all()


def test_times_between_visits_are_exponential() -> None:
    motion, dt = Visits(of=AREA, lasting=10.0, rate=12 / HOUR), 0.5
    first, last = stays_of(motion, 400_000, dt)
    gaps = (first[1:] - last[:-1]) * dt
    assert kstest(gaps, "expon", args=(0.0, HOUR / 12 - 10.0)).pvalue > 0.01


def test_the_profile_says_how_visits_are_shared_among_the_hours() -> None:
    motion, dt = Visits(of=AREA, lasting=5.0, rate=30 / HOUR, profile=WORKDAY), 4.0
    first, _ = stays_of(motion, round(20 * 24 * HOUR / dt), dt)
    counts = np.bincount((first * dt % (24 * HOUR) // HOUR).astype(int), minlength=24)
    assert counts[:8].max(initial=0) <= 1  # one that begins at the very end of the last hour is rounded up
    assert chisquare(counts[8:], np.array(WORKDAY[8:]) * counts[8:].sum() / sum(WORKDAY)).pvalue > 0.01


@pytest.mark.parametrize("profile", [None, WORKDAY])
def test_many_visits_at_once_end_when_as_many_single_ones_do(profile: Any) -> None:
    motion, rng, count, paths = (
        Visits(of=AREA, lasting=20.0, rate=40 / HOUR, profile=profile),
        np.random.default_rng(1),
        4000,
        300,
    )
    one = np.full(paths, 5 * HOUR)
    for _ in range(count):
        one = motion.after(one, rng.exponential(size=paths)) + 20.0
    stay = np.full(paths, 20.0 * count)
    several = motion.after_several(np.full(paths, 5 * HOUR), count, rng.gamma(count, size=paths), stay)
    error = np.hypot(one.std(), several.std()) / np.sqrt(paths)
    assert abs(one.mean() - several.mean()) < 4.0 * error
    assert several.std() == pytest.approx(one.std(), rel=0.25)


def test_a_listed_visit_begins_with_the_first_step_at_or_after_its_time(tmp_path: Path) -> None:
    times = (0.0, 10.2, 12.0 * 3, 100.0)
    motion = Visits(of=AREA, lasting=4.0, times=times)
    first, last = stays_of(motion, 45, 2.0)
    np.testing.assert_array_equal(first, [0, 6, 18])
    np.testing.assert_array_equal(last, first + 1)
    path = tmp_path / "times.csv"
    path.write_text("number,time\n" + "".join(f"{number},{time}\n" for number, time in enumerate(times)))
    np.testing.assert_array_equal(stays_of(Visits(of=AREA, lasting=4.0, path=str(path)), 45, 2.0), (first, last))


def test_there_are_no_visits_without_times() -> None:
    assert np.isnan(Visits(of=AREA, times=()).truth(50, 1.0, np.random.default_rng(0))).all()


def test_visits_are_those_of_their_motion() -> None:
    motion = Visits(of=AREA, times=(0.0,))
    states = motion.truth(50, 1.0, np.random.default_rng(4))
    np.testing.assert_array_equal(states, AREA.truth(50, 1.0, np.random.default_rng(4)))
    assert motion.assumed(2.0) == AREA.assumed(2.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "give one of rate, such as 1/h, times"),
        ({"rate": 1e-3, "times": (1.0,)}, "give one of rate, such as 1/h, times"),
        ({"rate": 1e-3, "of": object()}, "say how long a visit lasts"),
        ({"rate": 1e-3, "profile": (1.0, 2.0)}, "expected 24 factors"),
        ({"rate": 1e-3, "profile": (0.0,) * 24}, "not all 0"),
        ({"times": (1.0,), "profile": WORKDAY}, "beside a rate"),
        ({"times": (5.0, 5.0)}, "must ascend"),
        ({"rate": 1 / 60, "lasting": 60.0}, "60 visits an hour of 60 s each would overlap"),
        ({"rate": 1 / 60, "lasting": 30.0, "profile": WORKDAY}, "would overlap"),
    ],
)
def test_values_that_contradict_each_other_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Visits(**{"of": AREA} | values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("start\n1\n", "time"),
        ("time\n1\n1\n", r":3: times must ascend from 0 s on, is 1 s"),
        ("time\n-1\n", r":2: times must ascend from 0 s on, is -1 s"),
        ("time\n1\n30\n", "two begin 29 s apart"),
    ],
)
def test_files_of_times_that_cannot_be_used_are_refused_at_their_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message):
        scenario({"kind": "visits", "of": {"kind": "crossing"}, "lasting": 30.0, "path": str(path)})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"of": {"kind": "visits", "of": {"kind": "crossing"}, "rate": "1/h"}, "rate": "1/h", "lasting": 1.0},
            "a visit is no series of visits",
        ),
        ({"times": [0, 30]}, "two begin 30 s apart"),
        ({"rate": "1/h", "of": {"kind": "crossing", "centre": [5000, 0]}}, "beside the field"),
    ],
)
def test_visits_that_cannot_happen_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario({"kind": "visits", "of": {"kind": "crossing"}} | values)


def test_a_rate_may_be_given_per_hour() -> None:
    assert scenario({"kind": "visits", "of": {"kind": "crossing"}, "rate": "10/h"}).motions[0].rate == pytest.approx(
        10 / HOUR
    )


def test_a_track_ends_after_its_target_has_left_and_the_next_visit_is_tracked_again() -> None:
    times = [4.0, 40.0]
    crossing = {"kind": "crossing", "width": 60, "height": 60}
    motion = {"kind": "visits", "lasting": 6.0, "times": times, "of": crossing}
    memory = Memory()
    replicate_of(build(load("gmtt", {"motion": motion, "duration": "60 s", "step": 1.0})), 0, memory)
    tracks, rows = memory.table("tracks"), memory.table("estimates")
    assert float(tracks["time_present"][0]) == 12.0
    assert float(tracks["false_time"][0]) == 0.0
    measured = set(rows["step"][rows["readings"] > 0].tolist())
    assert not measured & set(range(12, 40))
    for time in times:
        assert len(measured & set(range(int(time), int(time) + 7))) >= 3


def test_a_file_is_read_when_it_is_needed() -> None:
    with pytest.raises(RunError, match="nowhere"):
        _ = Visits(of=AREA, lasting=1.0, path="nowhere.csv").begins


def test_the_frequency_of_listed_visits_counts_those_that_begin_before_the_horizon(tmp_path: Path) -> None:
    (tmp_path / "times.csv").write_text("time\n0\n100\n200\n")
    for listed in ({"times": (0.0, 100.0, 200.0)}, {"path": str(tmp_path / "times.csv")}):
        visits = Visits(of=Crossing(), lasting=20.0, **listed)  # type: ignore[arg-type]
        assert [visits.frequency(horizon) for horizon in (50.0, 200.0, 400.0)] == [0.02, 0.01, 0.0075]
    assert Visits(of=Crossing(), lasting=20.0, rate=0.003).frequency(50.0) == 0.003
