"""The experiments of papers and studies as resumable campaigns, and their results as rows, figures and summaries.

A study is named as `wsnsim.papers.study.study` takes it: by its name or its folder.

begin(study, experiment, where) -> Folder                     the experiment's campaign
resume(folder, jobs) -> CampaignOutcome                       run its missing runs
rows(study, experiment, folder) -> [ClaimRow, ...]            published, measured, bound, verdict
evaluated(study, experiment, folder) -> (rows, lines)         rows and summary, kept beside the campaign
draw(study, experiment, folder, into) -> [file, ...]          the figures from our results
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import wsnsim.campaign as campaign
from wsnsim.analysis import campaigns
from wsnsim.base.errors import ScenarioError, UsageError, did_you_mean
from wsnsim.base.runs import tracked
from wsnsim.campaign.engines import LocalEngine, available_cores
from wsnsim.papers.counts import kind_of
from wsnsim.papers.measures import VARIANT, Data
from wsnsim.papers.reproduction import FROM, NAN, ClaimRow, Experiment, Variant, rendered, row_of
from wsnsim.papers.rows import answered, rows_of
from wsnsim.papers.study import PAGES, PAPERS, Study
from wsnsim.papers.study import study as load_study
from wsnsim.recording.folder import Folder
from wsnsim.recording.kept import KEPT, KeptAnswers
from wsnsim.recording.provenance import committed
from wsnsim.scenario.registry import Plugins, access
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.sweep_schema import Plan
from wsnsim.scenario.texts import find_or_none


def experiments(source: str) -> tuple[Experiment, ...]:
    """The experiments of a study. Raises UsageError for an unknown one."""
    return load_study(source).experiments


def on_data(sources: Sequence[str], data: Path) -> list[tuple[str, Experiment]]:
    """(study, experiment) of each experiment of a study that takes data, on the data of a folder.

    Raises:
        UsageError: the studies are not one that takes data, or the folder has not what it needs.
        RunError: a file of the folder cannot be used.
    """
    if len(sources) != 1 or not load_study(sources[0]).takes_data:
        raise UsageError(f"--data is for one study that takes data, such as: wsnsim reproduce reality --data {data}")
    return [(sources[0], experiment) for experiment in load_study(sources[0], data.resolve()).experiments]


def chosen(sources: Sequence[str], only: str | None = None) -> list[tuple[str, Experiment]]:
    """(study, experiment) of each experiment of these studies, or of all papers; with `only`, of those of that name.

    Of an experiment that is named by one of its figures, that figure and the claims on it are left.

    Raises:
        UsageError: a study does not exist, two have one name, or one of them has no experiment `only`.
    """
    names: dict[str, str] = {}
    for source in dict.fromkeys(sources):
        if (first := names.setdefault(load_study(source).name, source)) != source:
            raise UsageError(f"{first} and {source} have the same name, which is that of their campaigns' folder")
    found = [(source, experiment) for source in names.values() or PAPERS for experiment in experiments(source)]
    if only is None:
        return found
    named = [(f"{name} has", experiments(source)) for name, source in names.items()]
    for papers, ones in named or [("the papers have", tuple([experiment for _, experiment in found]))]:
        if only not in (known := set().union(*map(_names, ones))):
            raise UsageError(f"{papers} no experiment '{only}' ({did_you_mean(only, known)})")
    return [(source, _narrowed(experiment, only)) for source, experiment in found if only in _names(experiment)]


def _names(experiment: Experiment) -> set[str]:
    """The names by which an experiment can be chosen: its own, and those of the figures that it draws."""
    return {experiment.name, *(figure.name for figure in experiment.figures)}


def _narrowed(experiment: Experiment, only: str) -> Experiment:
    """The experiment, or what is left of it for one of its figures: of `figure_9`, the claims on figure 9 alone."""
    figures = tuple(figure for figure in experiment.figures if figure.name == only)
    if only == experiment.name or not figures:
        return experiment
    claims, number = experiment.claims, only.removeprefix("figure_").partition("_")[0]
    if number.isdecimal():
        kept = [claim.shown and claim.literal and _is_on(claim.where, int(number)) for claim in claims]
        claims = tuple(replace(claim, shown=shown) for claim, shown in zip(claims, kept, strict=True))
    return replace(experiment, figures=figures, claims=claims)


def _is_on(where: str, figure: int) -> bool:
    """Whether a place is on a figure: 'text of figure 9' and 'figures 1 to 4' are; 'from figure 9' is not."""
    words = where.removeprefix(FROM + "figure").partition("figure")[2].replace(",", " ").replace(":", " ").split()
    numbers = [int(word) for word in words if word.isdecimal()]
    return bool(numbers) and min(numbers) <= figure <= max(numbers)


def plan(source: str, experiment: Experiment, full: bool = False) -> Plan:
    """The experiment as a campaign with one point for each variant."""
    points, study = [], load_study(source)
    for name, variant in experiment.variants.items():
        tables = [f"record.{table}=true" for table in experiment.record]
        sets = [*tables, *experiment.sets, *([] if full else experiment.quick_sets), *variant.sets]
        sweep = _sweep(study, experiment, name, variant, sets)
        points.append(replace(sweep.points[0], settings={VARIANT: name}))
    ids = {point.id for point in points}
    if len(ids) < len(points):
        names = [name for name, point in zip(experiment.variants, points, strict=True)
                 if [one.id for one in points].count(point.id) > 1]  # fmt: skip
        raise study.variant_error(experiment.name, names[1], f"is the same scenario as '{names[0]}'")
    return Plan(
        name=f"{study.name}_{experiment.name}",
        keys=(VARIANT,),
        points=tuple(points),
        replicates=experiment.full if full else experiment.quick,
        until=None,
        block=experiment.block,
        timeout=None,
        source="",
    )


def _sweep(study: Study, experiment: Experiment, name: str, variant: Variant, sets: Sequence[str]) -> Plan:
    """The one point of a variant, whose scenario is beside the study's file or has a shipped one's name."""
    beside = find_or_none(variant.scenario, study.folder)
    try:
        return load_sweep(beside or variant.scenario, overrides=sets)
    except ScenarioError as error:
        raise study.variant_error(experiment.name, name, str(error)) from None


def begin(
    source: str, experiment: Experiment, where: Path, full: bool = False, accept_code_change: bool = False
) -> Folder:
    """The campaign of an experiment in the folder WHERE/STUDY/EXPERIMENT: a new one, or the existing one.

    Raises:
        UsageError: the folder was made by another version or by other code, or cannot be written.
    """
    folder = folder_of(where, source, experiment)
    return campaign.prepare(
        plan(source, experiment, full), folder, by=(VARIANT,), accept_code_change=accept_code_change
    )


def run_counts(source: str, experiment: Experiment, where: Path) -> tuple[int, int, float]:
    """The numbers of runs of an experiment that are planned and that are missing, and the mean time of a run.

    It is the processor time (s) of those on disk, NaN without any.
    """
    folder = Folder(folder_of(where, source, experiment))
    points = folder.manifest().points
    planned = sum(point.replicates for point in points)
    missing = sum(len(folder.missing(point.id, point.replicates)) for point in points)
    seconds = campaigns.read(folder.path, "runs", ["cpu_seconds"])["cpu_seconds"].mean() if missing < planned else NAN
    return planned, missing, float(seconds)


def registrations(chosen: Sequence[tuple[str, Experiment]], where: Path) -> list[str]:
    """For each study of a user, whether its files were committed before its runs were made, and in which commit."""
    said = []
    for source in dict.fromkeys(source for source, _ in chosen):
        if (study := load_study(source)).name in PAGES:
            continue
        found = committed(study.folder, "*.yaml", "*.py")
        folders = [folder_of(where, source, experiment) for each, experiment in chosen if each == source]
        made = [file.stat().st_mtime for folder in folders for file in folder.glob("*/*.h5")]
        if found and found[1] <= min(made, default=math.inf):
            said.append(f"{study.name} is registered: commit {found[0][:12]}, before its runs")
        else:
            why = f"commit {found[0][:12]} is later than runs" if found else "its files are not committed as they are"
            said.append(f"{study.name} is not registered: {why}")
    return said


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
    allowed = access(Plugins.ANY)  # the folder's scenarios are those of the study that the caller named, see `begin`
    return campaign.run_campaign(folder, engine, on_progress=watch, should_stop=stop, batch=batch, access=allowed)


def folder_of(where: Path, source: str, experiment: Experiment) -> Path:
    """The folder of an experiment's campaign."""
    return where / load_study(source).name / experiment.name


def rows(source: str, experiment: Experiment, folder: Path) -> list[ClaimRow]:
    """The rows of an experiment whose campaign is in a folder, for each claim that is shown.

    Beside the row of an order, which is of the published statistic, stands one of the paired differences' median.
    """
    data = Data(Folder(folder), load_study(source))
    found = [rows_of(claim, data) for claim in tracked(experiment.claims, f"claims of {experiment.name} judged")]
    by_id: dict[str, dict[str, ClaimRow]] = {}
    for row, *_ in found:
        by_id.setdefault(row.id, {})[row.key] = row
    shown = [row for these, claim in zip(found, experiment.claims, strict=True) if claim.shown for row in these]
    return [
        replace(
            row, paper=load_study(source).name, experiment=experiment.name, title=experiment.title,
            literal=experiment.literal and row.literal, reading=experiment.reading,
            reason=rendered(row.reason, row, by_id),
        )
        for row in shown
    ]  # fmt: skip


def evaluated(source: str, experiment: Experiment, folder: Path) -> tuple[list[ClaimRow], list[str]]:
    """`rows` and `summary` of an experiment, kept beside its campaign while no file, claim or code changes."""
    campaign_folder = Folder(folder)
    points = [asdict(point) for point in campaign_folder.manifest().points]
    study = load_study(source)
    given = [dict(study.published), dict(study.registered), study.code.digest()]
    question = [study.name, repr(experiment), given, points, campaign_folder.state()]

    def compute() -> list[Any]:
        return [[asdict(row) for row in rows(source, experiment, folder)], summary(source, experiment, folder)]

    found, lines = KeptAnswers(folder / KEPT / "rows.json").answer(question, compute)
    return [row_of(content) for content in found], lines


def summary(source: str, experiment: Experiment, folder: Path) -> list[str]:
    """The lines beneath an experiment's rows: the answers to its hypotheses, and its summary."""
    study = load_study(source)
    data = Data(Folder(folder), study)
    answers = [f"registered {answered(each, data)}" for each in experiment.hypotheses]
    return [*answers, *(study.code.functions("SUMMARIES")[experiment.summary](data) if experiment.summary else [])]


def draw(source: str, experiment: Experiment, folder: Path, into: Path) -> list[Path]:
    """Draw the figures of an experiment, whose campaign is in a folder, as INTO/STUDY_NAME.png."""
    from wsnsim.analysis.figure_style import write_figure

    into.mkdir(parents=True, exist_ok=True)
    study = load_study(source)
    data, files = Data(Folder(folder), study), []
    for figure in experiment.figures:
        function = study.code.functions("FIGURES")[figure.draw or figure.name]
        caption = f"{study.source}, {figure.caption}"
        out = into / f"{study.name}_{figure.name}.png"
        files.append(write_figure(functools.partial(function, data=data), out, figure.size, caption))
    return files


def as_json(row: ClaimRow) -> dict[str, Any]:
    """A row as plain values: its verdict with the ratio, shares and medians with their intervals."""
    nested = ("title", "id", "key", "judgement", "astray", "median", "losses")
    return {
        **{name: value for name, value in vars(row).items() if name not in nested},
        "kind": kind_of(row),
        "verdict": row.verdict,
        "ratio_low": row.judgement.low,
        "ratio_high": row.judgement.high,
        "within": row.judgement.within,
        "undecidable": row.judgement.undecidable,
        "counted": row.counted,
        **dict(zip(("astray", "astray_low", "astray_high"), row.astray, strict=True)),
        **dict(zip(("median", "median_low", "median_high"), row.median, strict=True)),
        **row.losses._asdict(),
    }
