"""Standard streams that are full, gone or closed: a command does its work, and only a lost answer is an error."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.helpers.full_disk import FullDisk
from wsnsim.base.files import CacheWarning
from wsnsim.campaign import engines
from wsnsim.cli import main
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, MODES, RUN, WORK, display
from wsnsim.experiment import Progress

TINY = ("ungm_pf", "--set", "duration=3 s", "--set", "tracker.particles=40")
SWEEP = """{name: s, scenario: ungm_pf, set: {duration: 2 s}, grid: {tracker.particles: [30, 40]}, replicates: 2}"""


def closed() -> io.StringIO:
    """A stream that was closed."""
    stream = io.StringIO()
    stream.close()
    return stream


@pytest.fixture(autouse=True)
def _alone(fresh_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", os.environ.copy())
    monkeypatch.setattr(engines, "LocalEngine", InlineEngine)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("make", [FullDisk, closed])
def test_no_display_of_progress_fails(make: Any, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", make())
    monkeypatch.setattr("wsnsim.cli.progress._is_terminal", lambda: True)
    for shown in (display(mode, RUN), display(mode, RUN)):
        shown.step(Progress(replicate=0, replicates=2, time=1.0, duration=2.0, wall=1.0))
        shown.step(Progress(replicate=1, replicates=2, time=2.0, duration=2.0, wall=1.0))
        shown.close()
    assert all(form.bar for form in (CAMPAIGN, WORK))


@pytest.mark.thorough(fast=["arguments2"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["run", *TINY, "--progress", "json", "-o", "x.h5"],
        ["run", *TINY, "--progress", "bar", "-o", "x.h5"],
        ["sweep", "s.yaml", "-j", "2", "--progress", "plain"],
    ],
)
def test_a_command_ends_well_although_nothing_can_be_printed_on_stderr(
    arguments: Sequence[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("s.yaml").write_text(SWEEP)
    monkeypatch.setattr(sys, "stderr", stderr := FullDisk())
    monkeypatch.setattr("wsnsim.cli.end_stderr", lambda: None)  # it would close the stderr of these tests
    assert main(list(arguments)) == 0
    assert capsys.readouterr().out
    assert sys.stderr is stderr


def test_an_error_that_cannot_be_printed_keeps_its_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", FullDisk())
    assert main(["run", "no such scenario"]) == 2


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
@pytest.mark.parametrize(
    ("streams", "arguments"),
    [
        ("<&- >&- 2>&-", ["run", *TINY, "-o", "x.h5"]),
        ("2>/dev/full", ["sweep", "s.yaml", "-j", "2", "-o", "c", "--progress", "json"]),
    ],
)
def test_results_are_whole_with_streams_that_are_closed_or_full(streams: str, arguments: Sequence[str]) -> None:
    """A file that is opened must not get the number of a closed stream: libraries would print into it."""
    if "/dev/full" in streams and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    Path("s.yaml").write_text(SWEEP)
    command = ["sh", "-c", f'exec "$0" -m wsnsim "$@" {streams}', sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert bool(done.stdout) == (">&-" not in streams)
    assert main(["info", arguments[-1] if arguments[0] == "run" else "c"]) == 0
    assert not list(Path().rglob("*.tmp"))


def test_a_note_on_caches_is_a_line_on_stderr_and_not_with_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*arguments: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("kernels are kept in /x", CacheWarning, stacklevel=1)
        raise click.ClickException("enough")

    monkeypatch.setattr("wsnsim.cli.running.loaded", said)
    main(["run", "x"])
    assert "wsnsim: kernels are kept in /x\n" in capsys.readouterr().err
    for silent in (["--quiet"], ["--progress", "json"], ["--progress", "none"]):
        main(["run", "x", *silent])
        assert "kernels" not in capsys.readouterr().err


# a terminal that hangs up


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")
@pytest.mark.parametrize(("before", "handled"), [(signal.SIG_DFL, True), (signal.SIG_IGN, False)])
def test_hanging_up_ends_a_command_unless_it_was_started_with_nohup(before: Any, handled: bool) -> None:
    former = signal.signal(signal.SIGHUP, before)
    interrupts = Interrupts()
    try:
        with interrupts.raising():
            if handled:
                with pytest.raises(KeyboardInterrupt):
                    os.kill(os.getpid(), signal.SIGHUP)
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            else:
                os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == before
    finally:
        signal.signal(signal.SIGHUP, former)
    assert interrupts.number == (signal.SIGHUP if handled else 0)
    assert not handled or (interrupts.code, interrupts.reason) == (129, "stopped by SIGHUP")
