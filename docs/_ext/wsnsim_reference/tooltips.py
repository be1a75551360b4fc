"""Explains the terms of the glossary where the mouse rests: the first occurrence of each term on a page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from docutils import nodes

ELSEWHERE: Final = ("glossary", "changelog", "bibliography", "index")
"""Pages without explanations, and the pages of `gallery/` and `reference/`."""
INSIDE: Final = (nodes.title, nodes.literal, nodes.literal_block, nodes.reference, nodes.abbreviation, nodes.raw)


def setup(app: Any) -> None:
    """Connect the handler to the event of a page that is complete."""
    app.connect("doctree-resolved", explain)


def meanings(page: str) -> dict[str, str]:
    """{term in small letters, or acronym: its meaning} of the rows of the glossary.

    Terms of one word, such as node or step, are left out: they stand everywhere, and everybody knows them.
    """
    found: dict[str, str] = {}
    for names, meaning in re.findall(r"^\| (?!term |---)(.+?) \| (.+?) \| [^|]+ \|$", page, re.MULTILINE):
        plain = re.sub(r"[`*]|\[(.*?)\]\(.*?\)", r"\1", meaning)
        in_full = " ".join(re.sub(r"\([^)]*\)", "", names).split())
        for name in in_full.split(", "):
            if re.search(r"\w[ -]\w", name):
                found[name.lower()] = plain
        for acronym in re.findall(r"(?:^|\()([A-Z/]{3,})(?=,|\)| \(|$)", names):
            found.setdefault(acronym, plain if acronym == in_full else f"{in_full}: {plain}")
    return found


def explain(app: Any, tree: nodes.document, page: str) -> None:
    """Make the first occurrence of each term on a page an abbreviation with the meaning of the term."""
    if app.builder.format != "html" or page in ELSEWHERE or page.startswith(("gallery/", "reference/")):
        return
    terms = meanings((Path(app.srcdir) / "glossary.md").read_text(encoding="utf-8"))
    longest_first = "|".join(map(re.escape, sorted(terms, key=len, reverse=True)))
    pattern = re.compile(rf"\b({longest_first})(?=s?\b)", re.IGNORECASE)
    for text in list(tree.findall(nodes.Text)):
        if not any(isinstance(above, INSIDE) for above in _above(text)):
            _replace(text, pattern, terms)


def _above(node: nodes.Node) -> list[nodes.Node]:
    """The nodes that hold a node, the nearest first."""
    found = []
    while node.parent is not None:
        node = node.parent
        found.append(node)
    return found


def _replace(text: nodes.Text, pattern: re.Pattern[str], terms: dict[str, str]) -> None:
    """Replace the terms in a text that no earlier text had, and take them from the terms."""
    pieces, done = [], 0
    for match in pattern.finditer(text.astext()):
        meaning = terms.pop(match[0].lower(), "") or terms.pop(match[0], "")
        if meaning:
            pieces += [nodes.Text(text[done : match.start()]), nodes.abbreviation("", match[0], explanation=meaning)]
            done = match.end()
    if pieces:
        text.parent.replace(text, [*pieces, nodes.Text(text[done:])])
