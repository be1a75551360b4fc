"""The page in a browser, opened from file://: it draws at once, asks nobody for anything, obeys keys and addresses.

Skipped where there is no Chromium. It is driven through its DevTools pipe: JSON messages, each ended by a zero byte.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest

from wsnsim import experiment
from wsnsim.analysis import report
from wsnsim.base.tables import TABLES, columns_of
from wsnsim.recording import ResultFile

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOUND = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(FOUND is None, reason=f"no browser: none of {', '.join(NAMES)} is installed")
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--remote-debugging-pipe",
)  # fmt: skip
LAUNCH = (
    "import fcntl, os, sys; r, w = (fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]);"
    "os.dup2(r, 3); os.dup2(w, 4); os.execv(sys.argv[3], sys.argv[3:])"
)
"""Chromium reads its orders from descriptor 3, and answers on 4."""
HOSTILE = (
    "</script><script>document.title='taken'</script><img src=http://127.0.0.1:9/x onerror=document.title='taken'>"
)
PAINTED = """(() => {
    const stage = document.getElementById('stage');
    const drops = stage.getContext('2d').getImageData(0, 0, stage.width, stage.height).data;
    return drops.reduce((count, drop, i) => count + (i % 4 === 3 && drop > 0), 0); })()"""
PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))


class Browser:
    """A headless Chromium with an empty profile, and one page at a time."""

    def __init__(self) -> None:
        self.profile = tempfile.mkdtemp(prefix="wsnsim-browser-")
        (orders, self.out), (self.inn, answers) = os.pipe(), os.pipe()
        words = [sys.executable, "-c", LAUNCH, str(orders), str(answers), FOUND, *QUIET]
        self.process = subprocess.Popen(
            [*words, f"--user-data-dir={self.profile}"],
            pass_fds=(orders, answers),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(orders)
        os.close(answers)
        self.number, self.rest, self.session, self.said = 0, b"", None, []

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.out)
        os.close(self.inn)
        shutil.rmtree(self.profile, ignore_errors=True)

    def order(self, method, **parameters):
        """Give an order, and wait for its result; what the page says meanwhile is kept in `said`."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session and not method.startswith("Target."):
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            self.said.append(answer)

    def _next(self):
        until = time.monotonic() + 60
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.inn], [], [], max(0.0, until - time.monotonic()))
            assert ready, "the browser does not answer"
            self.rest += os.read(self.inn, 1 << 16) or pytest.fail("the browser has ended")
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, address, width=1200, height=900, reduced=False):
        """Open a page of its own, and wait until it says that it is ready."""
        target = self.order("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.order("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.said = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.order(f"{domain}.enable")
        self.order(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
        )
        if reduced:
            feature = {"name": "prefers-reduced-motion", "value": "reduce"}
            self.order("Emulation.setEmulatedMedia", features=[feature])
        self.order("Page.navigate", url=address)
        self.until("document.documentElement?.dataset.ready !== undefined")
        return self

    def value(self, expression):
        """What a JavaScript expression gives in the page."""
        answer = self.order("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression):
        until = time.monotonic() + 30
        while not self.value(expression):
            assert time.monotonic() < until, f"the page never came to: {expression}"
            time.sleep(0.02)

    def press(self, key):
        text = {"text": key} if len(key) == 1 else {}
        self.order("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.order("Input.dispatchKeyEvent", type="keyUp", key=key)

    def frame(self):
        return int(self.value("document.documentElement.dataset.frame"))

    def complaints(self):
        """What stands in the console."""
        kinds = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        return [said["params"] for said in self.said if said.get("method") in kinds]

    def requests(self):
        """What the page asked for, itself and what is within it aside."""
        asked = [
            said["params"]["request"]["url"] for said in self.said if said.get("method") == "Network.requestWillBeSent"
        ]
        return [url for url in asked if not url.startswith(("file://", "data:", "blob:"))] + (
            ["a second file"] if sum(url.startswith("file://") for url in asked) > 1 else []
        )


@pytest.fixture(scope="module")
def browser():
    made = Browser()
    yield made
    made.close()


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    """The page of the default run: 700 steps, 256 nodes."""
    folder = tmp_path_factory.mktemp("default")
    experiment.run("pso_mhpf", out=folder / "x.h5")
    report.write([folder / "x.h5"], folder / "x.html")
    return folder / "x.html"


def invented(folder, steps=20, nodes=12, estimates=True, name="invented"):
    """The page of an invented run."""
    rng = np.random.default_rng(3)
    folder.mkdir(exist_ok=True)
    with ResultFile(folder / "x.h5", PLANE, dict.fromkeys(TABLES, True), position=(0, 2)) as file:
        way = {"px": np.linspace(-40, 40, steps + 1), "py": 20.0, "vx": 1.0, "vy": 0.0}
        step = np.arange(steps + 1)
        file.write("truth", {"replicate": 0, "target": 0, "step": step, "time": 0.5 * step, **way})
        if estimates:
            row = dict.fromkeys((column.name for column in columns_of("estimates", PLANE, (0, 2))), 0)
            file.write(
                "estimates", {**row, "step": step[1:], "time": 0.5 * step[1:], "px": way["px"][1:], "error": 1.0}
            )
        place = {"x": rng.uniform(-50, 50, nodes), "y": rng.uniform(-50, 50, nodes)}
        charge = {"gain": 1.0, "energy_initial": 2.0, "energy_left": rng.uniform(1, 2, nodes), "died_at": np.nan}
        file.write("nodes", {"replicate": 0, "node": np.arange(nodes), **place, **charge})
        file.set_text("scenario/source_yaml", f"name: {name}\n")
        file.set_text("scenario/resolved_json", json.dumps({"name": name, "seed": 1, "step": 0.5}))
    report.write([folder / "x.h5"], folder / "x.html")
    return folder / "x.html"


def test_the_default_run_is_drawn_in_two_seconds_with_a_silent_console_and_no_request(browser, default):
    took = "+document.documentElement.dataset.drawn"  # ms since the page was asked for
    page = browser.open(f"file://{default}")
    assert page.value("document.documentElement.dataset.ready") == "yes"
    assert min([page.value(took), *(browser.open(f"file://{default}").value(took) for _ in range(2))]) < 2000
    assert page.value("document.getElementById('slider').max") == "700"
    for frame in (1, 350, 700):
        page.value(f"location.hash = '#frame={frame}'")
        page.until(f"document.documentElement.dataset.frame === '{frame}'")
    assert page.value(PAINTED) > 500
    assert page.complaints() == []
    assert page.requests() == []


def test_what_the_page_says_is_heard_and_what_it_asks_for_is_seen(browser, tmp_path):
    """Of the tests themselves: a page that complains, and one that asks, would be noticed."""
    page = tmp_path / "bad.html"
    page.write_text("<html data-ready=yes><img src='http://127.0.0.1:9/x'><script>console.error('no')</script>")
    browser.open(f"file://{page}")
    browser.until("document.readyState === 'complete'")
    assert browser.complaints() and browser.requests() == ["http://127.0.0.1:9/x"]


def test_an_address_names_a_frame(browser, default):
    page = browser.open(f"file://{default}#frame=350")
    assert page.frame() == 350
    assert page.value("document.getElementById('status').textContent").startswith("step 350 of 700 · 14 s\nerror ")
    assert browser.open(f"file://{default}#frame=99999").frame() == 700


def test_keys_go_through_the_frames(browser, default):
    page = browser.open(f"file://{default}#frame=5")
    page.value("document.getElementById('stage').focus()")
    for key, frame in (("ArrowRight", 6), ("ArrowLeft", 5), ("End", 700), ("Home", 0)):
        page.press(key)
        assert page.frame() == frame, key
    page.press(" ")
    page.until("+document.documentElement.dataset.frame > 3")
    assert page.value("document.getElementById('play').textContent") == "Pause"
    page.press(" ")
    stopped = page.frame()
    assert page.value("document.getElementById('play').textContent") == "Play"
    assert page.value(f"new Promise(done => setTimeout(() => done(location.hash === '#frame={stopped}'), 200))")
    assert page.frame() == stopped


def test_going_back_shows_what_going_there_directly_shows(browser, default):
    page = browser.open(f"file://{default}#frame=300")
    picture = "document.getElementById('stage').toDataURL()"
    direct = page.value(picture)
    for frame in (700, 300):
        page.value(f"location.hash = '#frame={frame}'")
        page.until(f"document.documentElement.dataset.frame === '{frame}'")
    assert page.value(picture) == direct


def test_nothing_moves_by_itself_and_with_reduced_motion_playing_is_slow(browser, default):
    page = browser.open(f"file://{default}", reduced=True)
    wait = "new Promise(done => setTimeout(() => done(+document.documentElement.dataset.frame), 700))"
    assert page.value(wait) == 0
    page.value("document.getElementById('play').click()")
    assert 1 <= page.value(wait) <= 3


@pytest.mark.parametrize("width", [375, 1200])
def test_the_page_is_no_wider_than_its_window(browser, default, width):
    page = browser.open(f"file://{default}", width=width)
    assert page.value("document.documentElement.scrollWidth") <= width
    assert page.value("document.getElementById('stage').getBoundingClientRect().width") > 0.6 * min(width, 900)
    for name in ("play", "back", "ahead", "speed"):
        assert page.value(f"document.getElementById('{name}').getBoundingClientRect().height") >= 28, name


def test_a_hostile_name_is_shown_and_does_nothing(browser, tmp_path):
    page = browser.open(f"file://{invented(tmp_path, name=HOSTILE)}")
    assert page.value("document.title") == HOSTILE.strip()
    assert page.value("document.querySelector('h1').textContent") == HOSTILE
    assert page.value("document.images.length") == 0
    assert page.complaints() == [] and page.requests() == []


def test_what_were_not_escaped_would_not_run_either(browser, tmp_path):
    page = invented(tmp_path)
    page.write_text(page.read_text().replace("<main>", f"<main><b>{HOSTILE.removeprefix('</script>')}"))
    shown = browser.open(f"file://{page}")
    assert shown.value("document.images.length") == 1 and shown.value("document.title") == "invented"
    told = [said["entry"]["text"] for said in shown.complaints() if "entry" in said]
    assert len(told) >= 2 and all("Content Security Policy" in text for text in told)


@pytest.mark.parametrize("told", [{"estimates": False}, {"nodes": 100_000}, {"nodes": 1, "steps": 1}])
def test_odd_results_are_drawn_too(browser, tmp_path, told, monkeypatch):
    monkeypatch.setattr(report, "pictures", lambda path, replicate: ([], []))
    page = browser.open(f"file://{invented(tmp_path, **told)}#frame=1")
    assert page.value("document.documentElement.dataset.ready") == "yes" and page.frame() == 1
    assert page.complaints() == []


def test_a_browser_that_cannot_unpack_says_so(browser, tmp_path):
    page = invented(tmp_path)
    shown = browser.open(f"file://{page}")
    frame = browser.order("Page.addScriptToEvaluateOnNewDocument", source="delete window.DecompressionStream")
    browser.order("Page.reload")
    shown.until("document.documentElement?.dataset.ready === 'failed'")
    browser.order("Page.removeScriptToEvaluateOnNewDocument", identifier=frame["identifier"])
    assert "no DecompressionStream" in shown.value("document.getElementById('message').textContent")
    assert shown.value("document.querySelectorAll('figure svg').length") > 0
