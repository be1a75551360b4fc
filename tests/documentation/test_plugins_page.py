"""The examples of docs/plugins.md, files in docs/plugins, pass their checks and run from the scenarios beside them."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

import wsnsim
from wsnsim import testing
from wsnsim.scenario.fields import demand_port
from wsnsim.trackers.ekf import ExtendedKalman

DOCS = Path(__file__).parents[2] / "docs"


def check_laboratory(tracker):
    """The sensor, the motion and the tracker of `mylab.py`, apart and together."""
    module = sys.modules[type(tracker).__module__]
    testing.check_sensor(module.Bearing())
    testing.check_motion(module.Friction())
    testing.check_tracker(tracker)
    testing.check_tracker(tracker, motion=module.Friction(), sensor=module.Bearing())


CHECKS = {
    "punctual": ("Punctual", {}, testing.check_tracker),
    "overheating": ("Overheating", {"at": 0.1}, testing.check_fault),
    "shelf": ("Shelf", {}, testing.check_battery),
    "convergecast": ("Convergecast", {}, testing.check_workload),
    "reference": ("Reference", {}, testing.check_sync),
    "neighbourhood": ("Neighbourhood", {}, testing.check_wakeup),
    "nearby": ("Nearby", {}, lambda policy: demand_port(type(policy), "clusters")),
    "aloha": ("PureAloha", {}, testing.check_mac),
    "mylab": ("Unscented", {}, check_laboratory),
    "camera": ("Camera", {}, lambda sensor: testing.check_tracker(ExtendedKalman(), sensor=sensor)),
}


@pytest.fixture
def module(request, monkeypatch):
    """A module of the page, importable by its name."""
    monkeypatch.syspath_prepend(DOCS / "plugins")
    yield importlib.import_module(request.param)
    del sys.modules[request.param]


def test_every_example_of_the_page_is_checked_and_has_a_scenario():
    shown = re.findall(r"\]\(plugins/(\w+)\.py\)", (DOCS / "plugins.md").read_text(encoding="utf-8"))
    for ending in ("py", "yaml"):
        assert {path.stem for path in (DOCS / "plugins").glob(f"*.{ending}")} == set(shown) == CHECKS.keys()


@pytest.mark.parametrize("module", CHECKS, indirect=True)
def test_an_example_passes_its_check(module):
    name, fields, check = CHECKS[module.__name__]
    fields = {**fields, "fraction": 0.5} if check is testing.check_fault else fields
    check(getattr(module, name)(**fields))


@pytest.mark.parametrize("module", CHECKS, indirect=True)
def test_an_example_runs_from_its_scenario(module):
    path = DOCS / "plugins" / f"{module.__name__}.yaml"
    result = wsnsim.experiment.simulate_run(wsnsim.load(path, ["duration=4 s"]))
    assert result.run["frames_sent"] > 0
