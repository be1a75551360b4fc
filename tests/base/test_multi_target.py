"""Metrics of several tracks: beside enumerations of all assignments, published values, and what a metric fulfils."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsnsim.base import multi_target
from wsnsim.base.multi_target import FollowedRun, Tracks, follow, gospa, ospa2, switches
from wsnsim.base.tables import UNLABELLED, columns_of

NAN = float("nan")
POINTS = st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=4)


def _tracks(rows, confirmed=None):
    """Tracks of (step, track, x) or (step, track, x, y)."""
    size = len(rows[0]) if rows else 3
    table = np.array(sorted(rows), dtype=np.float64).reshape(-1, size)
    steps, numbers = table[:, :2].T.astype(np.int64)
    return Tracks(steps, numbers, table[:, 2:], np.ones(len(rows), bool) if confirmed is None else np.array(confirmed))


def _line(*targets):
    """Positions on a line at step 0, where nothing counts, and at the steps from 1 on."""
    return np.array([[NAN, *places] for places in targets])[..., None]


def _sets(one, other):
    """Two sets of points as a truth and tracks of one step."""
    truth = np.full((len(one), 2, 2), NAN)
    truth[:, 1] = np.array(one).reshape(-1, 2)
    place = np.array(other).reshape(-1, 2)
    numbers = np.arange(len(place))
    return truth, Tracks(np.ones_like(numbers), numbers, place, np.ones(len(place), bool))


def _enumerated_gospa(one, other, c, p):
    """The least of the sum of all partial assignments, as their proposition 1 has it."""
    best = np.inf
    for size in range(min(len(one), len(other)) + 1):
        for chosen in combinations(range(len(one)), size):
            for given_ in permutations(range(len(other)), size):
                errors = [np.hypot(*np.subtract(one[i], other[j])) for i, j in zip(chosen, given_, strict=True)]
                if all(error < c for error in errors):
                    best = min(best, sum(e**p for e in errors) + c**p / 2 * (len(one) + len(other) - 2 * size))
    return best ** (1 / p)


def _enumerated_ospa(one, other, c, p):
    short, long = sorted((one, other), key=len)
    if not long:
        return 0.0
    sums = [sum(min(c, np.hypot(*np.subtract(a, long[j]))) ** p for a, j in zip(short, order, strict=True))
            for order in permutations(range(len(long)), len(short))]  # fmt: skip
    return ((min(sums) + c**p * (len(long) - len(short))) / len(long)) ** (1 / p)


@settings(max_examples=20)
@given(POINTS, POINTS, st.sampled_from([0.5, 4.0, 30.0]), st.sampled_from([1.0, 2.0, 3.0]))
def test_gospa_is_the_least_cost_of_all_assignments_and_its_parts_add_up(one, other, c, p):
    found = gospa(*_sets(one, other), [c, 2 * c], p)
    assert found.distance[:, 0] == pytest.approx([_enumerated_gospa(one, other, k, p) for k in (c, 2 * c)], abs=1e-9)
    assert found.distance**p == pytest.approx(sum(part**p for part in found[1:]))
    count = lambda part: part[0, 0] ** p / (c**p / 2)  # noqa: E731
    assert count(found.missed) - count(found.false) == pytest.approx(len(one) - len(other), abs=1e-6)


@settings(max_examples=20)
@given(POINTS, POINTS, st.sampled_from([0.5, 4.0, 30.0]), st.sampled_from([1.0, 2.0, 3.0]))
def test_ospa2_of_one_step_is_ospa(one, other, c, p):
    assert ospa2(*_sets(one, other), c, 1, p)[0] == pytest.approx(_enumerated_ospa(one, other, c, p), abs=1e-9)


@settings(max_examples=20)
@given(POINTS, POINTS, POINTS, st.sampled_from([1.0, 2.0]))
def test_gospa_and_ospa_are_metrics(one, other, third, p):
    def apart(a, b):
        return np.array([gospa(*_sets(a, b), [5.0], p).distance[0, 0], ospa2(*_sets(a, b), 5.0, 1, p)[0]])

    assert (apart(one, third) <= apart(one, other) + apart(other, third) + 1e-9).all()
    assert apart(one, other) == pytest.approx(apart(other, one))
    assert apart(one, one) == pytest.approx(0.0)


WALKS = st.lists(st.lists(st.one_of(st.none(), st.floats(-9, 9)), min_size=3, max_size=3).filter(any), max_size=3)


@settings(max_examples=20)
@given(WALKS, WALKS, WALKS)
def test_ospa2_of_histories_is_a_metric(one, other, third):
    def apart(a, b):
        rows = [(k + 1, number, x) for number, walk in enumerate(b) for k, x in enumerate(walk) if x is not None]
        truth = np.array([[NAN, *(NAN if x is None else x for x in walk)] for walk in a]).reshape(len(a), 4, 1)
        return ospa2(truth, _tracks(rows), 5.0, 3)[-1]

    assert apart(one, third) <= apart(one, other) + apart(other, third) + 1e-9
    assert apart(one, other) == pytest.approx(apart(other, one))
    assert apart(one, one) == pytest.approx(0.0)


@pytest.mark.parametrize(("p", "published"), [(1.0, 2.4), (2.0, 4.49444)])
def test_ospa_of_a_missing_track_has_the_value_that_stone_soup_publishes(p, published):
    """Five targets a metre apart, four tracks with errors of 0.5 m, c = 10 m: its test of errors of cardinality."""
    truth = _line(*([float(i)] for i in range(5)))
    tracks = _tracks([(1, i, i + 0.5) for i in range(4)])
    assert ospa2(truth, tracks, 10.0, 1, p)[0] == pytest.approx(published, abs=5e-6)


def test_gospa_counts_a_track_at_the_cutoff_as_one_missed_and_one_false():
    found = gospa(_line([0.0, 0.0]), _tracks([(1, 0, 3.0), (2, 0, 4.0)]), [4.0])
    assert found.localisation[0].tolist() == [3.0, 0.0]
    assert found.missed[0] == pytest.approx([0.0, 4.0 / np.sqrt(2.0)])
    assert found.false[0] == pytest.approx(found.missed[0])


def test_tracks_that_are_not_confirmed_count_nowhere():
    truth, tracks = _line([0.0, 0.0]), _tracks([(1, 0, 0.0), (2, 0, 0.0)], [False, True])
    assert gospa(truth, tracks, [4.0]).distance[0] == pytest.approx([4.0 / np.sqrt(2.0), 0.0])
    assert ospa2(truth, tracks, 4.0, 1).tolist() == [4.0, 0.0]
    assert follow(truth, tracks, 4.0).tolist() == [[-1, 1]]
    assert _columns(truth, tracks)["time_to_confirm"] == 0.5


def _columns(truth, tracks, cutoff=4.0):
    return FollowedRun.of(0, truth, tracks, cutoff, window=3, dt=0.5).columns()


def test_a_swap_costs_nothing_in_gospa_and_the_share_of_its_steps_in_ospa2():
    """Tracks that exchange targets 10 m apart at the third of four steps: c for half of the steps of each pair."""
    truth = _line([0.0] * 4, [10.0] * 4)
    tracks = _tracks([(k, i, 10.0 * (i if k < 3 else 1 - i)) for k in range(1, 5) for i in range(2)])
    assert not gospa(truth, tracks, [4.0]).distance.any()
    assert ospa2(truth, tracks, 4.0, 4, 1.0) == pytest.approx([0.0, 0.0, 4.0 / 3.0, 2.0])
    present = np.ones((2, 4), bool)
    assert switches(present, tracks, follow(truth, tracks, 4.0)).tolist() == [[3, 0, 0, 1], [3, 1, 1, 0]]


def test_an_identity_is_kept_while_it_is_possible():
    """Two targets cross; the tracks bounce, and each is nearer to the other target long before it leaves its own."""
    ahead = np.arange(-4.0, 5.0)
    truth = _line(ahead, -ahead)
    tracks = _tracks([(k + 1, i, (-1.0) ** i * -abs(x)) for k, x in enumerate(ahead) for i in range(2)])
    followed = follow(truth, tracks, 6.5)
    numbers = tracks.track[followed]
    assert numbers.tolist() == [[0] * 8 + [1], [1] * 8 + [0]], "4 m beyond the crossing, their own are 8 m away"
    assert follow(truth, tracks, 100.0)[0].tolist() == np.flatnonzero(tracks.track == 0).tolist()


def test_a_target_gets_back_its_last_track_unless_it_was_absent_or_another_target_has_it():
    truth = _line([0.0, 0.0, 0.0], [NAN, NAN, 30.0])
    tracks = _tracks([(1, 0, 1.0), (2, 0, 9.0), (3, 0, 3.0), (3, 1, 0.0)])
    assert follow(truth, tracks, 4.0).tolist() == [[0, -1, 2], [-1, -1, -1]], "track 1 is nearer at step 3"
    absent = _line([0.0, NAN, 0.0])
    assert follow(absent, tracks, 4.0).tolist() == [[0, -1, 3]]
    assert len(switches(np.isfinite(absent[:, 1:, 0]), tracks, follow(absent, tracks, 4.0))) == 0
    taken = _line([0.0, 20.0, 0.0], [20.0, 9.0, 2.0])
    assert follow(taken, tracks, 4.0).tolist() == [[0, -1, 3], [-1, 1, 2]], "it followed target 1 since"


def test_the_columns_of_a_run_count_what_happened():
    """Target 0 is found at its second step, lost at the fourth and found by another track; target 1 never."""
    truth = _line([0.0] * 6, [NAN, NAN, 50.0, 50.0, NAN, NAN])
    rows = [(2, 4, 0.0), (3, 4, 0.0), (5, 7, 0.0), (6, 7, 0.0), (1, 9, -30.0), (2, 9, -30.0)]
    tracks = _tracks(rows)
    found = _columns(truth, tracks)
    assert found["completeness"] == 4 / 8
    assert (found["switches"], found["fragments"]) == (1, 1)
    assert found["time_to_confirm"] == 0.5, "target 1, which was never confirmed, has none"
    assert found["track_life"] == 1.0
    assert (found["confirmed_tracks"], found["false_tracks"]) == (3, 1 / (6 * 0.5 / 3600.0))
    assert found["gospa"] ** 2 == pytest.approx(sum(found[f"gospa_{part}"] ** 2 for part in multi_target.PARTS))
    assert found["gospa_missed"] ** 2 == pytest.approx(8.0 * 4 / 6), "c² / 2 for each of four misses in six steps"


def test_an_infinite_limit_of_the_error_leaves_a_cutoff_of_20_m():
    run = FollowedRun.of(0, _line([0.0, 0.0]), _tracks([(1, 0, 19.0), (2, 0, 21.0)]), np.inf, 3, 0.5)
    assert run.followed.tolist() == [[0, -1]]
    assert run.errors[0].tolist() == pytest.approx([19.0, NAN], nan_ok=True)


def test_every_column_of_the_table_has_a_value():
    truth, nothing = np.empty((0, 5, 1)), _tracks([])
    assert tuple(_columns(truth, nothing)) == UNLABELLED
    assert {*UNLABELLED} == {c.name for c in columns_of("runs", unlabelled=True)} - {c.name for c in columns_of("runs")}


def test_an_empty_field_and_no_track_are_ordinary():
    for truth in (np.empty((0, 5, 1)), np.full((1, 5, 1), NAN)):
        nothing = _tracks([])
        found = _columns(truth, nothing)
        assert found["gospa"] == found["ospa2"] == found["false_tracks"] == found["switches"] == 0.0
        assert np.isnan([found["completeness"], found["time_to_confirm"], found["track_life"]]).all()
        ghost = _tracks([(2, 0, 0.0)])
        assert gospa(truth, ghost, [4.0]).false[0] == pytest.approx([0.0, 4.0 / np.sqrt(2.0), 0.0, 0.0])
        assert ospa2(truth, ghost, 4.0, 2).tolist() == [0.0, 4.0, 4.0, 0.0]


@settings(max_examples=20)
@given(st.randoms(use_true_random=False), st.integers(0, 3), st.integers(0, 3))
def test_nothing_depends_on_the_order_of_targets_or_on_the_numbers_of_tracks(random, targets, count):
    rng = np.random.default_rng(random.randrange(2**32))
    truth = rng.uniform(-9, 9, (targets, 5, 1))
    truth[rng.random(truth.shape[:2]) < 0.3] = NAN
    rows = [(k, i, rng.uniform(-9, 9)) for k in range(1, 5) for i in range(count) if rng.random() < 0.7]
    tracks = _tracks(rows)
    order, names = rng.permutation(targets), rng.permutation(9)
    renamed = tracks._replace(track=names[tracks.track])
    found = _columns(truth, tracks, 8.0)
    other = _columns(truth[order], renamed, 8.0)
    assert found == pytest.approx(other, nan_ok=True)
