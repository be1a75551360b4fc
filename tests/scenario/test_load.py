"""From a text to a scenario: places and words of every kind of fault, extends, --set, dicts, bad files."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.helpers.files import write_yaml
from tests.helpers.scenario_components import base_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError

pytestmark = pytest.mark.usefixtures("fresh_folder")


def test_every_fault_of_a_file_is_told_at_once_and_at_its_place() -> None:
    bad = f"""\
name: bad
duration: 28 s
deploy: {{kind: "{kind("Deploy")}", heigth: 400 m}}
motion: {{kind: "{kind("Motion")}", start: [1, 2 s, 3, 4]}}
link: {{   reach: 75 kbit/s, kind: "{kind("Link")}"}}
sensor: {{kind: "{kind("Sensor")}", reach: -60 m, samples: 10.5}}
energy: {{kind: frist_order}}
tracker:
  kind: pso_mhfp
seed: 1
seed: 2
"""
    assert faults_of(write_yaml("bad.yaml", bad)) == [
        "bad.yaml:3:9: error: deploy.nodes: is missing: number of nodes",
        f"bad.yaml:3:{bad.splitlines()[2].index('heigth') + 1}: error: deploy.heigth: "
        "unknown key, did you mean 'height'?",
        f"bad.yaml:4:{bad.splitlines()[3].index('2 s') + 1}: error: motion.start.1: "
        "'s' is a unit of time, expected length (for example '1 m')",
        "bad.yaml:5:18: error: link.reach: 'kbit/s' is a unit of data rate, expected length (for example '1 m')",
        f"bad.yaml:6:{bad.splitlines()[5].index('-60') + 1}: error: sensor.reach: must be greater than 0, is -60",
        f"bad.yaml:6:{bad.splitlines()[5].index('10.5') + 1}: error: sensor.samples: expected a whole number, got 10.5",
        "bad.yaml:7:16: error: energy.kind: unknown energy 'frist_order' (did you mean 'first_order'?)",
        "bad.yaml:9:9: error: tracker.kind: unknown tracker 'pso_mhfp' (did you mean 'pso_mhpf'?)",
        "bad.yaml:11:1: error: duplicate key 'seed' (first at line 10)",
    ]


@pytest.mark.thorough(fast=["changes0-faults0"])
@pytest.mark.parametrize(
    ("changes", "faults"),
    [
        ({"seed": True}, ["seed: error: expected a whole number, got true"]),
        ({"seed": -1}, ["seed: error: must be at least 0, is -1"]),
        ({"replicates": 2.5}, ["replicates: error: expected a whole number, got 2.5"]),
        ({"replicates": 0}, ["replicates: error: must be at least 1, is 0"]),
        ({"name": "a/b"}, [
            "name: error: 'a/b' cannot name a file: use letters and digits, then also '_', '-' and '.'",
        ]),
        ({"name": 2013}, ["name: error: expected text, got the number 2013"]),
        ({"duration": "4.01 s"}, ["duration: error: 4.01 s is not a whole number of steps of 0.04 s (nearest: 4 s)"]),
        ({"duration": 0.01}, ["duration: error: 0.01 s is 0 steps of 0.04 s; 1 to 1e+07 are allowed"]),
        ({"duration": 1e12}, ["duration: error: 1e+12 s is 2.5e+13 steps of 0.04 s; 1 to 1e+07 are allowed"]),
        ({"duration": float("inf")}, ["duration: error: must be finite"]),
        ({"duration": float("nan")}, ["duration: error: expected time (for example '1 s'), got not-a-number"]),
        ({"duration": None}, ["duration: error: is missing: simulated time [s]"]),
        ({"until": {"clusters": 0}}, ["until.clusters: error: must be at least 1, is 0"]),
        ({"until": {"cluster": 3}}, [
            "until.cluster: error: unknown key, did you mean 'clusters'?",
            "until.clusters: error: is missing: end when the cluster of this number would hand over",
        ]),
        ({"record": {"evnts": True}}, ["record.evnts: error: unknown key, did you mean 'events'?"]),
        ({"record": {"events": "on"}}, ["record.events: error: expected true or false, got the text 'on'"]),
        ({"recrod": {}}, ["recrod: error: unknown key, did you mean 'record'?"]),
        ({"mac": 3}, ["mac: error: expected a mapping such as {kind: ideal}, got the number 3"]),
        ({"link": {}}, ["link.kind: error: is missing; known: disk, log_normal, recorded"]),
        ({"link": {"kind": 3}}, ["link.kind: error: expected the name of a kind, got the number 3"]),
        ({"sensor": None}, ["sensor: error: is missing: what a node measures of the target"]),
        ({"motion": None}, ["motion: error: is missing: how the target moves (or 'targets', a list of them)"]),
        ({"targets": [{"kind": kind("Motion")}]}, ["targets: error: give either 'motion' or 'targets', not both"]),
        ({"motion": None, "targets": []}, ["targets: error: expected a list of motions, got nothing"]),
        ({"motion": None, "targets": [{"kind": kind("Motion"), "bound": 0}, {"kind": "brownian"}]}, [
            "targets.0.bound: error: must be greater than 0, is 0",
            "targets.1.kind: error: unknown motion 'brownian' "
            "(known: bounded_velocity, constant_acceleration, constant_velocity, coordinated_turn, crossing, "
            "gauss_markov, random_waypoint, recorded_track, ungm, visits, waypoints)",
        ]),
        ({"motion": {"kind": kind("Motion"), "start": [1, 2]}}, [
            "motion.start: error: expected a list of 4 items, got 2",
        ]),
        ({"motion": {"kind": kind("Motion"), "start": 3}}, [
            "motion.start: error: expected a list of 4 items, got the number 3",
        ]),
        ({"prior": {"kind": kind("Prior"), "sd": [1, 0, "x"]}}, [
            "prior.sd.1: error: must be greater than 0, is 0",
            "prior.sd.2: error: expected a pure number, got the text 'x'",
        ]),
        ({"link": {"kind": kind("Link"), "reach": 75, "loss": 1}}, ["link.loss: error: must be less than 1, is 1"]),
        ({"sensor": {"kind": kind("Sensor"), "decay": float("inf")}}, ["sensor.decay: error: must be finite"]),
        ({"deploy": {"kind": kind("Deploy"), "nodes": 16, "cover": 1}}, [
            "deploy.cover: error: expected true or false, got the number 1",
        ]),
        ({"tracker": {"kind": kind("Tracker"), "measurements": "al"}}, [
            "tracker.measurements: error: unknown value 'al' (did you mean 'all'?)",
        ]),
        ({"tracker": {"kind": kind("Tracker"), "assumes": {"gains": "no"}}}, [
            "tracker.assumes.gains: error: unknown value 'no' (known: estimated, known, unknown)",
        ]),
        ({"tracker": {"kind": kind("Tracker"), "filter_noise_scale": 0}}, [
            "tracker.filter_noise_scale: error: must be at least 1e-09, is 0",
        ]),
        ({"tracker": {"kind": kind("Tracker"), "gains": "unknown", "assumes": {"gains": "known"}}}, [
            "tracker: error: 'gains' and 'assumes.gains' are the same: give one of them",
        ]),
    ],
)  # fmt: skip
def test_a_fault_of_a_dict_is_named_by_its_keys(changes: dict, faults: list[str]) -> None:
    assert faults_of(base_scenario(**changes)) == faults


def test_numbers_and_quantities_are_read_as_si() -> None:
    loaded = scenario.load(
        base_scenario(
            duration="0.1 min",
            deploy={"kind": kind("Deploy"), "nodes": 400.0, "width": "0.4 km"},
            energy={"kind": kind("Energy"), "electronics": "50 nJ/bit", "battery": ".inf"},
            link={"kind": kind("Link"), "reach": 75, "power": "-30 dBm"},
        )
    )
    assert (loaded.duration, loaded.steps) == (6.0, 150)
    assert (loaded.deploy.nodes, type(loaded.deploy.nodes), loaded.deploy.width) == (400, int, 400.0)
    assert loaded.energy.electronics == 5e-8
    assert loaded.energy.battery == float("inf")
    assert loaded.link.power == 1e-6


def test_a_scenario_is_frozen_and_equal_to_one_that_says_the_same() -> None:
    loaded = scenario.load(base_scenario())
    assert loaded == scenario.load(base_scenario(duration="4 s"))
    assert loaded != scenario.load(base_scenario(seed=2))
    with pytest.raises(ValueError, match="frozen"):
        loaded.seed = 3


def test_a_scenario_keeps_its_text_and_the_name_of_its_file() -> None:
    text = yaml.safe_dump(base_scenario()) + "# the end\n"
    loaded = scenario.load(write_yaml("kept.yaml", text))
    assert (loaded.source_yaml, loaded.file) == (text, "kept.yaml")
    assert yaml.safe_load(scenario.load(base_scenario()).source_yaml) == base_scenario()


def test_a_loaded_scenario_loads_as_itself() -> None:
    loaded = scenario.load(base_scenario())
    assert scenario.load(loaded) is loaded
    assert scenario.load(loaded, ["seed=9"]).seed == 9


# --set


def test_set_follows_the_rules_of_the_file() -> None:
    loaded = scenario.load(base_scenario(), ["link.reach=80 m", "seed=1e2", "record.events=false"])
    assert (loaded.link.reach, loaded.seed, loaded.record.events) == (80.0, 100, False)


@pytest.mark.parametrize(
    ("override", "faults"),
    [
        ("link.reach=1 kJ", ["--set link.reach: error: 'kJ' is a unit of energy, expected length (for example '1 m')"]),
        ("link.raech=5", ["--set link.raech: error: unknown key, did you mean 'reach'?"]),
        ("lnk.reach=5", ["--set lnk.reach: error: lnk: unknown key, did you mean 'link'?"]),
        ("tracker.kind=pso_mhfp", [
            "--set tracker.kind: error: unknown tracker 'pso_mhfp' (did you mean 'pso_mhpf'?)",
        ]),
        ("name.first=x", ["--set name.first: error: name is a single value and has no 'first'"]),
        ("seed", ["--set seed: error: expected KEY=VALUE, such as link.reach='80 m'"]),
        ("seed=", ["--set seed=: error: expected KEY=VALUE, such as link.reach='80 m'"]),
        (".seed=1", ["--set .seed=1: error: expected KEY=VALUE, such as link.reach='80 m'"]),
        ("extends=x", ["--set extends: error: 'extends' is allowed in a file only"]),
        ("mac=[", ["--set mac: error: not valid YAML: while parsing a flow node, did not find expected node content"]),
        ("record={events: 3}", ["--set record: error: record.events: expected true or false, got the number 3"]),
        ("record={events: true, events: false}", [
            "--set record: error: duplicate key 'events' (first at line 1)",
        ]),
    ],
)  # fmt: skip
def test_a_fault_of_set_is_named_by_its_key(override: str, faults: list[str]) -> None:
    assert faults_of(base_scenario(), override) == faults


def test_set_reaches_into_lists_by_number() -> None:
    source = base_scenario(
        motion=None, targets=[{"kind": kind("Motion")}, {"kind": kind("Motion"), "start": [1, 2, 3, 4]}]
    )
    loaded = scenario.load(source, ["targets.1.start.2=9 m", "targets.0.bound=50"])
    assert loaded.targets[1].start == (1, 2, 9, 4)
    assert loaded.targets[0].bound == 50
    assert faults_of(source, "targets.2.bound=1") == [
        "--set targets.2.bound: error: targets has no item 2: it is a list of 2, counted from 0"
    ]


def test_a_kind_that_is_set_replaces_its_role_before_its_fields_are_set() -> None:
    source = base_scenario(tracker={"kind": kind("Tracker"), "particles": 100})
    loaded = scenario.load(source, ["tracker.gains=7", f"tracker.kind={kind('GainTracker')}"])
    assert (loaded.tracker.gains, loaded.tracker.kind) == (7.0, kind("GainTracker"))
    kept = scenario.load(source, [f"tracker.kind={kind('Tracker')}"])
    assert kept.tracker.particles == 100


def test_what_a_kind_that_is_set_lacks_is_a_fault_of_that_set() -> None:
    assert faults_of(base_scenario(), "deploy.kind=file")[0].startswith(
        "--set deploy.kind: error: deploy.path: is missing"
    )


# extends


def test_a_file_that_extends_another_differs_in_what_it_says() -> None:
    Path("bases").mkdir()
    write_yaml("bases/base.yaml", base_scenario(link={"kind": kind("Link"), "reach": 75, "loss": 0.1}))
    child = write_yaml("child.yaml", "extends: bases/base.yaml\nname: child\nlink: {reach: 80 m}\n")
    loaded = scenario.load(child)
    assert (loaded.name, loaded.link.reach, loaded.link.loss) == ("child", 80.0, 0.1)


def test_a_role_whose_kind_changes_is_replaced() -> None:
    write_yaml("base.yaml", base_scenario(tracker={"kind": kind("Tracker"), "particles": 100}))
    child = write_yaml("child.yaml", f"extends: base\ntracker: {{kind: '{kind('GainTracker')}'}}\n")
    assert scenario.load(child).tracker.gains == 3.0


def test_targets_replace_the_motion_of_the_base() -> None:
    write_yaml("base.yaml", base_scenario())
    child = write_yaml(
        "child.yaml", f"extends: base.yaml\ntargets: [{{kind: '{kind('Motion')}'}}, {{kind: '{kind('Motion')}'}}]\n"
    )
    assert len(scenario.build(scenario.load(child)).motions) == 2


def test_a_fault_of_the_base_stands_in_the_base() -> None:
    text = yaml.safe_dump(base_scenario()).replace("reach: 75.0", "reach: 75 kg")
    write_yaml("base.yaml", text)
    row = 1 + next(i for i, line in enumerate(text.splitlines()) if "75 kg" in line)
    child = write_yaml("child.yaml", "extends: base.yaml\nsed: 4\n")
    assert faults_of(child) == [
        f"base.yaml:{row}:10: error: link.reach: 'kg' is a unit of mass, expected length (for example '1 m')",
        "child.yaml:2:1: error: sed: unknown key, did you mean 'seed'?",
    ]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("extends: nowhere_near.yaml", "x.yaml:1:10: error: extends: there is no scenario 'nowhere_near.yaml'"),
        ("extends: x.yaml", "x.yaml:1:10: error: extends: x.yaml extends itself"),
        ("extends: y.yaml", "y.yaml:1:10: error: extends: x.yaml extends itself"),
        ("extends: [y.yaml, a]", "x.yaml:1:19: error: extends: there is no scenario 'a'"),
        ("extends: []", "x.yaml:1:10: error: extends: expected the name of a scenario, or a list"),
    ],
)
def test_a_base_that_is_missing_or_goes_round_is_a_fault(line: str, fault: str) -> None:
    write_yaml("x.yaml", f"{line}\nname: x\n")
    write_yaml("y.yaml", "extends: x.yaml\nname: y\n" if line.split()[-1] == "y.yaml" else "name: y\n")
    (found,) = faults_of("x.yaml")
    assert found.startswith(fault)


def test_of_several_bases_later_ones_count() -> None:
    write_yaml("base.yaml", base_scenario())
    write_yaml("link.yaml", "link: {reach: 60 m}\nseed: 5\n")
    write_yaml("seeds.yaml", "seed: 6\n")
    child = write_yaml("child.yaml", "extends: [base.yaml, link.yaml, seeds.yaml]\nname: child\n")
    loaded = scenario.load(child)
    assert (loaded.name, loaded.link.reach, loaded.seed) == ("child", 60.0, 6)


def test_a_dict_may_extend_a_file() -> None:
    write_yaml("base.yaml", base_scenario())
    assert scenario.load({"extends": "base.yaml", "seed": 77}).seed == 77


def test_the_path_of_a_part_starts_from_the_folder_of_the_file_that_says_it() -> None:
    Path("bases").mkdir()
    write_yaml("bases/base.yaml", base_scenario(deploy={"kind": kind("Deploy"), "nodes": 16, "path": "nodes.csv"}))
    child = write_yaml("child.yaml", "extends: bases/base.yaml\n")
    assert Path(scenario.load(child).deploy.path) == Path("bases/nodes.csv").resolve()
    assert Path(scenario.load(child, ["deploy.path=mine.csv"]).deploy.path) == Path("mine.csv").resolve()


# bad files


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("h5.yaml", b"\x89HDF\r\n\x1a\n\x00", "h5.yaml: error: is a binary file (or not UTF-8), expected YAML text"),
        ("latin.yaml", b"name: \xe9", "latin.yaml: error: is a binary file (or not UTF-8), expected YAML text"),
        ("empty.yaml", b"", "empty.yaml:1:1: error: is empty"),
        ("list.yaml", b"- a\n- b\n", "list.yaml:1:1: error: expected keys such as 'name', got a list"),
        ("word.yaml", b"hello", "word.yaml:1:1: error: expected keys such as 'name', got the text 'hello'"),
        ("big.yaml", b"#" * 10_000_001, "big.yaml: error: is too large for a scenario: the limit is 10 MB"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_scenario_says_so_in_one_message(name: str, content: bytes, message: str) -> None:
    Path(name).write_bytes(content)
    assert faults_of(name) == [message]


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    assert faults_of(tmp_path) == [
        f"{tmp_path}: error: is a folder, expected a scenario file"
        ", or that of a campaign in sweep, compare, watch and info"
    ]


@pytest.mark.parametrize("name", ["pso_mhfp", "nowhere/x.yaml", "", "a\0b", "x" * 5000])
def test_a_file_that_is_missing_says_so(name: str) -> None:
    (fault,) = faults_of(name)
    assert "file not found, and no shipped scenario has this name" in fault or "is a folder" in fault


def test_the_nearest_shipped_scenario_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "wsnsim" / "scenario"
    (tmp_path / "scenarios").mkdir()
    write_yaml("scenarios/quick.yaml", base_scenario(name="quick"))
    monkeypatch.setattr(sys.modules["wsnsim.scenario.texts"], "__file__", str(package / "texts.py"))
    assert scenario.load("quick").name == "quick"
    assert "(did you mean 'quick'?)" in faults_of("quikc")[0]
    Path("quick").mkdir()
    assert scenario.load("quick").name == "quick"


def test_a_byte_order_mark_is_no_fault() -> None:
    Path("bom.yaml").write_bytes(b"\xef\xbb\xbf" + yaml.safe_dump(base_scenario()).encode())
    assert scenario.load("bom.yaml").name == "small"


# anything at all


@given(st.text(max_size=300))
def test_any_text_in_a_file_is_a_scenario_or_a_scenario_error(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(ScenarioError):
        scenario.load(path)


LINES = [
    "name: x", "seed: 1", "duration: 4 s", "duration: 1e", "deploy: {kind: uniform, nodes: 3}", "deploy: [1]", "link:",
    "link: {kind: disk, reach: .nan}", "tracker: {kind: 3}", "tracker: {assumes: 4}", "targets: {a: 1}",
    "targets: [1, {}]", "motion: &m {kind: &k bounded_velocity, start: [*k]}", "sensor: *m", "until: ~",
    "until: {clusters: [1]}", "record: 3", "extends: x", "extends: {}", "prior: {<<: *m}", "1: 2", "~: 3", "'': 4",
    "energy: {kind: 'os:path'}", "mac: {kind: ':'}",
]  # fmt: skip


@pytest.mark.thorough
@given(st.lists(st.sampled_from(LINES), unique=True), st.lists(st.text(max_size=20), max_size=3))
def test_any_pieces_of_scenarios_are_a_scenario_or_a_scenario_error(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str], overrides: list[str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "pieces.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        scenario.load(path, overrides)
    assert all(str(fault) for fault in caught.value.issues)
