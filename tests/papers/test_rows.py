"""The bound beside a measured value: in the same terms, over the same steps, and strict only where it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from wsnsim.analysis import error_bounds
from wsnsim.bounds import Bound, BoundQuery
from wsnsim.papers import rows
from wsnsim.papers.reproduction import Measured
from wsnsim.papers.rows import bound_beside, bound_from_events

NAN = float("nan")


def bound(variances, kind="per_trajectory", runs=(4, 7)):
    """A bound of one target and one state column, with variances (R, steps)."""
    covariances = np.asarray(variances, dtype=np.float64)[:, None, :, None, None]
    return Bound(BoundQuery(kind, "arrived", "known", runs), (0,), covariances)


def data(found):
    return SimpleNamespace(
        manifest=SimpleNamespace(points=[SimpleNamespace(id="p")]),
        variants=("ekf",),
        folder=SimpleNamespace(batches=lambda point: [SimpleNamespace(path="some/file.h5")]),
        bound=lambda variant, kind: found,
        states=lambda variant: (("x", "m"),),
    )


def test_the_bound_for_readings_that_arrived_is_over_the_steps_with_an_estimate(monkeypatch):
    """The second run has no estimate at the last two steps, where nothing arrives and its bound grows."""
    found = bound([[1.0, 4.0, 9.0, 16.0], [1.0, 1.0, 100.0, 400.0]])
    monkeypatch.setattr(rows.bounds, "bound_of_run", lambda path, readings, kind: found)
    estimates = pd.DataFrame({
        "replicate": np.repeat([7, 4], 4), "target": 0, "step": [1, 2, 3, 4] * 2,
        "error": [0.5, 0.5, NAN, NAN, 1.0, 1.0, 1.0, 1.0],
    })  # fmt: skip
    monkeypatch.setattr(error_bounds, "is_unlabelled", lambda path: False)
    monkeypatch.setattr(error_bounds, "read_table", lambda path, table, columns: estimates)
    each = bound_from_events(data(found), "ekf", "arrived")
    assert each.to_dict() == pytest.approx({4: np.sqrt(7.5), 7: 1.0})
    assert found.of_replicates[1] == pytest.approx(np.sqrt(125.5))
    beside = bound_beside(data(found), "ekf", "median:rmse", "arrived")
    assert beside.value == pytest.approx((np.sqrt(7.5) + 1.0) / 2.0) and beside.kind == "arrived, not strict"


def test_the_bound_of_a_mean_of_rmse_is_a_mean_of_roots_and_not_strict():
    variances = [[1.0, 1.0], [16.0, 16.0]]
    per_run = bound_beside(data(bound(variances)), "ekf", "per_run_rmse:x", "per_trajectory")
    assert per_run.value == pytest.approx(2.5) and np.isnan(per_run.strict)
    pooled = bound_beside(data(bound(variances, "unconditional")), "ekf", "column:x", "unconditional")
    assert pooled.value == pooled.strict == pytest.approx(np.sqrt(8.5))
    posterior = bound_beside(data(bound([[4.0, 4.0]], "unconditional")), "ekf", "per_run_rmse:x", "unconditional")
    assert posterior.value == pytest.approx(2.0) and np.isnan(posterior.strict)
    assert posterior.kind.endswith("not strict") and "mean square" in posterior.caution


def test_the_exact_posterior_limits_the_mean_square_and_not_the_mean_of_roots(monkeypatch):
    monkeypatch.setattr(rows, "measured", lambda *_: Measured(4.0, 3.9, 4.1, 100, 0.0))
    pooled, per_run = (
        bound_beside(data(None), "pf", measure, "variant:exact posterior") for measure in ("column:x", "per_run_rmse:x")
    )
    assert pooled.strict == pooled.value == per_run.value == 3.9
    assert np.isnan(per_run.strict) and "mean square" in per_run.caution
