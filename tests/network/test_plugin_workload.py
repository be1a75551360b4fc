"""A workload plug-in with a mechanism of its own sends in a run that starts from a scenario."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import pytest

import wsnsim
from wsnsim.base.errors import ScenarioError
from wsnsim.base.part import Quantity, part
from wsnsim.models.workloads import Periodic
from wsnsim.testing import check_workload

HERE = "tests.network.test_plugin_workload"


@part
class Convergecast:
    """Every node sends one datagram to node 0 at a random time of the first `within` s, and once broadcasts."""

    mechanism = "convergecast"
    within: Annotated[float, Quantity("s", ge=0.1, le=1e6), "all nodes send within this time"] = 2.0

    def start(self, services):
        """Return the mechanism."""
        return Sends(self, services)


class Sends:
    """What the nodes do; `arrived` counts the datagrams at node 0."""

    def __init__(self, component, services):
        self._component = component
        self._services = services
        self._word = services.code_of("hello")
        self.arrived = 0

    def begin(self):
        """Set a timer per node."""
        count = len(self._services.positions)
        for node in range(1, count):
            self._services.call_later(self._component.within * node / count, partial(self._send, node))

    def _send(self, node):
        services = self._services
        if services.is_awake(node):
            services.broadcast(node, 96, self._word)
            services.send(node, 0, 200, "sample", self._note)

    def _note(self, arrived):
        self.arrived += arrived


def scenario(**changes):
    """A grid of 25 nodes, of which the far ones reach node 0 over several hops."""
    said = {
        "name": "convergecast",
        "seed": 3,
        "duration": 5.0,
        "deploy": {"kind": "grid", "nodes": 25, "width": 250.0, "height": 250.0, "cover": False},
        "energy": {"kind": "first_order"},
        "link": {"kind": "disk", "reach": 75.0},
        "mac": {"kind": "csma"},
        "workload": {"kind": f"{HERE}:Convergecast"},
    }
    return {**said, **changes}


@pytest.mark.thorough
def test_a_plug_in_broadcasts_and_sends_over_several_hops_in_a_run_that_starts_from_a_scenario(tmp_path):
    out = tmp_path / "run.h5"
    wsnsim.run(scenario(), replicates=1, out=out)
    events = wsnsim.read(out, "events")
    sent = events[events["kind"] == "send"]
    assert (sent["what"] == "hello").sum() == 24
    assert (sent["what"] == "sample").sum() == 24
    samples = events[events["what"] == "sample"]
    assert (samples["kind"] == "relay").sum() > 12, "far nodes are relayed"
    assert ((samples["kind"] == "receive") & (samples["node"] == 0)).sum() > 12
    assert wsnsim.read(out, "runs")["energy"].sum() > 0


@pytest.mark.thorough
def test_a_plug_in_works_on_the_ideal_channel_and_with_crashed_nodes():
    faults = [{"kind": "crash", "at": 0.5, "fraction": 0.5}]
    whole = wsnsim.experiment.simulate_run(scenario(mac={"kind": "ideal"})).run
    halved = wsnsim.experiment.simulate_run(scenario(mac={"kind": "ideal"}, faults=faults)).run
    assert 0 < halved["frames_sent"] < whole["frames_sent"]


def test_the_shipped_check_accepts_the_plug_in():
    check_workload(Convergecast())


def test_the_shipped_check_names_a_workload_that_never_sends():
    @part
    class Silent:
        mechanism = "silent"

        def start(self, services):
            return Nothing()

    class Nothing:
        def begin(self):
            pass

    with pytest.raises(AssertionError, match="sends"):
        check_workload(Silent())


def test_a_mechanism_that_is_neither_built_in_nor_started_is_refused_at_its_place():
    with pytest.raises(ScenarioError, match=r"workload.kind: .*lacks 'start'.*'drum'"):
        wsnsim.experiment.simulate_run(scenario(workload={"kind": f"{HERE}:Unstarted"}))


@part
class Unstarted(Periodic):
    """A component that names a mechanism that does not exist."""

    mechanism = "drum"
