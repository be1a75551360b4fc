"""What a command shows in a browser while it computes, and how it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, final

import click

from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.shared import echo

if TYPE_CHECKING:
    from wsnsim.base.runs import Progress
    from wsnsim.base.tables import Recorder
    from wsnsim.recording.folder import Folder
    from wsnsim.watch.campaign_view import CampaignView
    from wsnsim.watch.run_view import RunView


class LiveOptions(NamedTuple):
    """How a live view is served: its port, whether a browser is opened, and whether it ends with what it shows."""

    port: int = 0
    browser: bool = True
    ends: bool = False


live_options = shared.with_options(
    click.option(
        "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port of the server; default a free one."
    ),
    click.option(
        "--no-browser", "browser", is_flag=True, flag_value=False, default=True, help="Only print the address."
    ),
    click.option("--exit", "ends", is_flag=True, help="End with the run or the campaign; without it, end at Ctrl-C."),
)
"""The options of a live view."""


@final
class LiveRun:
    """The live view of a run; without a view, nothing is shown.

    Attributes:
        recorder: what makes the recorder through which the run is watched, None if nobody watches.
    """

    def __init__(self, view: RunView | None, options: LiveOptions) -> None:
        self._view, self._options = view, options
        self.recorder: Callable[[Recorder], Recorder] | None = view.recorder if view else None

    def reporting(self, step: Callable[[Progress], None]) -> Callable[[Progress], None]:
        """A function that passes on the progress, also to the view."""

        def report(progress: Progress) -> None:
            if self._view:
                self._view.report(progress)
            step(progress)

        return report

    def show_result(self, result: Path, page: Path | None, quiet: bool, interrupts: Interrupts) -> None:
        """Show the page of the result until the user has seen enough."""
        if self._view is None or (self._options.ends and not self._view.has_tab):
            return
        self._view.finish(page_of(result, page, plugins=True))
        if self._options.ends:
            self._view.wait_for_tabs()
        else:
            if not quiet:
                echo("wsnsim: the address now shows the result; Ctrl-C ends the server", err=True)
            stay(interrupts, threading.Event().wait)


@contextlib.contextmanager
def shown_live(title: str, options: LiveOptions | None) -> Iterator[LiveRun]:
    """The live view of a run, whose server is closed at the end; one that shows nothing without options."""
    if options is None:
        yield LiveRun(None, LiveOptions())
        return
    from wsnsim.watch.run_view import RunView

    with RunView(title, options.port) as view:
        say_where(view.url, options)
        yield LiveRun(view, options)


@final
class LiveCampaign:
    """The live view of a campaign that this process runs; without a view, nothing is shown."""

    def __init__(self, view: CampaignView | None = None) -> None:
        self._view = view

    def following(self) -> contextlib.AbstractContextManager[None]:
        """A context in which the view follows the campaign's folder."""
        return self._view.following() if self._view else contextlib.nullcontext()

    def show_end(self, quiet: bool, interrupts: Interrupts) -> None:
        """Show the last state until the user has seen enough."""
        if self._view is None:
            return
        if not quiet:
            echo("wsnsim: the address still shows the campaign; Ctrl-C ends the server", err=True)
        stay(interrupts, self._wait)

    def _wait(self) -> None:
        assert self._view, "there is a view"
        self._view.look()
        threading.Event().wait()


@contextlib.contextmanager
def campaign_shown_live(folder: Folder, metric: str, options: LiveOptions | None) -> Iterator[LiveCampaign]:
    """The live view of a campaign, whose server is closed at the end; one that shows nothing without options."""
    if options is None:
        yield LiveCampaign()
        return
    from wsnsim.watch.campaign_view import CampaignView

    with CampaignView(folder, metric, port=options.port) as view:
        say_where(view.url, options)
        yield LiveCampaign(view)


def show_page(page: str, options: LiveOptions, quiet: bool, interrupts: Interrupts) -> None:
    """Serve a page until Ctrl-C."""
    from wsnsim.watch.server import page_server

    with page_server(page, options.port) as server:
        say_where(server.url, options)
        if not quiet:
            echo("wsnsim: Ctrl-C ends the server", err=True)
        stay(interrupts, threading.Event().wait)


def say_where(url: str, options: LiveOptions) -> None:
    """Print the address of a view, and open it in a browser if there is a terminal and a screen."""
    echo(f"wsnsim: watch at {url}", err=True)
    has_screen = sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    if options.browser and has_screen and sys.stderr is not None and sys.stderr.isatty():
        import webbrowser

        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def stay(interrupts: Interrupts, wait: Callable[[], object]) -> None:
    """Wait. Ctrl-C is then the usual end; another signal is reported as always."""
    try:
        wait()
    except KeyboardInterrupt:
        if interrupts.number != signal.SIGINT:
            raise


def page_of(result: Path, page: Path | None, plugins: bool, bounds: bool = False) -> str:
    """The page of a result, from the file if it was written. `plugins`: whether what the result names is imported."""
    if page is not None:
        return page.read_text(encoding="utf-8")
    import tempfile

    import wsnsim.report as pages
    from wsnsim.papers import published

    with tempfile.TemporaryDirectory(prefix="wsnsim-") as folder:
        written = pages.write([result], Path(folder) / "page.html", published=published, plugins=plugins, bounds=bounds)
        return written.path.read_text(encoding="utf-8")
