"""Errors beside the bound, consistency on either kind of stretch, and the answers, on small tables that are made up."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim.papers.resampling import DRAWS
from wsnsim.papers.rows import Interval, both, interval
from wsnsim.papers.study import study

against_bound = module("frontier", "bound")
consistency = module("frontier", "bound")
hypotheses = module("frontier", "hypotheses")
real_radio = module("frontier", "real_radio")
_bound = module("frontier", "bound")
Squares, medians, near_walls, of_medians, pooled, rmse_of_runs = (
    _bound.Squares,
    _bound.medians,
    _bound.near_walls,
    _bound.of_medians,
    _bound.pooled,
    _bound.rmse_of_runs,
)
_settings = module("frontier", "settings")
Choice, StoredSweep = _settings.Choice, _settings.StoredSweep
_strategies = module("frontier", "strategies")
Strategy = _strategies.Strategy

REGISTERED = study("frontier").registered
TIMES = np.array([0.5, 1.0, 1.5])
NAN = float("nan")


def squared(errors, bounds):
    errors = np.asarray(errors, dtype=np.float64)
    return Squares(np.arange(len(errors)), TIMES, errors, np.where(np.isfinite(errors), bounds, NAN))


def test_what_was_registered_before_the_first_run_is_unchanged():
    assert REGISTERED == {
        "ideal": 1.10, "joules": 0.18, "greatest": 1.0, "walls": {"margin": 10.0, "memory": 1.0, "beginning": 1.0},
        "near_walls": 4.0, "radio_settled": 1.3, "radio_whole": 1.5, "in_time": 0.92, "asleep_in_time": 0.8,
        "robust": {
            "noise x10": {"number": 9, "least": 1.0, "most": 1.4},
            "nodes off by 1 m": {"number": 10, "least": 2.0, "most": 8.0},
            "nodes off by 3 m": {"number": 10, "least": 5.0, "most": 25.0},
            "gains unknown": {"number": 11, "least": 3.0, "most": 20.0},
        },
        "published_near": 1.1, "linearisation": 0.1, "membership": 0.9, "kept": 0.8,
        "real_radio": {"in_time": 0.9, "lost": 0.05, "over_bound": 1.5},
    }  # fmt: skip


def test_the_pooled_error_counts_the_steps_that_have_an_estimate_of_every_run():
    found = squared([[4.0, 4.0, NAN], [16.0, 4.0, 8.0]], 1.0)
    assert pooled(found).value == pytest.approx(np.sqrt(36.0 / 5.0))
    assert rmse_of_runs(found.errors) == pytest.approx([2.0, np.sqrt(28.0 / 3.0)])
    later = found.after(1.0)
    assert later.times.tolist() == [1.5] and pooled(later).value == pytest.approx(np.sqrt(8.0))
    assert np.isnan(rmse_of_runs(later.errors)[0]) and rmse_of_runs(later.errors)[1] == pytest.approx(np.sqrt(8.0))


def test_a_run_astray_moves_the_pooled_error_and_not_the_median():
    rows = [[1.0, 1.0, 1.0]] * 8 + [[400.0] * 3]
    assert of_medians(squared(rows, 1.0)).value == pytest.approx(1.0)
    assert pooled(squared(rows, 1.0)).value == pytest.approx(np.sqrt((8.0 + 400.0) / 9.0))


def test_equal_runs_have_no_interval_and_unequal_ones_have():
    assert pooled(squared([[2.0] * 3] * 5, 1.0)) == pytest.approx((np.sqrt(2.0),) * 3)
    found = pooled(squared([[1.0] * 3] * 5 + [[4.0] * 3] * 5, 1.0))
    assert 1.0 < found.low < found.value < found.high < 2.0


def test_the_median_of_resamples_leaves_runs_without_a_value_last():
    assert medians(np.array([3.0, NAN, 1.0]))[0] == 3.0
    assert medians(np.array([3.0, 2.0, 1.0]))[0] == 2.0


def test_a_stretch_is_near_a_wall_while_the_target_is_beyond_the_margin_and_for_some_time_after():
    x = np.array([[0.0, 171.0, 0.0, 0.0, 0.0]])
    positions = np.stack([x, np.zeros_like(x)], axis=2)
    times = np.arange(1, 6) * 0.5
    assert near_walls(positions, times, 180.0, 10.0, 1.0).tolist() == [[False, True, True, True, False]]
    assert near_walls(-positions, times, 180.0, 10.0, 0.0).tolist() == [[False, True, False, False, False]]


def one_interval(value, low, high):
    return Interval(value, low, high)


def test_an_interval_on_one_side_of_a_threshold_decides_and_another_does_not():
    assert one_interval(1.0, 0.9, 1.1).below(1.2) is True and one_interval(1.0, 0.9, 1.1).below(0.5) is False
    assert one_interval(1.0, 0.9, 1.1).below(1.05) is None and one_interval(NAN, NAN, NAN).above(1.0) is None
    assert both(True, True) is True and both(None, False) is False and both(True, None) is None
    assert interval(np.full(1 + DRAWS, 2.0)) == (2.0, 2.0, 2.0)


def test_only_the_known_ends_of_an_interval_are_printed():
    assert str(one_interval(1.0, 0.9, 1.1)) == "1.00 [0.90, 1.10]" and str(one_interval(NAN, NAN, NAN)) == "unknown"
    assert str(one_interval(1.0, NAN, NAN)) == str(one_interval(1.0, 0.9, NAN)) == "1.00"


class Runs(TablesOfRuns):
    """Data with the tables given by variant and name, and a scenario of a wall at 180 m and steps of 0.5 s."""

    def __init__(self, tables, name="at_the_bound"):
        super().__init__({})
        self.by_name, self.variants = tables, tuple(tables)
        self.registered = REGISTERED
        self.manifest = type("Manifest", (), {"name": f"frontier_{name}"})

    def of(self, variant, table):
        return self.by_name[variant][table]

    def of_runs(self, variant, column):
        return self.of(variant, "runs").set_index("replicate")[column]

    def scenario(self, variant):
        return {"step": 0.5, "motion": {"bound": 180.0}}


def runs(count=10, **columns):
    usual = {"rmse": 0.2, "energy": 0.1, "lost": 0, "losses": 0, "tracked": 1.0, "time_lost": 0.0}
    return pd.DataFrame({"replicate": range(count), **usual, **columns})


def walked(nees, count=10):
    """Eight steps of every run: in the middle, except the fifth, which is beyond the margin of a wall."""
    steps = np.arange(1, 9)
    x = np.where(steps == 5, 175.0, 0.0)
    truth = pd.concat([pd.DataFrame({"replicate": i, "step": steps, "px": x, "py": 0.0}) for i in range(count)])
    estimates = pd.concat([pd.DataFrame({"replicate": i, "step": steps, "nees": nees(i, steps)}) for i in range(count)])
    return {"truth": truth, "estimates": estimates}


def test_the_nees_of_a_stretch_is_the_mean_over_its_steps_without_the_beginning():
    def nees(run, steps):
        return np.where(steps <= 2, 1000.0, np.where((steps >= 5) & (steps <= 7), 30.0, 2.0))

    data = Runs({"v": {"runs": runs(), **walked(nees)}})
    assert consistency.mean_nees(data, "v", near=False).value == pytest.approx(2.0)
    assert consistency.mean_nees(data, "v", near=True).value == pytest.approx(30.0)
    assert consistency.nees_of_runs(data, "v", near=True).tolist() == pytest.approx([30.0] * 10)


def bound_data(monkeypatch, ratio=1.05, away=2.0, wall=3.0, **columns):
    """Ten runs of one seed whose error is a multiple of the bound, with NEES spread around the levels given."""
    spread = 1.0 + 0.02 * np.linspace(-1.0, 1.0, 10)

    def nees(run, steps):
        return np.where((steps >= 5) & (steps <= 7), wall, away) * spread[run]

    name = "ideal: information_driven, seed 1"
    data = Runs({name: {"runs": runs(**columns), **walked(nees)}})
    found = Squares(np.arange(10), 0.5 * np.arange(1, 9), np.outer((ratio * spread) ** 2, np.ones(8)), np.ones((10, 8)))
    monkeypatch.setattr(hypotheses, "squares", lambda data, variant: found)
    monkeypatch.setattr(consistency, "_of_state", lambda data, variant: data.of(variant, "estimates").assign(nees=4.0))
    return data


def given(found):
    return [answer.answer for answer in found]


def test_the_answers_at_the_bound_follow_from_the_rows(monkeypatch):
    # error pooled and median, energy, losses, NEES of position and state away from walls, NEES near walls
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch))) == ["yes"] * 7
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, ratio=1.2)))[:2] == ["no", "no"]
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, ratio=1.1)))[0] == "undecided"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, energy=0.2)))[2] == "no"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, losses=[0] * 9 + [1])))[3] == "no"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, rmse=[0.2] * 9 + [1.1])))[3] == "no"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, away=2.2)))[4] == "no"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, wall=1.5)))[6] == "no"
    assert given(hypotheses.at_the_bound(bound_data(monkeypatch, wall=5.0)))[6] == "no"
    assert all(line.startswith("registered ") for line in hypotheses.lines(bound_data(monkeypatch)))


def test_the_answers_on_a_radio_follow_from_the_rows(monkeypatch):
    assert given(hypotheses.on_a_radio(bound_data(monkeypatch, ratio=1.2))) == ["yes"] * 4
    found = given(hypotheses.on_a_radio(bound_data(monkeypatch, ratio=1.4, tracked=0.5, losses=1)))
    assert found == ["no", "yes", "no", "no"]


def test_the_answers_on_a_radio_say_of_which_slots_they_are(monkeypatch):
    data = bound_data(monkeypatch)
    data.variants = ("slots: information_driven, seed 1", "slots: information_driven, idle slots kept, seed 1")
    data.by_name = dict.fromkeys(data.variants, data.by_name["ideal: information_driven, seed 1"])
    named = [answer.words.partition(":")[0] for answer in hypotheses.on_a_radio(data)]
    assert named == [*["6 (seed 1)"] * 2, *["7 (seed 1)"] * 2,
                     *["6 (seed 1, idle slots kept)"] * 2, *["7 (seed 1, idle slots kept)"] * 2]  # fmt: skip


def test_the_interval_of_a_share_is_exact():
    assert real_radio.clopper_pearson(0, 60) == pytest.approx((0.0, 0.0, 1.0 - 0.025 ** (1 / 60)))
    assert real_radio.clopper_pearson(60, 60) == pytest.approx((1.0, 0.025 ** (1 / 60), 1.0))
    found = real_radio.clopper_pearson(1, 10)
    assert found == pytest.approx((0.1, 0.00253, 0.44502), abs=1e-5), "tabulated"


def on_real_radio(**in_time):
    """Figures of strategies on two seeds with as much in time; nothing is lost, and all are near the bound."""
    found = {}
    for name, shares in in_time.items():
        for seed, share in enumerate(shares):
            total = Strategy(f"kept: {name}, margin 5 m, seed {seed}", 0.1 if name == "information_driven" else 0.2,
                             NAN, NAN, 440.0, 0.0, share)  # fmt: skip
            near = one_interval(1.2, 1.1, 1.3)
            found[total.variant] = real_radio.OnASeed(
                one_interval(share, share - 0.02, share + 0.02), (0, 60), near, total
            )
    return found


def test_the_answers_on_the_real_radio_hold_on_every_seed_or_not():
    found = real_radio.of_figures(
        on_real_radio(information_driven=(0.95, 0.95), ukf=(0.95, 0.91), gpf=(0.95, 0.5)), REGISTERED["real_radio"]
    )
    assert given(found) == ["yes", "undecided", "no", *["undecided"] * 3, *["yes"] * 3, *["yes"] * 4]
    assert found[6].words == "19 (information_driven, all seeds): at most 5% of 120 runs lost"
    assert found[6].found[0].high == pytest.approx(1.0 - 0.025 ** (1 / 120))
    assert "these follow: information_driven, ukf; on the front of each seed: information_driven)" in found[-1].words
    nobody = real_radio.of_figures(on_real_radio(information_driven=(0.5, 0.95)), REGISTERED["real_radio"])
    assert given(nobody)[-1] == "no" and "these follow: none" in nobody[-1].words


def test_the_answers_of_a_sleeping_network_compare_shares_of_lost_runs():
    tables = {
        "2 % awake: information_driven": {"runs": runs(losses=[1] + [0] * 9, tracked=0.9)},
        "2 % awake: gpf": {"runs": runs(losses=[1] * 8 + [0] * 2)},
        "2 % awake: ekf": {"runs": runs(losses=0)},
    }
    better, worse, timely = hypotheses.asleep(Runs(tables, "asleep"))
    assert better.answer == "yes" and better.found[0].value == pytest.approx(0.7)
    assert worse.answer != "yes" and worse.found[0].value == pytest.approx(-0.1) and timely.answer == "yes"


def test_shares_and_ratios_are_of_the_runs_that_both_variants_have():
    tables = {
        "2 % awake: information_driven": {"runs": runs(10, losses=0)},
        "2 % awake: gpf": {"runs": runs(6, losses=[1, 1, 1, 0, 0, 0])},
    }
    found = hypotheses.asleep(Runs(tables, "asleep"))[0]
    assert found.found[0].value == pytest.approx(0.5)


def test_the_answers_on_wrong_knowledge_are_ratios_to_the_same_tracker_with_full_knowledge():
    ours, levels = "ideal: information_driven", {"noise x10": 1.2, "nodes off by 1 m": 20.0, "nodes off by 3 m": 10.0}
    spread = np.linspace(0.99, 1.01, 10)
    tables = {ours: {"runs": runs(rmse=spread)}, f"{ours}, gains unknown": {"runs": runs(rmse=3.0 * spread)}}
    tables |= {f"{ours}, {name}": {"runs": runs(rmse=level * spread)} for name, level in levels.items()}
    assert given(hypotheses.robustness(Runs(tables, "robustness"))) == ["yes", "no", "yes", "undecided"]


def frontier_data(monkeypatch, levels, energies=None, lost=()):
    """Ten runs of each strategy with an RMSE around the level given; the bound is 1 m."""
    spread = np.linspace(0.99, 1.01, 10)
    tables = {
        name: {"runs": runs(rmse=level * spread, energy=(energies or {}).get(name, 1.0), losses=int(name in lost))}
        for name, level in levels.items()
    }
    data = Runs(tables, "frontier")
    choices = {name: Choice(f"ideal: {name}", f"ideal: {name}") for name in ("ekf", "gpf")}
    results = tuple(Strategy(f"ideal: {name}", 1.0, 1.0, 1.0, 1.0, 0.0, 1.0) for name in choices)
    monkeypatch.setattr(hypotheses, "stored", lambda: {"ideal": StoredSweep({}, results, choices)})
    monkeypatch.setattr(hypotheses, "limit", lambda data: 1.0)
    return data


LEVELS = {
    "ideal: ekf": 1.4, "ideal: gpf": 1.3, "ideal: ukf": 1.41, "ideal: ckf": 1.35, "ideal: ekf, appointed": 1.2,
    "ideal: gpf, appointed": 1.1, "ideal: information_driven": 1.05, "slots: information_driven": 1.3,
    "slots: ekf": 1.5,
}  # fmt: skip


def test_a_campaign_without_two_strategies_has_no_answer_that_compares_them(monkeypatch):
    data = frontier_data(monkeypatch, {"ideal: imm": 1.1, "ideal: gpf, appointed": 1.1, "ideal: ukf": 1.2})
    assert hypotheses.of_pairs(data, hypotheses.strategies(data)) == []


def test_the_answers_of_the_frontier_follow_from_its_strategies(monkeypatch):
    cheap = {"ideal: information_driven": 0.5}
    found = given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS, cheap)))
    assert found == ["yes"] * 9, "12 twice, 13, 14, 15 twice, 16 twice, 17"
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS, {"ideal: gpf": 0.1})))[2] == "no"
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS | {"slots: ekf": 1.0})))[3] == "no"
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS | {"ideal: ukf": 1.0})))[4] == "no"
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS | {"ideal: gpf, appointed": 1.29})))[7] == "no"
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS, lost=("ideal: ekf",))))[8] == "no"
    others = {"ideal: gpf": 1.8, "ideal: ckf": 1.9, "ideal: ekf": 2.0, "ideal: ukf": 1.9}
    assert given(hypotheses.frontier(frontier_data(monkeypatch, LEVELS | others)))[:2] == ["no", "yes"]


def test_errors_and_bounds_of_a_run_stand_at_the_same_steps(monkeypatch):
    estimates = pd.DataFrame({"replicate": [0, 0, 1], "step": [1, 3, 2], "error": [2.0, 3.0, 4.0]})
    data = Runs({"v": {"runs": runs(2), "estimates": estimates}})
    bound = type("Bound", (), {"reason": "", "each": np.array([[[1.0, 2.0, 3.0]], [[4.0, 5.0, 6.0]]])})
    monkeypatch.setattr(against_bound, "load", lambda scenario, plugins: type("Scenario", (), {"step": 0.5}))
    monkeypatch.setattr(against_bound.bounds, "bound", lambda scenario, numbers, kind: bound)
    found = against_bound.squares(data, "v")
    np.testing.assert_array_equal(found.errors, [[4.0, NAN, 9.0], [NAN, 16.0, NAN]])
    np.testing.assert_array_equal(found.bounds, [[1.0, NAN, 9.0], [NAN, 25.0, NAN]])
    assert against_bound.over_bound(data, "v").tolist() == pytest.approx([np.sqrt(1.3), 0.8])
    assert against_bound.rmse_after(data, "v", 0.6).tolist() == pytest.approx([3.0, 4.0])


def test_what_no_strategy_or_run_shows_is_undecided():
    nobody = [Strategy(f"{radio}: {name}", NAN, NAN, NAN, NAN, 1.0, 0.0)
              for radio in ("ideal", "slots") for name in ("ekf, fair", "information_driven, fair")]  # fmt: skip
    found = hypotheses.of_strategies(nobody, 1.0, REGISTERED)
    for answer in found[:2]:
        assert "(none follows the target)" in answer.words and str(answer).endswith(": undecided, unknown")
    nothing = squared([[NAN] * 3] * 5, 1.0)
    assert np.isnan([*pooled(nothing), *of_medians(nothing)]).all()
