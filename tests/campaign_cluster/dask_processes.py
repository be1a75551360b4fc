"""A Dask scheduler and workers as processes, over TCP on loopback, and a tracker that fails on demand."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import final

from wsnsim.recording.folder import Folder

ODD = '''
import os
import time
from typing import Annotated

import numpy as np

import wsnsim


@wsnsim.part
class Odd:
    """A tracker with random estimates, which first sleeps, raises, or kills its process."""

    sleep: Annotated[float, wsnsim.Quantity("s", ge=0), "how long"] = 0.0
    fail: Annotated[int, wsnsim.Quantity("", ge=0), "1: raise"] = 0
    crash: Annotated[int, wsnsim.Quantity("", ge=0), "1: kill the process"] = 0

    def start(self, prior, scene):
        yield wsnsim.Compute(0.0)
        time.sleep(self.sleep)
        if self.fail:
            raise ArithmeticError("told to fail")
        if self.crash:
            os.kill(os.getpid(), 9)
        return prior

    def step(self, belief, scene):
        yield wsnsim.Compute(1.0)
        drawn = np.random.default_rng(scene.key).normal(size=belief.mean.shape)
        return wsnsim.Estimate(belief.mean + drawn, belief.cov)

    def hand_over(self, belief, scene, successor):
        yield wsnsim.Compute(0.0)
        return belief

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return belief
'''
SHIM = "import wsnsim.base.version\nwsnsim.base.version.__version__ = '9.9.9'\n"
BLOCK = "import sys\nsys.modules['wsnsim'] = None\n"
PATIENCE = 120.0
ROOT = Path(__file__).parents[2]


@final
class Lab:
    """A folder with the tracker, and the processes started in it, which `close` ends."""

    def __init__(self, place: Path) -> None:
        self.place = place
        self.started: list[subprocess.Popen[bytes]] = []
        (place / "mylab_odd.py").write_text(ODD)
        (place / "shim").mkdir()
        (place / "shim" / "sitecustomize.py").write_text(SHIM)
        (place / "without").mkdir()
        (place / "without" / "sitecustomize.py").write_text(BLOCK)
        self.environment = {**os.environ, **_path(place)}
        self.other_version = _path(place / "shim", place)
        self.without_wsnsim = _path(place / "without", place)

    def scheduler(self, name: str, changes: Mapping[str, str] | None = None) -> Path:
        """Start a scheduler; its scheduler file."""
        file = self.place / f"{name}.json"
        file.unlink(missing_ok=True)
        where = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
        self._dask("scheduler", [*where, "--scheduler-file", str(file)], changes or {})
        until(lambda: file.is_file() and file.read_text().endswith("}"))
        return file

    def worker(
        self, file: Path, *options: str, changes: Mapping[str, str] | None = None, before: Sequence[str] = ()
    ) -> subprocess.Popen[bytes]:
        """Start a worker, by default with a nanny and one thread."""
        options = options if "--nthreads" in options else (*options, "--nthreads", "1")
        where = ["--host", "127.0.0.1", "--no-dashboard", "--local-directory", str(self.place / "dask")]
        return self._dask("worker", ["--scheduler-file", str(file), *where, *options], changes or {}, before)

    def wsnsim(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start a wsnsim command in a process group of its own, as a terminal does."""
        command = [sys.executable, "-m", "wsnsim", *arguments]
        return self._started(command, self.environment, subprocess.PIPE)

    def close(self) -> None:
        """End all processes."""
        for process in self.started:
            stop(process)
        shutil.rmtree(self.place / "dask", ignore_errors=True)

    def _dask(
        self, what: str, options: Sequence[str], changes: Mapping[str, str], before: Sequence[str] = ()
    ) -> subprocess.Popen[bytes]:
        command = [*before, sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        return self._started(command, {**self.environment, **changes}, subprocess.DEVNULL)

    def _started(self, command: Sequence[str], environment: Mapping[str, str], output: int) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            command, cwd=self.place, env=dict(environment), stdout=output, stderr=output, start_new_session=True
        )
        self.started.append(process)
        return process


def _path(*folders: Path) -> dict[str, str]:
    """The environment in which these folders, and the sources under test, are on Python's path."""
    return {"PYTHONPATH": os.pathsep.join(map(str, [*folders, ROOT]))}


@contextlib.contextmanager
def lab(place: Path) -> Iterator[Lab]:
    """A lab whose tracker this process can import as well."""
    found = Lab(place)
    sys.path.insert(0, str(place))
    try:
        yield found
    finally:
        sys.path.remove(str(place))
        found.close()


def stop(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and its children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(timeout=PATIENCE)
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def until(holds: Callable[[], bool]) -> None:
    """Wait until the condition holds; fail after two minutes."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, "the condition did not hold in time"
        time.sleep(0.02)


def files(folder: Folder) -> dict[Path, tuple[int, bytes]]:
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.path.glob("*/*.h5")}


def said(process: subprocess.Popen[bytes]) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of a command, once it has ended."""
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out.decode(), err.decode()
