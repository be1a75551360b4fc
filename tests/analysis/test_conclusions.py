"""What a comparison concludes, from values of runs written by hand."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wsnsim.analysis import statistics
from wsnsim.analysis.conclusions import (
    PointTraffic,
    degenerate,
    hint,
    pair_columns,
    sentence,
    shows_difference,
    with_pairs,
)

WORDS = ("ekf", "pf"), "rmse", "m"
NAN = float("nan")


def runs(values: Any, losses: Any = 0, metric: str = "rmse") -> pd.DataFrame:
    """Rows of `runs` by replicate."""
    frame = pd.DataFrame({metric: np.asarray(values, dtype=np.float64), "lost": 0})
    return frame.assign(losses=losses)


def pair(here: pd.DataFrame, there: pd.DataFrame, metric: str = "rmse", others: int = 0) -> dict[str, Any]:
    """The columns of a pair, corrected together with other pairs without any difference."""
    same = pair_columns(there, there, metric)
    pairs = {0: pair_columns(here, there, metric), **{1 + i: same for i in range(others)}}
    return with_pairs(pd.DataFrame(index=range(1 + others)), pairs).iloc[0].to_dict()


def test_the_sentence_of_a_clear_pair_says_size_interval_test_correction_and_pairs() -> None:
    """15 pairs, all of one sign: the exact p is 2 / 2^15."""
    base = 30.0 + np.arange(15.0)
    found = pair(runs(base - 21.1 - 0.2 * (np.arange(15) - 7)), runs(base))
    assert found["p"] == found["p_holm"] == pytest.approx(2 / 2**15)
    match = re.fullmatch(
        r"ekf is 21\.1 m better than pf in per-run RMSE, 95 % \[(.*), (.*)\], "
        r"Wilcoxon p = 6\.1e-05, Holm-corrected, 15 pairs",
        sentence(found, *WORDS),
    )
    assert match and float(match[1]) < 21.1 < float(match[2])
    assert found["test"] == "Wilcoxon signed-rank, exact"
    back = pair(runs(base), runs(base - 21.1))
    assert sentence(back, *WORDS).startswith("ekf is 21.1 m worse than pf in per-run RMSE, 95 % [21.1, 21.1]")


def test_with_more_pairs_the_same_difference_may_no_longer_be_shown() -> None:
    base = np.arange(8.0)
    here = runs(base - 0.5 - 0.05 * np.arange(8))
    assert pair(here, runs(base))["p_holm"] == pytest.approx(2 / 256)
    assert "better" in sentence(pair(here, runs(base)), *WORDS)
    found = pair(here, runs(base), others=9)
    assert found["p_holm"] == pytest.approx(20 / 256)
    assert sentence(found, *WORDS).startswith(
        "no difference in per-run RMSE is shown between ekf and pf: median -0.675 m"
    )


def test_the_p_values_of_losses_and_errors_of_all_pairs_are_one_family() -> None:
    """Any sentence claims a difference only if the least p of all 2 n tests is at most 5 % / 2 n (Bonferroni)."""
    rng, pairs = np.random.default_rng(4), 3
    empty = pair_columns(runs([1.0]), runs([1.0]), "rmse")
    said = 0
    for p in rng.uniform(size=(400, pairs, 2)):
        columns = {row: {**empty, "p": both[0], "p_losses": both[1]} for row, both in enumerate(p)}
        found = with_pairs(pd.DataFrame(index=range(pairs)), columns)
        least = found[["p_holm", "p_losses_holm"]].to_numpy().min()
        assert least == pytest.approx(min(1.0, 2 * pairs * p.min()))
        said += least <= 0.05
    assert said <= 29, "at most 5 % of 400 null comparisons, and two standard deviations"


def test_losses_are_compared_first_and_errors_on_the_runs_that_both_survive() -> None:
    """Nine runs only the particle filter loses, by a kilometre; one only the Kalman filter; ten both keep."""
    base, losses, own = np.full(20, 2.0), np.zeros(20, dtype=int), np.zeros(20, dtype=int)
    losses[:9], own[9] = 1, 3
    values, baseline = base + 0.5 + 0.01 * np.arange(20), base.copy()
    baseline[:9], values[9] = 1000.0, 1000.0
    found = pair(runs(values, own), runs(baseline, losses))
    assert (found["lost_alone"], found["baseline_lost_alone"], found["pairs"], found["common"]) == (
        1,
        9,
        10,
        20,
    )
    assert found["p_losses"] == pytest.approx(22 / 1024)
    assert found["difference"] == pytest.approx(np.median(0.5 + 0.01 * np.arange(10, 20)))
    assert found["difference_all"] == pytest.approx(np.median(values - baseline))
    conclusion = sentence(found, *WORDS)
    assert conclusion.startswith(
        "ekf loses its target in fewer runs than pf (1 lost by it alone, 9 by the other, exact McNemar p = 0.021,"
        " Holm-corrected, 20 pairs); ekf is 0.645 m worse than pf in per-run RMSE"
    )
    assert conclusion.endswith("10 pairs of runs that both survive")


def test_losses_that_chance_explains_are_no_difference_and_no_losses_are_not_mentioned() -> None:
    few = pair(runs([1.0] * 9, [1, 0, 0, 0, 0, 0, 0, 0, 0]), runs([1.0] * 9))
    assert sentence(few, *WORDS).startswith("no difference in losses is shown between ekf and pf (1 run lost by")
    assert "McNemar" not in sentence(pair(runs([1.0] * 9), runs([1.0] * 9)), *WORDS)


def test_energy_is_compared_on_all_runs_and_is_lower_not_better() -> None:
    words = WORDS[0], "energy", "J"
    here, there = runs(np.arange(12.0), [1] * 6 + [0] * 6, "energy"), runs(np.arange(12.0) + 3.0, metric="energy")
    found = pair(here, there, "energy")
    assert found["pairs"] == 12
    assert "ekf is 3 J lower than pf in energy, 95 % [3, 3]" in sentence(found, *words)


def test_too_few_pairs_conclude_nothing() -> None:
    found = pair(runs([1.0] * 4), runs([9.0] * 4))
    assert sentence(found, *WORDS) == "4 pairs are too few to compare ekf and pf in per-run RMSE"
    one = pair(runs([1.0]), runs([9.0]))
    assert sentence(one, *WORDS) == "1 pair is too few to compare ekf and pf in per-run RMSE"
    lost = pair(runs([NAN] * 6, 1), runs([1.0] * 6))
    assert sentence(lost, *WORDS).endswith(
        "0 pairs of runs that both survive are too few to compare ekf and pf in per-run RMSE"
    )


@pytest.mark.thorough
def test_no_sentence_claims_more_than_the_interval() -> None:
    """Random pairs, some with a true difference: a claim has an interval on its side of zero and a small p."""
    rng, claims = np.random.default_rng(2), 0
    for _ in range(30):
        base, shift = rng.normal(10.0, 2.0, 12), rng.choice([0.0, 0.0, -1.5, 1.5])
        found = pair(runs(base + shift + rng.normal(0.0, 1.0, 12)), runs(base), others=int(rng.integers(3)))
        conclusion = sentence(found, *WORDS)
        claimed = re.search(r"is (\S+) m (better|worse) .* \[(\S+), (\S+)\]", conclusion)
        assert bool(claimed) == shows_difference(found) == ("no difference" not in conclusion)
        if claimed:
            claims += 1
            value, low, high = (float(claimed[i]) for i in (1, 3, 4))
            assert 0.0 < low <= value <= high and found["p_holm"] <= 0.05
            assert (claimed[2] == "better") == (found["difference"] < 0.0)
    assert 5 < claims < 25


def test_a_handover_that_fills_the_step_is_hinted_at() -> None:
    fast = PointTraffic(late=0.0, missing=0.01, delay=0.004, step=0.04, handover=0.002)
    slow = PointTraffic(late=0.4, missing=0.5, delay=1.7, step=0.04, handover=1.1)
    conclusion = hint(slow, fast, ("pf", "ekf"))
    assert conclusion == (
        "packets, not the filter, may have decided: pf: 40% of the steps late, 50% missing, median latency 1.7 s,"
        " 1.1 s of airtime a handover (step 0.04 s); ekf: 0% of the steps late, 1% missing, median latency 0.004 s,"
        " 0.002 s of airtime a handover (step 0.04 s)"
    )
    assert hint(fast, fast, ("a", "b")) == ""
    assert hint(PointTraffic(), PointTraffic(), ("a", "b")) == ""
    for one in (fast._replace(late=0.2), fast._replace(delay=0.05), fast._replace(handover=0.05)):
        assert "packets" in hint(fast, one, ("a", "b"))
    lost = fast._replace(missing=0.9, delay=NAN)
    assert hint(fast, lost, ("a", "b")) == "", "without airtime, a lost track is not a matter of packets"
    assert "b: 0% of the steps late, 90% missing" in hint(fast, lost._replace(timed=True), ("a", "b"))


def test_different_numbers_of_particles_are_hinted_at() -> None:
    few, many = PointTraffic(particles=100, kind="gpf"), PointTraffic(particles=1000, kind="pf")
    assert (
        hint(few, many, ("gpf", "pf"))
        == "the numbers of particles differ: gpf has 100 particles and pf has 1000 particles"
    )
    assert hint(few, PointTraffic(), ("gpf", "ekf")) == hint(few, few, ("gpf", "pf")) == ""
    assert hint(few, few._replace(particles=9), ("gpf:particles=100", "gpf:particles=9")) == "", "this was asked for"


@pytest.mark.parametrize(
    ("particles", "nees", "lost", "singular", "said"),
    [
        (100, 2.6e4, 0.75, 0.0, True),
        (100, 2.6e4, 0.0, 0.0, False),  # it followed its target
        (100, 0.9, 0.75, 0.0, False),  # the spread covers the error
        (100, 0.9, 0.0, 1.0, True),  # all particles were in one place
        (100, NAN, 1.0, 0.0, False),  # no step has an estimate
        (100, NAN, 0.0, NAN, False),  # without a position there is no covariance
        (None, 2.6e4, 0.75, 3.0, False),  # a Kalman filter
    ],
)
def test_a_particle_filter_with_a_collapsed_covariance_is_hinted_at(
    particles: int | None, nees: float, lost: float, singular: float, said: bool
) -> None:
    assert bool(degenerate(particles, nees, lost, singular)) == said


def test_the_p_of_a_pair_is_that_of_the_statistics() -> None:
    one, other = np.array([1.0, 5.0, 3.0, 8.0, 2.0, 9.0]), np.array([2.0, 3.0, 4.0, 5.0, 6.0, 1.0])
    found = pair(runs(one), runs(other))
    expected = statistics.paired_difference(one, other)
    assert tuple(found[key] for key in ("difference", "effect", "p", "pairs")) == (
        expected.value, expected.effect, expected.p, expected.known,
    )  # fmt: skip
