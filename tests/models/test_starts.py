"""A target starts in the field that its network monitors."""

import pytest

from wsnsim import scenario
from wsnsim.base.errors import ScenarioError

OUTSIDE = {
    "bounded_velocity": {"start": [0, 0, 201, 0]},
    "constant_velocity": {"start": [0, 0, 201, 0]},
    "constant_acceleration": {"start": [201, 0, 0]},
}


def issues(*motions: dict, **changes) -> list[str]:
    source = scenario.resolved(scenario.load("jiang_field")) | changes
    del source["motion"]
    size = 3 if motions[-1]["kind"] == "constant_acceleration" else 4
    source |= {"targets": list(motions)} if len(motions) > 1 else {"motion": motions[0]}
    source["prior"] = {"sd": [1] * size}
    try:
        scenario.build(scenario.load(source))
    except ScenarioError as error:
        return str(error).splitlines()
    return []


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_start_outside_the_field_is_a_fault(kind: str) -> None:
    (issue,) = issues({"kind": kind, **OUTSIDE[kind]})
    assert issue.startswith("motion.start: error: (") and "outside the field of 400 m by 400 m around (0, 0)" in issue


def test_the_fault_is_that_of_the_target_which_it_concerns() -> None:
    inside = {"kind": "bounded_velocity", "start": [0, 0, 199, 0]}
    (issue,) = issues(inside, {"kind": "bounded_velocity", **OUTSIDE["bounded_velocity"]})
    assert issue.startswith("targets.1.start: error: ")


@pytest.mark.parametrize("kind", OUTSIDE)
def test_without_a_network_nobody_monitors_a_field(kind: str) -> None:
    assert issues({"kind": kind, **OUTSIDE[kind]}, network="none") == []
