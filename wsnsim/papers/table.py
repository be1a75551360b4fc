"""The rows of a reproduction as a table for a terminal, and the claims as a Markdown table.

text(rows) -> str         cells(row) -> cells by HEADS         legend(rows) -> the meaning of words and marks
markdown(rows, lines) -> str                                    a row for each claim, as docs/papers shows them
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from wsnsim.analysis.phrases import wrapped
from wsnsim.papers.counts import CountedClaim, count_line, counted_claims, judged_claims
from wsnsim.papers.reproduction import BASES, LESS_THAN, ClaimRow
from wsnsim.papers.rows import ends
from wsnsim.papers.verdicts import ASTRAY, RULE, AstrayShare

KINDS: Final = {"unconditional": "u", "per_trajectory": "t", "active": "active", "arrived": "arrived"}
"""Kinds of bounds, as the table abbreviates them."""
MARKS: Final = (
    "u posterior (over all trajectories); t conditional on each trajectory, which a filter may beat on some; "
    "other: of another variant, or as the reason says; ~ not strict here"
)
"""What the abbreviations of KINDS and other marks of bounds mean."""
UNCOUNTED: Final = " *"
ABOUT: Final = "about"
ASSUMED: Final = "assumed"
NOWHERE: Final = "no value in any run"
UNDECIDABLE: Final = "undecidable"
WORDS_UNDECIDABLE: Final = "the paper's runs are too few: even with unlimited runs of ours the value cannot reproduce"
WORDS_READ: Final = "our reading of a curve or of words, not a printed number"
WORDS_UNCOUNTED: Final = "on a repair or on another reading of the paper; not counted among its claims"
WORDS_RUNS: Final = "ours / those behind the published value"
WORDS_ASSUMED: Final = "the paper does not give the number of runs behind the published value; this one is ours"
WORDS_ASTRAY: Final = f"share of runs with more than {ASTRAY:g} times the median of the runs [Clopper-Pearson, %]"
WORDS_LOST: Final = "share of runs (re-acquisitions in a run, mean over runs)"
OTHER_BASES: Final = tuple(basis for basis in BASES if basis != "evidence")
"""Bases on which a verdict is not counted."""
OUT_OF_REACH: Final = "out of reach"
CLAIM_HEADS: Final = ("claim", "published", "measured [95 %]", "outcome")
CLAIM_MARKS: Final = {
    OUT_OF_REACH: "the paper made so few runs that no number of ours could reproduce the value",
    **{f"({basis})": f"{words}; not counted" for basis, words in BASES.items() if basis in OTHER_BASES},
    ABOUT: WORDS_READ,
}
"""Marks of a claim's cells, and what they mean."""
HEADS: Final = (
    "quantity", "variant", "published", "measured [95 %]", "statistic", "bound", "runs", "astray", "lost", "verdict",
)  # fmt: skip


def text(rows: Sequence[ClaimRow]) -> str:
    """The rows by experiment with their reasons, the verdicts counted, and the legend; '' without rows."""
    lines: list[str] = []
    for (paper, experiment), block in groupby(rows, key=lambda row: (row.paper, row.experiment)):
        these = list(block)
        reading = f" [{these[0].reading}]" if these[0].reading else ""
        lines += ["", f"{paper}, {experiment}: {these[0].title}{reading}", *_block(these)]
    legends = [piece for line in (*verdict_counts(rows), *legend(rows)) for piece in wrapped(line, indent="    ")]
    return "\n".join([*lines[1:], "", *legends]) if rows else ""


def _block(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """The lines of an experiment; rows in sequence with the same reason have it once, beneath the last."""
    for row, after in zip(rows, [*rows[1:], None], strict=True):
        quantity, variant, *values, verdict = cells(row)
        yield from wrapped(f"{quantity}, {variant}: {verdict}", "  ", "      ")
        known = [f"{head} {value}" for head, value in zip(HEADS[2:-1], values, strict=True) if value != "-"]
        yield from wrapped("; ".join(known), "    ", "      ")
        if after is None or row.reason != after.reason:
            yield from wrapped(row.reason, "      ")
    for caution in dict.fromkeys(caution for row in rows for caution in row.caution.split("; ") if caution):
        yield f"  of the bound: {caution}"


def verdict_counts(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """Yield the outcomes of each paper's claims, and the verdicts of each kind on its rows that are not counted."""
    for paper, block in groupby(rows, key=lambda row: row.paper):
        these = list(block)
        yield from (*_counts(these), *_uncounted(paper, these))


def _counts(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """Yield the outcomes of each paper's claims."""
    for paper, block in groupby(counted_claims(rows), key=lambda claim: claim.rows[0].paper):
        yield f"{paper}: {count_line(list(block))}"


def _uncounted(name: str, rows: Sequence[ClaimRow]) -> Iterator[str]:
    """Yield the verdicts of each kind on rows of a paper that are not counted."""
    judged = [row for row in rows if row.verdict in RULE and row.verdict != "not judged" and not row.paired]
    kinds: dict[str, list[ClaimRow]] = {
        basis: [row for row in judged if row.literal and row.basis == basis] for basis in OTHER_BASES
    }
    kinds["repairs and other readings"] = [row for row in judged if not row.literal]
    for words, members in kinds.items():
        counts = Counter(row.verdict for row in members)
        if members:
            summary = ", ".join(f"{counts[verdict]} x {verdict}" for verdict in RULE if counts[verdict])
            yield f"{name}: {len(members)} not counted, {words}: {summary}"


def legend(rows: Sequence[ClaimRow]) -> list[str]:
    """The meanings of the verdicts, abbreviations and marks that occur in the rows."""
    judged = [row for row in rows if row.verdict in RULE]
    known = {basis: words for basis, words in BASES.items() if any(row.basis == basis for row in judged)}
    lines = [f"  {verdict}: {words}" for verdict, words in RULE.items() if any(row.verdict == verdict for row in rows)]
    statistics = dict.fromkeys((row.short, row.statistic) for row in rows if row.short not in ("", row.statistic))
    lines += [f"  {short}: {words}" for short, words in statistics]
    lines += [f"  ({basis}): {words}; not counted" for basis, words in known.items() if basis in OTHER_BASES]
    rules: dict[str, dict[str, None]] = {}
    for row in rows:
        if row.losses.lost_rule and math.isfinite(row.lost_fraction):
            rules.setdefault(row.losses.lost_rule, {})[row.paper] = None
    lines += [f"  lost ({', '.join(papers)}): {rule}, at any time" for rule, papers in rules.items()]
    for shown, words in (
        (any(not row.literal for row in judged), f"{UNCOUNTED.strip()}: {WORDS_UNCOUNTED}"),
        (any(math.isfinite(row.bound) for row in rows), f"bound: {MARKS}"),
        (any(row.read and math.isfinite(row.published) for row in rows), f"{ABOUT}: {WORDS_READ}"),
        (any(UNDECIDABLE in _verdict(row) for row in rows), f"{UNDECIDABLE}: {WORDS_UNDECIDABLE}"),
        (any(row.published_runs for row in rows), f"runs: {WORDS_RUNS}"),
        (any(row.published_runs and row.published_runs_assumed for row in rows), f"{ASSUMED}: {WORDS_ASSUMED}"),
        (any(math.isfinite(row.astray.value) for row in rows), f"astray: {WORDS_ASTRAY}"),
        (any(row.losses.reacquired > 0.0 for row in rows), f"lost: {WORDS_LOST}"),
    ):
        lines += [f"  {words}"] if shown else []
    return lines


def cells(row: ClaimRow) -> tuple[str, ...]:
    """The cells of a row, by HEADS."""
    return (
        row.quantity,
        row.variant,
        _published(row),
        _measured(row),
        row.short or "-",
        _bound(row),
        _runs(row),
        _astray(row.astray),
        _lost(row),
        _verdict(row),
    )


def _published(row: ClaimRow) -> str:
    """The published value; of one that we read from a curve, that it is about that."""
    return f"{ABOUT} {_number(row.published)}" if row.read and math.isfinite(row.published) else _number(row.published)


def _runs(row: ClaimRow) -> str:
    """Our runs, and those behind the published value."""
    published = f" / {row.published_runs}" if row.published_runs else ""
    return f"{row.replicates}{published}{f' {ASSUMED}' if published and row.published_runs_assumed else ''}"


def _verdict(row: ClaimRow) -> str:
    """The verdict, with the factor within which it holds, and a mark or basis if it is not counted."""
    if row.verdict not in RULE:
        return row.verdict
    within = row.judgement.within
    factor = f" within x {math.ceil(100 * within) / 100:.4g}" if row.verdict == "compatible" else ""
    factor += f"; {UNDECIDABLE}" if factor and row.judgement.undecidable else ""
    basis = "" if row.basis == "evidence" else f" ({row.basis})"
    return row.verdict + factor + basis + ("" if row.literal else UNCOUNTED)


def _measured(row: ClaimRow) -> str:
    """The measured value with its interval, or that there is no value in any run."""
    if not row.replicates and math.isnan(row.measured):
        return NOWHERE
    return _number(row.measured) + ends(row.low, row.high, ".4g") + _median(row)


def _median(row: ClaimRow) -> str:
    """The median of the runs, shown beside the mean of too few runs; otherwise ''."""
    value, low, high = row.median
    few = row.verdict == "too few runs" and math.isfinite(value) and value != row.measured
    return f", median {_number(value)}{ends(low, high, '.4g')}" if few else ""


def _lost(row: ClaimRow) -> str:
    """The share of runs that lost their target, and how often tracks were lost and found again in a run."""
    again = f" ({row.reacquired:.2g} re-acq.)" if row.reacquired > 0.0 else ""
    return _percent(row.lost_fraction) + again


def _astray(found: AstrayShare) -> str:
    """The share of runs astray with its interval, in per cent."""
    if not math.isfinite(found.value):
        return "-"
    return f"{_percent(found.value)} [{_hundredfold(found.low)}, {_hundredfold(found.high)}]"


def _percent(share: float) -> str:
    return f"{_hundredfold(share)} %" if math.isfinite(share) else "-"


def _hundredfold(share: float) -> str:
    """A share in per cent with two digits, and 100 without an exponent."""
    return f"{float(f'{100 * share:.2g}'):g}"


def _bound(row: ClaimRow) -> str:
    """The bound and its kind, with a '~' where it is not strict."""
    if not math.isfinite(row.bound):
        return "-"
    kind, _, caveat = row.bound_kind.partition(", ")
    return f"{'~' if caveat else ''}{_number(row.bound)} {KINDS.get(kind, 'other')}"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"


def markdown(rows: Sequence[ClaimRow], lines: Sequence[str] = ()) -> str:
    """A row for each judged claim (if none is judged, for each row), the verdicts counted, marks, and `lines`."""
    claims = [claim for claim in judged_claims(rows) if not claim.kind.startswith("derived")]
    found = [*map(claim_cells, claims)] or [(_said(row), _published(row), _measured(row), row.verdict) for row in rows]
    said = " ".join(cell for cells in found for cell in cells)
    marks = [f"{mark}: {words}" for mark, words in CLAIM_MARKS.items() if mark in said]
    notes = [f"- {_plain(line)}" for line in (*_counts(rows), *marks, *lines)]
    return "\n".join([*_markdown([CLAIM_HEADS, *found]), "", *notes])


def claim_cells(claim: CountedClaim) -> tuple[str, ...]:
    """The cells of a claim, by CLAIM_HEADS: of several readings, the least and the largest measured value."""
    row, values = claim.rows[0], [one.measured for one in claim.rows if math.isfinite(one.measured)]
    several = len(claim.rows) > 1 and values
    measured = f"{_number(min(values))} to {_number(max(values))}" if several else _measured(row)
    return _said(row), _published(row), measured, _outcome(claim)


def _said(row: ClaimRow) -> str:
    """What a row is about in one cell."""
    other = row.key.partition(LESS_THAN)[2]
    quantity = row.quantity.replace(f" below that of {other}", "", 1) if other else row.quantity
    return f"{row.key or row.variant}: {quantity}"


def _outcome(claim: CountedClaim) -> str:
    """The outcome of a claim, under how many readings others hold, whether it is out of reach, and what it rests on."""
    row, found, readings = claim.rows[0], claim.by_reading, len(claim.rows)
    apart = [
        f"{one} under {found[one]} of {readings}" for one in ("reproduced", "contradicted") if 0 < found[one] < readings
    ]
    outcome = claim.outcome + (f" ({', '.join(apart)})" if apart else "")
    basis = "" if row.basis == "evidence" else f" ({row.basis})"
    return outcome + (f", {OUT_OF_REACH}" if claim.undecidable else "") + basis


def _markdown(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table whose first row is its head."""
    for row in (rows[0], ["---"] * len(rows[0]), *rows[1:]):
        yield "| " + " | ".join(map(_plain, row)) + " |"


def _plain(cell: str) -> str:
    """A cell with Markdown's special characters escaped."""
    return cell.replace("|", "\\|").replace("~", "\\~").replace("_", "\\_").replace("*", "\\*")
