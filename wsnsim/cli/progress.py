"""Progress on stderr: a bar, a line from time to time, or JSON lines.

`display(mode, of)` gives an object with `step(progress)` and `close()`. The progress of a run has `replicate` (from
0), `replicates`, `time` and `duration` (simulated, s), `wall` (s since the start) and `left` (estimated s until the
end, or None). The progress of a campaign has `done`, `failed` and `total` (runs), `wall` and `left`. Other work has a
`WorkBar`.
Progress that cannot be shown, because stderr is full or closed, is left out.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, final

import click

from wsnsim.cli.interrupts import ENDED, tell

MODES: Final = ("auto", "bar", "plain", "json", "none")
INTERVAL: Final = 30.0
"""Seconds after which a line is printed although less than 10 % more is done."""


class ProgressDisplay:
    """Shows progress; this one shows nothing."""

    def step(self, progress: Any) -> None:
        """Show the progress."""

    def close(self) -> None:
        """Remove what must not stay on the terminal."""


@dataclass(frozen=True)
class ProgressFormat:
    """How the progress of one kind of work is formatted.

    Attributes:
        done: how much is done.
        total: how much there is.
        postfix: a note behind the bar.
        bar: the bar in tqdm's format.
        fields: the attributes that JSON lines hold.
        line: a line of text.
    """

    done: Callable[[Any], float]
    total: Callable[[Any], float]
    postfix: Callable[[Any], str]
    bar: str
    fields: tuple[str, ...]
    line: Callable[[Any], str]

    def share(self, progress: Any) -> float:
        """How much is done, from 0 to 1."""
        total = self.total(progress)
        return min(1.0, self.done(progress) / total) if total else 1.0

    def json(self, progress: Any) -> str:
        """A line of JSON."""
        return json.dumps({name: getattr(progress, name) for name in self.fields} | {"share": self.share(progress)})


@final
class _ProgressBar(ProgressDisplay):
    """One line on the terminal, redrawn."""

    def __init__(self, form: ProgressFormat) -> None:
        self._form = form
        self._bar: Any = None

    def step(self, progress: Any) -> None:
        from tqdm import tqdm

        total = self._form.total(progress)
        if self._bar is None:
            file: Any = _Stderr()
            self._bar = tqdm(
                total=total, desc="wsnsim", bar_format=self._form.bar, leave=False, file=file, dynamic_ncols=True
            )
        self._bar.total = total
        self._bar.n = self._form.share(progress) * total
        self._bar.set_postfix_str(self._form.postfix(progress))

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


@final
class _Stderr:
    """Stderr of which tqdm sees no error: a bar whose first drawing fails would fail again when it is removed."""

    def write(self, text: str) -> None:
        with contextlib.suppress(*ENDED):
            sys.stderr.write(text)

    def flush(self) -> None:
        with contextlib.suppress(*ENDED):
            sys.stderr.flush()

    def fileno(self) -> int:
        """The number by which tqdm asks for the terminal's width; it takes a default if there is none."""
        return sys.stderr.fileno()

    @property
    def encoding(self) -> str:
        """Without blocks in it, tqdm draws the bar in ASCII."""
        return sys.stderr.encoding or "ascii"


@final
class _ProgressLines(ProgressDisplay):
    """A line for every 10 % or 30 s, or for every step."""

    def __init__(self, form: ProgressFormat, line: Callable[[Any], str], every: bool) -> None:
        self._form = form
        self._line = line
        self._every = every
        self._tenths = 0
        self._wall = 0.0

    def step(self, progress: Any) -> None:
        tenths = int(10 * self._form.share(progress) + 1e-9)
        if self._every or tenths > self._tenths or progress.wall - self._wall >= INTERVAL:
            self._tenths, self._wall = tenths, progress.wall
            tell(self._line(progress))


def _speed(progress: Any) -> str:
    return f"{progress.simulated / max(progress.wall - progress.overhead, 1e-9):.3g} × real time"


def _left(progress: Any) -> str:
    return "" if progress.left is None else f"about {duration(progress.left)} left"


def _listed(*notes: str) -> str:
    return ", ".join(note for note in notes if note)


def _run_line(progress: Any) -> str:
    runs = f"run {progress.replicate + 1} of {progress.replicates}" if progress.replicates > 1 else ""
    time = f"{progress.time:.4g} of {progress.duration:.4g} s"
    notes = _listed(runs, time, _speed(progress), _left(progress))
    return f"wsnsim: {100 * RUN.share(progress):.0f} % ({notes})"


def _campaign_line(progress: Any) -> str:
    left = _left(progress) if progress.done < progress.total else ""
    counts = f"{progress.done} of {progress.total} runs done, {progress.failed} failed"
    return f"wsnsim: {100 * CAMPAIGN.share(progress):.0f} % ({_listed(counts, duration(progress.wall), left)})"


def duration(seconds: float) -> str:
    """A duration in common units: 45 s, 12 min, 3 h 20 min, 2.5 days."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 120:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min" if minutes < 2880 else f"{minutes / 1440:.1f} days"


RUN: Final = ProgressFormat(
    done=lambda p: p.simulated,
    total=lambda p: p.replicates * p.duration,
    postfix=lambda p: _listed(_speed(p), _left(p)),
    bar="{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s simulated [{elapsed}{postfix}]",
    fields=("replicate", "replicates", "time", "duration", "wall", "left"),
    line=_run_line,
)
CAMPAIGN: Final = ProgressFormat(
    done=lambda p: p.done,
    total=lambda p: p.total,
    postfix=lambda p: _listed(f"{p.failed} failed" if p.failed else "", _left(p)),
    bar="{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} runs [{elapsed}{postfix}]",
    fields=("done", "failed", "total", "wall", "left"),
    line=_campaign_line,
)
VISITS: Final = replace(
    CAMPAIGN,
    bar=CAMPAIGN.bar.replace("{total:.0f} runs", "at most {total:.0f} visits"),
    line=lambda p: _campaign_line(p).replace(" of ", " of at most ").replace("runs done", "visits done"),
)


WORK: Final = ProgressFormat(
    done=lambda p: p.done,
    total=lambda p: p.total,
    postfix=lambda p: p.what,
    bar="{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} [{elapsed}<{remaining}{postfix}]",
    fields=("what", "done", "total", "wall"),
    line=lambda p: f"wsnsim: {p.done} of {p.total} {p.what}",
)


@final
class WorkBar:
    """A bar for work that takes more than a second, such as reading files; it is removed when the work is done.

    There is none without a terminal, with --quiet, or with another --progress than `auto` and `bar`.
    """

    def __init__(self) -> None:
        self._bar: ProgressDisplay | None = None
        self._what = ""

    def step(self, progress: Any) -> None:
        """Show the progress."""
        if self._bar is not None and (progress.what != self._what or progress.done == progress.total):
            self.close()
        if progress.done < progress.total and (self._bar is not None or (progress.wall >= 1.0 and _bar_wanted())):
            self._bar, self._what = self._bar or display("bar", WORK), progress.what
            self._bar.step(progress)

    def close(self) -> None:
        """Remove the bar, if there is one: the work has ended, or failed."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def _bar_wanted() -> bool:
    """Whether the current command may show a bar."""
    context = click.get_current_context(silent=True)
    options = context.params if context else {}
    mode = options.get("progress", "auto")
    return not options.get("quiet") and (mode == "bar" or (mode == "auto" and _is_terminal()))


def _is_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def display(mode: str, of: ProgressFormat) -> ProgressDisplay:
    """The display of progress in one of the `MODES`; `auto` is a bar on a terminal and lines elsewhere."""
    if mode == "none":
        return ProgressDisplay()
    if mode == "auto":
        mode = "bar" if _is_terminal() else "plain"
    if mode == "bar":
        return _ProgressBar(of)
    return _ProgressLines(of, of.json if mode == "json" else of.line, every=mode == "json")
