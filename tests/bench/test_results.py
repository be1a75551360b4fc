"""The campaign that the benchmark reads. This is tested; what it measures never is."""

from __future__ import annotations

import pytest

import wsnsim
from tests.bench.results import RUNS, SIZE, campaign_of_copies


@pytest.mark.thorough
def test_a_campaign_of_copies_is_read_as_one_of_as_many_points(tmp_path) -> None:
    folder = campaign_of_copies(tmp_path / "x", 3)
    frame = wsnsim.read(folder.path, "runs")
    assert frame["tracker.particles"].tolist() == [number for number in range(3) for _ in range(RUNS)]
    assert frame["replicate"].tolist() == list(range(RUNS)) * 3
    assert next(folder.path.glob("*/r*.h5")).stat().st_size < 1000 * SIZE
