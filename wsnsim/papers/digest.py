"""The main rows of the reproductions as Markdown tables, as docs/papers shows them.

markdown(rows, lines) -> str
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from wsnsim.papers.reproduction import ClaimRow
from wsnsim.papers.study import PAPERS, Study, study
from wsnsim.papers.table import HEADS, cells, legend, verdict_counts

SHOWN: Final = (
    "variant", "published", "measured [95 %]", "bound", "verdict", "statistic", "runs", "astray", "lost",
)  # fmt: skip
"""The columns of a table, in their order."""
QUANTITY, VARIANT = HEADS.index("quantity"), HEADS.index("variant")


def main_rows(rows: Sequence[ClaimRow], studies: Sequence[Study] = ()) -> list[ClaimRow]:
    """The rows that the files of the papers, or of these studies, list as main, in that order."""
    found: dict[tuple[str, ...], list[ClaimRow]] = {}
    for row in rows:
        found.setdefault((row.paper, row.experiment, row.id, row.key), []).append(row)
    named = {row.paper for row in rows}
    known = [*(study(name) for name in PAPERS if name in named), *(one for one in studies if one.name not in PAPERS)]
    keys = [(one.name, experiment.name, claim.id, claim.key) for one in known for experiment, claim in one.main]
    return [row for key in keys for row in found.get(key, ())]


def markdown(rows: Sequence[ClaimRow], lines: Sequence[str] = (), studies: Sequence[Study] = ()) -> str:
    """The main rows by experiment and quantity, the number of verdicts on all claims, the legend and `lines`."""
    chosen = main_rows(rows, studies)
    if not chosen and not lines:
        return "No main row belongs to the chosen experiments."
    tables = tables_of([MainRow(row.paper, row.experiment, row.title, cells(row), row.reason) for row in chosen])
    counted = ["Verdicts on all claims:", *(f"- {_plain(line)}" for line in verdict_counts(rows))] if chosen else []
    return "\n".join([*tables, *counted, *_notes(chosen), *(f"- {line}" for line in lines)])


class MainRow(NamedTuple):
    """A row of the tables: its paper, experiment with title, cells by HEADS, and reason."""

    paper: str
    experiment: str
    title: str
    cells: tuple[str, ...]
    reason: str


def tables_of(rows: Sequence[MainRow]) -> Iterator[str]:
    """Yield the lines of a heading per experiment, and of a table per quantity with the reasons beneath it."""
    experiments: dict[tuple[str, str, str], dict[str, list[MainRow]]] = {}
    for row in rows:
        quantities = experiments.setdefault((row.paper, row.experiment, row.title), {})
        quantities.setdefault(row.cells[QUANTITY], []).append(row)
    for (name, experiment, title), quantities in experiments.items():
        yield from (f"### {_plain(f'{name}, {experiment}')}", "", *([f"{_plain(title)}.", ""] if title else []))
        for quantity, these in quantities.items():
            yield from (f"**{_plain(quantity)}**", "", *_table([row.cells for row in these]), "", *_reasons(these), "")


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Yield the lines of a table in the order of SHOWN; columns without a value in any row are left out."""
    columns = [HEADS.index(head) for head in SHOWN]
    used = [column for column in columns if any(row[column] != "-" for row in rows)]
    for row in (HEADS, ("---",) * len(HEADS), *rows):
        yield "| " + " | ".join(_plain(row[column]) for column in used) + " |"


def _reasons(rows: Sequence[MainRow]) -> Iterator[str]:
    """Yield the reasons of rows: one that all share once, others with their variants."""
    variants: dict[str, dict[str, None]] = {}
    for row in rows:
        if row.reason:
            variants.setdefault(row.reason, {})[row.cells[VARIANT]] = None
    if len(variants) == 1 and all(row.reason for row in rows):
        yield f"Why: {_plain(rows[0].reason)}."
        return
    for reason, names in variants.items():
        yield f"- {_plain('; '.join(names))}: {_plain(reason)}."


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
