"""No tracker of a shipped scenario is below the posterior bound of its scenario, in a campaign of short runs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign.inline_engine import InlineEngine
from wsnsim import bounds
from wsnsim.papers import measures, reproduce
from wsnsim.papers.reproduction import Experiment, Variant
from wsnsim.scenario import load, resolved, shipped

RUNS = 4
SURE = 7.5
"""Standard errors: Student's t with 3 degrees of freedom is above minus this in 99.75 % of all cases."""
SAME = ("lifetime", "field_1m")
"""Scenarios that do not differ from pso_mhpf and field_10k in short runs."""


def short(name):
    """A shipped scenario with some tens of steps and without its event log."""
    duration = "1 s" if resolved(load(name))["step"] < 0.5 else "10 s"
    return Variant(name, (f"duration={duration}", "record.events=false"))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The campaign of all scenarios with a posterior bound."""
    variants = {name: short(name) for name in shipped() if name not in SAME}
    bounded = {
        name: variant
        for name, variant in variants.items()
        if not bounds.bound({"extends": f"scenarios/{name}.yaml", "duration": variant.sets[0][9:]}, range(1)).reason
    }
    experiment = Experiment("shipped", "", bounded, RUNS, RUNS)
    where = tmp_path_factory.mktemp("shipped")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce, "LocalEngine", InlineEngine)
        assert reproduce.resume(reproduce.begin("liu2012", experiment, where)).complete
    return measures.Data(reproduce.Folder(reproduce.folder_of(where, "liu2012", experiment)))


@pytest.mark.thorough
def test_no_shipped_tracker_is_significantly_below_the_unconditional_bound_of_its_scenario(data):
    seen = {}
    for name in data.variants:
        squares = data.of(name, "runs")["rmse"].to_numpy() ** 2
        found = data.bound(name, "unconditional")
        if np.isfinite(squares).all():  # else some run has no estimate to speak of
            seen[name] = (squares.mean() + SURE * squares.std(ddof=1) / np.sqrt(RUNS)) / (found.rmse**2).mean()
    assert len(seen) >= 18 and min(seen.values()) >= 1.0, seen
    assert min(seen.values()) < 10.0, "of a bound that is far below all of them this would say nothing"
