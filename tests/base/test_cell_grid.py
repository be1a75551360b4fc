"""The grid of cells against SciPy's k-d tree, which is independent of it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree

import wsnsim.base.cell_grid as cell_grid
from wsnsim.base.cell_grid import CellGrid

SEEDS = st.integers(0, 2**32 - 1)


def scattered(seed, count, width, height, lattice):
    """Points of a field, on a lattice (many equal distances, many equal points) or anywhere."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(0, 12, (count, 2)) if lattice else rng.uniform(0.0, 12.0, (count, 2))
    return (steps - 5.0) * np.array([width, height])


FIELDS = (SEEDS, st.integers(1, 400), st.sampled_from([0.0, 1e-3, 1.0, 30.0]), st.sampled_from([0.0, 1.0, 25.0]))


@pytest.mark.thorough
@given(*FIELDS, st.booleans(), st.sampled_from([0.0, 0.5, 1.0, 5.0, 30.0, 75.0, 1e6, math.inf]))
def test_it_finds_what_a_k_d_tree_finds(seed, count, width, height, lattice, radius):
    positions = scattered(seed, count, width, height, lattice)
    places = np.concatenate([positions[:5], scattered(seed + 1, 20, 2 * width, 3 * height, lattice)])
    grid, tree = CellGrid(positions), KDTree(positions)
    expected = tree.query_ball_point(places, radius, return_sorted=True)
    assert [grid.within(place, radius).tolist() for place in places] == list(expected)
    rows, ids = grid.within_each(places, radius)
    assert rows.tolist() == [row for row, near in enumerate(expected) for _ in near]
    assert ids.tolist() == [point for near in expected for point in near]


@pytest.mark.thorough
@given(*FIELDS, st.booleans(), st.sampled_from([0.0, 1.0, 30.0, 75.0]))
def test_links_are_the_pairs_of_a_k_d_tree_in_both_directions(seed, count, width, height, lattice, radius):
    positions = scattered(seed, count, width, height, lattice)
    pairs = KDTree(positions).query_pairs(radius)
    sources, ends = CellGrid(positions).links(radius)
    assert list(zip(sources.tolist(), ends.tolist(), strict=True)) == sorted(pairs | {(b, a) for a, b in pairs})


@given(*FIELDS, st.booleans())
def test_the_nearest_point_is_that_of_a_k_d_tree_also_among_equally_near_ones(seed, count, width, height, lattice):
    positions = scattered(seed, count, width, height, lattice)
    for place in scattered(seed + 1, 10, width, height, lattice):
        assert CellGrid(positions).nearest(place) == KDTree(positions).query(place)[1]


@pytest.mark.parametrize("candidates", [1, 40, 5000])
def test_neither_the_size_of_blocks_nor_clusters_of_points_change_what_is_found(monkeypatch, candidates):
    rng = np.random.default_rng(5)
    positions = np.concatenate([rng.normal(0.0, 1.0, (300, 2)), rng.uniform(-500.0, 500.0, (50, 2))])
    expected = KDTree(positions).query_ball_point(positions, 2.0, return_sorted=True)
    monkeypatch.setattr(cell_grid, "CANDIDATES", candidates)
    rows, ids = CellGrid(positions).within_each(positions, 2.0)
    assert rows.tolist() == [row for row, near in enumerate(expected) for _ in near]
    assert ids.tolist() == [point for near in expected for point in near]
