"""The sections of a page, as HTML: what each result is, its figures, its scenario and its provenance.

Every text from a result is escaped. It stands in an element of its own, so that its writing direction does not affect
the text around it.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wsnsim.recording import read_text
from wsnsim.report.replay import Replay
from wsnsim.report.svg_figures import SvgFigure

MAX_TEXT: Final = 60_000
"""Characters of a scenario's text that are shown (our choice)."""
MAX_FINGERPRINTS: Final = 30
TAG: Final = re.compile(r"<[^>]*>")
ID: Final = re.compile(r'(\bid="|href="#|url\(#)')


@dataclass(frozen=True)
class PageSection:
    """What the page shows of one result.

    Attributes:
        info: the answer of `wsnsim info`, with the file's path and the scenario's text.
        name: name of the result in the page.
        replicate: the run that is replayed.
        figures: figures, the most important first.
        left_out: reasons for missing figures.
    """

    info: Mapping[str, Any]
    name: str
    replicate: int
    figures: list[SvgFigure]
    left_out: list[str]

    @property
    def path(self) -> Path:
        """The result file."""
        return Path(self.info["path"])


def isolated(text: object) -> str:
    """A text from a result as HTML, its writing direction isolated."""
    return f"<bdi>{html.escape(str(text))}</bdi>"


def names(infos: Sequence[Mapping[str, Any]]) -> list[str]:
    """The scenarios' names; where results share one, with their files and as many folders as needed."""
    bare = [str(info["name"] or info["path"].stem) for info in infos]
    result = list(bare)
    for name in {name for name in bare if bare.count(name) > 1}:
        rows = [row for row, each in enumerate(bare) if each == name]
        paths = [infos[row]["path"].resolve().parts for row in rows]
        for row, path in zip(rows, paths, strict=True):
            result[row] = f"{name}, {'/'.join(path[-_distinct_depth(paths) :])}"
    return result


def _distinct_depth(paths: Sequence[tuple[str, ...]]) -> int:
    """How many last parts of the paths make them distinct."""
    different, deepest = len(set(paths)), max(map(len, paths))
    return next(depth for depth in range(1, deepest + 1) if len({path[-depth:] for path in paths}) == different)


def lead(section: PageSection, replay: Replay) -> str:
    """One line on what the result is, and a warning if it is incomplete."""
    info = section.info
    runs = info["replicates"] or 0
    text = f": seed {info['seed']}, {runs} Monte Carlo run{'s' * (runs != 1)}"
    if runs > 1 and replay.text:
        text += f" (replicate {section.replicate} is replayed)"
    text += f", wsnsim {info['wsnsim_version']}"
    line = f'<p class="lead">{isolated(info["file"])}{html.escape(text)}</p>'
    if info["status"] == "complete":
        return line
    return line + f'\n<p class="warn">This result is {html.escape(info["status"])}: the simulation did not finish.</p>'


def answer(section: PageSection, several: bool) -> str:
    """The result's answer in a sentence; with its name if there are several. Empty if no run has finished."""
    name = f"<b>{isolated(section.name)}</b>: " if several else ""
    return f'<p class="answer">{name}{html.escape(section.info["answer"])}</p>' if section.info["answer"] else ""


def notes(section: PageSection, replay: Replay, several: bool) -> str:
    """What a viewer of the replay must know; with the result's name if there are several."""
    rows = "".join(f"<li>{html.escape(note)}</li>" for note in replay.notes)
    name = f"<p>{isolated(section.name)}</p>" if several and rows else ""
    return f"{name}<ul>{rows}</ul>" if rows else ""


def replay_data(section: PageSection, replay: Replay) -> str:
    """The replay as a data block, which browsers do not run."""
    title = html.escape(section.name)
    return f'<script type="text/plain" class="replay-data" data-title="{title}">{replay.text}</script>'


def html_of(section: PageSection, number: int) -> str:
    """The figures, the scenario and the provenance of one result."""
    shown = "\n".join(_figure(each, f"{number}-{i}") for i, each in enumerate(section.figures))
    missing = "".join(f"<li>{html.escape(reason)}</li>" for reason in section.left_out)
    return f"""<section aria-labelledby="h-{number}">
<h2 id="h-{number}">{isolated(section.name)}: figures</h2>
<div class="figures">
{shown}
</div>
{f'<ul class="small">{missing}</ul>' if missing else ""}
<details open><summary>Scenario</summary>
{_scenario(section)}
</details>
<details><summary>Provenance</summary>
<dl>{"".join(_provenance(section))}</dl>
</details>
</section>"""


def _figure(figure: SvgFigure, prefix: str) -> str:
    """A figure with ids that are unique in the page."""
    svg = TAG.sub(lambda tag: ID.sub(rf"\g<1>f{prefix}-", tag[0]), figure.svg)
    return f'<figure role="img" aria-label="{html.escape(figure.label)}">{svg}</figure>'


def stored_text(path: Path, name: str) -> str:
    """A text stored in the result, '' if there is none."""
    return read_text(path, name, optional=True)


def _scenario(section: PageSection) -> str:
    """The scenario as it was written, and with every default."""
    source, resolved = section.info["source"], stored_text(section.path, "scenario/resolved_json")
    if not source and not resolved:
        return "<p>The result does not contain its scenario.</p>"
    shown = f"<pre>{html.escape(_shortened(source))}</pre>" if source else ""
    if resolved:
        shown += (
            "<details><summary>With every default, in SI units</summary>"
            f"<pre>{html.escape(_shortened(_one_key_per_line(resolved)))}</pre></details>"
        )
    return shown


def _one_key_per_line(text: str) -> str:
    try:
        lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in json.loads(text).items()]
    except (ValueError, AttributeError):
        return text
    return "\n".join(lines)


def _shortened(text: str) -> str:
    if len(text) <= MAX_TEXT:
        return text
    return f"{text[:MAX_TEXT]}\n… ({len(text) - MAX_TEXT:,} more characters)"


def _provenance(section: PageSection) -> Iterator[str]:
    """The rows of the list of file, versions, machine, fingerprints and table sizes."""
    info = section.info
    facts = {"file": info["file"], "bytes": f"{info['bytes']:,}", "status": info["status"]}
    facts |= _flat(info["provenance"] or {"wsnsim": info["wsnsim_version"]})
    if info["fingerprints"]:
        facts["fingerprint" + "s" * (len(info["fingerprints"]) > 1)] = ", ".join(
            info["fingerprints"][:MAX_FINGERPRINTS]
        )
    facts["rows"] = ", ".join(f"{name} {size['rows']:,}" for name, size in info["tables"].items())
    for name, value in facts.items():
        yield f"<dt>{isolated(name)}</dt><dd>{isolated(value)}</dd>"


def _flat(mapping: Mapping[str, Any]) -> dict[str, str]:
    """The values as text, those of a nested mapping or list in one line."""
    result: dict[str, str] = {}
    for name, value in mapping.items():
        if isinstance(value, Mapping):
            text = ", ".join(f"{key} {inner}" for key, inner in value.items())
        else:
            text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
        result[name.replace("_", " ")] = text
    return result
