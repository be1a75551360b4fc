"""Worker processes end with the process that started them, however that ended.

Linux kills them: a thread that waits for the parent cannot run while compiled code holds the interpreter's lock. On
other systems there is only the thread.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from typing import Any, Final

PR_SET_PDEATHSIG: Final = 1
"""The option of prctl(2) that asks for a signal when the parent ends."""


def end_with_parent() -> None:
    """Let this process end when its parent has ended, or at once if it has ended already.

    On Linux the parent is the thread that started this process. It must live as long as the process is needed.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        _ask_for_signal()
        if os.getppid() != parent.pid:  # it ended before the signal was asked for
            os._exit(1)
    threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()


def _ask_for_signal() -> None:
    """Ask Linux to kill this process when its parent ends. Where that is forbidden, the thread remains."""
    import ctypes

    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL))


def _exit_after(parent: Any) -> None:
    parent.join()
    os._exit(1)
