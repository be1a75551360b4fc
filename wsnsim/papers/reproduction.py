"""What a reproduction is made of: experiments of variants, and claims about them with a verdict each.

    Experiment: variants that are run side by side;  Claim: a published figure of one of them
    Order: a published order of two of them;  Picture: a figure of the paper;  Row: what `wsnsim reproduce` prints

A paper's module holds EXPERIMENTS, and imports nothing heavy. The rule behind a verdict is RULE.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

Verdict = Literal["reproduces", "same order", "does not reproduce", "cannot: beyond the bound", "not published"]
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
    """

    quantity: str
    variant: str
    measure: str
    published: float | None = None
    where: str = ""
    bound: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Order:
    """A published order: the measure of `variant` is below that of `other`, replicate by replicate."""

    quantity: str
    variant: str
    other: str
    measure: str
    where: str = ""
    reason: str = ""


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
    as 'module:function' that takes the data and gives lines to stand beneath the rows.
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


RULE: Final[Mapping[Verdict, str]] = {
    "reproduces": "what is published lies in our 95 % interval or within 10 % of our figure, and is of its order; "
    "or the whole interval of the paired difference has the published sign",
    "same order": "ours is between half and twice what is published; or only the median difference has its sign",
    "does not reproduce": "anything else",
    "cannot: beyond the bound": "what is published lies below a strict bound: nobody could have measured it",
}
"""How a verdict comes about."""


def judged(published: float | None, found: Measured, strict: float = NAN) -> Verdict:
    """The verdict on a figure, by RULE; `strict` is the bound below which nothing can be measured, if there is one."""
    if published is None:
        return "not published"
    if math.isfinite(strict) and published < strict:
        return "cannot: beyond the bound"
    if not math.isfinite(found.value):
        return "does not reproduce"
    ratio = found.value / published if published else math.inf
    near = 1.0 / FACTOR <= ratio <= FACTOR or found.value == published
    if near and (found.low <= published <= found.high or abs(found.value - published) <= CLOSE * abs(published)):
        return "reproduces"
    return "same order" if near else "does not reproduce"


def ordered(found: Measured) -> Verdict:
    """The verdict on an order, by RULE, from the paired difference, which should be below zero."""
    if math.isfinite(found.high) and found.high < 0.0:
        return "reproduces"
    return "same order" if found.value < 0.0 else "does not reproduce"
