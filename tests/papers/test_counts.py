"""The claims of a paper are counted once each, by three outcomes, and by all readings together."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.papers.counts import OUTCOMES, count_line, counted_claims
from wsnsim.papers.reproduction import ClaimRow
from wsnsim.papers.resampling import MEAN, Sample
from wsnsim.papers.study import PAPERS, study
from wsnsim.papers.table import claim_cells
from wsnsim.papers.verdicts import CLOSE, RULE, Judgement, PublishedValue, judged_value, lasting_interval

NAN = float("nan")
TOO_WIDE = Judgement("compatible", 0.8, 1.2, 1.5)
NARROW = Judgement("compatible", 1.05, 1.15, 1.1)


def row(verdict, key="pf, 50", where="table 1", **more):
    judgement = verdict if isinstance(verdict, Judgement) else Judgement(verdict)
    basis = {"paper": "ruan2020", "experiment": "table_1", "id": "rmse", "published_runs": 50}
    return ClaimRow("RMSE, m (table 1)", key.partition(" <")[0], 1.0, 1.1, 1.0, 1.2, 200, 0.0, NAN, "", judgement, "",
                    key=key, where=where, **basis | more)  # fmt: skip


def lognormal(spread, runs=2000):
    return Sample(np.arange(runs), np.random.default_rng(3).lognormal(0.0, spread, (runs, 1)), MEAN)


@pytest.mark.parametrize(
    ("verdicts", "outcome"),
    [
        (["reproduces"], "reproduced"),
        (["within a factor of two"], "contradicted"),
        (["does not reproduce", "cannot: beyond the bound"], "contradicted"),
        (["too few runs", "compatible"], "undecided"),
        (["reproduces", "compatible"], "dependent on the reading"),
        (["does not reproduce", "reproduces", "reproduces"], "dependent on the reading"),
    ],
)
def test_rows_of_one_printed_number_in_several_experiments_are_readings_of_it(verdicts, outcome):
    rows = [row(verdict, experiment=f"reading {number}") for number, verdict in enumerate(verdicts)]
    (claim,) = counted_claims([*rows, row("reproduces", literal=False), row("reproduces", paired=True)])
    assert claim.outcome == outcome and len(claim.rows) == len(verdicts)
    line = count_line([claim])
    assert line.startswith("1 printed numbers: ") and f"1 {outcome}" in line
    assert line.endswith(f"; {len(verdicts)} readings tried at most")


def test_printed_numbers_orders_in_words_and_what_follows_from_printed_numbers_are_told_apart():
    rows = [
        row("reproduces"), row("reproduces", where="section 3.1"), row("reproduces", "pf, 50 < gpf, 50"),
        row("reproduces", "pf, 50 < gpf, 50", "section 3.1"), row("reproduces", where="from table 1"),
        row("reproduces", where="figure 2", read=True), row("not judged", "pf, 100"), row("not published", "pf, 200"),
    ]  # fmt: skip
    assert [claim.kind.partition(" ")[0] for claim in counted_claims(rows)] == [
        "printed", "printed", "derived", "in", "derived", "in",
    ]  # fmt: skip
    assert set(OUTCOMES) == set(RULE) - {"not judged"}


def test_what_more_runs_may_decide_is_not_called_undecidable():
    wide, narrow = counted_claims([row(TOO_WIDE), row(NARROW, "pf, 100")])
    assert claim_cells(wide)[-1] == "undecidable at 50 published runs" and claim_cells(narrow)[-1] == "undecided"
    assert ": 2 undecided (1 undecidable);" in count_line([wide, narrow])


@pytest.mark.parametrize(("spread", "runs", "undecidable"), [(0.4, 50, True), (0.2, 100, False), (0.8, 0, False)])
def test_fifty_published_runs_that_spread_by_forty_per_cent_can_never_reproduce(spread, runs, undecidable):
    """The 95 % interval of the mean of m log-normal runs is about exp(±1.96 sd / sqrt(m)), whatever our number is."""
    sample = lognormal(spread)
    found = judged_value(sample, PublishedValue(float(sample.rows.mean()), runs))
    expected = np.exp(2 * 1.96 * np.sqrt(np.expm1(spread**2) / runs)) if runs else 1.0
    assert found.lasting == lasting_interval(sample, runs) == pytest.approx(expected, rel=0.05)
    assert found.undecidable is undecidable is (found.lasting > CLOSE**2)
    assert (found.verdict == "compatible") is undecidable


def test_a_ratio_that_we_compute_from_two_printed_numbers_is_from_their_place():
    claims = [claim for name in PAPERS for experiment in study(name).experiments for claim in experiment.claims]
    ratios = {claim.where for claim in claims if claim.measure.startswith("over:") and not claim.read}
    assert len(ratios) > 3 and all(where.startswith("from ") for where in ratios if where)
