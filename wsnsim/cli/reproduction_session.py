"""The experiments of one `wsnsim reproduce`: how they are run, and the rows and lines that they give."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from wsnsim.analysis.phrases import fitting
from wsnsim.base.errors import ResultError, counted
from wsnsim.campaign import CampaignOutcome
from wsnsim.campaign.engines import available_cores
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.progress import CAMPAIGN, display, duration
from wsnsim.cli.shared import INCOMPLETE, echo, echo_json
from wsnsim.papers import reproduce as reproducing
from wsnsim.papers import table
from wsnsim.papers.counts import outcome_line
from wsnsim.papers.reproduction import NAN, ClaimRow, Experiment
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

MAX_REASONS: Final = 3
"""Reasons of an incomplete campaign that are printed."""


@dataclass(frozen=True)
class ReproductionSession:
    """The experiments of one command: how they are run, and the rows and lines that they gave so far."""

    where: Path
    jobs: int | None
    full: bool
    batch: bool
    quiet: bool
    progress: str
    figures: Path | None
    only: str | None
    rows: list[ClaimRow] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    outcomes: list[str] = field(default_factory=list)

    def begin_all(self, chosen: Sequence[tuple[str, Experiment]], accept_code_change: bool) -> None:
        """Begin all campaigns before one runs, so that a folder that cannot be used is found at once."""
        for source, experiment in chosen:
            reproducing.begin(source, experiment, self.where, self.full, accept_code_change)

    def announce(self, chosen: Sequence[tuple[str, Experiment]]) -> None:
        """Print what will be run: experiments, their studies, runs, those that are on disk, how long, and where."""
        if self.quiet or self.progress == "json":
            return
        counts = [reproducing.run_counts(source, experiment, self.where) for source, experiment in chosen]
        wanted, missing = sum(planned for planned, _, _ in counts), sum(missing for _, missing, _ in counts)
        names = ", ".join(dict.fromkeys(study(source).name for source, _ in chosen))
        there = f", {wanted - missing:,} of them on disk" if missing < wanted else ""
        there += self._time(sum(missing * seconds for _, missing, seconds in counts if missing), "; the others take")
        echo(f"wsnsim: {counted(len(chosen), 'experiment')} of {names}: {counted(wanted, 'run')}{there}; "
             f"folder {self.where}", err=True)  # fmt: skip
        for _, experiment in chosen:
            if self.only not in (None, experiment.name):
                echo(f"wsnsim: {self.only} is drawn from the runs of {experiment.name}; --only {experiment.name} "
                     "prints all rows and draws all figures of these", err=True)  # fmt: skip
        for line in reproducing.registrations(chosen, self.where):
            echo(f"wsnsim: {line}", err=True)

    def run_all(self, chosen: Sequence[tuple[str, Experiment]], interrupts: Interrupts) -> int:
        """Run the experiments one after the other and return the exit code."""
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
        with contextlib.closing(display("none" if self.quiet else self.progress, CAMPAIGN)) as shown:
            folder = Folder(reproducing.folder_of(self.where, source, experiment))
            return reproducing.resume(folder, self.jobs, batch=self.batch, watch=shown.step, stop=should_stop)

    def evaluate(self, source: str, experiment: Experiment, should_stop: Callable[[], bool]) -> None:
        """Add the rows, lines and figures of an experiment. Damaged files are set aside and run again once."""
        folder = reproducing.folder_of(self.where, source, experiment)
        try:
            rows, lines = reproducing.evaluated(source, experiment, folder)
        except ResultError:
            damaged = Folder(folder).all_set_aside()
            for path in damaged:
                echo(f"wsnsim: {path}: is damaged and was set aside; its runs are repeated", err=True)
            if not damaged or not self.run(source, experiment, should_stop).complete:
                raise
            rows, lines = reproducing.evaluated(source, experiment, folder)
        self.rows.extend(rows)
        self.lines.extend(lines)
        self.outcomes.append(self.outcome(source, experiment, rows))
        if self.figures:
            for figure in reproducing.draw(source, experiment, folder, self.figures):
                echo(f"wsnsim: {figure}", err=True)

    def outcome(self, source: str, experiment: Experiment, rows: Sequence[ClaimRow]) -> str:
        """How an experiment, or the one figure, comes out, on how many runs, and how long the full number takes."""
        name = experiment.name if self.only in (None, experiment.name) else self.only.replace("_", " ")
        said = f"{study(source).name}, {name}: {outcome_line(rows)}; "
        planned, _, seconds = reproducing.run_counts(source, experiment, self.where)
        if self.full:
            return f"{said}{experiment.full} runs of each variant"
        whole = NAN if experiment.quick_sets else planned / experiment.quick * experiment.full * seconds
        return f"{said}{experiment.quick} of {experiment.full} runs; `--full` makes all{self._time(whole, ' in')}"

    def _time(self, seconds: float, verb: str) -> str:
        """How long so much processor time takes in words; '' if it is unknown, or less than a second."""
        wall = seconds / (self.jobs or available_cores())
        return f"{verb} about {duration(wall)}" if wall >= 1.0 else ""

    def print_answer(self, as_json: bool, markdown: bool) -> None:
        """Print the rows and lines of all experiments."""
        if as_json:
            echo_json({"rows": [reproducing.as_json(row) for row in self.rows], "lines": self.lines})
        elif markdown:
            echo(table.markdown(self.rows, [*self.outcomes, *self.lines]))
        else:
            pieces = [table.text(self.rows), "\n".join(self.lines), fitting(self.outcomes, "    ")]
            echo("\n\n".join(filter(None, pieces)))


def _print_incomplete(folder: Path, outcome: CampaignOutcome) -> None:
    count = sum(map(len, outcome.missing.values()))
    echo(f"wsnsim: {folder} is incomplete, runs missing: {count}; repeat the command to resume", err=True)
    for reason in list(dict.fromkeys(filter(None, [outcome.stopped, *outcome.failed.values()])))[:MAX_REASONS]:
        echo(f"wsnsim: {reason}", err=True)
