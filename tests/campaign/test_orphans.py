"""Workers end when the process that started them is killed, even where no Python code can run."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from wsnsim.campaign import task

from .processes import environment, lives, wait_for

DRIVER = """
import ctypes
import multiprocessing
import os
import signal
import sys

from wsnsim.campaign.task import start_worker


def work():
    start_worker()
    print(os.getpid(), file=sys.stderr, flush=True)
    ctypes.PyDLL(None).sleep(60)  # as compiled code that holds the interpreter's lock


if __name__ == "__main__":
    process = multiprocessing.get_context(sys.argv[1]).Process(target=work)
    process.start()
    sys.stdin.readline()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux kills the children of a process that ends")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_worker_that_never_lets_python_run_ends_with_its_driver(method: str, fresh_folder) -> None:
    (fresh_folder / "driver.py").write_text(DRIVER)
    command = [sys.executable, "driver.py", method]
    driver = subprocess.Popen(
        command, env=environment(), stdin=subprocess.PIPE, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    with driver:
        assert driver.stdin is not None and driver.stderr is not None
        worker = int(driver.stderr.readline())
        assert lives(worker)
        driver.stdin.write("\n")
        driver.stdin.flush()
        wait_for(lambda: not lives(worker), 30)


def test_a_worker_whose_driver_ended_before_it_asked_for_the_signal_ends_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ended(code: int) -> None:
        raise SystemExit(code)

    parent = SimpleNamespace(pid=os.getppid(), join=lambda: None)
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: parent)
    monkeypatch.setattr(task, "_ask_for_signal", lambda: None)
    monkeypatch.setattr(task, "_exit_after", lambda parent: None)
    monkeypatch.setattr(task.sys, "platform", "linux")
    monkeypatch.setattr(os, "_exit", ended)
    task.end_with_parent()
    monkeypatch.setattr(os, "getppid", lambda: parent.pid + 1)
    with pytest.raises(SystemExit):
        task.end_with_parent()
