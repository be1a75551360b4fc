"""A field is fitted to the nodes of a file, and coordinates of a map grid give the results of small coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.node_file import FromFile

UTM = (512_345.6, 4_180_123.4)
"""m: an easting and a northing of zone 10."""


def nodes_file(folder: Path, origin: tuple[float, float] = (0.0, 0.0)) -> str:
    """A grid of 6 by 5 nodes, 40 m apart, with an origin."""
    places = [(40.0 * i + origin[0], 40.0 * j + origin[1]) for i in range(6) for j in range(5)]
    path = folder / f"nodes_{origin[0]:.0f}.csv"
    path.write_text("x,y\n" + "".join(f"{x!r},{y!r}\n" for x, y in places))
    return str(path)


def scenario_of(folder: Path, origin: tuple[float, float], tracker: dict[str, Any]) -> dict[str, Any]:
    """A target that crosses the field, with everything at an origin."""
    track = folder / f"track_{origin[0]:.0f}.csv"
    points = [(0.0, 10.0, 20.0), (6.0, 90.0, 60.0), (12.0, 180.0, 120.0)]
    track.write_text("time,x,y\n" + "".join(f"{t},{x + origin[0]!r},{y + origin[1]!r}\n" for t, x, y in points))
    return {
        "name": "grid", "seed": 4, "duration": 12.5, "step": 0.5, "prior": {"sd": [4.0, 2.0, 4.0, 2.0]},
        "deploy": {"kind": "file", "path": nodes_file(folder, origin), "fit": True, "margin": 10.0, "cover": False},
        "motion": {"kind": "recorded_track", "path": str(track), "q": 1.0},
        "sensor": {"kind": "range", "sd": 1.0, "reach": 70.0}, "energy": {"kind": "first_order"},
        "link": {"kind": "disk", "reach": 100.0}, "tracker": tracker,
    }  # fmt: skip


def estimates(folder: Path, origin: tuple[float, float], tracker: dict[str, Any]) -> np.ndarray:
    """(K, 2) the estimated positions about the origin."""
    memory = Memory(RECORDED_BY_DEFAULT)
    replicate_of(scenario.build(scenario.load(scenario_of(folder, origin, tracker))), 0, memory)
    table = memory.table("estimates")
    return np.column_stack([table["px"], table["py"]]) - np.array(origin)


def test_the_field_is_the_extent_of_the_nodes_and_a_margin(tmp_path: Path) -> None:
    field = FromFile(path=nodes_file(tmp_path, UTM), fit=True, margin=5.0).field
    assert (field.width, field.height) == pytest.approx((210.0, 170.0))
    assert field.centre == pytest.approx((UTM[0] + 100.0, UTM[1] + 80.0))
    tight = FromFile(path=nodes_file(tmp_path, UTM), fit=True)
    assert tight.field.contains(tight.draw(0.0, np.random.default_rng(0))).all()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "tracker", [{"kind": "ekf"}, {"kind": "ukf"}, {"kind": "central_pf", "particles": 300}], ids=lambda one: one["kind"]
)
def test_coordinates_of_a_map_grid_give_the_estimates_of_small_ones(tracker: dict[str, Any], tmp_path: Path) -> None:
    here, there = estimates(tmp_path, (0.0, 0.0), tracker), estimates(tmp_path, UTM, tracker)
    assert len(here) == len(there) == 24
    # coordinates of 4e6 m have steps of 1e-9 m; filters amplify them, and a resampled particle may be another one
    limit = 0.5 if "particles" in tracker else 1e-5
    assert np.abs(here - there).max() < limit


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"fit": True, "width": 300.0}, "width, height and centre come from the nodes then: leave them out"),
        ({"margin": 3.0}, "margin goes with fit: true"),
        ({"fit": True, "path": "missing.csv"}, "missing.csv: cannot be read"),
        ({"path": "far.csv"}, "far.csv:2: (512346, 4.18012e+06) m is outside the field"),
        ({"path": "far.csv", "fit": True, "columns": {"x": "east"}}, "the header must name the columns east and y"),
    ],
)
def test_what_cannot_be_fitted_is_an_issue(
    more: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.csv").write_text(f"x,y\n{UTM[0]},{UTM[1]}\n{UTM[0] + 9},{UTM[1]}\n")
    text = scenario_of(tmp_path, (0.0, 0.0), {"kind": "ekf"})
    text["deploy"] = {"kind": "file", "path": nodes_file(tmp_path), "cover": False, **more}
    with pytest.raises(ScenarioError) as caught:
        scenario.build(scenario.load(text))
    assert words in str(caught.value)
