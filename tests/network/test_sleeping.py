"""Sleeping networks: which nodes are awake, what that costs, whom wake-up messages reach, and reacquisition."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.helpers.sleeping_networks import PAIRS, Run, scenario
from tests.helpers.thorough import thorough
from wsnsim import experiment
from wsnsim import scenario as scenarios
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import simulate_run
from wsnsim.models.access import Csma
from wsnsim.network.clusters.network_view import TargetSearch
from wsnsim.network.radio.channel import Channel
from wsnsim.network.sensing import ContinuousSensing
from wsnsim.trackers.ekf import ExtendedKalman


@pytest.fixture(scope="module")
def floods() -> list[Run]:
    """Runs with steps so long that wake-up messages must be forwarded."""
    said = scenario(step=10.0, duration=200.0, motion={"kind": "random_waypoint", "width": 300.0, "height": 300.0,
                                                      "speed": [4.0, 8.0]})  # fmt: skip
    return [Run(said, replicate) for replicate in range(4)]


def places(run: Run) -> np.ndarray:
    """(N, 2)."""
    nodes = run.table("nodes")
    return np.column_stack([nodes["x"], nodes["y"]])


@pytest.mark.thorough
def test_a_node_that_forwards_a_message_is_nearer_to_the_prediction_than_its_sender(floods):
    checked = 0
    for run in floods:
        wakeups, where = run.table("wakeups"), places(run)
        centres = {int(s): (x, y) for s, x, y in zip(*(wakeups[k] for k in ("sequence", "x", "y")), strict=True)}
        heard: dict[tuple[int, int], list[tuple[float, int]]] = {}
        for row in run.events("receive", what="track"):
            heard.setdefault((row["node"], row["sequence"]), []).append((row["time"], row["peer"]))
        for row in run.events("relay", what="track"):
            centre = np.array(centres[row["sequence"]])
            sender = min(pair for pair in heard[row["node"], row["sequence"]] if pair[0] <= row["time"])[1]
            assert math.dist(where[row["node"]], centre) < math.dist(where[sender], centre)
            checked += 1
    assert checked > 20


@pytest.mark.thorough
def test_no_node_forwards_a_message_twice(floods):
    for run in floods:
        forwards = [(row["node"], row["sequence"]) for row in run.events("relay", what="track")]
        assert len(forwards) == len(set(forwards))
    assert sum(len(run.events("relay", what="track")) for run in floods) > 20


@pytest.mark.thorough
def test_tracking_nodes_are_in_the_region_and_forwarding_nodes_are_not(floods):
    for run in floods:
        wakeups, where = run.table("wakeups"), places(run)
        for row in run.events("relay", what="track"):
            i = int(np.flatnonzero(wakeups["sequence"] == row["sequence"])[0])
            assert math.dist(where[row["node"]], (wakeups["x"][i], wakeups["y"][i])) >= wakeups["radius"][i]


def test_the_table_of_messages_counts_what_the_events_say(floods):
    for run in floods:
        wakeups = run.table("wakeups")
        relays = [row["sequence"] for row in run.events("relay", what="track")]
        for sequence, forwards in zip(wakeups["sequence"].tolist(), wakeups["forwards"].tolist(), strict=True):
            assert relays.count(sequence) == forwards
        assert wakeups["called"].sum() == len(run.events("called"))


def test_a_message_of_five_positions_has_33_bytes(floods):
    sizes = {row["bits"] for run in floods for row in run.events("send", what="track")}
    assert sizes == {(6 + 9 + 33 + 2) * 8}, "PHY overhead, MAC header, payload, frame check"


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", PAIRS)
def test_every_joule_is_booked_once(tracker):
    for replicate in range(3):
        Run(scenario(tracker), replicate).books()


SCHEDULES = (
    {"kind": "ris", "period": 3.0, "probability": 0.5},
    {"kind": "duty_cycle", "period": 4.0, "awake_share": 0.4, "phases": "synchronous"},
    {"kind": "duty_cycle", "period": 4.0, "awake_share": 0.4, "phases": "staggered"},
    {"kind": "always_on"},
    {"kind": "event_wake"},
)


TRACKERS = ("gmtt", "tsstp", "cluster", "ris", "ekf", "pf")


def _pairs_of_tracker_and_schedule():
    """All pairs; without those that only `make thorough` tests, each tracker and each schedule stands once or twice."""
    for i, tracker in enumerate(TRACKERS):
        for k, sleep in enumerate(SCHEDULES):
            name = f"{tracker}-{sleep.get('phases', sleep['kind'])}"
            marks = () if i % len(SCHEDULES) == k else pytest.mark.thorough
            yield pytest.param(tracker, sleep, id=name, marks=marks)


@pytest.mark.thorough
@pytest.mark.parametrize(("tracker", "sleep"), list(_pairs_of_tracker_and_schedule()))
def test_every_schedule_goes_with_every_wake_up_and_tracker(tracker, sleep):
    for wakeup, main in dict.fromkeys(PAIRS.values()):
        said = scenario(
            tracker, duration=12.0, sleep=sleep, wakeup={"kind": wakeup}, clusters={"kind": "moving_head", "main": main}
        )
        run = Run(said, replicate=1)
        run.books()
        errors = run.summary.errors
        assert np.isfinite(errors).any() and not np.isinf(errors).any()


@pytest.mark.thorough(fast=["directed_flood"])
@pytest.mark.parametrize("wakeup", ["none", "directed_flood", "experience_zones", "region"])
def test_standing_clusters_sleep_and_wake_nodes_ahead_too(wakeup):
    said = scenario(
        "pso_mhpf", duration=20.0, step=0.5, wakeup={"kind": wakeup}, clusters={"kind": "strongest_signal"},
        sink={"kind": "none"}, mac={"kind": "ideal"}, sleep={"kind": "ris", "probability": 0.6},
    )  # fmt: skip
    said["tracker"] = {"kind": "pso_mhpf", "particles": 50, "measurements": "all"}
    run = Run(said)
    run.books()
    assert np.isfinite(run.summary.errors).mean() > 0.3
    assert bool(run.table("wakeups")) == (wakeup != "none")


@pytest.mark.thorough
def test_the_awake_share_is_that_of_the_schedules_and_events():
    """An independent account: every node's awake time from its schedule, scanned, and from its wake and sleep rows."""
    run, end = Run(scenario(duration=20.0)), 20.0
    setup = scenarios.build(scenarios.load(scenario(duration=20.0)))
    keys = derive_all(Streams(5, 0).key("sleep"), np.arange(200))
    ticks = (np.arange(0, end, 0.004) + 0.002).tolist()
    held: dict[int, list[tuple[float, float]]] = {}
    for row in run.events("wake", "stay", "sleep", "resume"):
        spells = held.setdefault(row["node"], [])
        if row["kind"] in (KIND["wake"], KIND["stay"]):
            spells.append((row["time"], end))
        else:
            spells[-1] = spells[-1][0], row["time"]
    sink = int(np.argmin((places(run) ** 2).sum(axis=1)))
    held[sink] = [(0.0, end)]
    awake = np.zeros(200)
    for time in ticks:
        now = setup.sleep.awake(keys, time)
        for node, spells in held.items():
            now[node] |= any(start <= time < end for start, end in spells)
        awake += now
    assert run.summary.run["awake"] == pytest.approx(awake.sum() / (200 * len(ticks)), abs=4e-4)
    assert any(len(spells) for node, spells in held.items() if node != sink)


def test_a_network_that_wakes_no_node_consumes_what_its_schedules_say():
    """No node detects a target that is far away: all energy is that of the schedules, summed by hand."""
    far = {"kind": "waypoints", "points": [[0, 5000, 5000], [60, 5000, 5000]]}
    run = Run(scenario("ris", motion=far, sink={"kind": "none"}))
    keys = derive_all(Streams(5, 0).key("sleep"), np.arange(200))
    schedule = scenarios.build(scenarios.load(scenario("ris"))).sleep
    seconds, changes = schedule.tally(keys, np.zeros(200), 62.0)
    asleep = 200 * 62.0 - seconds.sum()
    joules = run.summary.joules
    assert joules["idle"] == pytest.approx(seconds.sum() * (62e-3 + 3 * 54.5e-6), rel=1e-9)
    assert joules["sleep"] == pytest.approx(asleep * (66e-6 + 3 * 5.1e-6), rel=1e-9)
    assert joules["sense"] == pytest.approx(seconds.sum() * 11e-6, rel=1e-9)
    assert changes.sum() > 0 and joules["switch"] > 0
    assert set(joules) == {"idle", "sleep", "sense", "switch"}
    run.books()


@pytest.mark.thorough
def test_all_four_methods_get_the_same_target_nodes_and_schedules():
    runs = [Run(scenario(tracker, duration=20.0)) for tracker in PAIRS]
    for run in runs[1:]:
        for table in ("truth",):
            for name, column in runs[0].table(table).items():
                assert np.array_equal(column, run.table(table)[name])
        assert np.array_equal(places(runs[0]), places(run))
    first = [min(row["time"] for row in run.events("acquire")) for run in runs]
    assert len(set(first)) == 1, "who is awake at the start, and detects, does not depend on the tracker"


@pytest.mark.thorough
def test_a_log_changes_nothing():
    said = scenario()
    quiet = simulate_run(said, recorder=Memory({}))
    assert quiet.run["fingerprint"] == Run(said).summary.run["fingerprint"]


@pytest.mark.thorough
def test_a_called_node_pays_for_the_call_and_sleeps_again_when_no_target_comes():
    run = Run(scenario(duration=40.0))
    calls, called = run.events("call"), run.events("called")
    assert len(called) >= len(calls) > 0
    assert {row["bits"] for row in (*calls, *called)} == {1250}, "5 ms at 250 kbit/s"
    assert [row["joules"] for row in calls] == pytest.approx([57.42e-3 * 5e-3] * len(calls))
    assert [row["joules"] for row in called] == pytest.approx([62e-3 * 5e-3] * len(called))
    asleep = run.events("sleep")
    assert asleep and all(row["what"] == "schedule" for row in asleep)
    woken = {(row["node"], row["time"]) for row in called}
    spells = 0
    for row in asleep:
        wakes = [
            wake["time"]
            for wake in run.events("wake", "stay")
            if wake["node"] == row["node"] and wake["time"] <= row["time"]
        ]
        if (row["node"], wakes[-1]) in woken:
            assert row["time"] - wakes[-1] >= 3.0 - 1e-9, "T_wait at least"
            spells += 1
    assert spells > 5


@pytest.mark.thorough
def test_only_awake_nodes_search_for_a_lost_target_once_a_second():
    found = [Run(scenario("ris", duration=20.0), replicate) for replicate in range(6)]
    for run in found:
        schedule = scenarios.build(scenarios.load(scenario("ris"))).sleep
        for row in run.events("acquire"):
            detection = next(send for send in run.events("send", what="detection") if send["node"] == row["node"])
            poll = math.floor(detection["time"])
            replicate = int(run.table("runs")["replicate"][0])
            keys = derive_all(Streams(5, replicate).key("sleep"), np.array([row["node"]]))
            assert schedule.awake(keys, float(poll))[0]
            assert 0.002 < detection["time"] - poll < 0.02, "sampled, contended, sent"
    assert any(run.events("acquire") for run in found)


@pytest.mark.thorough
def test_an_unreachable_sink_is_reported():
    island = {"kind": "anchors", "width": 2000.0, "height": 2000.0, "places": [
        *([x, y] for x in range(-60, 61, 30) for y in range(-60, 61, 30)), [900.0, 900.0], [870.0, 900.0]]}  # fmt: skip
    still = {"kind": "waypoints", "points": [[0, 5, 5], [60, 20, 5]]}
    run = Run(scenario(deploy=island, motion=still, sink={"kind": "node", "x": 900.0, "y": 900.0, "every": 10.0}))
    drops = run.events("drop", what="no_path")
    sink = 25
    assert drops and {row["peer"] for row in drops} == {sink}
    track = run.table("tracks")
    assert track["received"][0] == 0 and track["due"][0] == 6 and track["in_time"][0] == 0.0
    assert not run.events("report")


@pytest.mark.thorough
@pytest.mark.parametrize(("tracker", "word"), [("cluster", "empty_region"), ("gmtt", "nobody_woken")])
def test_a_region_without_nodes_loses_the_track_and_logs_why(tracker, word):
    """A row of nodes, and a target that leaves it at a right angle."""
    row = {"kind": "anchors", "width": 400.0, "height": 2000.0, "places": [[x, 0.0] for x in range(-200, 201, 10)]}
    away = {"kind": "waypoints", "points": [[0, 0, -40], [400, 0, 2000]]}
    run = Run(scenario(tracker, deploy=row, motion=away, sleep={"kind": "always_on"}, duration=40.0))
    assert word in {lost["what"] for lost in run.events("lost")}
    assert run.summary.run["tracked"] < 0.7


@pytest.mark.thorough(fast=["ris"])
@pytest.mark.parametrize("tracker", PAIRS)
def test_a_target_that_leaves_the_field_and_returns_is_lost_and_found(tracker):
    there = {"kind": "waypoints", "points": [[0, 150, 0], [20, 250, 0], [60, 400, 0], [100, 250, 0], [120, 150, 0]]}
    run = Run(scenario(tracker, motion=there, duration=140.0, sleep={"kind": "always_on"}))
    leave, back = run.events("leave"), run.events("return")
    assert len(leave) == len(back) == 1
    assert leave[0]["time"] == 12.0 and back[0]["time"] == 110.0
    lost = [row["time"] for row in run.events("lost") if row["time"] > 12.0]
    found = [row["time"] for row in run.events("reacquire")]
    assert lost and found and min(lost) < min(time for time in found if time > 60.0)
    beyond = run.table("estimates")
    outside = (beyond["time"] > 40.0) & (beyond["time"] < 80.0)
    assert np.isnan(beyond["error"][outside]).all()


def test_a_message_that_expires_on_the_way_is_dropped_and_counted():
    """Calling sleeping nodes takes longer than the time until the step."""
    said = scenario(step=1.0, duration=20.0, wakeup={"kind": "directed_flood", "expiry": 0.0, "call": 1.2})
    run = Run(said)
    dropped = run.events("drop", what="expired")
    assert dropped and run.table("wakeups")["expired"].sum() == len(dropped)
    called = {(row["node"], row["time"]) for row in run.events("called")}
    assert {(row["node"], row["time"]) for row in dropped} <= called


@pytest.mark.thorough
@pytest.mark.parametrize("at", [10.0, 10.01, 11.0, *thorough((10.001, 10.004, 10.02, 10.03, 10.05, 11.999))])
def test_a_run_continues_after_a_moving_head_crashes_at_any_time(at):
    run = Run(scenario(duration=40.0, sleep={"kind": "ris", "probability": 0.7},
                       faults=[{"kind": "crash", "at": at, "head": 0, "duration": 5.0}]))  # fmt: skip
    run.books()
    assert run.events("crash")
    later = run.table("estimates")["issued"]
    assert np.nanmax(later) > 20.0


@pytest.mark.thorough
def test_nodes_that_run_out_of_charge_die_while_asleep_and_the_ledger_closes():
    """Half a joule: 8 s of listening, 6150 s of sleep."""
    energy = {"kind": "states", "radio": "cc2420", "processor": "msp430f1611", "sensing": 11e-6, "battery": 0.5}
    run = Run(scenario(duration=60.0, energy=energy))
    nodes, died = run.table("nodes"), run.summary.run["alive"]
    assert 0 < died < 200
    dead = np.isfinite(nodes["died_at"])
    assert np.allclose(nodes["energy_left"][dead], 0.0, atol=1e-12)
    keys = derive_all(Streams(5, 0).key("sleep"), np.arange(200))
    schedule = scenarios.build(scenarios.load(scenario())).sleep
    untouched = dead & ~np.isin(nodes["node"], [row["node"] for row in run.events("wake", "receive", "send", "called")])
    for node in np.flatnonzero(untouched)[:20]:
        awake, changes = schedule.tally(keys[node : node + 1], np.zeros(1), float(nodes["died_at"][node]))
        asleep = nodes["died_at"][node] - awake[0]
        drawn = awake[0] * (62e-3 + 163.5e-6 + 11e-6) + asleep * (66e-6 + 15.3e-6)
        assert drawn == pytest.approx(0.5, abs=2e-4 + 1e-4 * changes[0])
    energy_table = run.table("energy")
    spent = np.bincount(energy_table["node"].astype(int), energy_table["joules"], 200)
    assert np.allclose(spent + nodes["energy_left"], 0.5, rtol=1e-9)


@pytest.mark.thorough
def test_two_targets_are_tracked_by_two_moving_heads():
    targets = [{"kind": "waypoints", "points": [[0, -120, -100], [60, 0, -100]]},
               {"kind": "waypoints", "points": [[0, 120, 100], [60, 0, 100]]}]  # fmt: skip
    said = scenario(sleep={"kind": "ris", "probability": 0.5})
    said.pop("motion")
    run = Run({**said, "targets": targets})
    run.books()
    assert {row["target"] for row in run.events("acquire")} == {0, 1}
    for errors in run.summary.errors:
        assert np.nanmedian(errors) < 10.0


def test_beacons_are_received_by_awake_nodes():
    said = {
        "name": "dozing", "duration": 20.0, "workload": {"kind": "beacons", "period": 1.0, "bits": 96},
        "deploy": {"kind": "uniform", "nodes": 60, "width": 200.0, "height": 200.0, "cover": False},
        "link": {"kind": "disk", "reach": 60.0}, "mac": {"kind": "csma"}, "sleep": {"kind": "duty_cycle"},
        "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"},
    }  # fmt: skip
    run = Run(said)
    assert run.summary.run["awake"] == pytest.approx(0.3, abs=0.02)
    assert 0.2 * 60 * 20 < run.summary.run["frames_sent"] < 0.4 * 60 * 20
    for a, b in itertools.pairwise(run.events("send")):
        assert a["time"] <= b["time"]


@pytest.mark.thorough
def test_no_node_sends_in_its_sleep(monkeypatch):
    """Awake spells are short, so that frames often still wait when a spell ends."""
    asleep, sent = [], []
    transmit = Channel.transmit

    def watched(self, source, frame, *rest):
        if frame.bits > Csma().ack_bits:  # a radio that has just received a frame acknowledges it
            sent.append(source)
            asleep.extend([source] if not self._nodes.is_awake(source) else [])
        return transmit(self, source, frame, *rest)

    monkeypatch.setattr(Channel, "transmit", watched)
    for tracker in PAIRS:
        Run(scenario(tracker, sleep={"kind": "ris", "period": 0.05, "probability": 0.4})).books()
    assert len(sent) > 500 and not asleep


@pytest.mark.thorough
@pytest.mark.parametrize("motion", [{"kind": "gauss_markov"}, {"kind": "random_waypoint"}])
def test_the_search_interval_does_not_change_the_trajectory(motion):
    def truth(tracker="gmtt", **changes):
        return Run(scenario(tracker, motion=motion, duration=12.0, sink={"kind": "none"}, **changes)).table("truth")

    once = truth(acquire={"poll": 2.0})
    standing = truth("ekf", clusters={"kind": "strongest_signal"}, acquire={}, wakeup={"kind": "none"})
    for other in (truth(acquire={"poll": 1.0}), truth(acquire={"poll": 0.25}), standing):
        assert all(np.array_equal(column, other[name]) for name, column in once.items())


@pytest.mark.thorough
def test_all_four_methods_get_the_same_readings_from_the_same_awake_nodes(monkeypatch):
    seen: dict[str, list] = {}
    update, first = ContinuousSensing.update, TargetSearch.first_detection

    def record_step(self, target):
        services, step = self._services, self._services.clock.step
        awake = [services.nodes.sleep_states.scheduled(node) for node in range(200)]
        readings = dict(services.available[target].readings(step))
        seen.setdefault(self.tag, []).append((step, readings, awake))
        update(self, target)

    def record_search(self, target, poll):
        if self._between:
            at = self._network.clock.step * self._polls + max(poll, 1)
            seen.setdefault("searches", []).append((at, dict(self._between[target].readings(at))))
        return first(self, target, poll)

    monkeypatch.setattr(ContinuousSensing, "update", record_step)
    monkeypatch.setattr(TargetSearch, "first_detection", record_search)
    for tracker in PAIRS:
        monkeypatch.setattr(ContinuousSensing, "tag", tracker, raising=False)
        Run(scenario(tracker, duration=20.0))
    reference = seen["gmtt"]
    assert any(readings for _, readings, _ in reference)
    for tracker in PAIRS:
        assert seen[tracker] == reference
    searches: dict[int, dict] = {}
    for at, readings in seen["searches"]:
        assert searches.setdefault(at, readings) == readings


@pytest.mark.thorough
def test_each_search_costs_a_reading_with_or_without_an_explicit_interval():
    named, unnamed = (Run(scenario("ris", acquire=acquire)).summary.joules["sense"] for acquire in ({"poll": 2.0}, {}))
    assert named == pytest.approx(unnamed, rel=1e-12) and named > 0
    twice = Run(scenario("ris", acquire={"poll": 1.0})).summary.joules["sense"]
    assert twice == pytest.approx(2.0 * named, rel=0.05), "but for who is held awake"


@pytest.mark.thorough
def test_a_node_whose_only_cost_is_switching_dies_when_its_charge_is_used():
    energy = {"kind": "first_order", "battery": 10.5e-3, "switch": 1e-3, "idle": 0.0, "sleep": 0.0}
    far = {"kind": "waypoints", "points": [[0, 5000, 5000], [60, 5000, 5000]]}
    sleep = {"kind": "duty_cycle", "period": 1.0, "awake_share": 0.5, "phases": "synchronous"}
    run = Run(scenario("ris", motion=far, sink={"kind": "none"}, sleep=sleep, energy=energy, duration=20.0))
    died = run.table("nodes")["died_at"]
    assert np.allclose(died, 5.5), "the eleventh change, at 5.5 s, cannot be paid whole"
    steps = run.table("energy_steps")
    assert (steps["joules"] > -1e-12).all()
    assert steps["joules"][steps["time"] < 5.0].sum() == pytest.approx(200 * 10e-3, rel=0.1)


@pytest.mark.thorough
def test_the_energy_of_a_step_is_never_negative_and_zero_after_all_nodes_died():
    energy = {"kind": "first_order", "battery": 0.03, "switch": 4e-3, "idle": 1e-3, "sleep": 1e-5, "sensing": 1e-5}
    sleep = {"kind": "ris", "period": 1.0, "probability": 0.5}
    run = Run(scenario(energy=energy, sleep=sleep, duration=40.0))
    steps = run.table("energy_steps")
    # a dying node's last charges are cut in proportion, those since it was last looked at: a millionth of its battery
    assert (steps["joules"] > -1e-4 * 0.03).all() and run.summary.run["alive"] == 0
    last = float(np.nanmax(run.table("nodes")["died_at"]))
    assert (steps["time"][steps["joules"] > 1e-12] <= last + 1e-9).all()


@pytest.mark.thorough
def test_a_call_that_takes_no_time_still_wakes():
    run = Run(scenario("cluster", wakeup={"kind": "region", "call": 0.0}))
    assert run.events("called") and run.summary.run["tracked"] > 0.5


@pytest.mark.thorough
def test_nodes_woken_by_a_head_that_died_are_counted_too():
    said = scenario(step=5.0, duration=60.0, sleep={"kind": "ris", "probability": 0.6},
                    faults=[{"kind": "crash", "at": 30.5, "head": 0, "duration": 1.0}])  # fmt: skip
    wakeups = Run(said).table("wakeups")
    again = [step for step in np.unique(wakeups["step"]) if (wakeups["step"] == step).sum() > 1]
    assert again, "the target was lost and found before the next step"
    for step in again:
        assert (wakeups["woken"][wakeups["step"] == step] > 0).all()


@pytest.mark.thorough
def test_without_a_prediction_the_region_covers_where_the_target_may_be():
    wakeups = Run(scenario("cluster")).table("wakeups")
    early = wakeups["foreseen"] == 0
    assert early.sum() >= 3 and (wakeups["radius"][~early] == 40.0).all()
    assert (wakeups["radius"][early] > 40.0).all() and (wakeups["radius"][early] <= 80.0).all()
    slow = Run(scenario("cluster", wakeup={"kind": "region", "speed": 0.0})).table("wakeups")
    assert (slow["radius"] == 40.0).all()


def test_the_first_step_after_a_detection_between_steps_is_as_long_as_the_time_passed():
    """The first step is 0.5 s long, the others 2 s."""
    asked: list[float] = []

    class Curious(ExtendedKalman):
        def step(self, belief, scene):
            asked.append(scene.dt)
            return super().step(belief, scene)

    said = scenario("ekf", acquire={"poll": 0.5}, duration=20.0,
                    motion={"kind": "waypoints", "points": [[0, -600, 0], [1.3, -600, 0], [1.4, 0, 0], [40, 40, 0]]},
                    sleep={"kind": "always_on"})  # fmt: skip
    setup = scenarios.build(scenarios.load(said))
    experiment.replicate_of(dataclasses.replace(setup, tracker=Curious()), 0, Memory({}))
    assert asked[0] == pytest.approx(0.5) and set(np.round(asked[1:], 9)) == {2.0}


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", ["gmtt", "ekf"])
def test_a_moving_head_wakes_nodes_between_the_detection_and_the_first_step(tracker):
    run = Run({**scenario("gmtt"), "tracker": {"kind": tracker}})
    acquired = run.events("acquire")[0]
    rounds = run.table("wakeups")
    first = int(np.flatnonzero(rounds["time"] >= acquired["time"])[0])
    assert rounds["step"][first] == acquired["step"] + 1
    assert rounds["time"][first] < (acquired["step"] + 1) * 2.0
