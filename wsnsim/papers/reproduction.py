"""What a reproduction is made of: experiments of variants, and claims about them with a verdict each.

    Experiment: variants that are run side by side;  Claim: a published figure of one of them
    Order: a published order of two of them;  Picture: a figure of the paper;  Row: what `wsnsim reproduce` prints

A paper's package holds EXPERIMENTS in experiments.py, which imports nothing heavy. The rule of the verdicts is RULE.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

Verdict = Literal[
    "reproduces", "same order", "does not reproduce", "cannot: beyond the bound", "undecided", "not judged",
    "not published",
]  # fmt: skip
CLOSE: Final = 0.1
"""Share of a published figure by which ours may differ and still be the same."""
FACTOR: Final = 2.0
"""Ratio up to which two figures are of the same order."""
NAN: Final = float("nan")


@dataclass(frozen=True)
class Variant:
    """One scenario of an experiment: a shipped scenario's name, and what is set in it, as `--set` takes it."""

    scenario: str
    sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Claim:
    """A figure that a paper prints (or, with None, that it should have printed) of one variant.

    `measure` names what is measured, `bound` the kind of bound to put beside it, '' for none: see `measures`.
    `reason` says in a line why it comes out as it does, `where` the table or figure that prints it.

    `read`: what is published is our reading of a curve or of words, no printed number. `judged`: False where the two
    cannot be compared, as seconds of two machines. `factor`: up to which ratio the two are of one order; nearer to one
    for shares. `literal`: False for what the paper does not claim, repairs and other readings; these are not counted.
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


@dataclass(frozen=True)
class Order:
    """A published order: the measure of `variant` is below that of `other`, replicate by replicate.

    `literal` as in Claim.
    """

    quantity: str
    variant: str
    other: str
    measure: str
    where: str = ""
    reason: str = ""
    literal: bool = True


@dataclass(frozen=True)
class Picture:
    """A figure of the paper, ours: `draw` names a function as 'module:function' that takes (figure, data=Data)."""

    name: str
    title: str
    draw: str
    size: tuple[float, float] = (7.0, 4.5)


@dataclass(frozen=True)
class Experiment:
    """Variants that are run side by side, on the same truths, as one campaign.

    `quick` and `full` are replicates a variant, `record` the tables that measures and pictures need beside `runs` and
    `tracks`. `sets` are laid on every variant, `quick_sets` in a quick run in addition. `says` names a function
    as 'module:function' that takes the data and gives lines to stand beneath the rows. `literal`: False where all of it
    is another reading than the paper's text, so that no claim is counted.
    """

    name: str
    title: str
    variants: Mapping[str, Variant]
    quick: int
    full: int
    claims: tuple[Claim | Order, ...] = ()
    pictures: tuple[Picture, ...] = ()
    record: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    quick_sets: tuple[str, ...] = ()
    block: int = 5
    says: str = ""
    literal: bool = True


class Measured(NamedTuple):
    """A figure with its 95 % interval, the replicates behind it, and the share of them that lost the target."""

    value: float
    low: float
    high: float
    replicates: int
    lost_fraction: float


class Limit(NamedTuple):
    """A bound beside a figure, and its kind.

    `strict`: below which nothing can be measured, not a number where the bound is not that; `caution` says why not.
    """

    value: float = NAN
    kind: str = ""
    strict: float = NAN
    caution: str = ""


@dataclass(frozen=True)
class Row:
    """One line of a reproduction."""

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


RULE: Final[Mapping[Verdict, str]] = {
    "reproduces": "ours is within 10 % of what is published; or that is in our 95 % interval, which is between "
    "half and twice of it; of an order: the whole interval of the paired difference has the published sign",
    "same order": "ours is between half and twice what is published (shares: within a fifth)",
    "does not reproduce": "neither; of an order: the whole interval has the other sign, or there is no difference",
    "cannot: beyond the bound": "what is published is below a strict bound: "
    "no filter is so good on average over truths",
    "undecided": "what is published is in the interval, which is wider than that; of an order: it holds zero",
    "not judged": "the two cannot be compared, as seconds on two machines",
}
"""How a verdict comes about."""


def judged(claim: Claim, found: Measured, strict: float = NAN) -> Verdict:
    """The verdict on a figure, by RULE; `strict` is the bound that no filter is below on average, if there is one."""
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


def ordered(found: Measured) -> Verdict:
    """The verdict on an order, by RULE, from the paired difference, which should be below zero."""
    if found.high < 0.0:
        return "reproduces"
    return "does not reproduce" if found.low > 0.0 or found.low == found.high == 0.0 else "undecided"
