"""The commands that run a scenario, and that show a run, a campaign or a result in a browser."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from wsnsim.base.errors import UsageError
from wsnsim.base.process import gc_disabled
from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import RUN, display
from wsnsim.cli.shared import (
    echo,
    echo_answer,
    group,
    is_campaign,
    loaded,
    not_the_result,
    reading,
    seconds_of,
    writable,
)

if TYPE_CHECKING:
    from wsnsim.scenario.schema import Scenario
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


run_options = shared.with_options(
    shared.overrides_option,
    click.option("--replicates", type=click.IntRange(min=1), metavar="N", help="Number of Monte Carlo runs."),
    shared.seed_option,
    click.option("--out", "-o", type=shared.PATH, metavar="FILE.h5", help="Result file; default results/NAME.h5."),
    shared.bounds_option,
    click.option("--report", "with_page", is_flag=True, help="Also write the HTML page, beside the result."),
    shared.plugins_option,
    shared.json_option,
    shared.batch_option,
    shared.quiet_option,
    shared.progress_option,
    shared.timeout_option,
)
"""The options that `run` and `watch` share."""


@group.command()
@click.argument("source", metavar="SCENARIO")
@click.option("--watch", "live", is_flag=True, help="Show the run in a browser while it computes, as `wsnsim watch`.")
@run_options
@click.pass_obj
def run(interrupts: Interrupts, /, source: str, live: bool, **given: Any) -> None:
    """Run a scenario and write its result."""
    run_scenario(source, SimpleNamespace(**given), interrupts, LiveOptions() if live else None)


def run_scenario(source: str, options: Any, interrupts: Interrupts, live: LiveOptions | None = None) -> None:
    """Run a scenario, write its result and print its summary; with `live` options, show it in a browser meanwhile.

    `options`: the values of `run_options` by name.
    """
    seeded = options.overrides if options.seed is None else (*options.overrides, f"seed={options.seed}")
    scenario = loaded(source, seeded, options.plugins)
    limit = None if options.timeout is None else seconds_of("--timeout", options.timeout)
    path = writable(options.out, Path("results") / f"{scenario.name}.h5")
    page = _page_path(path) if options.with_page else None
    with gc_disabled():
        import wsnsim.experiment as experiment
        from wsnsim.analysis.summary_text import summary_of
        from wsnsim.papers import published
        from wsnsim.recording.atomic_files import sole_writer

    talks = not options.quiet and options.progress not in ("json", "none")
    if talks:
        _say_notes(scenario, options.replicates or scenario.replicates, options.batch)

    def view_at(port: int) -> Any:
        from wsnsim.watch.run_view import RunView

        return RunView(scenario.name, port)

    with shown_live(live, view_at) as view:
        with (
            sole_writer(path),
            contextlib.closing(display("none" if options.quiet else options.progress, RUN)) as shown,
        ):
            report = experiment.run(
                scenario, replicates=options.replicates, out=path, command_line=shared.command_line(),
                progress=view.reporting(shown.step) if view else shown.step,
                on_compile=partial(echo, "wsnsim: compiling kernels, once ...", True) if talks else None,
                batch=options.batch, watched=view and view.recorder, timeout=limit,
            )  # fmt: skip
        if talks and report.compiled:
            echo(f"wsnsim: compiling kernels, once: {report.compiled:.1f} s, no part of the CPU time", err=True)
        echo_answer(summary_of(report, published, options.bounds, options.as_json))
        if talks:
            _say_residuals(scenario, path)
        if page:
            _write_page(path, page, options)
        if view and live:
            show_result(view, live, path, page, options.quiet, interrupts)


def _write_page(result: Path, page: Path, options: Any) -> None:
    """Write the page of a result that has just been made, whose plug-ins may therefore be imported."""
    import wsnsim.report as pages
    from wsnsim.papers import published

    written = pages.write([result], page, published=published, plugins=True, bounds=options.bounds)
    if not options.quiet:
        echo(f"wsnsim: {written.path}: {written.size / 1e6:.2f} MB; open it in a browser", err=True)


def _say_notes(scenario: Scenario, replicates: int, batch: bool) -> None:
    """Print, before the runs of a scenario, what is hardly meant in it, and how large they are if that is much."""
    from wsnsim.analysis import notes, recording_notes, run_size
    from wsnsim.scenario import build

    setup = build(scenario)
    size = run_size.run_size(setup, replicates, batch)
    for said in recording_notes.residuals(setup):
        echo(f"wsnsim: {said}", err=True)
    for note in (*notes.before_a_run(setup), run_size.warning(size, run_size.free_memory())):
        if note:
            echo(f"wsnsim: note: {note}", err=True)


def _say_residuals(scenario: Scenario, result: Path) -> None:
    """Print, after the runs of a scenario without a recorded trajectory, how recorded readings fit its estimates."""
    from wsnsim.analysis import recording_notes
    from wsnsim.scenario import build

    for said in recording_notes.residuals(build(scenario), result):
        echo(f"wsnsim: {said}", err=True)


def _page_path(result: Path) -> Path:
    """The path of the result's page.

    Raises:
        UsageError: the page cannot be written there. It is checked before anything runs.
    """
    page = result.with_suffix(".html")
    return not_the_result(writable(page, Path(page.name), "--report:"), result, "page")


OF_CAMPAIGNS = ("port", "browser", "ends", "metric", "column", "quiet", "source", "out")
"""Options that also have a meaning for a campaign."""
OF_RESULTS = ("port", "browser", "bounds", "plugins", "quiet", "source", "ends", "metric", "column")
"""Options that also have a meaning for a result, or are refused with a reason of their own."""


@group.command()
@click.argument("source", metavar="SCENARIO|SWEEP|DIR|FILE.h5")
@live_options
@click.option("--metric", metavar="NAME", help="Of a campaign: the column of runs to plot; default rmse.")
@click.option("--column", metavar="KEY", help="Of a campaign: the swept key on the axis.")
@run_options
@click.pass_obj
def watch(
    interrupts: Interrupts, /, source: str, port: int, browser: bool, ends: bool, metric: str | None,
    column: str | None, **given: Any,
) -> int | None:  # fmt: skip
    """Show a run, a campaign or a result in a browser.

    The page is served to this machine only. It shows a run while it computes, and then its result, until Ctrl-C.
    A campaign is one that another process runs, or has run: DIR is its folder. The folder of a SWEEP is results/NAME,
    or that of --out. FILE.h5 is a result, whose page is shown.
    """
    live = LiveOptions(port, browser, ends)
    from wsnsim.scenario.texts import is_result

    if not Path(source).is_dir() and is_result(source):
        again = f"a result; to run its scenario: wsnsim run {source} --watch"
        shared.demand_meaning(OF_RESULTS.__contains__, again)
        _demand_campaign(metric, column)
        _show_result(Path(source), live, interrupts, given)
        return None
    folder = _folder(source, given["out"])
    if folder is None:
        _demand_campaign(metric, column)
        run_scenario(source, SimpleNamespace(**given), interrupts, live)
        return None
    shared.demand_meaning(OF_CAMPAIGNS.__contains__, "a campaign, which another process runs")
    return _follow(folder, metric or "rmse", column, live, interrupts, given["quiet"])


def _folder(source: str, out: Path | None) -> Path | None:
    """The folder of the campaign to follow, None if the source is a scenario."""
    if is_campaign(source):
        return Path(source)
    from wsnsim.scenario.sweep import is_sweep, load_sweep

    if not is_sweep(source):
        return None
    folder = out or Path("results") / load_sweep(source).name
    if not is_campaign(str(folder)):
        raise UsageError(f"{folder}: holds no campaign yet; start it in another terminal: wsnsim sweep {source}")
    return folder


def _demand_campaign(metric: str | None, column: str | None) -> None:
    if metric or column:
        raise UsageError("--metric and --column need a campaign")


def _show_result(result: Path, live: LiveOptions, interrupts: Interrupts, given: dict[str, Any]) -> None:
    """Serve the page of a result until Ctrl-C.

    Raises:
        UsageError: the command would end at once.
        ResultError: the file cannot be read.
    """
    import wsnsim.recording as recording
    from wsnsim.watch.server import page_server

    recording.attributes(result)
    if live.ends:
        raise UsageError(f"--exit: {result} is a result, whose run has ended; wsnsim report {result} writes its page")
    with reading(result):
        page = page_of(result, None, given["plugins"], given["bounds"])
    with shown_live(live, partial(page_server, page)):
        linger("", given["quiet"], interrupts)


def _follow(
    folder: Path, metric: str, column: str | None, live: LiveOptions, interrupts: Interrupts, quiet: bool
) -> int:
    from wsnsim.recording.folder import Folder
    from wsnsim.watch.campaign_view import CampaignView

    with shown_live(live, partial(CampaignView, Folder(folder), metric, column)) as view:
        stay(interrupts, lambda: view.follow(until_complete=live.ends))
        if not quiet:
            echo(f"wsnsim: {folder}: {view.state()}", err=True)
    return 0
