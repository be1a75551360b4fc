"""The rule that chooses settings, what is swept, and the sweeps that come with wsnsim."""

from __future__ import annotations

import json
import math

import pandas as pd
import pytest

from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim.papers.study import study

settings = module("frontier", "settings")
_settings = module("frontier", "settings")
Choice, StoredSweep, chosen, stored, swept = (
    _settings.Choice,
    _settings.StoredSweep,
    _settings.chosen,
    _settings.stored,
    _settings.swept,
)
_strategies = module("frontier", "strategies")
Strategy = _strategies.Strategy
CHOSEN = _settings.CHOSEN

SWEEP = study("frontier").published["sweep"]


def result(name, rmse, energy, lost=0.0, in_time=1.0):
    return Strategy(name, rmse, rmse, rmse, energy, lost, in_time)


def test_the_fair_setting_has_the_least_error_of_those_that_follow_and_the_frugal_one_saves_a_tenth():
    found = [
        result("a", 0.10, 1.00),
        result("late", 0.05, 0.1, in_time=0.5),
        result("astray", 0.06, 0.1, lost=0.2),
        result("frugal", 0.14, 0.5),
        result("far", 0.16, 0.1),
    ]
    assert chosen(found) == Choice("a", "frugal")
    assert chosen([*found[:3], result("b", 0.14, 0.95)]) == Choice("a", "a"), "a twentieth is not worth an error"


def test_where_no_setting_is_in_time_that_with_the_most_estimates_is_chosen():
    found = [result("a", 0.1, 1.0, in_time=0.2), result("b", 9.0, 1.0, lost=1.0, in_time=0.6)]
    assert chosen(found) == Choice("b", "b")


def test_where_every_setting_loses_runs_those_that_lose_fewest_count():
    found = [result("a", 0.1, 1.0, lost=0.6), result("b", 0.4, 1.0, lost=0.2), result("c", 0.3, 1.0, lost=0.2)]
    assert chosen(found).fair == "c"
    assert chosen([result("a", math.nan, 1.0), result("b", 5.0, 2.0)]).fair == "b", "NaN is no error"


@pytest.mark.parametrize("radio", ["ideal", "slots"])
def test_a_sweep_crosses_process_noise_with_every_other_factor_and_names_each_setting_once(radio):
    names = swept(SWEEP, radio)
    assert list(names) == list(
        next(one for one in study("frontier").experiments if one.name == f"settings_{radio}").variants
    )
    for group in SWEEP[radio]:
        factors = {**SWEEP["usual"], **group}
        per_strategy = len(factors["noise"]) * (
            len(factors["handover"]) * len(factors["fraction"]) + len(factors["particles"])
        )
        for strategy in group["strategies"]:
            assert list(names.values()).count(strategy) == per_strategy


def test_what_is_swept_is_stored():
    for radio, one in stored().items():
        assert set(swept(SWEEP, radio).values()) == set(one.choices)


def test_every_stored_choice_follows_from_the_stored_results_by_the_rule():
    for radio, one in stored().items():
        of = swept(SWEEP, radio)
        assert [row.variant for row in one.results] == list(of), "sweep again: the experiments settings_*"
        assert one.choices == settings.choices(one.results, of)
        assert one.about["seed"] != 20131101 and one.about["runs"] >= 4 and len(one.about["digest"]) == 64


@pytest.mark.parametrize("radio", ["ideal", "slots"])
def test_a_chosen_setting_is_a_variant_unless_it_is_the_default_or_the_other_choice(radio):
    experiments = {one.name: one.variants for one in study("frontier").experiments}
    swept_as, written = experiments[f"settings_{radio}"], experiments["frontier"]
    wanted = {}
    for strategy, choice in stored()[radio].choices.items():
        usual = f"{radio}: {strategy}"
        if choice.fair != usual:
            wanted[f"{usual}, fair"] = swept_as[choice.fair].sets
        if choice.frugal not in (usual, choice.fair):
            wanted[f"{usual}, frugal"] = swept_as[choice.frugal].sets
    found = {name: one for name, one in written.items() if name.startswith(f"{radio}: ") and name.endswith(CHOSEN)}
    assert {name: {*one.sets} for name, one in found.items()} == {name: {*sets} for name, sets in wanted.items()}


def sweep_data(**changes):
    runs = {
        name: pd.DataFrame({"replicate": [0, 1], "rmse": [rmse, rmse], "energy": energy, "tracked": 1.0, "lost": 0,
                            "losses": 0, "fingerprint": [f"{name}0", f"{name}1"]})
        for name, (rmse, energy) in {"ideal: ekf": (1.0, 1.0), "ideal: ekf, noise x10": (0.5, 2.0)}.items()
    }  # fmt: skip
    for name, columns in changes.items():
        runs[name] = runs[name].assign(**columns)
    data = TablesOfRuns(runs)
    data.variants, data.published = tuple(runs), {"sweep": SWEEP}
    data.scenario = lambda variant: {"seed": 19, "duration": 14.0}
    data.manifest = type("Manifest", (), {
        "points": [type("Point", (), {"replicates": 2})], "code": {},
        "code_changes": ({"before": "a", "after": "b"}, {"before": "b", "after": "c"}),
    })  # fmt: skip
    return data


def test_what_is_stored_is_read_back_and_its_digest_is_that_of_all_fingerprints(tmp_path):
    found = settings.sweep_of(sweep_data(), ["1234567"])
    assert found.about["code"] == ["a", "b", "c"] and found.about["commits"] == ["1234567"]
    assert found.choices == {"ekf": Choice("ideal: ekf, noise x10", "ideal: ekf, noise x10")}
    settings.store({"ideal": found}, tmp_path / "settings.json")
    again = stored(tmp_path / "settings.json")["ideal"]
    assert again.choices == found.choices and again.about == found.about
    assert json.dumps([row.variant for row in again.results]) == json.dumps([row.variant for row in found.results])
    other = settings.sweep_of(sweep_data(**{"ideal: ekf": {"fingerprint": ["p", "q"]}}))
    assert other.about["digest"] != found.about["digest"]


def test_a_strategy_that_is_swept_later_is_added_in_the_order_of_the_sweep():
    of = swept(SWEEP, "ideal")

    def sweep_of(kind, about):
        rows = tuple(result(name, 1.0, 1.0) for name, strategy in of.items() if strategy == kind)
        return StoredSweep(about, rows, {kind: Choice(f"ideal: {kind}", f"ideal: {kind}")})

    found = settings.merged(sweep_of("imm", {"seed": 19}), sweep_of("ekf", {"digest": "x"}), SWEEP)
    assert [*found.choices] == ["ekf", "imm"] and found.choices["ekf"].fair == "ideal: ekf"
    assert [one.variant for one in found.results] == [name for name, kind in of.items() if kind in ("ekf", "imm")]
    assert found.about == {"seed": 19, "added": [{"strategies": ["ekf"], "digest": "x"}]}
    with pytest.raises(AssertionError, match="a second time"):
        settings.merged(found, sweep_of("ekf", {}), SWEEP)


def test_a_line_says_what_the_sweep_chooses_and_whether_the_frontier_has_it(monkeypatch):
    monkeypatch.setattr(settings, "stored", dict)
    assert settings.lines(sweep_data()) == ["ideal: ekf: fair is noise x10; the frontier has none"]
    monkeypatch.setattr(settings, "stored", lambda: {"ideal": settings.sweep_of(sweep_data())})
    assert settings.lines(sweep_data()) == ["ideal: ekf: fair is noise x10"]
