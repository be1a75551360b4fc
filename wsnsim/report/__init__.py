"""One self-contained HTML page of results: summary, replay, figures, scenario and provenance.

`write(paths, out)` writes the page and gives a `WrittenPage`, as `wsnsim report` does.
"""

from wsnsim.report.html_page import WrittenPage, write

__all__ = ["WrittenPage", "write"]
