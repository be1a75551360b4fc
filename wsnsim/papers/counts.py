"""The claims of a paper, counted: each printed number once, and each order or relation that it states in words once.

    counted_claims(rows) -> [CountedClaim, ...]   claims with the rows that are readings of them
    count_line(claims) -> str                     of the claims of one paper

Rows of one paper, place (`where`), quantity and variant in several experiments are readings of one claim. What follows
from two printed numbers (a place "from table 1"; an order of two values of a table) is derived, and not counted.
docs/verdicts.md explains the rule.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple, get_args

from wsnsim.papers.reproduction import FROM, LESS_THAN, ClaimRow
from wsnsim.papers.verdicts import Verdict

Kind = Literal["printed numbers", "in words", "derived (not counted)"]
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
        """What all readings say, if they say the same."""
        found = {OUTCOMES[row.verdict] for row in self.rows}
        return found.pop() if len(found) == 1 else "dependent on the reading"

    @property
    def undecidable(self) -> bool:
        """Whether it is undecided, and so few runs are published that it cannot reproduce with any number of ours."""
        return self.outcome == "undecided" and all(row.judgement.undecidable for row in self.rows)


def counted_claims(rows: Sequence[ClaimRow]) -> list[CountedClaim]:
    """The claims that rows of evidence are about; rows of repairs, and verdicts that say nothing, are left out."""
    claims: dict[tuple[str, ...], list[ClaimRow]] = {}
    for row in rows:
        if row.counted and row.verdict in OUTCOMES:
            claims.setdefault((row.paper, row.where, row.id or row.quantity, row.key), []).append(row)
    return [CountedClaim(_kind(readings[0]), tuple(readings)) for readings in claims.values()]


def _kind(row: ClaimRow) -> Kind:
    """What a row is about. Our reading of a curve or of words is no printed number."""
    order = LESS_THAN in row.key
    if row.where.startswith(FROM) or (order and row.where.startswith("table")):
        return "derived (not counted)"
    return "in words" if order or row.read else "printed numbers"


def count_line(claims: Sequence[CountedClaim]) -> str:
    """How many printed numbers of a paper, and of its claims in words, have each outcome."""
    parts = [_part(kind, [claim for claim in claims if claim.kind == kind]) for kind in get_args(Kind)]
    return f"{'; '.join(parts)}; {max(len(claim.rows) for claim in claims)} readings tried at most"


def _part(kind: Kind, claims: Sequence[CountedClaim]) -> str:
    """How many claims of a kind have each outcome."""
    found, never = Counter(claim.outcome for claim in claims), sum(claim.undecidable for claim in claims)
    outcomes = ", ".join(f"{found[outcome]} {outcome}" for outcome in get_args(Outcome) if found[outcome]) or "none"
    return f"{len(claims)} {kind}: {outcomes}" + (f" ({never} undecidable)" if never else "")
