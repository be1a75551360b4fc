"""Interacting multiple models: twins, the Kalman filter of one model, unequal columns, lost modes, and packets."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import wsnsim
from tests.helpers.linear_cluster import Cluster, F, LinearMotion, LinearSensor, kalman, sent
from tests.helpers.losses import losing
from wsnsim import experiment, scenario
from wsnsim.base.arrays import Estimate
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.mobility import CoordinatedTurn
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.imm import InteractingModels

CALM, ROUGH = LinearMotion(0.1), LinearMotion(40.0)
CV, CT = ConstantVelocity(variances=(0.5,)), CoordinatedTurn(q=0.2, turn_q=0.05)
CHAIN = ((0.9, 0.1), (0.3, 0.7))


def bank_of(belief) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(probability, mean, covariance) of each mode."""
    bank = belief.bank
    return [(bank.chances[mode], bank.means[:, mode], bank.covs[mode]) for mode in range(bank.chances.size)]


def by_hand(modes, chain, motions, readings, traits):
    """A step of the estimator in the book's loops, for a linear world in which F moves every mode."""
    count, after = len(modes), []
    for j in range(count):
        predicted = sum(chain[i][j] * modes[i][0] for i in range(count))
        shares = [chain[i][j] * modes[i][0] / predicted for i in range(count)]
        mean = sum(share * one[1] for share, one in zip(shares, modes, strict=True))
        cov = sum(
            share * (one[2] + np.outer(one[1] - mean, one[1] - mean)) for share, one in zip(shares, modes, strict=True)
        )
        mean, cov = F @ mean, F @ cov @ F.T + motions[j].noise
        rise = np.zeros((len(readings), 4))
        rise[:, [0, 2]] = traits
        width, error = rise @ cov @ rise.T + 2.0 * np.eye(len(readings)), readings - rise @ mean
        gain = cov @ rise.T @ np.linalg.inv(width)
        likelihood = np.exp(-0.5 * error @ np.linalg.inv(width) @ error) / np.sqrt(np.linalg.det(2.0 * np.pi * width))
        after.append((predicted * likelihood, mean + gain @ error, cov - gain @ rise @ cov))
    total = sum(one[0] for one in after)
    return [(one[0] / total, *one[1:]) for one in after]


@pytest.mark.thorough
@pytest.mark.parametrize("transition", [None, CHAIN], ids=["stay", "a matrix"])
def test_it_is_the_estimator_of_the_book_in_a_linear_world(transition) -> None:
    cluster, tracker = Cluster(5), InteractingModels(models=(CALM, ROUGH), stay=0.8, transition=transition)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    modes = [(0.5, cluster.prior.mean, cluster.prior.cov)] * 2
    for step in range(1, 31):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        modes = by_hand(modes, transition or ((0.8, 0.2), (0.2, 0.8)), (CALM, ROUGH), *cluster.readings())
        for ours, theirs in zip(bank_of(belief), modes, strict=True):
            for one, other in zip(ours, theirs, strict=True):
                assert one == pytest.approx(other, rel=1e-7, abs=1e-7)
        mean = sum(chance * each for chance, each, _ in modes)
        cov = sum(chance * (spread + np.outer(each - mean, each - mean)) for chance, each, spread in modes)
        assert belief.mean == pytest.approx(mean, rel=1e-7) and belief.cov == pytest.approx(cov, rel=1e-7, abs=1e-7)
        assert tracker.report_state(belief)["mode_probability"].sum() == pytest.approx(1.0)


def test_one_model_or_two_equal_ones_are_the_kalman_filter_and_have_no_innovation() -> None:
    for models in ((CALM,), (CALM, CALM)):
        cluster, tracker = Cluster(5), InteractingModels(models=models)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        mean, cov = cluster.prior.mean, cluster.prior.cov
        for step in range(1, 11):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
            mean, cov = kalman(mean, cov, CALM.noise, *cluster.readings())
            assert belief.mean == pytest.approx(mean, rel=1e-8, abs=1e-8)
            assert belief.cov == pytest.approx(cov, rel=1e-7, abs=1e-7)
        assert belief.bank.chances == pytest.approx(np.full(len(models), 1.0 / len(models)))
        assert tracker.estimate(belief).innovation.dof == 0


def test_without_a_list_the_modes_are_the_assumed_motion_and_a_rougher_one() -> None:
    cluster = Cluster(4, CV, Range(sd=0.5, reach=200.0))
    plain, listed = InteractingModels(manoeuvre=30.0), InteractingModels(models=(CV, CV.assumed(30.0)))
    ends = []
    for tracker in (plain, listed):
        cluster.renew()
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        for step in range(1, 6):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        ends.append(belief)
    assert np.array_equal(ends[0].mean, ends[1].mean) and np.array_equal(*(end.bank.chances for end in ends))


def test_a_column_that_a_model_lacks_stays_as_it_is_and_the_estimate_has_those_of_the_scenario() -> None:
    cluster = Cluster(4, CV, Range(sd=0.5, reach=200.0))
    tracker = InteractingModels(models=(CV, CT), stay=1.0, added_sd=0.3)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert belief.bank.means[4].tolist() == [0.0, 0.0]
    assert belief.bank.covs[:, 4, 4] == pytest.approx([0.09, 0.09])
    after, _ = cluster.drive(tracker.step(belief, cluster.scene(1, ())))
    assert after.bank.covs[:, 4, 4] == pytest.approx([0.09, 0.09 + 0.05 * cluster.dt])
    assert after.bank.covs[0, 4, :4].tolist() == [0.0] * 4 and np.abs(after.bank.covs[1, 4, :4]).max() > 0.0
    assert after.mean.shape == (4,) and after.cov.shape == (4, 4)
    assert after.bank.means[:4, 0] == pytest.approx(CV.advance(cluster.prior.mean[:, None], cluster.dt)[:, 0])


def test_a_scenario_whose_state_has_the_turn_rate_is_estimated_with_it() -> None:
    """The target's own motion may be the widest: the models' order does not matter, and nothing is added."""
    rng = np.random.default_rng(2)
    truth = CT.truth(60, 0.2, rng)
    cluster = Cluster(5, CT, Range(sd=0.3, reach=500.0), reach=60.0)
    cluster.truth, cluster.dt = truth, 0.2
    tracker = InteractingModels(models=(CT, CV))
    prior = Estimate(truth[0] + [1.0, 0.5, -1.0, 0.5, 0.05], np.diag([4.0, 1.0, 4.0, 1.0, 0.04]))
    belief, _ = cluster.drive(tracker.start(prior, cluster.scene(0)))
    assert np.array_equal(belief.bank.covs[0], prior.cov)
    for step in range(1, 61):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
    assert belief.mean.shape == (5,) and np.hypot(*(belief.mean - truth[60])[[0, 2]]) < 1.0


def test_missed_steps_are_mixed_and_predicted_as_the_forecast_is() -> None:
    cluster, tracker = Cluster(5), InteractingModels(models=(CALM, ROUGH), transition=CHAIN)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    ahead = tracker.forecast(belief, cluster.scene(1), 3)
    once, _ = cluster.drive(tracker.step(belief, cluster.scene(4, (), steps=3)))
    each = belief
    for step in (2, 3, 4):
        each, _ = cluster.drive(tracker.step(each, cluster.scene(step, ())))
    for other in (once, each):
        assert np.array_equal(ahead.mean, other.mean) and np.array_equal(ahead.cov, other.cov)
    assert each.bank.chances == pytest.approx(belief.bank.chances @ np.linalg.matrix_power(np.array(CHAIN), 3))
    unheard, _ = cluster.drive(tracker.step(belief, cluster.scene(2, cluster.ids[1:])), silent)
    assert np.array_equal(unheard.mean, tracker.forecast(belief, cluster.scene(1), 1).mean)


def test_a_mode_that_cannot_be_entered_starts_from_itself_and_impossible_readings_change_no_probability() -> None:
    cluster, tracker = Cluster(5), InteractingModels(models=(CALM, ROUGH), transition=((1.0, 0.0), (1.0, 0.0)))
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(2)))
    assert belief.bank.chances.tolist() == [1.0, 0.0] and np.isfinite(belief.bank.covs).all()

    class Blind(LinearSensor):
        def linearise(self, points, positions, traits):
            expected, gradients, variances = super().linearise(points, positions, traits)
            return np.full(expected.shape, np.nan), gradients, variances

    blind = Cluster(5, LinearMotion(), Blind())
    after, _ = blind.drive(tracker.step(belief, blind.scene(3)))
    assert np.isfinite(after.mean).all() and after.bank.chances.tolist() == [1.0, 0.0]


def test_a_handover_carries_every_mode_and_goes_on_with_those_that_arrive() -> None:
    cluster, tracker = Cluster(6, CV, Range(sd=0.5, reach=200.0)), InteractingModels(models=(CV, CT, CV.assumed(50.0)))
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    for step in (1, 2, 3):
        belief, heard = cluster.drive(tracker.step(belief, cluster.scene(step)))
    assert sent(heard, cluster.head) == {"^reading": 5}
    scene, each = cluster.scene(3), 2 + 4  # five columns: two packets of a mean, four of a covariance
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", 3 * each + 1)] and after.head == 7
    assert np.array_equal(after.mean, belief.mean) and np.array_equal(after.bank.means, belief.bank.means)

    after, _ = cluster.drive(tracker.hand_over(belief, scene, 7), losing([each + 2], "handover"))
    bank, chances = after.bank, belief.bank.chances
    assert np.array_equal(bank.means[:, [0, 2]], belief.bank.means[:, [0, 2]]) and np.array_equal(bank.chances, chances)
    rest = chances[[0, 2]] / chances[[0, 2]].sum()
    assert bank.means[:, 1] == pytest.approx(belief.bank.means[:, [0, 2]] @ rest)
    around = belief.bank.means[:, [0, 2]] - bank.means[:, [1]]
    spread = np.tensordot(rest, belief.bank.covs[[0, 2]], 1) + (around * rest) @ around.T
    assert bank.covs[1] == pytest.approx(spread)

    after, _ = cluster.drive(tracker.hand_over(belief, scene, 7), losing([3 * each], "handover"))
    assert after.bank.chances == pytest.approx(np.full(3, 1.0 / 3.0)), "the packet of the probabilities is lost"
    for packets in (slice(None), [0, each, 2 * each]):
        assert cluster.drive(tracker.hand_over(belief, scene, 7), losing(packets, "handover"))[0] is None


def test_a_step_costs_what_is_counted() -> None:
    cluster, tracker = Cluster(6), InteractingModels(models=(CALM, ROUGH))
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    a_reading = (4 * 2 + 2 * 2 * 4 + 20) + 3 * 4 + 8 * 16
    of_a_mode = 6 * a_reading + 6 * (2 * 4 + 2) + 4 * 8 + 10 + 2 * 4 + 3 * 16
    mixing = 2 + 2 * 4 + 3 * 16
    assert heard.cycles == {cluster.head: 2 * (2 * mixing + 4 * 64 + 2 * 16) + 2 * of_a_mode}


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("models: [{kind: constant_velocity}, {kind: constant_acceleration}]", "lacks ax of another model"),
        ("models: [{kind: ungm}]", "lacks px, vx, py, vy of the scenario's motion"),
        ("transition: [[0.5, 0.5]]", r"tracker\.transition: 2 modes need 2 rows of 2 probabilities"),
        ("transition: [[0.5, 0.4], [0, 1]]", r"tracker\.transition: row 0 must add up to 1, adds up to 0\.9"),
        ("models: {kind: constant_velocity}", "expected a list of motions, got a mapping"),
        ("models: [{kind: constant_velocty}]", r"models\.0\.kind: unknown motion .*did you mean 'constant_velocity'"),
        ("models: [{kind: coordinated_turn, q: -1}]", r"models\.0\.q: must be at least 0"),
    ],
)
def test_models_that_do_not_fit_are_refused_with_the_reason(said: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario.build(scenario.load("jiang_field", [f"tracker={{kind: imm, {said}}}"]))


@pytest.mark.thorough
def test_a_scenario_in_which_the_models_have_no_position_in_common_is_refused() -> None:
    with pytest.raises(ScenarioError, match="lacks py, vy of the scenario's motion"):
        scenario.build(scenario.load("jiang_field", ["tracker={kind: imm, models: [{kind: constant_acceleration}]}"]))
    line = InteractingModels(models=(ConstantAcceleration(), ConstantAcceleration(q=1e-3)))
    check_tracker(line, ConstantAcceleration(), Range())


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("tracker", "motion"),
    [
        (InteractingModels(), None),
        (InteractingModels(models=(CV, CT)), CV),
        (InteractingModels(models=(CT, CV), transition=CHAIN), CT),
    ],
    ids=["one motion", "unequal columns", "the turn rate is known"],
)
def test_it_keeps_the_rules_of_the_interface(tracker, motion) -> None:
    if motion is None:
        check_tracker(tracker)
    else:
        check_tracker(tracker, motion, AcousticEnergy())


@pytest.mark.thorough
@pytest.mark.parametrize("extra", [(), ("network=none",)], ids=["in a network", "standalone"])
def test_the_mode_probabilities_follow_the_turns_and_the_error_is_below_that_of_one_filter(extra) -> None:
    memory = Memory({**RECORDED_BY_DEFAULT, "tracker_state": True})
    rmse = experiment.simulate_run(scenario.load("imm", extra), 0, memory).run["rmse"]
    table = memory.table("tracker_state")
    assert memory.state_names.all() == ("mode_probability",)
    turning = table["value"][table["index"] == 1]
    time = table["step"][table["index"] == 1] * 0.2
    turns = ((time > 6.4) & (time <= 10.0)) | ((time > 15.4) & (time <= 21.0))
    settled = ((time > 1.0) & (time < 6.0)) | ((time > 11.0) & (time < 15.0)) | (time > 22.0)
    assert turning[turns].mean() > 0.7 and turning[settled].mean() < 0.25
    alone = experiment.simulate_run(scenario.load("imm", ["tracker={kind: ekf}", *extra]), 0, Memory()).run["rmse"]
    assert rmse < 0.9 * alone


@pytest.mark.thorough
def test_listed_models_are_stored_set_and_swept(tmp_path) -> None:
    loaded = scenario.load("imm", ["tracker.models.1.q=0.3", "duration=1.2 s"])
    kept = scenario.resolved(loaded)["tracker"]["models"]
    assert [one["kind"] for one in kept] == ["constant_velocity", "coordinated_turn"] and kept[1]["q"] == 0.3
    again = wsnsim.load(scenario.resolved(loaded))
    assert scenario.build(again).tracker == scenario.build(loaded).tracker
    report = wsnsim.experiment.run(loaded, replicates=1, out=tmp_path / "x.h5", progress=None)
    table = wsnsim.read(report.out, "tracker_state")
    assert set(table["name"]) == {"mode_probability"} and len(table) == 2 * 5
    points = {"scenario": loaded.file, "set": {"duration": 0.4}, "replicates": 1,
              "grid": {"tracker.models.0.variances": [[0.1], [1.0]]}}  # fmt: skip
    done = wsnsim.sweep(points, out=tmp_path / "sweep", workers=1)
    assert done is not None


def test_the_truth_of_the_scenario_turns_where_it_says() -> None:
    motion = scenario.build(scenario.load("imm")).motions[0]
    points = np.array(motion.points)
    moves = np.diff(points[:, 1:], axis=0)
    heading = np.unwrap(np.arctan2(moves[:, 1], moves[:, 0]))
    assert heading[-1] - heading[0] == pytest.approx(np.pi / 2 - np.pi, abs=0.01)
    assert all(later > earlier for earlier, later in pairwise(points[:, 0]))
    assert np.hypot(*moves.T) / np.diff(points[:, 0]) == pytest.approx(np.full(len(moves), 16.0), rel=0.01)
