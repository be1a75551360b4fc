"""Trackers of several targets as pure functions of scans: against plain filters, and what no result depends on."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.scenes import make_scene
from tests.helpers.target_scans import MOTION, driven, facts_of, prior_of, ring, scans_of, straight
from wsnsim.base.ports import KnownNodes
from wsnsim.base.requests import GatheredReadings, GatherReadings
from wsnsim.base.scans import Scan
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.ranging import Range
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.imm import InteractingModels
from wsnsim.trackers.multi_target.frames import Belief, Frame, stacked
from wsnsim.trackers.multi_target.management import KnownTargets, MOfN, SequentialTest
from wsnsim.trackers.multi_target.several_gaussians import Lmb, Mht, best_global
from wsnsim.trackers.multi_target.single_gaussian import Gnn, Jpda, LocalNearestNeighbour, Pda
from wsnsim.trackers.sigma_points import CubatureKalman, UnscentedKalman

METHODS = [LocalNearestNeighbour, Gnn, Pda, Jpda, Lmb, Mht]
FILTERS = [ExtendedKalman(), UnscentedKalman(), CubatureKalman(), InteractingModels()]
SENSORS = [Range(sd=1.0, reach=1e3), Bearing(sd=0.02, reach=1e3), RangeBearing(range_sd=1.0, reach=1e3)]
NAMED = {"ids": lambda value: type(value).__name__ if not isinstance(value, type) else value.__name__}


def by_step(facts, truth, nodes, seed, low=0.0, high=150.0):
    rng = np.random.default_rng(seed)
    return [scans_of(truth, step, nodes, facts, rng, low, high) for step in range(1, len(truth))]


def answered(flow, ids, values):
    """What a flow of a filter in a head returns, whose only requests are readings and operations."""
    reply = None
    while True:
        try:
            asked = flow.send(reply)
        except StopIteration as done:
            return done.value
        reply = GatheredReadings(ids, values) if isinstance(asked, GatherReadings) else None


@pytest.mark.parametrize("sensor", SENSORS, **NAMED)
@pytest.mark.parametrize("plain", FILTERS, **NAMED)
def test_with_one_certain_target_each_method_is_the_plain_filter(plain, sensor) -> None:
    nodes, facts = ring(4), facts_of(sensor, probability=1.0, clutter=0.0)
    truth = straight([[-10.0, 2.0, 5.0, -1.0]], 6)
    every, prior = by_step(facts, truth, nodes, 3), prior_of(truth[0, 0], rng=np.random.default_rng(1))
    scenes = [make_scene(step, nodes.ids, nodes.positions, nodes.traits, MOTION, sensor) for step in range(7)]
    beliefs = [answered(plain.start(prior, scenes[0]), (), None)]
    for step, scans in enumerate(every, 1):
        values = np.array([scan.detections[0] for scan in scans])
        values = values if values.shape[1] > 1 else values[:, 0]
        beliefs.append(answered(plain.step(beliefs[-1], scenes[step]), nodes.ids, values))
    for method in METHODS:
        tracker = method(filter=plain, management=KnownTargets(), gate=1.0)
        outcomes = driven(tracker, tracker.begin([prior], 0.0, facts), every, nodes, facts)
        for outcome, belief in zip(outcomes, beliefs[1:], strict=True):
            (found,), expected = tracker.estimates(outcome.belief, facts), plain.estimate(belief)
            assert found.mean == pytest.approx(expected.mean, abs=1e-9, rel=1e-9), method.__name__
            assert found.cov == pytest.approx(expected.cov, abs=1e-9, rel=1e-9), method.__name__
            assert np.concatenate(outcome.explained) == pytest.approx(1.0)


def lmb_enumerated(tracks, likelihoods, components, density, probability):
    """(existence, weights (C, M + 1)) of each track, by visiting every event in which tracks are absent, miss or hit.

    `tracks`: (existence, weights) of each; `components`: of each track the densities (C, M) of all detections.
    """
    count, number = likelihoods, len(tracks)
    totals, weights = np.zeros(number), [np.zeros((len(each[1]), count + 1)) for each in tracks]
    whole = 0.0
    for event in itertools.product(range(-1, count + 1), repeat=number):  # -1: absent, 0: missed
        used = [made for made in event if made > 0]
        if len(used) > len(set(used)):
            continue
        each = []
        for (existence, shares), densities, made in zip(tracks, components, event, strict=True):
            if made < 0:
                each.append(np.array([1.0 - existence]))
            elif made == 0:
                each.append(existence * (1.0 - probability) * shares)
            else:
                each.append(existence * probability * shares * densities[:, made - 1])
        weight = np.prod([part.sum() for part in each]) * density ** (count - len(used))
        whole += weight
        for row, made in enumerate(event):
            if made >= 0:
                totals[row] += weight
                weights[row][:, made] += weight * each[row] / each[row].sum()
    return [(total / whole, share / share.sum()) for total, share in zip(totals, weights, strict=True)]


def test_the_labelled_filter_without_pruning_is_the_enumeration_of_all_events() -> None:
    rng, nodes, sensor = np.random.default_rng(5), ring(1), Range(sd=2.0, reach=1e4)
    for case in range(12):
        count, number = (4, 4) if case == 0 else rng.integers(1, 4, 2)
        facts = facts_of(sensor, probability=rng.uniform(0.5, 0.98), clutter=2.0)
        tracker = Lmb(filter=ExtendedKalman(), management=SequentialTest(), gate=1.0, components=0, prune=0.0)
        means = rng.normal(0.0, 3.0, (number, 2, 4))
        priors = [[prior_of(mean) for mean in two] for two in means]
        tracks = []
        for row, two in enumerate(priors):
            pair = tracker.begin(two, 0.0, facts).tracks
            share = rng.uniform(0.2, 0.8)
            tracks.append(replace(
                pair[0], number=row, bank=stacked(track.bank for track in pair), existence=rng.uniform(0.1, 0.9),
                weights=np.array([share, 1.0 - share]),
            ))  # fmt: skip
        values = np.hypot(*(nodes.positions[0] - means[rng.integers(number, size=count), 0][:, [0, 2]]).T)
        values = np.sort(values + rng.normal(0.0, 3.0, count))
        scan = Scan(nodes.ids[0], 0.0, values[:, None])
        after = tracker.step(Belief(0.0, tuple(tracks)), 0.0, [scan], nodes, facts, 9).belief.tracks
        densities, states = [], []
        for two in priors:
            each = [updated_by(prior, values, nodes.positions[0], 2.0) for prior in two]
            densities.append(np.array([one[0] for one in each]))
            states.append([one[1] for one in each])
        given = [(track.existence, track.weights) for track in tracks]
        truth = lmb_enumerated(given, count, densities, 0.01, facts.probability)
        found = {track.number: track for track in after}
        for row, (existence, weights) in enumerate(truth):
            if existence <= 0.01 / 0.99:  # below it, the test has deleted it
                continue
            assert found[row].existence == pytest.approx(existence, abs=1e-8)
            order = np.argsort(-weights.reshape(-1), kind="stable")
            order = order[weights.reshape(-1)[order] > 0.0]
            assert found[row].weights == pytest.approx(weights.reshape(-1)[order], abs=1e-8)
            flat = [state for one in states[row] for state in one]
            assert found[row].bank.means[:, 0] == pytest.approx(np.array([flat[place][0] for place in order]), abs=1e-8)
            assert found[row].bank.covs[:, 0] == pytest.approx(np.array([flat[place][1] for place in order]), abs=1e-8)


def updated_by(prior, values, position, sd):
    """Densities (M,) of ranges given a Gaussian, and the state unchanged and after each: a filter by the book."""
    apart = prior.mean[[0, 2]] - position
    slope = np.zeros(4)
    slope[[0, 2]] = apart / np.hypot(*apart)
    width = slope @ prior.cov @ slope + sd**2
    off = values - np.hypot(*apart)
    gain = prior.cov @ slope / width
    cov = prior.cov - np.outer(gain, gain) * width
    states = [(prior.mean, prior.cov), *((prior.mean + gain * each, cov) for each in off)]
    return np.exp(-0.5 * off**2 / width) / np.sqrt(2.0 * np.pi * width), states


def crossing(steps=12, apart=6.0):
    """Two targets that cross."""
    return straight([[-apart, 1.0, -apart, 1.0], [-apart, 1.0, apart, -1.0]], steps)


def bytes_of(outcome):
    """Everything of an outcome but the order of `explained`."""
    tracks = [
        (t.number, t.weights.tobytes(), *(p.tobytes() for p in t.bank), t.existence) for t in outcome.belief.tracks
    ]
    return tracks, outcome.events, [np.sort(share).tobytes() for share in outcome.explained]


@pytest.mark.parametrize("method", METHODS, **NAMED)
def test_the_order_of_detections_and_of_scans_changes_no_bit(method) -> None:
    nodes, facts = ring(4), facts_of(Range(sd=1.0, reach=200.0), clutter=2.0)
    every, rng = by_step(facts, crossing(), nodes, 7), np.random.default_rng(8)
    mixed = [[replace(scan, detections=rng.permutation(scan.detections)) for scan in scans] for scans in every]
    tracker = method(filter=ExtendedKalman(), management=MOfN(), gate=0.999)
    one, other = (list(driven(tracker, Belief(0.0), each, nodes, facts)) for each in (every, mixed))
    assert [bytes_of(outcome) for outcome in one] == [bytes_of(outcome) for outcome in other]
    assert any(outcome.belief.tracks for outcome in one)
    last = tracker.step(one[-2].belief, 12.0, mixed[-1][::-1], nodes, facts, 99).belief
    assert [t.bank.means.tobytes() for t in last.tracks] == [
        t.bank.means.tobytes() for t in tracker.step(one[-2].belief, 12.0, every[-1], nodes, facts, 99).belief.tracks
    ]


def test_the_order_of_the_sensors_matters_little() -> None:
    """Probabilities of a scan depend on the ones before.

    Over 20 such runs, the median of the mean difference is 0.07 standard deviations, the greatest 1.3.
    """
    nodes, facts = ring(6), facts_of(Range(sd=1.0, reach=200.0), clutter=4.0)
    truth = crossing(8)
    every = by_step(facts, truth, nodes, 9)
    tracker = Jpda(filter=ExtendedKalman(), management=KnownTargets())
    begun = tracker.begin([prior_of(state) for state in truth[0]], 0.0, facts)
    turned = KnownNodes(nodes.ids[::-1], nodes.positions, nodes.traits)
    again = [[replace(scan, node=25 - scan.node) for scan in scans] for scans in every]
    ends = []
    for scans, known in ((every, nodes), (again, turned)):
        *_, last = driven(tracker, begun, scans, known, facts)
        ends.append(tracker.estimates(last.belief, facts))
    off = [(one.mean - other.mean) / np.sqrt(np.diag(one.cov)) for one, other in zip(*ends, strict=True)]
    assert 1e-6 < np.abs(off).mean() < 0.2


def test_the_global_nearest_neighbour_is_the_most_probable_event() -> None:
    rng = np.random.default_rng(10)
    tracker = Gnn(filter=ExtendedKalman())
    for _ in range(100):
        tracks, count = rng.integers(1, 4, 2)
        likelihoods = rng.exponential(1.0, (tracks, count)) * (rng.random((tracks, count)) < 0.7)
        miss, clutter = rng.uniform(0.05, 0.5, tracks), rng.uniform(0.05, 2.0, count)
        best, truth = -1.0, None
        for event in itertools.product(range(count + 1), repeat=tracks):
            used = [made for made in event if made]
            weight = np.prod([likelihoods[i, made - 1] if made else miss[i] for i, made in enumerate(event)])
            weight *= np.prod([clutter[j] for j in range(count) if j + 1 not in used])
            if len(used) == len(set(used)) and weight > best:
                best, truth = weight, event
        assert tracker.associated(likelihoods, miss, clutter).argmax(axis=1).tolist() == list(truth)


def test_the_nearest_neighbour_may_share_a_detection_and_pda_ignores_other_tracks() -> None:
    likelihoods, miss, clutter = np.array([[0.5, 0.1], [0.4, 0.0]]), np.full(2, 0.1), np.full(2, 0.2)
    local = LocalNearestNeighbour(filter=ExtendedKalman()).associated(likelihoods, miss, clutter)
    assert local.argmax(axis=1).tolist() == [1, 1]
    alone = Pda(filter=ExtendedKalman()).associated(likelihoods, miss, clutter)
    assert alone[1] == pytest.approx([1.0 / 21.0, 20.0 / 21.0, 0.0])
    assert alone[0] == pytest.approx(np.array([0.1, 2.5, 0.5]) / 3.1)


def test_the_best_global_hypothesis_is_that_of_the_enumeration() -> None:
    rng = np.random.default_rng(11)
    for _ in range(12):
        owners = np.repeat(np.arange(3), 3)
        histories = [tuple(((0, int(row)),) for row in rng.integers(0, 3, 2)) for _ in owners]
        scores = rng.normal(0.0, 5.0, len(owners))
        frame = Frame(
            owners, scores, np.ones((9, 1)), np.empty((9, 0)), np.empty((9, 0, 0)), np.ones(3), np.ones((3, 1)),
            np.zeros(3), histories, 4, np.zeros(1), [0],
        )  # fmt: skip
        truth = max(
            itertools.product(*([-1, *range(3 * row, 3 * row + 3)] for row in range(3))),
            key=lambda leaves: global_score(leaves, scores, histories),
        )
        assert best_global(frame) == list(truth)


def global_score(leaves, scores, histories):
    """(number of tracks, sum of scores) of a global hypothesis; -1 where two have a detection in common."""
    leaves = [leaf for leaf in leaves if leaf >= 0]
    taken = [(ago, key) for leaf in leaves for ago, step in enumerate(reversed(histories[leaf])) for key in step]
    return (-1, 0.0) if len(taken) > len(set(taken)) else (len(leaves), sum(scores[leaf] for leaf in leaves))


def test_hypotheses_remember_no_more_steps_than_the_depth_and_are_no_more_than_allowed() -> None:
    nodes, facts = ring(4), facts_of(Range(sd=1.0, reach=200.0), probability=0.7, clutter=5.0)
    truth = crossing(8)
    tracker = Mht(filter=ExtendedKalman(), management=KnownTargets(), depth=2, hypotheses=7)
    begun = tracker.begin([prior_of(state) for state in truth[0]], 0.0, facts)
    silent = tracker.step(begun, 5.0, [], nodes, facts, 2).belief
    later = [[replace(scan, time=scan.time + 5.0) for scan in scans] for scans in by_step(facts, truth, nodes, 3)]
    for outcome in driven(tracker, silent, later, nodes, facts):
        for track in outcome.belief.tracks:
            assert len(track.histories) == len(track.weights) == len(track.bank.means) <= 7
            assert len(set(track.histories)) == len(track.histories)
            assert {len(history) for history in track.histories} <= {1, 2}
    assert max(len(track.weights) for track in outcome.belief.tracks) > 1


@pytest.mark.parametrize("method", METHODS, **NAMED)
def test_two_that_cross_keep_one_track_each(method) -> None:
    nodes, facts = ring(5), facts_of(Range(sd=1.0, reach=200.0), probability=0.95, clutter=1.0)
    truth = crossing(14, 8.0)
    tracker = method(filter=ExtendedKalman(), management=KnownTargets())
    begun = tracker.begin([prior_of(state) for state in truth[0]], 0.0, facts)
    *_, last = driven(tracker, begun, by_step(facts, truth, nodes, 12), nodes, facts)
    found = np.array([one.mean[[0, 2]] for one in tracker.estimates(last.belief, facts)])
    assert np.abs(found - truth[-1][:, [0, 2]]).max() < 3.0


def test_hypotheses_of_two_tracks_go_together_where_a_step_has_more_scans_than_hypotheses_tell_apart() -> None:
    nodes, facts = (
        ring(10),
        facts_of(RangeBearing(range_sd=2.0, bearing_sd=0.07, reach=200.0), probability=0.7, clutter=1.0),
    )
    truth = crossing(20, 3.0)
    tracker = Mht(filter=ExtendedKalman(), management=SequentialTest())
    begun = tracker.begin([prior_of(state) for state in truth[0]], 0.0, facts)
    for outcome in driven(tracker, begun, by_step(facts, truth, nodes, 5), nodes, facts):
        assert {0, 1} <= {track.number for track in outcome.belief.tracks}


def test_a_group_splits_and_merges_by_value() -> None:
    facts = facts_of(Range(sd=1.0, reach=200.0))
    tracker = Jpda(filter=ExtendedKalman())
    places = ([0.0, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0], [90.0, 0.0, 0.0, 0.0], [6.0, 0.0, 0.0, 0.0])
    belief = tracker.begin([prior_of(np.array(place)) for place in places], 2.0, facts, number=5)
    parts = [tracker.only(belief, group) for group in ([5, 6, 8], [7])]
    assert tracker.joined(parts[::-1], 2.0, facts).tracks == belief.tracks
    assert tracker.numbers_of(parts[1]) == 4 + 1 + 4 + 10 and tracker.numbers_of(belief) == 4 * 19


@pytest.mark.parametrize("rules", [MOfN(coast=2), SequentialTest()], **NAMED)
@pytest.mark.parametrize("method", METHODS, **NAMED)
def test_groups_that_merge_count_nothing_for_or_against_their_tracks(method, rules) -> None:
    facts = facts_of(Range(sd=1.0, reach=200.0))
    tracker = method(filter=ExtendedKalman(), management=rules)
    one, other = (
        tracker.begin([prior_of(np.array([place, 1.0, 0.0, 0.0]))], time, facts, number)
        for number, (place, time) in enumerate([(0.0, 2.0), (0.5, 4.0)])
    )
    worn = replace(one, tracks=tuple(replace(track, misses=1, near=((1, 4),), hits=(True,)) for track in one.tracks))
    both = tracker.joined([worn, other], 4.0, facts)
    assert both.time == 4.0 and [track.number for track in both.tracks] == [0, 1]
    first, second = both.tracks
    assert (first.misses, first.near, first.hits) == (1, ((1, 4),), (True,))
    assert first.existence == pytest.approx(rules.survival**2) and second.bank is other.tracks[0].bank
    ahead = tracker.step(one, 4.0, [], KnownNodes((), np.empty((0, 2)), np.empty((0, 0))), facts, 2).belief
    np.testing.assert_array_equal(first.bank.means, ahead.tracks[0].bank.means)


def separation(method, apart, runs=10, steps=40, far=1e4):
    """(mean, standard error) of how far apart two tracks are of targets that move in parallel, seen as by a far radar.

    A detection has an error of 1 m along each axis.
    """
    nodes = ring(1)._replace(positions=np.array([[-far, 0.0]]))
    sensor = RangeBearing(range_sd=1.0, bearing_sd=1.0 / far, reach=2.0 * far)
    facts = facts_of(sensor, clutter=1.0, volume=1e4 / far)
    truth = straight([[0.0, 1.0, -apart / 2.0, 0.0], [0.0, 1.0, apart / 2.0, 0.0]], steps)
    tracker, found = method(filter=ExtendedKalman(), management=KnownTargets(), gate=0.999), []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        every = [
            scans_of(truth, step, nodes, facts, rng, [far - 50.0, -50.0 / far], [far + 90.0, 50.0 / far])
            for step in range(1, steps + 1)
        ]
        begun = tracker.begin([prior_of(state, (1.0, 0.3, 1.0, 0.3), rng) for state in truth[0]], 0.0, facts)
        ends = [tracker.estimates(o.belief, facts) for o in driven(tracker, begun, every, nodes, facts)]
        found.append(np.mean([abs(one.mean[2] - other.mean[2]) for one, other in ends[steps // 3 :]]))
    return float(np.mean(found)), float(np.std(found) / np.sqrt(runs))


@pytest.mark.thorough
def test_tracks_of_jpda_coalesce_where_those_of_the_labelled_filter_and_of_mht_stay_apart() -> None:
    """As Fitzgerald (1985) explains. Over 20 runs with targets 2 m apart: JPDA 0.6 m, LMB 2.3, MHT 2.4, GNN 2.3."""
    mean, error = separation(Jpda, 2.0)
    assert mean + 3.0 * error < 1.2
    for method in (Gnn, Lmb, Mht):
        mean, error = separation(method, 2.0)
        assert mean - 2.0 * error > 1.8 and mean + 2.0 * error < 2.8, method.__name__
