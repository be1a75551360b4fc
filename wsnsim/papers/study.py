"""A paper or a study: a folder with `study.yaml`, and `study.py` with its measures and figures.

study('jiang2013').experiments           every experiment, checked; of a folder: study('studies/mine')
study('jiang2013').published['rmse']     what the paper prints
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, final

from wsnsim.base.errors import Issue, ScenarioError, UsageError, did_you_mean
from wsnsim.papers.reproduction import (
    BASES,
    FROM,
    LESS_THAN,
    Claim,
    Experiment,
    Variant,
    measure_problem,
    problems,
)
from wsnsim.papers.study_file import ClaimEntry, ExperimentEntry, StudyCode, StudyDocument
from wsnsim.scenario.messages import Document, document_of, read_document
from wsnsim.scenario.schema import unsafe_name
from wsnsim.scenario.texts import Keys, shipped_studies

PAPERS: Final = ("jiang2013", "liu2012", "wei2022", "ruan2020", "li2012")
STUDIES: Final = ("frontier", "reality", "duty_cycles", "few_bits", "late", "association", "headless")
"""Studies of our own."""
PAGES: Final = (*PAPERS, *STUDIES)
"""The names of what comes with wsnsim."""
FILE: Final = "study.yaml"
ALL: Final = "all"
PER_NAME: Final = ("published", "reason")
"""Keys of a claim that may have a value for each variant or order."""


@functools.cache
def study(source: str, data: Path | None = None) -> Study:
    """The paper or study of a name in PAGES or in a folder; of one that takes data, on those of a folder.

    Raises:
        UsageError: no such study, or it takes no data.
        ScenarioError: its file is wrong; every issue found in the part that is wrong.
    """
    ours = shipped_studies()
    folder = ours.get(source) or _folder(source)
    name = folder.resolve().name
    if source not in ours and name in ours and folder.resolve() != ours[name].resolve():
        raise UsageError(f"{source}: '{name}' is the name of a study that comes with wsnsim; rename the folder")
    shown = f"{name}/{FILE}" if source in ours else str(folder / FILE)
    document = read_document(folder / FILE, StudyDocument, shown)
    if not document.content.experiments:
        raise ScenarioError([document.issue(("experiments",), "a study needs an experiment")])
    if data is not None and not document.content.takes_data:
        raise UsageError(f"{name} takes no data: its {FILE} would have 'takes_data: true'")
    return Study(name, folder, document, StudyCode(folder.resolve(), source in ours), data)


def _folder(source: str) -> Path:
    """The folder of a study that a caller names. Raises UsageError."""
    folder = Path(source)
    folder = folder.parent if folder.name == FILE else folder
    if (folder / FILE).is_file():
        return folder
    if folder.is_dir():
        raise UsageError(f"{source}: has no {FILE}; `wsnsim new --for study NAME` writes a study to start from")
    raise UsageError(
        f"there is no paper or study '{source}' ({did_you_mean(source, PAGES)}), nor a folder of this name"
    )


@final
class Study:
    """A paper or a study."""

    def __init__(
        self, name: str, folder: Path, document: Document[StudyDocument], code: StudyCode, data: Path | None = None
    ) -> None:
        self.name = name
        self.folder = folder
        self.source = document.content.source
        self.takes_data = document.content.takes_data
        self.published: Mapping[str, Any] = document.content.published
        self.registered: Mapping[str, Any] = document.content.registered
        self.code = code
        self._data = data
        self._prefix = f"{data.name}_" if data else ""
        self._document = document

    @property
    def names(self) -> list[str]:
        """The names of the experiments."""
        return [one.name for one in self._document.content.experiments]

    @functools.cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """The experiments, checked.

        Raises:
            ScenarioError: the study's file is wrong.
            UsageError: its Python file is wrong, or the folder of data has not what it needs.
            RunError: data cannot be used.
        """
        issues: list[Issue] = []
        found = [self._experiment(index, issues) for index in range(len(self.names))]
        names = [experiment.name for experiment in found]
        for index, name in enumerate(names):
            if name in names[:index]:
                issues.append(self._document.issue(("experiments", index, "name"), f"a second experiment is '{name}'"))
        if issues:
            raise ScenarioError(dict.fromkeys(issues))
        return tuple(found)

    @property
    def measures(self) -> Mapping[str, Callable[..., Any]]:
        """The study's own measures, by name."""
        return self.code.functions("MEASURES")

    def variant_error(self, experiment: str, variant: str, message: str) -> ScenarioError:
        """The error of a variant whose scenario is wrong, at its place in the file."""
        name = experiment.removeprefix(self._prefix)
        index = self.names.index(name) if name in self.names else 0
        return ScenarioError([self._document.issue(("experiments", index, "variants", variant), message)])

    def _experiment(self, index: int, issues: list[Issue]) -> Experiment:
        """An experiment of the file; what is wrong with it is added to the issues."""
        entry, path = self._completed(index), ("experiments", index)
        texts = {name: (given,) if isinstance(given, str) else given for name, given in entry.variants.items()}
        empty = [(*path, "variants", name) for name, given in texts.items() if not given]
        issues += [self._document.issue(place, "names no scenario") for place in empty]
        variants = {name: Variant(given[0], given[1:]) for name, given in texts.items() if given}
        placed: list[tuple[Claim, Keys]] = []  # with their paths in the file
        for number, claim in enumerate(entry.claims):
            placed += self._claims(entry, claim, (*path, "claims", number), issues)
        kept = ("title", "hypotheses", "figures", "record", "sets", "quick_sets", "summary", "literal", "reading")
        experiment = Experiment(
            name=f"{self._prefix}{entry.name}", variants=variants, claims=tuple(claim for claim, _ in placed),
            **{key: getattr(entry, key) for key in kept}, **dict(entry.runs),
        )  # fmt: skip
        issues += [*self._claim_issues(experiment, placed), *self._issues(experiment, entry, path)]
        return experiment

    def _completed(self, index: int) -> ExperimentEntry:
        """The entry of an experiment, with the variants and claims that the study's EXPERIMENTS gives for it."""
        entry = self._document.content.experiments[index]
        make = None if entry.variants else self.code.functions("EXPERIMENTS").get(entry.name)
        if make is None:
            return entry
        given = make(self, self._data)
        try:
            return document_of({**entry.model_dump(exclude_unset=True), **given}, ExperimentEntry)
        except (TypeError, ValueError) as error:
            message = f"what EXPERIMENTS['{entry.name}'] gives is wrong: {error}"
            raise ScenarioError([self._document.issue(("experiments", index), message)]) from None

    def _claims(
        self, experiment: ExperimentEntry, entry: ClaimEntry, path: Keys, issues: list[Issue]
    ) -> Iterator[tuple[Claim, Keys]]:
        """The claims of an entry: those of the first variant or order, then those of the next."""
        names = (
            tuple(experiment.variants) if entry.of == ALL else (entry.of,) if isinstance(entry.of, str) else entry.of
        )
        numbered = enumerate(entry.rows)
        rows = [(row, (*path, "rows", number)) for number, row in numbered] if entry.rows else [(entry, path)]
        for row, place in rows:
            issues += [self._document.issue(place, message) for message in _entry_problems(entry, row, names)]
        for name in names:
            for row, place in rows:
                yield _claim(row, name, experiment, self._document.content.published_runs), place

    def _claim_issues(self, experiment: Experiment, placed: list[tuple[Claim, Keys]]) -> Iterator[Issue]:
        """Names in claims that nothing has: variants, measures, and rows in reasons; claims of the same name."""
        keys: dict[str, list[str]] = {}
        for claim, place in placed:
            if claim.id and claim.key in keys.get(claim.id, ()):
                yield self._document.issue(place, f"a second claim is '{claim.id}[{claim.key}]'")
            keys.setdefault(claim.id, []).append(claim.key)
        for claim, place in placed:
            yield from self._measured(experiment, (claim.variant, *filter(None, [claim.other])), claim.measure, place)
            for message in problems(claim.reason, keys):
                yield self._document.issue((*place, "reason"), message)

    def _issues(self, experiment: Experiment, entry: ExperimentEntry, path: Keys) -> Iterator[Issue]:
        """What is wrong with the other keys of an experiment."""
        for number, hypothesis in enumerate(experiment.hypotheses):
            place = (*path, "hypotheses", number)
            yield from self._measured(experiment, (hypothesis.of,), hypothesis.measure, place)
            if (hypothesis.above is None) == (hypothesis.below is None):
                yield self._document.issue(place, "needs one of 'above' and 'below'")
        functions = [("FIGURES", figure.draw or figure.name, "figures") for figure in experiment.figures]
        functions += [("SUMMARIES", experiment.summary, "summary")] if experiment.summary else []
        for mapping, name, key in functions:
            if name not in (known := self.code.functions(mapping)):
                yield self._document.issue((*path, key), f"{mapping} has no '{name}' ({did_you_mean(name, known)})")
        for key, names in (("repairs", entry.repairs), *(("bases", names) for names in entry.bases.values())):
            for name in set(names) - set(experiment.variants):
                message = f"no variant is '{name}' ({did_you_mean(name, experiment.variants)})"
                yield self._document.issue((*path, key), message)
        for basis in {entry.basis, *entry.bases} - set(BASES):
            yield self._document.issue(path, f"basis: '{basis}' ({did_you_mean(basis, BASES)})")
        named = [(entry.name, "a folder", "name"), *((figure.name, "a file", "figures") for figure in entry.figures)]
        for name, what, key in named:
            if reason := unsafe_name(name, what):
                yield self._document.issue((*path, key), f"'{name}' {reason}")
        if min(experiment.quick, experiment.full, experiment.block) < 1:
            yield self._document.issue((*path, "runs"), "quick, full and block must be at least 1")
        if not experiment.variants:
            yield self._document.issue((*path, "name"), "has no variants, neither here nor in the study's EXPERIMENTS")

    def _measured(
        self, experiment: Experiment, variants: tuple[str, ...], measure: str, place: Keys
    ) -> Iterator[Issue]:
        """What is wrong with the variants and the measure of a claim or a hypothesis."""
        for variant in variants:
            if variant not in experiment.variants:
                message = f"no variant is '{variant}' ({did_you_mean(variant, experiment.variants)})"
                yield self._document.issue(place, message)
        if message := measure_problem(measure, self.measures, experiment.variants):
            yield self._document.issue((*place, "measure"), message)


def _entry_problems(entry: ClaimEntry, row: ClaimEntry, names: tuple[str, ...]) -> Iterator[str]:
    """What is wrong with a claim, apart from the names in it."""
    if not names or not all(names):
        yield "needs 'of': a variant, an order such as 'ekf < pf', a list of them, or 'all'"
    if row is not entry and (row.of or row.rows):
        yield "a row has neither 'of' nor 'rows': they stand beside the rows"
    if entry.rows and entry.model_fields_set - {"of", "rows"}:
        yield f"beside 'rows' stands 'of' alone, not '{min(entry.model_fields_set - {'of', 'rows'})}'"
    for key in ("quantity", "measure"):
        if not getattr(row, key):
            yield f"needs '{key}'"
    if row.basis and row.basis not in BASES:
        yield f"basis: '{row.basis}' ({did_you_mean(row.basis, BASES)})"
    for key in PER_NAME:
        given = getattr(row, key)
        for name in set(given) - set(names) if isinstance(given, dict) else ():
            yield f"{key}: the claim is not of '{name}' ({did_you_mean(name, names)})"


def _claim(row: ClaimEntry, name: str, experiment: ExperimentEntry, published_runs: int) -> Claim:
    """The claim of a variant or an order."""
    variant, _, other = name.partition(LESS_THAN)
    given = row.model_dump(exclude={"of", "rows"})
    of_variants = [basis for each in (variant, other) for basis, names in experiment.bases.items() if each in names]
    given["basis"] = given["basis"] or next(iter(of_variants), experiment.basis)
    given["literal"] = given["literal"] and not {variant, other} & set(experiment.repairs)
    for key, otherwise in zip(PER_NAME, (None, ""), strict=True):
        if isinstance(given[key], dict):
            given[key] = given[key].get(name, otherwise)
    if isinstance(given["published"], tuple):
        given["published"] = given["published"][0] / given["published"][1]
        given["where"] = given["where"] and f"{FROM}{given['where'].removeprefix(FROM)}"
    given["published_runs_assumed"] = given["published_runs_assumed"] or experiment.published_runs_assumed
    if given["published_runs"] is None:
        given["published_runs"] = published_runs
    return Claim(**given, variant=variant, other=other)
