"""The live view of a run: its page, and what the page asks for while the run computes.

    with RunView(title, runs, port) as view:
        report = experiment.run(scenario, out=path, progress=view.reporting(print), watched=view.recorder)
        view.finish(page)

The thread of the simulation only puts pieces into a queue. A thread of the view encodes them, and the server's threads
send what is encoded, so that no tab, however slow, holds up the run.
"""

from __future__ import annotations

import contextlib
import html
import itertools
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, Self, final

from wsnsim.base.rows import RunStart
from wsnsim.base.runs import Progress
from wsnsim.base.tables import Recorder
from wsnsim.report.html_page import filled, script_of, source_of, static_text
from wsnsim.watch.live_frames import INTERVAL, LiveFrames, LiveRecorder, RunPiece
from wsnsim.watch.server import HttpAnswer, WatchServer, answer_with_page

SCRIPTS: Final = ("replay_data.js", "tooltips.js", "drawing.js", "legend.js", "player.js")
LIVE_SCRIPTS: Final = ("live_data.js", "live_curves.js", "live.js")
MOST_SENT: Final = 2_000_000
"""Characters of frames in one answer; the rest comes with the next one."""
FAREWELL: Final = 5.0
"""Seconds that tabs get to fetch the result's page before the server is closed."""
OPEN: Final = 3.0
"""Seconds since its last request for which a tab is taken to be open."""
Queued = RunStart | RunPiece | None


@final
class RunView(WatchServer):
    """A server that shows one call of `experiment.run`.

    Args:
        title: name of the scenario.
        port: port of the loopback interface; 0 chooses a free one.
        interval: seconds between two looks at the run.
    """

    def __init__(self, title: str, port: int = 0, interval: float = INTERVAL) -> None:
        self._title, self._interval = title, interval
        self._queue: queue.SimpleQueue[Queued] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._frames: LiveFrames | None = None
        self._texts: list[str] = []
        self._run = 0
        self._note = ""
        self._progress: Progress | None = None
        self._final: HttpAnswer | None = None
        self._asked, self._given = -math.inf, threading.Event()
        sources = [*map(static_text, SCRIPTS), *(static_text(n, "wsnsim.watch") for n in LIVE_SCRIPTS)]
        self._page = page("run.html", title, script_of(sources))
        super().__init__(self._answer, port)
        self._encoder = threading.Thread(target=self._encode, name="watch frames", daemon=True)

    def __enter__(self) -> Self:
        self._encoder.start()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        self._queue.put(None)
        super().__exit__(*error)

    def recorder(self, file: Recorder) -> Recorder:
        """The recorder through which the run is watched."""
        return LiveRecorder(file, self._queue.put, self._queue.put, self._interval)

    def reporting(self, step: Callable[[Progress], None]) -> Callable[[Progress], None]:
        """A function that takes the progress, and passes it on."""

        def report(progress: Progress) -> None:
            self._progress = progress
            step(progress)

        return report

    def finish(self, page: str) -> None:
        """Show the page of the result instead."""
        self._final = answer_with_page(page)

    @property
    def has_tab(self) -> bool:
        """Whether a tab has asked for news lately."""
        return time.monotonic() - self._asked < OPEN

    def wait_for_tabs(self, most: float = FAREWELL) -> None:
        """Wait until an open tab has fetched the page of the result, but not for long."""
        if self.has_tab:
            self._given.wait(most)

    def _encode(self) -> None:
        """Encode what is in the queue; pieces that have come since the last time are encoded together."""
        while True:
            items: list[Any] = [self._queue.get()]
            with contextlib.suppress(queue.Empty):
                while True:
                    items.append(self._queue.get_nowait())
            for kind, group in itertools.groupby(items, type):
                if kind is RunStart:
                    self._begin(list(group)[-1])
                elif kind is RunPiece:
                    self._add(list(group))
                else:
                    return

    def _begin(self, start: Any) -> None:
        frames = LiveFrames(start)
        with self._lock:
            self._frames, self._texts, self._note = frames, [], ""
            self._run += 1

    def _add(self, pieces: list[Any]) -> None:
        if self._frames is None or self._note:
            return
        try:
            text = self._frames.add(pieces)
        except Exception as error:  # what a view cannot show is no reason to disturb the run
            self._note = f"The run goes on, but cannot be shown any further: {type(error).__name__}: {error}"
            return
        with self._lock:
            self._texts.append(text)

    def _answer(self, name: str, given: Mapping[str, str]) -> HttpAnswer | None:
        if name == "":
            if self._final is not None:
                self._given.set()
            return self._final or self._page
        if name == "state":
            self._asked = time.monotonic()
            return HttpAnswer.json(self._state(_number(given.get("run")), _number(given.get("from"))))
        return None

    def _state(self, run: int, first: int) -> dict[str, Any]:
        """What a tab does not know yet that has the first texts of a run."""
        state: dict[str, Any] = {"ended": self._final is not None, "note": self._note, **self._progress_now()}
        with self._lock:
            frames, texts = self._frames, self._texts
            if frames is None:
                return state | {"run": 0, "texts": []}
            begin = first if run == self._run and 0 <= first <= len(texts) + 1 else 0
            everything = [frames.head, *texts]
            state |= {
                "run": self._run, "from": begin, "error": _finite(frames.error),
                "rmse": _finite(frames.rmse), "joules": dict(frames.joules), "known": len(everything),
            }  # fmt: skip
        return state | {"texts": _as_many_as_fit(everything[begin:])}

    def _progress_now(self) -> dict[str, Any]:
        progress = self._progress
        if progress is None:
            return {"progress": None}
        simulated = progress.replicate * progress.duration + progress.time
        return {
            "progress": {
                "number": progress.replicate + 1, "runs": progress.replicates, "time": progress.time,
                "duration": progress.duration, "wall": progress.wall, "speed": simulated / max(progress.wall, 1e-9),
                "share": min(1.0, simulated / max(progress.replicates * progress.duration, 1e-9)),
            }
        }  # fmt: skip


def _number(text: str | None) -> int:
    return int(text) if text and text.isascii() and text.isdecimal() and len(text) < 10 else -1


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _as_many_as_fit(texts: list[str]) -> list[str]:
    """The first of the texts that together have at most `MOST_SENT` characters, and at least one."""
    size = 0
    for count, text in enumerate(texts):
        size += len(text)
        if size > MOST_SENT and count:
            return texts[:count]
    return texts


def page(template: str, title: str, script: str) -> HttpAnswer:
    """A page of this package, which may ask its own server only."""
    name = html.escape(title)
    style = static_text("style.css") + static_text("live.css", "wsnsim.watch")
    slots = {"title": name, "heading": f"<bdi>{name}</bdi>", "style": style, "script": script}
    policy = (
        f"default-src 'none'; script-src {source_of(script)}; style-src 'unsafe-inline'; connect-src 'self'; "
        "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return HttpAnswer(filled(static_text(template, "wsnsim.watch"), slots).encode(), policy=policy)
