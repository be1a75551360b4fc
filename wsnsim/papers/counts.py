"""The claims of a paper, counted: each printed number once, and each order or relation that it states in words once.

    judged_claims(rows) -> [CountedClaim, ...]    claims with the rows that are readings of them
    counted_claims(rows) -> [CountedClaim, ...]   those of evidence
    count_line(claims) -> str                     of the claims of one paper
    stated_claims(rows), outcome_line(rows)       the same without derived ones, whether they are counted or not

Rows of one paper, place (`where`), quantity and variant in several experiments are readings of one claim. What follows
from two printed numbers (a place "from table 1"; an order of two values of a table) is derived, and not counted.
docs/verdicts.md explains the rule.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple, get_args

from wsnsim.papers.reproduction import FROM, LESS_THAN, ClaimRow
from wsnsim.papers.verdicts import OUT_OF_REACH, Verdict

Kind = Literal["printed numbers", "in words", "derived (not counted)"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
Outcome = Literal["reproduced", "contradicted", "undecided", "dependent on the reading"]
OUTCOMES: Final[Mapping[Verdict, Outcome]] = {
    "reproduces": "reproduced",
    **dict.fromkeys(("compatible", "undecided", "too few runs"), "undecided"),
    **dict.fromkeys(("within a factor of two", "does not reproduce", "cannot: beyond the bound"), "contradicted"),
}
"""What each verdict says of a claim; the others say nothing."""


class CountedClaim(NamedTuple):
    """A claim and its rows, one for each reading of the paper."""

    kind: Kind
    rows: tuple[ClaimRow, ...]

    @property
    def outcome(self) -> Outcome:
        """What all readings say, if they say the same; dependent only if one reproduces and another one contradicts."""
        if len(self.by_reading) == 1:
            return next(iter(self.by_reading))
        apart = {"reproduced", "contradicted"} <= self.by_reading.keys()
        return "dependent on the reading" if apart else "undecided"

    @property
    def by_reading(self) -> Counter[Outcome]:
        """The number of readings with each outcome."""
        return Counter(OUTCOMES[row.verdict] for row in self.rows)

    @property
    def undecidable(self) -> bool:
        """Whether so few runs are published that no number of ours could have reproduced it under any reading."""
        return "reproduced" not in self.by_reading and all(row.judgement.undecidable for row in self.rows)


def judged_claims(rows: Sequence[ClaimRow]) -> list[CountedClaim]:
    """The claims that rows are about, each with the rows that are readings of it, in the order of their first row.

    Rows of repairs, medians beside orders, and verdicts that say nothing are left out.
    """
    claims: dict[tuple[str, ...], list[ClaimRow]] = {}
    for row in rows:
        if row.literal and not row.paired and row.verdict in OUTCOMES:
            claims.setdefault((row.paper, row.where, row.id or row.quantity, row.key, row.basis), []).append(row)
    return [CountedClaim(kind_of(readings[0]), tuple(readings)) for readings in claims.values()]


def stated_claims(rows: Sequence[ClaimRow]) -> list[CountedClaim]:
    """The claims that rows are about, counted or not, without derived ones."""
    return [claim for claim in judged_claims(rows) if not claim.kind.startswith("derived")]


def outcome_line(rows: Sequence[ClaimRow]) -> str:
    """How many of the stated claims have each outcome, and how many of them are counted."""
    claims = stated_claims(rows)
    found = Counter(claim.outcome for claim in claims)
    said = ", ".join(f"{found[outcome]} {outcome}" for outcome in get_args(Outcome) if found[outcome])
    return (
        f"{said}, {sum(claim.rows[0].counted for claim in claims) or 'none'} counted" if said else "nothing is judged"
    )


def counted_claims(rows: Sequence[ClaimRow]) -> list[CountedClaim]:
    """The claims that rows of evidence are about."""
    return judged_claims([row for row in rows if row.counted])


def kind_of(row: ClaimRow) -> Kind:
    """What a row is about. Our reading of a curve or of words is no printed number."""
    order = LESS_THAN in row.key
    if row.where.startswith(FROM) or (order and row.where.startswith("table")):
        return "derived (not counted)"
    return "in words" if order or row.read else "printed numbers"


def count_line(claims: Sequence[CountedClaim]) -> str:
    """How many printed numbers of a paper, and of its claims in words, have each outcome."""
    kinds = {kind: [claim for claim in claims if claim.kind == kind] for kind in KINDS}
    readings = max(len(claim.rows) for claim in claims)
    parts = [_part(kind, members) for kind, members in kinds.items() if members]
    return f"{'; '.join(parts)}; {readings} reading{'s' if readings > 1 else ''} counted at most"


def _part(kind: Kind, claims: Sequence[CountedClaim]) -> str:
    """How many claims of a kind have each outcome."""
    found = Counter(claim.outcome for claim in claims)
    never = Counter(claim.outcome for claim in claims if claim.undecidable)
    outcomes = [
        f"{found[outcome]} {outcome}" + (f" ({never[outcome]} {OUT_OF_REACH})" if never[outcome] else "")
        for outcome in get_args(Outcome) if found[outcome]
    ]  # fmt: skip
    words = kind.replace("numbers", "number") if len(claims) == 1 else kind
    return f"{len(claims)} {words}: {', '.join(outcomes)}"
