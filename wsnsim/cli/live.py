"""What a command shows in a browser while it computes, and how it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.shared import echo

if TYPE_CHECKING:
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


@contextlib.contextmanager
def shown_live(options: LiveOptions | None, view: Callable[[int], Any]) -> Iterator[Any]:
    """The view at a port, whose server is closed at the end; None, so that nothing is shown, without options."""
    if options is None:
        yield None
        return
    with view(options.port) as shown:
        say_where(shown.url, options)
        yield shown


def show_result(
    view: RunView, options: LiveOptions, result: Path, page: Path | None, quiet: bool, interrupts: Interrupts
) -> None:
    """Show the page of the result of a run until the user has seen enough."""
    if options.ends and not view.has_tab:
        return
    view.finish(page_of(result, page, plugins=True))
    if options.ends:
        view.wait_for_tabs()
    else:
        linger("the address now shows the result; ", quiet, interrupts)


def linger(note: str, quiet: bool, interrupts: Interrupts, refresh: Callable[[], object] = lambda: None) -> None:
    """Serve the last state until Ctrl-C, after it was refreshed."""
    if not quiet:
        echo(f"wsnsim: {note}Ctrl-C ends the server", err=True)
    stay(interrupts, lambda: (refresh(), threading.Event().wait()))


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
