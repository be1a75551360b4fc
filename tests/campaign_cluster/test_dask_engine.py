"""Campaigns on a real Dask scheduler and real workers, some of which die."""

from __future__ import annotations

import os
import shlex
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from wsnsim import campaign
from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.recording.folder import Folder

from .dask_campaigns import TRUSTED, endings_of, marks, rows, task_of
from .dask_processes import Lab, files, said, stop, until

Begun = Callable[..., Folder]


def workers_of(engine: DaskEngine) -> Mapping[str, int]:
    """The process id of each worker, by address."""
    return dict(engine._client.run(os.getpid))


def reasons_of(ended: campaign.CampaignOutcome, folder: Folder) -> list[str]:
    """Why each point failed, '' if it did not."""
    written, counted = (
        [each.partition(".")[0] for each in sorted(found)] for found in (folder.failures(), ended.failed)
    )
    assert written == counted and not ended.stopped  # a point without a possible run is counted as a whole
    failed = {task.partition(".")[0]: words for task, words in ended.failed.items()}
    return [failed.get(point.id, "") for point in folder.manifest().points]


def test_tasks_that_crash_or_raise_are_named_and_the_rest_is_done(begun: Begun, engine_of: Any) -> None:
    points = [{}, {"tracker.crash": 1}, {"tracker.fail": 1}, {"tracker.sleep": 0.1}]
    folder = begun(points=points, replicates=1)
    ended = campaign.run_campaign(folder, engine_of(folder), access=TRUSTED)
    reasons = reasons_of(ended, folder)
    assert reasons[:2] == ["", "killed 2 workers"] and reasons[3] == ""
    assert "ArithmeticError: told to fail" in reasons[2]
    assert ended.done == 2 and len(files(folder)) == 2


def test_a_task_that_hangs_is_given_up_when_its_time_is_up(begun: Begun, engine_of: Any) -> None:
    warm = begun(name="warm", replicates=4, grid={"tracker.sleep": [0.5]})
    assert campaign.run_campaign(
        warm, engine_of(warm), access=TRUSTED
    ).complete  # to import all that it takes is in a worker's first time
    folder = begun(points=[{}, {"tracker.sleep": 0.1}, {"tracker.sleep": 100}], replicates=1, timeout=3)
    ended = campaign.run_campaign(folder, engine_of(folder), access=TRUSTED)
    assert reasons_of(ended, folder) == ["", "", "took more than 3 s"]


def test_a_worker_that_is_killed_costs_nothing_but_time(begun: Begun, engine_of: Any) -> None:
    folder = begun(grid={"tracker.sleep": [0.1, 0.11]}, replicates=10)
    engine = engine_of(folder)
    victim, killed = next(iter(workers_of(engine).values())), []

    def watch(progress: campaign.CampaignProgress) -> None:
        if progress.done >= 4 and not killed:
            os.kill(victim, signal.SIGKILL)
            killed.append(victim)

    ended = campaign.run_campaign(folder, engine, on_progress=watch, access=TRUSTED)
    assert killed and ended.complete and not ended.failed and len(rows(folder)) == 20
    assert not list(folder.path.glob("*/*.tmp"))


def test_an_outcome_that_died_with_its_worker_is_said_again(begun: Begun, engine_of: Any) -> None:
    folder = begun(replicates=1)
    engine = engine_of(folder)
    engine.submit(task_of(folder))
    engine._send()
    [(future, _)] = engine._running.values()
    until(lambda: future.status == "finished")
    before = files(folder)
    for process in workers_of(engine).values():
        os.kill(process, signal.SIGKILL)
    assert endings_of(engine)[0].outcome.status == "exists"  # type: ignore[union-attr]
    assert len(before) == 1 and files(folder) == before


def test_when_the_scheduler_is_killed_the_printed_command_goes_on(begun: Begun, place: Lab) -> None:
    folder = begun(grid={"tracker.sleep": [0.15, 0.16]}, replicates=10)
    file = place.scheduler("mortal")
    place.worker(file, "--no-nanny")
    driver = place.wsnsim("sweep", str(folder.path), "--scheduler-file", str(file), "--plugins", "--progress", "none")
    until(lambda: len(files(folder)) >= 2 or driver.poll() is not None)
    stop(next(process for process in place.started if str(file) in process.args))
    code, out, err = said(driver)
    before = files(folder)
    assert code == 3 and 2 <= len(before) < 20
    assert "is gone" in err and "Traceback" not in err and "distributed" not in err
    command = shlex.split(
        next(line for line in err.splitlines() if "resume with: " in line).partition("resume with: ")[2]
    )
    place.worker(place.scheduler("mortal"), "--no-nanny")
    code, out, err = said(place.wsnsim(*command[1:], "--json", "--quiet"))
    assert (code, err) == (0, "") and out.count("\n") == 1
    assert len(rows(folder)) == 20 and before.items() <= files(folder).items()
    assert not list(folder.path.glob("*/*.tmp"))


def test_after_ctrl_c_what_runs_ends_and_nothing_is_begun(begun: Begun, place: Lab, scheduler: Path) -> None:
    folder = begun(grid={"tracker.sleep": [0.4, 0.44]}, replicates=10)
    driver = place.wsnsim(
        "sweep", str(folder.path), "--scheduler-file", str(scheduler), "--plugins", "--progress", "none"
    )
    until(lambda: marks(folder) == 2 or driver.poll() is not None)
    driver.send_signal(signal.SIGINT)
    code, _, err = said(driver)
    assert code == 130 and "Traceback" not in err and "distributed" not in err
    assert f"resume with: wsnsim sweep {folder.path} --scheduler-file {scheduler}" in err
    assert 2 <= len(files(folder)) <= 4 and not list(folder.path.glob("running/*"))


def test_the_client_keeps_none_of_the_messages_that_it_sent(begun: Begun, engine_of: Any) -> None:
    engine = engine_of(begun(points=[{}], replicates=1))
    assert engine._client.scheduler_comm.recent_message_log.maxlen == 0
    engine.close()
