"""One HTML page of one or several results: summary, replay, figures, scenario and provenance in a single file.

The page loads nothing: a Content-Security-Policy forbids it, and only the page's own script may run. Every text from a
result is escaped. What exceeds the size limit is thinned or left out, and the page says so.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

from wsnsim.analysis import result_info
from wsnsim.analysis.plot_data import check_replicate, first_replicate
from wsnsim.analysis.summary_text import PublishedLookup
from wsnsim.recording.atomic_files import replacing
from wsnsim.report import page_sections
from wsnsim.report.page_sections import PageSection, summary_table
from wsnsim.report.replay import Replay, encode
from wsnsim.report.scenario_words import isolated
from wsnsim.report.svg_figures import svg_figures

SLOT: Final = re.compile(r"\{\{(\w+)\}\}")


def static_text(name: str, package: str = "wsnsim.report") -> str:
    """A file of a package's folder `static`."""
    return (files(package) / "static" / name).read_text(encoding="utf-8")


def script_of(sources: Sequence[str]) -> str:
    """One script of several, whose names are not visible outside."""
    return '"use strict";\n{\n' + "".join(sources) + "}\n"


def source_of(script: str) -> str:
    """The source expression of a Content-Security-Policy that allows this script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def filled(template: str, slots: Mapping[str, str]) -> str:
    """The template with all slots filled in one pass, because an inserted text may contain a slot."""
    return SLOT.sub(lambda slot: slots[slot[1]], template)


LIMIT: Final = 2_000_000
"""Default size limit of a page (bytes)."""
FIGURE_SHARE: Final = 0.6
"""Fraction of the limit that figures may take (our choice); the rest is for replays."""
AROUND: Final = 2000
"""Bytes of the element and the notes around a replay (our choice)."""
SCRIPTS: Final = ("replay_data.js", "tooltips.js", "drawing.js", "legend.js", "player.js", "start.js")


@dataclass(frozen=True)
class WrittenPage:
    """A page that was written: its file, its size (bytes), and notes on what was thinned or left out."""

    path: Path
    size: int
    notes: tuple[str, ...]


def write(  # noqa: PLR0913
    results: Sequence[Path],
    out: Path,
    replicate: int | None = None,
    limit: int = LIMIT,
    published: PublishedLookup | None = None,
    plugins: bool = False,
    bounds: bool = False,
    place: str = "",
) -> WrittenPage:
    """Write the page of one or several results.

    Args:
        results: result files.
        out: file of the page.
        replicate: the run to replay, by default the first of each file.
        limit: largest size of the page (bytes).
        published: gives the published values of a scenario.
        plugins: whether plug-ins that a result's scenario names are imported for the bounds.
        bounds: whether the three trajectory-conditional CRLBs are shown.
        place: what stands in place of the file of a result that has none of its own.

    Raises:
        UsageError: a result has no such replicate.
        ResultError: a result cannot be read, or the page cannot be written.
    """
    sections = _sections(results, replicate, plugins, place)
    _drop_figures(sections, int(FIGURE_SHARE * limit))
    paths, names = [section.path for section in sections], [section.name for section in sections]
    summary = summary_table(paths, names, published, plugins, bounds)
    bare = len(_page(sections, [Replay("", ())] * len(sections), summary).encode())
    replays = _replays(sections, limit - bare)
    page = _page(sections, replays, summary).encode()
    notes = _notes(sections, replays)
    if len(page) > limit:
        notes.append(f"The page exceeds {limit / 1e6:g} MB: texts and the first figures alone take more.")
    with replacing(out) as unfinished:
        unfinished.write_bytes(page)
    return WrittenPage(out, len(page), tuple(notes))


def _sections(results: Sequence[Path], replicate: int | None, plugins: bool, place: str) -> list[PageSection]:
    """The section of each result. All results are checked before the figures, which take time, are drawn."""
    infos = [result_info.info(path, plugins) | ({"file": place} if place else {}) for path in results]
    chosen = [first_replicate(path) if replicate is None else replicate for path in results]
    for path, number in zip(results, chosen, strict=True):
        check_replicate(path, number)
    return [
        PageSection(info, path, name, number, *svg_figures(path, number, plugins))
        for info, path, name, number in zip(infos, results, page_sections.names(infos, results), chosen, strict=True)
    ]


def _replays(sections: Sequence[PageSection], room: int) -> list[Replay]:
    """A replay of each result. Room that a small result does not use goes to larger ones."""
    replays: dict[int, Replay] = {}
    for i in sorted(range(len(sections)), key=lambda i: sections[i].info["bytes"]):
        share = room // (len(sections) - len(replays)) - AROUND
        replays[i] = encode(sections[i].path, sections[i].replicate, share)
        room -= len(replays[i].text) + AROUND
    return [replays[i] for i in range(len(sections))]


def _notes(sections: Sequence[PageSection], replays: Sequence[Replay]) -> list[str]:
    """The notes on replays and figures, with the result's name if there are several."""
    notes = []
    for section, replay in zip(sections, replays, strict=True):
        prefix = f"{section.name}: " if len(sections) > 1 else ""
        notes += [prefix + note for note in (*replay.notes, *section.left_out)]
    return list(dict.fromkeys(notes))


def _drop_figures(sections: Sequence[PageSection], room: int) -> None:
    """Drop figures until the rest fits: the least important of all results first, and of these the largest."""
    ranked = [
        (rank, len(figure.svg), i) for i, section in enumerate(sections) for rank, figure in enumerate(section.figures)
    ]
    size = sum(length for _, length, _ in ranked)
    for _, length, i in sorted(ranked, reverse=True):
        if size <= room:
            return
        dropped = sections[i].figures.pop()
        sections[i].left_out.append(f"without {dropped.label}: the page would be too large")
        size -= length


def _page(sections: Sequence[PageSection], replays: Sequence[Replay], summary: str) -> str:
    """The page's text."""
    script = script_of([static_text(name) for name in SCRIPTS])
    names, pairs = list(dict.fromkeys(section.name for section in sections)), list(zip(sections, replays, strict=True))
    slots = {
        "title": html.escape(" · ".join(names)),
        "heading": " · ".join(map(isolated, names)),
        "hash": source_of(script),
        "style": static_text("style.css"),
        "script": script,
        "lead": "\n".join(page_sections.lead(*pair) for pair in pairs),
        "answers": "\n".join(page_sections.answer(section, len(sections) > 1) for section in sections),
        "summary": summary,
        "layout": "beside" if len(sections) == 1 and replays[0].text else "",
        "notes": "\n".join(page_sections.notes(*pair, several=len(sections) > 1) for pair in pairs),
        "replays": "\n".join(page_sections.replay_data(*pair) for pair in pairs if pair[1].text),
        "sections": "\n".join(page_sections.html_of(section, i) for i, section in enumerate(sections)),
    }
    return filled(static_text("template.html"), slots)
