"""Trackers of a comparison, each with its own parameters."""

from __future__ import annotations

import json

import pytest

from wsnsim import part
from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.tracker_choices import column_of, tracker_choices
from wsnsim.trackers.multi_target.single_gaussian import Gnn


def read(text):
    return [(one.name, {".".join(map(str, keys[1:])): node.plain() for keys, node in one.assignments})
            for one in tracker_choices(text)]  # fmt: skip


def tracker_of(point):
    return json.loads(point.resolved)["tracker"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("pf,ekf", [("pf", {"kind": "pf"}), ("ekf", {"kind": "ekf"})]),
        (" pf , ekf ", [("pf", {"kind": "pf"}), ("ekf", {"kind": "ekf"})]),
        ("pf:particles=1000,ekf", [("pf:particles=1000", {"kind": "pf", "particles": 1000}), ("ekf", {"kind": "ekf"})]),
        (
            "ekf,pf:particles=10,assumes.noise_scale=4,pf:particles=20",
            [
                ("ekf", {"kind": "ekf"}),
                ("pf:particles=10,assumes.noise_scale=4", {"kind": "pf", "particles": 10, "assumes.noise_scale": 4}),
                ("pf:particles=20", {"kind": "pf", "particles": 20}),
            ],
        ),
        ("pf: particles = 7", [("pf:particles=7", {"kind": "pf", "particles": 7})]),
        ("pf:x=[1, 2],y={a: 1, b: 2}", [
            ("pf:x=[1, 2],y={a: 1, b: 2}", {"kind": "pf", "x": [1, 2], "y": {"a": 1, "b": 2}}),
        ]),
        ("pf:path='a,b=c',z=\"d,e\"", [("pf:path='a,b=c',z=\"d,e\"", {"kind": "pf", "path": "a,b=c", "z": "d,e"})]),
        ("mylab.trackers:Mine", [("mylab.trackers:Mine", {"kind": "mylab.trackers:Mine"})]),
        ("mylab.trackers:Mine:size=3", [("mylab.trackers:Mine:size=3", {"kind": "mylab.trackers:Mine", "size": 3})]),
    ],
)  # fmt: skip
def test_kinds_and_their_parameters_are_read(text, expected):
    assert read(text) == expected


@pytest.mark.parametrize(
    ("text", "message", "column"),
    [
        ("pf,,ekf", "expected a tracker, such as", 3),
        ("", "expected a tracker, such as", 0),
        ("particles=3,pf", "'particles=3' stands before the first tracker", 0),
        ("pf:", "pf: expected KEY=VALUE after the colon, not ''", 0),
        ("ekf, pf:particles", "pf: expected KEY=VALUE after the colon, not 'particles'", 5),
        ("pf:particles=", "pf: particles has no value", 3),
        ("pf:particles=1,particles=2", "pf: particles is given twice", 15),
        ("pf,ekff", "unknown tracker 'ekff' (did you mean 'ekf'?)", 3),
        ("pf:x=[1,2", "is never closed: ] is missing", 5),
        ("pf:x='1,2", "is never closed: ' is missing", 5),
        ("pf:1=2", "pf: expected KEY=VALUE after the colon, not '1=2'", 0),
    ],
)
def test_what_cannot_be_read_is_refused_at_its_place(text, message, column):
    with pytest.raises(ScenarioError) as refused:
        tracker_choices(text)
    (issue,) = refused.value.issues
    assert message in issue.message and issue.place == "--trackers"
    assert issue.excerpt.splitlines()[1] == " " * (4 + column) + "^"


@pytest.mark.parametrize(
    ("trackers", "message"),
    [
        ("pf:partcles=1000,ekf", "--trackers pf:partcles: error: unknown key, did you mean 'particles'?"),
        ("pf:particles=0", "--trackers pf:particles: error: "),
        ("ekf:assumes.noise=1", "--trackers ekf:assumes.noise: error: "),
    ],
)
def test_what_a_tracker_does_not_take_is_named_with_the_nearest(trackers, message):
    with pytest.raises(ScenarioError) as refused:
        load_sweep("jiang_field", trackers=trackers)
    assert str(refused.value).startswith(message), str(refused.value)


def test_points_have_their_own_parameters_and_the_names_of_their_trackers():
    plan = load_sweep("jiang_field", trackers="pf:particles=1000,assumes.noise_scale=2,ekf,pf")
    assert plan.keys == ("tracker",)
    assert [point.settings for point in plan.points] == [
        {"tracker": "pf:particles=1000,assumes.noise_scale=2"}, {"tracker": "ekf"}, {"tracker": "pf"},
    ]  # fmt: skip
    assert [tracker_of(point)["kind"] for point in plan.points] == ["pf", "ekf", "pf"]
    first, _, default = map(tracker_of, plan.points)
    assert (first["particles"], first["assumes"]["noise_scale"]) == (1000, 2.0)
    assert default["particles"] != 1000 and default["assumes"]["noise_scale"] == 1.0
    assert len({point.world for point in plan.points}) == 1, "all follow the same target"


def test_trackers_without_parameters_are_the_points_that_an_axis_of_kinds_makes():
    """Folders of earlier campaigns are resumed."""
    plan = load_sweep("jiang_field", ["tracker.particles=100,200"], trackers="pf,ipf")
    axis = load_sweep("jiang_field", ["tracker.kind=pf,ipf", "tracker.particles=100,200"])
    assert plan.keys == axis.keys == ("tracker.kind", "tracker.particles")
    assert plan.points == axis.points


def test_a_parameter_is_not_varied_twice():
    with pytest.raises(ScenarioError, match=r"'tracker\.particles' is an axis twice"):
        load_sweep("jiang_field", ["tracker.particles=100,200"], trackers="pf:particles=50")
    with pytest.raises(ScenarioError, match="are the same point"):
        load_sweep("jiang_field", trackers="pf,pf")


def test_the_column_is_that_of_the_kind_unless_a_tracker_has_parameters():
    assert column_of(tracker_choices("pf,ekf")) == "tracker.kind"
    assert column_of(tracker_choices("pf,ekf:assumes.noise_scale=3")) == "tracker"


HOLDS = {
    "kind": "jpda",
    "gate": 0.99,
    "filter": {"kind": "ukf", "kappa": 1},
    "management": {"kind": "sprt", "support": 2},
}
MINE = {"extends": "scans_crossing", "name": "mine", "tracker": HOLDS}


@part
class PickyGnn(Gnn):
    """Takes no other filter than ekf."""

    def check(self, setup):
        if not type(self.filter).__name__.startswith("Ekf"):
            yield Issue(("tracker", "filter"), "PickyGnn takes ekf")


@pytest.mark.parametrize(
    "how",
    [{"trackers": "gnn,mht"}, {"trackers": [{"kind": "gnn"}, "mht"]}, {"vary": ["tracker.kind=gnn,mht"]}],
    ids=["option", "Python", "axis"],
)
def test_another_tracker_of_several_targets_keeps_the_filter_and_the_management_and_no_other_key(how):
    base = tracker_of(load_sweep(MINE).points[0])
    found = [tracker_of(point) for point in load_sweep(MINE, **how).points]
    assert [one["kind"] for one in found] == ["gnn", "mht"]
    for one in found:
        assert one["filter"] == base["filter"] and one["management"] == base["management"]
        assert base["gate"] == 0.99 and one["gate"] != base["gate"]


def test_a_choice_may_change_what_it_keeps():
    points = load_sweep(MINE, trackers="gnn:filter.kind=ckf,pda:management.support=4,lmb:filter.kappa=0").points
    ckf, pda, lmb = map(tracker_of, points)
    assert ckf["filter"]["kind"] == "ckf" and "kappa" not in ckf["filter"] and ckf["management"]["support"] == 2
    assert pda["filter"]["kappa"] == 1.0 and pda["management"]["support"] == 4
    assert lmb["filter"]["kappa"] == 0.0


@pytest.mark.parametrize(
    ("base", "trackers", "message"),
    [
        (MINE, f"{__name__}:PickyGnn,gnn", "tracker.filter: error: PickyGnn takes ekf"),
        (MINE, "gnn,ekf", "ekf follows one target"),
        ("two_targets", "ekf,gnn", "tracker.filter: is missing"),
    ],
)
def test_what_another_kind_cannot_keep_is_refused_with_one_message(base, trackers, message):
    with pytest.raises(ScenarioError) as refused:
        load_sweep(base, trackers=trackers)
    assert len(refused.value.issues) == 1 and message in str(refused.value)
