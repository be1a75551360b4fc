"""The first and the last moment of a command: a signal while Python imports it, and the end of its process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

HOME = Path(__file__).parents[2]
STUB = "import os, signal, time\nos.kill(os.getpid(), signal.{})\ntime.sleep(60)\n"
"""In place of click, of which the import is then interrupted."""
ENTRY = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]["wsnsim"]
SCRIPT = "import sys; from {} import {}; sys.exit({}())".format(*ENTRY.split(":"), ENTRY.split(":")[1])
"""What the installed script does."""


def interrupted(folder: Path, name: str, *words: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the command, of which the import of click sends this signal."""
    (folder / "click.py").write_text(STUB.format(name))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(HOME)])}
    ended = subprocess.run(
        [sys.executable, *words, "--help"], env=environment, capture_output=True, text=True, timeout=50, check=False,
        cwd=folder,
    )  # fmt: skip
    return ended.returncode, ended.stdout, ended.stderr


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
@pytest.mark.parametrize(
    ("name", "code", "said"),
    [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "stopped by SIGTERM"), ("SIGHUP", 129, "stopped by SIGHUP")],
)
@pytest.mark.parametrize("words", [("-m", "wsnsim"), ("-c", SCRIPT)], ids=["python -m wsnsim", "wsnsim"])
def test_a_signal_during_the_imports_is_one_line(
    tmp_path: Path, words: tuple[str, ...], name: str, code: int, said: str
) -> None:
    assert interrupted(tmp_path, name, *words) == (code, "", f"wsnsim: error: {said}\n")


@pytest.mark.parametrize("other", ["", "threading.Thread(target=lambda: (time.sleep(0.1), print('last'))).start()"])
def test_what_was_registered_for_the_end_and_other_threads_do_their_work(other: str) -> None:
    code = f"import atexit, threading, time; atexit.register(print, 'kept'); {other}\n{SCRIPT}"
    words = [sys.executable, "-c", code, "run", "no_scenario.yaml"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=50, check=False, cwd=HOME)
    assert (ended.returncode, ended.stdout) == (2, "last\nkept\n" if other else "kept\n")
    assert ended.stderr.startswith("no_scenario.yaml: error: file not found")
