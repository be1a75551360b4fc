"""`python -m wsnsim` and the installed script `wsnsim`: the command line, which a signal may end while it is imported.

Nothing is imported here that takes time: Ctrl-C before `main` prints the traceback of Python's own start.
"""

import atexit
import contextlib
import gc
import os
import signal
import sys
import threading


def main() -> int:
    """Run the command line of this process and return its exit code."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and shells want it
            signal.signal(number, _end)
    gc.disable()  # what is imported stays
    from wsnsim.cli import main as perform

    gc.enable()
    return _leave(perform())


def _leave(code: int) -> int:
    """End the process without freeing each object, which takes longer than a short run; else return the exit code."""
    if threading.active_count() == 1:  # otherwise the interpreter waits for the others
        with contextlib.suppress(OSError, ValueError):  # what cannot be written is the interpreter's to report
            atexit._run_exitfuncs()
            for stream in filter(None, (sys.stdout, sys.stderr)):
                stream.flush()
            os._exit(code)
    return code


def _end(number: int, _: object) -> None:
    """End the process: it has no files open yet, or none any more."""
    reason = "interrupted" if number == signal.SIGINT else f"stopped by {signal.Signals(number).name}"
    with contextlib.suppress(OSError):  # stderr may be closed
        os.write(2, f"wsnsim: error: {reason}\n".encode())
    os._exit(128 + number)


def _forget_working_directory() -> None:
    """Take the working directory from the path: Python puts it first, where files of others may stand."""
    from pathlib import Path

    home = Path(__file__).resolve().parents[1]
    with contextlib.suppress(FileNotFoundError):  # the working directory was deleted
        if not sys.flags.safe_path and sys.path[0] == str(Path.cwd()) and home != Path.cwd():
            del sys.path[0]


if __name__ == "__main__":  # a worker process of a campaign imports this file, and must not run it
    _forget_working_directory()
    sys.exit(main())
