"""A watched run has the result of any other, and its view tells tabs what they do not know yet."""

from __future__ import annotations

import json
import threading

import pytest

from tests.report.page_reader import decoded
from wsnsim import experiment
from wsnsim.analysis.difference import differ
from wsnsim.scenario import load
from wsnsim.watch import run_view
from wsnsim.watch.run_view import RunView

SHORT = ["duration=2 s", "tracker.particles=40"]
RUNS = {
    "pso_mhpf": [*SHORT, "record.particles=true"],
    "two_targets": [*SHORT, "record.events=false"],
    "information_driven_asleep": ["duration=4 s"],
    "beacons": ["duration=3 s"],
    "rkf": ["duration=2 s"],
}


def settle(view):
    """Wait until all that has happened is encoded."""
    view._queue.put(None)
    view._encoder.join()


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", RUNS)
def test_a_run_that_is_looked_at_in_every_step_has_the_same_result(tmp_path, ask, scenario):
    loaded, ended = load(scenario, RUNS[scenario]), threading.Event()
    experiment.run(loaded, replicates=2, out=tmp_path / "alone.h5", batch=False)
    with RunView(scenario, interval=0.0) as view:

        def poll():
            while not ended.is_set():
                assert ask(view.url, "state")[0] == 200

        tabs = [threading.Thread(target=poll) for _ in range(2)]
        for tab in tabs:
            tab.start()
        try:
            experiment.run(
                loaded, replicates=2, out=tmp_path / "watched.h5", batch=False, progress=view.reporting(lambda _: None),
                watched=view.recorder,
            )  # fmt: skip
        finally:
            ended.set()
            for tab in tabs:
                tab.join()
        settle(view)
        state = json.loads(ask(view.url, "state")[2])
    assert differ(tmp_path / "alone.h5", tmp_path / "watched.h5").same
    assert state["note"] == "" and state["run"] == 2 and len(state["texts"]) > 1


@pytest.mark.thorough
def test_a_tab_gets_each_text_once_and_another_one_gets_all(tmp_path, ask):
    with RunView("x", interval=0.0) as view:
        assert json.loads(ask(view.url, "state?run=0&from=0")[2])["texts"] == []
        experiment.run(load("pso_mhpf", SHORT), replicates=1, out=tmp_path / "x.h5", watched=view.recorder)
        settle(view)
        first = json.loads(ask(view.url, "state?run=0&from=0")[2])
        count = len(first["texts"])
        again = json.loads(ask(view.url, f"state?run=1&from={count}")[2])
        other = json.loads(ask(view.url, "state?run=7&from=2")[2])
        strange = json.loads(ask(view.url, "state?run=one&from=-3")[2])
    assert first["run"] == 1 and again["texts"] == [] and again["from"] == count == first["known"]
    assert other["texts"] == strange["texts"] == first["texts"]
    assert decoded(first["texts"][0])[0]["frames"] == 50
    assert 0 < first["rmse"] < 20 and sum(first["joules"].values()) > 0


@pytest.mark.thorough
def test_an_answer_is_limited_and_the_rest_comes_with_the_next(tmp_path, ask, monkeypatch):
    monkeypatch.setattr(run_view, "MOST_SENT", 5000)
    with RunView("x", interval=0.0) as view:
        experiment.run(load("pso_mhpf", SHORT), replicates=1, out=tmp_path / "x.h5", watched=view.recorder)
        settle(view)
        got, texts = 0, []
        view._texts.extend(["x" * 3000] * 3)
        while not texts or got < texts[-1]["known"]:
            texts.append(json.loads(ask(view.url, f"state?run=1&from={got}")[2]))
            got += len(texts[-1]["texts"])
    assert len(texts) > 3 and got == texts[0]["known"]


def test_what_cannot_be_shown_is_said_and_does_not_disturb_the_run(tmp_path, ask, monkeypatch):
    monkeypatch.setattr(run_view.LiveFrames, "add", lambda self, pieces: 1 / 0)
    with RunView("x", interval=0.0) as view:
        experiment.run(load("rkf", RUNS["rkf"]), replicates=1, out=tmp_path / "x.h5", watched=view.recorder)
        settle(view)
        assert "cannot be shown any further: ZeroDivisionError" in json.loads(ask(view.url, "state")[2])["note"]
    assert (tmp_path / "x.h5").exists()


@pytest.mark.thorough
def test_the_page_is_escaped_loads_nothing_and_becomes_that_of_the_result(ask):
    with RunView("<script>alert(1)</script>") as view:
        _, headers, body = ask(view.url)
        assert b"<script>alert" not in body and b"src=" not in body and b"http" not in body.replace(b"http-equiv", b"")
        policy = headers["Content-Security-Policy"]
        assert "connect-src 'self'" in policy and "script-src 'sha256-" in policy and "frame-ancestors 'none'" in policy
        meta = "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'sha256-abc'\">"
        view.finish(f"<html>{meta}the result</html>")
        _, headers, body = ask(view.url)
        assert body.endswith(b"the result</html>")
        assert (
            headers["Content-Security-Policy"] == "default-src 'none'; script-src 'sha256-abc'; frame-ancestors 'none'"
        )
        assert json.loads(ask(view.url, "state")[2])["ended"]
