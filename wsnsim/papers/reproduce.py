"""Every table and figure of the papers, run as campaigns that can be gone on with, and what comes of it.

begin(paper, experiment, where) -> Folder                     the experiment's campaign
run(paper, experiment, where, full=False, ...) -> CampaignOutcome       what is missing of it
rows(paper, experiment, folder) -> [Row, ...]                 published, measured, bound, verdict
draw(experiment, folder, into) -> [file, ...]                 the paper's figures, ours
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import wsnsim.campaign as campaign
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.campaign.local_engine import LocalEngine, available_cores
from wsnsim.papers import measures
from wsnsim.papers.measures import VARIANT, Data
from wsnsim.papers.reproduction import Claim, Experiment, Limit, Order, Row, judged, ordered
from wsnsim.recording.folder import Folder
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.sweep_schema import Plan

PAPERS: Final = ("jiang2013", "liu2012", "wei2022", "ruan2020", "li2012")
PAGES: Final = (*PAPERS, "frontier")
NAN: Final = float("nan")
USUAL: Final = {
    "median:rmse": "beside the mean over time: single runs that go astray do not move it",
    "mean:energy": "what the error beside it costs",
}
OTHERS: Final = "for comparison; the paper prints no such figure"
"""Reasons where a claim gives none of its own: of what a measure is for."""


def experiments(paper: str) -> tuple[Experiment, ...]:
    """The experiments of a paper. Raises UsageError for one that is not known."""
    if paper not in PAGES:
        raise UsageError(f"there is no paper '{paper}' ({did_you_mean(paper, PAGES)})")
    found: tuple[Experiment, ...] = importlib.import_module(f"wsnsim.papers.{paper}.experiments").EXPERIMENTS
    return found


def chosen(papers: Sequence[str], only: str | None = None) -> list[tuple[str, Experiment]]:
    """The experiments of these papers, of all five if none is named; only those of a name, if one is given.

    Raises:
        UsageError: there is no such paper, or a paper that is named has no such experiment.
    """
    every = {paper: experiments(paper) for paper in papers or PAPERS}
    if only is None:
        return [(paper, experiment) for paper, those in every.items() for experiment in those]
    for paper in papers:
        _demand_experiment(f"{paper} has no experiment", only, {each.name for each in every[paper]})
    _demand_experiment("there is no experiment", only, {each.name for those in every.values() for each in those})
    return [(paper, experiment) for paper, those in every.items() for experiment in those if experiment.name == only]


def _demand_experiment(words: str, only: str, names: set[str]) -> None:
    if only not in names:
        raise UsageError(f"{words} '{only}' ({did_you_mean(only, names)})")


def plan(paper: str, experiment: Experiment, full: bool = False) -> Plan:
    """The experiment as a campaign: a point a variant, which its name tells apart."""
    points = []
    for name, variant in experiment.variants.items():
        keep = [f"record.{table}=true" for table in experiment.record]
        sets = [*keep, *experiment.sets, *([] if full else experiment.quick_sets), *variant.sets]
        alone = load_sweep(variant.scenario, overrides=sets)
        points.append(replace(alone.points[0], settings={VARIANT: name}))
    twins = {point.id for point in points}
    assert len(twins) == len(points), f"two variants of {paper} {experiment.name} are the same scenario"
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


def begin(paper: str, experiment: Experiment, where: Path, full: bool = False) -> Folder:
    """The campaign of an experiment in the folder WHERE/PAPER/EXPERIMENT, begun or to be gone on with.

    Raises:
        UsageError: the folder is of another version, or cannot be written.
    """
    return campaign.prepare(plan(paper, experiment, full), place(where, paper, experiment), by=(VARIANT,))


def run(
    paper: str,
    experiment: Experiment,
    where: Path,
    jobs: int | None = None,
    *,
    full: bool = False,
    watch: Callable[[campaign.CampaignProgress], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> campaign.CampaignOutcome:
    """Run what is missing of an experiment."""
    return campaign.run_campaign(
        begin(paper, experiment, where, full),
        LocalEngine(jobs or available_cores()),
        on_progress=watch,
        should_stop=stop,
    )


def place(where: Path, paper: str, experiment: Experiment) -> Path:
    """The folder of an experiment."""
    return where / paper / experiment.name


def rows(paper: str, experiment: Experiment, where: Path) -> list[Row]:
    """What was published, measured and possible, claim by claim, of the campaign in a folder."""
    data = Data(Folder(where))
    return [
        _of_order(paper, experiment, claim, data)
        if isinstance(claim, Order)
        else _of_claim(paper, experiment, claim, data)
        for claim in experiment.claims
    ]


def set_aside(where: Path) -> list[Path]:
    """Rename the files of a campaign that cannot be read, so that their replicates are missing; their new names."""
    folder = Folder(where)
    return [place for point in folder.manifest().points for place in folder.set_aside(point.id)]


def lines(experiment: Experiment, where: Path) -> list[str]:
    """What an experiment says beneath its rows, of the campaign in a folder."""
    if not experiment.says:
        return []
    module, _, name = experiment.says.partition(":")
    said: list[str] = getattr(importlib.import_module(module), name)(Data(Folder(where)))
    return said


def draw(paper: str, experiment: Experiment, where: Path, into: Path) -> list[Path]:
    """Draw the pictures of an experiment, whose campaign is in a folder, to INTO/PAPER_NAME.png."""
    from wsnsim.analysis.figure_style import panels

    into.mkdir(parents=True, exist_ok=True)
    data, drawn = Data(Folder(where)), []
    for picture in experiment.pictures:
        module, _, name = picture.draw.partition(":")
        function = getattr(importlib.import_module(module), name)
        out = into / f"{paper}_{picture.name}.png"
        drawn.append(panels(functools.partial(function, data=data), out, picture.size, picture.title))
    return drawn


def as_json(found: Sequence[Row]) -> list[dict[str, Any]]:
    """The rows as plain values."""
    names = ("paper", "experiment", "quantity", "variant", "published", "measured", "low", "high", "replicates",
             "lost_fraction", "bound", "bound_kind", "verdict", "reason", "caution", "read", "literal")  # fmt: skip
    return [{name: getattr(row, name) for name in names} for row in found]


def _of_claim(paper: str, experiment: Experiment, claim: Claim, data: Data) -> Row:
    found = measures.measured(data, claim.variant, claim.measure)
    limit = measures.bound_of(data, claim.variant, claim.measure, claim.bound) if claim.bound else Limit()
    published = NAN if claim.published is None else claim.published
    verdict, counted = judged(claim, found, limit.strict), experiment.literal and claim.literal
    return Row(
        paper, experiment.name, quantity(claim), claim.variant, published, *found, limit.value, limit.kind, verdict,
        claim.reason or USUAL.get(claim.measure, OTHERS), limit.caution, claim.read, counted, experiment.title,
    )  # fmt: skip


def _of_order(paper: str, experiment: Experiment, claim: Order, data: Data) -> Row:
    found = measures.difference(data, claim.variant, claim.other, claim.measure)
    return Row(
        paper, experiment.name, quantity(claim), claim.variant, NAN, *found, NAN, "", ordered(found), claim.reason,
        literal=experiment.literal and claim.literal, title=experiment.title,
    )  # fmt: skip


def quantity(claim: Claim | Order) -> str:
    """What a row is of, in words."""
    words = f"{claim.quantity} below that of {claim.other}" if isinstance(claim, Order) else claim.quantity
    return words + (f" ({claim.where})" if claim.where else "")
