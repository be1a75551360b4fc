"""A text becomes frozen objects. pydantic and yaml live here, and are imported at the first scenario.

parts = build(load("scenarios/pso_mhpf.yaml", ["seed=7"]))
"""

from wsnsim.scenario.build import build, plugins, resolved
from wsnsim.scenario.load import load, shipped

__all__ = ["build", "load", "plugins", "resolved", "shipped"]
