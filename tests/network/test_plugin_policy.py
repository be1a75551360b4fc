"""A cluster policy of an earlier version, with flags in place of `protocol`, still runs as the built-in policy does."""

from __future__ import annotations

import pytest

import wsnsim
from wsnsim.base.part import part
from wsnsim.models.clusters import Central, MovingHead, StrongestSignal

HERE = "tests.network.test_plugin_policy"


class _Flags:
    """What a policy offered before `protocol` existed; the built-in policy decides everything else."""

    is_open = False
    moves = False
    calls_election = False
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
class Standing(_Flags):
    """A standing cluster by its flags."""


@part
class Electing(_Flags):
    """A standing cluster whose successor calls an election, by its flags."""

    calls_election = True


@part
class Open(_Flags):
    """An open cluster by its flags."""

    is_open = True
    minimum_active = 0
    decides = Central()


@part
class Moving(_Flags):
    """A moving head by its flags."""

    moves = True
    minimum_active = 1
    main = "detection"
    sampling, quiet, cap, patience = 2e-3, 6e-3, 20e-3, 3.0
    decides = MovingHead()


BUILT_IN = {
    "Standing": ("pso_mhpf", "{kind: strongest_signal}"),
    "Electing": ("pso_mhpf", "{kind: strongest_signal, successor_rule: elect}"),
    "Open": ("ekf_real", "{kind: central}"),
    "Moving": ("ekf_real", "{kind: moving_head, main: detection, quiet: 6 ms, cap: 20 ms}"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", BUILT_IN)
def test_a_policy_with_flags_gives_the_same_run_as_the_built_in_policy(name):
    scenario, built_in = BUILT_IN[name]
    expected = wsnsim.experiment.simulate_run(wsnsim.load(scenario, ["duration=1 s", f"clusters={built_in}"]))
    with pytest.warns(DeprecationWarning, match="replaced by `protocol`"):
        found = wsnsim.experiment.simulate_run(
            wsnsim.load(scenario, ["duration=1 s", f"clusters={{kind: {HERE}:{name}}}"])
        )
    assert found.run["fingerprint"] == expected.run["fingerprint"]
