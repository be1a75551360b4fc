"""A Sphinx extension that writes the reference from the code before Sphinx reads the pages.

The pages of the Python reference are written by hand; `python_entries` says how autodoc shows their entries, and
`tooltips` explains terms of the glossary on all other pages.

The other pages are `reference/kinds/*.md` (a page per role), `reference/tables.md`, `reference/commands.md`,
`reference/scenario_file.md` and `reference/datasheets.md`. They are not kept in git, and a page is written only if it
has changed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wsnsim_reference import commands, datasheets, kinds, scenario_file, tables


def setup(app: Any) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    from wsnsim_reference import python_entries, tooltips  # need Sphinx, which the pages do not

    python_entries.setup(app)
    tooltips.setup(app)
    app.connect("builder-inited", lambda builder: write_pages(Path(builder.srcdir) / "reference"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def pages() -> Iterator[tuple[str, str]]:
    """Yield the path of every page in the folder of the reference, and its text."""
    yield from (("kinds/" + name, text) for name, text in kinds.pages())
    yield "tables.md", tables.page()
    yield "commands.md", commands.page()
    yield "scenario_file.md", scenario_file.page()
    yield "datasheets.md", datasheets.page()


def write_pages(folder: Path) -> None:
    """Write the pages that have changed, and remove pages of roles that no longer exist."""
    written = dict(pages())
    (folder / "kinds").mkdir(parents=True, exist_ok=True)
    for old in (folder / "kinds").glob("*.md"):
        if f"kinds/{old.name}" not in written:
            old.unlink()
    for name, text in written.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
