"""Sweeps: files, dicts and command lines become points; every fault stands at its place; a point's name is its own."""

from __future__ import annotations

import itertools
import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.helpers.files import write_yaml
from tests.helpers.scenario_components import base_scenario, kind
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import TABLES
from wsnsim.scenario.sweep import is_sweep, load_sweep
from wsnsim.scenario.sweep_schema import Plan
from wsnsim.scenario.texts import shipped_sweeps

PARTICLES = "tracker.particles"


@pytest.fixture(autouse=True)
def _small_scenario(fresh_folder: Path) -> None:
    write_yaml("small.yaml", base_scenario())


def sweep(**blocks: Any) -> dict[str, Any]:
    return {"scenario": "small", **blocks}


def settings_of(source: Any, *arguments: Any, **given: Any) -> list[dict[str, Any]]:
    return [dict(point.settings) for point in load_sweep(source, *arguments, **given).points]


def faults_of(source: Any, *arguments: Any, **given: Any) -> list[str]:
    """Every fault of a sweep, without the excerpts."""
    try:
        load_sweep(source, *arguments, **given)
    except ScenarioError as error:
        return [str(fault).partition("\n")[0] for fault in error.issues]
    return []


def ids_of(source: Any, *arguments: Any, **given: Any) -> list[str]:
    return [point.id for point in load_sweep(source, *arguments, **given).points]


# What a sweep says ------------------------------------------------------------------------------------------------


def test_a_file_becomes_a_plan_with_everything_that_it_says() -> None:
    text = """\
name: sizes
scenario: ../small.yaml
set: {link.reach: 0.08 km}
grid: {tracker.particles: [100, 200], sensor.reach: {range: [50 m, 70 m], count: 3}}
until: {metric: median_error, half_width: 5 %, at_least: 4, at_most: 40}
block: 2
timeout: 1.5 min
"""
    plan = load_sweep(write_yaml("sweeps/s.yaml", text))
    assert (plan.name, plan.keys, plan.block, plan.timeout) == ("sizes", (PARTICLES, "sensor.reach"), 2, 90.0)
    assert (plan.replicates, plan.source) == (40, text)
    assert plan.until is not None
    assert (plan.until.metric, plan.until.half_width) == ("median_error", 0.05)
    assert (plan.until.at_least, plan.until.at_most) == (4, 40)
    assert [tuple(point.settings.values()) for point in plan.points] == list(
        itertools.product([100, 200], [50.0, 60.0, 70.0])
    )
    for point in plan.points:
        said = json.loads(point.resolved)
        assert said["link"]["reach"] == 80.0
        assert (said["tracker"]["particles"], said["sensor"]["reach"]) == tuple(point.settings.values())


def test_without_axes_a_sweep_is_the_scenario_as_it_is() -> None:
    plan = load_sweep(sweep())
    assert (plan.name, plan.keys, plan.block, plan.timeout, plan.until) == ("sweep", (), 5, None, None)
    assert [dict(point.settings) for point in plan.points] == [{}]


@pytest.mark.thorough
def test_blocks_of_every_kind_are_combined_with_each_other() -> None:
    plan = load_sweep(
        sweep(
            grid={PARTICLES: [100, 200]},
            zip={"sensor.reach": [50, 60], "link.reach": ["70 m", "80 m"]},
            points=[{"seed": 1}, {"seed": 2, "sensor.decay": 3}],
            random={"points": 2, "seed": 4, "over": {"energy.battery": {"range": [1, 2]}}},
            latin_hypercube={"points": 3, "over": {"link.loss": {"range": [0, 0.5]}}},
        )
    )
    assert len(plan.points) == len({point.id for point in plan.points}) == 2 * 2 * 2 * 2 * 3
    assert plan.keys == (
        PARTICLES, "sensor.reach", "link.reach", "seed", "energy.battery", "link.loss", "sensor.decay",
    )  # fmt: skip
    pairs = {(point.settings["sensor.reach"], point.settings["link.reach"]) for point in plan.points}
    assert pairs == {(50.0, 70.0), (60.0, 80.0)}
    assert {point.settings.get("sensor.decay") for point in plan.points} == {None, 3.0}
    assert len({point.settings["energy.battery"] for point in plan.points}) == 2
    losses = {point.settings["link.loss"] for point in plan.points}
    assert sorted(int(loss / 0.5 * 3) for loss in losses) == [0, 1, 2]


def test_settings_are_typed_and_in_si_units() -> None:
    (point,) = load_sweep(
        sweep(
            points=[
                {
                    PARTICLES: 400.0,
                    "link.reach": "0.1 km",
                    "sensor.decay": 2,
                    "deploy.cover": False,
                    "tracker.measurements": "all",
                    "motion.start": [1, "2 m", 3, 4],
                    "energy.battery": ".inf",
                }
            ]
        )
    ).points
    expected = {
        PARTICLES: 400,
        "link.reach": 100.0,
        "sensor.decay": 2.0,
        "deploy.cover": False,
        "tracker.measurements": "all",
        "motion.start": "[1.0, 2.0, 3.0, 4.0]",
        "energy.battery": ".inf",
    }
    assert point.settings == expected
    assert {key: type(value) for key, value in point.settings.items()} == {
        key: type(value) for key, value in expected.items()
    }


def test_a_range_between_whole_numbers_is_of_real_numbers_where_the_scenario_has_one() -> None:
    both = {PARTICLES: {"range": [1, 2], "count": 3}, "link.loss": {"range": [0, 1e-1], "count": 3}}
    assert settings_of(sweep(grid={"sensor.decay": {"range": [2, 3], "count": 3}})) == [
        {"sensor.decay": 2.0}, {"sensor.decay": 2.5}, {"sensor.decay": 3.0},
    ]  # fmt: skip
    assert [point[PARTICLES] for point in settings_of(sweep(grid=both))] == [1, 1, 1, 2, 2, 2]
    drawn = settings_of(sweep(random={"points": 20, "over": {"sensor.decay": {"range": [2, 3]}}}))
    assert len({point["sensor.decay"] for point in drawn}) == 20


def test_a_whole_role_may_be_an_axis_and_each_of_its_keys_is_a_column() -> None:
    trackers = [{"kind": kind("Tracker"), "particles": 7}, {"kind": kind("GainTracker"), "gains": 2}]
    assert settings_of(sweep(grid={"tracker": trackers})) == [
        {"tracker.kind": kind("Tracker"), PARTICLES: 7},
        {"tracker.kind": kind("GainTracker"), "tracker.gains": 2.0},
    ]


def test_several_scenarios_are_an_axis_of_their_own() -> None:
    write_yaml("other.yaml", base_scenario(name="other", seed=5, replicates=7))
    plan = load_sweep({"scenario": ["small", "other.yaml"], "grid": {PARTICLES: [1, 2]}})
    assert plan.keys == ("scenario", PARTICLES)
    assert [tuple(point.settings.values()) for point in plan.points] == [
        ("small", 1), ("small", 2), ("other", 1), ("other", 2),
    ]  # fmt: skip
    assert plan.replicates == 7, "the most that one of them says"
    assert load_sweep(["small", "other"]).name == "small_other"


def test_a_campaign_records_the_summaries_and_what_is_asked_for() -> None:
    (point,) = load_sweep(sweep(set={"record.estimates": True})).points
    assert json.loads(point.resolved)["record"] == {name: name in ("runs", "tracks", "estimates") for name in TABLES}
    (point,) = load_sweep(sweep(), overrides=["record.truth=true"]).points
    assert [name for name, wanted in json.loads(point.resolved)["record"].items() if wanted] == [
        name for name in TABLES if name in ("runs", "tracks", "truth")
    ]


def test_replicates_are_those_of_the_command_line_of_the_file_or_of_the_scenario() -> None:
    write_yaml("small.yaml", base_scenario(replicates=12))
    rule = {"half_width": 0.1, "at_most": 50}
    assert load_sweep(sweep()).replicates == 12
    assert load_sweep(sweep(replicates=3)).replicates == 3
    assert load_sweep(sweep(replicates=3), replicates=4).replicates == 4
    assert load_sweep(sweep(until=rule)).replicates == 50
    plan = load_sweep(sweep(until=rule), replicates=4)
    assert (plan.replicates, plan.until) == (4, None)


def test_the_command_line_replaces_name_and_timeout_and_what_it_does_not_say_stays() -> None:
    source = sweep(name="a", timeout="2 s")
    plan = load_sweep(source, name="b", timeout="3 min")
    assert (plan.name, plan.timeout) == ("b", 180.0)
    plan = load_sweep(source, name=None, timeout=None, replicates=None)
    assert (plan.name, plan.timeout) == ("a", 2.0)


@pytest.mark.thorough(fast=["vary2-expected2"])
@pytest.mark.parametrize(
    ("vary", "expected"),
    [
        (["tracker.particles=100,200"], [{PARTICLES: 100}, {PARTICLES: 200}]),
        ([" tracker . particles = 100, 200,"], [{PARTICLES: 100}, {PARTICLES: 200}]),
        (["tracker.particles=100"], [{PARTICLES: 100}]),
        (["tracker.particles={range: [100, 200], step: 50}"], [{PARTICLES: n} for n in (100, 150, 200)]),
        (["link.reach={range: [60 m, 80 m], count: 2}"], [{"link.reach": 60.0}, {"link.reach": 80.0}]),
        (["link.reach=60 m,0.08 km"], [{"link.reach": 60.0}, {"link.reach": 80.0}]),
        (["tracker.measurements=own,all"], [{"tracker.measurements": "own"}, {"tracker.measurements": "all"}]),
        (["deploy.cover=true,false"], [{"deploy.cover": True}, {"deploy.cover": False}]),
        (["motion.start=[1,2,3,4],[5,6,7,8]"], [
            {"motion.start": "[1.0, 2.0, 3.0, 4.0]"}, {"motion.start": "[5.0, 6.0, 7.0, 8.0]"},
        ]),
        (["tracker.measurements='own',\"all\""], [{"tracker.measurements": "own"}, {"tracker.measurements": "all"}]),
        (["seed=1,2", "tracker.particles=3"], [{"seed": 1, PARTICLES: 3}, {"seed": 2, PARTICLES: 3}]),
    ],
)  # fmt: skip
def test_the_command_line_gives_axes_in_the_words_of_a_file(vary: list[str], expected: list[dict]) -> None:
    assert settings_of("small", vary) == expected


def test_vary_adds_axes_to_the_grid_of_a_file_and_takes_the_place_of_those_that_it_has() -> None:
    source = sweep(grid={PARTICLES: [1, 2], "seed": [3]})
    assert settings_of(source, ["tracker.particles=7", "link.reach=60 m"]) == [
        {PARTICLES: 7, "seed": 3, "link.reach": 60.0}
    ]


def test_set_is_laid_on_every_point_and_an_axis_on_that() -> None:
    plan = load_sweep(sweep(set={"link.reach": 60, PARTICLES: 5}, points=[{PARTICLES: 6}, {}]), (), ["seed=9"])
    said = [json.loads(point.resolved) for point in plan.points]
    assert [(one["link"]["reach"], one["tracker"]["particles"], one["seed"]) for one in said] == [
        (60.0, 6, 9), (60.0, 5, 9),
    ]  # fmt: skip


# Names of points --------------------------------------------------------------------------------------------------


def test_a_points_name_depends_neither_on_order_nor_on_names_replicates_or_other_points() -> None:
    (own,) = ids_of(sweep(points=[{PARTICLES: 100, "seed": 3}]))
    assert own in ids_of(sweep(grid={"seed": [1, 2, 3], PARTICLES: [50, 100]}))
    assert own in ids_of(sweep(grid={PARTICLES: [200, 100], "seed": [3]}, name="x", replicates=7, block=3))
    assert own in ids_of(sweep(until={"half_width": 0.1}, timeout=5), ["seed=4,3", "tracker.particles=100.0"])
    assert own in ids_of("small", ["tracker.particles=100"], ["seed=3"])
    write_yaml("other.yaml", base_scenario(name="another", replicates=9))
    assert own in ids_of({"scenario": "other"}, ["seed=3", "tracker.particles=100"])
    write_yaml("spelt.yaml", base_scenario(duration="4 s", link={"kind": kind("Link"), "reach": "0.075 km"}))
    assert own in ids_of({"scenario": "spelt"}, ["seed=3", "tracker.particles=100"])


@pytest.mark.thorough
def test_a_points_name_depends_on_everything_else() -> None:
    changes = [
        "seed=2", "duration=8 s", "step=0.1 s", "prior.sd=[1, 1, 1, 1]", "deploy.nodes=17", "motion.bound=99 m",
        "sensor.decay=3", "energy.battery=1 J", "link.loss=0.1", "clusters.minimum_active=4", "tracker.particles=9",
        f"tracker.kind={kind('GainTracker')}", "record.events=true", "tracker.gains=unknown", "until={clusters: 3}",
    ]  # fmt: skip
    found = [ids_of("small", (), [change])[0] for change in changes]
    assert len({*found, *ids_of("small")}) == len(changes) + 1


def test_points_share_a_world_if_they_differ_in_what_the_strategy_does_alone() -> None:
    def world(*overrides: str) -> str:
        return load_sweep("small", (), overrides).points[0].world

    own = world()
    for change in ("tracker.particles=9", "link.reach=50", "energy.battery=1", "clusters.minimum_active=4"):
        assert world(change) == own
    for change in ("seed=2", "duration=8 s", "deploy.nodes=9", "motion.bound=9", "sensor.decay=3", "prior.sd=[1]"):
        assert world(change) != own


@pytest.mark.thorough
@given(st.permutations([(PARTICLES, [1, 2, 3]), ("seed", [4, 5]), ("sensor.reach", ["60 m", "70 m"])]))
def test_the_order_of_axes_changes_the_order_of_points_only(items: list[tuple[str, list]]) -> None:
    expected = sorted(itertools.product([1, 2, 3], [4, 5], [60.0, 70.0]))
    plan = load_sweep({"scenario": base_file(), "grid": dict(items)})
    by_settings = {tuple(p.settings[key] for key in (PARTICLES, "seed", "sensor.reach")): p.id for p in plan.points}
    assert sorted(by_settings) == expected
    assert by_settings == KNOWN.setdefault("ids", by_settings)


KNOWN: dict[str, Any] = {}


def base_file() -> str:
    return str(Path("small.yaml").resolve())


def test_what_a_point_resolves_to_is_a_scenario_that_loads_to_the_same() -> None:
    plan = load_sweep(sweep(grid={PARTICLES: [100, 200], "energy.battery": [".inf", 2]}))
    for point in plan.points:
        said = json.loads(point.resolved)
        assert scenario.resolved(scenario.load(said)) == said


# Faults -----------------------------------------------------------------------------------------------------------

PLACES = [
    ("grid: {tracker.partcles: [1, 2]}", "1, 2", "tracker.partcles: unknown key, did you mean 'particles'?"),
    ("grid: {trakcer.particles: [1]}", "1]", "trakcer: unknown key, did you mean 'tracker'?"),
    ("grid: {tracker.particles: [1, x]}", "x]", "tracker.particles: expected a pure number, got the text 'x'"),
    ("grid: {tracker.particles: [1, 0]}", "0]", "tracker.particles: must be at least 1, is 0"),
    ("grid: {link.reach: [60 m, 1 kJ]}", "1 kJ",
     "link.reach: 'kJ' is a unit of energy, expected length (for example '1 m')"),
    ("grid: {link.reach: {range: [60 s, 90 s], count: 2}}", "{range",
     "link.reach: 's' is a unit of time, expected length (for example '1 m')"),
    ("grid: {tracker.kind: [pso_mhfp]}", "pso_mhfp",
     "tracker.kind: unknown tracker 'pso_mhfp' (did you mean 'pso_mhpf'?)"),
    ("grid: {deploy.nodes: [16, 2]}", "2]", "deploy.nodes: 2 nodes cannot form a cluster"),
    ("grid: {tracker.particles: []}", "[]", "grid.tracker.particles: is an empty list: an axis needs a value"),
    ("grid: {tracker.particles: [1, 2, 1]}", "1]", "grid.tracker.particles.2: 1 is in the list twice"),
    ("grid: {tracker.particles: [100, 100.0]}", "100.0",
     "tracker.particles: tracker.particles = 100 and tracker.particles = 100 are the same point: "
     "they differ in nothing"),
    ("grid: {a=b: [1]}", "[1]", "grid.a=b: 'a=b' is not a key of a scenario that can be varied"),
    ("grid: {name: [a]}", "[a]", "grid.name: 'name' is not a key of a scenario that can be varied"),
    ("grid: {replicates: [1]}", "[1]", "grid.replicates: 'replicates' is not a key of a scenario that can be varied"),
    ("grid: {scenario: [a]}", "[a]", "grid.scenario: 'scenario' is not a key of a scenario that can be varied"),
    ("grid: {extends: [a]}", "[a]", "grid.extends: 'extends' is not a key of a scenario that can be varied"),
    ("grid: {tracker..particles: [1]}", "[1]",
     "grid.tracker..particles: 'tracker..particles' is not a key of a scenario that can be varied"),
    ("grid: {seed: [1], ' seed': [2]}", "[2]", "grid. seed: 'seed' is an axis twice"),
    ("grid: {seed: [1]}\nzip: {seed: [2]}", "2]", "zip.seed.0: 'seed' is an axis twice"),
    ("grid: {seed: {range: [1, 2], cuont: 2}}", "2}",
     "grid.seed.cuont: unknown key 'cuont' in a range (count or step)"),
    ("grid: {seed: {range: [1, 10], count: 1000000000}}", "{range",
     "grid.seed: makes 1,000,000,000 points; at most 20,000 are allowed"),
    ("zip: {seed: [1, 2], tracker.particles: [1, 2, 3]}", "[1, 2], t",
     "zip.seed: axes of `zip` must have equal lengths: seed has 2, tracker.particles has 3"),
    ("points: []", "[]", "points: is an empty list: a sweep needs a point"),
    ("points: [{seed: 1}, {seed: 1}]", "1}]",
     "seed: seed = 1 and seed = 1 are the same point: they differ in nothing"),
    ("random: {points: 1000000000, over: {seed: {range: [1, 2]}}}", "1000000000",
     "random.points: must be at most 20000, is 1e+09"),
    ("random: {points: 3, over: {}}", "{}}", "random.over: is empty: name the axes of the random points"),
    ("random: {over: {seed: [1]}}", "{over", "random.points: is missing: number of points"),
    ("latin_hypercube: {points: 3, over: {seed: {range: [1, 2], count: 2}}}", "2}}",
     "latin_hypercube.over.seed.count: 'count' is not allowed for random points"),
    ("set: {link.raech: 3}", "3}", "link.raech: unknown key, did you mean 'reach'?"),
    ("set: {name: x}", "x}", "set.name: 'name' is not a key of a scenario that can be varied"),
    ("set: [link.reach=3]", "[link", "set: expected a mapping, got a list"),
    ("gird: {seed: [1]}", "gird", "gird: unknown key, did you mean 'grid'?"),
    ("name: a=b", "a=b",
     "name: 'a=b' cannot name a folder: use letters and digits, then also '_', '-' and '.'"),
    ("name: ../up", "../up",
     "name: '../up' cannot name a folder: use letters and digits, then also '_', '-' and '.'"),
    ("replicates: 0", "0", "replicates: must be at least 1, is 0"),
    ("replicates: 1000000000", "1000000000", "replicates: must be at most 100000, is 1e+09"),
    ("block: 2.5", "2.5", "block: expected a whole number, got 2.5"),
    ("timeout: 3 m", "3 m", "timeout: 'm' is a unit of length, expected time (for example '1 s')"),
    ("until: {metric: rsme, half_width: 5 %}", "rsme",
     "until.metric: table runs has no metric 'rsme' (did you mean 'rmse'?)"),
    ("until: {metric: rmse}", "{metric",
     "until.half_width: is missing: half of the 95 % interval of the median, as a share of the median"),
    ("until: {half_width: 0}", "0}", "until.half_width: must be greater than 0, is 0"),
    ("until: {half_width: 5 %, at_least: 9, at_most: 3}", "{half",
     "until: at_least is 9, and at_most only 3"),
]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(("written", "mark", "message"), PLACES)
def test_a_fault_of_a_file_stands_at_its_place_with_a_caret(written: str, mark: str, message: str) -> None:
    content = f"scenario: small\n{written}\n"
    with pytest.raises(ScenarioError) as refused:
        load_sweep(write_yaml("s.yaml", content))
    (fault,) = refused.value.issues
    line = written.splitlines()[-1]
    place = f"s.yaml:{1 + len(written.splitlines())}:{line.rindex(mark) + 1}"
    assert str(fault).partition("\n")[0] == f"{place}: error: {message}"
    excerpt, caret = fault.excerpt.splitlines()
    assert excerpt[caret.index("^") :].startswith(mark)


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ({"grid": {"seed": [1]}}, ["scenario: error: is missing: the scenario to vary, or several"]),
        ({"scenario": []}, ["scenario: error: is an empty list: a sweep needs a scenario"]),
        ({"scenario": [], "replicates": 2}, ["scenario: error: is an empty list: a sweep needs a scenario"]),
        ({"scenario": "smal"}, ["smal: error: file not found, and no shipped scenario has this name"]),
        (sweep(replicates=2, until={"half_width": 0.1}), [
            "scenario: error: 'replicates' and 'until' both end a point: give one of them (until.at_most)",
        ]),
        (sweep(grid={"seed": [1, 2]}, points=[{"seed": 3}]), ["points.0.seed: error: 'seed' is an axis twice"]),
        (sweep(points=[{}, {}]), [
            "error: (the scenario as it is) and (the scenario as it is) are the same point: "
            "they differ in nothing",
        ]),
        (sweep(grid={f"x{i}": {"range": [0, 1], "count": 1000} for i in range(6)}), [
            "grid.x0: error: makes 1.00e+18 points; at most 20,000 are allowed",
        ]),
        (sweep(grid={"seed": {"range": [1, 200], "step": 1}}, points=[{PARTICLES: i} for i in range(1, 102)]), [
            "scenario: error: makes 20,200 points; at most 20,000 are allowed",
        ]),
        ({"scenario": ["small", "small"], "grid": {"seed": {"range": [1, 10_001], "step": 1}}}, [
            "scenario: error: makes 20,002 points; at most 20,000 are allowed",
        ]),
    ],
)  # fmt: skip
def test_a_fault_of_a_dict_is_named_by_its_keys(source: dict[str, Any], faults: list[str]) -> None:
    found = faults_of(source)
    assert len(found) == len(faults)
    assert all(one.startswith(expected) for one, expected in zip(found, faults, strict=True)), found


def test_points_without_number_are_refused_before_memory_is_taken() -> None:
    axes = {f"tracker.a{i}": {"range": [0, 1], "count": 10**9} for i in range(2)}
    load_sweep(sweep())
    tracemalloc.start()
    try:
        assert faults_of(sweep(grid=axes)) == [
            "grid.tracker.a0: error: makes 1,000,000,000 points; at most 20,000 are allowed",
            "grid.tracker.a1: error: makes 1,000,000,000 points; at most 20,000 are allowed",
        ]
        assert tracemalloc.get_traced_memory()[1] < 50_000_000, "of 16 GB"
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("vary", "overrides", "fault"),
    [
        (["tracker.particles"], [], "--vary tracker.particles: error: expected KEY=VALUES, such as"),
        (["tracker.particles="], [], "--vary tracker.particles: error: expected KEY=VALUES, such as"),
        (["=1,2"], [], "--vary: error: expected KEY=VALUES, such as"),
        (["a..b=1"], [], "--vary a..b: error: expected KEY=VALUES, such as"),
        (["tracker.particles=1,,2"], [], "--vary tracker.particles: error: not valid YAML:"),
        (["tracker.particles=1]"], [], "--vary tracker.particles: error: not valid YAML:"),
        (["tracker.particles=1,1"], [], "--vary tracker.particles: error: grid.tracker.particles.1: 1 is in"),
        (["tracker.particles=1", "tracker.particles=2"], [],
         "--vary tracker.particles: error: is given twice: write all of its values in one --vary"),
        (["tracker.partcles=1"], [], "--vary tracker.partcles: error: unknown key, did you mean 'particles'?"),
        (["tracker.particles=1,x"], [], "--vary tracker.particles: error: expected a pure number, got the text 'x'"),
        (["tracker.particles=[1,2]"], [], "--vary tracker.particles: error: expected a whole number, got a list"),
        (["seed={range: [1, 2], count: 1000000000}"], [],
         "--vary seed: error: grid.seed: makes 1,000,000,000 points; at most 20,000 are allowed"),
        (["name=a,b"], [], "--vary name: error: grid.name: 'name' is not a key of a scenario that can be varied"),
        ([], ["tracker.partcles=1"], "--set tracker.partcles: error: unknown key, did you mean 'particles'?"),
        ([], ["tracker.particles"], "--set tracker.particles: error: expected KEY=VALUE, such as"),
        ([], ["tracker.particles=x"], "--set tracker.particles: error: expected a pure number, got the text 'x'"),
        (["tracker.particles=1,2"], ["tracker.particles=5"],
         "--set tracker.particles: error: is an axis of this sweep; --vary takes other values for it"),
    ],
)  # fmt: skip
def test_a_fault_of_the_command_line_names_its_option(vary: list[str], overrides: list[str], fault: str) -> None:
    (found,) = faults_of("small", vary, overrides)
    assert found.startswith(fault)


@pytest.mark.parametrize(
    ("given_", "fault"),
    [
        ({"timeout": "soon"}, "--timeout: error: expected time (for example '1 s'), got the text 'soon'"),
        ({"replicates": 0}, "--replicates: error: must be at least 1, is 0"),
        ({"name": "a=b"}, "--name: error: 'a=b' cannot name a folder: use letters and digits, then also"),
    ],
)
def test_a_fault_of_another_option_is_not_laid_to_the_file(given_: dict[str, Any], fault: str) -> None:
    (found,) = faults_of(write_yaml("s.yaml", sweep()), **given_)
    assert found.startswith(fault)


def test_a_file_that_names_no_sweep_but_cannot_name_a_folder_is_refused() -> None:
    (found,) = faults_of(write_yaml("a=b.yaml", sweep()))
    assert found.startswith("a=b.yaml:1:1: error: name: 'a=b' cannot name a folder")
    assert load_sweep(write_yaml("a=b.yaml", sweep(name="ab"))).name == "ab"
    write_yaml("a b=c.yaml", base_scenario())
    assert load_sweep("a b=c.yaml", ["seed=1,2"]).name == "a_b_c"


def test_every_fault_of_the_points_is_told_once_and_in_order() -> None:
    content = "scenario: small\ngrid:\n  seed: [1, -1]\n  tracker.particles: [0, 5, x]\n"
    assert faults_of(write_yaml("s.yaml", content)) == [
        "s.yaml:3:13: error: seed: must be at least 0, is -1",
        "s.yaml:4:23: error: tracker.particles: must be at least 1, is 0",
        "s.yaml:4:29: error: tracker.particles: expected a pure number, got the text 'x'",
    ]


def test_the_faults_of_all_parts_of_a_sweep_come_at_once() -> None:
    content = """scenario: [small, smal]
replicates: 0
gird: {seed: [1]}
set: {name: x, link.raech: 3}
grid: {seed: [], step: [1, 1], a=b: [1], tracker.particles: [1, 0]}
zip: {tracker.iterations: [2, 3], link.reach: [80 m]}
points: [{replicates: 2}, {}]
random: {points: 2, over: {duration: {range: [1 s, 9 m]}}}
"""
    found = faults_of(write_yaml("s.yaml", content))
    heads = [one.partition(": error: ")[2].partition(": ")[0] for one in found]
    assert heads == [
        "scenario", "replicates", "gird", "set.name", "link.raech", "grid.seed", "grid.step.1", "grid.a=b",
        "zip.tracker.iterations", "points.0.replicates", "random.over.duration.range",
    ]  # fmt: skip
    assert [int(one.split(":")[1]) for one in found] == [1, 2, 3, 4, 4, 5, 5, 5, 6, 7, 8]


def test_of_a_thousand_faults_a_few_are_told() -> None:
    assert 20 <= len(faults_of(sweep(grid={PARTICLES: {"range": [-1000, -1], "step": 1}}))) < 25


def test_a_fault_of_the_scenario_stands_in_the_scenario() -> None:
    write_yaml("bad.yaml", base_scenario(seed=-1))
    (found,) = faults_of(write_yaml("sweeps/s.yaml", "scenario: ../bad.yaml\ngrid: {tracker.particles: [1, 2]}\n"))
    assert found.endswith("error: seed: must be at least 0, is -1")
    assert "bad.yaml:2:7" in found


def test_a_scenario_that_is_not_there_is_told_where_the_sweep_names_it() -> None:
    (found,) = faults_of(write_yaml("s.yaml", "grid: {seed: [1]}\nscenario: [small, pso_mhfp]\n"))
    assert found == (
        "s.yaml:2:19: error: scenario: file not found, and no shipped scenario has this name (did you mean 'pso_mhpf'?)"
    )


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("scenario: small\ngrid: {a: [1, 2\n", "s.yaml:3:1: error: not valid YAML:"),
        ("scenario: small\nscenario: small\n", "s.yaml:2:1: error: duplicate key 'scenario' (first at line 1)"),
        ("", "s.yaml:1:1: error: is empty"),
        ("grid: {seed: [1]}\n", "s.yaml:1:1: error: scenario: is missing: the scenario to vary, or several"),
        ("scenario: 3\n", "s.yaml:1:11: error: scenario: expected text, got the number 3"),
        ("scenario: small\nuntil: 3\n", "s.yaml:2:8: error: until: expected a mapping, got the number 3"),
    ],
)
def test_a_file_that_is_no_sweep_says_why(content: str, fault: str) -> None:
    name = write_yaml("s.yaml", content)
    assert is_sweep(name)
    found = faults_of(name)
    assert any(one.startswith(fault) for one in found), found


def test_a_binary_file_is_refused() -> None:
    Path("s.yaml").write_bytes(b"scenario: small\0")
    assert faults_of("s.yaml") == ["s.yaml: error: is a binary file (or not UTF-8), expected YAML text"]


# Which file -------------------------------------------------------------------------------------------------------


def test_a_sweep_is_told_from_a_scenario_and_from_what_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    write_yaml("s.yaml", sweep())
    Path("folder").mkdir()
    assert [is_sweep(name) for name in ("s.yaml", "s", Path("s.yaml"))] == [True] * 3
    names = ("small.yaml", "small", "pso_mhpf", "nothing", "folder", "", "/", "n" * 5000, "a\0b")
    assert [is_sweep(name) for name in names] == [False] * len(names)


def test_shipped_sweeps_are_found_by_name_and_a_file_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    place = Path(write_yaml("away/mine.yaml", sweep(scenario="../small", grid={"seed": [1]}))).resolve()
    monkeypatch.setattr("wsnsim.scenario.texts.shipped_sweeps", lambda: {"mine": place})
    for name in ("mine", "mine.yaml"):
        assert is_sweep(name)
        assert load_sweep(name).name == "mine"
        assert settings_of(name) == [{"seed": 1}]
    write_yaml("mine.yaml", sweep(grid={"seed": [2]}))
    assert settings_of("mine") == [{"seed": 2}]


def test_a_name_that_nobody_has_is_told_with_the_nearest() -> None:
    (found,) = faults_of("pso_mhfp", ["seed=1,2"])
    assert found.endswith("file not found, and no shipped scenario has this name (did you mean 'pso_mhpf'?)")
    assert len(faults_of("n" * 5000)) == 1


@pytest.mark.thorough
def test_every_shipped_sweep_is_a_plan() -> None:
    for name in shipped_sweeps():
        plan = load_sweep(name)
        assert isinstance(plan, Plan)
        assert plan.name == name
        assert len(plan.points) > 1
