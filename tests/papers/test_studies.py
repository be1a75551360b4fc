"""A study in a folder: what is found, what is refused, what its Python gives, and how its hypotheses are answered."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim.base.errors import ScenarioError, UsageError
from wsnsim.cli import main
from wsnsim.papers import reproduce
from wsnsim.papers.rows import answered
from wsnsim.papers.study import study
from wsnsim.papers.study_file import RegisteredHypothesis
from wsnsim.papers.toolkit import ALLOWED
from wsnsim.scenario.texts import shipped_studies

TEXT = """
source: Mine
experiments:
  - name: few
    title: two filters without a network
    variants: {pf: ungm_pf, more: [ungm_pf, tracker.particles=200]}
    runs: {quick: 5, full: 6}
    sets: [duration=4 s]
    hypotheses:
      - {says: more is better, of: more, measure: "over:pf; median:rmse", below: 10}
    claims:
      - {of: all, id: own, quantity: steps, measure: "mean:own"}
"""
CODE = "MEASURES = {'own': lambda data, variant: data.of_runs(variant, 'steps')}\n"


@pytest.fixture
def mine(fresh_folder):
    """The folder `mine` with a study that runs, in the working directory."""
    folder = Path("mine")
    folder.mkdir()
    (folder / "study.yaml").write_text(TEXT)
    (folder / "study.py").write_text(CODE)
    yield folder
    study.cache_clear()
    for name in [name for name in sys.modules if name.startswith("wsnsim_study_") and _is_in(name, folder)]:
        del sys.modules[name]


def _is_in(name, folder):
    path = next(iter(getattr(sys.modules[name.partition(".")[0]], "__path__", [])), "")
    return Path(path) == folder.resolve()


def changed(folder, before, after):
    text = (folder / "study.yaml").read_text()
    assert before in text
    (folder / "study.yaml").write_text(text.replace(before, after, 1))


def test_a_folder_is_run_resumed_and_answered(mine, monkeypatch, capsys):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    assert main(["reproduce", "mine/", "--progress", "none"]) == 0
    said = capsys.readouterr()
    assert "wsnsim: 1 experiment of mine: 10 runs; folder results/reproduce/quick\n" in said.err
    assert "registered more is better: yes, " in said.out and said.out.count(": steps: ") == 2
    files = {path: path.stat().st_mtime_ns for path in Path("results").rglob("*.h5")}
    assert main(["reproduce", "mine/study.yaml", "--progress", "none", "--markdown"]) == 0
    said = capsys.readouterr()
    assert "10 runs, 10 of them on disk" in said.err and "| pf: steps | - | 3 [3, 3] | not published |" in said.out
    assert {path: path.stat().st_mtime_ns for path in Path("results").rglob("*.h5")} == files


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_a_study_is_registered_if_its_files_were_committed_before_its_runs(mine):
    def said():
        return reproduce.registrations([("mine", SimpleNamespace(name="few"))], Path("results"))

    def commit():
        who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
        for words in (["init", "-q"], ["add", "mine"], [*who, "commit", "-q", "-m", "registered"]):
            subprocess.run(["git", *words], check=True)

    assert said() == ["mine is not registered: its files are not committed as they are"]
    commit()
    result = Path("results/mine/few/point/r00000-00004.h5")
    result.parent.mkdir(parents=True)
    for _ in range(2):
        assert re.fullmatch("mine is registered: commit [0-9a-f]{12}, before its runs", *said())
        result.touch()
    os.utime(result, (1e9, 1e9))
    assert re.fullmatch("mine is not registered: commit [0-9a-f]{12} is later than runs", *said())
    (mine / "study.py").write_text("")
    assert said() == ["mine is not registered: its files are not committed as they are"]


def test_a_changed_measure_is_measured_again(mine, monkeypatch):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    (experiment,) = study("mine").experiments
    assert reproduce.resume(reproduce.begin("mine", experiment, Path("out")), 1).complete
    folder = reproduce.folder_of(Path("out"), "mine", experiment)
    assert {row.measured for row in reproduce.evaluated("mine", experiment, folder)[0]} == {3.0}
    (mine / "study.py").write_text(CODE.replace("'steps')", "'steps') + 1.0"))
    study.cache_clear()
    for name in [name for name in sys.modules if name.startswith("wsnsim_study_") and _is_in(name, mine)]:
        del sys.modules[name]
    assert {row.measured for row in reproduce.evaluated("mine", experiment, folder)[0]} == {4.0}


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("below: 10", "above: 1, below: 10", r"hypotheses.0: needs one of 'above' and 'below'"),
        (", below: 10", "", r"hypotheses.0: needs one of 'above' and 'below'"),
        ("below: 10", "belw: 10", r"hypotheses.0.belw: unknown key, did you mean 'below'"),
        ("of: more,", "of: mor,", r"hypotheses.0: no variant is 'mor' .did you mean 'more'"),
        ("over:pf;", "over:fp;", r"hypotheses.0.measure: over: unknown name 'fp' .known: more, pf"),
        ("median:rmse", "median:rms", r"hypotheses.0.measure: median: unknown name 'rms' .did you mean 'rmse'"),
        ("name: few", "name: ../few", r"name: '../few' cannot name a folder"),
        ("    claims:", "    figures: [{name: ../x, caption: x}]\n    claims:", r"figures: '../x' cannot name a file"),
        (
            "    variants: {pf: ungm_pf, more: [ungm_pf, tracker.particles=200]}\n",
            "",
            r"name: has no variants, neither",
        ),
        ("[ungm_pf, tracker.particles=200]", "[]", r"variants.more: names no scenario"),
        (TEXT[TEXT.index("  - name") :], "  []\n", r"experiments: a study needs an experiment"),
    ],
)
def test_what_is_wrong_with_a_study_is_said_with_its_place(mine, before, after, words):
    changed(mine, before, after)
    with pytest.raises(ScenarioError, match=r"(?s)^mine/study.yaml:\d+:\d+: error: .*" + words):
        study("mine").experiments  # noqa: B018


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("MEASURES = [1]", r"mine/study.py: MEASURES must be a mapping from names to functions"),
        ("import nowhere_to_be_found", r"mine/study.py:1: ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("\ndef (", r"mine/study.py:2: SyntaxError"),
        ("from .other import x", r"mine/study.py:1: ModuleNotFoundError"),
        ("raise SystemExit(3)", r"mine/study.py:1: SystemExit: 3"),
    ],
)
def test_what_is_wrong_with_its_python_is_said_with_its_line(mine, code, words):
    (mine / "study.py").write_text(code)
    with pytest.raises(UsageError, match=words):
        study("mine").experiments  # noqa: B018


def test_variants_and_claims_may_come_from_its_python_and_are_checked_like_the_others(mine):
    changed(mine, "    variants: {pf: ungm_pf, more: [ungm_pf, tracker.particles=200]}\n", "")
    code = "from .other import made\nEXPERIMENTS = {'few': lambda study, folder: made(study.source)}\n"
    other = "def made(name):\n    return {'variants': {'pf': 'ungm_pf', 'more': 'ungm_grid'}, 'claims': [%s]}\n"
    (mine / "study.py").write_text(code)
    (mine / "other.py").write_text(other % "{'of': 'pf', 'quantity': 'x', 'measure': 'rmse'}")
    (experiment,) = study("mine").experiments
    assert list(experiment.variants) == ["pf", "more"] and experiment.claims[0].measure == "rmse"
    study.cache_clear()
    study("mine").code.module("study").made = lambda name: {"variants": {"pf": 3}}
    with pytest.raises(ScenarioError, match=r"study.yaml:4:\d+: .*EXPERIMENTS\['few'\] gives is wrong: variants.pf"):
        study("mine").experiments  # noqa: B018


def test_what_is_no_study_is_refused(mine):
    with pytest.raises(UsageError, match=r"no paper or study 'fronteer' .did you mean 'frontier'.*nor a folder"):
        study("fronteer")
    with pytest.raises(UsageError, match=r"has no study.yaml; `wsnsim new --for study NAME` writes"):
        study(".")
    mine.rename("frontier")
    assert study("frontier").folder == shipped_studies()["frontier"]
    with pytest.raises(UsageError, match="'frontier' is the name of a study that comes with wsnsim"):
        study("./frontier")
    Path("frontier").rename("mine")
    with pytest.raises(UsageError, match=r"^mine and ./mine have the same name"):
        reproduce.chosen(["mine", "./mine"])
    with pytest.raises(UsageError, match="mine takes no data"):
        study("mine", Path())


def test_a_figure_of_a_paper_is_chosen_by_its_name():
    ((_, chosen),) = reproduce.chosen(["jiang2013"], "figure_9")
    assert chosen.name == "figures_4_to_9"


@pytest.mark.parametrize(
    ("threshold", "answer"),
    [({"above": 1.5}, "yes"), ({"above": 2.5}, "no"), ({"above": 2.0}, "undecided"), ({"below": 2.5}, "yes"),
     ({"below": 1.5}, "no")],
)  # fmt: skip
def test_a_hypothesis_is_answered_by_the_interval_of_its_measure(threshold, answer):
    errors = 2.0 + 0.1 * np.linspace(-1.0, 1.0, 20)
    data = TablesOfRuns({"pf": pd.DataFrame({"replicate": range(21), "rmse": [*errors, np.nan]})})
    data.own = {}
    found = answered(RegisteredHypothesis(says="so it is", of="pf", measure="mean:rmse", **threshold), data)
    assert str(found).startswith(f"so it is: {answer}, 2.00 [1.9")
    nothing = SimpleNamespace(of=lambda *_: pd.DataFrame({"replicate": [], "rmse": []}), own={})
    found = answered(RegisteredHypothesis(says="so it is", of="pf", measure="mean:rmse", **threshold), nothing)
    assert str(found) == "so it is: undecided, unknown"


def test_our_studies_import_what_a_study_may_import():
    libraries = {"numpy", "pandas", "matplotlib", "scipy"}
    files = [file for folder in shipped_studies().values() for file in folder.glob("*.py")]
    assert len(files) >= 8
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in names:
                top = name.partition(".")[0]
                assert (
                    top in libraries | sys.stdlib_module_names or name in ALLOWED or name.startswith("wsnsim.fitting.")
                )
