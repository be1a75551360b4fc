"""Stone Soup's updaters run in the head, and results become Stone Soup's tracks and detections (`make peers`)."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wsnsim
from tests.distribution.pythons import HOME
from tests.distribution.versions import REQUIRED
from tests.helpers import unlabelled
from wsnsim.base.errors import ResultError, ScenarioError, UsageError
from wsnsim.interop import stonesoup

KIND = "wsnsim.interop.stonesoup:StoneSoupFilter"
MISSING = importlib.util.find_spec("stonesoup") is None and os.environ.get(REQUIRED) != "required"
needs_stonesoup = pytest.mark.skipif(MISSING, reason="Stone Soup is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")
SENSORS = {
    "range": {"kind": "range", "sd": 1.0, "reach": 70.0},
    "bearing": {"kind": "bearing", "sd": 0.03, "reach": 70.0},
    "range_bearing": {"kind": "range_bearing", "reach": 70.0},
}


def scenario(tracker: dict[str, Any], sensor: str = "range") -> dict[str, Any]:
    """A target that crosses a grid of 30 nodes on an ideal channel."""
    return {
        "name": "crossing", "seed": 4, "duration": 8.0, "step": 0.5, "prior": {"sd": [4.0, 2.0, 4.0, 2.0]},
        "deploy": {"kind": "grid", "nodes": 30, "width": 240.0, "height": 200.0, "cover": False},
        "motion": {"kind": "waypoints", "points": [[0.0, -80.0, -40.0], [4.0, 0.0, 10.0], [8.0, 70.0, 60.0]], "q": 1.0},
        "sensor": SENSORS[sensor], "energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": 150.0},
        "tracker": tracker,
    }  # fmt: skip


def positions(result: Any) -> np.ndarray:
    """(K, 2) estimated positions."""
    return result.estimates[["px", "py"]].to_numpy()


@needs_stonesoup
@pytest.mark.parametrize("sensor", sorted(SENSORS))
@pytest.mark.parametrize(
    ("updater", "ours"),
    [("extended", {"kind": "ekf"}), ("unscented", {"kind": "ukf", "kappa": 0.0}), ("cubature", {"kind": "ckf"})],
)
def test_a_stone_soup_updater_in_the_head_estimates_what_ours_does(
    updater: str, ours: dict[str, Any], sensor: str
) -> None:
    theirs = wsnsim.simulate(scenario({"kind": KIND, "updater": updater}, sensor))
    mine = wsnsim.simulate(scenario(ours, sensor))
    # sigma points are drawn from the linearised prediction here, and passed through the (linear) motion there
    assert np.abs(positions(theirs) - positions(mine)).max() < 1e-6
    packets = [result.runs["packets"].iloc[0] for result in (theirs, mine) if "packets" in result.runs]
    assert len(set(packets)) <= 1


@needs_stonesoup
def test_the_tracker_passes_the_contract_check() -> None:
    from wsnsim.testing import check_tracker

    check_tracker(stonesoup.StoneSoupFilter())


@needs_stonesoup
def test_results_become_tracks_truths_and_detections(tmp_path: Path) -> None:
    keep = ["estimates", "covariances", "readings", "nodes", "truth"]
    result = wsnsim.simulate(scenario({"kind": "ekf"}, "range_bearing"), keep=keep)
    (track,) = stonesoup.to_tracks(result)
    table, covs = result.estimates, result.table("covariances")
    assert len(track) == len(table) and track.metadata["target"] == 0
    last = track[-1]
    assert np.asarray(last.state_vector, float).ravel().tolist() == table[["px", "vx", "py", "vy"]].iloc[-1].tolist()
    assert float(last.covar[0, 2]) == covs["cov_px_py"].iloc[-1] and np.allclose(last.covar, last.covar.T)
    assert (last.timestamp - stonesoup.START).total_seconds() == pytest.approx(table["time"].iloc[-1])
    (path,) = stonesoup.to_truths(result)
    assert len(path) == len(result.table("truth"))
    detections = stonesoup.to_detections(result)
    readings, nodes = result.table("readings"), result.table("nodes").set_index("node")
    assert sum(len(found) for _, found in detections) == len(readings) / 2
    one = next(iter(detections[3][1]))
    assert one.state_vector.shape == (2, 1) and one.metadata["x"] == nodes.loc[one.metadata["node"], "x_assumed"]
    file = tmp_path / "x.h5"
    result.save(file)
    (again,) = stonesoup.to_tracks(file)
    assert [list(a.state_vector) for a in again] == [list(a.state_vector) for a in track]


@needs_stonesoup
def test_the_examples_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    page = (HOME / "docs" / "how-to" / "standalone.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```\{code-block\} python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    assert len(blocks) == 2 and "(4, 4)" in capsys.readouterr().out


@needs_stonesoup
def test_the_iterated_updater_stays_as_near_as_ours() -> None:
    theirs = wsnsim.simulate(scenario({"kind": KIND, "updater": "iterated"}))
    mine = wsnsim.simulate(scenario({"kind": "ekf", "iterations": 20}))
    assert np.abs(positions(theirs) - positions(mine)).max() < 1e-2


@needs_stonesoup
def test_what_was_not_recorded_is_named() -> None:
    result = wsnsim.simulate(scenario({"kind": "ekf"}), keep=["estimates"])
    with pytest.raises(ResultError, match="table readings was not recorded"):
        stonesoup.to_detections(result)
    (track,) = stonesoup.to_tracks(result)
    assert not hasattr(track[-1], "covar")


def test_without_stone_soup_a_scenario_is_refused_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stonesoup, "is_installed", lambda: False)
    with pytest.raises(ScenarioError, match=r"Stone Soup is not installed: pip install 'wsnsim\[stonesoup\]'"):
        wsnsim.simulate(scenario({"kind": KIND}))
    with pytest.raises(UsageError, match="Stone Soup is not installed"):
        stonesoup.to_tracks("x.h5")


def test_tracks_that_no_reading_names_are_refused_with_what_to_read_instead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stonesoup, "is_installed", lambda: True)
    with pytest.raises(ResultError, match="take its tables estimates and detections"):
        stonesoup.to_tracks(unlabelled.write_result(tmp_path / "x.h5"))
