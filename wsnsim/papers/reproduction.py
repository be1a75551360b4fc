"""Experiments of a paper, claims about them, and the rows that compare both.

    Experiment: variants that run side by side as one campaign       Variant: one scenario of an experiment
    Claim: a published value of one variant, or order of two         ClaimRow: one line of `wsnsim reproduce`

`wsnsim.papers.study` reads experiments from a study's file; `wsnsim.papers.verdicts` judges.

Reasons are format strings over rows: '{rmse[pf, 50].measured:.1f} m', or '{row.lost:.0f}' of the row itself.

    problems(reason, keys) -> [message, ...]          checked when a study's file is loaded
    rendered(reason, row, rows) -> str                once the rows are measured
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from string import Formatter
from typing import Any, Final, Literal, NamedTuple

from wsnsim.base.errors import did_you_mean
from wsnsim.base.tables import TABLES
from wsnsim.papers.study_file import RegisteredHypothesis, StudyFigure
from wsnsim.papers.verdicts import NO_SHARE, AstrayShare, Judgement, Verdict

Basis = Literal["evidence", "reconstruction", "construction", "our constant"]
BASES: Final[Mapping[Basis, str]] = {
    "evidence": "a result of the paper's method in the paper's set-up",
    "reconstruction": "of a method, or of measurements, that we rebuilt from a few words of the paper",
    "construction": "true by the construction of the method, whatever the data are",
    "our constant": "the value follows from a constant that the paper does not give and that we chose",
}
"""What a claim rests on. Only claims that rest on evidence are counted."""
NAN: Final = float("nan")
LESS_THAN: Final = " < "
FROM: Final = "from "
"""How the place of a value begins that is computed from printed ones."""


@dataclass(frozen=True)
class Variant:
    """The name of a shipped scenario, and the settings laid on it (as `--set` takes them)."""

    scenario: str
    sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Claim:
    """A value that a paper prints for one variant, or the order of two variants.

    Attributes:
        measure: what is measured, see `wsnsim.papers.measures`; of an order: the published statistic.
        published: None for a value that the paper does not print, and for an order.
        bound: the kind of bound beside it, '' for none; see `rows.bound_beside`.
        where: the table or figure that prints the value, or the section that states an order; 'from table 1' of a value
            computed from printed ones.
        reason: one line on why the result is as it is: a format string over rows, see `rendered`.
        read: True if the value is our reading of a curve or of words, not a printed number.
        judged: False if the two values cannot be compared, such as seconds on two machines.
        fraction: True for a fraction of at most 1; a few runs cannot move it far from a published value of 1/2 or more.
        literal: False for repairs and other readings, which are not counted among the paper's claims.
        id: the name under which reasons refer to the claim.
        shown: False for a value that only reasons use.
        other: for the order of two variants: the variant whose measure is larger; otherwise ''.
        basis: what the claim rests on, see BASES.
        deterministic: True if the measured value is not random, such as an operation count.
        published_runs: Monte Carlo runs behind the published value; 0 if it has no Monte Carlo error.
        published_runs_assumed: True if this number is our assumption.
    """

    quantity: str
    variant: str
    measure: str
    published: float | None = None
    where: str = ""
    bound: str = ""
    reason: str = ""
    read: bool = False
    judged: bool = True
    fraction: bool = False
    literal: bool = True
    id: str = ""
    shown: bool = True
    other: str = ""
    basis: Basis = "evidence"
    deterministic: bool = False
    published_runs: int = 0
    published_runs_assumed: bool = False

    @property
    def label(self) -> str:
        """The row's quantity, of an order with the other variant, and where the paper prints it."""
        name, *unit = self.quantity.rsplit(", ", 1)
        compared = ", ".join([f"{name} minus that of {self.other}", *unit]) if self.other else self.quantity
        return compared + (f" ({self.where})" if self.where else "")

    @property
    def key(self) -> str:
        """The claim's name among those with the same id."""
        return f"{self.variant}{LESS_THAN}{self.other}" if self.other else self.variant


@dataclass(frozen=True)
class Experiment:
    """Variants that run side by side on the same ground truths, as one campaign.

    Attributes:
        quick: Monte Carlo runs of each variant in a quick reproduction.
        full: the same in a full one.
        record: the tables that measures and figures need in addition to `runs` and `tracks`.
        sets: settings laid on every variant.
        quick_sets: further settings in a quick reproduction.
        block: runs in one task of the campaign.
        hypotheses: what was registered before the runs, and is answered beneath the rows.
        summary: the function of the study's SUMMARIES that gives lines beneath the rows, '' for none.
        literal: False if the whole experiment is another reading of the paper, so that no claim is counted.
        reading: how the experiment reads what the paper leaves open, '' if there is one reading alone. Rows of the same
            paper, `where`, id and variant in several experiments are readings of one printed number.
    """

    name: str
    title: str
    variants: Mapping[str, Variant]
    quick: int
    full: int
    claims: tuple[Claim, ...] = ()
    hypotheses: tuple[RegisteredHypothesis, ...] = ()
    figures: tuple[StudyFigure, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    block: int = 5
    summary: str = ""
    literal: bool = True
    reading: str = ""


class Measured(NamedTuple):
    """A value with its 95 % interval, the number of runs, and the fraction of them that ever lost the target."""

    value: float
    low: float
    high: float
    replicates: int
    lost_fraction: float


class Losses(NamedTuple):
    """What tracks lose and find again, means over runs: re-acquisitions, losses, time lost (s); NaN if not recorded.

    `lost_rule` says when a track is lost; empty if it is unknown.
    """

    reacquired: float = NAN
    losses: float = NAN
    time_lost: float = NAN
    lost_rule: str = ""


NOT_RECORDED: Final = Losses()


class BoundBeside(NamedTuple):
    """A bound beside a value, and its kind.

    `strict` is the limit below which no filter is on average; NaN for a bound that is not strict. `caution` says why.
    """

    value: float = NAN
    kind: str = ""
    strict: float = NAN
    caution: str = ""


@dataclass(frozen=True)
class ClaimRow:
    """One line of a reproduction: a claim with its measured value, bound and verdict.

    Attributes:
        statistic: the statistic over runs, in words.
        published_runs: the runs behind the published value; 0 if it has no Monte Carlo error, or if there is none.
        published_runs_assumed: True if this number is our assumption.
        judgement: the verdict, and the interval of measured / published.
        astray: the share of runs astray; NaN for orders.
        median: the median of the runs' values, with its interval.
        losses: re-acquisitions and losses of the variant.
        where: the place in the paper, see Claim.
        paired: True for the row that an order has beside it: the median of the paired differences, not counted.
    """

    quantity: str
    variant: str
    published: float
    measured: float
    low: float
    high: float
    replicates: int
    lost_fraction: float
    bound: float
    bound_kind: str
    judgement: Judgement
    reason: str
    caution: str = ""
    read: bool = False
    literal: bool = True
    basis: Basis = "evidence"
    statistic: str = ""
    published_runs: int = 0
    published_runs_assumed: bool = False
    astray: AstrayShare = NO_SHARE
    median: tuple[float, float, float] = (NAN, NAN, NAN)
    losses: Losses = NOT_RECORDED
    paired: bool = False
    paper: str = ""
    experiment: str = ""
    title: str = ""
    reading: str = ""
    id: str = ""
    key: str = ""
    where: str = ""

    @property
    def lost(self) -> float:
        """The number of runs that lost the target at any time."""
        return self.lost_fraction * self.replicates

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return self.judgement.verdict

    @property
    def reacquired(self) -> float:
        """The mean number of re-acquisitions in a run."""
        return self.losses.reacquired

    @property
    def counted(self) -> bool:
        """Whether the verdict is counted among those on the paper's claims."""
        return self.literal and self.basis == "evidence" and not self.paired


def row_of(content: Mapping[str, Any]) -> ClaimRow:
    """The row with this content, in which tuples may be lists, as `json` gives them."""
    nested = {"judgement": Judgement, "astray": AstrayShare, "losses": Losses}
    return ClaimRow(
        **{name: nested[name](*value) if name in nested else value for name, value in content.items()}
        | {"median": tuple(content["median"])}
    )


COMPARED: Final = ("over", "less_than")
"""Measures of a variant in the terms of those of another."""
OF_ANOTHER: Final = "; "
"""Between a variant and the measure that is compared."""


def measure_problem(measure: str, own: Collection[str], variants: Collection[str]) -> str:
    """What is wrong with the name of a measure; '' if nothing is."""
    family, _, rest = measure.partition(":")
    columns = {table: [column.name for column in TABLES[table]] for table in ("runs", "tracks")}
    known: dict[str, Collection[str] | None] = {
        **dict.fromkeys(("rmse", "rmse_of_kept")),
        **{name: [rest] for name in ("column", "column_of_kept", "per_run_rmse")},
        **{name: [*own, *columns["runs"]] for name in ("mean", "median")},
        "share": columns["runs"],
        **dict.fromkeys(("tracks", "tracks_mean", "tracks_median"), columns["tracks"]),
    }
    if family in COMPARED:
        rival, _, compared = rest.partition(OF_ANOTHER)
        if rival not in variants:
            return f"{family}: unknown name '{rival}' ({did_you_mean(rival, variants)})"
        return measure_problem(compared, own, ()) if compared else ""
    if family not in known:
        return f"unknown measure '{family}' ({did_you_mean(family, [*known, *COMPARED])})"
    names = known[family]
    return "" if names is None or rest in names else f"{family}: unknown name '{rest}' ({did_you_mean(rest, names)})"


FIELD: Final = re.compile(r"(row|(?P<id>\w+)\[(?P<key>[^\]]+)\])\.(?P<value>\w+)")
VALUES: Final = ("published", "measured", "low", "high", "replicates", "lost", "lost_fraction", "bound", "reacquired")


def problems(reason: str, keys: Mapping[str, Collection[str]]) -> Iterator[str]:
    """What is wrong with a reason, given the keys (variants, or orders) of the rows of each id."""
    try:
        fields = [(name, spec or "") for _, name, spec, _ in Formatter().parse(reason) if name is not None]
    except ValueError as error:
        yield f"not a format string: {error}"
        return
    for name, spec in fields:
        found = FIELD.fullmatch(name)
        if found is None:
            yield f"'{{{name}}}' is not of the form 'row.measured' or 'id[variant].measured'"
            continue
        if found["id"] and found["id"] not in keys:
            yield f"no row has the id '{found['id']}' ({did_you_mean(found['id'], keys)})"
        elif found["id"] and found["key"] not in keys[found["id"]]:
            yield f"no row is '{found['id']}[{found['key']}]' ({did_you_mean(found['key'], keys[found['id']])})"
        if found["value"] not in VALUES:
            yield f"a row has no number '{found['value']}' ({did_you_mean(found['value'], VALUES)})"
        try:
            format(1.0, spec)
        except ValueError as error:
            yield f"'{{{name}:{spec}}}': {error}"


def rendered(reason: str, row: ClaimRow, rows: Mapping[str, Mapping[str, ClaimRow]]) -> str:
    """The reason of a row with the numbers of the rows that it names, by id and key."""
    return _Numbers().vformat(reason, (), {"row": row, **rows})


class _Numbers(Formatter):
    """Formats numbers; those that no run has are unknown."""

    def format_field(self, value: float, spec: str) -> str:
        return "unknown" if math.isnan(value) else format(value, spec)
