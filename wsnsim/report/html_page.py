"""One HTML page of one or several results: summary, replay, figures, scenario and provenance, all within the file.

write(paths, out, replicate=None, limit=2_000_000, published=None) -> WrittenPage        as `wsnsim report`

The page fetches nothing: a Content-Security-Policy forbids it, and only the page's own script may run. Every text from
a file is escaped. What there is no room for is thinned or left out, and the page says so.
"""

from __future__ import annotations

import base64
import hashlib
import html
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from wsnsim.analysis import result_info
from wsnsim.analysis.replicate_tables import check_replicate, first_replicate
from wsnsim.base.errors import ResultError
from wsnsim.report import page_sections
from wsnsim.report.page_sections import Part
from wsnsim.report.replay import Packed, pack
from wsnsim.report.summary_table import Published, tally
from wsnsim.report.svg_figures import pictures

LIMIT: Final = 2_000_000
"""Bytes that a page may have."""
OF_PICTURES: Final = 0.6
"""The part of them that figures may take (our choice): the rest is left to the replay."""
AROUND: Final = 2000
"""Bytes that stand around a replay: its element, its notes (our choice)."""
SCRIPTS: Final = ("film.js", "picture.js", "legend.js", "replay.js")
SLOT: Final = re.compile(r"\{\{(\w+)\}\}")


@dataclass(frozen=True)
class WrittenPage:
    """A page that was written: its size, and what a reader must know of it."""

    path: Path
    size: int
    notes: tuple[str, ...]


def write(
    paths: Sequence[Path], out: Path, replicate: int | None = None, limit: int = LIMIT,
    published: Published | None = None,
) -> WrittenPage:  # fmt: skip
    """Write the page of results, the replay being that of one replicate: the first of each file, if none is named.

    Raises:
        UsageError: a result has no such replicate.
        ResultError: a result cannot be read, or the page cannot be written.
    """
    parts = _parts(paths, replicate)
    _fit(parts, int(OF_PICTURES * limit))
    summary = tally([part.path for part in parts], [part.name for part in parts], published)
    bare = len(_page(parts, [Packed("", ())] * len(parts), summary).encode())
    films = _films(parts, limit - bare)
    page = _page(parts, films, summary).encode()
    notes = _told(parts, films)
    if len(page) > limit:
        notes.append(f"The page has more than the {limit / 1e6:g} MB asked for: figures and texts alone take as much.")
    _put(out, page)
    return WrittenPage(out, len(page), tuple(notes))


def _parts(paths: Sequence[Path], replicate: int | None) -> list[Part]:
    """What the page says of each result. All of them are looked at before figures are drawn, which takes its time."""
    abouts = [_about(path) for path in paths]
    chosen = [first_replicate(path) if replicate is None else replicate for path in paths]
    for path, number in zip(paths, chosen, strict=True):
        check_replicate(path, number)
    return [
        Part(about, name, number, *pictures(about["path"], number))
        for about, name, number in zip(abouts, page_sections.names(abouts), chosen, strict=True)
    ]


def _about(path: Path) -> dict[str, Any]:
    return result_info.info(path) | {"path": path, "source": page_sections.text_of(path, "scenario/source_yaml")}


def _films(parts: Sequence[Part], room: int) -> list[Packed]:
    """A replay of each result; what short ones leave of the room goes to long ones."""
    films: dict[int, Packed] = {}
    for number in sorted(range(len(parts)), key=lambda number: parts[number].about["bytes"]):
        each = room // (len(parts) - len(films)) - AROUND
        films[number] = pack(parts[number].path, parts[number].replicate, each)
        room -= len(films[number].text) + AROUND
    return [films[number] for number in range(len(parts))]


def _told(parts: Sequence[Part], films: Sequence[Packed]) -> list[str]:
    """What a reader must know of replays and figures, with the result's name where there are several."""
    told = []
    for part, film in zip(parts, films, strict=True):
        before = f"{part.name}: " if len(parts) > 1 else ""
        told += [before + note for note in (*film.notes, *part.left_out)]
    return list(dict.fromkeys(told))


def _fit(parts: Sequence[Part], room: int) -> None:
    """Leave out figures until the rest has room: of all results the least important, then the largest, first."""
    ranked = [
        (rank, len(each.svg), number) for number, part in enumerate(parts) for rank, each in enumerate(part.drawn)
    ]
    taken = sum(size for _, size, _ in ranked)
    for _, size, number in sorted(ranked, reverse=True):
        if taken <= room:
            return
        gone = parts[number].drawn.pop()
        parts[number].left_out.append(f"without {gone.label}: the page would be too large")
        taken -= size


def _put(out: Path, page: bytes) -> None:
    """Write the page; its file has its name only once it is complete."""
    unfinished = out.with_name(f"{out.name}.{os.getpid()}.tmp")
    try:
        unfinished.write_bytes(page)
        unfinished.replace(out)
    except OSError as error:
        raise ResultError(f"{out}: cannot be written: {error.strerror or error}") from error
    finally:
        unfinished.unlink(missing_ok=True)


def _page(parts: Sequence[Part], films: Sequence[Packed], summary: str) -> str:
    """The whole page. Slots are filled in one pass, so that no text that is filled in can hold a slot."""
    room = files("wsnsim.report") / "static"
    template, style, *scripts = (
        (room / name).read_text(encoding="utf-8") for name in ("template.html", "style.css", *SCRIPTS)
    )
    script = '"use strict";\n{\n' + "".join(scripts) + "}\n"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    names, both = list(dict.fromkeys(part.name for part in parts)), list(zip(parts, films, strict=True))
    slots = {
        "title": html.escape(" · ".join(names)),
        "heading": " · ".join(map(page_sections.told, names)),
        "hash": f"'sha256-{digest}'",
        "style": style,
        "script": script,
        "lead": "\n".join(page_sections.lead(part, film) for part, film in both),
        "summary": summary,
        "notes": "\n".join(page_sections.notes(part, film, len(parts) > 1) for part, film in both),
        "films": "\n".join(page_sections.block(part, film) for part, film in both if film.text),
        "sections": "\n".join(page_sections.section(part, number) for number, part in enumerate(parts)),
    }
    return SLOT.sub(lambda slot: slots[slot[1]], template)
