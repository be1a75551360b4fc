"""Worker processes of this machine: equal tables for any number of workers, and tasks that kill their worker."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.thorough import thorough
from wsnsim.base.runs import watching
from wsnsim.base.version import __version__
from wsnsim.campaign import Shard, collect, engines, prepare, run_campaign
from wsnsim.campaign.engines import FinishedTask, LocalEngine
from wsnsim.campaign.task import Task, TaskOutcome, describe_error, perform
from wsnsim.recording import read_text
from wsnsim.recording.folder import Folder
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import assert_same, tables_of
from .inline_engine import InlineEngine
from .moody_tracker import TRUSTED, sweep_of
from .processes import environment, lives, wait_for

RAISES = "moody.py:26: ValueError: out of sorts"
EXITS = "moody.py:28: SystemExit: 7"


def first_task(folder: Folder, **said: Any) -> Task:
    point = folder.manifest().points[0].id
    return Task(
        str(folder.path),
        point,
        **{"first": 0, "last": 1, "session": "s", "version": __version__, "access": TRUSTED, **said},
    )


def all_ended(pool: LocalEngine, count: int) -> list[FinishedTask]:
    endings: list[FinishedTask] = []
    wait_for(lambda: endings.extend(pool.finished(0.1)) or len(endings) >= count)
    return endings


@pytest.mark.thorough
def test_the_tables_do_not_depend_on_workers_or_shards(lab: Path) -> None:
    plan = load_sweep(sweep_of([{"pause": pause} for pause in (0.0, 0.001, 0.002)], 5))
    for name, engine in (("1", InlineEngine()), ("2", LocalEngine(2))):
        assert run_campaign(prepare(plan, lab / name), engine, access=TRUSTED).complete
    for number in (1, 2):
        assert run_campaign(
            prepare(plan, lab / f"part{number}"), InlineEngine(), Shard(number, 2), access=TRUSTED
        ).complete
    collect([Folder(lab / "part1"), Folder(lab / "part2")], Folder(lab / "all"))
    one = tables_of(lab / "1")
    assert len(one["runs"]) == 3 * 5 and one["runs"]["rmse"].nunique() == 5
    assert_same(one, tables_of(lab / "2"))
    assert_same(one, tables_of(lab / "all"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    "moods",
    [
        {"raises": 0, "exits": 1, "killed": 2, "hangs": 1},
        *thorough([{"raises": 0, "exits": 1, "killed": 2, "crashes": 0, "hangs": 1, "sleeps": 2}]),
    ],
    ids=len,
)
def test_tasks_that_raise_exit_crash_or_never_end_are_named_and_the_rest_is_done(
    lab: Path, moods: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "_can_be_copied", lambda: sys.platform == "linux")  # as in most campaigns
    sweep = sweep_of([{"mood": "calm"}, *({"mood": m, "at": at} for m, at in moods.items())], 3, block=1, timeout=8)
    folder = prepare(load_sweep(sweep), lab / "c")
    ended = run_campaign(folder, LocalEngine(1), access=TRUSTED)
    ids = {point.settings["tracker.mood"]: point.id for point in folder.manifest().points}
    assert ended.missing == {ids[mood]: [at] for mood, at in moods.items()}
    words = {mood: ended.failed[f"{ids[mood]}.r{at:05d}-{at:05d}"] for mood, at in moods.items()}
    words = {mood: re.sub(r"\S+/(?=moody\.py)", "", text) for mood, text in words.items()}  # of an earlier test
    expected = {
        "raises": f"the run failed at 1 s of simulated time (seed 20220101, replicate 0): {RAISES}",
        "exits": f"the run failed at 1 s of simulated time (seed 20220101, replicate 1): {EXITS}",
        "killed": "killed its worker twice (killed from outside, perhaps out of memory)",
        "crashes": "killed its worker twice (Segmentation fault)",
        "hangs": "took more than 8 s",
        "sleeps": "took more than 8 s",
    }
    assert words == {mood: expected[mood] for mood in moods}
    said = folder.failures()[f"{ids['hangs']}.r00001-00001"]
    assert "tracker.mood = hangs" in said and "in misbehave" in said
    assert not list(folder.path.rglob("*.tmp")) and not list(folder.path.glob("running/*"))


@pytest.mark.thorough
def test_a_worker_that_cannot_begin_is_not_the_tasks_fault(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "_start", importlib.import_module("moody").die_at_once)
    monkeypatch.setattr(engines, "MAX_BROKEN_POOLS", 2)
    folder = prepare(load_sweep(sweep_of([{"mood": "calm"}])), lab / "c")
    ended = run_campaign(folder, LocalEngine(1), access=TRUSTED)
    assert ended.stopped.startswith("workers died 2 times in a row before they started: is there enough memory?")
    assert not ended.failed and not ended.complete


@pytest.mark.thorough
def test_workers_do_not_hear_ctrl_c_even_while_they_start_and_end_with_the_pool(lab: Path) -> None:
    folder = prepare(load_sweep(sweep_of([{"mood": "calm"}])), lab / "c")
    pool = LocalEngine(1)
    pool.submit(first_task(folder))
    workers = [process.pid for process in multiprocessing.active_children()]
    for worker in workers:
        os.kill(worker, signal.SIGINT)
    assert [ending.outcome.status for ending in all_ended(pool, 1)] == ["done"]
    for worker in workers:
        os.kill(worker, signal.SIGINT)
    pool.submit(first_task(folder, first=2, last=3))
    assert [ending.outcome.status for ending in all_ended(pool, 1)] == ["done"]
    pool.close()
    assert workers and not any(map(lives, workers))


@pytest.mark.thorough
def test_a_pool_that_broke_while_nobody_looked_gives_its_tasks_back_and_is_made_anew(lab: Path) -> None:
    folder = prepare(load_sweep(sweep_of([{"mood": "calm", "pause": 30.0}, {"mood": "calm"}])), lab / "c")
    pool = LocalEngine(1)
    pool.submit(first_task(folder))
    wait_for(lambda: list(folder.path.glob("running/*")))
    for process in multiprocessing.active_children():
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()
    wait_for(lambda: all(future.done() for future in pool._running))
    pool.submit(first_task(folder, first=2, last=3))
    gone = all_ended(pool, 2)
    assert [type(ending.outcome).__name__ for ending in gone] == ["WorkerLost", "WorkerLost"]
    point = folder.manifest().points[1].id
    pool.submit(Task(str(folder.path), point, 0, 1, "s", __version__, access=TRUSTED))
    assert all_ended(pool, 1)[0].outcome.status == "done"
    pool.close()


@pytest.mark.thorough(fast=["True-ForkProcess"])
@pytest.mark.parametrize(("copied", "process"), [(True, "ForkProcess"), (False, "SpawnProcess")])
def test_workers_are_copies_where_that_is_safe_and_report_to_nobody_who_watches_the_campaign(
    lab: Path, copied: bool, process: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "_can_be_copied", lambda: copied)
    moody = importlib.import_module("moody")
    pool = LocalEngine(1, moody.describe_process)
    with watching(moody.REPORTED.append):
        pool.submit(Task("", "", 0, 0, "s", __version__))
    (ended,) = all_ended(pool, 1)
    pool.close()
    assert ended.outcome == TaskOutcome("done", f"{process}, 0 reported")


@pytest.mark.thorough
def test_a_process_with_another_thread_is_not_copied() -> None:
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    assert not engines._can_be_copied()
    end.set()
    thread.join()
    alone = "from wsnsim.campaign.engines import _can_be_copied; print(_can_be_copied())"
    said = subprocess.run([sys.executable, "-c", alone], env=environment(), capture_output=True, text=True, check=True)
    assert said.stdout.strip() == str(sys.platform == "linux")


# a task by itself


def performed(lab: Path, mood: str, **said: Any) -> tuple[Folder, TaskOutcome]:
    folder = prepare(load_sweep(sweep_of([{"mood": mood}])), lab / "c")
    return folder, perform(first_task(folder, **said))


def test_a_task_leaves_its_file_and_nothing_else(lab: Path) -> None:
    folder, outcome = performed(lab, "calm")
    place = folder.batch(folder.manifest().points[0].id, 0, 1)
    assert (outcome.status, outcome.size) == ("done", place.stat().st_size) and outcome.seconds > 0
    assert {p.name for p in lab.glob("c/*/*")} == {"scenario.json", "r00000-00001.h5"}
    written = place.stat().st_mtime_ns
    assert perform(first_task(folder)).status == "exists" and place.stat().st_mtime_ns == written


@pytest.mark.parametrize(("mood", "words"), [("raises", RAISES), ("exits", EXITS)])
def test_what_a_tracker_raises_is_the_outcome(lab: Path, mood: str, words: str) -> None:
    folder, outcome = performed(lab, mood)
    assert outcome.status == "failed" and words in outcome.reason
    assert not list(folder.path.glob("*/r*")) and not list(folder.path.glob("running/*"))


def test_a_task_of_another_version_is_not_run(lab: Path) -> None:
    folder, outcome = performed(lab, "calm", version="9.9")
    assert outcome == TaskOutcome("version", f"the worker has wsnsim {__version__}, but the campaign runs with 9.9")
    assert not list(folder.path.glob("*/r*"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("marks", "outcome"),
    [
        (["", ""], TaskOutcome("suspect", "killed 2 workers")),
        (["Timeout (0:00:03)!"], TaskOutcome("failed", "took more than 3 s")),
    ],
)
def test_a_task_that_has_killed_before_is_not_taken_up(lab: Path, marks: list[str], outcome: TaskOutcome) -> None:
    folder = prepare(load_sweep(sweep_of([{"mood": "calm"}])), lab / "c")
    task = first_task(folder, timeout=3.0)
    (folder.path / "running").mkdir()
    for number, text in enumerate(marks):
        (folder.path / "running" / f"s.{task.name}.host.{number}.log").write_text(text)
    assert perform(task) == outcome
    assert perform(first_task(folder, session="another")).status == "done"


class _Mute(Exception):
    def __str__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (_Mute(), "_Mute (its message cannot be read)"),
        (ValueError("\udcff"), "ValueError: \\udcff"),
        (ValueError("x" * 9999), "ValueError: " + "x" * 586 + " …"),
        (KeyboardInterrupt(), "KeyboardInterrupt: "),
    ],
)
def test_what_went_wrong_can_always_be_said_and_written(error: BaseException, words: str) -> None:
    assert describe_error(error) == words and len(words.encode()) < 1000


def test_an_outcome_is_small(lab: Path) -> None:
    folder, outcome = performed(lab, "raises")
    assert max(len(pickle.dumps(thing)) for thing in (outcome, first_task(folder))) < 1000


@pytest.mark.thorough
@pytest.mark.parametrize("batch", [True, False])
def test_standalone_runs_of_a_task_are_made_at_once_unless_the_campaign_says_otherwise(lab: Path, batch: bool) -> None:
    plan = load_sweep(["ungm_pf"], ["tracker.particles=20"], ["duration=3 s"], replicates=4)
    folder = prepare(plan, lab / "made")
    assert run_campaign(folder, InlineEngine(), batch=batch).complete
    (file,) = [each.path for point in folder.manifest().points for each in folder.batches(point.id)]
    assert json.loads(read_text(file, "provenance_json"))["engine"] == ("batch" if batch else "composed")
