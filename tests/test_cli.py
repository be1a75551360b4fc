"""The command line: imports, answers, errors and exit codes."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import pytest

from tests.helpers.commands import run_process
from tests.helpers.thorough import thorough
from wsnsim.analysis import phrases
from wsnsim.cli import main
from wsnsim.cli.progress import MODES, RUN, display
from wsnsim.cli.shared import PURPOSES, every_command
from wsnsim.experiment import Progress
from wsnsim.scenario.registry import ROLES
from wsnsim.scenario.texts import shipped

HEAVY = ("numpy", "pandas", "scipy", "numba", "h5py", "matplotlib", "networkx", "pydantic", "yaml", "simpy")
QUICK = ("--set", "duration=0.4 s", "--set", "tracker.particles=40")


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run each test in a folder of its own, and undo its changes to the process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of two short runs, written by the command itself."""
    out = tmp_path_factory.mktemp("result") / "quick.h5"
    assert main(["run", "pso_mhpf", *QUICK, "--replicates", "2", "--out", str(out), "--quiet"]) == 0
    return out


# what it imports


@pytest.mark.thorough(fast=["--help"])
@pytest.mark.parametrize(
    "words", ["--help", "--version", "run --help", "plot --help", "list", "list trackers", "list scenarios", "rnu"]
)
def test_a_word_about_itself_imports_nothing_heavy(words: str) -> None:
    probe = (
        f"import sys; from wsnsim.cli import main; main({words.split()!r}); print(set({HEAVY!r}) & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "set()", done.stdout


def test_help_imports_nothing_but_the_standard_library_click_and_wsnsim() -> None:
    """`make bench` has the time that it takes."""
    names = "{name.partition('.')[0] for name in sys.modules}"
    probe = f"import sys; from wsnsim.cli import main; main(['--help']); print(*{names})"
    bare = subprocess.run([sys.executable, "-c", "import sys; print(*sys.modules)"], capture_output=True, text=True)
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True)
    before = {name.partition(".")[0] for name in bare.stdout.split()}
    found = set(done.stdout.splitlines()[-1].split()) - before - sys.stdlib_module_names
    assert {name for name in found if not name.startswith("_")} == {"click", "wsnsim"}


def test_help_shows_the_first_sentence_of_every_command_in_full(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    sections = dict(re.findall(r"^(.+):\n((?:  .+\n)+)", capsys.readouterr().out, re.MULTILINE))
    lines = [line for purpose in PURPOSES for line in sections[purpose].splitlines()]
    assert sorted(line.split()[0] for line in lines) == sorted(every_command())
    assert [line for line in lines if not line.endswith(".") or line.endswith("...")] == []


def test_threads_of_numerical_libraries_are_held_to_one_unless_the_user_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    main(["--version"])
    assert (os.environ["OMP_NUM_THREADS"], os.environ["MKL_NUM_THREADS"]) == ("1", "3")


# what it answers


def test_list_shows_the_kinds_and_finds_a_role_by_its_plural(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    everything = capsys.readouterr().out
    assert main(["list", "trackers"]) == 0
    trackers = capsys.readouterr().out
    assert trackers.partition("\n\n")[0] in everything
    for word in ("pso_mhpf", "Jiang, Song, Lin (2013)", "wsnsim info KIND"):
        assert word in trackers


@pytest.mark.parametrize("word", [*ROLES, "scenarios", "sweeps", "datasheets"])
def test_a_list_fits_a_hundred_columns_and_leaves_no_word_out(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", word]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    for row in ROLES[word].kinds if word in ROLES else ():
        assert any(line.startswith(f"  {row.kind} ") for line in lines)
        assert all(any(piece in line for line in lines) for piece in f"{row.idea} {row.paper}".split())


def test_a_narrow_terminal_gets_a_narrow_table(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "72")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(["list", "trackers"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 72
    assert any(line.startswith("  pso_mhpf ") for line in lines)
    lines = [*phrases.wrapped("words " * 99), *phrases.aligned([["a cell"] * 30] * 2)]
    assert 60 < max(map(len, lines)) <= 72


def test_list_as_json_is_one_object_with_every_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "motions", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["schema_version"] == 1
    assert answer["roles"]["motion"]["kinds"][0]["kind"] == "bounded_velocity"


def test_list_scenarios_says_what_each_shows_in_a_line_of_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "scenarios", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["scenarios"]
    assert sorted(found) == sorted(shipped()), "wsnsim/scenario/scenarios.table has a row for each"
    assert main(["list", "scenarios"]) == 0
    groups = [block.splitlines() for block in capsys.readouterr().out.split("\n\n")]
    assert [lines[0] for lines in groups] == ["start here", "several unlabelled targets", "papers", "radios",
                                              "recorded", "scale"]  # fmt: skip
    assert [line.split()[0] for lines in groups for line in lines[1:]] == list(found)


@pytest.mark.thorough
def test_schema_prints_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert "tracker" in json.loads(capsys.readouterr().out)["properties"]


def test_new_writes_a_scenario_that_checks_and_never_overwrites(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "mine"]) == 0
    assert main(["check", "mine.yaml"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "mine.yaml: ok"
    Path("mine.yaml").write_text("mine")
    assert main(["new", "mine.yaml"]) == 2
    assert capsys.readouterr().err == "wsnsim: error: mine.yaml exists already: choose another name, or remove it\n"
    assert Path("mine.yaml").read_text() == "mine"
    assert main(["new", "../mine"]) == 2


def test_check_tells_good_from_bad(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.yaml").write_text("extends: pso_mhpf\nlink: {raech: 3}\n")
    assert main(["check", "pso_mhpf", "bad.yaml", "ipf"]) == 2
    said = capsys.readouterr()
    assert said.out == "pso_mhpf: ok\nipf: ok\n"
    assert said.err == (
        "bad.yaml:2:8: error: link.raech: unknown key, did you mean 'reach'?\n    link: {raech: 3}\n           ^\n"
    )


def test_check_lays_set_on_the_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "pso_mhpf", "--set", "link.reach=1 kJ"]) == 2
    assert capsys.readouterr().err == (
        "--set link.reach: error: 'kJ' is a unit of energy, expected length (for example '1 m')\n"
    )


@pytest.mark.parametrize(
    ("override", "place"),
    [
        ("link.reach=-1", "link.reach"),
        ("deploy.nodes=2", "deploy.nodes"),
        ("deploy.nodes=12", "deploy.cover"),
        ("tracker.particles=0", "tracker.particles"),
        ("motion.start=[300, 0, 0, 0]", "motion.start"),
        ("tracker.kind=nobody", "tracker.kind"),
    ],
)
def test_an_impossible_value_is_one_fault_and_exit_code_2(
    override: str, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "pso_mhpf", "--set", override, "--out", "x.h5"]) == 2
    said = capsys.readouterr()
    faults = [line for line in said.err.splitlines() if "error: " in line]
    assert faults and place in faults[0] and "Traceback" not in said.err
    assert not list(Path().iterdir())


# runs


def test_a_run_writes_its_result_and_prints_its_summary(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "pso_mhpf", *QUICK]) == 0
    said = capsys.readouterr()
    assert Path("results/pso_mhpf.h5").is_file()
    assert "RMSE" in said.out
    assert "100 %" in said.err


@pytest.mark.parametrize("scenario", ["pso_mhpf", *thorough(["beacons"])])
def test_a_run_writes_its_page_too_where_it_is_asked_for(scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    short = QUICK if scenario == "pso_mhpf" else ("--set", "duration=2 s")
    assert main(["run", scenario, *short, "--report", "--json", "--progress", "none", "-o", "x.h5"]) == 0
    said = capsys.readouterr()
    assert isinstance(json.loads(said.out), dict) and "x.html" in said.err
    assert "<canvas" in Path("x.html").read_text(encoding="utf-8")


def test_a_page_that_has_no_place_is_refused_before_anything_runs(capsys: pytest.CaptureFixture[str]) -> None:
    Path("y.html").mkdir()
    for out, message in (
        ("x.html", "expected a file with the suffix .h5"),
        ("y.h5", "--report: y.html is a folder"),
    ):
        assert main(["run", "pso_mhpf", *QUICK, "--report", "--out", out]) == 2
        said = capsys.readouterr()
        assert message in said.err and said.out == "" and not Path(out).exists()


def test_a_run_as_json_is_one_object_without_nan(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "pso_mhpf", *QUICK, "--json", "--quiet", "--seed", "7", "-o", "x.h5"]) == 0
    said = capsys.readouterr()
    answer = json.loads(said.out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert (answer["seed"], answer["replicates"], answer["schema_version"]) == (7, 1, 1)
    assert answer["first_death"] is None
    assert said.err == ""


@pytest.mark.thorough
def test_a_result_can_be_run_again_checked_described_and_verified(
    result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(result), "--out", "again.h5", "--json", "--quiet"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["name"], again["replicates"], again["steps"]) == ("pso_mhpf", 2, 9)
    assert main(["check", str(result)]) == 0
    assert main(["info", str(result)]) == 0
    assert "pso_mhpf" in capsys.readouterr().out
    assert main(["info", str(result), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["replicates"] == 2
    assert main(["verify", "again.h5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True


@pytest.mark.parametrize("command", ["info", "plot", "verify", "recover"])
def test_a_result_that_is_missing_or_something_else_is_one_message(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("text.h5").write_text("not a result")
    for name in ("nowhere.h5", "text.h5"):
        assert main([command, name]) == 1
        said = capsys.readouterr().err
        assert name in said and said.startswith("wsnsim: error: ") and said.count("\n") == 1


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("nowhere/x.h5", "--out nowhere/x.h5: folder does not exist: nowhere"),
        ("folder", "--out folder is a folder; give a file such as folder/pso_mhpf.h5"),
        ("file/x.h5", "cannot write file/x.h5: Not a directory"),
        ("/dev/null", "--out /dev/null is a device, not a regular file"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_before_anything_runs(
    out: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("folder").mkdir()
    Path("file").write_text("")
    assert main(["run", "pso_mhpf", "--out", out]) == 2
    assert capsys.readouterr().err == f"wsnsim: error: {message}\n"
    assert sorted(path.name for path in Path().iterdir()) == ["file", "folder"]


def test_a_second_run_into_one_file_is_told_and_a_killed_one_leaves_no_lock(capsys: pytest.CaptureFixture[str]) -> None:
    from wsnsim.recording.atomic_files import sole_writer

    command = ["run", "pso_mhpf", *QUICK, "--replicates", "1", "--out", "x.h5", "--quiet"]
    with sole_writer(Path("x.h5")):
        assert main(command) == 2
        said = "x.h5: another run is writing this file: wait until it has ended, or name another file"
        assert capsys.readouterr().err == f"wsnsim: error: {said}\n"
    assert list(Path().iterdir()) == []
    Path(".x.h5.lock").touch()
    assert main(command) == 0
    assert [path.name for path in Path().iterdir()] == ["x.h5"]


# pictures


@pytest.mark.thorough
def test_plot_draws_all_that_a_result_shows_beside_it_and_says_what_it_lacks(
    result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(result, "mine.h5")
    assert main(["plot", "mine.h5"]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        "mine.png: track, state px, state vx, state py, state vy, error, consistency, energy",
        "  without particles: table particles was not recorded; run the scenario with record.particles=true",
    ]
    assert (said.err, Path("mine.png").read_bytes()[:8]) == ("", b"\x89PNG\r\n\x1a\n")
    assert sorted(path.name for path in Path().iterdir()) == ["mine.h5", "mine.png"]


def test_plot_draws_what_is_asked_for_where_it_is_asked_for(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--what", "states", "--column", "vy", "--replicate", "1", "--target", "0", "--out", "vy.svg"]
    assert main(["plot", str(result), *asked]) == 0
    assert capsys.readouterr().out == "vy.svg: state vy\n"
    assert Path("vy.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--column", "vxx"], 2, "R: no state column 'vxx' (did you mean 'vx'?)"),
        (["--replicate", "2"], 2, "R: table truth has no replicate 2; it has 0, 1"),
        (["--what", "track", "--target", "1"], 2, "R: table truth has no target 1; it has 0"),
        (["--what", "energy", "--column", "px"], 2,
         "--column cannot be combined with --what energy; it can with all, states, particles"),
        (["--out", "x.jpg"], 2, "x.jpg: a figure cannot have the suffix '.jpg' (did you mean '.png'?)"),
        (["--out", "nowhere/x.png"], 2, "--out nowhere/x.png: folder does not exist: nowhere"),
        (["--what", "particles"], 1,
         "R: cannot plot particles: table particles was not recorded; run the scenario with record.particles=true"),
        (["--what", "tracks"], 2, "Invalid value for '--what': 'tracks' is not one of 'all', 'track', 'states', "
         "'gospa', 'error', 'consistency', 'energy', 'particles', 'step' (did you mean 'track'?)"
         " (see 'wsnsim plot --help')"),
    ],
)  # fmt: skip
def test_a_picture_that_cannot_be_is_one_message_and_no_file(
    arguments: list[str], code: int, message: str, result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plot", str(result), "--out", "x.png", *arguments]) == code
    assert capsys.readouterr().err == f"wsnsim: error: {message.replace('R: ', f'{result}: ')}\n"
    assert not list(Path().iterdir())


def test_a_picture_never_takes_the_place_of_its_result(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(result, "x.png")
    assert main(["plot", "x.png"]) == 2
    assert (
        capsys.readouterr().err
        == "wsnsim: error: x.png is the result itself; give another file for the plot with --out\n"
    )
    assert Path("x.png").read_bytes() == result.read_bytes()


# what it refuses


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rnu"], "unknown command 'rnu' (did you mean 'run'?) (see 'wsnsim --help')"),
        (["run"], "Missing argument 'SCENARIO'. (see 'wsnsim run --help')"),
        (["list", "trakers"], "unknown role 'trakers' (did you mean 'trackers'?)"),
        (["list", "datashets"], "unknown role 'datashets' (did you mean 'datasheets'?)"),
        (["run", "--seed", "x", "y"],
         "Invalid value for '--seed': 'x' is not a whole number of at least 0. (see 'wsnsim run --help')"),
    ],
)  # fmt: skip
def test_a_slip_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"wsnsim: error: {message}\n"


def test_a_scenario_that_is_missing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "pso_mhfp"]) == 2
    assert capsys.readouterr().err == (
        "pso_mhfp: error: file not found, and no shipped scenario has this name (did you mean 'pso_mhpf'?)\n"
    )
    assert main(["run", "nosuch.yaml"]) == 2
    assert capsys.readouterr().err.endswith("no shipped scenario has this name (`wsnsim list scenarios` shows all)\n")


COMPARE = ("compare", "field.yaml", "--trackers", "ekf,ukf")


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (["run", "feild.yaml"], "no shipped scenario has this name (did you mean 'field.yaml'?)"),
        (["plot", "compare_feild"], "compare_feild: no such file, did you mean 'compare_field'?"),
        (["compare", "compare_feild"], "compare_feild: error: file not found"),
        ([*COMPARE, "--latex", "field.pdf"], "--latex field.pdf must end in .tex"),
        ([*COMPARE, "--csv", "field.yaml"], "--csv field.yaml must end in .csv"),
        (["run", "pso_mhpf", "--set", "mac=xmac"], "a mapping such as {kind: xmac} or mac.kind=xmac, got the text"),
        (["run", "bearing", "--set", "sensor.sd=2"], "at most 0.5, is 2 rad (degrees have their unit: '2 deg')"),
        (["run", "pso_mhpf", "--set", "deploy={kind: uniform, width: 200,5 m}"], "unknown key, decimals have a point"),
        (["run", "pso_mhpf", "--set", "tracker.kind=mine.py:Mine"], "path; a module is named without .py"),
        (["run", "pso_mhpf", "--set", "tracker.kind=my_good:Ensmble"], "no class Ensmble (did you mean 'Ensemble'?)"),
        (["info", "my_good:Ensmble"], "no class Ensmble (did you mean 'Ensemble'?)"),
        (["run", "pso_mhpf", "--set", "tracker=my_good:Ensemble"], "a mapping such as {kind: my_good:Ensemble} or"),
        (["compare", "field.yaml", "ekf", "ukf"], "with --trackers: wsnsim compare field.yaml --trackers ekf,ukf"),
        (["compare", "field.yaml", "--trackers", "ekf", "ukf"], "wsnsim compare field.yaml --trackers ekf,ukf"),
        (["lifetime", "ekf"], "with --trackers: wsnsim lifetime SCENARIO --trackers ekf"),
        *((words, "tags.csv: error: is a file of data, not a scenario; `wsnsim import` reads such files")
          for words in (["run", "tags.csv"], ["check", "tags.csv"], ["info", "tags.csv"], ["compare", "tags.csv"],
                        ["sweep", "tags.csv"], ["lifetime", "tags.csv"], ["watch", "tags.csv"])),
        *((words, "data: error: is a folder, expected a scenario file, or that of a campaign in sweep, compare")
          for words in (["run", "data"], ["check", "data"], ["info", "data"], ["compare", "data"], ["sweep", "data"],
                        ["lifetime", "data"], ["watch", "data"])),
        *(([*words, "field.yaml"], "field.yaml: is not a wsnsim result: these end in .h5, and `wsnsim run` writes them")
          for words in (["plot"], ["report"], ["verify"], ["trace", "--step", "1"], ["diff", "field.yaml"])),
        (["collect", "field.yaml"], "field.yaml: holds no campaign"),
        (["new", "field"], "field.yaml exists already: choose another name, or remove it"),
        (["new", "80 nodes.yaml"], "then also '_', '-' and '.', such as 80_nodes"),
        (["run", "field.yaml", "-replicates", "3"], "Long options have two dashes: --replicates, --report."),
        (["run", "field.yaml", "--out", "tags.csv"], "--out tags.csv: expected a file with the suffix .h5"),
        (["lifetime", "field.yaml", "--out", "tags.csv"], "--out tags.csv: expected a file with the suffix .json"),
        (["fit", "tags.csv", "--nodes", "tags.csv", "--out", "notes.txt"], "notes.txt: expected a file with"),
        ([*COMPARE, "--timeout", "soon"], "--timeout: expected time (for example '1 s'), got the text 'soon'"),
        (["compare", "compare_field", "--seed", "3"], "compare_field is a campaign, whose sweep is fixed"),
    ],
)  # fmt: skip
def test_a_beginners_mistake_is_one_sentence(
    command: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    texts = {"field.yaml": "extends: jiang_field\n", "tags.csv": "time,node,reading\n0,1,2\n", "notes.txt": "mine\n",
             "my_good.py": "class Ensemble: pass\n", "compare_field/campaign.json": "{}", "data/x": "x"}  # fmt: skip
    for name, text in texts.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    assert main(command) in (1, 2)
    assert sentence in capsys.readouterr().err
    assert {name: Path(name).read_text() for name in texts} == texts


def test_the_help_of_a_command_is_shown_to_those_who_ask_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["help", "run"], ["run", "--help"]):
        assert main(words) == 0
    said = capsys.readouterr().out
    assert said[: len(said) // 2] == said[len(said) // 2 :] and said.startswith("Usage: wsnsim run")


@pytest.mark.parametrize("command", sorted(every_command()))
def test_every_option_that_takes_a_number_refuses_a_word_in_plain_words(command: str, capsys: Any) -> None:
    for option in every_command()[command].params:
        if isinstance(option.type, click.types._NumberParamTypeBase) and isinstance(option, click.Option):
            assert main([command, f"{option.opts[0]}=twenty"]) == 2
            number = "whole number" if isinstance(option.type, click.types.IntParamType) else "number"
            said = capsys.readouterr().err
            assert f"'twenty' is not a {number}" in said and said.endswith(f". (see 'wsnsim {command} --help')\n")


def test_an_unexpected_error_is_one_line_and_its_traceback_is_for_those_who_ask(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(*arguments: Any) -> None:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("wsnsim.cli.running.loaded", breaks)
    assert main(["run", "x"]) == 1
    assert capsys.readouterr().err == (
        "wsnsim: internal error: RuntimeError: two lines (set WSNSIM_TRACEBACK=1 for the traceback)\n"
    )
    monkeypatch.setenv("WSNSIM_TRACEBACK", "1")
    assert main(["run", "x"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.thorough
def test_nobody_reading_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-m", "wsnsim", "list"], stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.thorough
def test_a_terminal_without_the_letters_still_gets_its_answer() -> None:
    Path("α.yaml").write_text("extends: pso_mhpf")
    assert run_process(Path(), "check", "α.yaml", PYTHONIOENCODING="latin-1") == (0, "?.yaml: ok\n", "")


def with_ctrl_c() -> None:
    """Restore the handling of signals that background processes of a script, or those under nohup, ignore."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "code", "message"),
    [
        (signal.SIGINT, 130, "wsnsim: error: interrupted"),
        pytest.param(signal.SIGTERM, 143, "wsnsim: error: stopped by SIGTERM", marks=pytest.mark.thorough),
        (signal.SIGHUP, 129, "wsnsim: error: stopped by SIGHUP"),
    ],
)
def test_a_run_that_is_stopped_leaves_nothing_half_written(
    number: signal.Signals, code: int, message: str, result: Path
) -> None:
    arguments = ["run", "pso_mhpf", "--set", "duration=400 s", "--out", "x.h5", "--progress", "json"]
    command = [sys.executable, "-m", "wsnsim", *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=with_ctrl_c
    )
    assert process.stderr is not None
    first = json.loads(process.stderr.readline())
    assert (first["replicate"], first["duration"]) == (0, 400.0)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == code
    assert err.splitlines()[-1] == message
    assert (out, "Traceback" in err) == ("", False)
    assert not list(Path().iterdir())


# progress


def report(replicate: int, time: float, wall: float) -> Progress:
    return Progress(replicate=replicate, replicates=2, time=time, duration=10.0, wall=wall)


def test_plain_progress_is_a_line_every_tenth_or_half_minute(capsys: pytest.CaptureFixture[str]) -> None:
    lines = display("plain", RUN)
    for replicate, time, wall in [(0, 0.5, 1.0), (0, 2.0, 2.0), (0, 3.0, 3.0), (0, 3.1, 40.0), (1, 10.0, 50.0)]:
        lines.step(report(replicate, time, wall))
    lines.close()
    assert capsys.readouterr().err.splitlines() == [
        "wsnsim: 10 % (run 1 of 2, 2 of 10 s, 1 × real time, about 18 s left)",
        "wsnsim: 16 % (run 1 of 2, 3.1 of 10 s, 0.0775 × real time, about 4 min left)",
        "wsnsim: 100 % (run 2 of 2, 10 of 10 s, 0.4 × real time, about 0 s left)",
    ]


def test_json_progress_is_one_object_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    lines = display("json", RUN)
    lines.step(report(1, 5.0, 3.0))
    assert json.loads(capsys.readouterr().err) == {
        "replicate": 1, "replicates": 2, "time": 5.0, "duration": 10.0, "wall": 3.0, "left": 1.0, "share": 0.75,
    }  # fmt: skip


def test_the_bar_shows_simulated_time_and_speed(capsys: pytest.CaptureFixture[str]) -> None:
    bar = display("bar", RUN)
    bar.step(report(0, 5.0, 2.0))
    bar.step(report(1, 10.0, 4.0))
    bar.close()
    drawn = capsys.readouterr().err
    assert "20.0/20.0 s simulated" in drawn
    assert ", 5 × real time, about 0 s left]" in drawn


def test_what_was_compiled_is_no_part_of_the_speed_and_of_the_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    for mode in ("plain", "bar"):
        shown = display(mode, RUN)
        shown.step(replace(report(0, 2.0, 34.0), overhead=30.0))
        shown.close()
        assert "0.5 × real time, about 36 s left" in capsys.readouterr().err


def test_without_progress_nothing_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    nothing = display("none", RUN)
    nothing.step(report(0, 5.0, 2.0))
    nothing.close()
    assert capsys.readouterr() == ("", "")
    assert MODES[0] == "auto"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_an_answer_that_cannot_be_written_is_an_error_in_words() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-m", "wsnsim", "list"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "wsnsim: error: No space left on device\n"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the working directory cannot be deleted")
def test_a_working_directory_that_was_deleted_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    script = 'rmdir "$PWD"; exec "$0" -m wsnsim list trackers'
    done = subprocess.run(["sh", "-c", script, sys.executable], capture_output=True, text=True, cwd=tmp_path / "gone")
    assert "Traceback" not in done.stderr
    assert (done.returncode, "pso_mhpf" in done.stdout) == (0, True), done.stderr
