"""Wrong arguments of the functions and results of the package are refused with one sentence."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import wsnsim
from wsnsim.base.errors import ResultError, ScenarioError, StorageError, UsageError

SHORT = {"duration": 3}


@pytest.fixture(scope="module")
def plain() -> wsnsim.Result:
    return wsnsim.simulate("rkf", **SHORT)


@pytest.mark.parametrize(
    ("replicates", "message"),
    [
        ([1, 1], "replicates: run 1 is named twice"),
        (True, "replicates: expected a number of runs from 1, or a list .* got True"),
        ("3", "replicates: expected .* got '3'"),
        (2.0, "replicates: expected .* got 2.0"),
        ([-1], "replicates: expected the number of a run, a whole number from 0, got -1"),
        ([False], "replicates: .* got False"),
        ([], "replicates: must be at least 1"),
        (0, "replicates: must be at least 1"),
    ],
)
def test_runs_are_a_number_or_different_numbers(replicates, message):
    with pytest.raises(UsageError, match=message):
        wsnsim.run("rkf", replicates=replicates, **SHORT)


def test_numbers_of_numpy_are_numbers_of_runs():
    assert wsnsim.run("rkf", replicates=np.int64(2), **SHORT).replicates == (0, 1)
    assert wsnsim.run("rkf", replicates=np.array([3, 1]), **SHORT).replicates == (3, 1)


FUNCTIONS = {
    "load": wsnsim.load,
    "simulate": wsnsim.simulate,
    "run": wsnsim.run,
    "sweep": lambda source: wsnsim.sweep(source, {"seed": [1]}, workers=0),
    "compare": lambda source: wsnsim.compare(source, trackers=["ekf", "pf"], workers=0),
    "bound": wsnsim.bound,
}


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("scenario", [None, 5, 2.5, True, b"rkf", [1], {1}, object(), dict, pd.DataFrame({"a": [1]})])
def test_what_is_no_scenario_is_refused(function, scenario):
    with pytest.raises(UsageError, match=r"^scenario: expected the name of a scenario, a file, a dict, .* got .+$"):
        FUNCTIONS[function](scenario)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_result_is_no_scenario_but_has_one(function, plain):
    with pytest.raises(UsageError, match=r"got <Result rkf: .* \(its attribute `scenario` is one\)$"):
        FUNCTIONS[function](plain)
    assert wsnsim.load(plain.scenario) is plain.scenario


@pytest.mark.parametrize("function", FUNCTIONS)
def test_a_folder_is_no_scenario(function, tmp_path):
    with pytest.raises(ScenarioError, match="is a folder, expected a scenario file"):
        FUNCTIONS[function](tmp_path)


@pytest.mark.parametrize("overrides", [5, b"seed=1", [3], [("a", "b", 3)]])
def test_overrides_of_a_scenario_to_load_are_a_mapping_or_a_list(overrides):
    with pytest.raises(UsageError, match=r"^overrides: expected a mapping such as .* got "):
        wsnsim.load("rkf", overrides)


@pytest.mark.parametrize("scenario", [None, 5, "rkf", {}, object()])
def test_only_what_was_loaded_is_built(scenario):
    with pytest.raises(UsageError, match=r"^scenario: expected what wsnsim.load returned, got "):
        wsnsim.build(scenario)


@pytest.mark.parametrize("path", [None, 5, b"a.h5", ["a.h5"], {}, pd.DataFrame({"a": [1]})])
def test_only_a_path_is_read_compared_or_plotted(path):
    with pytest.raises(UsageError, match=r"^path: expected the path of a result file, .*, got [^\n]+$"):
        wsnsim.read(path, "runs")
    with pytest.raises(UsageError, match=r"^compare\(\): [^\n]+ is not the folder of a campaign"):
        wsnsim.compare(path)
    with pytest.raises(
        UsageError, match=r"^result: expected what wsnsim.simulate or wsnsim.run returned, .* got [^\n]+$"
    ):
        wsnsim.plot(path)


def test_a_result_has_tables_of_its_own(plain):
    with pytest.raises(UsageError, match=r"; its tables are result.table\('runs'\)$"):
        wsnsim.read(plain, "runs")


def test_a_name_that_is_too_long_for_the_system_is_an_error_of_ours():
    name = "x" * 5000
    with pytest.raises(UsageError, match="is not the folder of a campaign"):
        wsnsim.compare(name)
    for call in (lambda: wsnsim.read(name, "runs"), lambda: wsnsim.plot(name), lambda: wsnsim.load(name)):
        with pytest.raises(wsnsim.WsnsimError):
            call()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"replicate": "x"}, "replicate: expected the number of a run, a whole number from 0, got 'x'"),
        ({"replicate": -1}, "replicate: .* got -1"),
        ({"replicate": 1.5}, "replicate: .* got 1.5"),
        ({"overrides": 5}, "overrides: expected a mapping such as .* got 5"),
        ({"overrides": [3]}, "overrides: expected a mapping .* got 3 in it"),
        ({"overrides": [("a", "b", 3)]}, r"overrides: .* got \('a', 'b', 3\) in it"),
        (
            {"overrides": {"sensor.sd": 1}, "sensor": {"sd": 2}},
            "'sensor.sd' is given twice, by arguments or in",
        ),
        ({"overrides": ["duration=2"], "duration": 3}, "'duration' is given twice"),
        ({"overrides": {"seed": 2}, "seed": 2}, "'seed' is given twice"),
        ({"keep": 5}, r"keep: expected names of tables, such as \['events'\], got 5"),
        ({"keep": [["a"]]}, r"keep: .* got \[\['a'\]\]"),
    ],
)
def test_a_wrong_value_of_an_argument_is_a_usage_error(arguments, message):
    with pytest.raises(UsageError, match=message):
        wsnsim.simulate("rkf", **arguments)


def test_a_table_for_which_the_tracker_has_nothing_is_named():
    said = "note: record.particles: the table is empty: the tracker rkf has none"
    assert said in wsnsim.simulate("rkf", keep="particles", **SHORT).summary()
    assert "table is empty" not in wsnsim.simulate("rkf", tracker="pf", keep="particles", **SHORT).summary()


def test_none_means_no_overrides_and_no_tables():
    assert wsnsim.simulate("rkf", overrides=None, keep=None, **SHORT).scenario.overrides == ("duration=3",)


@pytest.mark.parametrize("path", [None, 5, ".", "a.csv", "a", "a.parquet"])
def test_a_result_is_saved_in_a_result_file_only(plain, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"path: expected .* suffix .h5, got "):
        plain.save(path)
    if path is not None:
        with pytest.raises(UsageError, match=r"out: expected .* suffix .h5, got "):
            wsnsim.run("rkf", out=path, **SHORT)
    assert not list(tmp_path.iterdir())


def test_a_page_needs_a_name_a_suffix_and_a_folder(plain):
    for path in (".", "a.txt", None):
        with pytest.raises(UsageError, match=r"path: expected .* suffix .html, got "):
            plain.report(path)
    with pytest.raises(StorageError, match=r"no/a.html: cannot be written: folder does not exist: no$"):
        plain.report("no/a.html")


def test_the_page_of_a_result_in_memory_names_no_temporary_file(plain, tmp_path):
    page = plain.report(tmp_path / "a.html").read_text(encoding="utf-8")
    assert "in memory" in page and "wsnsim-" not in page


def test_a_result_whose_file_was_deleted_names_that_file_and_is_still_shown(tmp_path):
    filed = wsnsim.run("rkf", replicates=1, out=tmp_path / "mine.h5", **SHORT)
    (tmp_path / "mine.h5").unlink()
    with pytest.raises(ResultError, match=r"mine.h5: the file of this result is missing"):
        filed.save(tmp_path / "copy.h5")
    assert "rkf" in filed._repr_html_() and "mine.h5" in filed._repr_html_()
    assert not list(tmp_path.iterdir())


def test_an_object_that_is_no_component_is_the_only_error_of_a_scenario_that_extends_another():
    with pytest.raises(ScenarioError) as caught:
        wsnsim.simulate({"extends": "pso_mhpf", "tracker": object()})
    assert str(caught.value) == "tracker: error: a object is not allowed in a scenario"
