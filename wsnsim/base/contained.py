"""What a plug-in does to the whole process: it ends it, closes its streams, or changes its working directory."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

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
    end, before = os._exit, _working_directory()
    os._exit = _refusal(end, "calls os._exit({!r}), which ends the whole process without a result")
    try:
        with streams_kept_open():
            yield
    finally:
        os._exit = end
        after = _working_directory()
        if before and after != before:
            os.chdir(before)
    if before and after != before:
        raise PluginAnswerError(f"leaves the working directory {before} for {after}", ", ".join(classes))


@contextlib.contextmanager
def streams_kept_open() -> Iterator[None]:
    """Report as an error that code of plug-ins closes stdout or stderr; what it puts in their place is taken back."""
    held = {name: getattr(sys, name) for name in ("stdout", "stderr")}
    acts = [
        (part, act, name)
        for name, stream in held.items()
        for part in (stream, getattr(stream, "buffer", None))
        for act in ("close", "detach")
        if hasattr(part, "__dict__") and hasattr(part, act)
    ]
    before = [vars(part).get(act) for part, act, _ in acts]
    for part, act, name in acts:
        setattr(part, act, _refusal(getattr(part, act), f"closes sys.{name}, which the whole process uses"))
    try:
        yield
    finally:
        for (part, act, _), one in zip(acts, before, strict=True):
            vars(part).pop(act, None)
            vars(part).update({act: one} if one else {})  # another of these is around this one
        vars(sys).update(held)


def _refusal(act: Callable[..., Any], said: str) -> Callable[..., Any]:
    """What stands in the place of an act: in this process it is an error, a child of a plug-in may do it."""
    process = os.getpid()

    def refuse(*given: Any) -> Any:
        if os.getpid() != process:
            return act(*given)
        raise PluginAnswerError(said.format(*given))

    return refuse


def _working_directory() -> str:
    """The working directory; '' if it was deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return ""
