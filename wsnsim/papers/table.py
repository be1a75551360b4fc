"""The rows of a reproduction as a table for a terminal.

text(rows) -> str         cells(row) -> cells by HEADS         legend(rows) -> the meaning of words and marks
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from wsnsim.analysis.phrases import aligned
from wsnsim.papers.reproduction import RULE, ClaimRow

KINDS: Final = {"unconditional": "u", "per_trajectory": "t", "active": "active", "arrived": "arrived"}
MARKS: Final = (
    "u posterior (over all trajectories); t conditional on each trajectory, which a filter may beat on some; "
    "other: of another variant, or as the reason says; ~ not strict here"
)
UNCOUNTED: Final = " *"
READ: Final = "about"
WORDS_READ: Final = "our reading of a curve or of words, not a printed number"
FEW: Final = 30
HEADS: Final = ("quantity", "variant", "published", "measured [95 %]", "bound", "runs", "lost", "verdict")


def text(rows: Sequence[ClaimRow]) -> str:
    """The rows by experiment, each with its reason beneath, and the verdicts counted by kind; '' without rows."""
    lines: list[str] = []
    for (paper, experiment), block in groupby(rows, key=lambda row: (row.paper, row.experiment)):
        these = list(block)
        lines += ["", f"{paper}, {experiment}: {these[0].title}", *_block(these)]
    return "\n".join([*lines[1:], "", *_verdicts(rows)]) if rows else ""


def _block(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """The lines of an experiment."""
    heading, *lines = aligned([HEADS, *map(cells, rows)], len(HEADS))
    yield heading
    for row, line, after in zip(rows, lines, [*rows[1:], None], strict=True):
        yield line
        if after is None or row.reason != after.reason:
            yield f"      {row.reason}"
    for caution in dict.fromkeys(caution for row in rows for caution in row.caution.split("; ") if caution):
        yield f"  of the bound: {caution}"


def _verdicts(rows: Sequence[ClaimRow]) -> list[str]:
    """The number of verdicts of each kind on the claims of each paper, and the legend."""
    papers = list(dict.fromkeys(row.paper for row in rows))
    lines = [line for paper in papers for line in _counted(paper, [row for row in rows if row.paper == paper])]
    return [*lines, *(_counted("all", rows) if len(papers) > 1 else []), *legend(rows)]


def _counted(name: str, rows: Sequence[ClaimRow]) -> Iterator[str]:
    judged = [row for row in rows if row.verdict in RULE and row.verdict != "not judged"]
    kinds = {"claims": [row for row in judged if row.literal]}
    kinds["rows on repairs and other readings"] = [row for row in judged if not row.literal]
    for words, some in kinds.items():
        counts = Counter(row.verdict for row in some)
        if some:
            summary = ", ".join(f"{counts[verdict]} x {verdict}" for verdict in RULE if counts[verdict])
            yield f"{name}: {len(some)} {words}: {summary}"


def legend(rows: Sequence[ClaimRow]) -> list[str]:
    """The rule of the verdicts and the marks of bounds, as far as the rows have them."""
    lines = [f"  {verdict}: {words}" for verdict, words in RULE.items() if any(row.verdict == verdict for row in rows)]
    if any(math.isfinite(row.bound) for row in rows):
        lines.append(f"  bound: {MARKS}")
    if any(row.read and math.isfinite(row.published) for row in rows):
        lines.append(f"  {READ}: {WORDS_READ}")
    if any(row.verdict in RULE and not row.literal for row in rows):
        lines.append(
            f"  {UNCOUNTED.strip()}: on a repair or on another reading of the paper; not counted among its claims"
        )
    if any(row.replicates < FEW and math.isfinite(row.low) for row in rows):
        lines.append(
            f"  runs: with fewer than {FEW}, the interval of a mean or an RMSE may miss that single runs diverge"
        )
    return lines


def cells(row: ClaimRow) -> tuple[str, ...]:
    """The cells of a row, by HEADS."""
    interval = f" [{_number(row.low)}, {_number(row.high)}]" if math.isfinite(row.low) else ""
    return (
        row.quantity,
        row.variant,
        f"{READ} {_number(row.published)}" if row.read and math.isfinite(row.published) else _number(row.published),
        _number(row.measured) + interval,
        _bound(row),
        str(row.replicates),
        f"{100 * row.lost_fraction:.0f} %" if math.isfinite(row.lost_fraction) else "-",
        row.verdict + (UNCOUNTED if row.verdict in RULE and not row.literal else ""),
    )


def _bound(row: ClaimRow) -> str:
    """The bound and its kind, with a '~' where it is not strict."""
    if not math.isfinite(row.bound):
        return "-"
    kind, _, more = row.bound_kind.partition(", ")
    return f"{'~' if more else ''}{_number(row.bound)} {KINDS.get(kind, 'other')}"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"
