"""Variants that are added to the frontier study run alone, and are those of the experiment."""

from __future__ import annotations

import json

import pytest

from tests.papers import frontier_runs as runs
from wsnsim.papers import reproduce
from wsnsim.papers.study import study

ASLEEP = next(one for one in study("frontier").experiments if one.name == "asleep")


def test_what_the_page_has_is_not_missing(monkeypatch, tmp_path):
    rows = tmp_path / "rows.json"
    monkeypatch.setattr(runs, "ROWS", rows)
    rows.write_text("{}", encoding="utf-8")
    assert runs.missing("asleep") == [*ASLEEP.variants]
    first, *others = ASLEEP.variants
    rows.write_text(json.dumps({"asleep": {"rows": {first: {}}}}), encoding="utf-8")
    assert runs.missing("asleep") == others
    rows.write_text(json.dumps({"frontier": {"strategies": [{"variant": "ideal: ekf"}]}}), encoding="utf-8")
    assert "ideal: ekf" not in runs.missing("frontier") and "ideal: ckf" in runs.missing("frontier")


@pytest.mark.thorough
def test_a_variant_alone_is_the_same_point_as_within_its_experiment():
    name = [*ASLEEP.variants][-1]
    alone = reproduce.plan("frontier", runs.of_variants("asleep", [name]), full=True)
    whole = reproduce.plan("frontier", ASLEEP, full=True)
    assert alone.points == whole.points[-1:] and alone.replicates == ASLEEP.full


def test_asleep_trackers_have_the_settings_that_the_sweep_chose_on_the_same_radio_awake():
    frontier = study("frontier").experiments[0]
    for strategy in ("gpf", "ekf"):
        awake = frontier.variants[f"slots: {strategy}, fair"].sets
        chosen = [one for one in awake if "noise" in one or "particles=" in one]
        assert chosen and set(chosen) <= set(ASLEEP.variants[f"2 % awake: {strategy}, fair"].sets)
        assert set(chosen) <= set(frontier.variants[f"10 % awake: {strategy}, fair"].sets)
    appointed = ASLEEP.variants["2 % awake: gpf, appointed, noise x100, 100 particles"].sets
    assert set(ASLEEP.variants["2 % awake: gpf, fair"].sets) < set(appointed)
