"""Appointed clusters in networks that sleep: whom heads wake, and how tracks start again."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.sleeping_networks import Run as SleepingRun
from tests.helpers.sleeping_networks import scenario
from wsnsim.network.clusters.appointing import AppointingProtocol
from wsnsim.network.clusters.cluster import AppointedCluster


@pytest.mark.thorough
def test_the_head_wakes_nodes_before_its_first_step_and_those_woken_are_members():
    said = scenario("gmtt", clusters={"kind": "appointed"}, duration=30.0) | {"tracker": {"kind": "ekf"}}
    run = SleepingRun(said)
    rounds, estimates = run.table("wakeups"), run.table("estimates")
    started = [row["step"] for row in run.events("elect")]
    assert started and started[0] + 1 in rounds["step"].tolist()
    joined = {(row["step"], row["node"]) for row in run.events("join")}
    assert any(step > started[0] for step, _ in joined)
    assert estimates["readings"].max() >= 5
    run.books()


def test_a_track_that_starts_from_too_few_readings_starts_again_from_those_of_the_nodes_that_were_woken():
    asleep = {"kind": "ris", "period": 10.0, "probability": 0.03}
    said = scenario("gmtt", clusters={"kind": "appointed"}, sleep=asleep, duration=100.0)
    run = SleepingRun(said | {"tracker": {"kind": "ekf"}}, 1)
    estimates, restarts = run.table("estimates"), run.events("elect")
    assert restarts
    first = restarts[0]["step"]
    few = estimates["readings"][estimates["step"] == first]
    assert few.size == 0 or few[0] < 3
    after = estimates["error"][(estimates["step"] > first) & (estimates["step"] <= first + 3)]
    assert np.nanmin(after) < 10.0


@pytest.mark.thorough
def test_no_message_wakes_a_region_in_which_everybody_is_a_member_already():
    said = scenario("gmtt", clusters={"kind": "appointed"}, duration=60.0, step=0.5) | {"tracker": {"kind": "ekf"}}
    run = SleepingRun(said | {"acquire": {}})
    rounds, estimates = run.table("wakeups")["step"], run.table("estimates")
    tracked = np.isfinite(estimates["error"])
    assert tracked.sum() > 100
    assert 3 < np.unique(rounds).size < 0.5 * tracked.sum()
    assert np.nanmedian(estimates["readings"]) >= 6, "members stay awake, as long as the cluster is theirs"
    run.books()


@pytest.mark.thorough
def test_a_head_knows_only_of_those_from_which_a_packet_has_arrived_that_they_need_no_waking(monkeypatch):
    asked: list[tuple[int, int, set[int], set[int], bool]] = []

    def must_call(cluster, nodes):
        answered = set(cluster._answered)
        needed = original(cluster, nodes)
        asked.append((cluster._network.clock.step, cluster.head, set(nodes), answered, needed))
        return needed

    original = AppointedCluster.must_call
    monkeypatch.setattr(AppointedCluster, "must_call", must_call)
    said = scenario("gmtt", clusters={"kind": "appointed"}, duration=20.0, step=0.5) | {"tracker": {"kind": "ekf"}}
    run = SleepingRun(said | {"acquire": {}})
    arrived = {(row["node"], row["peer"]): row["step"] for row in reversed(run.events("receive", what="reading"))}
    assert sum(len(answered) for _, _, _, answered, _ in asked) > 100
    for step, head, nodes, answered, needed in asked:
        assert all(arrived[head, node] <= step for node in answered - {head})
        assert not (needed and nodes <= answered)
    first = {head: (nodes, answered, needed) for _, head, nodes, answered, needed in reversed(asked)}
    assert all(needed for nodes, answered, needed in first.values() if nodes - answered)


@pytest.mark.thorough
def test_no_member_sends_a_reading_twice_and_memories_stand_when_a_track_starts_again(monkeypatch):
    started: list[bool] = []

    def start_anew(protocol, lead):
        before = dict(lead.cluster.members)
        yield from original(protocol, lead)
        assert all(lead.cluster.members[node] is member for node, member in before.items())
        started.append(not lead.tentative)

    original = AppointingProtocol._start_anew
    monkeypatch.setattr(AppointingProtocol, "_start_anew", start_anew)
    asleep = {"kind": "ris", "period": 10.0, "probability": 0.03}
    said = scenario("gmtt", clusters={"kind": "appointed"}, sleep=asleep, duration=100.0, mac={"kind": "ideal"})
    for enough in (3, 5, 100):
        monkeypatch.setattr(AppointingProtocol, "_enough", lambda self, track, enough=enough: enough)
        run = SleepingRun(said | {"tracker": {"kind": "ekf"}}, 1)
        assert run.events("elect")
        sent = [(row["step"], row["node"]) for row in run.events("send", what="reading")]
        assert sent and len(sent) == len(set(sent))
        run.books()
    assert set(started) == {True, False}, "sometimes enough readings arrived, sometimes not"
