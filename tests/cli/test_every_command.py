"""Every command of `wsnsim --help`, with its defaults on something small, as a process in the shell of a user."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Final

import pytest

from tests.helpers.commands import run_process
from tests.recording.test_recovery import killed_run
from wsnsim.cli.shared import every_command

SMALL: Final = "{extends: pso_mhpf, name: small, duration: 0.4 s, tracker: {particles: 40}}"
WALK: Final = """\
$node_(0) set X_ 10.0
$node_(0) set Y_ 40.0
$ns_ at 1.0 "$node_(0) setdest 90.0 40.0 4.0"
"""
RECORDED: Final = Path("scenarios/recorded/ble").resolve()
VARIED: Final = "sweep small.yaml --vary tracker.particles=20,40 --replicates 2"
LINES: Final[dict[str, tuple[list[str], str]]] = {
    "check": (["check small.yaml"], "small.yaml: ok"),
    "collect": (
        [f"{VARIED} --shard {n}/2 --out part{n}" for n in (1, 2)] + ["collect part1 part2"],
        "2 points, 2 runs each",
    ),
    "compare": (["compare small.yaml --trackers pso_mhpf,ekf --replicates 2"], "ekf"),
    "diff": (["diff results/small.h5 results/small.h5"], "equal"),
    "export": (["export results/small.h5 --csv tables"], "tables/runs.csv"),
    "fit": ([f"fit {RECORDED}/straight_01.csv.gz --nodes {RECORDED}/receivers.csv"], "exponent"),
    "import": (["import ns3 walk.tcl --id 0"], "walk_ns3.csv"),
    "info": (["info pso_mhpf", "info reach", "info small.yaml", "info results/small.h5"], "small"),
    "lifetime": (["lifetime --help"], "how long a network lives"),
    "list": (["list", "list scenarios", "list sweeps", "list datasheets"], "cc2420"),
    "new": (["new mine"], "mine.yaml"),
    "plot": (["plot results/small.h5"], "small.png"),
    "recover": (["recover killed/run.host.1.tmp"], "run.h5"),
    "report": (["report results/small.h5"], "small.html"),
    "reproduce": (["reproduce --help"], "jiang2013"),
    "run": (["run small.yaml"], "results/small.h5"),
    "schema": (["schema"], '"tracker"'),
    "sweep": ([VARIED], "2 points, 2 runs each"),
    "trace": (["trace results/small.h5 --step 5"], "step 5"),
    "verify": (["verify results/small.h5"], "small"),
    "watch": (["watch small.yaml --no-browser --exit"], "http://"),
}
"""{command: (command lines, what the last one prints or writes)}. `reproduce` is run in tests/papers/test_quick.py."""


def test_no_command_is_without_a_test() -> None:
    assert list(LINES) == sorted(every_command())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small scenario, its result, the file of a killed run, and a trace."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.yaml").write_text(SMALL)
    (folder / "walk.tcl").write_text(WALK)
    (folder / "killed").mkdir()
    killed_run(folder / "killed", 0.0).rename(folder / "killed" / "run.host.1.tmp")
    assert run_process(folder, "run", "small.yaml").code == 0
    return folder


@pytest.mark.thorough
@pytest.mark.parametrize("command", LINES)
def test_a_command_does_as_its_help_says(command: str, made: Path, fresh_folder: Path) -> None:
    shutil.copytree(made, fresh_folder, dirs_exist_ok=True)
    lines, expected = LINES[command]
    for line in lines:
        answer = run_process(fresh_folder, *line.split())
        assert answer.code == 0, answer.err
        assert not re.search("Traceback|internal error|Warning", answer.err), answer.err
    assert expected in answer.out + answer.err
