"""How a run's progress is shown on stderr: a bar, a line now and then, or JSON lines.

    shown(mode) -> an object with step(progress) and close(), or None

`progress` has `replicate` (from 0), `replicates`, `time` and `duration` (simulated, s) and `wall` (s since the start).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any, Final, Protocol

import click

MODES: Final = ("auto", "bar", "plain", "json", "none")


class Shown(Protocol):
    """What shows progress."""

    def step(self, progress: Any) -> None: ...

    def close(self) -> None: ...


def shown(mode: str) -> Shown | None:
    """What shows progress; None if nothing does."""
    if mode == "none":
        return None
    if mode == "auto":
        mode = "bar" if sys.stderr is not None and sys.stderr.isatty() else "plain"
    return _Bar() if mode == "bar" else _Lines(_json_line if mode == "json" else _plain_line, every=mode == "json")


def _share(progress: Any) -> float:
    """How much of all replicates is done, from 0 to 1. `progress.replicate` counts from 0."""
    return min(1.0, (progress.replicate + progress.time / progress.duration) / progress.replicates)


def _speed(progress: Any) -> float:
    """Simulated seconds a second."""
    return (progress.replicate * progress.duration + progress.time) / max(progress.wall, 1e-9)


class _Bar:
    """One line on the terminal, redrawn: simulated time, × real time, time left."""

    def __init__(self) -> None:
        self._bar: Any = None

    def step(self, progress: Any) -> None:
        if self._bar is None:
            self._bar = _tqdm(progress.replicates * progress.duration)
        self._bar.n = _share(progress) * self._bar.total
        self._bar.set_postfix_str(f"{_speed(progress):.3g} × real time")

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _tqdm(total: float) -> Any:
    from tqdm import tqdm

    shape = "{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s simulated [{elapsed}<{remaining}{postfix}]"
    return tqdm(total=total, desc="wsnsim", bar_format=shape, leave=False, file=sys.stderr)


class _Lines:
    """A line now and then: every 10 % or 30 s, or at every call."""

    def __init__(self, line_of: Callable[[Any], str], every: bool) -> None:
        self._line_of = line_of
        self._every = every
        self._tenths = 0
        self._wall = 0.0

    def step(self, progress: Any) -> None:
        tenths = int(10 * _share(progress) + 1e-9)
        if self._every or tenths > self._tenths or progress.wall - self._wall >= 30:
            self._tenths, self._wall = tenths, progress.wall
            click.echo(self._line_of(progress), err=True)

    def close(self) -> None:
        """Nothing stays open."""


def _plain_line(progress: Any) -> str:
    share = _share(progress)
    left = f", about {progress.wall / share - progress.wall:.0f} s left" if share else ""
    runs = f"replicate {progress.replicate + 1} of {progress.replicates}, " if progress.replicates > 1 else ""
    time = f"{progress.time:.4g} of {progress.duration:.4g} s"
    return f"wsnsim: {100 * share:.0f} % ({runs}{time}, {_speed(progress):.3g} × real time{left})"


def _json_line(progress: Any) -> str:
    names = ("replicate", "replicates", "time", "duration", "wall")
    return json.dumps({name: getattr(progress, name) for name in names} | {"share": _share(progress)})
