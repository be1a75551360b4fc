"""The page's answer, its short legend, and explanations on hover, by keyboard and by tap, in a browser."""

from __future__ import annotations

import pytest

from wsnsim import experiment
from wsnsim.analysis.answer import answer
from wsnsim.analysis.quantities import QUANTITIES
from wsnsim.report import html_page
from wsnsim.scenario import load

from .test_replay_in_browser import bare, browser, pytestmark  # noqa: F401

TIP = "document.getElementById('tip')"
TERM = "[...document.querySelectorAll('.term')].find((each) => each.textContent === '{}')"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A short run with contention and losses: (result, page)."""
    folder = tmp_path_factory.mktemp("explained")
    experiment.run(load("ekf_real", ["duration=2 s"]), replicates=1, out=folder / "x.h5")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html_page, "svg_figures", lambda path, replicate, plugins: ([], []))
        html_page.write([folder / "x.h5"], folder / "x.html")
    return folder / "x.h5", folder / "x.html"


def centre(page, term):
    """The middle of a term in the window, after scrolling there."""
    page.value(f"{TERM.format(term)}.scrollIntoView({{block: 'center'}})")
    box = page.value(f"(({{left, top, width, height}}) => [left + width / 2, top + height / 2])({TERM.format(term)}"
                     ".getBoundingClientRect())")  # fmt: skip
    return {"x": box[0], "y": box[1]}


def in_window(page):
    """Whether the tip is visible and inside the window."""
    return page.value(
        f"(({{left, top, right, bottom}}) => !{TIP}.hidden && left >= 0 && top >= 0 && right <= innerWidth &&"
        f" bottom <= innerHeight)({TIP}.getBoundingClientRect())"
    )


def test_the_answer_stands_above_everything_else(browser, made):  # noqa: F811
    result, place = made
    page = browser.open(f"file://{place}")
    assert page.value("document.querySelector('main').firstElementChild.textContent") == answer(result)


@pytest.mark.parametrize("width", [390, 1200])
def test_a_term_is_explained_on_hover(browser, made, width):  # noqa: F811
    page = browser.open(f"file://{made[1]}", width=width)
    for key in ("tracked", "energy"):
        at = centre(page, QUANTITIES[key].name)
        page.order("Input.dispatchMouseEvent", type="mouseMoved", **at)
        page.until(f"{TIP}.textContent === {QUANTITIES[key].definition!r}")
        assert in_window(page)
    page.order("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
    page.until(f"{TIP}.hidden")


def test_a_term_is_explained_when_it_has_the_focus_and_escape_hides_it(browser, made):  # noqa: F811
    page = browser.open(f"file://{made[1]}")
    page.value(f"{TERM.format('Monte Carlo runs')}.focus()")
    for _ in range(2):
        page.order("Input.dispatchKeyEvent", type="keyDown", key="Tab", code="Tab", windowsVirtualKeyCode=9)
    assert page.value("document.activeElement.textContent") == QUANTITIES["ever_lost"].name
    assert page.value(f"{TIP}.textContent") == QUANTITIES["ever_lost"].definition and in_window(page)
    assert page.value("document.activeElement.getAttribute('aria-describedby')") == "tip"
    page.press("Escape")
    assert page.value(f"{TIP}.hidden && !document.activeElement.hasAttribute('aria-describedby')")


def test_a_term_is_explained_by_tap_on_a_phone(browser, made):  # noqa: F811
    page = browser.open(f"file://{made[1]}", width=390, height=844)
    page.order("Emulation.setTouchEmulationEnabled", enabled=True)
    page.order("Input.dispatchTouchEvent", type="touchStart", touchPoints=[centre(page, "cluster head")])
    page.order("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    page.until(f"{TIP}.textContent.startsWith('the node that runs the tracker')")
    assert in_window(page) and page.value("document.documentElement.scrollWidth") <= 390
    page.order("Emulation.setTouchEmulationEnabled", enabled=False)


def test_a_legend_has_ten_entries_at_most_and_explains_each(browser, made, tmp_path, bare):  # noqa: F811
    entries = (
        "[...document.querySelectorAll('#legend li')].map((each) => [each.textContent, each.lastChild.dataset.tip])"
    )
    crowded = tmp_path / "x.h5"
    told = ["duration=1 s", "tracker.particles=40", "record.particles=true", "link.loss=0.2", "energy.battery=0.002 J"]
    experiment.run(load("two_targets", told), replicates=1, out=crowded)
    html_page.write([crowded], tmp_path / "x.html")
    for place in (made[1], tmp_path / "x.html"):
        page = browser.open(f"file://{place}#frame=10")
        shown = page.value(entries)
        assert 8 <= len(shown) <= 10 and all(name and tip for name, tip in shown)
        assert page.complaints() == []
    assert [name for name, _ in shown][-2:] == ["messages", "lost transmission"]
    assert "particles" in [name for name, _ in shown]
    assert "cluster member of target 0, 1" in [name for name, _ in shown]
