"""A comparison that shows itself: as the table and sentences of `wsnsim compare`, and as HTML in a notebook."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import Any, final

from wsnsim.analysis.comparison import Comparison, conclusions_of


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
