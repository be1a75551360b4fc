"""One HTML page of estimated lifetimes: the answers, the figures and the texts, in a single file without scripts."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from wsnsim.analysis import lifetime_plots, lifetime_text
from wsnsim.recording.atomic_files import replacing
from wsnsim.report.html_page import static_text
from wsnsim.report.svg_figures import svg_of

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"


def write(points: Sequence[Mapping[str, Any]], out: Path) -> Path:
    """Write the page of one or several outcomes. Raises ResultError if it cannot be written."""
    heading = html.escape(f"Lifetime of {points[0]['name']}" + f": {len(points)} variants" * (len(points) > 1))
    body = [*map(_block, lifetime_text.blocks(points))] if len(points) > 1 else []
    for point in points:
        body += [f"<section><h2>{html.escape(lifetime_text.label(point))}</h2>", section(point), "</section>"]
    page = "\n".join([
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{heading}</title>\n<style>\n{static_text('style.css')}\n</style>\n</head>\n<body>",
        f"<header><h1>{heading}</h1></header>\n<main>", *body, "</main>\n</body>\n</html>\n",
    ])  # fmt: skip
    with replacing(out) as unfinished:
        unfinished.write_text(page, encoding="utf-8")
    return out


def section(point: Mapping[str, Any]) -> str:
    """The answer, the figures and the whole text of an outcome, as HTML; a notebook shows the same."""
    first, *rest = map(_block, lifetime_text.blocks([point]))
    return "\n".join([f'<div class="answer">{first}</div>', '<div class="figures">', *_figures(point), "</div>", *rest])


def _block(block: lifetime_text.Block) -> str:
    """A sentence or a table as HTML."""
    if isinstance(block, str):
        return f"<p>{html.escape(block)}</p>"
    rows = "".join(f"<tr><th>{'<td>'.join(map(html.escape, row))}" for row in block)
    return f'<div class="wide"><table>{rows}</table></div>'


def _figures(point: Mapping[str, Any]) -> Iterator[str]:
    for name, panel in lifetime_plots.PANELS.items():
        figure = svg_of(name, partial(panel, point=point))
        yield f'<figure role="img" aria-label="{name}">{figure.svg}</figure>'
