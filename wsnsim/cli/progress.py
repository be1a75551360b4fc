"""How progress is shown on stderr: a bar, a line now and then, or JSON lines.

    shown(mode) -> an object with step(progress) and close(), or None;  shown(mode, of=CAMPAIGN) the same for a campaign

A run's `progress` has `replicate` (from 0), `replicates`, `time` and `duration` (simulated, s) and `wall` (s since the
start); a campaign's has `done`, `failed` and `total` (replicates), `wall` and `left` (s to come, or None).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import click

MODES: Final = ("auto", "bar", "plain", "json", "none")


class Shown(Protocol):
    """What shows progress."""

    def step(self, progress: Any) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Kind:
    """What progress of one kind of work is made of: how much is done of how much, a word on it, and its lines."""

    done: Callable[[Any], float]
    total: Callable[[Any], float]
    words: Callable[[Any], str]
    shape: str
    plain: Callable[[Any], str]
    json: Callable[[Any], str]

    def share(self, progress: Any) -> float:
        """How much is done, from 0 to 1."""
        total = self.total(progress)
        return min(1.0, self.done(progress) / total) if total else 1.0


class _Bar:
    """One line on the terminal, redrawn."""

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        self._bar: Any = None

    def step(self, progress: Any) -> None:
        from tqdm import tqdm

        total = self._kind.total(progress)
        if self._bar is None:
            self._bar = tqdm(total=total, desc="wsnsim", bar_format=self._kind.shape, leave=False, file=sys.stderr)
        self._bar.total = total
        self._bar.n = self._kind.share(progress) * total
        self._bar.set_postfix_str(self._kind.words(progress))

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


class _Lines:
    """A line now and then: every 10 % or 30 s, or at every call."""

    def __init__(self, kind: Kind, line_of: Callable[[Any], str], every: bool) -> None:
        self._kind = kind
        self._line_of = line_of
        self._every = every
        self._tenths = 0
        self._wall = 0.0

    def step(self, progress: Any) -> None:
        tenths = int(10 * self._kind.share(progress) + 1e-9)
        if self._every or tenths > self._tenths or progress.wall - self._wall >= 30:
            self._tenths, self._wall = tenths, progress.wall
            click.echo(self._line_of(progress), err=True)

    def close(self) -> None:
        """Nothing stays open."""


def _speed(progress: Any) -> float:
    """Simulated seconds a second."""
    return (progress.replicate * progress.duration + progress.time) / max(progress.wall, 1e-9)


def _run_line(progress: Any) -> str:
    share = RUN.share(progress)
    left = f", about {progress.wall / share - progress.wall:.0f} s left" if share else ""
    runs = f"replicate {progress.replicate + 1} of {progress.replicates}, " if progress.replicates > 1 else ""
    time = f"{progress.time:.4g} of {progress.duration:.4g} s"
    return f"wsnsim: {100 * share:.0f} % ({runs}{time}, {_speed(progress):.3g} × real time{left})"


def _run_json(progress: Any) -> str:
    names = ("replicate", "replicates", "time", "duration", "wall")
    return json.dumps({name: getattr(progress, name) for name in names} | {"share": RUN.share(progress)})


def _campaign_words(progress: Any) -> str:
    return f", {progress.failed} failed" if progress.failed else ""


def _campaign_line(progress: Any) -> str:
    left = (
        f", about {clock(progress.left)} left" if progress.left is not None and progress.done < progress.total else ""
    )
    words = f"{progress.done} of {progress.total} replicates done, {progress.failed} failed"
    return f"wsnsim: {100 * CAMPAIGN.share(progress):.0f} % ({words}, {clock(progress.wall)}{left})"


def _campaign_json(progress: Any) -> str:
    names = ("done", "failed", "total", "wall", "left")
    return json.dumps({name: getattr(progress, name) for name in names} | {"share": CAMPAIGN.share(progress)})


def clock(seconds: float) -> str:
    """A time as people say it: 45 s, 12 min, 3 h 20 min."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 120:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min" if minutes < 2880 else f"{minutes / 1440:.1f} days"


RUN: Final = Kind(
    done=lambda p: p.replicate * p.duration + p.time,
    total=lambda p: p.replicates * p.duration,
    words=lambda p: f"{_speed(p):.3g} × real time",
    shape="{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s simulated [{elapsed}<{remaining}{postfix}]",
    plain=_run_line,
    json=_run_json,
)
CAMPAIGN: Final = Kind(
    done=lambda p: p.done,
    total=lambda p: p.total,
    words=_campaign_words,
    shape="{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} replicates [{elapsed}<{remaining}{postfix}]",
    plain=_campaign_line,
    json=_campaign_json,
)


def shown(mode: str, of: Kind = RUN) -> Shown | None:
    """What shows progress; None if nothing does."""
    if mode == "none":
        return None
    if mode == "auto":
        mode = "bar" if sys.stderr is not None and sys.stderr.isatty() else "plain"
    return _Bar(of) if mode == "bar" else _Lines(of, of.json if mode == "json" else of.plain, every=mode == "json")
