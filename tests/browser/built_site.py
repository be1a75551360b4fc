"""The built documentation: its pages, the links between them, and a server on this machine that shows it."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

LINKS = {"a": "href", "link": "href", "img": "src", "script": "src", "source": "src", "iframe": "src"}
OUTSIDE = ("http", "https", "mailto", "data", "doi")


class PageParser(HTMLParser):
    """Collects the links of a page, what they name, and the anchors that links can lead to."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note the link and the anchor of a tag."""
        given = {name: value for name, value in attrs if value is not None}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if LINKS.get(tag) in given:
            self.links.append(given[LINKS[tag]])


@functools.cache
def parsed(page: Path) -> PageParser:
    """The links and anchors of a page."""
    parser = PageParser()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser


def pages(site: Path) -> list[Path]:
    """Every page of the site."""
    return sorted(page for page in site.rglob("*.html") if "_static" not in page.parts)


def broken(page: Path, site: Path) -> Iterator[str]:
    """Yield the links of a page that lead to no file of the site, or to no anchor of a page."""
    for link in parsed(page).links:
        parts = urlsplit(link)
        if parts.scheme in OUTSIDE or parts.netloc:
            continue
        target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
        if target.is_dir():
            target /= "index.html"
        if not target.is_file() or site not in target.parents:
            yield f"{page.relative_to(site)}: {link}: no such file"
        elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in parsed(target).anchors:
            yield f"{page.relative_to(site)}: {link}: no such anchor"


class Quiet(SimpleHTTPRequestHandler):
    """Serves files without a line per request."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a server that shows a folder to this machine."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
