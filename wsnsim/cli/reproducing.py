"""The command of the papers: reproduce."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, MODES, shown
from wsnsim.cli.session import INCOMPLETE
from wsnsim.cli.shared import echo_json, group, json_option

if TYPE_CHECKING:
    from wsnsim.campaign import Ended
    from wsnsim.papers.reproduction import Experiment

FEW: Final = 3
"""Reasons that are told."""


@group.command()
@click.argument("papers", metavar="[PAPER]...", nargs=-1)
@click.option("--quick/--full", "quick", default=True, show_default=True, help="Few runs; or as many as the papers'.")
@click.option("--out", "-o", type=click.Path(path_type=Path), default=Path("results/reproduce"), show_default=True,
              metavar="DIR", help="Folder of the campaigns.")  # fmt: skip
@click.option("--figures", type=click.Path(path_type=Path), metavar="DIR", help="Draw the papers' figures there, too.")
@click.option("--only", metavar="EXPERIMENT", help="Only this experiment: table_2, figure_3, ...")
@click.option("--jobs", "-j", type=click.IntRange(1, 1024), metavar="N", help="Worker processes; default all cores.")
@json_option
@click.option("--markdown", is_flag=True, help="Answer with the main rows as a table of Markdown.")
@click.option("--quiet", "-q", is_flag=True, help="No progress and no log.")
@click.option("--progress", type=click.Choice(MODES), default="auto", show_default=True, help="How to show it.")
@click.pass_obj
def reproduce(interrupts: Interrupts, papers: tuple[str, ...], quick: bool, out: Path, figures: Path | None,
              only: str | None, jobs: int | None, as_json: bool, markdown: bool, quiet: bool,
              progress: str) -> int:  # fmt: skip
    """Run the tables and figures of the papers: published, measured, possible, and a verdict on each.

    PAPER is jiang2013, liu2012, wei2022, ruan2020 or li2012; by default all of them. `frontier` is a page of our own:
    error against joules of every tracker on one field. What has been run is not run again.
    """
    from wsnsim.papers import digest, table
    from wsnsim.papers import reproduce as reproducing

    if as_json and markdown:
        raise UsageError("--json and --markdown: one of them, please")
    chosen = reproducing.chosen(papers, only)
    if figures:
        _demand_folder(figures)
    where = out / ("quick" if quick else "full")
    for paper, experiment in chosen:  # before anything runs: each folder must be one that can be gone on with
        reproducing.begin(paper, experiment, where, full=not quick)
    found, said, code = [], [], 0
    with interrupts.noted() as stop:
        job = _Job(where, jobs, not quick, "none" if quiet else progress, stop)
        for number, (paper, experiment) in enumerate(chosen, 1):
            if not quiet and progress != "json":
                click.echo(
                    f"wsnsim: {number} of {len(chosen)}: {paper}, {experiment.name}: {experiment.title}", err=True
                )
            ended = job.run(paper, experiment)
            if interrupts.number:
                break
            folder = reproducing.place(where, paper, experiment)
            if not ended.complete or ended.stopped:
                code = INCOMPLETE
                _say_incomplete(folder, ended)
                continue
            try:
                rows, lines = reproducing.rows(paper, experiment, folder), reproducing.lines(experiment, folder)
            except ResultError:
                if not job.mend(paper, experiment, folder):
                    raise
                rows, lines = reproducing.rows(paper, experiment, folder), reproducing.lines(experiment, folder)
            found += rows
            said += lines
            if figures:
                for picture in reproducing.draw(paper, experiment, folder, figures):
                    click.echo(f"wsnsim: {picture}", err=True)
    if interrupts.number:
        click.echo(f"wsnsim: {interrupts.words}; the same command goes on", err=True)
        return interrupts.code
    if as_json:
        echo_json({"schema_version": 1, "rows": reproducing.as_json(found), "lines": said})
    else:
        words = [digest.markdown(found, said)] if markdown else [table.text(found), "\n".join(said)]
        click.echo("\n\n".join(filter(None, words)))
    return code


@dataclass(frozen=True)
class _Job:
    """How experiments are run: where, by how many processes, at which number of runs, and how progress is shown."""

    where: Path
    jobs: int | None
    full: bool
    progress: str
    stop: Callable[[], bool]

    def run(self, paper: str, experiment: Experiment) -> Ended:
        """Run what is missing of an experiment."""
        from wsnsim.papers import reproduce as reproducing

        show = shown(self.progress, of=CAMPAIGN)
        with contextlib.closing(show) if show else contextlib.nullcontext():
            return reproducing.run(
                paper, experiment, self.where, self.jobs, full=self.full, watch=show.step if show else None,
                stop=self.stop,
            )  # fmt: skip

    def mend(self, paper: str, experiment: Experiment, folder: Path) -> bool:
        """Put aside what is damaged, and run it again; whether all is whole now that was not."""
        from wsnsim.papers import reproduce as reproducing

        moved = reproducing.set_aside(folder)
        for place in moved:
            click.echo(f"wsnsim: {place}: was damaged, and is put aside: its replicates are run again", err=True)
        return bool(moved) and self.run(paper, experiment).complete


def _demand_folder(place: Path) -> None:
    """Raise UsageError, before anything runs, if figures cannot be written there."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        if not os.access(place, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise UsageError(f"--figures {place}: {error.strerror or error}") from None


def _say_incomplete(folder: Path, ended: Ended) -> None:
    lacking = sum(map(len, ended.missing.values()))
    reasons = list(dict.fromkeys(filter(None, [ended.stopped, *ended.failed.values()])))[:FEW]
    click.echo(f"wsnsim: {folder} is incomplete, {lacking} replicates are missing; the same command goes on", err=True)
    for reason in reasons:
        click.echo(f"wsnsim: {reason}", err=True)
