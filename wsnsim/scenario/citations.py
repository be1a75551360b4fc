"""The papers, books and standards that kinds name as their sources, with titles and DOIs.

cited_in("Jiang, Song, Lin (2013), eq. 1-4") -> [Citation(...)]
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Final, NamedTuple

from wsnsim.base.data_tables import read_sections

NOT_LOOKED_UP: Final = "not looked up"
"""The mark of a DOI that was not compared with the record at doi.org."""


class Citation(NamedTuple):
    """A publication that the code cites.

    Attributes:
        key: how the code cites it.
        title: its title.
        venue: where it appeared.
        doi: its DOI; '' if none could be verified.
        looked_up: whether the DOI was compared with the record at doi.org.
    """

    key: str
    title: str
    venue: str
    doi: str = ""
    looked_up: bool = True

    @property
    def mark(self) -> str:
        """The words that follow a DOI which was not looked up; '' for all others."""
        return "" if self.looked_up else f" ({NOT_LOOKED_UP})"

    def text(self) -> str:
        """Return the citation in one line."""
        return f"{self.key}: {self.title}. {self.venue}." + (f" doi:{self.doi}{self.mark}" if self.doi else "")


OTHER_FORMS: Final = {
    "Heinzelman, Chandrakasan, Balakrishnan (2002)": "Heinzelman (2002)",
    "Heinzelman and others (2000)": "Heinzelman (2000)",
    "Jiang, Song, Lin 2013": "Jiang, Song, Lin (2013)",
    "Jiang et al. (2013)": "Jiang, Song, Lin (2013)",
}
"""Other forms in which the code cites a publication."""


@functools.cache
def citations() -> tuple[Citation, ...]:
    """Return every publication that the code cites: the rows of citations.table."""
    ((_, rows),) = read_sections(Path(__file__).with_name("citations.table"))
    padded = ((*row, "", "") for row in rows)
    return tuple(Citation(key, title, venue, doi, mark != NOT_LOOKED_UP) for key, title, venue, doi, mark, *_ in padded)


def cited_in(text: str) -> list[Citation]:
    """Return the publications that a text cites, in the order of their first places."""
    words = " ".join(text.split())
    for form, key in OTHER_FORMS.items():
        words = words.replace(form, key)
    places = {one: words.find(one.key) for one in citations()}
    return sorted((one for one, place in places.items() if place >= 0), key=lambda one: places[one])
