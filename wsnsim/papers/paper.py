"""A source paper: its published values, experiments and claims from its YAML file, its measures and figures from code.

paper('jiang2013').experiments           every experiment, checked
paper('jiang2013').published['rmse']     what the paper prints
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, final

from wsnsim.base.errors import Issue, ScenarioError, UsageError, did_you_mean
from wsnsim.papers.document import PaperDocument
from wsnsim.papers.reasons import problems
from wsnsim.papers.reproduction import Claim, Experiment
from wsnsim.papers.templates import PlacedClaim, experiment_of
from wsnsim.scenario.documents import Document, read_document
from wsnsim.scenario.located_values import Keys

if TYPE_CHECKING:
    from wsnsim.papers.measures import Data, OwnMeasure

PAPERS: Final = ("jiang2013", "liu2012", "wei2022", "ruan2020", "li2012")
FRONTIER: Final = "frontier"
"""The comparison of error and energy; a stored sweep has chosen some of its variants' settings."""
REALITY: Final = "reality"
"""The comparison whose variants come from a folder of recorded tracks."""
DUTY_CYCLES: Final = "duty_cycles"
"""The comparison of trackers on radios that are off most of the time."""
PAGES: Final = (*PAPERS, FRONTIER, REALITY, DUTY_CYCLES)
"""Every name that `wsnsim reproduce` takes; those after PAPERS are comparisons of our own."""
FOLDER: Final = Path(__file__).parent


@functools.cache
def paper(name: str, data: Path | None = None) -> Paper:
    """The paper of a name in PAGES; of `reality`, on the tracks of a folder, or on those that come with wsnsim.

    Raises:
        UsageError: no such paper, or it takes no data.
        ScenarioError: its file is wrong; every issue found in the part that is wrong.
    """
    if name not in PAGES:
        raise UsageError(f"there is no paper '{name}' ({did_you_mean(name, PAGES)})")
    if data is not None and name != REALITY:
        raise UsageError(f"{name} takes no data: only '{REALITY}' does")
    return Paper(name, read_document(FOLDER / f"{name}.yaml", PaperDocument), data)


@final
class Paper:
    """A source paper."""

    def __init__(self, name: str, document: Document[PaperDocument], data: Path | None = None) -> None:
        self.name = name
        self._data = data
        self.source = document.content.source
        self.published: Mapping[str, Any] = document.content.published
        self._document = document

    @functools.cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """The experiments, checked.

        Raises:
            ScenarioError: the paper's file is wrong.
            UsageError: the folder of recorded tracks has no receivers, or fewer than two tracks.
            RunError: a recorded track cannot be used.
        """
        document = self._document
        if self.name == REALITY:
            from wsnsim.papers.reality.variants import filled  # SciPy, and tracks are read

            document = filled(document, self._data)
        elif self.name == FRONTIER:
            from wsnsim.papers.frontier.variants import filled as with_chosen_settings

            document = with_chosen_settings(document)
        found = [experiment_of(document, index) for index in range(len(document.content.experiments))]
        issues = [issue for experiment, named in found for issue in self._issues(experiment, named)]
        if issues:
            raise ScenarioError(dict.fromkeys(issues))
        return tuple(experiment for experiment, _ in found)

    @functools.cached_property
    def main(self) -> list[tuple[Experiment, Claim]]:
        """The claims whose rows docs/papers shows, in its order. Raises ScenarioError."""
        groups = enumerate(self._document.content.main)
        return [
            found
            for index, group in groups
            for name, chosen in group.items()
            for label, keys in chosen.items()
            for found in self._chosen(name, label, keys, ("main", index, name, label))
        ]

    def _chosen(self, name: str, label: str, keys: Any, path: Keys) -> Iterator[tuple[Experiment, Claim]]:
        """The claims of an id, all or those of some keys."""
        for experiment in self.experiments:
            claims = {claim.key: claim for claim in experiment.claims if claim.id == label and experiment.name == name}
            if claims and (keys == "all" or set(keys) <= set(claims)):
                yield from ((experiment, claim) for key, claim in claims.items() if keys == "all" or key in keys)
                return
        raise ScenarioError([self._document.issue(path, f"{name} has no such claims")])

    @functools.cached_property
    def measures(self) -> Mapping[str, OwnMeasure]:
        """The paper's own measures, by name."""
        found: Mapping[str, OwnMeasure] = self._module("measures").MEASURES
        return found

    def figure(self, name: str) -> Callable[..., None]:
        """The function (figure, data) that draws a figure."""
        found: Callable[..., None] = self._module("figures").FIGURES[name]
        return found

    def summary(self, name: str) -> Callable[[Data], list[str]]:
        """The function that gives the lines beneath an experiment's rows."""
        found: Callable[[Data], list[str]] = self._module("measures").SUMMARIES[name]
        return found

    def _module(self, name: str) -> ModuleType:
        return importlib.import_module(f"wsnsim.papers.{self.name}.{name}")

    def _issues(self, experiment: Experiment, named: list[PlacedClaim]) -> Iterator[Issue]:
        """Names in claims that nothing has: variants, measures, and rows in reasons."""
        from wsnsim.papers.measures import problem

        keys: dict[str, list[str]] = {}
        for claim, path in named:
            if claim.id and claim.key in keys.get(claim.id, ()):
                yield self._document.issue(path, f"a second claim is '{claim.id}[{claim.key}]'")
            keys.setdefault(claim.id, []).append(claim.key)
        for claim, path in named:
            for variant in filter(None, (claim.variant, claim.other)):
                if variant not in experiment.variants:
                    message = f"no variant is '{variant}' ({did_you_mean(variant, experiment.variants)})"
                    yield self._document.issue(path, message)
            if message := problem(claim.measure, self.measures, experiment.variants):
                yield self._document.issue((*path, "measure"), message)
            for message in problems(claim.reason, keys):
                yield self._document.issue((*path, "reason"), message)
