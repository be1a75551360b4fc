"""Words of the field for what wsnsim calls otherwise: kinds, keys, commands and columns. Suggestions use them.

    meant_by("unscented kalman filter", ["ekf", "ukf"]) -> ["ukf"]

Words are compared in lower case, with '_' for spaces, hyphens and dots. The table is read when the first is asked for.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from wsnsim.base.data_tables import read_sections

FILLERS: Final = (
    "model",
    "filter",
    "sensor",
    "tracker",
    "motion",
    "mac",
    "protocol",
    "kind",
    "the",
    "m",
    "s",
    "hz",
    "dbm",
)
"""Words that a name may have more than a row of the table."""


@functools.cache
def synonyms() -> dict[str, tuple[str, ...]]:
    """Return what each word may mean, the likeliest first: the rows of synonyms.table."""
    found: dict[str, tuple[str, ...]] = {}
    for _, rows in read_sections(Path(__file__).with_name("synonyms.table")):
        for words, names in rows:
            for word in words.split(", "):
                found[word] = (*found.get(word, ()), *names.split())
    return found


def meant_by(word: str, known: Collection[str]) -> list[str]:
    """Return the known names that a word may mean, the likeliest first; none if the table has no such word."""
    by_form = {_form(name): name for name in sorted(known, reverse=True)}
    for form in _forms(word):
        names = [form, *synonyms().get(form, ())]
        found = [by_form[name] for name in dict.fromkeys(names) if name in by_form]
        if found and _form(word) not in known:
            return found
    return []


def _forms(word: str) -> Iterator[str]:
    """Yield the word, then without fillers, then each of its own words."""
    form = _form(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", word))
    pieces = form.split("_")
    yield form
    yield form.replace("_", "")
    yield form.removesuffix("s")
    yield "_".join(piece for piece in pieces if piece not in FILLERS)
    if len(pieces) > 1:
        yield from (piece for piece in pieces if piece not in FILLERS and len(piece) > 1)


def _form(word: str) -> str:
    return re.sub(r"[\s.\-/]+", "_", word.strip().lower())
