"""The live view in a browser: it moves while the run computes, becomes the result, and shows curves as they form."""

from __future__ import annotations

import os
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

    def __init__(self, out, *times):
        self.out, self.times = out, list(times)
        self.reached, self.goes_on = threading.Event(), threading.Event()
        self.view = RunView("a run", interval=0.0)
        self.thread = threading.Thread(target=self._run)

    def _run(self):
        scenario = load("pso_mhpf", ["duration=8 s", "tracker.particles=40"])
        experiment.run(scenario, out=self.out, replicates=1, progress=self.view.report, watched=self._recorder)

    def _recorder(self, file):
        made = self.view.recorder(file)
        follow = made.follow

        def pausing(now):
            follow(now)
            if self.times and now.time >= self.times[0]:
                self.times.pop(0)
                self.reached.set()
                self.goes_on.wait(60)
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
        assert self.reached.wait(60)
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
        run.goes_on.set()
        run.wait()
        page.until(f"+{DATA}.frame >= 96")
        assert page.value("document.getElementById('drawing').toDataURL()") != picture
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
        assert page.value("document.getElementById('slider').max") == "200" and page.complaints() == []


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
            live.value(f"(() => {{ const s = document.getElementById('slider'); s.value = {step}; "
                       "s.dispatchEvent(new Event('input')); })()")  # fmt: skip
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
        assert page.value("[...document.images].every(each => each.complete && each.naturalWidth > 100)")
        assert page.value(TEXT.format("state")) == "The campaign is complete."
        assert page.complaints() == [] and all(url.startswith(view.url) for url in page.requests())
