"""The keys of `study.yaml`, the file of a paper or of a study.

Claims are written out. YAML's anchors and merge keys serve for what repeats: `reason: &far "..."`, then `reason: *far`;
`- &first {...}`, then `- {<<: *first, name: again}`.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from wsnsim.scenario.messages import DocumentModel

Published: TypeAlias = int | float | tuple[float, float]
"""A printed value, or two whose ratio is claimed."""


class ClaimEntry(DocumentModel):
    """What is claimed of a variant ('pf'), of an order ('ekf < pf'), of a list of them, or of `all` variants.

    `rows` holds several claims: each variant or order has all of them, one variant after the other. `published` and
    `reason` may be mappings by variant or order. See reproduction.Claim for the other keys.
    """

    of: str | tuple[str, ...] = ""
    rows: tuple[ClaimEntry, ...] = ()
    id: str = ""
    quantity: str = ""
    measure: str = ""
    published: Published | dict[str, Published] | None = None
    where: str = ""
    bound: str = ""
    reason: str | dict[str, str] = ""
    read: bool = False
    judged: bool = True
    fraction: bool = False
    literal: bool = True
    shown: bool = True
    basis: str = ""
    deterministic: bool = False
    published_runs: int | None = None


class HypothesisEntry(DocumentModel):
    """A hypothesis: that a measure of a variant is above, or below, a threshold."""

    says: str
    of: str
    measure: str
    above: float | None = None
    below: float | None = None


class StudyFigure(DocumentModel):
    """A figure, drawn from the results by the function `draw` of the study's FIGURES (default: `name`)."""

    name: str
    caption: str
    draw: str = ""
    size: tuple[float, float] = (7.0, 4.5)


class Runs(DocumentModel):
    """Monte Carlo runs of each variant in a quick and in a full reproduction, and in one task of the campaign."""

    quick: int
    full: int
    block: int = 5


class ExperimentEntry(DocumentModel):
    """An experiment; see reproduction.Experiment.

    `variants` gives each variant's scenario (a file beside `study.yaml`, or the name of a shipped one), or a list of it
    and of the settings laid on it. An experiment named in the study's EXPERIMENTS has variants and claims from there.
    Claims on variants in `repairs` are not counted among the paper's. `bases` lists the variants of a basis: a claim
    without a `basis` of its own has that of its variant, or else the experiment's.
    """

    name: str
    title: str
    variants: dict[str, str | tuple[str, ...]] = {}  # noqa: RUF012 (pydantic copies it)
    runs: Runs
    claims: tuple[ClaimEntry, ...] = ()
    hypotheses: tuple[HypothesisEntry, ...] = ()
    figures: tuple[StudyFigure, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    bases: dict[str, tuple[str, ...]] = {}  # noqa: RUF012 (pydantic copies it)
    basis: str = "evidence"
    summary: str = ""
    literal: bool = True


class StudyDocument(DocumentModel):
    """A study: what is run, what is claimed and registered about the results, and what the measures and figures need.

    `published` holds what a paper prints, `registered` thresholds that were written before the runs. `main` lists the
    rows that Markdown tables have: for an experiment, the ids of claims and their variants or orders, or `all`.
    `published_runs` is the number of Monte Carlo runs behind a published value, where a claim gives no other.
    """

    source: str
    takes_data: bool = False
    published_runs: int = 0
    published: dict[str, Any] = {}  # noqa: RUF012 (pydantic copies it)
    registered: dict[str, Any] = {}  # noqa: RUF012 (pydantic copies it)
    experiments: tuple[ExperimentEntry, ...]
    main: tuple[dict[str, dict[str, str | tuple[str, ...]]], ...] = ()
