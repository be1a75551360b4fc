"""Association probabilities against the enumeration of all joint events.

python -m tests.kernels.test_association        writes the error of belief propagation by detection and clutter
"""

from __future__ import annotations

import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from wsnsim.kernels.association import associate

MOST = 10
TABLE = Path(__file__).parents[2] / "docs/explanation/propagation_error.csv"


def enumerated(likelihoods, miss, clutter):
    """(T, M + 1) by visiting each joint event: what every track made, 0 for nothing."""
    tracks, detections = likelihoods.shape
    result = np.zeros((tracks, detections + 1))
    for event in itertools.product(range(detections + 1), repeat=tracks):
        used = [made for made in event if made]
        if len(used) > len(set(used)):
            continue
        weight = math.prod(likelihoods[i, made - 1] if made else miss[i] for i, made in enumerate(event))
        weight *= math.prod(clutter[j] for j in range(detections) if j + 1 not in used)
        for i, made in enumerate(event):
            result[i, made] += weight
    return result / result.sum(axis=1, keepdims=True)


def associate_twin(likelihoods, miss, clutter, most):
    """The probabilities by enumeration, whatever is computed by belief propagation."""
    return enumerated(likelihoods, miss, clutter)


def case(rng, tracks, detections, gated=0.6, probability=0.9, density=0.3):
    """Random likelihoods of a scan with detections about some tracks."""
    squares = rng.exponential(2.0, (tracks, detections))
    likelihoods = probability * np.exp(-squares) * (rng.random(squares.shape) < gated)
    return likelihoods, np.full(tracks, 1.0 - probability), np.full(detections, density) * rng.uniform(0.5, 2.0)


def test_exact_probabilities_are_those_of_the_enumeration_in_a_thousand_cases() -> None:
    rng = np.random.default_rng(1)
    for _ in range(1000):
        given = case(rng, *rng.integers(1, 5, 2), gated=rng.uniform(0.2, 1.0), probability=rng.uniform(0.3, 0.99))
        assert associate(*given, MOST) == pytest.approx(enumerated(*given), abs=1e-10)


def test_belief_propagation_is_exact_without_cycles() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        # a chain: track i may have made the detections i and i + 1
        count = int(rng.integers(1, 5))
        likelihoods, miss, clutter = case(rng, count, count + 1, 1.0, rng.uniform(0.3, 0.99))
        likelihoods *= np.eye(count, count + 1) + np.eye(count, count + 1, 1)
        exact = enumerated(likelihoods, miss, clutter)
        assert associate(likelihoods, miss, clutter, 0) == pytest.approx(exact, abs=1e-10)


def test_clusters_and_both_orientations_are_those_of_one_enumeration() -> None:
    rng = np.random.default_rng(3)
    for tracks, detections in ((2, 6), (6, 2), (5, 5)):
        likelihoods, miss, clutter = case(rng, tracks, detections, 0.35)
        exact = enumerated(likelihoods, miss, clutter)
        assert associate(likelihoods, miss, clutter, 2 if tracks != detections else 5) == pytest.approx(
            exact, abs=1e-10
        )


def test_where_nothing_is_missed_nor_false_each_track_has_its_detection() -> None:
    likelihoods = np.array([[0.3, 0.0], [0.2, 1e-9]])
    found = associate(likelihoods, np.zeros(2), np.zeros(2), MOST)
    assert found == pytest.approx(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), abs=1e-5)  # floors of 1e-15
    alone = associate(np.array([[1e-3]]), np.zeros(1), np.zeros(1), MOST)
    assert alone == pytest.approx(np.array([[0.0, 1.0]]), abs=1e-13)


def test_without_detections_or_tracks_nothing_is_associated() -> None:
    assert associate(np.zeros((2, 0)), np.full(2, 0.1), np.zeros(0), MOST) == pytest.approx(np.ones((2, 1)))
    assert associate(np.zeros((0, 3)), np.zeros(0), np.ones(3), MOST).shape == (0, 4)
    assert associate(np.zeros((1, 2)), np.full(1, 0.1), np.ones(2), MOST) == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


def propagation_error(probability: float, density: float, cases: int = 200) -> tuple[float, float]:
    """The mean and the greatest error of a probability by belief propagation, in dense clusters of four by four."""
    rng = np.random.default_rng(4)
    errors = []
    for _ in range(cases):
        given = case(rng, 4, 4, 1.0, probability, density)
        errors.append(np.abs(associate(*given, 0) - associate(*given, MOST)).max())
    return float(np.mean(errors)), float(np.max(errors))


def test_the_error_of_belief_propagation_falls_with_clutter_and_with_misses() -> None:
    assert propagation_error(0.6, 1.0)[1] < 0.02 < propagation_error(0.95, 0.01)[1] < 0.4
    assert propagation_error(0.6, 0.1)[0] < propagation_error(0.95, 0.1)[0]


def test_the_table_of_errors_in_the_documentation_is_what_is_measured() -> None:
    with TABLE.open(encoding="utf-8") as file:
        rows = {(float(row["detection"]), float(row["density"])): row for row in csv.DictReader(file)}
    mean, most = propagation_error(0.8, 0.1)
    assert float(rows[0.8, 0.1]["mean_greatest_error"]) == pytest.approx(mean, abs=1e-3)
    assert float(rows[0.8, 0.1]["greatest_error"]) == pytest.approx(most, abs=1e-3)
    page = TABLE.with_name("several_targets.md").read_text(encoding="utf-8")
    for detection in (0.6, 0.8, 0.95):
        cells = [f"{float(rows[detection, density]['mean_greatest_error']):.3f}" for density in (0.01, 0.1, 1.0)]
        assert f"| {detection:g} | {' | '.join(cells)} |" in page


if __name__ == "__main__":
    with TABLE.open("w", encoding="utf-8") as file:
        print("detection,density,mean_greatest_error,greatest_error", file=file)
        for probability, density in itertools.product((0.6, 0.8, 0.95), (0.01, 0.1, 1.0)):
            mean, most = propagation_error(probability, density)
            print(f"{probability:g},{density:g},{mean:.4f},{most:.4f}", file=file)
