"""Rows of a track: losses and lateness."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim.base.results import TrackRule, absence_columns, overtaken, track_row

STEPS, DT = 700, 0.02
RULE = TrackRule(50, 20.0, DT, 0, np.ones(STEPS, dtype=bool))


def columns(errors):
    times = DT * np.arange(1, STEPS + 1)
    return {"time": times, "issued": times, "received": np.full(STEPS, np.nan), "error": errors,
            "readings": np.full(STEPS, 4), "woken": 0, "ineffective": 0, "late": np.zeros(STEPS)}  # fmt: skip


def test_a_run_with_an_rmse_of_a_kilometre_is_a_loss_although_it_came_back():
    """The case of the audit: an excursion in the middle, none at the end."""
    errors = np.full(STEPS, 2.0)
    errors[200:260] = 3_200.0
    row = track_row(columns(errors), RULE)
    assert row["rmse"] > 900.0 and row["lost"] == 0
    assert row["losses"] == 1
    assert row["time_lost"] == pytest.approx(60 * DT) and row["lost_share"] == pytest.approx(60 / STEPS)
    assert row["lost_at"] == pytest.approx(250 * DT), "after 50 steps astray"


def test_a_track_that_holds_has_no_losses_and_one_without_estimates_is_always_lost():
    held = track_row(columns(np.full(STEPS, 2.0)), RULE)
    assert (held["lost"], held["losses"], held["time_lost"], held["lost_share"]) == (0, 0, 0.0, 0.0)
    gone = track_row(columns(np.full(STEPS, np.nan)), RULE)
    assert (gone["lost"], gone["losses"], gone["lost_share"]) == (1, 1, 1.0)
    assert gone["time_lost"] == pytest.approx(STEPS * DT)


def test_nothing_but_its_cost_is_asked_of_a_track_while_its_target_is_absent():
    """30 steps astray on both sides of an absence of 100 are no loss; 60 are one. Each tenth step owes a report."""
    present = np.ones(STEPS, dtype=bool)
    present[200:300] = False
    errors = np.where(present, 2.0, np.nan)
    errors[170:200], errors[300:330], errors[400:460] = 90.0, 90.0, 90.0
    found, rule = columns(errors), RULE._replace(present=present, every=10)
    row = track_row(found, rule)
    assert (row["losses"], row["lost"], row["reports"], row["due"], row["tracked"]) == (1, 0, 600, 60, 1.0)
    assert row["time_lost"] == pytest.approx(60 * DT) and row["lost_share"] == pytest.approx(0.1)
    assert row["lost_at"] == pytest.approx(450 * DT)
    kept = absence_columns(found, rule)
    assert kept["time_present"] == pytest.approx(600 * DT) and kept["false_time"] == pytest.approx(100 * DT)


@pytest.mark.parametrize(
    ("received", "count"),
    [
        ([1.0, 2.0, 3.0], 0),
        ([3.0, 2.0, 4.0], 1),
        ([5.0, 4.0, 3.0], 2),
        ([np.nan, 4.0, 3.0, np.nan], 1),
        ([], 0),
        ([1.0], 0),
    ],
)
def test_a_report_is_overtaken_if_one_of_a_later_step_arrives_before_it(received, count):
    assert overtaken(np.array(received)) == count
