"""Schedulers that cannot be used, and workers that do not belong: a clear end, before or while a campaign runs."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim import campaign
from wsnsim.base.errors import UsageError
from wsnsim.campaign import dask_engine, dask_workers
from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.campaign.dask_workers import WorkerRequirements
from wsnsim.campaign.engines import EngineError
from wsnsim.recording.folder import Folder

from .dask_campaigns import TRUSTED
from .dask_processes import Lab, files, said, stop, until

HERE = WorkerRequirements(wsnsim.__version__, np.__version__, "")
Begun = Callable[..., Folder]


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ((), "other_version", f"has wsnsim 9.9.9, but the campaign runs with {wsnsim.__version__}"),
        ((), "without_wsnsim", f"cannot read what it receives: is wsnsim {wsnsim.__version__} installed there?"),
        (("--nthreads", "2"), "same", "has 2 threads: start workers with --nthreads 1"),
    ],
)
def test_a_worker_that_does_not_belong_is_refused_at_the_start_and_left_out_later(
    begun: Begun, engine_of: Any, place: Lab, scheduler: Path, options: tuple[str, ...], kind: str, words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = begun(grid={"tracker.sleep": [0.1]}, replicates=20)
    engine = engine_of(folder)
    late = place.worker(scheduler, "--no-nanny", *options, changes=getattr(place, kind, None))
    until(lambda: len(engine._client.nthreads()) == 3)
    with pytest.raises(UsageError, match=f"worker tcp://.* {re.escape(words)}"):
        DaskEngine(folder.path, scheduler_file=scheduler)
    if (
        kind != "without_wsnsim"
    ):  # it is found by what it does with a task; Dask tries those that it cannot read elsewhere
        monkeypatch.setattr(dask_engine, "REFRESH", 1e9)
    ended = campaign.run_campaign(folder, engine, access=TRUSTED)
    stop(late)
    # Dask may try a task that this worker cannot read elsewhere before anybody sees that it failed here
    assert len(ended.left_out) == 1 or kind == "without_wsnsim"
    assert all(found.startswith(words) for found in ended.left_out.values())
    assert ended.complete and not ended.stopped and ended.done == len(files(folder)) == 20


def test_a_worker_that_does_not_see_the_folder_is_refused(begun: Begun, place: Lab, scheduler: Path) -> None:
    blind = ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"')
    folder = begun(replicates=1)
    if subprocess.run([*blind, str(folder.path), "true"], capture_output=True).returncode:
        pytest.skip("this user may not hide a folder from a process")
    file = place.scheduler("blind")
    place.worker(file, "--no-nanny", before=(*blind, str(folder.path)))
    with pytest.raises(UsageError, match=f"worker tcp.* does not see {folder.path}: .* shared"):
        DaskEngine(folder.path, scheduler_file=file, wait_for=60.0)
    assert not list(folder.path.glob("running/*"))


def test_a_scheduler_without_workers_or_of_another_version_is_refused(begun: Begun, place: Lab) -> None:
    folder = begun(replicates=1)
    with pytest.raises(UsageError, match=r"has no worker after 0\.5 s"):
        DaskEngine(folder.path, scheduler_file=place.scheduler("empty"), wait_for=0.5)
    with pytest.raises(UsageError, match=r"the scheduler .* has wsnsim 9\.9\.9, but this is"):
        DaskEngine(folder.path, scheduler_file=place.scheduler("other", place.other_version))
    assert not list(folder.path.glob("running/*"))


def test_a_scheduler_that_hangs_is_given_up(
    begun: Begun, place: Lab, engine_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begun(grid={"tracker.sleep": [0.1]}, replicates=1)
    engine = engine_of(folder)
    monkeypatch.setattr(dask_workers, "ANSWER_TIMEOUT", 0.5)
    monkeypatch.setattr(dask_engine, "REFRESH", 0.0)
    process = next(
        process
        for process in place.started
        if engine._name.split()[-1] in process.args and "dask_scheduler" in str(process.args)
    )
    os.kill(process.pid, signal.SIGSTOP)
    try:
        with pytest.raises(EngineError, match="does not answer"):
            _ = engine.window
    finally:
        os.kill(process.pid, signal.SIGCONT)


def test_the_command_line_says_in_time_that_nobody_is_there(nobody: subprocess.Popen[bytes]) -> None:
    code, out, err = said(nobody)
    assert code == 2 and not out and err.startswith("wsnsim: error: cannot connect to the scheduler tcp://127.0.0.1:")
    assert err.count("\n") == 1
