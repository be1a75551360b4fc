"""Schedulers that cannot be used, and workers that do not belong: a clear end, before or while a campaign runs."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim import campaign
from wsnsim.base.errors import UsageError
from wsnsim.campaign import dask_engine
from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.campaign.dask_worker import WorkerRequirements, unmet_requirement
from wsnsim.campaign.engines import EngineError
from wsnsim.recording.folder import Folder

from .dask_processes import Lab, files, said, stop, until

HERE = WorkerRequirements(wsnsim.__version__, np.__version__, "")
Begun = Callable[..., Folder]


@pytest.mark.parametrize(
    ("options", "foreign", "words"),
    [
        ((), True, f"has wsnsim 9.9.9, but the campaign runs with {wsnsim.__version__}"),
        (("--nthreads", "2"), False, "has 2 threads: start workers with --nthreads 1"),
    ],
)
def test_a_worker_that_does_not_belong_is_refused_at_the_start_and_later(
    begun: Begun, engine_of: Any, place: Lab, scheduler: Path, options: tuple[str, ...], foreign: bool, words: str
) -> None:
    folder = begun(grid={"tracker.sleep": [0.1]}, replicates=20)
    engine = engine_of(folder)
    late = place.worker(scheduler, "--no-nanny", *options, changes=place.other_version if foreign else None)
    until(lambda: len(engine._client.nthreads()) == 3)
    with pytest.raises(UsageError, match=f"worker tcp://.* {words}"):
        DaskEngine(folder.path, scheduler_file=scheduler)
    ended = campaign.run_campaign(folder, engine)
    stop(late)
    assert ended.stopped.startswith("worker tcp://") and ended.stopped.endswith(words)
    assert not ended.complete and not ended.failed
    again = campaign.run_campaign(folder, engine_of(folder))
    assert again.complete and again.found == len(files(folder)) - again.done


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


@pytest.mark.parametrize(
    ("need", "threads", "words"),
    [
        (HERE, 1, ""),
        (HERE._replace(wsnsim="9"), 1, f"has wsnsim {wsnsim.__version__}, but the campaign runs with 9"),
        (HERE._replace(numpy="9"), 1, f"has NumPy {np.__version__}, but the campaign runs with 9"),
        (HERE, 2, "has 2 threads"),
        (HERE._replace(marker="elsewhere/running/driver.log"), 1, "does not see elsewhere"),
    ],
)
def test_a_worker_says_what_it_lacks(tmp_path: Path, need: WorkerRequirements, threads: int, words: str) -> None:
    mark = tmp_path / "running" / "driver.log"
    mark.parent.mkdir()
    mark.touch()
    worker = SimpleNamespace(state=SimpleNamespace(nthreads=threads))
    found = unmet_requirement(need if need.marker else need._replace(marker=str(mark)), worker)
    assert found.startswith(words) and bool(found) == bool(words)


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
    monkeypatch.setattr(dask_engine, "ANSWER_TIMEOUT", 0.5)
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


@pytest.mark.parametrize("text", ["", "[]", "{}", "tcp://127.0.0.1"])
def test_a_file_that_names_no_scheduler_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "s.json").write_text(text)
    with pytest.raises(UsageError, match="is not a scheduler file"):
        DaskEngine(tmp_path, scheduler_file=tmp_path / "s.json")
    with pytest.raises(UsageError, match="scheduler file does not exist"):
        DaskEngine(tmp_path, scheduler_file=tmp_path / "t.json")


@pytest.mark.parametrize("address", ["nonsense", "tcp://no.such.host.invalid:1", "foo://127.0.0.1:1", "127.0.0.1:x"])
def test_an_address_where_no_scheduler_is_is_refused(
    tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "CONNECT_TIMEOUT", 0.5)
    with pytest.raises(UsageError, match=f"cannot connect to the scheduler {address}"):
        DaskEngine(tmp_path, address)


def test_a_port_where_nobody_answers_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_engine, "CONNECT_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent, pytest.raises(UsageError, match="does not answer"):
        DaskEngine(tmp_path, f"tcp://127.0.0.1:{silent.getsockname()[1]}")


def test_without_dask_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'wsnsim\[cluster\]'"):
        DaskEngine(tmp_path, "tcp://127.0.0.1:1")


def test_the_command_line_says_in_time_that_nobody_is_there(nobody: subprocess.Popen[bytes]) -> None:
    code, out, err = said(nobody)
    assert code == 2 and not out and err.startswith("wsnsim: error: cannot connect to the scheduler tcp://127.0.0.1:")
    assert err.count("\n") == 1
