"""The examples of docs/plugins.md pass their checks and run, as they are printed there."""

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

PAGE = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text(encoding="utf-8")
MODULES = dict(re.findall(r"```python\n# (\w+)\.py\n(.*?)```", PAGE, re.DOTALL))
SCENARIOS = dict(re.findall(r"```yml\n(.*?kind: \"(\w+):.*?)```", PAGE, re.DOTALL))
CHECKS = {
    "punctual": ("Punctual", {}, testing.check_tracker),
    "overheating": ("Overheating", {"at": 0.1}, testing.check_fault),
    "shelf": ("Shelf", {}, testing.check_battery),
    "convergecast": ("Convergecast", {}, testing.check_workload),
    "reference": ("Reference", {}, testing.check_sync),
    "neighbourhood": ("Neighbourhood", {}, testing.check_wakeup),
    "nearby": ("Nearby", {}, lambda policy: demand_port(type(policy), "clusters")),
    "aloha": ("PureAloha", {}, testing.check_mac),
    "camera": ("Camera", {}, lambda sensor: testing.check_tracker(ExtendedKalman(), sensor=sensor)),
}


@pytest.fixture
def module(request, tmp_path, monkeypatch):
    """A module of the page, importable by its name."""
    (tmp_path / f"{request.param}.py").write_text(MODULES[request.param], encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module(request.param)
    del sys.modules[request.param]


def test_every_example_of_the_page_is_checked_and_has_a_scenario():
    assert MODULES.keys() == CHECKS.keys() == set(SCENARIOS.values())


@pytest.mark.parametrize("module", CHECKS, indirect=True)
def test_an_example_passes_its_check(module):
    name, fields, check = CHECKS[module.__name__]
    fields = {**fields, "fraction": 0.5} if check is testing.check_fault else fields
    check(getattr(module, name)(**fields))


@pytest.mark.parametrize("module", CHECKS, indirect=True)
def test_an_example_runs_from_its_scenario(module, tmp_path):
    (text,) = (text for text, name in SCENARIOS.items() if name == module.__name__)
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    result = wsnsim.experiment.simulate_run(wsnsim.load(path, ["duration=4 s"]))
    assert result.run["frames_sent"] > 0
