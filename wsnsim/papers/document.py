"""The keys of a paper's YAML file.

Any text may contain `<name>`: an entry of `published` or `texts`, or a variable of `each`. A text that is nothing else
takes the entry's value. A mapping in place of a value is a table. It gives the first entry it has for: the variant or
the order ('a < b'), the value of a variable, the experiment, a word of the variant's name (the last one first), `else`.
A value that is missing in its table keeps its default.
"""

from __future__ import annotations

from typing import Any

from wsnsim.scenario.documents import DocumentModel


class ClaimTemplate(DocumentModel):
    """One claim, or several that differ in a variant, an order or the variables of `each`. See reproduction.Claim.

    `claims` and `use` (a name of the file's shared claims) hold claims that inherit every key given beside them.
    `among` lists the only variants for which the claims hold.
    """

    each: dict[str, Any] | None = None
    claims: list[ClaimTemplate] | None = None
    use: str | None = None
    among: Any = None
    id: str | None = None
    quantity: str | None = None
    variant: Any = None
    order: str | list[str] | None = None
    measure: str | None = None
    published: Any = None
    where: Any = None
    bound: Any = None
    reason: Any = None
    read: bool | None = None
    judged: bool | None = None
    fraction: bool | None = None
    literal: Any = None
    shown: bool | None = None
    basis: Any = None
    deterministic: bool | None = None
    published_runs: Any = None


class PaperFigure(DocumentModel):
    """A figure of the paper, drawn from our results by the function `draw` of its FIGURES (default: `name`)."""

    name: str
    caption: str
    draw: str = ""
    size: tuple[float, float] = (7.0, 4.5)


class Runs(DocumentModel):
    """Monte Carlo runs of each variant in a quick and in a full reproduction, and in one task of the campaign."""

    quick: int
    full: int
    block: int = 5


class ExperimentTemplate(DocumentModel):
    """An experiment. See reproduction.Experiment.

    A variant's name consists of words that `words` explains: the name of a scenario, or settings. `[[a, b], [c, d]]`
    stands for all combinations: 'a, c', 'a, d', 'b, c', 'b, d'. `also` has further settings of single variants. Claims
    on variants with one of the words in `repairs` are not counted among the paper's. A claim without a `basis` has that
    of a word of its variants in `bases` ({word: basis}), or else the experiment's. `published_runs` is by default the
    paper's. `like` names another experiment, whose keys hold where this one has none.
    """

    name: str
    title: str
    like: str | None = None
    words: dict[str, str | list[str]] | None = None
    variants: tuple[Any, ...] = ()
    also: dict[str, list[str]] | None = None
    runs: Runs | None = None
    claims: tuple[ClaimTemplate, ...] = ()
    figures: tuple[PaperFigure, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    basis: str = "evidence"
    bases: dict[str, str] | None = None
    published_runs: int | None = None
    summary: str = ""
    literal: bool = True


class PaperDocument(DocumentModel):
    """A paper: what it prints, what is run for it, and what is claimed about the results.

    `words` holds for every experiment. `main` lists the rows in docs/papers: for an experiment, the ids of claims and
    the variants or orders shown, or `all`. `published_runs` is the number of Monte Carlo runs behind a
    published value, where an experiment or a claim gives no other.
    """

    source: str
    published: dict[str, Any]
    texts: dict[str, Any]
    words: dict[str, str | list[str]]
    published_runs: int = 0
    shared: dict[str, list[ClaimTemplate]] | None = None
    experiments: list[ExperimentTemplate]
    main: tuple[dict[str, dict[str, Any]], ...] = ()
