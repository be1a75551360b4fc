"""Whether nodes cover the field, against dense sampling and against cases that can be done by hand."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import KDTree

import wsnsim.models.coverage as sensing_coverage
from tests.helpers.thorough import thorough
from wsnsim.models.coverage import TOLERANCE, coverage, covers, nodes_needed


def farthest(positions, width, height, side=201):
    """How far the worst of a dense lattice of points, edges and corners included, is from its nearest node."""
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, side), np.linspace(-height / 2, height / 2, side))
    apart = np.hypot(x[..., None] - positions[:, 0], y[..., None] - positions[:, 1])
    return apart.min(axis=-1).max()


def grid(columns, rows, width, height):
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * width
    y = ((np.arange(rows) + 0.5) / rows - 0.5) * height
    return np.array([(a, b) for b in y for a in x])


@pytest.mark.thorough
@given(st.integers(1, 40), st.floats(50, 400), st.floats(50, 400), st.floats(0.9, 1.1), st.integers(0, 2**32 - 1))
def test_covering_agrees_with_dense_sampling(nodes, width, height, factor, seed):
    positions = (np.random.default_rng(seed).random((nodes, 2)) - 0.5) * np.array([width, height])
    needed, spacing = farthest(positions, width, height), max(width, height) / 200
    reach = needed * factor
    assume(not needed - 1e-9 <= reach <= needed + spacing)  # between lattice points the sampling cannot tell
    assert covers(positions, reach, width, height) == (reach > needed)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [300, *thorough([1500])])
def test_one_hole_among_many_nodes_is_found(count):
    """More nodes than the neighbours tried first, all around a hole of 10 m."""
    draw = np.random.default_rng(count)
    positions = (draw.random((count, 2)) - 0.5) * 400
    hole = np.array([37.0, -81.0])
    outside = positions[np.hypot(*(positions - hole).T) > 70.0]
    assert not covers(outside, 60.0, 400, 400)
    assert covers(np.vstack([outside, hole]), 60.0, 400, 400) == (
        farthest(np.vstack([outside, hole]), 400, 400) <= 60.0
    )


def test_a_grid_whose_discs_meet_exactly_covers_and_a_hair_less_does_not():
    positions = grid(5, 4, 500, 400)
    assert covers(positions, 50 * math.sqrt(2) * (1 + 1e-12), 500, 400)
    assert not covers(positions, 50 * math.sqrt(2) * (1 - 1e-6), 500, 400)


def test_one_node_covers_a_square_from_its_middle_if_it_reaches_the_corners():
    middle = np.zeros((1, 2))
    assert covers(middle, 50 * math.sqrt(2) * (1 + 1e-12), 100, 100)
    assert not covers(middle, 70.0, 100, 100)
    assert not covers(middle, 49.0, 100, 100)
    assert covers(middle, 1e6, 100, 100)


def test_a_node_in_a_corner_must_reach_the_opposite_one():
    corner = np.array([[-50.0, -50.0]])
    assert covers(corner, 141.5, 100, 100)
    assert not covers(corner, 141.0, 100, 100)


def test_nodes_that_share_a_place_cover_no_more_than_one():
    assert not covers(np.zeros((5, 2)), 60.0, 100, 100)
    assert not covers(np.array([[0.0, 0.0], [1e-12, 0.0]]), 60.0, 100, 100)
    assert covers(np.zeros((5, 2)), 71.0, 100, 100)


def test_a_gap_at_the_edge_alone_is_found():
    """Three nodes in a row cover the middle line, but not the edge between two of them."""
    positions = np.array([[-40.0, 0.0], [0.0, 0.0], [40.0, 0.0]])
    assert covers(positions, math.hypot(20, 30) * (1 + 1e-12), 120, 60)
    assert not covers(positions, math.hypot(20, 30) - 0.01, 120, 60)


def test_nobody_covers_nothing():
    nobody = np.empty((0, 2))
    assert not covers(nobody, 60.0, 100, 100)
    assert coverage(nobody, 60.0, 100, 100) == 0.0


def test_ten_thousand_nodes_are_no_trouble():
    positions = grid(100, 100, 4000, 4000)
    assert covers(positions, 28.3, 4000, 4000)
    assert not covers(np.delete(positions, 5050, axis=0), 28.3, 4000, 4000)


def test_nodes_looked_at_in_turns_are_judged_as_those_looked_at_together(monkeypatch):
    monkeypatch.setattr("wsnsim.models.coverage.AT_ONCE", 7)
    positions = grid(10, 10, 400, 400)
    assert covers(positions, 28.3, 400, 400)
    for missing in (0, 6, 7, 55, 99):
        assert not covers(np.delete(positions, missing, axis=0), 28.3, 400, 400)


def test_the_covered_fraction_is_an_area():
    assert coverage(np.zeros((1, 2)), 30.0, 100, 100) == pytest.approx(math.pi * 0.09, abs=2e-3)
    assert coverage(np.zeros((1, 2)), 71.0, 100, 100) == 1.0
    assert coverage(np.array([[-100.0, 0.0], [100.0, 0.0]]), 40.0, 400, 200) == pytest.approx(math.pi * 0.04, abs=2e-3)


@given(st.floats(10, 200), st.floats(50, 500), st.floats(50, 500))
def test_fewer_nodes_than_the_bound_never_cover(reach, width, height):
    """Half the diagonal is what one node needs; the densest lattice of discs wastes a fifth."""
    needed = nodes_needed(reach, width, height)
    assert needed >= width * height / (math.pi * reach**2)
    if needed > 1:
        assert not covers(np.zeros((1, 2)), reach, width, height)


def test_the_bound_of_the_papers_field_is_eighteen_nodes():
    assert nodes_needed(60.0, 400, 400) == 18


@given(st.integers(1, 300), st.floats(10, 900), st.floats(10, 900), st.floats(0.01, 0.6), st.integers(0, 2**32 - 1))
def test_coverage_is_the_share_of_cells_whose_nearest_node_is_within_range(nodes, width, height, reach, seed):
    positions = (np.random.default_rng(seed).random((nodes, 2)) - 0.5) * np.array([width, height]) * 1.3
    reach *= max(width, height)
    x, y = (length * ((np.arange(50) + 0.5) / 50 - 0.5) for length in (width, height))
    middles = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    expected = np.mean(KDTree(positions).query(middles)[0] < reach * (1 + TOLERANCE))
    assert coverage(positions, reach, width, height, side=50) == expected


@pytest.mark.thorough
def test_covering_does_not_depend_on_how_neighbours_are_found(monkeypatch):
    draw = np.random.default_rng(8)
    fields = [(draw.random((nodes, 2)) - 0.5) * 400 for nodes in (20, 90, 200, 400) for _ in range(5)]
    few = [covers(positions, reach, 400, 400) for positions in fields for reach in (40.0, 60.0, 90.0)]
    monkeypatch.setattr(sensing_coverage, "SMALL", 0)
    assert few == [covers(positions, reach, 400, 400) for positions in fields for reach in (40.0, 60.0, 90.0)]
    assert True in few and False in few
