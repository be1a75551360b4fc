"""The density on a grid, against closed forms and NumPy twins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erfc
from scipy.stats import norm

from wsnsim.kernels.grid import spread, weigh

LOW, WIDTH, CELLS = -20.0, 0.1, 400
MIDDLES = LOW + WIDTH * (np.arange(CELLS) + 0.5)


def spread_twin(masses, moved, deviations, low, width, cells):
    """A row a source cell: the density at all middles within eight deviations, scaled to the mass on the grid."""
    middles, high = low + width * (np.arange(cells) + 0.5), low + width * cells
    used = (masses > 1e-20) & np.isfinite(moved) & np.isfinite(deviations)
    masses, moved, deviations = masses[used], moved[used, None], deviations[used, None]
    white = (middles - moved) / deviations
    rows = np.where(np.abs(white) < 8.0 + width / deviations, np.exp(-0.5 * white**2), 0.0)
    below = 0.5 * erfc((moved - low) / deviations / np.sqrt(2.0))
    above = 0.5 * erfc((high - moved) / deviations / np.sqrt(2.0))
    total = rows.sum(axis=1, keepdims=True)
    rows = rows * np.divide(1.0 - below - above, total, out=np.zeros_like(total), where=total > 0.0)
    rows[:, 0] += np.where(total > 0.0, below, moved < low)[:, 0]
    rows[:, -1] += np.where(total > 0.0, above, moved > high)[:, 0]
    return masses @ rows / masses.sum()


def weigh_twin(masses, logs):
    """Bayes' rule."""
    with np.errstate(divide="ignore"):
        scores = np.log(masses) + np.where(np.isnan(logs), -np.inf, logs)
    result = np.exp(scores - scores.max())
    return result / result.sum()


def gaussian(mean, deviation):
    """(CELLS,) masses of a normal law."""
    masses = norm.pdf(MIDDLES, mean, deviation)
    return masses / masses.sum()


def test_spreading_is_its_twin() -> None:
    rng = np.random.default_rng(0)
    masses = rng.dirichlet(np.full(CELLS, 0.2))
    moved = rng.uniform(-23.0, 23.0, CELLS)
    deviations = rng.uniform(WIDTH, 30 * WIDTH, CELLS)
    found = spread(masses, moved, deviations, LOW, WIDTH, CELLS)
    assert found == pytest.approx(spread_twin(masses, moved, deviations, LOW, WIDTH, CELLS), rel=1e-9, abs=1e-14)


def test_weighing_is_its_twin() -> None:
    rng = np.random.default_rng(1)
    masses = rng.dirichlet(np.full(CELLS, 0.2))
    masses[:50] = 0.0
    logs = rng.normal(0.0, 100.0, CELLS)
    logs[60], logs[61] = np.nan, -np.inf
    assert weigh(masses, logs) == pytest.approx(weigh_twin(masses, logs), rel=1e-9, abs=1e-200)


@pytest.mark.parametrize("deviation", [WIDTH, 0.3, 2.0])
def test_a_mass_in_one_place_becomes_a_normal_law(deviation) -> None:
    """At the middles against the density, to 3e-9 of its top; between them against the cumulative law."""
    found = spread(np.ones(1), np.array([1.234]), np.array([deviation]), LOW, WIDTH, CELLS)
    density = norm.pdf(MIDDLES, 1.234, deviation)
    assert found / WIDTH == pytest.approx(density, abs=6e-9 * density.max())
    assert found @ MIDDLES == pytest.approx(1.234, abs=1e-8)
    assert found @ (MIDDLES - 1.234) ** 2 == pytest.approx(deviation**2, rel=1e-6)


def test_spreading_a_normal_law_by_a_linear_motion_gives_the_convolved_one() -> None:
    found = spread(gaussian(4.0, 1.2), 0.8 * MIDDLES - 1.0, np.full(CELLS, 0.7), LOW, WIDTH, CELLS)
    expected = gaussian(0.8 * 4.0 - 1.0, np.hypot(0.8 * 1.2, 0.7))
    assert found == pytest.approx(expected, abs=1e-9 * expected.max())


def test_mass_is_conserved_and_what_leaves_is_kept_at_the_edge_that_it_left_by() -> None:
    masses = np.full(CELLS, 1.0 / CELLS)
    for shift in (-1e9, -39.0, 0.0, 15.0, 1e9):
        found = spread(masses, MIDDLES + shift, np.full(CELLS, 1.0), LOW, WIDTH, CELLS)
        assert found.sum() == pytest.approx(1.0, rel=1e-12) and found.min() >= 0.0
    assert found[-1] == pytest.approx(1.0)
    found = spread(np.ones(1), np.array([-19.0]), np.array([2.0]), LOW, WIDTH, CELLS)
    assert found[0] == pytest.approx(norm.cdf(-20.0, -19.0, 2.0) + WIDTH * norm.pdf(-19.95, -19.0, 2.0), rel=1e-4)


def test_a_window_far_wider_than_the_grid_leaves_half_at_either_edge() -> None:
    found = spread(np.ones(1), np.zeros(1), np.array([1e12]), LOW, WIDTH, CELLS)
    assert found[[0, -1]] == pytest.approx([0.5, 0.5], abs=1e-9)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_cells_without_a_finite_image_are_made_up_for_by_the_rest(broken) -> None:
    masses, moved = np.array([0.5, 0.25, 0.25]), np.array([broken, -5.0, 5.0])
    found = spread(masses, moved, np.ones(3), LOW, WIDTH, CELLS)
    expected = (gaussian(-5.0, 1.0) + gaussian(5.0, 1.0)) / 2
    assert found == pytest.approx(expected, abs=1e-9)
    nothing = spread(masses, np.full(3, broken), np.ones(3), LOW, WIDTH, CELLS)
    assert nothing == pytest.approx(np.full(CELLS, 1.0 / CELLS))


def test_a_normal_law_weighed_with_a_normal_likelihood_is_the_conjugate_one_however_unlikely() -> None:
    logs = norm.logpdf(5.0, MIDDLES, 0.5) - 1e5
    precision = 1 / 1.5**2 + 1 / 0.5**2
    expected = gaussian((2.0 / 1.5**2 + 5.0 / 0.5**2) / precision, precision**-0.5)
    assert weigh(gaussian(2.0, 1.5), logs) == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_a_likelihood_that_contradicts_all_but_a_slight_mass_picks_that() -> None:
    masses = np.array([1.0 - 1e-200, 1e-200, 0.0])
    assert weigh(masses, np.array([-1e5, 0.0, 1e5])) == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("nothing", [-np.inf, np.nan, np.inf])
def test_where_nothing_is_possible_the_masses_stay(nothing) -> None:
    masses = gaussian(0.0, 1.0)
    assert np.array_equal(weigh(masses, np.full(CELLS, nothing)), masses)
