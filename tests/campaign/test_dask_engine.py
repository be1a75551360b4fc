"""Campaigns on a Dask scheduler in this process, with two workers. What kills processes is in `campaign_cluster`."""

from __future__ import annotations

import pickle
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import wsnsim
from tests.campaign_cluster.dask_campaigns import TRUSTED, Begun, begun_in, endings_of, marks, rows, task_of
from tests.campaign_cluster.dask_processes import ODD, files, until
from wsnsim import campaign
from wsnsim.base.errors import UsageError
from wsnsim.campaign import dask_engine, dask_workers
from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.campaign.dask_workers import WorkerRequirements, unmet_requirement
from wsnsim.campaign.task import TaskOutcome
from wsnsim.recording.folder import Folder

from .inline_engine import InlineEngine

HERE = WorkerRequirements(wsnsim.__version__, np.__version__, "")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with two workers, processes of one thread each that can import the slow tracker."""
    distributed = pytest.importorskip("distributed")
    lab = tmp_path_factory.mktemp("lab")
    (lab / "mylab_odd.py").write_text(ODD)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(lab))
        cluster = distributed.LocalCluster(
            n_workers=2, processes=True, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1",
            protocol="tcp", local_directory=str(lab), silence_logs=False,
        )  # fmt: skip
        yield cluster.scheduler_address
        cluster.close()


@pytest.fixture
def begun(tmp_path: Path) -> Begun:
    """begun(keys of a sweep file): a campaign on disk, see `begun_in`."""
    return begun_in(tmp_path)


@pytest.fixture
def engine_of(address: str) -> Iterator[Callable[[Folder], DaskEngine]]:
    """engine_of(folder): an engine, closed after the test."""
    engines: list[DaskEngine] = []

    def make(folder: Folder) -> DaskEngine:
        engines.append(DaskEngine(folder.path, address, wait_for=60.0))
        return engines[-1]

    yield make
    for engine in engines:
        engine.close()


@pytest.mark.thorough
def test_a_campaign_has_the_same_rows_as_on_this_machine(begun: Begun, engine_of: Any) -> None:
    written = {"set": {"duration": "20 s"}, "grid": {"tracker.particles": [20, 40]}, "replicates": 12, "block": 5}
    here, there = (begun(**written, name=name) for name in ("here", "there"))
    assert campaign.run_campaign(here, InlineEngine(), access=TRUSTED).complete
    ended = campaign.run_campaign(there, engine_of(there), access=TRUSTED)
    assert ended.complete and ended.done == 24
    pd.testing.assert_frame_equal(rows(there), rows(here), check_exact=True)
    assert rows(there)["rmse"].nunique() == 24
    assert [path.relative_to(there.path) for path in sorted(files(there))] == [
        path.relative_to(here.path) for path in sorted(files(here))
    ]


@pytest.mark.thorough
def test_a_task_and_its_outcome_are_small_and_nothing_of_them_stays(begun: Begun, engine_of: Any) -> None:
    folder = begun(replicates=8)
    engine = engine_of(folder)
    assert len(pickle.dumps((dask_workers.perform_on_worker, task_of(folder), engine._required))) < 1000
    assert len(pickle.dumps(TaskOutcome("failed", "x" * 600, 1.0, 1))) < 1000
    for number in range(8):
        engine.submit(task_of(folder, number))
    endings = endings_of(engine, 8)
    assert sorted(ending.task.first for ending in endings) == list(range(8))
    until(lambda: not engine._client.futures)
    assert not engine._running and engine.finished(0.0) == []
    assert campaign.run_campaign(folder, engine, access=TRUSTED).found == 8
    assert not list(folder.path.glob("running/*"))


@pytest.mark.thorough
def test_what_no_worker_has_begun_is_taken_back(begun: Begun, engine_of: Any) -> None:
    folder = begun(grid={"tracker.sleep": [0.5]}, replicates=6)
    engine = engine_of(folder)
    tasks = [task_of(folder, number) for number in range(6)]
    for task in tasks[:5]:
        engine.submit(task)
    engine.finished(0.0)
    until(lambda: marks(folder) == 2)
    engine.submit(tasks[5])
    taken = engine.cancel_pending()
    done = [ending.task for ending in endings_of(engine, 2)]
    assert len(taken) == 4 and sorted([*taken, *done], key=lambda task: task.first) == tasks
    assert len(files(folder)) == 2 and engine.finished(0.2) == []


@pytest.mark.parametrize(
    ("need", "threads", "words"),
    [
        (HERE, 1, ""),
        (HERE._replace(wsnsim="9"), 1, f"has wsnsim {wsnsim.__version__}, but the campaign runs with 9"),
        (HERE._replace(numpy="9"), 1, f"has NumPy {np.__version__}, but the campaign runs with 9"),
        (
            HERE._replace(code="9"),
            1,
            f"has other source files of wsnsim {wsnsim.__version__} than the campaign: {wsnsim.__path__[0]}",
        ),
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


@pytest.mark.parametrize("text", ["", "[]", "{}", "tcp://127.0.0.1"])
def test_a_file_that_names_no_scheduler_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "s.json").write_text(text)
    with pytest.raises(UsageError, match="is not a scheduler file"):
        DaskEngine(tmp_path, scheduler_file=tmp_path / "s.json")
    with pytest.raises(UsageError, match="scheduler file does not exist"):
        DaskEngine(tmp_path, scheduler_file=tmp_path / "t.json")


@pytest.mark.thorough(fast=["127.0.0.1:x"])
@pytest.mark.parametrize("address", ["nonsense", "tcp://no.such.host.invalid:1", "foo://127.0.0.1:1", "127.0.0.1:x"])
def test_an_address_where_no_scheduler_is_is_refused(
    tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_workers, "CONNECT_TIMEOUT", 3.0)  # and 1.5 s more for its error to be heard of
    with pytest.raises(UsageError, match=f"cannot connect to the scheduler {address}"):
        DaskEngine(tmp_path, address)


@pytest.mark.thorough
def test_a_port_where_nobody_answers_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_workers, "CONNECT_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent, pytest.raises(UsageError, match="does not answer"):
        DaskEngine(tmp_path, f"tcp://127.0.0.1:{silent.getsockname()[1]}")


def test_without_dask_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'wsnsim\[cluster\]'"):
        DaskEngine(tmp_path, "tcp://127.0.0.1:1")


@pytest.mark.thorough
def test_a_worker_that_does_not_see_the_folder_is_refused(begun: Begun, address: str, tmp_path: Path) -> None:
    folder = begun(replicates=1)
    engine = DaskEngine(folder.path, address)
    marker = Path(engine._required.marker)
    elsewhere = engine._required._replace(marker=str(tmp_path / "elsewhere" / "driver.log"))
    with pytest.raises(UsageError, match=r"worker tcp://.* does not see"):
        engine._check_workers(elsewhere)
    assert marker.is_file()
    engine.close()
    assert not marker.exists()


@pytest.mark.thorough
@pytest.mark.parametrize("refresh", [0.0, 1e9], ids=["found when it joins", "found when it refuses a task"])
def test_a_worker_that_joins_and_cannot_run_the_campaign_is_left_out(
    begun: Begun, engine_of: Any, address: str, refresh: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begun(grid={"tracker.sleep": [0.05]}, replicates=10)
    engine = engine_of(folder)
    late = joined(engine, address, nthreads=2)
    monkeypatch.setattr(dask_engine, "REFRESH", refresh)
    try:
        ended = campaign.run_campaign(folder, engine, access=TRUSTED)
    finally:
        left(address, late)
    assert (ended.complete, ended.stopped, ended.done) == (True, "", 10)
    assert ended.left_out == {late.address: "has 2 threads: start workers with --nthreads 1"}


@pytest.mark.thorough
def test_where_no_worker_can_run_the_campaign_it_ends_with_the_reason(
    begun: Begun, engine_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begun(replicates=6)
    engine = engine_of(folder)
    engine._required = engine._required._replace(numpy="9")
    ended = campaign.run_campaign(folder, engine, access=TRUSTED)
    assert ended.stopped.startswith("worker tcp://") and ended.stopped.endswith("last bits would differ")
    assert not ended.complete and not ended.failed and len(ended.left_out) == 2


@pytest.mark.thorough
def test_tasks_for_workers_that_have_gone_are_sent_to_others(begun: Begun, engine_of: Any) -> None:
    folder = begun(grid={"tracker.sleep": [0.05]}, replicates=3)
    engine = engine_of(folder)
    here, workers = set(engine._workers.usable), engine._workers
    workers.usable, workers.left_out = {"tcp://127.0.0.1:1"}, {"tcp://127.0.0.1:2": "has 2 threads"}
    engine.submit(task_of(folder))
    engine._send()
    assert list(engine._restricted.values()) == [frozenset({"tcp://127.0.0.1:1"})]
    engine._look_at_workers()
    assert workers.usable == here and not engine._restricted
    assert [ending.outcome.status for ending in endings_of(engine)] == ["done"]


def joined(engine: DaskEngine, address: str, **options: Any) -> Any:
    """A worker in this process that has joined the scheduler."""
    distributed = pytest.importorskip("distributed")

    async def start() -> Any:
        return await distributed.Worker(address, **options)

    worker = engine._client.sync(start)
    until(lambda: worker.address in engine._client.nthreads())
    return worker


def left(address: str, worker: Any) -> None:
    """Close a worker, by a client of its own: that of the engine is closed."""
    distributed = pytest.importorskip("distributed")
    with distributed.Client(address, set_as_default=False) as client:
        client.retire_workers([worker.address])


@pytest.mark.thorough
def test_a_scheduler_that_ends_is_said_to_be_gone(begun: Begun, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    folder = begun(replicates=1)
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, dashboard_address="127.0.0.1:0", host="127.0.0.1", protocol="tcp"
        ) as cluster,
        pytest.raises(UsageError, match=r"has no worker after 0\.1 s"),
    ):
        DaskEngine(folder.path, cluster.scheduler_address, wait_for=0.1)
    assert not list(folder.path.glob("running/*"))
