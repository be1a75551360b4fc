"""The live view of a campaign: its progress as read from its folder, and its curves as they form.

    with CampaignView(folder) as view: view.follow()                 another process runs the campaign
    with CampaignView(folder) as view, view.following(): run it      this process runs it

The folder is only read. What the page asks for is answered from what was read last.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from statistics import median_high
from typing import Any, Final, NamedTuple, final

import numpy as np

from wsnsim.analysis import campaigns
from wsnsim.analysis.campaign_info import ReplicateCounts, label
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.recording.folder import Folder
from wsnsim.report.html_page import script_of, static_text
from wsnsim.report.svg_figures import SvgFigure, sweep_svgs
from wsnsim.watch.run_view import page
from wsnsim.watch.server import HttpAnswer, WatchServer

MOST_POINTS: Final = 300
"""Points, and failures, that are listed (our choice)."""


class PointState(NamedTuple):
    """One point: its settings, runs on disk, failed and wanted, and the median processor time of a run (s)."""

    settings: str
    done: int
    failed: int
    wanted: int
    seconds: float | None = None


@dataclass(frozen=True)
class CampaignState:
    """A campaign as it is on disk.

    Attributes:
        name: its name.
        points: its points, at most `MOST_POINTS`.
        done: runs on disk, `failed` those that failed, of `total`.
        running: tasks that a process has begun and not finished.
        failures: {task: first line of the reason}, at most `MOST_POINTS`.
    """

    name: str
    points: tuple[PointState, ...]
    done: int
    failed: int
    total: int
    running: int
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether each run is on disk or has failed."""
        return self.done + self.failed >= self.total


def campaign_state(folder: Folder) -> CampaignState:
    """The state of a campaign.

    Raises:
        ResultError: the folder cannot be read.
    """
    manifest = folder.manifest()
    rule, seconds = ReplicateCounts(folder, manifest), _seconds(folder)
    points = []
    for number, point in enumerate(manifest.points):
        wanted, done, failed = rule.wanted(point), folder.done(point.id), folder.given_up(point.id)
        settings = ", ".join(f"{key} = {label([value])}" for key, value in point.settings.items())
        found, lost = (sum(run < wanted for run in runs) for runs in (done, failed))
        points.append(PointState(settings or "the scenario unchanged", found, lost, wanted, seconds.get(number)))
    reasons = list(folder.failures().items())[:MOST_POINTS]
    return CampaignState(
        name=manifest.name,
        points=tuple(points[:MOST_POINTS]),
        done=sum(point.done for point in points),
        failed=sum(point.failed for point in points),
        total=sum(point.wanted for point in points),
        running=sum(1 for _ in folder.path.glob("running/*.log")),
        failures={task: (why.splitlines() or [""])[0] for task, why in reasons},
    )


def _seconds(folder: Folder) -> dict[int, Any]:
    """{number of a point: median processor time of its runs in s}, of the points with results."""
    try:
        runs = campaigns.read(folder.path, "runs", ["cpu_seconds"])
    except ResultError:  # no results yet, or a file that is just being written
        return {}
    medians = runs.groupby(campaigns.POINT)["cpu_seconds"].median()
    return {int(point): float(value) for point, value in medians.items() if np.isfinite(value)}


PAUSE: Final = 1.0
"""Seconds between two looks at the folder."""
SHARE: Final = 0.2
"""The share of the time that reading and plotting may take (our choice)."""
OPEN: Final = 5.0
"""Seconds that tabs get to fetch the last state before the server is closed."""
SVG_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"


@final
class CampaignView(WatchServer):
    """A server that shows a campaign's folder.

    Args:
        folder: the campaign's folder.
        metric: the column of `runs` that is plotted.
        column: the swept key on the axis; by default the numeric key with the most values.
        port: port of the loopback interface; 0 chooses a free one.

    Raises:
        ResultError: the folder holds no campaign.
        UsageError: there is no such metric or key, or the port cannot be used.
    """

    def __init__(self, folder: Folder, metric: str = "rmse", column: str | None = None, port: int = 0) -> None:
        self._folder, self._metric, self._column = folder, metric, column
        self._state = campaign_state(folder)
        self._curves: list[SvgFigure] = []
        self._left_out: dict[str, str] = {}
        self._version, self._why = 0, "There are no results yet."
        self._drawn_at = -1
        self._began, self._first = time.monotonic(), self._state.done
        self._looked, self._computes = threading.Event(), False
        self._draw()
        self._page = page("campaign.html", self._state.name, script_of([static_text("campaign.js", "wsnsim.watch")]))
        super().__init__(self._answer, port)

    def state(self) -> str:
        """The state of the campaign in one line."""
        state = self._state
        failed = f", {state.failed} failed" if state.failed else ""
        return f"{state.done} of {state.total} runs done{failed}, at {len(state.points)} points"

    def follow(self, until_complete: bool = False) -> None:
        """Look at the folder again and again, for ever or until the campaign is complete."""
        self._look_until(threading.Event(), until_complete)
        if self._looked.is_set():  # a tab is open: it gets the last state
            self._looked.clear()
            self._looked.wait(OPEN)

    @contextlib.contextmanager
    def following(self) -> Iterator[None]:
        """Look at the folder in a thread of its own while the block runs the campaign."""
        ended = threading.Event()
        thread = threading.Thread(target=self._look_undisturbing, args=(ended,), name="watch campaign", daemon=True)
        self._computes = True
        thread.start()
        try:
            yield
        finally:
            self._computes = False
            ended.set()
            thread.join()

    def _look_undisturbing(self, ended: threading.Event) -> None:
        """Look until the end; what cannot be shown is no reason to disturb the campaign."""
        try:
            self._look_until(ended)
        except Exception as error:
            self._why = f"The campaign goes on, but cannot be shown any further: {type(error).__name__}: {error}"

    def _look_until(self, ended: threading.Event, until_complete: bool = False) -> None:
        pause = 0.0
        while not ended.wait(pause) and not (until_complete and self._state.complete):
            began = time.monotonic()
            self.look()
            pause = max(PAUSE, (time.monotonic() - began) * (1 / SHARE - 1))

    def look(self) -> None:
        """Read the folder, and plot the curves if there are more runs."""
        try:
            self._state = campaign_state(self._folder)
            self._draw()
        except ResultError as error:  # the folder was moved, or a file is just being replaced
            self._why = str(error)

    def _draw(self) -> None:
        done = self._state.done
        if done == self._drawn_at or not done:
            return
        try:
            self._curves, self._left_out = sweep_svgs(self._folder, self._metric, self._column)
            self._why = ""
        except UsageError as error:
            if self._column or self._metric != "rmse":
                raise
            self._why = str(error)
        self._drawn_at, self._version = done, self._version + 1

    def _answer(self, name: str, given: Mapping[str, str]) -> HttpAnswer | None:
        if name == "":
            return self._page
        if name == "state":
            self._looked.set()
            return HttpAnswer.json(self._told())
        found = next((curve for curve in self._curves if name == f"{curve.name}.svg"), None)
        return HttpAnswer(found.svg.encode(), "image/svg+xml", SVG_POLICY) if found else None

    def _told(self) -> dict[str, Any]:
        """The state as the page takes it."""
        state = self._state
        known = [point.seconds for point in state.points if point.seconds is not None]
        return vars(state) | {
            "computes": self._computes, "complete": state.complete, "left": self._left(state),
            "seconds": median_high(known) if known else None, "failures": list(state.failures.items()),
            "version": self._version, "why": self._why, "left_out": list(self._left_out.items()),
            "curves": [[curve.name, curve.label] for curve in self._curves],
        }  # fmt: skip

    def _left(self, state: CampaignState) -> float | None:
        """Estimated seconds until the end, from the runs that were finished since the view began."""
        new = state.done - self._first
        if new <= 0 or state.complete:
            return None
        return (time.monotonic() - self._began) / new * (state.total - state.done - state.failed)
