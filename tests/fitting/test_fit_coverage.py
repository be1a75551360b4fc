"""Intervals of fits hold the truth as often as they say, also where the target only stands at a few points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wsnsim
from tests.fitting import fit_coverage
from tests.fitting.fit_coverage import ANCHORS, DESIGNS, FITS, POINTS

PAGE = Path(__file__).parents[2] / "docs" / fit_coverage.PAGE


def test_no_interval_holds_the_truth_less_often_than_it_says() -> None:
    held = fit_coverage.held()
    assert list(held) == list(DESIGNS)
    assert {len(text) for row in held.values() for text in row.values()} == {FITS}
    corrected = fit_coverage.below(held)
    assert len(corrected) == 35
    assert min(corrected.values()) > 0.05, corrected


@pytest.mark.parametrize(("design", "fits"), [("stays", 20), ("gains", 2), ("heavy tails", 1), ("biases", 2)])
def test_the_stored_outcomes_are_those_of_new_fits(design: str, fits: int) -> None:
    held = fit_coverage.held()[design]
    assert DESIGNS[design].outcomes(fits) == {name: text[:fits] for name, text in held.items()}


def test_the_page_shows_the_stored_outcomes() -> None:
    held = fit_coverage.held()
    assert fit_coverage.in_document(PAGE.read_text(encoding="utf-8")) == fit_coverage.markdown(held)
    assert PAGE.parents[1].joinpath(fit_coverage.TABLE).read_text(encoding="utf-8") == fit_coverage.table(held)


def test_a_sandwich_of_tiny_blocks_is_noticed() -> None:
    """Outcomes as they were when stays were cut into blocks of 10 s: 4 of 16 intervals held the truth."""
    few = {"stays": {"eta": "1000" * 250, "sd": "~" * FITS}, "path": {"eta": "1" * 950 + "0" * 50}}
    corrected = fit_coverage.below(few)
    assert corrected[("stays", "eta")] < 1e-9 and corrected[("path", "eta")] > 0.4
    assert ("stays", "sd") not in corrected


def write_stays(folder: Path, seed: int) -> tuple[list[str], str]:
    """A file for each point where the target stands: a constant of 6 dB for each link and point, 1 dB white."""
    rng = np.random.default_rng(seed)
    rows = [f"{name},{x:g},{y:g}" for name, (x, y) in zip("abcd", ANCHORS, strict=True)]
    (folder / "nodes.csv").write_text("\n".join(["id,x,y", *rows]) + "\n")
    files = []
    for number, (x, y) in enumerate(POINTS):
        means = -50.0 - 20.0 * np.log10(np.hypot(*(ANCHORS - (x, y)).T)) + rng.normal(0.0, 6.0, len(ANCHORS))
        rows = [
            f"{time},{name},{mean + rng.normal(0.0, 1.0):.1f},{x},{y}"
            for time in range(30)
            for name, mean in zip("abcd", means, strict=True)
        ]
        files.append(str(folder / f"p{number}.csv"))
        Path(files[-1]).write_text("\n".join(["time,node,reading,x,y", *rows]) + "\n")
    return files, str(folder / "nodes.csv")


def test_intervals_from_a_few_stays_hold_the_exponent_and_say_what_they_rest_on(tmp_path: Path) -> None:
    held = 0
    for seed in range(1, 17):
        files, nodes = write_stays(tmp_path, seed)
        found = wsnsim.fit(files, nodes, gains=False)
        held += found.values["eta"].low <= 2.0 <= found.values["eta"].high
    assert held >= 14  # 13 or fewer of 16 have a probability of 4 % at a coverage of 95 %
    assert "intervals come from 5 stays of 4 links" in found.text()
    assert "The target never moves" in found.text() and "sd: 5 blocks are fewer than 10" in found.text()
    assert found.values["sd"].approximate and not found.values["eta"].approximate
    assert "(approximate)" in found.yaml()


def test_a_gain_that_one_stay_alone_determines_has_no_interval(tmp_path: Path) -> None:
    files, nodes = write_stays(tmp_path, 1)
    for file in files[1:]:
        lines = Path(file).read_text().splitlines()
        Path(file).write_text("\n".join(line for line in lines if ",d," not in line) + "\n")
    found = wsnsim.fit(files, nodes)
    assert [np.isnan(gain.low) for gain in found.gains][-1] and not np.isnan(found.values["eta"].low)
    assert "A gain has no interval where one block or stay alone determines it." in found.text()
