"""The command: the result of `run`, an address, and an end by itself or by Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import pytest

from wsnsim.analysis.difference import differ
from wsnsim.cli import live, main

QUICK = ["--set", "duration=0.4 s", "--set", "tracker.particles=40", "--no-browser"]
ENDLESS = ["--set", "duration=1 h", "--no-browser", "--quiet"]


@pytest.fixture(autouse=True)
def _alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "environ", os.environ.copy())


@pytest.fixture
def interrupted(monkeypatch):
    """Sends this process a signal when something holds after the address was printed; gives the address."""
    said, addresses = live.say_where, []

    def when(number, holds):
        def send():
            while not holds():
                time.sleep(0.01)
            os.kill(os.getpid(), number)

        def say(url, options):
            said(url, options)
            addresses.append(url)
            threading.Thread(target=send, daemon=True).start()

        monkeypatch.setattr(live, "say_where", say)
        monkeypatch.setattr("wsnsim.cli.watch.say_where", say)
        return addresses

    return when


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


def test_ctrl_c_during_the_run_ends_it_as_usual_and_closes_the_server(interrupted, capsys, tmp_path, ask):
    addresses = interrupted(signal.SIGINT, lambda: any(tmp_path.glob("*.tmp")))
    assert main(["watch", "pso_mhpf", *ENDLESS, "-o", "x.h5"]) == 130
    assert "wsnsim: error: interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_after_the_run_the_result_is_shown_until_a_signal_comes(
    interrupted, monkeypatch, capsys, tmp_path, ask, number, code
):
    monkeypatch.setattr(live, "_page_of", lambda result, page: "the result")
    addresses = interrupted(number, lambda: ask(addresses[0])[2] == b"the result")
    assert main(["run", "pso_mhpf", *QUICK[:-1], "--watch", "-o", "x.h5"]) == code
    assert "the address now shows the result; Ctrl-C ends the server" in capsys.readouterr().err
    assert (tmp_path / "x.h5").exists()
    with pytest.raises(ConnectionRefusedError):
        ask(addresses[0])


def test_no_browser_is_opened_without_a_terminal(monkeypatch, capsys):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail("a browser was opened"))
    live.say_where("http://127.0.0.1:1/x/", live.LiveOptions())
    assert "http://127.0.0.1:1/x/" in capsys.readouterr().err


def test_what_has_no_meaning_for_a_scenario_is_refused(capsys):
    for words, message in (
        (["rkf", "--metric", "rmse"], "--metric and --column need a campaign"),
        (["."], "folder holds no campaign"),
        (["nothing_like_it"], "file not found"),
    ):
        assert main(["watch", *words]) == 2
        assert message in capsys.readouterr().err
