"""A cluster policy of somebody else, which inherits from none of ours, runs as the built-in of its protocol does."""

from __future__ import annotations

import pytest

import wsnsim
from wsnsim.base.part import part
from wsnsim.models.clusters import Central, MovingHead, StrongestSignal

HERE = "tests.network.test_plugin_policy"


class _Policy:
    """What every policy offers; the built-in policy decides."""

    protocol = "standing"
    minimum_active = 3
    threshold = None
    decides = StrongestSignal()

    def elect(self, ids, strengths, able):
        return self.decides.elect(ids, strengths, able)

    def must_hand_over(self, active, members):
        return self.decides.must_hand_over(active, members)

    def successor(self, forecast, positions, able):
        return self.decides.successor(forecast, positions, able)


@part
class Standing(_Policy):
    """A standing cluster."""


@part
class Electing(_Policy):
    """A standing cluster whose successor calls an election."""

    protocol = "electing"


@part
class Open(_Policy):
    """An open cluster."""

    protocol = "open"
    minimum_active = 0
    decides = Central()


@part
class Moving(_Policy):
    """A moving head."""

    protocol = "moving"
    minimum_active = 1
    main = "detection"
    sampling, quiet, cap, patience = 2e-3, 6e-3, 20e-3, 3.0
    decides = MovingHead()


BUILT_IN = {
    "Standing": ("pso_mhpf", "{kind: strongest_signal}"),
    "Electing": ("pso_mhpf", "{kind: strongest_signal, successor_rule: elect}"),
    "Open": ("ekf_real", "{kind: central}"),
    "Moving": ("ekf_real", "{kind: moving_head, main: detection, quiet: 6 ms, cap: 20 ms}", "mac.idle_slots=skipped"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", BUILT_IN)
def test_a_policy_of_somebody_else_gives_the_same_run_as_the_built_in_policy(name):
    scenario, built_in, *sets = BUILT_IN[name]
    expected = wsnsim.experiment.simulate_run(wsnsim.load(scenario, ["duration=1 s", *sets, f"clusters={built_in}"]))
    own = wsnsim.load(scenario, ["duration=1 s", *sets, f"clusters={{kind: {HERE}:{name}}}"])
    found = wsnsim.experiment.simulate_run(own)
    assert found.run["fingerprint"] == expected.run["fingerprint"]


@part
class Unnamed:
    """A policy that does not say what its heads do."""

    minimum_active, threshold = 3, None
    elect = must_hand_over = successor = _Policy.elect


def test_a_policy_without_a_protocol_is_refused():
    with pytest.raises(wsnsim.ScenarioError, match=r"lacks 'protocol', which every clusters needs"):
        wsnsim.load("pso_mhpf", [f"clusters={{kind: {HERE}:Unnamed}}"])
