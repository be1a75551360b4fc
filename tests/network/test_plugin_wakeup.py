"""A wake-up plug-in with a mechanism of its own wakes nodes in a run that starts from a scenario."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import wsnsim
from tests.helpers.sleeping_networks import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.base.part import part
from wsnsim.base.sleeping import Decision, WakeUpMessage
from wsnsim.models.wakeup import Region
from wsnsim.testing import check_wakeup

KIND = "tests.network.test_plugin_wakeup:Neighbourhood"


@part
class Neighbourhood:
    """The head calls every sleeping neighbour within `radius` of the predicted position; no message is broadcast."""

    mechanism = "neighbourhood"
    carries_belief = False
    wait = 3.0
    call = 5e-3
    radius: float = 40.0

    def compose(self, plan, belief):
        """A message about the predicted position."""
        return WakeUpMessage(
            target=plan.target, step=plan.step, sequence=plan.sequence % 256, sender=plan.sender, place=plan.place,
            centre=plan.prediction, radius=self.radius, fix=plan.fix, heading=plan.heading, due=plan.due,
            expires=plan.due + 1.0, sensing=plan.sensing, reach=plan.reach, bits=104,
        )  # fmt: skip

    def decide(self, place, message, seen, now, chance):
        """Never called: the mechanism decides for the nodes."""
        return Decision.STOP

    def start(self, services):
        """Return the mechanism."""
        return CallsNeighbours(services)


class CallsNeighbours:
    """Calls the sleeping neighbours of a head that stand in the message's region."""

    def __init__(self, services):
        self._services = services

    def begin(self, round):
        """Call them; those that wake track, and so do the head and the neighbours that are awake."""
        services, message = self._services, round.message
        inside = np.intersect1d(services.neighbours(round.node), services.nodes_within(message.centre, message.radius))
        asleep = services.sleepers(inside)
        for node in {round.node, *inside.tolist()} - asleep:
            services.track(round, node, message)
        if asleep:
            services.call(round, round.node, sorted(asleep), message.bits, lambda woken: self._track(round, woken))

    def _track(self, round, nodes):
        for node in nodes:
            self._services.track(round, node, round.message)


@pytest.mark.thorough
def test_a_plug_in_wakes_nodes_in_a_run_that_starts_from_a_scenario(tmp_path):
    said = scenario("gmtt", duration=40.0, wakeup={"kind": KIND})
    out = tmp_path / "run.h5"
    wsnsim.run(said, replicates=1, out=out)
    wakeups, events = wsnsim.read(out, "wakeups"), wsnsim.read(out, "events")
    assert (wakeups["called"] > 0).sum() > 3 and wakeups["forwards"].sum() == 0
    called = events[events["kind"] == "called"]
    assert len(called) == wakeups["called"].sum()
    assert (wakeups["woken"] > 1).any(), "nodes track for the step that they were woken for"


@pytest.mark.thorough
def test_the_shipped_check_accepts_the_plug_in():
    check_wakeup(Neighbourhood())


def test_the_shipped_check_names_a_message_for_another_step():
    class Late(Region):
        def compose(self, plan, belief):
            return replace(super().compose(plan, belief), step=plan.step + 1)

    with pytest.raises(AssertionError, match="message"):
        check_wakeup(Late())


def test_a_mechanism_that_is_neither_built_in_nor_started_is_refused_at_its_place():
    said = scenario("gmtt", duration=4.0, wakeup={"kind": "tests.network.test_plugin_wakeup:Unstarted"})
    with pytest.raises(ScenarioError, match=r"wakeup.kind: .*lacks 'start'.*'drum'"):
        wsnsim.experiment.simulate_run(said)


@part
class Unstarted(Region):
    """A component that names a mechanism that does not exist."""

    mechanism = "drum"
