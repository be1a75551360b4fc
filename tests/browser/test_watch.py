"""The live view in a browser: it moves while the run computes, becomes the result, and shows curves as they form."""

from __future__ import annotations

import os
import re
import shutil
import threading

import pytest

from tests.watch.test_campaign_view import complete, without_point
from wsnsim import experiment
from wsnsim.recording.folder import Folder
from wsnsim.report import html_page
from wsnsim.scenario import load
from wsnsim.watch.campaign_view import CampaignView
from wsnsim.watch.run_view import RunView

from .chromium import FOUND, NAMES, Browser

LACKS = f"no browser: none of {', '.join(NAMES)} is installed"
pytestmark = pytest.mark.skipif(FOUND is None and os.environ.get("WSNSIM_BROWSER") != "required", reason=LACKS)
__all__ = ["complete"]
DATA = "document.documentElement.dataset"
TEXT = "document.getElementById('{}').textContent"
TO_STEP = (
    "(() => {{ const s = document.getElementById('slider'); s.value = {}; s.dispatchEvent(new Event('input')); }})()"
)
DRAWN_UNTIL = """(() => { const canvas = document.getElementById("time-curves"), left = 44, width = canvas.width - 56;
    const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
    const pen = copy.getContext("2d", { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    const { data } = pen.getImageData(left, 0, width, canvas.height);
    const colour = getComputedStyle(document.documentElement).getPropertyValue("--estimate").trim();
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    let last = 0;
    for (let at = 0; at < data.length; at += 4) {
        if (data[at] === r && data[at + 1] === g && data[at + 2] === b) last = Math.max(last, (at / 4) % width);
    }
    return (last / width) * canvas.dataset.end; })()"""
"""The simulated time (s) up to which the position error is drawn."""
VALUES = "document.getElementById('time-curves').getAttribute('aria-label')"
PLACES = """(() => { const box = (id) => document.getElementById(id).getBoundingClientRect();
    return [box("time-curves").left, box("time-curves").right, box("drawing").right]; })()"""
"""Left and right end of the curves, and right end of the drawing (px)."""
NBSP = "\u00a0"
NARROW = "document.documentElement.scrollWidth <= innerWidth"


@pytest.fixture(scope="module")
def browser():
    if FOUND is None:
        pytest.fail(LACKS)
    made = Browser()
    yield made
    made.close()


class PausedRun:
    """A run that stops at some simulated times (s) until it is let go on."""

    def __init__(self, out, *times, scenario="pso_mhpf", duration=8):
        self.out, self.times = out, list(times)
        set_to = ["tracker.particles=40"] if scenario == "pso_mhpf" else []
        self.scenario = load(scenario, [f"duration={duration} s", *set_to])
        self.reached, self.goes_on = threading.Event(), threading.Event()
        self.view = RunView("a run", interval=0.0)
        self.thread = threading.Thread(target=self._run)

    def _run(self):
        experiment.run(
            self.scenario, out=self.out, replicates=1, progress=self.view.reporting(print), watched=self._recorder
        )

    def _recorder(self, file):
        made = self.view.recorder(file)
        follow = made.follow

        def pausing(now):
            follow(now)
            if self.times and now.time >= self.times[0]:
                self.times.pop(0)
                self.reached.set()
                self.goes_on.wait(600)
                self.goes_on.clear()

        made.follow = pausing
        return made

    def __enter__(self):
        self.view.__enter__()
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.times.clear()
        self.goes_on.set()
        self.thread.join()
        self.view.__exit__(*error)

    def wait(self):
        assert self.reached.wait(600)
        self.reached.clear()


@pytest.mark.parametrize("width", [1200, 390])
def test_the_page_follows_the_run_and_becomes_the_page_of_its_result(browser, tmp_path, monkeypatch, width):
    monkeypatch.setattr(html_page, "svg_figures", lambda path, replicate, plugins: ([], []))
    with PausedRun(tmp_path / "x.h5", 2.0, 4.0) as run:
        run.wait()
        page = browser.open(run.view.url, width=width)
        page.until(f"+{DATA}.known >= 48")
        first = page.frame()
        assert first == int(page.value(f"{DATA}.known")) - 1 and page.value(TEXT.format("status")).startswith("step ")
        assert page.value(TEXT.format("rmse")).endswith("m") and page.value(TEXT.format("spent")).endswith("J")
        assert page.value(NARROW)
        picture = page.value("document.getElementById('drawing').toDataURL()")
        half_a_run = page.value(DRAWN_UNTIL)
        run.goes_on.set()
        run.wait()
        page.until(f"+{DATA}.frame >= 96")
        assert page.value("document.getElementById('drawing').toDataURL()") != picture
        assert page.value(DRAWN_UNTIL) > half_a_run
        page.value("document.getElementById('back').click()")
        stays = page.frame()
        assert page.value("document.getElementById('follow').checked") is False
        run.goes_on.set()
        run.thread.join()
        page.until(f"+{DATA}.known > 150")
        assert page.frame() == stays
        assert page.complaints() == [] and all(url.startswith(run.view.url) for url in page.requests())
        html_page.write([tmp_path / "x.h5"], tmp_path / "x.html")
        run.view.finish((tmp_path / "x.html").read_text(encoding="utf-8"))
        page.until("!document.getElementById('follow') && document.documentElement?.dataset.ready === 'yes'")
        assert page.value("document.getElementById('slider').max") == "199" and page.complaints() == []


@pytest.mark.parametrize("width", [1200, 390])
def test_the_curves_of_error_and_energy_follow_the_slider(browser, tmp_path, width):
    with PausedRun(tmp_path / "x.h5") as run:
        run.thread.join()
        page = browser.open(run.view.url, width=width)
        page.until(f"+{DATA}.known > 190")
        pictures = set()
        for step in (10, 180):
            page.value(TO_STEP.format(step))
            pictures.add(page.value("document.getElementById('time-curves').toDataURL()"))
            error = page.value(TEXT.format("status")).split("error ")[1].split(",")[0]
            values = re.fullmatch(
                f"position error: {error}; energy spent: (.*) mJ", page.value(VALUES).replace(NBSP, " ")
            )
            assert values and float(values[1]) > 0
        assert len(pictures) == 2 and page.value(NARROW)
        left, right, drawing = page.value(PLACES)
        assert left >= 0 and right <= width and right - left > 250 and page.complaints() == []
        assert (left > drawing) is (width == 1200)


def test_a_run_whose_first_steps_have_no_estimate_is_shown(browser, tmp_path):
    with PausedRun(tmp_path / "x.h5", scenario="information_driven_asleep", duration=8) as run:
        run.thread.join()
        page = browser.open(run.view.url)
        page.until(f"+{DATA}.known > 190")
        page.value(TO_STEP.format(1))
        assert "no estimate" in page.value(TEXT.format("status"))
        assert page.value(VALUES).startswith("position error: no estimate; energy spent: ") and page.complaints() == []
        assert page.value(f"{DATA}.failure") is None


def test_a_replayed_step_looks_as_in_the_page_of_the_result(browser, tmp_path, monkeypatch):
    """The portions, put together by the page's script, draw what the whole replay draws, but for residual energy."""
    monkeypatch.setattr(html_page, "svg_figures", lambda path, replicate, plugins: ([], []))
    members = "[...document.querySelectorAll('#status')].map(each => each.textContent)[0]"
    with PausedRun(tmp_path / "x.h5") as run:
        run.thread.join()
        live = browser.open(run.view.url)
        live.until(f"+{DATA}.known > 190")
        told = []
        for step in (10, 100, 180):
            live.value(TO_STEP.format(step))
            told.append(live.value(members))
    html_page.write([tmp_path / "x.h5"], tmp_path / "x.html")
    for step, text in zip((10, 100, 180), told, strict=True):
        assert browser.open(f"file://{tmp_path / 'x.html'}#frame={step}").value(members) == text


def test_a_tab_whose_server_has_gone_says_so_and_keeps_what_it_shows(browser, tmp_path):
    with PausedRun(tmp_path / "x.h5") as run:
        run.thread.join()
        page = browser.open(run.view.url)
        page.until(f"+{DATA}.known > 150")
    page.until(f"{DATA}.state.includes('no longer answers')")
    assert page.value("document.getElementById('player').hidden") is False


def test_the_curves_of_a_campaign_form_while_it_runs(browser, complete, tmp_path):
    folder = Folder(shutil.copytree(complete, tmp_path / "c"))
    put_back = without_point(folder, 1)
    with CampaignView(folder) as view:
        page = browser.open(view.url, width=390, height=800)
        page.until(f"{DATA}.curves === '1'")
        assert page.value(TEXT.format("done")) == "6 of 12" and page.value(NARROW)
        assert page.value("document.querySelectorAll('#rows tr').length") == 2
        put_back()
        view.look()
        page.until(f"{DATA}.done === '12' && {DATA}.curves === '2'")
        assert page.value(
            "(() => { const b = document.querySelector('.wide'); return b.scrollWidth <= b.clientWidth; })()"
        )
        assert page.value("[...document.images].every(each => each.complete && each.naturalWidth > 100)")
        assert page.value(TEXT.format("state")) == "The campaign is complete."
        assert page.complaints() == [] and all(url.startswith(view.url) for url in page.requests())


def test_curves_of_a_campaign_stand_side_by_side_on_a_wide_screen(browser, complete):
    with CampaignView(Folder(complete)) as view:
        page = browser.open(view.url)
        page.until(f"{DATA}.curves === '1'")
        tops = page.value("[...document.querySelectorAll('figure')].map(each => each.getBoundingClientRect().top)")
        assert len(tops) == 3 and tops[0] == tops[1] < tops[2]
