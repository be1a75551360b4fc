"""The command that reproduces papers and runs studies."""

from __future__ import annotations

from pathlib import Path

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli import shared
from wsnsim.cli.interrupts import Interrupts
from wsnsim.cli.shared import PATH, group


@group.command()
@click.argument("sources", metavar="[STUDY]...", nargs=-1)
@click.option("--quick", is_flag=True, help="Few runs: the default.")
@click.option("--full", is_flag=True, help="Runs enough for verdicts: 200 for a mean.")
@click.option("--out", "-o", type=PATH, default=Path("results/reproduce"), show_default=True, metavar="DIR",
              help="Folder of the campaigns.")  # fmt: skip
@click.option("--figures", type=PATH, metavar="DIR", help="Also draw the figures into this folder.")
@click.option("--data", type=PATH, metavar="DIR", help="For `reality`: a folder of tracks with receivers.csv.")
@click.option(
    "--only", metavar="NAME", help="Only this experiment (table_2, ...), or the rows of one figure (figure_9, ...)."
)
@shared.jobs_option
@shared.batch_option
@shared.accept_code_option
@shared.json_option
@click.option("--markdown", is_flag=True, help="Print Markdown: a row for each claim.")
@shared.quiet_option
@shared.progress_option
@click.pass_obj
def reproduce(interrupts: Interrupts, sources: tuple[str, ...], quick: bool, full: bool, out: Path,
              figures: Path | None, data: Path | None, only: str | None, jobs: int | None, batch: bool,
              accept_code_change: bool, as_json: bool, markdown: bool, quiet: bool, progress: str) -> int:  # fmt: skip
    """Run papers and studies; judge values, answer hypotheses.

    STUDY is a folder with study.yaml (`wsnsim new --for study NAME` writes one), or a paper: jiang2013, liu2012,
    wei2022, ruan2020 or li2012; these five by default. Each row shows the published value, the measured one, the bound
    and a verdict. Verdicts on means and RMSEs need 200 runs (--full). Finished runs are not repeated. The folder's
    study.py is imported.

    Seven studies of our own have no paper. `frontier` compares error and energy of every tracker on one field.
    `reality` compares recorded readings with simulated ones, on the tracks that come with wsnsim or on those of --data.
    `duty_cycles` compares what trackers cost on radios that are off most of the time. `few_bits` asks what readings of
    1 to 8 bits save, `late` what readings are worth that miss their step. `association` asks what finding out whose
    detections are costs, and what loss does to it; `headless` what it costs to need no cluster head.
    """
    from wsnsim.cli.reproduction_session import ReproductionSession
    from wsnsim.papers import reproduce as reproducing

    if quick and full:
        raise UsageError("--quick cannot be combined with --full")
    if as_json and markdown:
        raise UsageError("--json cannot be combined with --markdown")
    if data is not None and only is not None:
        raise UsageError("--only cannot be combined with --data")
    chosen = reproducing.chosen(sources, only) if data is None else reproducing.on_data(sources, data)
    if figures:
        _demand_folder(figures)
    session = ReproductionSession(
        out / ("full" if full else "quick"), jobs, full, batch, quiet, progress, figures, only
    )
    session.begin_all(chosen, accept_code_change)
    session.announce(chosen)
    code = session.run_all(chosen, interrupts)
    if not interrupts.number:
        session.print_answer(as_json, markdown)
    return code


def _demand_folder(figures: Path) -> None:
    """Create the folder of the figures in one that exists. Raises UsageError."""
    from wsnsim.campaign.folders import demand_writable

    if figures.exists() and not figures.is_dir():
        raise UsageError(f"--figures {figures} is a file; give a folder")
    if not figures.parent.is_dir():
        raise UsageError(f"--figures {figures}: folder does not exist: {figures.parent}")
    demand_writable(figures, "--figures ")
