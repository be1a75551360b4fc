"""Scenarios: from text to frozen, checked components. pydantic and yaml are imported with the first scenario.

setup = build(load("scenarios/pso_mhpf.yaml", ["seed=7"]))
"""

from wsnsim.scenario.build import build, plugins, resolved
from wsnsim.scenario.load import Overrides, listed, load
from wsnsim.scenario.registry import Plugins
from wsnsim.scenario.texts import shipped

__all__ = ["Overrides", "Plugins", "build", "listed", "load", "plugins", "resolved", "shipped"]
