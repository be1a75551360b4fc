r"""The BibTeX entries of a result: wsnsim, and the publications of the methods and models that its scenario uses.

bibtex([{"tracker": {"kind": "ekf"}, ...}]) -> "@software{wsnsim, ...}\n\n@article{...}"
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from wsnsim.base.version import RELEASED, __version__
from wsnsim.scenario.kind_info import Citation, kind_info
from wsnsim.scenario.registry import AT_TOP


def bibtex(scenarios: Iterable[Mapping[str, Any]], version: str = __version__) -> str:
    """Return the entries of wsnsim and of all publications that the components of resolved scenarios cite.

    Titles, volumes and DOIs are those of docs/bibliography.md; initials of authors are not known. A plug-in cites
    itself: its name stands in a comment.

    Args:
        scenarios: the resolved scenarios.
        version: the version of wsnsim that made the result.
    """
    pairs = list(dict.fromkeys(pair for scenario in scenarios for pair in _components(scenario)))
    found = {
        one: f"{role} {kind}"
        for role, kind in reversed(pairs)
        if ":" not in kind
        for one in kind_info(role, kind).citations
    }
    plugins = [f"% {kind} is a plug-in: cite its source" for _, kind in pairs if ":" in kind]
    year = f"  year = {{{RELEASED[:4]}}},\n" if version == __version__ else ""
    software = f"@software{{wsnsim,\n  author = {{{{The wsnsim authors}}}},\n  title = {{{{wsnsim}}}},\n{year}"
    entries = [_entry(one, used_by) for one, used_by in sorted(found.items(), key=lambda item: item[0].key)]
    return "\n\n".join([f"{software}  version = {{{version}}}\n}}", *entries, *plugins])


def _components(scenario: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield role and kind of each component of a resolved scenario."""
    for key, role in AT_TOP.items():
        held = scenario.get(key)
        for component in held if isinstance(held, list | tuple) else [held]:
            if isinstance(component, Mapping) and "kind" in component:
                yield role.name, component["kind"]


def _entry(one: Citation, used_by: str) -> str:
    """The entry of a publication: an article if it has a volume, else a publication of another kind."""
    authors, _, year = one.key.rstrip(")").partition(" (")
    names, venue = authors.split(", "), one.venue.split(", ")
    if venue[0] == names[0].removesuffix(" and others") and len(venue) > 1:
        names, venue = venue[:-1], venue[-1:]  # the table names all authors there
    article = re.fullmatch(r"(.+?) (\d+)\(([^)]+)\)(?:, ([\d, -]+\d))?(?: \((.+)\))?", ", ".join(venue))
    journal, volume, number, pages, note = article.groups() if article else (None, None, None, None, None)
    values = {
        "author": " and ".join(names) if year else None,
        "title": f"{{{one.title}}}" if year else f"{{{one.key}: {one.title}}}",
        "journal": journal,
        "howpublished": None if article else ", ".join(venue),
        "volume": volume,
        "number": number,
        "pages": pages and pages.replace("-", "--"),
        "year": year,
        "doi": one.doi,
        "note": note,
    }
    key = "".join(c for c in f"{names[0]}{year}" if c.isalnum() and c.isascii())
    lines = [f"  {name} = {{{value}}}" for name, value in values.items() if value]
    fields = re.sub("[&%#]", r"\\\g<0>", ",\n".join(lines))
    return f"% cited by {used_by}{one.mark}\n@{'article' if article else 'misc'}{{{key},\n{fields}\n}}"
