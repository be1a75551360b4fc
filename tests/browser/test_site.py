"""The built documentation: every link leads somewhere; in a browser it can be navigated, searched and read on a phone.

Skipped where there is no Chromium or no Sphinx, unless the environment says WSNSIM_BROWSER=required, as `.ci/run` does.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from .built_site import broken, pages, parsed, served
from .chromium import FOUND, LOADED, Browser

ROOT = Path(__file__).parents[2]
LACKS = "no browser, or no Sphinx (make docs installs it)"
MISSING = FOUND is None or find_spec("sphinx") is None
pytestmark = pytest.mark.skipif(MISSING and os.environ.get("WSNSIM_BROWSER") != "required", reason=LACKS)
PHONE, DESK = 390, 1280
SECTIONS = ("tutorials", "how-to", "explanation", "reference", "papers", "gallery")
TOO_WIDE = """[...document.querySelectorAll('.bd-main *')].filter(part => {
    const box = part.getBoundingClientRect();
    return box.width > 0 && box.right > innerWidth + 1 && getComputedStyle(part).position !== 'fixed';
}).filter(part => {
    for (let up = part.parentElement; up; up = up.parentElement)
        if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(up).overflowX)) return false;
    return true;
}).slice(0, 3).map(part => part.tagName + '.' + part.className)"""
"""The parts of a page that reach beyond the screen and are not inside something that scrolls."""


@pytest.fixture(scope="module")
def site():
    """The folder of the built site; what `make docs` has built already is not built again."""
    if MISSING:
        pytest.fail(LACKS)
    folder = ROOT / "build" / "docs"
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(ROOT / "docs"),
        str(folder),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    return folder


@pytest.fixture(scope="module")
def address(site):
    with served(site) as shown:
        yield shown


@pytest.fixture(scope="module")
def browser():
    made = Browser()
    yield made
    made.close()


def at(browser, address, path="index.html", width=DESK):
    """Open a page of the site."""
    return browser.open(f"{address}/{path}", width=width, ready=LOADED)


def go(browser, url):
    """Go on to another address in the same page."""
    browser.order("Page.navigate", url=url)
    browser.until(f"location.href.split('#')[0] === {url!r} && {LOADED}")


def test_no_link_is_broken_and_no_anchor_is_missing(site):
    every = pages(site)
    assert len(every) > 30 and sum(len(parsed(page).links) for page in every) > 1000
    assert [found for page in every for found in broken(page, site)] == []


def test_the_python_reference_shows_examples_as_code_not_as_quotations(site):
    shown = {page.name: page.read_text(encoding="utf-8") for page in (site / "reference" / "python").glob("*.html")}
    assert len(shown) > 10 and [name for name, text in shown.items() if "<blockquote" in text] == []
    assert 'class="highlight"' in shown["running.html"]


def test_a_broken_link_is_found(tmp_path):
    (tmp_path / "a.html").write_text('<a href="b.html#no">x</a><a href="c.html">x</a><a href="#here" id="here">x</a>')
    (tmp_path / "b.html").write_text('<p id="yes">x</p><a href="a.html#here">x</a><a href="https://x.org/#y">x</a>')
    found = [line for page in pages(tmp_path) for line in broken(page, tmp_path)]
    assert found == ["a.html: b.html#no: no such anchor", "a.html: c.html: no such file"]


def test_every_page_can_be_reached_from_the_first(site):
    reached, waiting = set(), [site / "index.html"]
    while waiting:
        page = waiting.pop()
        if page in reached or not page.is_file():
            continue
        reached.add(page)
        links = (link.partition("#")[0] for link in parsed(page).links)
        waiting += [(page.parent / link).resolve() for link in links if link.endswith(".html") and "//" not in link]
    assert [page for page in pages(site) if page not in reached] == []


def test_the_header_leads_to_every_section_and_the_site_asks_nobody_else(browser, address):
    at(browser, address)
    for section in SECTIONS:
        browser.value(f"document.querySelector(\"header a[href*='{section}/index.html']\").click()")
        browser.until(f"location.pathname === '/{section}/index.html' && {LOADED}")
        assert len(browser.value("document.querySelector('h1').innerText")) > 4
        browser.value("history.back()")
        browser.until(f"location.pathname === '/index.html' && {LOADED}")
    asked = [said["params"]["request"]["url"] for said in browser.said if said["method"] == "Network.requestWillBeSent"]
    assert asked and [url for url in asked if not url.startswith((address, "data:"))] == []
    assert [said for said in browser.complaints() if "error" in str(said).lower()] == []


@pytest.mark.parametrize("word", ["coordinated_turn", "contikimac", "handover"])
def test_the_search_finds_a_kind_and_leads_to_a_page_that_has_it(browser, address, word):
    at(browser, address, f"search.html?q={word}")
    browser.until("document.querySelectorAll('#search-results li a').length > 0")
    found = browser.value("[...document.querySelectorAll('#search-results li a')].map(link => link.href)")
    go(browser, re.split(r"[?#]", found[0])[0])
    assert word in browser.value("document.querySelector('main').innerText")


def test_no_page_is_wider_than_a_phone(browser, address, site):
    at(browser, address, width=PHONE)
    wide = {}
    for page in pages(site):
        go(browser, f"{address}/{page.relative_to(site).as_posix()}")
        if browser.value("document.documentElement.scrollWidth") > PHONE:
            wide[page.name] = browser.value(TOO_WIDE)
    assert wide == {}


def test_a_wide_table_scrolls_inside_the_page_of_a_phone(browser, address):
    at(browser, address, "papers/index.html", width=PHONE)
    holder = "document.querySelector('article table').parentElement"
    assert browser.value(f"{holder}.scrollWidth > {holder}.clientWidth + 100")
    browser.value(f"{holder}.scrollLeft = 80")
    assert browser.value(f"{holder}.scrollLeft") == 80


def test_the_navigation_of_a_phone_opens_and_has_every_section(browser, address):
    at(browser, address, width=PHONE)
    browser.value("document.querySelector('.primary-toggle').click()")
    browser.until("document.querySelector('#pst-primary-sidebar-modal')?.open")
    text = browser.value("document.querySelector('#pst-primary-sidebar-modal').innerText.toLowerCase()")
    assert [section for section in SECTIONS if section not in text] == []


def test_light_and_dark_have_readable_colours(browser, address):
    at(browser, address, "glossary.html")
    shades = {}
    for theme in ("light", "dark"):
        browser.value(f"document.documentElement.dataset.theme = '{theme}'")
        colours = browser.value("""[getComputedStyle(document.body).backgroundColor,
            getComputedStyle(document.querySelector('article td')).color]""")
        shades[theme] = [sum(map(int, re.findall(r"\d+", colour)[:3])) / 765 for colour in colours]
    assert shades["light"][0] > 0.9 and shades["light"][1] < 0.4
    assert shades["dark"][0] < 0.2 and shades["dark"][1] > 0.6
