"""The experiments of the papers as resumable campaigns, and their results as rows, figures and summaries.

begin(paper, experiment, where) -> Folder                     the experiment's campaign
run(paper, experiment, where, full=False, ...) -> CampaignOutcome       run its missing runs
rows(paper, experiment, folder) -> [ClaimRow, ...]            published, measured, bound, verdict
evaluated(paper, experiment, folder) -> (rows, lines)         rows and summary, kept beside the campaign
draw(paper, experiment, folder, into) -> [file, ...]          the paper's figures from our results
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import wsnsim.campaign as campaign
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.progress import tracked
from wsnsim.campaign.local_engine import LocalEngine, available_cores
from wsnsim.papers.measures import VARIANT, Data
from wsnsim.papers.paper import PAPERS, REALITY
from wsnsim.papers.paper import paper as load_paper
from wsnsim.papers.reasons import rendered
from wsnsim.papers.reproduction import ClaimRow, Experiment, row_of
from wsnsim.papers.rows import rows_of
from wsnsim.recording.folder import Folder
from wsnsim.recording.kept import KEPT, KeptAnswers
from wsnsim.scenario.plugin_access import Plugins, access
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.sweep_schema import Plan


def experiments(paper: str) -> tuple[Experiment, ...]:
    """The experiments of a paper. Raises UsageError for an unknown one."""
    return load_paper(paper).experiments


def on_data(papers: Sequence[str], data: Path) -> list[tuple[str, Experiment]]:
    """(paper, experiment) of each experiment of these papers on the recorded tracks of a folder.

    Raises:
        UsageError: the papers are not `reality` alone, or the folder has no receivers or fewer than two tracks.
        RunError: a file of the folder cannot be used.
    """
    if tuple(papers) != (REALITY,):
        raise UsageError(f"--data is for '{REALITY}' alone: wsnsim reproduce {REALITY} --data {data}")
    return [(REALITY, experiment) for experiment in load_paper(REALITY, data.resolve()).experiments]


def chosen(papers: Sequence[str], only: str | None = None) -> list[tuple[str, Experiment]]:
    """(paper, experiment) of each experiment of these papers, or of all papers; with `only`, of those of that name.

    Raises:
        UsageError: a paper does not exist, or one of `papers` has no experiment `only`.
    """
    found = [(paper, experiment) for paper in papers or PAPERS for experiment in experiments(paper)]
    if only is None:
        return found
    for paper in papers:
        _check_name(only, {experiment.name for experiment in experiments(paper)}, f"{paper} has no experiment")
    _check_name(only, {experiment.name for _, experiment in found}, "there is no experiment")
    return [(paper, experiment) for paper, experiment in found if experiment.name == only]


def _check_name(name: str, known: set[str], message: str) -> None:
    if name not in known:
        raise UsageError(f"{message} '{name}' ({did_you_mean(name, known)})")


def plan(paper: str, experiment: Experiment, full: bool = False) -> Plan:
    """The experiment as a campaign with one point for each variant."""
    points = []
    for name, variant in experiment.variants.items():
        tables = [f"record.{table}=true" for table in experiment.record]
        sets = [*tables, *experiment.sets, *([] if full else experiment.quick_sets), *variant.sets]
        sweep = load_sweep(variant.scenario, overrides=sets)
        points.append(replace(sweep.points[0], settings={VARIANT: name}))
    ids = {point.id for point in points}
    assert len(ids) == len(points), f"two variants of {paper} {experiment.name} are the same scenario"
    return Plan(
        name=f"{paper}_{experiment.name}",
        keys=(VARIANT,),
        points=tuple(points),
        replicates=experiment.full if full else experiment.quick,
        until=None,
        block=experiment.block,
        timeout=None,
        source="",
    )


def begin(
    paper: str, experiment: Experiment, where: Path, full: bool = False, accept_code_change: bool = False
) -> Folder:
    """The campaign of an experiment in the folder WHERE/PAPER/EXPERIMENT: a new one, or the existing one.

    Raises:
        UsageError: the folder was made by another version or by other code, or cannot be written.
    """
    folder = folder_of(where, paper, experiment)
    return campaign.prepare(plan(paper, experiment, full), folder, by=(VARIANT,), accept_code_change=accept_code_change)


def run_counts(chosen: Sequence[tuple[str, Experiment]], where: Path) -> tuple[int, int]:
    """(planned, missing) numbers of runs of the experiments."""
    wanted = missing = 0
    for folder in (Folder(folder_of(where, paper, experiment)) for paper, experiment in chosen):
        for point in folder.manifest().points:
            wanted += point.replicates
            missing += len(folder.missing(point.id, point.replicates))
    return wanted, missing


def run(  # noqa: PLR0913
    paper: str,
    experiment: Experiment,
    where: Path,
    jobs: int | None = None,
    *,
    full: bool = False,
    batch: bool = True,
    watch: Callable[[campaign.CampaignProgress], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> campaign.CampaignOutcome:
    """Begin an experiment and run its missing runs."""
    return resume(begin(paper, experiment, where, full), jobs, batch=batch, watch=watch, stop=stop)


def resume(
    folder: Folder,
    jobs: int | None = None,
    *,
    batch: bool = True,
    watch: Callable[[campaign.CampaignProgress], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> campaign.CampaignOutcome:
    """Run the missing runs of an experiment that was begun."""
    engine = LocalEngine(jobs or available_cores())
    allowed = access(Plugins.ANY)  # `begin` has written the scenarios of the folder, which come with wsnsim
    return campaign.run_campaign(folder, engine, on_progress=watch, should_stop=stop, batch=batch, access=allowed)


def folder_of(where: Path, paper: str, experiment: Experiment) -> Path:
    """The folder of an experiment's campaign."""
    return where / paper / experiment.name


def rows(paper: str, experiment: Experiment, folder: Path) -> list[ClaimRow]:
    """The rows of an experiment whose campaign is in a folder, for each claim that is shown.

    Beside the row of an order, which is of the published statistic, stands one of the paired differences' median.
    """
    data = Data(Folder(folder), load_paper(paper))
    found = [rows_of(claim, data) for claim in tracked(experiment.claims, f"claims of {experiment.name} judged")]
    by_id: dict[str, dict[str, ClaimRow]] = {}
    for row, *_ in found:
        by_id.setdefault(row.id, {})[row.key] = row
    shown = [row for these, claim in zip(found, experiment.claims, strict=True) if claim.shown for row in these]
    return [
        replace(
            row, paper=paper, experiment=experiment.name, title=experiment.title,
            literal=experiment.literal and row.literal, reason=rendered(row.reason, row, by_id),
        )
        for row in shown
    ]  # fmt: skip


def evaluated(paper: str, experiment: Experiment, folder: Path) -> tuple[list[ClaimRow], list[str]]:
    """`rows` and `summary` of an experiment, kept beside its campaign while no file, claim or code changes."""
    campaign_folder = Folder(folder)
    points = [asdict(point) for point in campaign_folder.manifest().points]
    question = [paper, repr(experiment), dict(load_paper(paper).published), points, campaign_folder.state()]

    def compute() -> list[Any]:
        return [[asdict(row) for row in rows(paper, experiment, folder)], summary(paper, experiment, folder)]

    found, lines = KeptAnswers(folder / KEPT / "rows.json").answer(question, compute)
    return [row_of(content) for content in found], lines


def set_aside(folder: Path) -> list[Path]:
    """Rename the unreadable files of a campaign, so that their runs count as missing. Return the new paths."""
    campaign_folder = Folder(folder)
    return [path for point in campaign_folder.manifest().points for path in campaign_folder.set_aside(point.id)]


def summary(paper: str, experiment: Experiment, folder: Path) -> list[str]:
    """The summary beneath an experiment's rows, line by line."""
    if not experiment.summary:
        return []
    return load_paper(paper).summary(experiment.summary)(Data(Folder(folder), load_paper(paper)))


def draw(paper: str, experiment: Experiment, folder: Path, into: Path) -> list[Path]:
    """Draw the figures of an experiment, whose campaign is in a folder, as INTO/PAPER_NAME.png."""
    from wsnsim.analysis.figure_style import write_figure

    into.mkdir(parents=True, exist_ok=True)
    data, files = Data(Folder(folder), load_paper(paper)), []
    for figure in experiment.figures:
        function = load_paper(paper).figure(figure.draw or figure.name)
        caption = f"{load_paper(paper).source}, {figure.caption}"
        out = into / f"{paper}_{figure.name}.png"
        files.append(write_figure(functools.partial(function, data=data), out, figure.size, caption))
    return files


def as_json(found: Sequence[ClaimRow]) -> list[dict[str, Any]]:
    """The rows as plain values: verdicts with their ratios, shares and medians with their intervals."""
    return [_plain(row) for row in found]


def _plain(row: ClaimRow) -> dict[str, Any]:
    nested = ("title", "id", "key", "short", "judgement", "astray", "median", "losses")
    return {
        **{name: value for name, value in vars(row).items() if name not in nested},
        "verdict": row.verdict,
        "ratio_low": row.judgement.low,
        "ratio_high": row.judgement.high,
        "within": row.judgement.within,
        "counted": row.counted,
        **dict(zip(("astray", "astray_low", "astray_high"), row.astray, strict=True)),
        **dict(zip(("median", "median_low", "median_high"), row.median, strict=True)),
        **row.losses._asdict(),
    }
