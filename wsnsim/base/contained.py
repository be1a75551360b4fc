"""What a plug-in does to the whole process during a run: it ends it, or changes its working directory."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from wsnsim.base.errors import PluginAnswerError


@contextlib.contextmanager
def contained(classes: Sequence[str]) -> Iterator[None]:
    """Report as an error of the run that code of plug-ins ends the process at once, or leaves the working directory.

    Args:
        classes: The classes of plug-ins that take part; none: nothing is done.
    """
    if not classes:
        yield
        return
    process, end, before = os.getpid(), os._exit, _working_directory()

    def refuse(status: Any = 0) -> NoReturn:
        if os.getpid() != process:  # a child of the plug-in ends as it should
            end(status)
        raise PluginAnswerError(f"calls os._exit({status!r}), which ends the whole process without a result")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = end
        after = _working_directory()
        if before and after != before:
            os.chdir(before)
    if before and after != before:
        raise PluginAnswerError(f"leaves the working directory {before} for {after}", ", ".join(classes))


def _working_directory() -> str:
    """The working directory; '' if it was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return ""
