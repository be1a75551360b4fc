"""`wsnsim reproduce --quick` of every paper and study, as a process in the shell of a user."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.helpers.commands import run_process
from tests.papers import few_runs
from wsnsim.papers import measures, reproduce, table
from wsnsim.papers.measures import Data
from wsnsim.papers.study import PAGES, PAPERS

WHOLE = ("liu2012",)
"""Papers whose quick reproduction takes less than half a minute of processor time. Others have one run of a variant."""

LARGE = ("frontier", "duty_cycles")
"""Studies of hundreds of variants. Tests of their own run a few variants of every experiment."""

MATPLOTLIB = ("matplotlib._fontconfig_pattern", "matplotlib._mathtext", "pyparsing.util")
"""Modules that warn of deprecation where matplotlib before 3.11 meets pyparsing 3.3."""
WARNINGS = ",".join(["error", *(f"ignore::DeprecationWarning:{name}" for name in MATPLOTLIB)])
reproduced = Data._table


def without_estimates(self: Data, name: str) -> pd.DataFrame:
    """A table of a campaign in which no run has an estimate and nothing that follows from one."""
    frame = reproduced(self, name)
    if name in ("estimates", "tracks", "runs"):
        kept = {"time", "cycles", "energy", "cpu_seconds", "lost", "losses"}
        unknown = [column for column in frame.select_dtypes("float").columns if column not in kept]
        frame = frame.assign(**dict.fromkeys(unknown, np.nan))
    return frame


@pytest.mark.thorough
@pytest.mark.parametrize("page", [page for page in PAGES if page not in LARGE])
def test_a_page_is_reproduced_and_what_no_run_has_is_unknown(page, fresh_folder, monkeypatch):
    program = ["-m", "wsnsim"] if page in WHOLE else [few_runs.__file__]
    words = ["reproduce", page, "--quick", "--figures", "figures", *([] if page in WHOLE else ["--jobs", "1"])]
    ended = run_process(fresh_folder, *words, program=program, PYTHONWARNINGS=WARNINGS)
    assert ended.code == 0, ended.err
    assert not re.search("Traceback|internal error|Warning", ended.err)
    assert f"of {page}: " in ended.err and not re.search(r"\bnan\b", ended.out)
    figures = [figure for experiment in reproduce.experiments(page) for figure in experiment.figures]
    assert {path.name for path in Path("figures").iterdir()} == {f"{page}_{figure.name}.png" for figure in figures}
    monkeypatch.setattr(Data, "_table", without_estimates)
    monkeypatch.setattr(measures, "TRUTHS", few_runs.TRUTHS)
    for experiment in reproduce.experiments(page):
        folder = reproduce.folder_of(Path("results/reproduce/quick"), page, experiment)
        said = [table.text(reproduce.rows(page, experiment, folder)), *reproduce.summary(page, experiment, folder)]
        assert not re.search(r"\bnan\b", "\n".join(said))
        reproduce.draw(page, experiment, folder, Path("unknown"))


@pytest.mark.thorough
def test_without_a_name_all_papers_are_reproduced_and_the_first_line_says_so(fresh_folder):
    """The command is stopped there: what follows is what the tests above run."""
    command = [sys.executable, "-m", "wsnsim", "reproduce"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        first = process.stderr.readline()
        process.terminate()
    assert first.startswith("wsnsim: ") and f" of {', '.join(PAPERS)}: " in first
    assert first.endswith("; folder results/reproduce/quick\n")
