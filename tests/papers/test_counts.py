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
        (["reproduces", "compatible"], "undecided"),
        (["does not reproduce", "compatible", "too few runs"], "undecided"),
        (["does not reproduce", "reproduces", "reproduces"], "dependent on the reading"),
        (["does not reproduce", "reproduces", "compatible"], "dependent on the reading"),
    ],
)
def test_rows_of_one_printed_number_in_several_experiments_are_readings_of_it(verdicts, outcome):
    rows = [row(verdict, experiment=f"reading {number}") for number, verdict in enumerate(verdicts)]
    (claim,) = counted_claims([*rows, row("reproduces", literal=False), row("reproduces", paired=True)])
    assert claim.outcome == outcome and len(claim.rows) == len(verdicts)
    line = count_line([claim])
    assert line == f"1 printed number: 1 {outcome}; {len(verdicts)} reading{'s'[: len(verdicts) - 1]} counted at most"


def test_kinds_without_claims_are_left_out_and_claims_have_the_number_of_readings_with_another_outcome():
    rows = [row(verdict, experiment=str(number), where="section 3", key=key)
            for key, verdicts in (("pf < gpf", ("reproduces", "undecided", "undecided")), ("pf < ekf", ("reproduces",)))
            for number, verdict in enumerate(verdicts)]  # fmt: skip
    claims = counted_claims(rows)
    assert count_line(claims) == "2 in words: 1 reproduced, 1 undecided; 3 readings counted at most"
    assert [claim_cells(claim)[-1] for claim in claims] == ["undecided (reproduced under 1 of 3)", "reproduced"]


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


def test_undecided_and_contradicted_numbers_that_could_not_have_reproduced_are_told_from_those_that_more_runs_decide():
    far = TOO_WIDE._replace(verdict="does not reproduce")
    rows = [row(TOO_WIDE), row(NARROW, "pf, 100"), row(far, "pf, 200", published_runs_assumed=True),
            row("does not reproduce", "gpf, 50")]  # fmt: skip
    claims = counted_claims(rows)
    assert [claim_cells(claim)[-1] for claim in claims] == [
        "undecided, out of reach", "undecided", "contradicted, out of reach", "contradicted",
    ]  # fmt: skip
    never = "(1 out of reach)"
    assert f": 2 contradicted {never}, 2 undecided {never};" in count_line(claims)
    (either,) = counted_claims([rows[0], row(NARROW, experiment="another reading")])
    assert not either.undecidable


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
