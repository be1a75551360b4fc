"""`wsnsim new NAME`: a scenario to start from; with --for ROLE a plug-in that passes its check, and its scenario."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from wsnsim import read
from wsnsim.cli import main
from wsnsim.cli.commands import PLUGIN_ROLES, class_name
from wsnsim.papers.study import study
from wsnsim.scenario import load, resolved
from wsnsim.scenario.kind_info import kind_info
from wsnsim.scenario.tracker_choices import tracker_choices

pytestmark = pytest.mark.usefixtures("fresh_folder")


@pytest.mark.thorough
@pytest.mark.parametrize("role", PLUGIN_ROLES)
def test_a_new_plug_in_passes_its_check_and_runs(role: str, capsys: pytest.CaptureFixture[str]) -> None:
    name = f"my_own_{role}"
    assert main(["new", "--for", role, name]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{name}.py and {name}.yaml: written",
        f"check its rules:  python {name}.py",
        f"run it:           wsnsim run {name}.yaml",
    ]
    text = Path(f"{name}.py").read_text()
    assert f"class MyOwn{role.capitalize()}" in text and "plugin_name" not in text and "Plugin" not in text
    runpy.run_path(f"{name}.py", run_name="__main__")
    assert f"{name}: keeps the rules of a" in capsys.readouterr().out
    short = ["--set", "duration=0.4 s"] if role != "mac" else ["--set", "duration=1 s", "--set", "deploy.nodes=60"]
    if role == "tracker":  # `check` imports plug-ins in a process of its own, which takes its time
        assert main(["check", f"{name}.yaml"]) == 0
    assert main(["run", f"{name}.yaml", "-q", "--out", "x.h5", *short]) == 0
    runs = read("x.h5", "runs")
    assert (runs.status == "complete").all()
    if role == "mac":
        assert 0 < runs.delivered[0] < runs.in_range[0]
    else:
        assert runs.rmse[0] < 10.0
    sys.modules.pop(name, None)


@pytest.mark.parametrize("role", PLUGIN_ROLES)
def test_a_new_plug_in_is_described_in_full(role: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path.cwd())
    assert main(["new", "--for", role, f"told_{role}"]) == 0
    found = kind_info(role, f"told_{role}:{class_name(f'told_{role}')}")
    assert found.parameters and all(one.meaning for one in found.parameters)
    assert len(found.method[0]) > 20
    sys.modules.pop(f"told_{role}", None)


def test_a_new_tracker_names_itself_for_a_comparison() -> None:
    assert main(["new", "--for", "tracker", "near_it"]) == 0
    line = next(line for line in Path("near_it.yaml").read_text().splitlines() if "wsnsim compare" in line)
    words = line.partition("wsnsim ")[2].split()
    assert [one.name for one in tracker_choices(words[words.index("--trackers") + 1])] == [
        "near_it:NearIt",
        "ekf",
        "pf",
    ]
    assert words[:2] == ["compare", "near_it.yaml"]


def test_a_new_study_is_without_faults_and_its_files_are_not_overwritten(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "--for", "study", "my-study"]) == 0
    said = ["my-study/study.yaml and my-study/study.py: written", "run it: wsnsim reproduce my-study"]
    assert capsys.readouterr().out.splitlines() == said
    (experiment,) = study("my-study").experiments
    assert experiment.hypotheses and experiment.claims and experiment.figures
    assert study("my-study").source == "my-study" and "plugin_name" not in Path("my-study/study.py").read_text()
    Path("my-study/study.py").unlink()
    assert main(["new", "--for", "study", "my-study"]) == 2
    assert capsys.readouterr().err == "wsnsim: error: my-study exists already: choose another name, or remove it\n"
    assert not Path("my-study/study.py").exists()


@pytest.mark.thorough
def test_a_new_study_runs_and_answers_its_hypotheses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "--for", "study", "answers"]) == 0
    assert main(["reproduce", "answers", "--quiet", "--figures", "figures"]) == 0
    said = capsys.readouterr().out
    assert said.count("registered the ") == 2 and Path("figures/answers_errors.png").stat().st_size > 10_000


def test_nothing_is_overwritten_and_nothing_is_half_written(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine_here.yaml").write_text("mine")
    assert main(["new", "--for", "motion", "mine_here"]) == 2
    assert (
        capsys.readouterr().err == "wsnsim: error: mine_here.yaml exists already: choose another name, or remove it\n"
    )
    assert not Path("mine_here.py").exists() and Path("mine_here.yaml").read_text() == "mine"
    Path("mine_here.yaml").rename("mine_here.py")
    assert main(["new", "--for", "motion", "mine_here"]) == 2
    assert not Path("mine_here.yaml").exists() and Path("mine_here.py").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--for", "sensor", "json"], "'json' is the name of an installed module"),
        (["--for", "sensor", "class"], "'class' cannot name a module of Python"),
        (["--for", "sensor", "my-sensor"], "'my-sensor' cannot name a module of Python"),
        (["--for", "sensor", "../up"], "'../up' cannot name a file"),
        (["--for", "sensor", "--bench", "mine"], "--bench cannot be combined with --for"),
        (["--for", "sensr", "mine"], "Invalid value for '--for'"),
        (["--for", "study", "frontier"], "'frontier' is the name of a study that comes with wsnsim"),
        (["--for", "study", "../up"], "'../up' cannot name a file"),
        (["--for", "study", "--bench", "mine"], "--bench cannot be combined with --for"),
    ],
)
def test_what_cannot_be_written_says_so(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", *words]) == 2
    assert capsys.readouterr().err.startswith(f"wsnsim: error: {message}")
    assert not list(Path().iterdir())


def test_the_name_of_the_class_follows_from_that_of_the_file() -> None:
    assert [class_name(name) for name in ("near", "my_own_mac", "_2nd")] == ["Near", "MyOwnMac", "Plugin2nd"]


def test_a_new_scenario_is_what_a_newcomer_wants_and_follows_its_target(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "field"]) == 0
    assert capsys.readouterr().out == "field.yaml: written; run it with: wsnsim run field.yaml\n"
    made = resolved(load("field.yaml"))
    assert made["deploy"]["nodes"] == 60 and made["energy"]["radio"]["name"] == "CC2420"
    assert [made[role]["kind"] for role in ("sensor", "tracker", "mac")] == ["range", "ekf", "csma"]
    assert main(["run", "field.yaml", "-q", "--set", "duration=10 s"]) == 0
    runs = read("results/field.h5", "runs")
    assert runs.rmse[0] < 3.0 and runs.tracked[0] > 0.9 and not runs.losses[0]
    told = Path("field.yaml").read_text()
    assert told.count("# CHANGE: ") == 5 and max(map(len, told.splitlines())) <= 100
    Path("field.yaml").write_text("mine")
    assert main(["new", "field"]) == 2 and Path("field.yaml").read_text() == "mine"
    assert "field.yaml exists already" in capsys.readouterr().err


@pytest.mark.parametrize("source", ["li_xmac", "two_targets", "ungm_pf", "beacons"])
def test_a_scenario_like_another_one_runs_as_that_one_until_a_line_is_changed(source: str) -> None:
    assert main(["new", "mine", "--like", source]) == 0
    like, whole = (resolved(load(name)) for name in ("mine.yaml", source))
    assert like == {**whole, "name": "mine"}
    lines = Path("mine.yaml").read_text().splitlines()
    every = [line.removeprefix("# ") for line in lines[1:] if line and not line.startswith("extends: ")]
    Path("taken.yaml").write_text("\n".join(every))
    assert resolved(load("taken.yaml")) == like, "every line that may be changed stands for itself"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--like", "li_xmacc"], "did you mean 'li_xmac'?"),
        (["--like", "li_xmac", "--bench"], "--bench cannot be combined with --like"),
        (["--like", "li_xmac", "--for", "mac"], "--like cannot be combined with --for"),
    ],
)
def test_what_cannot_be_copied_writes_nothing(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "mine", *words]) == 2
    assert message in capsys.readouterr().err and not list(Path().iterdir())
