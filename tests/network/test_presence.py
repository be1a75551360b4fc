"""Targets that begin late, end early, come again or never exist: nobody tells the network."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wsnsim.scenario as scenarios
from wsnsim.analysis.notes import before_a_run
from wsnsim.analysis.summary import as_json
from wsnsim.base.errors import ScenarioError
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.tables import KIND, Memory
from wsnsim.bounds import bound
from wsnsim.experiment import run_in_memory, simulate_run

STEPS = 24
WANTED = dict.fromkeys(("truth", "readings", "estimates", "events", "energy", "tracks"), True)
DIAGONAL = {"kind": "waypoints", "points": [[0, -35, -35], [STEPS, 35, 35]]}
MOVING = {
    "clusters": {"kind": "moving_head", "main": "detection"},
    "sleep": {"kind": "ris", "period": "1 s", "probability": 0.5},
    "acquire": {"kind": "readings", "poll": "0.25 s"},
}  # fmt: skip
NETWORKS: dict[str, dict[str, Any]] = {
    "standing": {},
    "electing": {"clusters": {"kind": "strongest_signal", "successor_rule": "elect"}},
    "central": {"clusters": {"kind": "central"}},
    "appointed": {"clusters": {"kind": "appointed"}},
    "moving": MOVING,
    "missed": {"detection": {"kind": "imperfect", "missed": 0.2}},
    "clocks": {"clock": {"kind": "drift", "sd": 0.01}},
}


def scenario(presence: Any = None, motion: dict[str, Any] = DIAGONAL, **others: Any) -> dict[str, Any]:
    """A small network whose target is present in these intervals; None: always."""
    return {
        "name": "presence", "seed": 5, "duration": f"{STEPS} s", "step": "1 s",
        "deploy": {"kind": "grid", "nodes": 16, "width": "80 m", "height": "80 m", "cover": False},
        "motion": motion if presence is None else {**motion, "presence": presence},
        "sensor": {"kind": "range", "sd": "1 m", "reach": "30 m"}, "energy": {"kind": "first_order"},
        "link": {"kind": "disk", "reach": "60 m"}, "clusters": {"kind": "strongest_signal"},
        "tracker": {"kind": "ekf"}, **others,
    }  # fmt: skip


def recorded(source: dict[str, Any]) -> Memory:
    memory = Memory(WANTED)
    simulate_run(source, 0, memory)
    return memory


def within(steps: np.ndarray, intervals: list[list[float]]) -> np.ndarray:
    return np.array([any(begin <= step <= end for begin, end in intervals) for step in steps], dtype=bool)


@st.composite
def disjoint(draw: st.DrawFn) -> list[list[float]]:
    """Intervals whose ends are instants or lie between them."""
    ends = sorted(draw(st.sets(st.integers(0, 2 * STEPS), max_size=6)))
    return [[begin / 2, end / 2] for begin, end in zip(ends[::2], ends[1::2], strict=False)]


@pytest.mark.parametrize("network", NETWORKS)
@given(intervals=disjoint())
@settings(max_examples=6, deadline=None)
def test_nothing_is_sensed_of_an_absent_target_and_nothing_else_changes_of_a_present_one(network, intervals):
    memory, always = recorded(scenario(intervals, **NETWORKS[network])), recorded(scenario(**NETWORKS[network]))
    truth, whole = memory.table("truth"), always.table("truth")
    there = within(truth["step"], intervals)
    assert np.array_equal(np.where(there, whole["px"], np.nan), truth["px"], equal_nan=True)

    readings, estimates, events = (memory.table(name) for name in ("readings", "estimates", "events"))
    if network not in ("moving", "clocks"):  # who is awake depends on a track; wrong clocks measure between steps
        every = always.table("readings")
        kept = within(every["step"], intervals)
        for name in ("step", "node", "reading"):
            assert np.array_equal(readings.get(name, np.empty(0)), every[name][kept])
    assert within(readings.get("step", np.empty(0)), intervals).all()
    starts = np.isin(events["kind"], [KIND[name] for name in ("sense", "elect", "acquire", "reacquire")])
    assert within(events["time"][starts & (events["time"] % 1 == 0)], intervals).all(), "of steps and polls"

    errors, issued = estimates["error"], np.isfinite(estimates["issued"])
    there = within(estimates["step"], intervals)
    assert np.array_equal(np.isfinite(errors), issued & there), "no error without a target"
    assert np.isnan(estimates["nees"][~there]).all()
    row = memory.table("tracks")
    assert row["time_present"] == [there.sum()] and row["false_time"] == [(issued & ~there).sum()]
    assert row["reports"] == [(issued & there).sum()]
    if not (first := np.flatnonzero(within(np.arange(STEPS), intervals))).size:
        assert not issued.any() and np.isnan(row["rmse"][0])
    elif issued.any():
        assert estimates["step"][issued].min() >= first[0]


REAL = {
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"},
    "mac": {"kind": "xmac", "interval": "125 ms"}, "link": {"kind": "disk", "reach": "60 m"},
}  # fmt: skip


@pytest.mark.parametrize("network", ["standing", "electing", "appointed", "moving"])
@pytest.mark.parametrize("radio", [{}, REAL], ids=["first_order", "xmac"])
def test_a_network_whose_target_never_exists_spends_what_one_without_a_target_in_reach_spends(network, radio):
    far = {"kind": "waypoints", "points": [[0, 9000, 0], [STEPS, 9000, 10]]}
    quiet, alone = (
        recorded(scenario(motion=far, **NETWORKS[network], **radio)),
        recorded(scenario([], **NETWORKS[network], **radio)),
    )
    assert not radio or alone.table("energy")["joules"].sum() > 0.0
    for name in ("node", "cause"):
        assert np.array_equal(quiet.table("energy").get(name), alone.table("energy").get(name))
    assert alone.table("energy").get("joules", np.empty(0)) == pytest.approx(
        quiet.table("energy").get("joules", np.empty(0)), rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize("network", ["standing", "central", "appointed"])
def test_the_prior_is_given_at_time_0_only_and_a_target_that_comes_later_is_initiated_from_readings(network):
    """A prior 900 m off misleads a track of time 0, and none of a target that comes later."""
    prior = {"prior": {"sd": [5, 3, 5, 3], "mean": [900, 0, 900, 0]}}
    first = {
        begin: recorded(scenario([[begin, STEPS]], **prior, **NETWORKS[network])).table("estimates")["error"]
        for begin in (0, 6)
    }
    assert first[0][0] > 30.0
    assert np.nanmax(first[6][:12]) < 10.0


def test_a_vehicle_that_left_after_ten_seconds_is_not_measured_any_more(tmp_path):
    """Two vehicles of one trace: one drives for the whole run, the other leaves the simulation at 10 s."""
    for name, last in (("long", STEPS), ("short", 10)):
        rows = [f"{time},{-35 + 2 * time},{10 if name == 'short' else 0}" for time in range(last + 1)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["time,x,y", *rows]))
    tracks = [{"kind": "recorded_track", "path": str(tmp_path / f"{n}.csv"), "gap": "1 s"} for n in ("long", "short")]
    source = scenario(targets=tracks, faults=[])
    del source["motion"]
    memory = recorded(source)
    readings, rows = memory.table("readings"), memory.table("tracks")
    assert [np.unique(readings["step"][readings["target"] == i]).max() for i in (0, 1)] == [STEPS - 1, 10]
    assert rows["time_present"].tolist() == [STEPS - 1, 10.0] and rows["false_time"][0] == 0.0


def test_losses_count_while_the_target_is_there_and_false_time_while_it_is_not():
    track = recorded(scenario([[0, 11]])).table("tracks")
    assert track["time_present"] == 11.0 and track["false_time"] == 12.0, "the standing cluster keeps its track"
    assert (track["lost"], track["losses"], track["late"], track["tracked"]) == (0, 0, 0, 1.0)


def test_who_runs_it_is_told_of_false_time_and_of_runs_without_a_target():
    for presence, said in (([[0, 11]], "kept for 12 s while their target was absent"), ([], "no target in 2 of 2")):
        report, _ = run_in_memory(scenario(presence), replicates=2)
        found = as_json(report)
        assert any(said in note for note in found["notes"]), found["notes"]
    assert found["answer"].startswith("No target existed") and np.isnan(found["rmse"])


@pytest.mark.parametrize(
    ("changes", "place", "said"),
    [
        ({"presence": [[5, 3]]}, "motion.presence", "disjoint, ascending"),
        ({"presence": [[2, 5], [5, 7]]}, "motion.presence", "got [2, 5], [5, 7]"),
        ({"presence": [[2, 5, 7]]}, "motion.presence.0", "a list of 2 items, got 3"),
        ({"presence": [["5 m", 7]]}, "motion.presence.0.0", "expected time"),
        ({"presence": [[2, 5]], "network": "none"}, "motion", "needs a network"),
    ],
)
def test_presence_that_means_nothing_is_refused_at_its_place(changes, place, said):
    with pytest.raises(ScenarioError) as caught:
        scenarios.build(scenarios.load(scenario(**changes)))
    assert any(str(line).partition(f"{place}: ")[2].find(said) >= 0 for line in str(caught.value).splitlines())


def test_a_mode_of_a_filter_has_no_presence():
    mode = {"kind": "constant_velocity", "presence": [[0, 1]]}
    with pytest.raises(ScenarioError, match="a mode of a filter has none"):
        scenarios.build(scenarios.load(scenario(tracker={"kind": "imm", "models": [mode, mode]})))


@pytest.mark.parametrize(
    ("presence", "never"),
    [([], True), ([[100, 200]], True), ([[3.2, 3.8]], True), ([[3, 3.5]], False), ([[0, ".inf"]], False)],
)
def test_a_check_notes_a_target_that_never_exists_in_the_run(presence: Any, never: bool) -> None:
    found = before_a_run(scenarios.build(scenarios.load(scenario(presence))))
    note = f"motion.presence: the target never exists at an instant of the run, every 1 s up to {STEPS - 1} s"
    assert (note in found) == never


def test_a_summary_says_which_target_never_existed() -> None:
    motions = {"targets": [DIAGONAL, {**DIAGONAL, "presence": []}]}
    source = {key: value for key, value in scenario().items() if key != "motion"} | motions
    figures = as_json(run_in_memory(source, replicates=1)[0])
    assert "target 1 never existed in 1 of 1 run" in figures["notes"]


def test_a_scenario_keeps_its_intervals_and_writes_none_that_nobody_gave():
    for presence in (None, [], [[3.0, 5.0], [8.0, ".inf"]]):
        plain = scenarios.resolved(scenarios.load(scenario(presence)))
        assert plain["motion"].get("presence") == presence
        assert scenarios.resolved(scenarios.load(json.loads(json.dumps(plain)))) == plain


def test_a_bound_is_that_of_present_steps_and_begins_again_from_the_prior():
    """At each first step of an interval, it is (P0⁻¹ + I)⁻¹, by hand for ranges with sd 1 m."""
    motion = {"kind": "constant_velocity", "start": [-30, 2, -30, 2]}
    source = scenario([[3, 6], [12, STEPS]], motion)
    found = bound(source, [0], kind="per_trajectory")
    states = found.covariances[0, 0]
    there = within(np.arange(1, STEPS), [[3, 6], [12, STEPS]])
    assert np.array_equal(np.isfinite(states).all(axis=(1, 2)), there)
    assert np.array_equal(np.isfinite(found.rmse), there) and np.isfinite(found.time_mean)
    run = sample_initial_conditions(scenarios.build(scenarios.load(source)), 0)
    for step in (3, 12):
        apart = run.truths[0][step, [0, 2]] - run.positions
        away = np.hypot(*apart.T)
        slopes = np.zeros((len(apart), 4))
        slopes[:, [0, 2]] = apart / away[:, None]
        slopes = slopes[away <= 30.0]
        by_hand = np.linalg.inv(np.linalg.inv(np.diag([25.0, 9.0, 25.0, 9.0])) + slopes.T @ slopes)
        assert states[step - 1] == pytest.approx(by_hand, rel=1e-9, abs=1e-12)
    assert "use kind per_trajectory" in bound(source, [0]).reason
