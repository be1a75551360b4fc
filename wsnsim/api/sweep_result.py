"""The result of a sweep: its points, their tables, what failed or is missing, and a comparison that shows itself.

A comparison is shown as the table and sentences of `wsnsim compare`, and as HTML in a notebook.
"""

from __future__ import annotations

import html
import html as markup
import os
import shutil
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from wsnsim.analysis.comparison import Comparison, conclusions_of
from wsnsim.base.errors import did_you_mean
from wsnsim.campaign.engines import CampaignOutcome

if TYPE_CHECKING:
    import pandas as pd


@final
@dataclass(frozen=True, repr=False)
class ShownComparison(Comparison):
    """A `Comparison` whose `print` shows table, conclusions and notes."""

    def __str__(self) -> str:
        from wsnsim.analysis import comparison_text

        return comparison_text.text(self)

    def __repr__(self) -> str:
        return f"<Comparison {self.name}: {self.metric} of {len(self.table)} points>"

    def _repr_html_(self) -> str:
        from wsnsim.analysis import comparison_text

        heads, rows = comparison_text.columns(self)
        body = "".join(f"<tr>{_cells(row, 'td')}</tr>" for row in rows)
        sentences = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in conclusions_of(self))
        table = f"<table><thead><tr>{_cells(heads, 'th')}</tr></thead><tbody>{body}</tbody></table>"
        return f"<div>{table}<ul>{sentences}</ul></div>"


def shown_comparison(found: Comparison) -> ShownComparison:
    """Return a comparison as one that shows itself."""
    values: dict[str, Any] = vars(found)
    return ShownComparison(**values)


def _cells(texts: list[str], tag: str) -> str:
    return "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts)


@final
class SweepResult:
    """The runs of a sweep: `.runs` has a row per run, with the swept parameters in front; `.compare()` a row per point.

    Args:
        out: folder of the campaign.
        outcome: what this session ran, what failed and what is missing.
        temporary: a folder that is removed with the result.
    """

    def __init__(self, out: Path, outcome: CampaignOutcome, temporary: Path | None = None) -> None:
        self.out = out
        self.outcome = outcome
        self._temporary = temporary
        if temporary is not None:
            weakref.finalize(self, _remove, temporary, os.getpid())

    @property
    def complete(self) -> bool:
        """Whether every run is there and none failed."""
        return self.outcome.complete

    @property
    def failed(self) -> Mapping[str, str]:
        """{run: reason} of the runs that failed."""
        return self.outcome.failed

    @property
    def missing(self) -> Mapping[str, list[int]]:
        """{point: numbers of the runs that are not there}."""
        return self.outcome.missing

    @property
    def runs(self) -> pd.DataFrame:
        """The table `runs` of all points: the swept parameters, then errors (m), energy (J) and counts of each run."""
        return self.table("runs")

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of all points, with the swept parameters as its first columns.

        Args:
            name: name of the table; `runs`, `tracks`, and those that `keep` named.

        Raises:
            ResultError: the table was not recorded.
        """
        from wsnsim.analysis import campaigns

        return campaigns.read(self.out, name)

    def compare(self, metric: str = "rmse", baseline: str | None = None) -> ShownComparison:
        """Return the points side by side: medians, intervals, energy and paired differences.

        Args:
            metric: a column of the table `runs`.
            baseline: the point that differences are from.

        Raises:
            UsageError: there is no such metric or baseline.
            ResultError: there are no results.
        """
        from wsnsim.analysis.comparison import compare

        return shown_comparison(compare(self.out, metric, baseline=baseline))

    def __repr__(self) -> str:
        runs = self.outcome.done + self.outcome.found
        failed = f", {len(self.failed)} failed" if self.failed else ""
        place = "temporary" if self._temporary else str(self.out)
        return f"<Sweep: {runs} runs{failed}, {place}>"

    def _repr_html_(self) -> str:
        return f"<div><p>{markup.escape(repr(self))}</p>{self.compare()._repr_html_()}</div>"

    def __getattr__(self, name: str) -> Any:
        known = ("compare", "complete", "failed", "missing", "out", "outcome", "runs", "table")
        raise AttributeError(f"the result of a sweep has no attribute '{name}' ({did_you_mean(name, known)})")


def _remove(folder: Path, process: int) -> None:
    """Remove a temporary folder, unless this is a copy of the process that made it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
