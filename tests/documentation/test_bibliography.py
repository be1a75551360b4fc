"""The bibliography has every publication that kinds and the glossary name, once, with the DOI that the code gives."""

from __future__ import annotations

import re

from tests.documentation.pages_of_docs import text
from wsnsim.scenario.kind_info import NOT_LOOKED_UP, citations

PAGE = " ".join(text("docs/bibliography.md").split())
ENTRIES = re.findall(r"- \*\*(.+?)\*\*:? (.*?)(?= - \*\*| ## |$)", PAGE)
NO_PUBLICATION = {
    "wsnsim",
    "SimPy",
    "HDF5",
    "Python",
    "statistics",
    "machine learning",
    "real-time systems",
    "Contiki",
    "Cockburn",
    "TI",
    "ns-3, SUMO",
    "Sphinx-Gallery",
}


def test_every_publication_that_kinds_cite_is_there_with_its_title_and_doi():
    entries = dict(ENTRIES)
    assert len(entries) == len(ENTRIES) > 60
    for one in citations():
        entry = entries[one.key.rstrip(":")]
        assert one.title.lower() in entry.lower(), one.key
        assert f"(https://doi.org/{one.doi})" in entry if one.doi else "doi.org" not in entry, one.key


def test_a_doi_that_nobody_looked_up_is_marked_in_the_page_and_in_the_code():
    marked = {name for name, entry in ENTRIES if f") ({NOT_LOOKED_UP})." in entry}
    cited = {one.key.rstrip(":") for one in citations()}
    assert NOT_LOOKED_UP in PAGE.split("## ")[0] and len(marked) == 11
    assert marked & cited == {one.key.rstrip(":") for one in citations() if not one.looked_up}
    assert all(one.text().endswith(f"doi:{one.doi} ({NOT_LOOKED_UP})") for one in citations() if not one.looked_up)


def test_a_doi_stands_once_and_has_the_form_of_one():
    found = re.findall(r"https://doi\.org/([^)]+)\)", PAGE)
    assert len(found) > 50 and len(set(found)) == len(found)
    assert [doi for doi in found if not re.fullmatch(r"10\.\d{4,5}/\S+", doi)] == []


def test_every_source_of_the_glossary_is_in_the_bibliography_or_named_in_full():
    rows = [line.strip("| ").split(" | ") for line in text("docs/glossary.md").splitlines() if line.startswith("| ")]
    sources = {part.strip() for row in rows for part in row[-1].split(";") if row[0] not in ("term", "---")}
    short = set(re.findall(r"Short: ([^.]+(?:\.[\d.-]+\d)?)\.", PAGE)) | NO_PUBLICATION
    unknown = [
        source
        for source in sources
        if not any(source.startswith(name) for name in short) and f"**{source.split(' ')[0].rstrip(',')}" not in PAGE
    ]
    assert len(short) > 15 and unknown == []
