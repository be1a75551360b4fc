"""The rows of a reproduction as a text for a terminal, and the claims as a Markdown table.

text(rows) -> str         cells(row) -> what is known of a row, by name         legend(rows) -> the meaning of the words
markdown(rows, lines) -> str                                    a row for each claim, as docs/papers shows them
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final

from wsnsim.analysis.phrases import wrapped
from wsnsim.papers.counts import CountedClaim, count_line, counted_claims, stated_claims
from wsnsim.papers.reproduction import BASES, LESS_THAN, ClaimRow
from wsnsim.papers.rows import ends
from wsnsim.papers.verdicts import ASTRAY, OUT_OF_REACH, RULE, AstrayShare

NOWHERE: Final = "no value in any run"
ABOUT: Final = "about"
OTHER_BASES: Final = tuple(basis for basis in BASES if basis != "evidence")
"""Bases on which a verdict is not counted."""
CLAIM_HEADS: Final = ("claim", "published", "measured [95 %]", "outcome")
CLAIM_MARKS: Final = {
    OUT_OF_REACH: "so few runs are behind the published value that it could not be confirmed within 10 %, however many "
    "runs we make",
    **{f"({basis})": f"{words}; not counted" for basis, words in BASES.items() if basis in OTHER_BASES},
    ABOUT: "our reading of a curve or of words, not a printed number",
}
"""Marks of a claim's cells, and what they mean."""
MARKS: Final = CLAIM_MARKS | {
    "bound": "no filter has a smaller error on average over all trajectories (unconditional), or along each of them "
    "(per_trajectory; a filter may have on some); other kinds name what they are from",
    "not strict": "a filter may be below this bound",
}
"""The same of a row's cells."""


def text(rows: Sequence[ClaimRow]) -> str:
    """The rows by experiment with their reasons, the verdicts counted, and the legend; '' without rows."""
    lines: list[str] = []
    for (paper, experiment), block in groupby(rows, key=lambda row: (row.paper, row.experiment)):
        these = list(block)
        reading = f" [{these[0].reading}]" if these[0].reading else ""
        lines += ["", f"{paper}, {experiment}: {these[0].title}{reading}", *_block(these)]
    legends = [piece for line in (*_counts(rows), *legend(rows)) for piece in wrapped(line, indent="    ")]
    return "\n".join([*lines[1:], "", *legends]) if rows else ""


def _block(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """The lines of an experiment; rows in sequence with the same reason have it once, beneath the last."""
    for row, after in zip(rows, [*rows[1:], None], strict=True):
        yield from wrapped(f"{_said(row)}: {_verdict(row)}", "  ", "      ")
        yield from wrapped("; ".join(f"{name} {value}" for name, value in cells(row).items()), "    ", "      ")
        if after is None or row.reason != after.reason:
            yield from wrapped(row.reason, "      ")
    for caution in dict.fromkeys(caution for row in rows for caution in row.caution.split("; ") if caution):
        yield f"  of the bound: {caution}"


def _counts(rows: Sequence[ClaimRow]) -> Iterator[str]:
    """Yield the outcomes of each paper's claims."""
    for paper, block in groupby(counted_claims(rows), key=lambda claim: claim.rows[0].paper):
        yield f"{paper}: {count_line(list(block))}"


def legend(rows: Sequence[ClaimRow]) -> list[str]:
    """The meanings of the verdicts and marks that occur in the rows."""
    said = "; ".join(piece for row in rows for pair in cells(row).items() for piece in (*pair, _verdict(row)))
    said += "; ".join(_counts(rows))
    lines = [f"{verdict}: {words}" for verdict, words in RULE.items() if any(row.verdict == verdict for row in rows)]
    lines += _meanings(MARKS, said)
    lines += [f"lost ({row.paper}): {row.losses.lost_rule}, at any time" for row in rows
              if row.losses.lost_rule and math.isfinite(row.lost_fraction)]  # fmt: skip
    return [f"  {line}" for line in dict.fromkeys(lines)]


def _meanings(marks: Mapping[str, str], said: str) -> list[str]:
    """What the marks mean that occur in cells."""
    return [f"{mark}: {words}" for mark, words in marks.items() if mark in said]


def cells(row: ClaimRow) -> dict[str, str]:
    """What is known of a row."""
    found = {
        "published": _published(row),
        "measured [95 %]": _measured(row),
        "statistic": row.statistic or "-",
        "bound": f"{_number(row.bound)} ({row.bound_kind})" if math.isfinite(row.bound) else "-",
        "runs": _runs(row),
        f"astray (above {ASTRAY:g} times the median)": _astray(row.astray),
        "lost at any time": _lost(row),
    }
    return {name: cell for name, cell in found.items() if cell != "-"}


def _published(row: ClaimRow) -> str:
    """The published value; of one that we read from a curve, that it is about that."""
    if LESS_THAN in row.key:
        return "below 0"
    return f"{ABOUT} {_number(row.published)}" if row.read and math.isfinite(row.published) else _number(row.published)


def _runs(row: ClaimRow) -> str:
    """Our runs, and those behind the published value."""
    assumed = ", which we assume" if row.published_runs_assumed else ""
    return f"{row.replicates}{f' (paper: {row.published_runs}{assumed})' if row.published_runs else ''}"


def _verdict(row: ClaimRow) -> str:
    """The verdict, with the factor within which it holds, and why it is not counted."""
    said: str = row.verdict
    if said == "compatible":
        said += f" within x {math.ceil(100 * row.judgement.within) / 100:.4g}"
        said += f", {OUT_OF_REACH}" if row.judgement.undecidable else ""
    apart: list[str] = [row.basis] if row.basis != "evidence" else []
    apart += [] if row.literal else ["a repair or another reading of the paper"]
    apart += ["paired by run, not as published"] if row.paired else []
    return said + (f", not counted{''.join(f' ({why})' for why in apart)}" if apart and row.verdict in RULE else "")


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
    again = f" of runs ({row.reacquired:.2g} re-acquisitions a run)" if row.reacquired > 0.0 else ""
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


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "-"


def markdown(rows: Sequence[ClaimRow], lines: Sequence[str] = ()) -> str:
    """A row for each judged claim (if none is judged, for each row), the verdicts counted, marks, and `lines`."""
    found = [*map(claim_cells, stated_claims(rows))] or [
        (_said(row), _published(row), _measured(row), row.verdict) for row in rows
    ]
    said = " ".join(cell for cells in found for cell in cells)
    notes = [f"- {_plain(line)}" for line in (*_counts(rows), *_meanings(CLAIM_MARKS, said), *lines)]
    return "\n".join([*_markdown([CLAIM_HEADS, *found]), "", *notes])


def claim_cells(claim: CountedClaim) -> tuple[str, ...]:
    """The cells of a claim, by CLAIM_HEADS: of several readings, the least and the largest measured value."""
    row, values = claim.rows[0], [one.measured for one in claim.rows if math.isfinite(one.measured)]
    several = len(claim.rows) > 1 and values
    measured = f"{_number(min(values))} to {_number(max(values))}" if several else _measured(row)
    return _said(row), _published(row), measured, _outcome(claim)


def _said(row: ClaimRow) -> str:
    """What a row is about in one cell."""
    return f"{row.variant}: {row.quantity}"


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
