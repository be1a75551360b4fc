"""The public names of the root and of `wsnsim.plugins`."""

from __future__ import annotations

import subprocess
import sys

import pytest
from matplotlib import pyplot

import wsnsim
from wsnsim import plugins

HEAVY = ("numpy", "pandas", "numba", "matplotlib", "h5py", "pydantic", "simpy")


@pytest.mark.parametrize("module", [wsnsim, plugins], ids=["root", "plugins"])
def test_every_public_name_exists_and_is_listed(module):
    assert len(set(module.__all__)) == len(module.__all__) > 30
    assert [name for name in module.__all__ if getattr(module, name, None) is None] == []
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match="has no attribute 'chek_tracker'"):
        module.chek_tracker  # noqa: B018


@pytest.mark.thorough
def test_errors_checks_and_the_recorder_are_at_the_root():
    assert issubclass(wsnsim.ScenarioError, wsnsim.WsnsimError)
    memory = wsnsim.Memory()
    wsnsim.experiment.simulate_run(wsnsim.load("rkf", {"duration": 2}), 0, memory)
    assert len(memory.table("estimates")["error"]) == 1
    assert wsnsim.build(wsnsim.load("rkf")).tracker == wsnsim.trackers.Rkf()


@pytest.mark.thorough
def test_plot_and_bound_are_at_the_root(tmp_path):
    from wsnsim.bounds import bound

    assert wsnsim.bound is wsnsim.bounds.bound is bound
    result = wsnsim.run("rkf", replicates=1, out=tmp_path / "a.h5", duration=2)
    for given in (result, tmp_path / "a.h5", str(tmp_path / "a.h5")):
        assert wsnsim.plot(given, "error").get_title(loc="left").startswith("position error")
        assert wsnsim.plot(given, "states", column="vx").get_ylabel() == result.plot.states("vx").get_ylabel()
    _, axes = pyplot.subplots()
    assert wsnsim.plot(result, ax=axes) is axes
    pyplot.close("all")
    with pytest.raises(wsnsim.UsageError, match=r"no option 'colum' \(did you mean 'column'\?\)"):
        wsnsim.plot(result, "states", colum="vx")
    with pytest.raises(wsnsim.UsageError, match=r"no plot 'eror' \(did you mean 'error'\?\)"):
        wsnsim.plot(result, "eror")


def test_importing_the_package_and_its_lists_of_names_imports_nothing_heavy():
    script = f"""
import sys, wsnsim, wsnsim.api, wsnsim.plugins, wsnsim.models, wsnsim.trackers
print([name for name in {HEAVY} if name in sys.modules])"""
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
