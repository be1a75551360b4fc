"""Fault components: which fields they accept, and which issues they find in a setup."""

import dataclasses

import pytest

from wsnsim.base.setups import BeaconSetup, NetworkSetup
from wsnsim.models.batteries import Linear
from wsnsim.models.deploy import Anchors, Uniform
from wsnsim.models.energy import FirstOrder
from wsnsim.models.faults import Bias, Blackout, ClockStep, Crash, Drain, LinkLoss, Restart, Stuck
from wsnsim.models.node_file import FromFile

EACH = {
    "crash": Crash(at=1.0, head=0),
    "restart": Restart(at=1.0, nodes=(3,)),
    "drain": Drain(at=1.0, fraction=0.5, share=0.5),
    "blackout": Blackout(at=1.0, region=(0.0, 0.0, 50.0)),
    "link_loss": LinkLoss(at=1.0, fraction=1.0, loss=0.5),
    "clock_step": ClockStep(at=1.0, nodes=(0, 255), offset=-0.1),
    "stuck": Stuck(at=1.0, nodes=(1,)),
    "bias": Bias(at=1.0, head=1, offset=2.0),
}


def company(kind=NetworkSetup, **given):
    """A setup of 10 s with 256 nodes on 400 m x 400 m and two targets; all other roles are None."""
    roles = {"steps": 100, "dt": 0.1, "deploy": Uniform(), "energy": FirstOrder(), "motions": (None, None)}
    names = [field.name for field in dataclasses.fields(kind)]
    return kind(**dict.fromkeys(names) | {name: value for name, value in roles.items() if name in names} | given)


def issues(part, parts=None):
    found = part.check(parts or company())
    return [(".".join(map(str, issue.path)), issue.message) for issue in found]


@pytest.mark.parametrize("mechanism", EACH)
def test_each_of_them_names_its_mechanism_and_can_be(mechanism):
    part = EACH[mechanism]
    assert part.mechanism == mechanism
    assert issues(part) == []


def test_they_last_for_good_unless_they_say_how_long_and_a_restart_no_time():
    assert Crash(at=1.0, head=0).duration is None
    assert Restart(at=1.0, head=0).duration == 0.0


@pytest.mark.parametrize(
    ("part", "path", "words"),
    [
        (Crash(at=1.0), "faults", "no nodes given: give exactly one of nodes, fraction, region, head"),
        (Crash(at=1.0, head=0, nodes=(1,)), "faults", "nodes given by nodes and head"),
        (Crash(at=company().duration, head=0), "faults.at", "not before the end of the run at"),
        (Crash(at=1.0, nodes=()), "faults.nodes", "at least one node"),
        (Crash(at=1.0, nodes=(0, 256)), "faults.nodes", "no node 256: the 256 nodes are numbered from 0"),
        (Blackout(at=1.0, region=(0.0, 0.0, 0.0)), "faults.region", "greater than 0"),
        (Blackout(at=1.0, region=(300.0, 0.0, 99.0)), "faults.region", "does not touch the field"),
        (Crash(at=1.0, head=2), "faults.head", "no target 2: the targets are numbered from 0 to 1"),
        (Restart(at=1.0, head=0, duration=None), "faults.duration", "needs a duration"),
        (Drain(at=1.0, head=0), "faults", "either joules or a share"),
        (Drain(at=1.0, head=0, joules=1.0, share=0.5), "faults", "either joules or a share"),
        (Drain(at=1.0, head=0, joules=1.0, duration=1.0), "faults.duration", "at once"),
    ],
)
def test_an_impossible_fault_is_an_issue(part, path, words):
    ((found, message),) = issues(part)
    assert found == path
    assert words in message


def test_the_last_instant_and_the_fields_edge_and_corner_belong_to_the_run():
    assert issues(Crash(at=10.0, head=0)) == []
    assert issues(Blackout(at=1.0, region=(300.0, 0.0, 100.0))) == []
    assert issues(Blackout(at=1.0, region=(203.0, 204.0, 5.0))) == []  # 5 m from the corner
    assert len(issues(Blackout(at=1.0, region=(203.0, 204.0, 4.99)))) == 1


def test_nodes_are_counted_where_the_deployment_can_tell():
    two = company(deploy=Anchors(places=((0.0, 0.0), (5.0, 5.0))))
    assert issues(Crash(at=1.0, nodes=(1,)), two) == []
    assert "the 2 nodes" in issues(Crash(at=1.0, nodes=(2,)), two)[0][1]
    assert issues(Crash(at=1.0, nodes=(99,)), company(deploy=FromFile(path="nodes.csv"))) == []


def test_without_a_target_nobody_leads_and_nothing_is_read():
    beacons = company(BeaconSetup)
    assert issues(Crash(at=1.0, nodes=(1,)), beacons) == []
    ((path, message),) = issues(Crash(at=1.0, head=0), beacons)
    assert (path, "without a target" in message) == ("faults.head", True)
    for part in (Stuck(at=1.0, nodes=(1,)), Bias(at=1.0, nodes=(1,), offset=1.0)):
        ((path, _),) = issues(part, beacons)
        assert path == "faults.kind"


def test_a_battery_without_limit_has_no_share():
    endless = company(energy=FirstOrder(battery=float("inf")), battery=Linear())
    assert issues(Drain(at=1.0, head=0, joules=1.0), endless) == []
    ((path, message),) = issues(Drain(at=1.0, head=0, share=0.5), endless)
    assert (path, "give joules" in message) == ("faults.share", True)
