"""One scheduler with two workers for all tests of this folder, and campaigns for them."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.recording.folder import Folder

from .dask_campaigns import Begun, begun_in
from .dask_processes import Lab, lab, until


@pytest.fixture(scope="package")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with lab(tmp_path_factory.mktemp("lab")) as found:
        yield found


@pytest.fixture(scope="package")
def nobody(place: Lab) -> subprocess.Popen[bytes]:
    """A command with the address of a scheduler that does not exist. It takes long, so it is started first."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    return place.wsnsim("sweep", "ungm_pf", "--vary", "motion.q=1,2", "--scheduler", address)


@pytest.fixture(scope="package")
def scheduler(place: Lab, nobody: subprocess.Popen[bytes]) -> Path:
    """The file of a scheduler with two workers and their nannies."""
    file = place.scheduler("two")
    place.worker(file, "--nworkers", "2")
    return file


@pytest.fixture
def begun(tmp_path: Path) -> Begun:
    """begun(keys of a sweep file): a campaign on disk, see `begun_in`."""
    return begun_in(tmp_path)


@pytest.fixture
def engine_of(scheduler: Path) -> Iterator[Callable[[Folder], DaskEngine]]:
    """engine_of(folder): an engine to which both workers are connected."""
    engines: list[DaskEngine] = []

    def make(folder: Folder) -> DaskEngine:
        engine = DaskEngine(folder.path, scheduler_file=scheduler, wait_for=60.0)
        engines.append(engine)
        until(lambda: len(engine._client.nthreads()) == 2)
        return engine

    yield make
    for engine in engines:
        engine.close()
