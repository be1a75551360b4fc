"""One HTML page of one or several results: summary, replay, figures, scenario and provenance, all within the file.

write(paths, out, replicate=0, limit=2_000_000, published=None) -> Written        as `wsnsim report`

The page fetches nothing: a Content-Security-Policy forbids it, and only the page's own script may run. Every text from
a file is escaped. What there is no room for is thinned or left out, and the page says so.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from wsnsim import recording
from wsnsim.analysis import frames
from wsnsim.analysis.pictures import Picture, pictures
from wsnsim.analysis.recorded import check
from wsnsim.analysis.replay import Packed, pack
from wsnsim.analysis.tally import Published, tally
from wsnsim.base.errors import ResultError

LIMIT: Final = 2_000_000
"""Bytes that a page may have."""
OF_PICTURES: Final = 0.6
"""The part of them that figures may take (our choice): the rest is left to the replay."""
AROUND: Final = 2000
"""Bytes that stand around a replay: its element, its notes (our choice)."""
LONGEST: Final = 60_000
"""Characters of a scenario's text that are shown (our choice)."""
SLOT: Final = re.compile(r"\{\{(\w+)\}\}")


@dataclass(frozen=True)
class Written:
    """A page that was written: its size, and what a reader must know of it."""

    out: Path
    bytes: int
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Part:
    """What the page says of one result, and the name that it has there."""

    about: Mapping[str, Any]
    name: str
    drawn: list[Picture]
    left_out: list[str]

    @property
    def path(self) -> Path:
        """Where the result is."""
        return self.about["path"]


def write(
    paths: Sequence[Path], out: Path, replicate: int = 0, limit: int = LIMIT, published: Published | None = None
) -> Written:
    """Write the page of results, the replay being that of one replicate.

    Raises:
        UsageError: a result has no such replicate.
        ResultError: a result cannot be read, or the page cannot be written.
    """
    abouts = [_about(path, replicate) for path in paths]
    parts = [
        _Part(about, name, *pictures(about["path"], replicate))
        for about, name in zip(abouts, _names(abouts), strict=True)
    ]
    _fit(parts, int(OF_PICTURES * limit))
    summary = tally([part.path for part in parts], [part.name for part in parts], published)
    bare = len(_page(parts, [Packed("", ())] * len(parts), replicate, summary).encode())
    films = _films(parts, replicate, limit - bare)
    page = _page(parts, films, replicate, summary).encode()
    notes = list(dict.fromkeys(note for film in films for note in film.notes))
    if len(page) > limit:
        notes.append(f"The page has more than the {limit / 1e6:g} MB asked for: figures and texts alone take as much.")
    _put(out, page)
    return Written(out, len(page), tuple(notes))


def _films(parts: Sequence[_Part], replicate: int, room: int) -> list[Packed]:
    """A replay of each result; what short ones leave of the room goes to long ones."""
    films: dict[int, Packed] = {}
    for number in sorted(range(len(parts)), key=lambda number: parts[number].about["bytes"]):
        each = room // (len(parts) - len(films)) - AROUND
        films[number] = pack(parts[number].path, replicate, each)
        room -= len(films[number].text) + AROUND
    return [films[number] for number in range(len(parts))]


def _about(path: Path, replicate: int) -> dict[str, Any]:
    about = frames.info(path)
    check(path, replicate)
    return about | {"path": path, "source": _text(path, "scenario/source_yaml")}


def _names(abouts: Sequence[Mapping[str, Any]]) -> list[str]:
    """The scenarios' names; where several results have one, with their files'."""
    names = [str(about["name"] or about["path"].stem) for about in abouts]
    return [
        f"{name}, {about['path'].name}" if names.count(name) > 1 else name
        for name, about in zip(names, abouts, strict=True)
    ]


def _text(path: Path, name: str) -> str:
    try:
        return recording.read_text(path, name)
    except ResultError:
        return ""


def _fit(parts: Sequence[_Part], room: int) -> None:
    """Leave out figures, the last of each result first, until the rest has room."""
    while sum(len(each.svg) for part in parts for each in part.drawn) > room:
        longest = max(parts, key=lambda part: sum(len(each.svg) for each in part.drawn))
        gone = longest.drawn.pop()
        longest.left_out.append(f"{gone.name}: left out, as the page would be too large")


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


def _page(parts: Sequence[_Part], films: Sequence[Packed], replicate: int, summary: str) -> str:
    """The whole page. Slots are filled in one pass, so that no text that is filled in can hold a slot."""
    room = files("wsnsim.analysis") / "page"
    template, style, *scripts = (
        (room / name).read_text(encoding="utf-8") for name in ("template.html", "style.css", "picture.js", "replay.js")
    )
    script = '"use strict";\n{\n' + "".join(scripts) + "}\n"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    slots = {
        "title": html.escape(" · ".join(dict.fromkeys(part.name for part in parts))),
        "hash": f"'sha256-{digest}'",
        "style": style,
        "script": script,
        "lead": "\n".join(_lead(part, replicate) for part in parts),
        "summary": summary,
        "notes": "\n".join(_notes(part, film, len(parts) > 1) for part, film in zip(parts, films, strict=True)),
        "films": "\n".join(_film(part, film) for part, film in zip(parts, films, strict=True) if film.text),
        "sections": "\n".join(_section(part, number) for number, part in enumerate(parts)),
    }
    return SLOT.sub(lambda slot: slots[slot[1]], template)


def _lead(part: _Part, replicate: int) -> str:
    """What the page is of, in a line; and a warning where the result is not whole."""
    about = part.about
    runs = about["replicates"] or 0
    said = f"{about['file']}: seed {about['seed']}, {runs} replicate{'s' * (runs != 1)}"
    if runs > 1:
        said += f", of which number {replicate} is replayed"
    lead = f'<p class="lead">{html.escape(said)}, wsnsim {html.escape(about["wsnsim_version"])}</p>'
    if about["status"] == "complete":
        return lead
    return lead + f'\n<p class="warn">This result is {html.escape(about["status"])}: its run did not end.</p>'


def _notes(part: _Part, film: Packed, several: bool) -> str:
    rows = "".join(f"<li>{html.escape(note)}</li>" for note in film.notes)
    name = f"<p>{html.escape(part.name)}</p>" if several and rows else ""
    return f"{name}<ul>{rows}</ul>" if rows else ""


def _film(part: _Part, film: Packed) -> str:
    """The replay as a block of data, which no browser runs."""
    return f'<script type="text/plain" class="film" data-title="{html.escape(part.name)}">{film.text}</script>'


def _section(part: _Part, number: int) -> str:
    """Figures, scenario and provenance of one result."""
    shown = "\n".join(_figure(each, f"{number}-{i}") for i, each in enumerate(part.drawn))
    lacking = "".join(f"<li>{html.escape(reason)}</li>" for reason in part.left_out)
    return f"""<section aria-labelledby="h-{number}">
<h2 id="h-{number}">{html.escape(part.name)}: figures</h2>
<div class="figures">
{shown}
</div>
{f'<ul class="small">{lacking}</ul>' if lacking else ""}
<details open><summary>Scenario</summary>
{_scenario(part)}
</details>
<details><summary>Provenance</summary>
<dl>{"".join(_rows(part))}</dl>
</details>
</section>"""


def _figure(drawn: Picture, prefix: str) -> str:
    """A figure within the page: its ids are its own, its text is that of the page."""
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>f{prefix}-", drawn.svg)
    return f'<figure role="img" aria-label="{html.escape(drawn.label)}">{svg}</figure>'


def _scenario(part: _Part) -> str:
    """The text that was run, and all that follows from it."""
    source, every = part.about["source"], _text(part.path, "scenario/resolved_json")
    if not source and not every:
        return "<p>The result does not hold its scenario.</p>"
    told = f"<pre>{html.escape(_cut(source))}</pre>" if source else ""
    if every:
        told += (
            "<details><summary>With every default, in SI units</summary>"
            f"<pre>{html.escape(_cut(_indented(every)))}</pre></details>"
        )
    return told


def _indented(text: str) -> str:
    try:
        lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in json.loads(text).items()]
    except (ValueError, AttributeError):
        return text
    return "\n".join(lines)


def _cut(text: str) -> str:
    if len(text) <= LONGEST:
        return text
    return f"{text[:LONGEST]}\n… ({len(text) - LONGEST:,} further characters are left out)"


def _rows(part: _Part) -> Iterator[str]:
    """Terms and what they are, of all that made the result."""
    about = part.about
    facts = {"file": about["file"], "bytes": f"{about['bytes']:,}", "status": about["status"]}
    facts |= _flat(about["provenance"] or {"wsnsim": about["wsnsim_version"]})
    if about["fingerprints"]:
        facts["fingerprint" + "s" * (len(about["fingerprints"]) > 1)] = ", ".join(about["fingerprints"][:30])
    facts["rows"] = ", ".join(f"{name} {size['rows']:,}" for name, size in about["tables"].items())
    for name, value in facts.items():
        yield f"<dt>{html.escape(name)}</dt><dd>{html.escape(str(value))}</dd>"


def _flat(held: Mapping[str, Any]) -> dict[str, str]:
    """A mapping's values as words: what is within another mapping or list, in one line."""
    words: dict[str, str] = {}
    for name, value in held.items():
        if isinstance(value, Mapping):
            words[name.replace("_", " ")] = ", ".join(f"{key} {inner}" for key, inner in value.items())
        else:
            words[name.replace("_", " ")] = " ".join(map(str, value)) if isinstance(value, list) else str(value)
    return words
