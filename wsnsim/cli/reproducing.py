"""The command that reproduces papers and runs studies."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, display
from wsnsim.cli.shared import INCOMPLETE, PATH, echo, echo_json, group

if TYPE_CHECKING:
    from wsnsim.campaign import CampaignOutcome
    from wsnsim.papers.reproduction import ClaimRow, Experiment
    from wsnsim.papers.study import Study

MAX_REASONS: Final = 3
"""Reasons of an incomplete campaign that are printed."""


@group.command()
@click.argument("sources", metavar="[STUDY]...", nargs=-1)
@click.option(
    "--quick/--full",
    "quick",
    default=True,
    show_default=True,
    help="Few runs, or enough for verdicts (200 for a mean).",
)
@click.option("--out", "-o", type=PATH, default=Path("results/reproduce"), show_default=True, metavar="DIR",
              help="Folder of the campaigns.")  # fmt: skip
@click.option("--figures", type=PATH, metavar="DIR", help="Also draw the figures into this folder.")
@click.option("--data", type=PATH, metavar="DIR", help="For `reality`: a folder of tracks with receivers.csv.")
@click.option("--only", metavar="EXPERIMENT", help="Run only this experiment: table_2, figure_3, ...")
@shared.jobs_option
@shared.batch_option
@shared.accept_code_option
@shared.json_option
@click.option("--markdown", is_flag=True, help="Print the main rows as a Markdown table.")
@shared.quiet_option
@shared.progress_option
@click.pass_obj
def reproduce(interrupts: Interrupts, sources: tuple[str, ...], quick: bool, out: Path, figures: Path | None,
              data: Path | None, only: str | None, jobs: int | None, batch: bool, accept_code_change: bool,
              as_json: bool, markdown: bool, quiet: bool, progress: str) -> int:  # fmt: skip
    """Run papers and studies; judge values, answer hypotheses.

    STUDY is a folder with study.yaml (`wsnsim new --for study NAME` writes one), or a paper: jiang2013, liu2012,
    wei2022, ruan2020 or li2012; these five by default. Each row shows the published value, the measured one, the bound
    and a verdict. Verdicts on means and RMSEs need 200 runs (--full). Finished runs are not repeated. The folder's
    study.py is imported.

    Three studies of our own have no paper. `frontier` compares error and energy of every tracker on one field.
    `reality` compares recorded readings with simulated ones, on the tracks that come with wsnsim or on those of --data.
    `duty_cycles` compares what trackers cost on radios that are off most of the time.
    """
    from wsnsim.papers import reproduce as reproducing
    from wsnsim.papers.study import study

    if as_json and markdown:
        raise UsageError("--json cannot be combined with --markdown")
    if data is not None and only is not None:
        raise UsageError("--only cannot be combined with --data")
    chosen = reproducing.chosen(sources, only) if data is None else reproducing.on_data(sources, data)
    if figures:
        _check_folder(figures)
    where = out / ("quick" if quick else "full")
    session = _ReproductionSession(where, jobs, not quick, batch, quiet, progress, figures)
    session.begin_all(chosen, accept_code_change)
    session.announce(chosen)
    code = session.run_all(chosen, interrupts)
    if not interrupts.number:
        session.print_answer(as_json, markdown, [study(source) for source in sources])
    return code


@dataclass(frozen=True)
class _ReproductionSession:
    """The experiments of one command: how they are run, and the rows and lines that they gave so far."""

    where: Path
    jobs: int | None
    full: bool
    batch: bool
    quiet: bool
    progress: str
    figures: Path | None
    rows: list[ClaimRow] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def begin_all(self, chosen: Sequence[tuple[str, Experiment]], accept_code_change: bool) -> None:
        """Begin all campaigns before one runs, so that a folder that cannot be used is found at once."""
        from wsnsim.papers import reproduce as reproducing

        for source, experiment in chosen:
            reproducing.begin(source, experiment, self.where, self.full, accept_code_change)

    def announce(self, chosen: Sequence[tuple[str, Experiment]]) -> None:
        """Print what will be run: experiments, their studies, runs, those that are on disk, and where."""
        from wsnsim.analysis.phrases import counted
        from wsnsim.papers import reproduce as reproducing
        from wsnsim.papers.study import study

        if self.quiet or self.progress == "json":
            return
        wanted, missing = reproducing.run_counts(chosen, self.where)
        names = ", ".join(dict.fromkeys(study(source).name for source, _ in chosen))
        there = f", {wanted - missing:,} of them on disk" if missing < wanted else ""
        echo(f"wsnsim: {counted(len(chosen), 'experiment')} of {names}: {counted(wanted, 'run')}{there}; "
             f"folder {self.where}", err=True)  # fmt: skip

    def run_all(self, chosen: Sequence[tuple[str, Experiment]], interrupts: Interrupts) -> int:
        """Run the experiments one after the other and return the exit code."""
        from wsnsim.papers import reproduce as reproducing
        from wsnsim.papers.study import study

        complete = True
        with interrupts.noted() as should_stop:
            for number, (source, experiment) in enumerate(chosen, 1):
                if not self.quiet and self.progress != "json":
                    name = f"{study(source).name}, {experiment.name}: {experiment.title}"
                    echo(f"wsnsim: {number} of {len(chosen)}: {name}", err=True)
                outcome = self.run(source, experiment, should_stop)
                if interrupts.number:
                    echo(f"wsnsim: {interrupts.reason}; repeat the command to resume", err=True)
                    return interrupts.code
                if outcome.complete and not outcome.stopped:
                    self.evaluate(source, experiment, should_stop)
                else:
                    complete = False
                    _print_incomplete(reproducing.folder_of(self.where, source, experiment), outcome)
        return 0 if complete else INCOMPLETE

    def run(self, source: str, experiment: Experiment, should_stop: Callable[[], bool]) -> CampaignOutcome:
        """Run what is missing of an experiment that was begun."""
        from wsnsim.papers import reproduce as reproducing
        from wsnsim.recording.folder import Folder

        with contextlib.closing(display("none" if self.quiet else self.progress, CAMPAIGN)) as shown:
            folder = Folder(reproducing.folder_of(self.where, source, experiment))
            return reproducing.resume(folder, self.jobs, batch=self.batch, watch=shown.step, stop=should_stop)

    def evaluate(self, source: str, experiment: Experiment, should_stop: Callable[[], bool]) -> None:
        """Add the rows, lines and figures of an experiment. Damaged files are set aside and run again once."""
        from wsnsim.papers import reproduce as reproducing

        folder = reproducing.folder_of(self.where, source, experiment)
        try:
            rows, lines = reproducing.evaluated(source, experiment, folder)
        except ResultError:
            damaged = reproducing.set_aside(folder)
            for path in damaged:
                echo(f"wsnsim: {path}: is damaged and was set aside; its runs are repeated", err=True)
            if not damaged or not self.run(source, experiment, should_stop).complete:
                raise
            rows, lines = reproducing.evaluated(source, experiment, folder)
        self.rows.extend(rows)
        self.lines.extend(lines)
        if self.figures:
            for figure in reproducing.draw(source, experiment, folder, self.figures):
                echo(f"wsnsim: {figure}", err=True)

    def print_answer(self, as_json: bool, markdown: bool, studies: Sequence[Study]) -> None:
        """Print the rows and lines of all experiments."""
        from wsnsim.papers import reproduce as reproducing
        from wsnsim.papers import table

        if as_json:
            echo_json({"schema_version": 1, "rows": reproducing.as_json(self.rows), "lines": self.lines})
        elif markdown:
            echo(table.markdown(self.rows, self.lines, studies))
        else:
            echo("\n\n".join(filter(None, [table.text(self.rows), "\n".join(self.lines)])))


def _check_folder(path: Path) -> None:
    """Raise UsageError, before anything runs, if figures cannot be written to the folder."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise UsageError(f"--figures {path}: {error.strerror or error}") from None


def _print_incomplete(folder: Path, outcome: CampaignOutcome) -> None:
    count = sum(map(len, outcome.missing.values()))
    echo(f"wsnsim: {folder} is incomplete, runs missing: {count}; repeat the command to resume", err=True)
    for reason in list(dict.fromkeys(filter(None, [outcome.stopped, *outcome.failed.values()])))[:MAX_REASONS]:
        echo(f"wsnsim: {reason}", err=True)
