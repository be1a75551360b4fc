"""When tracks start, are confirmed, end and merge: rules by hand, ghosts, and an empty field beside the logic alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.helpers.target_scans import MOTION, driven, facts_of, grid, prior_of, ring, scans_of, straight
from wsnsim.base.scans import Scan
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.ranging import Range
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.multi_target.frames import Belief, BelievedTrack
from wsnsim.trackers.multi_target.management import KnownTargets, MOfN, SequentialTest, with_hit
from wsnsim.trackers.multi_target.several_gaussians import Lmb, Mht
from wsnsim.trackers.multi_target.single_gaussian import Gnn, Jpda, LocalNearestNeighbour, Pda
from wsnsim.trackers.shared.gaussian_port import GaussianBank

NO_BANK = GaussianBank(np.zeros((1, 1, 4)), np.eye(4)[None, None], np.ones((1, 1)))
TWO = straight([[-12.0, 0.5, 3.0, 0.2], [14.0, -0.3, -9.0, 0.4]], 10)


def track(**changes):
    return BelievedTrack(0, np.ones(1), NO_BANK, 0.0, **changes)


@pytest.mark.parametrize(
    ("hits", "verdict"),
    [("1", "stay"), ("11", "stay"), ("111", "confirm"), ("10101", "confirm"), ("1000", "delete"), ("10010", "delete")],
)
def test_three_of_five_steps_confirm_a_track_and_it_ends_when_they_are_out_of_reach(hits, verdict) -> None:
    rules = MOfN(hits=3, window=5, coast=4)
    assert rules.judge(track(hits=tuple(hit == "1" for hit in hits))) == verdict


def test_a_confirmed_track_coasts_for_some_steps() -> None:
    one, rules = track(hits=(True,) * 5, confirmed=True), MOfN(coast=3)
    verdicts = []
    for _ in range(3):
        one = with_hit(one, 0.0, 2.0, rules.window)
        verdicts.append(rules.judge(one))
    assert verdicts == ["stay", "stay", "delete"]
    assert with_hit(one, 1.0, 2.0, 5).misses == 0 and not with_hit(one, 1.0, 4.0, 5).hits[-1]
    assert with_hit(one, 0.0, 0.01, 5).hits == one.hits, "no node could see it"


def test_the_sequential_test_confirms_and_deletes_at_walds_odds() -> None:
    rules = SequentialTest(false_confirmation=0.02, false_deletion=0.1)
    assert (
        rules.judge(track(existence=45.1 / 46.1)) == "confirm" and rules.judge(track(existence=44.9 / 45.9)) == "stay"
    )
    lower = 0.1 / 0.98
    assert rules.judge(track(existence=lower / (1 + lower) * 0.999)) == "delete"
    assert rules.judge(track(existence=lower / (1 + lower) * 1.001, confirmed=True)) == "stay"
    with pytest.raises(ValueError, match="hits"):
        MOfN(hits=4, window=3)


def first_step(sensor, nodes, rules, truth=TWO, seed=1, **words):
    facts = facts_of(sensor, probability=1.0, clutter=0.0, **words)
    scans = scans_of(truth, 0, nodes, facts, np.random.default_rng(seed), 0.0, 1.0)
    tracker = Jpda(filter=ExtendedKalman(), management=rules)
    outcome = tracker.step(Belief(0.0), 0.0, scans, nodes, facts, 7)
    return tracker.estimates(outcome.belief, facts), outcome


@pytest.mark.parametrize(
    ("sensor", "count", "support"),
    [(Range(sd=0.5, reach=200.0), 5, 3), (Bearing(sd=0.005, reach=200.0), 4, 3),
     (RangeBearing(range_sd=0.5, bearing_sd=0.01, reach=200.0), 1, 1)],
    ids=["ranges", "bearings", "both"],
)  # fmt: skip
def test_two_targets_start_two_tracks_where_they_are(sensor, count, support) -> None:
    found, outcome = first_step(sensor, ring(count), MOfN(support=support))
    assert [event.track for event in outcome.events] == [7, 8] == [one.number for one in found]
    places = np.array(sorted(one.mean[[0, 2]].tolist() for one in found))
    assert np.abs(places - TWO[0][:, [0, 2]]).max() < 2.0
    for one, truth in zip(sorted(found, key=lambda one: one.mean[0]), TWO[0], strict=True):
        off = one.mean[[0, 2]] - truth[[0, 2]]
        assert off @ np.linalg.solve(one.cov[np.ix_([0, 2], [0, 2])], off) < chi2.ppf(0.999, 2)
    assert all(share == pytest.approx(1.0) for share in outcome.explained)
    assert not any(one.confirmed for one in found)


def test_crossings_of_two_bearings_need_a_further_node() -> None:
    sensor = Bearing(sd=0.005, reach=200.0)
    assert not first_step(sensor, ring(2), MOfN(support=3))[0]
    pairs, _ = first_step(sensor, ring(2), MOfN(support=2))
    assert len(pairs) == 2, "two targets or their two ghosts: two nodes cannot tell"
    seen = [first_step(sensor, ring(3), MOfN(support=3), seed=seed)[0] for seed in range(10)]
    assert all(len(found) == 2 for found in seen)


@pytest.mark.parametrize("rules", [MOfN(), SequentialTest(births=1e-4)], ids=["M of N", "sequential"])
@pytest.mark.parametrize("method", [Gnn, Jpda, Lmb, Mht])
def test_tracks_are_confirmed_follow_their_targets_and_end_after_them(method, rules) -> None:
    nodes, facts, rng = ring(6), facts_of(Range(sd=1.0, reach=200.0), clutter=0.5), np.random.default_rng(2)
    truth = np.concatenate([TWO, np.full((12, 2, 4), np.nan)])
    every = [scans_of(truth, step, nodes, facts, rng, 0.0, 150.0) for step in range(len(truth))]
    tracker = method(filter=ExtendedKalman(), management=rules)
    steps = list(driven(tracker, Belief(0.0), every, nodes, facts))
    found = [one for one in tracker.estimates(steps[9].belief, facts) if one.confirmed]
    places = np.array(sorted(one.mean[[0, 2]].tolist() for one in found))
    assert places == pytest.approx(truth[9][:, [0, 2]], abs=3.0)
    assert not [one for one in steps[-1].belief.tracks if one.confirmed]
    kinds = [event.kind for outcome in steps for event in outcome.events]
    assert kinds.count("confirm") == 2 and kinds.count("delete") >= 2


@pytest.mark.parametrize("method", [LocalNearestNeighbour, Gnn, Pda, Jpda, Lmb, Mht])
def test_a_target_that_no_node_can_sense_exists_as_probably_as_it_survives(method) -> None:
    nodes, facts = ring(3), facts_of(Range(sd=1.0, reach=100.0))
    tracker = method(filter=ExtendedKalman(), management=SequentialTest(survival=0.9))
    belief = tracker.begin([prior_of(np.array([1e4, 0.0, 0.0, 0.0]))], 0.0, facts)
    for step in (1, 2, 4):
        scans = [Scan(node, float(step), np.empty((0, 1))) for node in nodes.ids]
        belief = tracker.step(belief, float(step), scans, nodes, facts, 1).belief
    assert tracker.estimates(belief, facts)[0].existence == pytest.approx(0.9**4, rel=1e-6)


def test_two_tracks_of_one_target_are_merged_and_those_of_two_are_not() -> None:
    nodes, facts = ring(5), facts_of(Range(sd=1.0, reach=200.0), probability=1.0, clutter=0.0)
    truth = straight([[0.0, 0.5, 0.0, 0.3], [12.0, 0.5, 0.0, 0.3]], 8)
    every = [scans_of(truth, step, nodes, facts, np.random.default_rng(step), 0.0, 1.0) for step in range(1, 9)]
    tracker = LocalNearestNeighbour(filter=ExtendedKalman(), management=MOfN(duplicate_steps=4))
    begun = tracker.begin([prior_of(state) for state in truth[0]], 0.0, facts)
    near = replace(tracker.begin([prior_of(truth[0, 0] + 0.5)], 0.0, facts, number=2).tracks[0], confirmed=False)
    steps = list(driven(tracker, replace(begun, tracks=(*begun.tracks, near)), every, nodes, facts))
    merges = [(event.track, event.other) for outcome in steps for event in outcome.events if event.kind == "merge"]
    assert merges == [(2, 0)]
    assert [one.number for one in steps[-1].belief.tracks] == [0, 1]


def test_known_targets_neither_start_nor_end() -> None:
    nodes, facts = ring(3), facts_of(Range(sd=1.0, reach=200.0))
    tracker = Jpda(filter=ExtendedKalman(), management=KnownTargets())
    belief = tracker.begin([prior_of(TWO[0, 0])], 0.0, facts)
    empty = [[Scan(node, float(step), np.empty((0, 1))) for node in nodes.ids] for step in range(1, 30)]
    *_, last = driven(tracker, belief, empty, nodes, facts)
    assert not last.events and [one.number for one in last.belief.tracks] == [0]
    none = tracker.step(
        Belief(0.0), 1.0, scans_of(TWO, 1, nodes, facts, np.random.default_rng(1), 0.0, 9.0), nodes, facts, 0
    )
    assert not none.belief.tracks


FIELD, CLUTTER, STEPS = 200.0, 6.0, 3000


def false_tracks_of_the_logic(rng, steps, sd, gate):
    """Confirmed tracks of M of N (2 of 3) with a Kalman filter and the nearest detection, written for itself alone.

    Points of clutter are uniform over a square; those that no track takes start tracks of their own.
    """
    tracks, confirmed = [], 0
    transition = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    _, noise = MOTION.matrices(np.zeros((4, 1)), 1.0, 0.0)
    rise = np.zeros((2, 4))
    rise[0, 0] = rise[1, 2] = 1.0
    for _ in range(steps):
        points = rng.uniform(-FIELD / 2, FIELD / 2, (rng.poisson(CLUTTER), 2))
        free, kept = np.ones(len(points), dtype=bool), []
        for mean, cov, hits, was in tracks:
            mean, cov = transition @ mean, transition @ cov @ transition.T + noise
            width = rise @ cov @ rise.T + sd**2 * np.eye(2)
            off = points - mean[[0, 2]]
            squares = np.einsum("mi,ij,mj->m", off, np.linalg.inv(width), off)
            best = int(squares.argmin()) if len(points) else -1
            hit = best >= 0 and squares[best] <= gate
            if hit:
                gain = cov @ rise.T @ np.linalg.inv(width)
                mean, cov = mean + gain @ off[best], cov - gain @ rise @ cov
                free[best] = False
            hits = (*hits, hit)[-3:]
            if not was and sum(hits) >= 2:
                was, confirmed = True, confirmed + 1
            if (was and any(hits[-2:])) or (not was and len(hits) < 3 and sum(hits) + 3 - len(hits) >= 2):
                kept.append((mean, cov, hits, was))
        tracks = kept
        for point in points[free]:
            mean, cov = np.zeros(4), np.diag([sd**2, 9.0, sd**2, 9.0])
            mean[[0, 2]] = point
            tracks.append((mean, cov, (True,), False))
    return confirmed


@pytest.mark.thorough
def test_an_empty_field_confirms_as_many_false_tracks_as_the_logic_alone() -> None:
    """A radar far away, so that its errors are those of points, and clutter uniform in the square around the origin."""
    sd, far = 1.0, 1e5
    sensor = RangeBearing(range_sd=sd, bearing_sd=sd / far, reach=2.0 * far)
    nodes = replace_position(ring(1), np.array([[-far, 0.0]]))
    facts = facts_of(sensor, clutter=CLUTTER, volume=FIELD * FIELD / far)
    rules = MOfN(hits=2, window=3, coast=2, support=1, births=1e3, duplicate=0.0)
    tracker = Gnn(filter=ExtendedKalman(), management=rules, gate=0.99)
    rng, belief, ours, number = np.random.default_rng(21), Belief(0.0), 0, 0
    for step in range(STEPS):
        points = rng.uniform(-FIELD / 2, FIELD / 2, (rng.poisson(CLUTTER), 2)) + np.array([far, 0.0])
        polar = np.column_stack([np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])])
        outcome = tracker.step(belief, float(step), [Scan(10, float(step), polar)], nodes, facts, number)
        belief, number = outcome.belief, number + sum(event.kind == "start" for event in outcome.events)
        ours += sum(event.kind == "confirm" for event in outcome.events)
    alone = false_tracks_of_the_logic(np.random.default_rng(22), STEPS, sd, chi2.ppf(0.99, 2))
    print(f"confirmed false tracks an hour: {3600 * ours / STEPS:.1f}, of the logic alone {3600 * alone / STEPS:.1f}")
    assert min(ours, alone) > 50
    assert abs(ours - alone) < 3.0 * math.sqrt(ours + alone)


def replace_position(nodes, positions):
    return nodes._replace(positions=positions)


def test_new_tracks_cost_no_more_than_a_scan_of_many_nodes_can_afford() -> None:
    """No candidate is made of nodes that are not neighbours: 36 nodes with heavy clutter take one call."""
    nodes, facts = grid(6, 20.0), facts_of(Range(sd=0.5, reach=40.0), clutter=3.0, volume=40.0)
    scans = scans_of(TWO, 0, nodes, facts, np.random.default_rng(4), 0.0, 40.0)
    tracker = Jpda(filter=ExtendedKalman(), management=MOfN(support=5))
    outcome = tracker.step(Belief(0.0), 0.0, scans, nodes, facts, 0)
    places = np.array([one.mean[[0, 2]] for one in tracker.estimates(outcome.belief, facts)])
    for target in TWO[0][:, [0, 2]]:
        assert np.hypot(*(places - target).T).min() < 2.0
