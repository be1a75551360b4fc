"""Which members send, and what a head learns from those that are silent."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import wsnsim
from wsnsim import ScenarioError
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.silence import HeardReadings, SharedEstimate
from wsnsim.trackers.shared.triggers import Event, Stochastic

NONE = Evidence((), np.empty(0), np.zeros((0, 2)), np.zeros((0, 0)))
MEAN, COV = np.array([1.0, -0.5]), np.array([[4.0, 0.6], [0.6, 0.5]])
NOISE = 1.5


class Line:
    """A sensor that measures the position on a line: linear, so that moments can be exact."""

    def linearise(self, points, positions, traits):
        count = len(positions)
        return (np.tile(points, (count, 1)), np.ones((count, 1, points.shape[1])),
                np.full((count, points.shape[1]), NOISE))  # fmt: skip


def silent(trigger, shared_mean, shared_variance, count=1):
    """Moments after the silence of some members, and the scene."""
    scene = SimpleNamespace(
        motion=SimpleNamespace(position=(0,)), sensor=Line(), step=3, dt=1.0,
        positions=np.zeros((count, 2)), traits=np.zeros((count, 0)),
    )  # fmt: skip
    shared = SharedEstimate(np.array([shared_mean]), np.array([[shared_variance]]), 3)
    return HeardReadings(NONE, shared, tuple(range(count)), trigger).with_silence(MEAN, COV, scene)


def posterior(trigger, shared_mean, shared_variance):
    """Mean and variance of the position by numerical integration over position and reading."""
    x = np.linspace(-25.0, 25.0, 1501)
    z = np.linspace(-40.0, 40.0, 4001)
    spread = shared_variance + NOISE
    if isinstance(trigger, Event):
        chance = (np.abs(z - shared_mean) * (shared_variance / spread) <= trigger.threshold).astype(float)
    else:
        chance = np.exp(-0.5 * (z - shared_mean) ** 2 / (trigger.width**2 * spread))
    heard_not = trigger.loss + (1.0 - trigger.loss) ** 3 * chance  # and the two packets of the broadcast
    likelihood = stats.norm.pdf(z[None], x[:, None], NOISE**0.5) @ heard_not
    weights = likelihood * stats.norm.pdf(x, MEAN[0], COV[0, 0] ** 0.5)
    weights /= weights.sum()
    mean = weights @ x
    return mean, weights @ (x - mean) ** 2


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("kind", [Event(threshold=0.8), Event(threshold=3.0), Stochastic(width=0.7)], ids=str)
@pytest.mark.parametrize("shared", [(1.0, 4.0), (-1.5, 2.0)])
def test_silence_gives_the_moments_of_the_exact_posterior(kind, loss, shared):
    trigger = type(kind)(**{**vars(kind), "loss": loss})
    mean, cov = silent(trigger, *shared)
    wanted = posterior(trigger, *shared)
    assert (mean[0], cov[0, 0]) == pytest.approx(wanted, rel=5e-3, abs=5e-3)
    # the velocity follows by its regression on the position
    assert mean[1] == pytest.approx(MEAN[1] + COV[0, 1] / COV[0, 0] * (mean[0] - MEAN[0]))
    assert np.linalg.eigvalsh(cov).min() > 0.0


def test_a_silence_of_many_members_stays_a_covariance_and_one_that_cannot_be_is_left_out():
    _, cov = silent(Event(threshold=0.05), 1.0, 4.0, count=500)
    assert np.linalg.eigvalsh(cov).min() > 0.0
    mean, cov = silent(Event(threshold=0.01), 1e6, 4.0)
    assert np.array_equal(mean, MEAN) and np.array_equal(cov, COV)


def run(trigger, replicates=2, tracker="ekf", **changes):
    tracker = {"kind": tracker, "trigger": trigger}
    return wsnsim.run("event_triggered", tracker=tracker, replicates=replicates, progress=False, **changes)


def sent(result):
    events = result.table("events")
    return events[(events["kind"] == "send") & (events["what"] == "reading")]


def squares(result):
    return result.table("estimates")["error"].to_numpy() ** 2


@pytest.mark.parametrize("tracker", ["ekf", "ukf", "ckf"])
def test_a_threshold_that_every_reading_exceeds_gives_the_estimates_of_sending_always(tracker):
    always, event = (
        run(trigger, 1, tracker, duration="6 s")
        for trigger in ({"kind": "always"}, {"kind": "event", "threshold": 1e-9})
    )
    columns = ["px", "vx", "py", "vy", "sd_x", "sd_y", "readings"]
    one, other = (result.table("estimates")[columns].to_numpy() for result in (always, event))
    assert np.allclose(one, other, rtol=1e-6)
    assert len(sent(always)) == len(sent(event))
    # what it costs to share the estimate is paid
    assert event.table("runs")["energy"][0] > 1.1 * always.table("runs")["energy"][0]


def test_periodic_members_send_in_turn():
    times = sent(run({"kind": "periodic", "every": 4}, 1)).groupby("node")["time"].apply(list)
    assert len(times) > 10
    assert all((np.round(each) + node).astype(int).tolist() == pytest.approx(
        [4 * (round(value + node) // 4) for value in each]) for node, each in times.items())  # fmt: skip


def test_random_members_send_with_their_probability():
    share = len(sent(run({"kind": "random", "probability": 0.3}))) / len(sent(run({"kind": "always"})))
    assert share == pytest.approx(0.3, abs=0.03)


def test_members_that_heard_no_estimate_send():
    # every broadcast of two packets is lost now and then, and then its readings are sent
    lossy = {"kind": "disk", "reach": "200 m", "loss": 0.3}
    event = {"kind": "event", "threshold": 1e6}
    share = len(sent(run(event, link=lossy))) / len(sent(run({"kind": "always"}, link=lossy)))
    assert share == pytest.approx(1.0 - 0.7**2, abs=0.05)
    assert len(sent(run(event))) == 0


def test_a_shared_estimate_lasts_for_as_many_steps_as_it_says():
    event = {"kind": "event", "threshold": 1e6, "shared_every": 10}
    result = run(event, 1)
    events = result.table("events")
    shared = events[(events["kind"] == "send") & (events["what"] == "shared_estimate")]
    assert np.diff(np.round(shared["time"])).tolist() == [10.0] * (len(shared) - 1) and len(shared) > 2
    # those send that began to sense after the last broadcast, until the next
    readings, broadcasts = sent(result), set(np.round(shared["time"]).astype(int))
    assert not readings["step"].isin(broadcasts).any()
    assert 0 < len(readings) < 0.2 * len(sent(run({"kind": "always"}, 1)))


def test_a_moving_head_that_uses_silence_goes_on_where_no_member_sends():
    def track(silence):
        tracker = {"kind": "ekf", "trigger": {"kind": "event", "threshold": "1000 m", "silence": silence}}
        result = wsnsim.run("gmtt", tracker=tracker, seed=2, duration="14 s", replicates=1, progress=False)
        return result.table("estimates")

    used, ignored = track("used"), track("ignored")
    assert (used["readings"] == 0).any() and np.isfinite(used["error"]).all()
    assert not np.isfinite(ignored["error"]).all()


def diffusion(replicates=1, **parameters):
    """A network without a head, whose nodes hear those within 40 m."""
    return wsnsim.run(
        "event_triggered", tracker={"kind": "diffusion", **parameters}, clusters={"kind": "none"},
        link={"kind": "disk", "reach": "40 m"}, replicates=replicates, progress=False,
    )  # fmt: skip


def frames(result, what):
    events = result.table("events")
    return events[(events["kind"] == "send") & (events["what"] == what)]


def test_diffusion_with_a_threshold_that_all_exceed_is_diffusion():
    always, event = diffusion(), diffusion(threshold=1e-12, heartbeat=1)
    assert np.allclose(squares(always), squares(event), rtol=1e-6)
    assert [len(frames(result, "estimate")) for result in (always, event)] == [len(frames(always, "estimate"))] * 2


def test_diffusion_at_events_sends_and_spends_less():
    always, event = diffusion(), diffusion(threshold=1.0)
    assert len(frames(event, "information")) < 0.4 * len(frames(always, "information"))
    assert event.table("runs")["energy"][0] < 0.7 * always.table("runs")["energy"][0]


def test_diffusion_sends_an_estimate_at_every_heartbeat_even_if_it_is_no_news():
    steps = frames(diffusion(threshold=1e6, heartbeat=5), "estimate").groupby("node")["step"].apply(list)
    gaps = [gap for each in steps for gap in np.diff(each)]
    assert len(frames(diffusion(threshold=1e6), "information")) == 0
    # a node that left and came back begins again
    assert len(gaps) > 20 and np.mean(np.equal(gaps, 5)) > 0.8


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sensor": {"kind": "range_bearing", "reach": "50 m"}}, "not readings of several components"),
        ({"sensor": {"kind": "binary"}}, "use periodic or random"),
        (
            {
                "sensor": {
                    "kind": "quantised",
                    "bits": 2,
                    "thresholds": "lloyd_max",
                    "law": {"kind": "range", "reach": "50 m"},
                },
                "tracker": {"kind": "ckf", "trigger": {"kind": "periodic"}},
            },
            "thresholds about a prediction are sent to all members",
        ),
        ({"tracker": {"kind": "ekf", "readings": "nearest", "trigger": {"kind": "event"}}}, "use all readings"),
        ({"tracker": {"kind": "ukf", "late": "refilter", "trigger": {"kind": "event"}}}, "use trigger: always"),
        ({"tracker": {"kind": "ekf", "trigger": {"kind": "event", "threshold": 0}}}, "greater than 0"),
        ({"tracker": {"kind": "diffusion", "heartbeat": 3}, "clusters": {"kind": "none"}}, "without a threshold"),
        ({"tracker": {"kind": "pf", "trigger": {"kind": "event"}}}, "unknown key"),
        ({"tracker": {"kind": "ekf", "trigger": {"kind": "evnt"}}}, "did you mean 'event'"),
    ],
)
def test_what_a_trigger_cannot_do_is_one_message(changes, message):
    with pytest.raises(ScenarioError, match=message):
        wsnsim.simulate("event_triggered", **changes)


@pytest.mark.thorough
def test_silence_is_worth_having_and_must_not_be_trusted_where_frames_are_lost():
    used, ignored = (squares(run({"kind": "event", "silence": each}, 30)) for each in ("used", "ignored"))
    assert used.mean() < ignored.mean()

    def nees(loss):
        link = {"kind": "disk", "reach": "200 m", "loss": 0.3}
        trigger = {"kind": "event", "threshold": 1.0, "loss": loss, "shared_every": 10}
        return run(trigger, 30, link=link).table("estimates")["nees"].median()

    assert nees(0.0) > nees(0.3)
