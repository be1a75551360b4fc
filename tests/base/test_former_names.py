"""Plug-ins that subclass a shipped component and override a member under its former name are still heard."""

from __future__ import annotations

import numpy as np
import pytest

import wsnsim
from wsnsim.base import ports, radio, sleeping
from wsnsim.base.clustering import head_protocol
from wsnsim.base.continuous_power import continuous_power
from wsnsim.base.errors import Issue, RunError, ScenarioError
from wsnsim.base.part import part
from wsnsim.models.clusters import StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.faults import Crash

HERE = "tests.base.test_former_names"


@part
class Thirsty(FirstOrder):
    """An energy model with the former name of `mode_power`."""

    def draw(self, mode):
        return radio.ModePower(5.0, False, 0.0, False)


@part
class Strict(StrongestSignal):
    """A policy with the former name of `check`."""

    def faults(self, parts):
        yield Issue(("clusters",), "this policy refuses everything")


@part
class Open(StrongestSignal):
    """A policy with a former flag."""

    is_open = True


@part
class Hollow(Crash):
    """A fault whose mechanism can do nothing."""

    mechanism = "hollow"

    def start(self, services):
        return object()


def test_an_overridden_power_counts():
    with pytest.warns(DeprecationWarning, match="mode_power"):
        power = continuous_power(Thirsty())
    assert power.mode_power(radio.Mode.AWAKE).radio == 5.0


def test_an_overridden_check_counts():
    with pytest.warns(DeprecationWarning, match="check"), pytest.raises(ScenarioError, match="refuses everything"):
        wsnsim.experiment.simulate_run(wsnsim.load("pso_mhpf", ["duration=0.4 s", f"clusters.kind={HERE}:Strict"]))


def test_an_overridden_flag_counts():
    with pytest.warns(DeprecationWarning, match="protocol"):
        assert head_protocol(Open()) == "open"
    assert head_protocol(StrongestSignal()) == "standing"


@pytest.mark.parametrize(
    ("module", "former", "present"),
    [(radio, "Draw", "ModePower"), (radio, "Draws", "ContinuousPower"), (sleeping, "Plan", "WakeUpPlan"),
     (sleeping, "Message", "WakeUpMessage")],
)  # fmt: skip
def test_a_former_class_name_gives_the_present_class(module, former, present):
    with pytest.warns(DeprecationWarning, match=present):
        assert getattr(module, former) is getattr(module, present)


def test_other_names_are_not_found():
    with pytest.warns(DeprecationWarning, match="requests"):
        assert ports.Member is wsnsim.Member
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        ports.Nothing  # noqa: B018


def test_a_mechanism_that_lacks_members_is_refused_by_name():
    scenario = wsnsim.load("pso_mhpf", ["duration=0.4 s", f"faults=[{{kind: '{HERE}:Hollow', at: 0.1 s, nodes: [1]}}]"])
    with pytest.raises(
        RunError, match=r"Hollow\.start: expected a FaultMechanism, not <object .*>, which lacks begin, end"
    ):
        wsnsim.experiment.simulate_run(scenario)


def test_a_star_import_warns_of_nothing():
    assert "compared" not in wsnsim.__all__
    assert np.all([hasattr(wsnsim, name) for name in wsnsim.__all__])
