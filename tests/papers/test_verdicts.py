"""The rule of the verdicts on values and orders: what reproduces, what fails, and what too few runs cannot show."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from scipy import stats

from wsnsim.papers import resampling
from wsnsim.papers.resampling import (
    MEAN,
    MEDIAN,
    PER_RUN_RMSE,
    POOLED_RMSE,
    TIME_MEAN_RMSE,
    Sample,
    Statistic,
    compared,
    known,
    median_of_runs,
    value,
    weights,
)
from wsnsim.papers.rows import interval as answer_interval
from wsnsim.papers.rows import resamples
from wsnsim.papers.study import study
from wsnsim.papers.verdicts import (
    RULE,
    Judgement,
    PublishedValue,
    astray,
    interval,
    judged_order,
    judged_value,
    ratio_interval,
    verdict_on_order,
    verdict_on_ratio,
)

NAN = float("nan")


def sample(values, statistic=MEAN, runs=None):
    rows = np.asarray(values, dtype=np.float64)
    rows = rows if rows.ndim > 1 else rows[:, None]
    return Sample(np.arange(len(rows)) if runs is None else runs, rows, statistic)


def less(one, other):
    return compared(one, other, lambda a, b: a - b, "difference")


def over(one, other):
    return compared(one, other, lambda a, b: a / b, "ratio")


def lognormal(seed, runs, sigma=0.1, centre=1.0):
    """Values whose mean is `centre`."""
    normal = np.random.Generator(np.random.Philox(seed)).standard_normal(runs)
    return centre * np.exp(sigma * normal - sigma**2 / 2.0)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (1 / 1.1, 1.1, "reproduces"),
        (0.95, 1.101, "compatible"),
        (0.3, 5.0, "compatible"),
        (1.1, 1.5, "compatible"),
        (1.101, 2.0, "within a factor of two"),
        (0.5, 0.9, "within a factor of two"),
        (1.2, 2.01, "does not reproduce"),
        (0.49, 0.9, "does not reproduce"),
        (3.0, 4.0, "does not reproduce"),
    ],
)
def test_a_ratio_is_judged_by_its_whole_interval(low, high, verdict):
    assert verdict_on_ratio(low, high) == verdict and verdict in RULE


def test_the_factor_of_a_verdict_is_the_farthest_end_of_its_interval():
    assert Judgement("compatible", 0.5, 1.5).within == 2.0
    assert Judgement("compatible", 0.9, 1.5).within == 1.5
    assert Judgement("compatible", 0.0, 1.5).within == np.inf
    assert np.isnan(Judgement("undecided").within)


def test_an_order_needs_the_whole_interval_on_one_side_of_zero():
    assert verdict_on_order(-2.0, -0.1) == "reproduces"
    assert verdict_on_order(0.1, 2.0) == verdict_on_order(0.0, 0.0) == "does not reproduce"
    assert verdict_on_order(-2.0, 0.0) == verdict_on_order(-0.1, 2.0) == verdict_on_order(0.0, 1.0) == "undecided"
    assert verdict_on_order(NAN, NAN) == "undecided"


@pytest.mark.thorough
def test_the_interval_of_a_ratio_has_both_errors():
    """Of a mean of many values it is exp(±1.96 s) with s² = cv² (1/n + 1/m) around measured / published."""
    ours = sample(lognormal(1, 900, 0.2))
    for runs in (0, 50, 900):
        low, high = ratio_interval(ours, 0.8, runs)
        spread = 1.96 * ours.per_run.std() / value(ours) * np.sqrt(1 / 900 + (1 / runs if runs else 0.0))
        assert np.log(high / low) / 2.0 == pytest.approx(spread, rel=0.08)
        assert np.sqrt(low * high) == pytest.approx(value(ours) / 0.8, rel=0.01)


def test_a_published_value_from_a_few_runs_that_missed_the_rare_ones_is_not_refuted():
    """2 % of our runs are 16 times as large; 50 runs without such a one are nothing unusual."""
    values = np.where(np.arange(400) % 50 == 0, 16.0, 1.0) * lognormal(2, 400, 0.05)
    assert judged_value(sample(values), PublishedValue(1.0, 50)).verdict == "compatible"
    assert judged_value(sample(values), PublishedValue(1.0, 0)).verdict == "within a factor of two"


@pytest.mark.parametrize("statistic", [MEAN, PER_RUN_RMSE, TIME_MEAN_RMSE, POOLED_RMSE])
def test_a_mean_or_an_rmse_of_fewer_than_200_runs_is_at_most_found_too_large(statistic):
    rows = lognormal(3, 200)
    rows = rows[:, None] if statistic is MEAN else rows[:, None, None]
    for count, verdicts in ((29, [few] * 4), (199, [few, few, few, bad]), (200, ["reproduces", *[bad] * 3])):
        found = [
            judged_value(sample(rows[:count], statistic), PublishedValue(published, 100)).verdict
            for published in (1.0, 5.0, 2.5, 0.3)
        ]
        assert found == verdicts


few, bad = "too few runs", "does not reproduce"


def test_a_median_is_judged_from_30_runs_on_and_so_is_a_large_fraction():
    close = PublishedValue(1.0, 100)
    assert judged_value(sample(lognormal(4, 30, 0.05), MEDIAN), close).verdict == "reproduces"
    assert judged_value(sample(lognormal(4, 29, 0.05), MEDIAN), close).verdict == "too few runs"
    shares = np.minimum(lognormal(5, 40, 0.02), 1.0)
    assert judged_value(sample(shares), close._replace(fraction=True)).verdict == "reproduces"
    assert judged_value(sample(shares), close).verdict == "too few runs"
    small = sample(0.1 * shares)
    assert judged_value(small, PublishedValue(0.1, 100, fraction=True)).verdict == "too few runs"


def test_a_mean_that_one_run_makes_too_large_is_not_refuted_by_few_runs_as_the_median_says_otherwise():
    values = lognormal(6, 60, 0.02)
    values[:30] *= 9.0
    assert judged_value(sample(values), PublishedValue(1.0, 100)).verdict == "too few runs"
    assert judged_value(sample(9.0 * values), PublishedValue(1.0, 100)).verdict == "does not reproduce"


def test_what_is_not_random_is_judged_at_any_number_of_runs():
    assert judged_value(sample([105.0] * 5), PublishedValue(100.0, 50)).verdict == "reproduces"
    assert judged_value(sample([130.0] * 5), PublishedValue(100.0, 50)).verdict == "within a factor of two"
    assert judged_value(sample([100.0] * 4), PublishedValue(100.0, 50)).verdict == "too few runs"
    assert judged_value(sample([100.0, 101.0]), PublishedValue(100.0, 0, exact=True)).verdict == "reproduces"
    # a share of 1 in each of a few runs is cut off, not exact
    assert judged_value(sample([1.0] * 10), PublishedValue(1.0, 50)).verdict == "too few runs"


def test_a_value_without_a_ratio_reproduces_only_what_it_equals():
    assert judged_value(sample([0.0] * 9), PublishedValue(0.0)).verdict == "reproduces"
    assert judged_value(sample([0.0, 0.1] * 300), PublishedValue(0.0, 50)).verdict == "does not reproduce"
    assert judged_value(sample([-1.0, -2.0] * 300), PublishedValue(1.0, 50)).verdict == "does not reproduce"


def test_a_ratio_of_rivals_has_to_be_on_the_published_side_of_one():
    """Equal filters do not reproduce that one is 6 % better, although 1 is within 10 % of 0.94."""
    base = lognormal(7, 400, 0.3)
    for factor, verdict in ((0.94, "reproduces"), (1.0, "compatible"), (1.02, "compatible")):
        rivals = over(sample(factor * base * lognormal(8, 400, 0.01)), sample(base))
        assert judged_value(rivals, PublishedValue(0.94, 100, rivals=True)).verdict == verdict
    assert judged_value(over(sample(base), sample(base)), PublishedValue(1.0, 100, rivals=True)).verdict == "reproduces"


def test_an_order_is_judged_by_the_published_statistic_on_the_same_runs():
    """Single runs that diverge decide the RMSE, and not the median of the paired differences."""
    other = lognormal(9, 400, 0.1)
    one = 0.9 * other
    one[::10] *= 16.0
    by_rmse, by_mean = (less(sample(one[:, None, None], s), sample(other[:, None, None], s))
                        for s in (TIME_MEAN_RMSE, PER_RUN_RMSE))  # fmt: skip
    assert judged_order(by_rmse).verdict == judged_order(by_mean).verdict == "does not reproduce"
    assert judged_order(median_of_runs(by_rmse)).verdict == "reproduces"
    short = by_rmse.among(np.arange(100))
    assert judged_order(short).verdict == "too few runs" and judged_order(median_of_runs(short)).verdict == "reproduces"
    assert value(by_rmse) == pytest.approx(np.sqrt((one**2).mean()) - np.sqrt((other**2).mean()))


def test_an_order_of_equal_or_exact_values_needs_no_runs():
    same = sample([1.0, 2.0, 3.0])
    assert judged_order(less(same, same)).verdict == "does not reproduce"
    assert judged_order(less(sample([10.0] * 5), sample([11.0] * 5))).verdict == "reproduces"
    assert judged_order(less(sample([10.0, 9.0]), sample([11.0, 12.0])), exact=True).verdict == "reproduces"
    assert judged_order(less(sample([10.0, 9.0]), sample([11.0, 12.0]))).verdict == "too few runs"


def test_only_common_runs_are_compared():
    found = less(sample([1.0, 2.0, 3.0], runs=np.array([0, 1, 2])), sample([5.0, 5.0], runs=np.array([2, 1])))
    assert found.runs.tolist() == [1, 2]


def test_the_share_astray_has_the_exact_binomial_interval():
    values = np.ones(200)
    values[:4] = [5.0, 5.1, 80.0, NAN]
    found = astray(values)
    low, high = stats.beta.ppf(0.025, 2, 198), stats.beta.ppf(0.975, 3, 197)
    assert found == pytest.approx((2 / 199, low, high))
    assert np.isnan(astray(np.zeros(10))).all() and np.isnan(astray(np.array([NAN]))).all()


@pytest.mark.parametrize("statistic", [MEAN, MEDIAN, TIME_MEAN_RMSE, POOLED_RMSE, PER_RUN_RMSE])
def test_resampling_by_weights_is_resampling_of_runs(statistic):
    """With unknown values and two tracks a run, each resample is the statistic of the runs drawn."""
    rng = np.random.Generator(np.random.Philox(10))
    rows = rng.lognormal(size=(7, 2) if statistic in (MEAN, MEDIAN) else (7, 2, 5))
    rows[0, 1], rows[3, 0] = NAN, NAN
    drawn = weights(7, 9)[:50]
    found = Sample(np.arange(7), rows, statistic).at(drawn)
    slow = [_slowly(rows[np.repeat(np.arange(7), count.astype(int))], statistic) for count in drawn]
    assert found == pytest.approx(np.array(slow), rel=1e-12)
    assert (drawn.sum(axis=1) == 9).all()


STATISTICS = [each for each in vars(resampling).values() if isinstance(each, Statistic)]
OF_ERRORS = (TIME_MEAN_RMSE, POOLED_RMSE, PER_RUN_RMSE)
NOTHING = {
    "no run": ((0, 2), (0, 2, 5)),
    "no target": ((6, 0), (6, 0, 5)),
    "no step": ((6, 0), (6, 1, 0)),
    "no run has a value": ((6, 2), (6, 2, 5)),
    "the only run has none": ((1, 1), (1, 1, 5)),
}


@pytest.mark.parametrize("statistic", STATISTICS, ids=lambda one: one.words)
@pytest.mark.parametrize("shapes", NOTHING.values(), ids=NOTHING.keys())
def test_a_statistic_of_nothing_is_unknown_and_too_few_runs_for_any_verdict(shapes, statistic):
    found = sample(np.full(shapes[statistic in OF_ERRORS], NAN), statistic)
    for unknown in (found, known(found), median_of_runs(found), less(found, found), over(found, known(found))):
        assert np.isnan([value(unknown), *interval(unknown), *answer_interval(resamples(unknown))]).all()
        assert np.isnan(unknown.per_run).all() and np.isnan(astray(unknown.per_run)).all()
        for exact in (False, True):
            published = PublishedValue(1.0, 50, exact=exact)
            assert judged_order(unknown, exact).verdict == judged_value(unknown, published).verdict == "too few runs"


@pytest.mark.parametrize("statistic", STATISTICS, ids=lambda one: one.words)
def test_a_statistic_of_one_run_is_that_run_without_an_interval(statistic):
    found = sample(np.full((1, 1, 5) if statistic in OF_ERRORS else (1, 1), 2.0), statistic)
    assert value(found) == value(median_of_runs(found)) == found.per_run == 2.0
    assert np.isnan(interval(found)).all()
    assert judged_value(found, PublishedValue(2.0, 50)).verdict == "too few runs"


def _slowly(rows, statistic):
    if statistic is MEAN:
        return np.nanmean(rows)
    if statistic is MEDIAN:
        return np.nanmedian(rows)
    if statistic is POOLED_RMSE:
        return np.sqrt(np.nanmean(rows**2))
    if statistic is TIME_MEAN_RMSE:
        return np.mean(np.sqrt(np.nanmean(rows**2, axis=(0, 1))))
    return np.mean([np.sqrt(np.nanmean(run**2)) for run in rows])


TABLE_1 = {
    count: {kind: study("wei2022").published["rmse_x"][kind][str(count)] for kind in ("pf", "cs_pf", "ics_pf")}
    for count in (30, 60, 100)
}


def wei_runs(labels, seed, runs=200):
    """200 runs of each filter whose mean per-run RMSE is the published one of the filter of another label."""
    for count, printed in TABLE_1.items():
        rows = {
            kind: sample(lognormal([seed, count, index], runs, 0.1, printed[labels[kind]]))
            for index, kind in enumerate(printed)
        }
        yield printed, rows


def test_swapped_labels_of_weis_table_1_fail_every_order_and_ratio():
    """Each swap of two filters keeps the values within a factor of two, which counts nothing, and reverses the rest."""
    kinds = ("pf", "cs_pf", "ics_pf")
    true = dict(zip(kinds, kinds, strict=True))
    passed = {"right": [], "swapped": []}
    beside = []
    for swap in combinations(kinds, 2):
        for name, labels in (("right", true), ("swapped", {**true, swap[0]: swap[1], swap[1]: swap[0]})):
            for printed, rows in wei_runs(labels, 11):
                better, worse = sorted(swap, key=printed.__getitem__)
                ratio = PublishedValue(printed[better] / printed[worse], 100, rivals=True)
                passed[name] += [
                    judged_order(less(rows[better], rows[worse])).verdict == "reproduces",
                    judged_value(over(rows[better], rows[worse]), ratio).verdict == "reproduces",
                ]
                if name == "swapped":
                    beside += [judged_value(rows[kind], PublishedValue(printed[kind], 100)).verdict for kind in swap]
    assert len(passed["swapped"]) == 18 and not any(passed["swapped"])
    assert sum(passed["right"]) >= 17
    assert set(beside) <= {"within a factor of two", "compatible", "does not reproduce", "reproduces"}
    assert beside.count("reproduces") <= 2


def test_no_permutation_of_labels_passes_the_orders():
    kinds = ("pf", "cs_pf", "ics_pf")
    for order in permutations(kinds):
        right = order == kinds
        for printed, rows in wei_runs(dict(zip(kinds, order, strict=True)), 12):
            ranked = sorted(kinds, key=printed.__getitem__)
            pairs = [judged_order(less(rows[a], rows[b])).verdict == "reproduces" for a, b in combinations(ranked, 2)]
            assert all(pairs) == right
