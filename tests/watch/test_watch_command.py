"""The command: the result of `run`, an address, and an end by itself or by Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from wsnsim.analysis.difference import differ
from wsnsim.cli import main, running

QUICK = ["--set", "duration=0.4 s", "--set", "tracker.particles=40", "--no-browser"]
FOLDERS = ("alone", "watched")
CACHE = "consolidated"
"""The folder of rows that were read from many files: whether it is written depends on when they are read."""
ENDLESS = ["--set", "duration=1 h", "--no-browser", "--quiet"]


@pytest.fixture(autouse=True)
def _alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


@pytest.fixture
def interrupted(monkeypatch):
    """Sends this process a signal when something holds after the address was printed; gives the address."""
    said, addresses = running.say_where, []

    def when(number, holds):
        def send():
            while not holds():
                time.sleep(0.01)
            os.kill(os.getpid(), number)

        def say(url, options):
            said(url, options)
            addresses.append(url)
            threading.Thread(target=send, daemon=True).start()

        monkeypatch.setattr(running, "say_where", say)
        return addresses

    return when


def state_of(ask, addresses):
    """What a campaign's page is told."""
    return json.loads(ask(addresses[0], "state")[2])


@pytest.mark.thorough
def test_watch_and_run_write_the_same_result_and_print_the_same_summary(capsys, tmp_path):
    assert main(["run", "pso_mhpf", *QUICK[:-1], "-o", "a.h5"]) == 0
    told = capsys.readouterr().out
    assert main(["watch", "pso_mhpf", *QUICK, "--exit", "-o", "b.h5"]) == 0
    seen = capsys.readouterr()
    assert "wsnsim: watch at http://127.0.0.1:" in seen.err
    assert [line for line in seen.out.splitlines() if "took" not in line] == [
        line.replace("a.h5", "b.h5") for line in told.splitlines() if "took" not in line
    ]
    assert differ(tmp_path / "a.h5", tmp_path / "b.h5").same


@pytest.mark.thorough
def test_ctrl_c_during_the_run_ends_it_as_usual_and_closes_the_server(interrupted, capsys, tmp_path, ask):
    addresses = interrupted(signal.SIGINT, lambda: any(tmp_path.glob("*.tmp")))
    assert main(["watch", "pso_mhpf", *ENDLESS, "-o", "x.h5"]) == 130
    assert "wsnsim: error: interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


@pytest.mark.thorough(fast=["15-143"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_after_the_run_the_result_is_shown_until_a_signal_comes(
    interrupted, monkeypatch, capsys, tmp_path, ask, number, code
):
    monkeypatch.setattr(running, "page_of", lambda result, page, plugins: "the result")
    addresses = interrupted(number, lambda: ask(addresses[0])[2] == b"the result")
    assert main(["run", "pso_mhpf", *QUICK[:-1], "--watch", "-o", "x.h5"]) == code
    assert "the address now shows the result; Ctrl-C ends the server" in capsys.readouterr().err
    assert (tmp_path / "x.h5").exists()
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


SWEEP = ["rkf", "--set", "duration=5 s", "--replicates", "4", "-q", "-j", "1"]
SWEEPS = [["sweep", *SWEEP, "--vary", "tracker.stay=0.9,0.95"], ["compare", *SWEEP, "--trackers", "rkf,ekf"]]


@pytest.mark.thorough
@pytest.mark.parametrize("words", SWEEPS, ids=["sweep", "compare"])
def test_a_campaign_is_shown_while_it_computes_and_has_the_rows_of_any_other(
    interrupted, monkeypatch, capsys, tmp_path, ask, words
):
    """The signal comes when the command has printed its tables and waits: before, it would end the command with 130."""
    waits, stay = threading.Event(), running.stay
    monkeypatch.setattr(running, "stay", lambda interrupts, wait: stay(interrupts, lambda: (waits.set(), wait())))
    assert main([*words, "-o", "alone"]) == 0
    told = capsys.readouterr().out
    addresses = interrupted(
        signal.SIGINT,
        lambda: (lambda now: waits.is_set() and now["complete"] and not now["computes"])(state_of(ask, addresses)),
    )
    assert main([*words, "-o", "watched", "--watch"]) == 0
    seen = capsys.readouterr()
    assert seen.out.replace("watched", "alone") == told and "wsnsim: watch at http://127.0.0.1:" in seen.err
    found = ([p.relative_to(tmp_path / name) for p in (tmp_path / name).rglob("*")] for name in FOLDERS)
    files = [sorted(p for p in paths if CACHE not in p.parts) for paths in found]
    assert files[0] == files[1]
    for path in (path for path in files[0] if path.suffix == ".h5"):
        assert differ(tmp_path / "alone" / path, tmp_path / "watched" / path).same
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


@pytest.mark.thorough
def test_ctrl_c_during_a_watched_campaign_ends_it_as_usual_and_closes_the_server(interrupted, capsys, tmp_path, ask):
    addresses = interrupted(signal.SIGINT, lambda: state_of(ask, addresses)["running"])
    words = ["sweep", "pso_mhpf", "--vary", "tracker.particles=200,400", "--set", "duration=60 s", "-q", "-j", "1"]
    assert main([*words, "--replicates", "50", "-o", "c", "--watch"]) == 130
    told = capsys.readouterr().err
    assert "resume with: wsnsim sweep c" in told and "wsnsim: interrupted" in told
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


def test_nothing_is_watched_that_is_not_run(capsys):
    assert main([*SWEEPS[0], "--watch", "--dry-run"]) == 2
    assert "--watch cannot be combined with --dry-run" in capsys.readouterr().err


def test_the_page_of_a_result_is_shown_until_ctrl_c(interrupted, monkeypatch, capsys, ask):
    assert main(["run", "pso_mhpf", *QUICK[:-1], "-q", "-o", "lab.h5"]) == 0
    given = []
    monkeypatch.setattr("wsnsim.cli.running.page_of", lambda *words: given.append(words) or "the result")
    addresses = interrupted(signal.SIGINT, lambda: ask(addresses[0])[2] == b"the result")
    assert main(["watch", "lab.h5", "--no-browser"]) == 0
    assert given == [(Path("lab.h5"), None, False, False)]  # what a file names is not imported
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])
    capsys.readouterr()
    for words, message in (
        (["--replicates", "3"], "--replicates has no meaning for a result; to run its scenario: wsnsim run lab.h5"),
        (["--exit"], "lab.h5 is a result, whose run has ended; wsnsim report lab.h5 writes its page"),
        (["--metric", "rmse"], "--metric and --column need a campaign"),
    ):
        assert main(["watch", "lab.h5", *words]) == 2
        assert message in capsys.readouterr().err


def test_a_file_that_is_no_result_is_named(capsys, tmp_path):
    (tmp_path / "x.h5").write_text("no result")
    for name, message in (("x.h5", "x.h5"), ("none.h5", "none.h5")):
        assert main(["watch", name]) != 0
        assert message in capsys.readouterr().err


def test_no_browser_is_opened_without_a_terminal(monkeypatch, capsys):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail("a browser was opened"))
    running.say_where("http://127.0.0.1:1/x/", running.LiveOptions())
    assert "http://127.0.0.1:1/x/" in capsys.readouterr().err


def test_what_has_no_meaning_for_a_scenario_is_refused(capsys):
    for words, message in (
        (["rkf", "--metric", "rmse"], "--metric and --column need a campaign"),
        (["."], "is a folder, expected a scenario file, or that of a campaign"),
        (["nothing_like_it"], "file not found"),
    ):
        assert main(["watch", *words]) == 2
        assert message in capsys.readouterr().err
