"""The main rows of the reproductions as a Markdown table, as the README shows it.

markdown(rows, lines) -> str
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from wsnsim.papers.paper import PAPERS, paper
from wsnsim.papers.reproduction import ClaimRow
from wsnsim.papers.table import HEADS, cells, legend, verdict_counts


def main_rows(rows: Sequence[ClaimRow]) -> list[ClaimRow]:
    """The rows that the papers' files list as main, in that order."""
    found: dict[tuple[str, ...], list[ClaimRow]] = {}
    for row in rows:
        found.setdefault((row.paper, row.experiment, row.id, row.key), []).append(row)
    names = [name for name in PAPERS if any(row.paper == name for row in rows)]
    keys = [(name, experiment.name, claim.id, claim.key) for name in names for experiment, claim in paper(name).main]
    return [row for key in keys for row in found.get(key, ())]


def markdown(rows: Sequence[ClaimRow], lines: Sequence[str] = ()) -> str:
    """A table of the main rows, beneath it the number of verdicts on all claims, the legend and `lines`.

    The experiment stands first in a row, the reason last.
    """
    chosen = main_rows(rows)
    if not chosen and not lines:
        return "No main row belongs to the chosen experiments."
    head = [("paper, experiment", *HEADS, "why"), ("---",) * (2 + len(HEADS))] if chosen else []
    table = [*head, *((f"{row.paper}, {row.experiment}", *cells(row), row.reason) for row in chosen)]
    rendered = ["| " + " | ".join(map(_plain, line)) + " |" for line in table]
    counted = ["", "Verdicts on all claims:", *(f"- {_plain(line)}" for line in verdict_counts(rows))] if chosen else []
    return "\n".join([*rendered, *counted, *_notes(chosen), *(f"- {line}" for line in lines)])


def _notes(chosen: Sequence[ClaimRow]) -> Iterator[str]:
    """The legend of the rows, and the cautions about their bounds."""
    if chosen:
        yield from ("", "Verdicts and bounds:")
        yield from (f"- {_plain(line.strip())}" for line in legend(chosen))
        cautions: dict[str, dict[str, None]] = {}
        for row in chosen:
            for caution in filter(None, row.caution.split("; ")):
                cautions.setdefault(caution, {})[f"{row.paper}, {row.experiment}"] = None
        yield from (f"- of the bound ({_plain('; '.join(where))}): {caution}" for caution, where in cautions.items())


def _plain(cell: str) -> str:
    """A cell with Markdown's special characters escaped."""
    return cell.replace("|", "\\|").replace("~", "\\~").replace("_", "\\_").replace("*", "\\*")
