"""The parts of a page, as HTML: what each result is, its figures, its scenario, its provenance.

Part;  names(abouts);  lead(part, film);  notes(part, film);  block(part, film);  section(part, number);  told(text)

Every text from a file is escaped, and stands in an element of its own, so that its direction of writing does not reach
what is around it.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import ResultError
from wsnsim.recording import read_text
from wsnsim.report.replay import Packed
from wsnsim.report.svg_figures import Picture

LONGEST: Final = 60_000
"""Characters of a scenario's text that are shown (our choice)."""
TAG: Final = re.compile(r"<[^>]*>")
ID: Final = re.compile(r'(\bid="|href="#|url\(#)')


@dataclass(frozen=True)
class Part:
    """What the page says of one result, the name that it has there, and the replicate that is replayed."""

    about: Mapping[str, Any]
    name: str
    replicate: int
    drawn: list[Picture]
    left_out: list[str]

    @property
    def path(self) -> Path:
        """Where the result is."""
        return self.about["path"]


def told(text: object) -> str:
    """A text from a file as HTML."""
    return f"<bdi>{html.escape(str(text))}</bdi>"


def names(abouts: Sequence[Mapping[str, Any]]) -> list[str]:
    """The scenarios' names; where several results have one, with their files', and as many folders as differ."""
    bare = [str(about["name"] or about["path"].stem) for about in abouts]
    result = list(bare)
    for name in {name for name in bare if bare.count(name) > 1}:
        rows = [row for row, each in enumerate(bare) if each == name]
        places = [abouts[row]["path"].resolve().parts for row in rows]
        for row, place in zip(rows, places, strict=True):
            result[row] = f"{name}, {'/'.join(place[-_depth(places) :])}"
    return result


def _depth(places: Sequence[tuple[str, ...]]) -> int:
    """How many last parts of paths tell them apart."""
    different, deepest = len(set(places)), max(map(len, places))
    return next(depth for depth in range(1, deepest + 1) if len({place[-depth:] for place in places}) == different)


def lead(part: Part, film: Packed) -> str:
    """What the page is of, in a line; and a warning where the result is not whole."""
    about = part.about
    runs = about["replicates"] or 0
    said = f": seed {about['seed']}, {runs} replicate{'s' * (runs != 1)}"
    if runs > 1 and film.text:
        said += f", of which number {part.replicate} is replayed"
    said += f", wsnsim {about['wsnsim_version']}"
    line = f'<p class="lead">{told(about["file"])}{html.escape(said)}</p>'
    if about["status"] == "complete":
        return line
    return line + f'\n<p class="warn">This result is {html.escape(about["status"])}: its run did not end.</p>'


def notes(part: Part, film: Packed, several: bool) -> str:
    """What a viewer of the replay must know."""
    rows = "".join(f"<li>{html.escape(note)}</li>" for note in film.notes)
    name = f"<p>{told(part.name)}</p>" if several and rows else ""
    return f"{name}<ul>{rows}</ul>" if rows else ""


def block(part: Part, film: Packed) -> str:
    """The replay as a block of data, which no browser runs."""
    return f'<script type="text/plain" class="film" data-title="{html.escape(part.name)}">{film.text}</script>'


def section(part: Part, number: int) -> str:
    """Figures, scenario and provenance of one result."""
    shown = "\n".join(_figure(each, f"{number}-{i}") for i, each in enumerate(part.drawn))
    lacking = "".join(f"<li>{html.escape(reason)}</li>" for reason in part.left_out)
    return f"""<section aria-labelledby="h-{number}">
<h2 id="h-{number}">{told(part.name)}: figures</h2>
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
    svg = TAG.sub(lambda tag: ID.sub(rf"\g<1>f{prefix}-", tag[0]), drawn.svg)
    return f'<figure role="img" aria-label="{html.escape(drawn.label)}">{svg}</figure>'


def text_of(path: Path, name: str) -> str:
    """A text that the file holds; '' if it does not."""
    try:
        return read_text(path, name)
    except ResultError:
        return ""


def _scenario(part: Part) -> str:
    """The text that was run, and all that follows from it."""
    source, every = part.about["source"], text_of(part.path, "scenario/resolved_json")
    if not source and not every:
        return "<p>The result does not hold its scenario.</p>"
    shown = f"<pre>{html.escape(_cut(source))}</pre>" if source else ""
    if every:
        shown += (
            "<details><summary>With every default, in SI units</summary>"
            f"<pre>{html.escape(_cut(_indented(every)))}</pre></details>"
        )
    return shown


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


def _rows(part: Part) -> Iterator[str]:
    """Terms and what they are, of all that made the result."""
    about = part.about
    facts = {"file": about["file"], "bytes": f"{about['bytes']:,}", "status": about["status"]}
    facts |= _flat(about["provenance"] or {"wsnsim": about["wsnsim_version"]})
    if about["fingerprints"]:
        facts["fingerprint" + "s" * (len(about["fingerprints"]) > 1)] = ", ".join(about["fingerprints"][:30])
    facts["rows"] = ", ".join(f"{name} {size['rows']:,}" for name, size in about["tables"].items())
    for name, value in facts.items():
        yield f"<dt>{told(name)}</dt><dd>{told(value)}</dd>"


def _flat(held: Mapping[str, Any]) -> dict[str, str]:
    """A mapping's values as words: what is within another mapping or list, in one line."""
    words: dict[str, str] = {}
    for name, value in held.items():
        if isinstance(value, Mapping):
            words[name.replace("_", " ")] = ", ".join(f"{key} {inner}" for key, inner in value.items())
        else:
            words[name.replace("_", " ")] = " ".join(map(str, value)) if isinstance(value, list) else str(value)
    return words
