"""Experiments of a paper, claims about them, and the rule that gives each claim its verdict.

    Experiment: variants that run side by side as one campaign       Variant: one scenario of an experiment
    Claim: a published value of one variant, or order of two         ClaimRow: one line of `wsnsim reproduce`

`wsnsim.papers.paper` reads experiments from a paper's YAML file. RULE states the rule of the verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from wsnsim.papers.document import PaperFigure

Verdict = Literal[
    "reproduces", "same order", "does not reproduce", "cannot: beyond the bound", "undecided", "not judged",
    "not published",
]  # fmt: skip
Basis = Literal["evidence", "reconstruction", "construction", "our constant"]
BASES: Final[Mapping[Basis, str]] = {
    "evidence": "a result of the paper's method in the paper's set-up",
    "reconstruction": "of a method that we rebuilt from a few words of the paper",
    "construction": "true by the construction of the method, whatever the data are",
    "our constant": "set by a constant that the paper does not give and that we chose",
}
"""What a claim rests on. Only claims that rest on evidence are counted."""
CLOSE: Final = 0.1
"""Relative difference up to which a measured value reproduces the published one."""
FACTOR: Final = 2.0
"""Ratio up to which two values are of the same order."""
NAN: Final = float("nan")


@dataclass(frozen=True)
class Variant:
    """The name of a shipped scenario, and the settings laid on it (as `--set` takes them)."""

    scenario: str
    sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Claim:
    """A value that a paper prints for one variant, or the order of two variants.

    Attributes:
        measure: what is measured, see `wsnsim.papers.measures`.
        published: None for a value that the paper does not print, and for an order.
        bound: the kind of bound beside it, '' for none; see `measures.bound_beside`.
        where: the table or figure that prints the value.
        reason: one line on why the result is as it is: a format string over rows, see `wsnsim.papers.reasons`.
        read: True if the value is our reading of a curve or of words, not a printed number.
        judged: False if the two values cannot be compared, such as seconds on two machines.
        factor: the ratio up to which the two are of the same order; nearer to one for fractions.
        literal: False for repairs and other readings, which are not counted among the paper's claims.
        id: the name under which reasons and the list of main rows refer to the claim.
        shown: False for a value that only reasons use.
        other: for the order of two variants: the variant whose measure is larger; otherwise ''.
        basis: what the claim rests on, see BASES.
        deterministic: True if the measured value is not random, such as an operation count.
        published_runs: Monte Carlo runs behind the published value; 0 if it has no Monte Carlo error.
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
    factor: float = FACTOR
    literal: bool = True
    id: str = ""
    shown: bool = True
    other: str = ""
    basis: Basis = "evidence"
    deterministic: bool = False
    published_runs: int = 0

    @property
    def label(self) -> str:
        """The row's quantity, of an order with the other variant, and where the paper prints it."""
        compared = f" below that of {self.other}" if self.other else ""
        return self.quantity + compared + (f" ({self.where})" if self.where else "")

    @property
    def key(self) -> str:
        """The claim's name among those with the same id."""
        return f"{self.variant} < {self.other}" if self.other else self.variant


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
        summary: the function of the paper's SUMMARIES that gives lines beneath the rows, '' for none.
        literal: False if the whole experiment is another reading of the paper, so that no claim is counted.
    """

    name: str
    title: str
    variants: Mapping[str, Variant]
    quick: int
    full: int
    claims: tuple[Claim, ...] = ()
    figures: tuple[PaperFigure, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    block: int = 5
    summary: str = ""
    literal: bool = True


class Measured(NamedTuple):
    """A value with its 95 % interval, the number of runs, and the fraction of them that ever lost the target."""

    value: float
    low: float
    high: float
    replicates: int
    lost_fraction: float


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
    """One line of a reproduction: a claim with its measured value, bound and verdict."""

    paper: str
    experiment: str
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
    verdict: Verdict
    reason: str
    caution: str = ""
    read: bool = False
    literal: bool = True
    title: str = ""
    id: str = ""
    key: str = ""

    @property
    def lost(self) -> float:
        """The number of runs that lost the target at any time."""
        return self.lost_fraction * self.replicates


RULE: Final[Mapping[Verdict, str]] = {
    "reproduces": "the measured value is within 10 % of the published one; or the published value is in the measured "
    "95 % interval, and that interval lies between half and twice the published value; of an order: the whole "
    "interval of the paired difference has the published sign",
    "same order": "the measured value is between half and twice the published one (fractions: within a fifth)",
    "does not reproduce": "neither; of an order: the whole interval has the other sign, or there is no difference",
    "cannot: beyond the bound": "the published value is below a strict bound, "
    "which no filter is on average over ground truths",
    "undecided": "the published value is in the interval, which is wider than that; of an order: it contains zero",
    "not judged": "the two cannot be compared, such as seconds on two machines",
}
"""How a verdict is reached."""


def verdict_on_value(claim: Claim, found: Measured, strict: float = NAN) -> Verdict:
    """The verdict on a value, by RULE; `strict` is the bound that no filter is below on average, NaN without one."""
    published = claim.published
    if published is None:
        return "not published"
    if not claim.judged:
        return "not judged"
    if math.isfinite(strict) and published < strict:
        return "cannot: beyond the bound"
    if not math.isfinite(found.value):
        return "does not reproduce"
    if abs(found.value - published) <= CLOSE * abs(published):
        return "reproduces"
    low, high = (published / claim.factor, published * claim.factor)
    if found.low <= published <= found.high:
        return "reproduces" if low <= found.low and found.high <= high else "undecided"
    return "same order" if low <= found.value <= high else "does not reproduce"


def verdict_on_order(found: Measured) -> Verdict:
    """The verdict on an order, by RULE, from the paired difference: below zero as published."""
    if found.high < 0.0:
        return "reproduces"
    return "does not reproduce" if found.low > 0.0 or found.low == found.high == 0.0 else "undecided"
