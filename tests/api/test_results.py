"""Results of `wsnsim.simulate` and `wsnsim.run`: tables, plots, pages, files and messages."""

from __future__ import annotations

import pickle

import pandas as pd
import pytest

import wsnsim
from tests.result_digests import column_digests
from wsnsim.base.errors import ResultError, RunError, ScenarioError, UsageError
from wsnsim.base.tables import RECORDED_BY_DEFAULT, TABLES
from wsnsim.cli import main
from wsnsim.models.ranging import Range
from wsnsim.trackers.pso_mhpf import PsoMhpf

SHORT = {"duration": "0.4 s"}
ALL = tuple(TABLES)


@pytest.fixture(scope="module")
def result() -> wsnsim.Result:
    return wsnsim.simulate("pso_mhpf", tracker=PsoMhpf(particles=60), seed=3, keep=ALL, **SHORT)


@pytest.fixture(scope="module")
def plain() -> wsnsim.Result:
    return wsnsim.simulate("rkf", duration=5)


@pytest.mark.thorough
def test_every_table_in_memory_equals_that_of_the_saved_file(result, tmp_path):
    path = result.save(tmp_path / "x.h5")
    assert set(result.tables) == set(TABLES)
    for table in result.tables:
        pd.testing.assert_frame_equal(result.table(table), wsnsim.read(path, table))
    assert result.energy.groupby("cause", observed=True).joules.sum().sum() == pytest.approx(result.runs.energy[0])


@pytest.mark.thorough
def test_a_saved_result_equals_that_of_the_command_line(result, tmp_path):
    tracker = "tracker={kind: pso_mhpf, particles: 60}"
    keep = [part for table in ALL for part in ("--set", f"record.{table}=true")]
    arguments = ["run", "pso_mhpf", "-q", "--seed", "3", "--set", tracker, "--set", "duration=0.4 s", *keep]
    assert main([*arguments, "--out", str(tmp_path / "cli.h5")]) == 0
    written = column_digests(result.save(tmp_path / "python.h5"))
    assert written == column_digests(tmp_path / "cli.h5")
    assert len(written) > 60
    scenarios = [wsnsim.load(tmp_path / f"{name}.h5") for name in ("cli", "python")]
    assert scenarios[0] == scenarios[1] == result.scenario


@pytest.mark.thorough
def test_many_runs_are_the_same_in_memory_and_in_a_file(tmp_path):
    kept, filed = (wsnsim.run("rkf", replicates=3, out=out, duration=4) for out in (None, tmp_path / "x.h5"))
    assert (kept.out, filed.out) == (None, tmp_path / "x.h5")
    assert kept.replicates == filed.replicates == (0, 1, 2)
    for table in filed.tables:
        left_out = ["cpu_seconds"] if table == "runs" else []
        pd.testing.assert_frame_equal(
            kept.table(table).drop(columns=left_out), filed.table(table).drop(columns=left_out)
        )
    assert column_digests(kept.save(tmp_path / "y.h5")) == column_digests(filed.save(tmp_path / "z.h5"))


def test_replicate_is_the_number_of_the_run(plain):
    second = wsnsim.simulate("rkf", duration=5, replicate=1)
    assert second.replicates == (1,)
    assert second.runs.fingerprint[0] != plain.runs.fingerprint[0]
    assert second.runs.fingerprint[0] == wsnsim.run("rkf", replicates=2, duration=5).runs.fingerprint[1]


def test_what_is_changed_is_in_the_scenario():
    told = wsnsim.simulate(
        "ekf_real",
        tracker="ukf",
        link={"exponent": 2.2},
        sleep="always_on",
        overrides=["duration=0.2 s"],
        clusters=None,
    ).scenario
    said = wsnsim.load("ekf_real", ["tracker.kind=ukf", "link.exponent=2.2", "sleep.kind=always_on", "duration=0.2 s"])
    assert told == said
    assert told.overrides == ("tracker.kind=ukf", "link.exponent=2.2", "sleep.kind=always_on", "duration=0.2 s")


def test_a_result_is_short_in_a_console_and_a_table_in_a_notebook(plain, result):
    assert len(repr(result)) < 160
    assert repr(plain).startswith("<Result rkf: 1 Monte Carlo run, RMSE ")
    assert "tmp" not in plain.summary()
    assert str(plain) == plain.summary()
    assert plain.summary().replace("\n", " ").startswith(plain.answer())
    assert plain.answer().startswith("The target was followed")
    assert f"an RMSE of {plain.runs.rmse[0]:.3g} m" in plain.answer()
    markup = result._repr_html_()
    assert "energy spent" in markup and ">RMSE</th>" in markup and "pso_mhpf" in markup
    assert "energy spent" not in plain._repr_html_(), "a run without a network spends none"
    assert result.to_dict()["file"] == ""
    assert "CRLB" in plain.summary(bounds=True) and plain.to_dict(bounds=True)["bound"] > 0
    assert wsnsim.simulate("beacons", duration=1).summary().count("beacons") > 0


def test_a_result_survives_a_pickle(result, tmp_path):
    again = pickle.loads(pickle.dumps(result))
    pd.testing.assert_frame_equal(again.events, result.events)
    assert again.scenario == result.scenario
    assert repr(again) == repr(result)
    assert column_digests(again.save(tmp_path / "a.h5")) == column_digests(result.save(tmp_path / "b.h5"))


@pytest.mark.thorough
def test_plots_draw_on_given_axes_or_on_their_own(result, plain):
    from matplotlib import pyplot

    axes = pyplot.figure().subplots()
    assert result.plot.track(ax=axes) is axes
    drawn = [
        result.plot(),
        result.plot.error(),
        result.plot.energy(),
        result.plot.states("vx"),
        result.plot("particles"),
    ]
    assert len({ax.figure for ax in drawn}) == len(drawn)
    assert drawn[0].get_title(loc="left") == "track of replicate 0"
    assert plain.plot.consistency().get_ylabel() == "per degree of freedom"
    opened = len(pyplot.get_fignums())
    with pytest.raises(ResultError, match=r"^cannot plot energy: no energy was spent"):
        plain.plot.energy()
    with pytest.raises(UsageError, match=r"^there is no plot 'trak' .did you mean 'track'"):
        plain.plot("trak")
    assert len(pyplot.get_fignums()) == opened, "no empty figure stays"
    pyplot.close("all")


@pytest.mark.thorough
def test_a_page_is_written(plain, tmp_path):
    page = plain.report(tmp_path / "page.html")
    assert page.read_text().count("rkf") > 0


def test_a_table_that_was_not_recorded_says_how_to_record_it(plain):
    assert not RECORDED_BY_DEFAULT["readings"]
    with pytest.raises(ResultError, match=r"table readings was not recorded: record it with keep=\['readings'\]"):
        plain.table("readings")
    with pytest.raises(UsageError, match=r"there is no table 'reading' .did you mean 'readings'"):
        plain.table("reading")
    with pytest.raises(AttributeError, match=r"did you mean 'estimates'"):
        plain.estimate  # noqa: B018
    assert not hasattr(plain, "_unknown")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"traker": "ekf"}, r"simulate\(\) has no argument 'traker' .did you mean 'tracker'"),
        ({"keep": ["evnts"]}, "keep: there is no table 'evnts' .did you mean 'events'"),
        ({"tracker": "efk"}, "tracker.kind: error: unknown tracker 'efk' .did you mean 'ekf'"),
        ({"tracker": PsoMhpf}, r"tracker: error: is the class PsoMhpf, expected a component: PsoMhpf\(\)"),
        ({"tracker": Range()}, "tracker: error: expected a tracker, got the sensor Range"),
        ({"tracker": 3}, "tracker: error: expected a mapping such as {kind: pso_mhpf}, got the number 3"),
        ({"tracker": PsoMhpf(particles=-3)}, "tracker.particles: error: must be at least 1, is -3"),
        ({"overrides": {"link.reach": "60 kg"}}, "link.reach: error: 'kg' is a unit of mass, expected length"),
        ({"overrides": {"link.rech": 60}}, "link.rech: error: unknown key, did you mean 'reach'"),
        ({"overrides": ["link.reach"]}, "overrides link.reach: error: expected KEY=VALUE"),
        ({"overrides": {7: 60}}, "expected keys, such as 'link.reach'"),
    ],
)  # fmt: skip
def test_a_wrong_argument_is_named_with_what_is_nearest(arguments, message):
    with pytest.raises((UsageError, ScenarioError), match=message):
        wsnsim.simulate("pso_mhpf", **arguments)


def test_a_failed_run_and_a_missing_folder_are_errors_of_the_package(tmp_path):
    with pytest.raises(ResultError, match=r"folder does not exist"):
        wsnsim.run("rkf", replicates=1, duration=4, out=tmp_path / "no" / "x.h5")
    with pytest.raises(RunError, match=r"has no reading"):
        raise RunError("has no reading")
    with pytest.raises(UsageError, match=r"replicates: must be at least 1"):
        wsnsim.run("rkf", replicates=0)


def test_an_attribute_that_a_result_has_not_is_named_with_the_nearest(plain):
    with pytest.raises(AttributeError, match=r"no attribute 'rns' \(did you mean 'runs'"):
        plain.rns  # noqa: B018
    with pytest.raises(AttributeError, match=r"the table is result.table\('tracks'\), recorded with keep=\['tracks'\]"):
        plain.tracks  # noqa: B018


def test_progress_is_reported_to_the_caller():
    times, runs = [], []
    wsnsim.simulate("rkf", duration=5, progress=times.append)
    wsnsim.run("rkf", duration=5, replicates=2, batch=False, progress=runs.append)
    assert times[-1] == 5.0
    assert (runs[-1].replicate, runs[-1].replicates) == (1, 2)
