"""The page in a browser, opened from file://: it draws, makes no request, and follows keys and addresses.

Skipped where there is no Chromium, unless the environment says WSNSIM_BROWSER=required, as `.ci/run` does.
"""

from __future__ import annotations

import json
import os
import re

import numpy as np
import pytest

from wsnsim import experiment, read
from wsnsim.base.tables import TABLES, columns_of
from wsnsim.recording import ResultFile
from wsnsim.report import html_page, replay
from wsnsim.scenario import load

from .chromium import FOUND, NAMES, Browser

LACKS = f"no browser: none of {', '.join(NAMES)} is installed"
pytestmark = pytest.mark.skipif(FOUND is None and os.environ.get("WSNSIM_BROWSER") != "required", reason=LACKS)
HOSTILE = (
    "</script><script>document.title='taken'</script><img src=http://127.0.0.1:9/x onerror=document.title='taken'>"
)
PAINTED = """(() => {
    const stage = document.getElementById('drawing');
    const drops = stage.getContext('2d').getImageData(0, 0, stage.width, stage.height).data;
    return drops.reduce((count, drop, i) => count + (i % 4 === 3 && drop > 0), 0); })()"""
SOON = "new Promise(done => setTimeout(() => done(+document.documentElement.dataset.frame), 30))"
PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))


@pytest.fixture(scope="module")
def browser():
    if FOUND is None:
        pytest.fail(LACKS)
    made = Browser()
    yield made
    made.close()


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    """The page of the default run: 700 steps, 256 nodes."""
    folder = tmp_path_factory.mktemp("default")
    experiment.run("pso_mhpf", out=folder / "x.h5")
    html_page.write([folder / "x.h5"], folder / "x.html")
    return folder / "x.html"


@pytest.fixture
def bare(monkeypatch):
    """Pages without figures, which take long to draw."""
    monkeypatch.setattr(html_page, "svg_figures", lambda path, replicate, plugins: ([], []))


def page_of_synthetic_result(folder, steps=20, nodes=12, estimates=True, name="invented", copies=1):
    """The page of one or several copies of a synthetic result."""
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
        place |= {f"{axis}_assumed": values for axis, values in place.items()}
        charge = {"gain": 1.0, "energy_initial": 2.0, "energy_left": rng.uniform(1, 2, nodes), "died_at": np.nan}
        file.write("nodes", {"replicate": 0, "node": np.arange(nodes), **place, **charge})
        file.set_text("scenario/source_yaml", f"name: {name}\n")
        file.set_text("scenario/resolved_json", json.dumps({"name": name, "seed": 1, "step": 0.5}))
    html_page.write([folder / "x.h5"] * copies, folder / "x.html")
    return folder / "x.html"


def test_the_default_run_is_drawn_with_a_silent_console_and_no_request(browser, default):
    page = browser.open(f"file://{default}")
    assert page.value("document.documentElement.dataset.ready") == "yes"
    assert page.value("document.getElementById('slider').max") == "700"
    for frame in (1, 350, 700):
        page.value(f"location.hash = '#frame={frame}'")
        page.until(f"document.documentElement.dataset.frame === '{frame}'")
    assert page.value(PAINTED) > 500
    assert page.complaints() == []
    assert page.requests() == []


def test_what_the_page_says_is_heard_and_what_it_asks_for_is_seen(browser, tmp_path):
    """A check of these tests: an error in the console and a request would be found."""
    page = tmp_path / "bad.html"
    page.write_text("<html data-ready=yes><img src='http://127.0.0.1:9/x'><script>console.error('no')</script>")
    browser.open(f"file://{page}")
    browser.until("document.readyState === 'complete'")
    assert browser.complaints() and browser.requests() == ["http://127.0.0.1:9/x"]


def test_an_address_names_a_frame(browser, default):
    page = browser.open(f"file://{default}#frame=350")
    assert page.frame() == 350
    assert page.value("document.getElementById('status').textContent").startswith("step 350 of 700 · 14 s\nerror ")
    for asking_nothing in ("frame=-3", "frame=abc", "frame=1e3", "replay", ""):
        page.value(f"location.hash = '#{asking_nothing}'")
        assert page.value(SOON) == 350, asking_nothing
    page.value("location.hash = '#frame=99999'")
    page.until("location.hash === '#frame=700'")
    assert page.frame() == 700


def test_an_address_names_a_step_where_steps_are_thinned(browser, tmp_path, bare, monkeypatch):
    monkeypatch.setattr(replay, "DETAILS", (replay.DetailLevel(stride=4),))
    page = browser.open(f"file://{page_of_synthetic_result(tmp_path, steps=30)}#frame=12")
    shown = "document.getElementById('status').textContent.split('\\n')[0]"
    assert page.frame() == 12 and page.value(shown) == "step 12 of 30 · 6 s"
    page.value("document.getElementById('ahead').click()")
    assert page.frame() == 16 and page.value("location.hash") == "#frame=16"
    page.value("location.hash = '#frame=30'")
    page.until("document.documentElement.dataset.frame === '30'")


def test_keys_go_through_the_frames_where_the_focus_is_in_the_player(browser, default):
    page = browser.open(f"file://{default}#frame=5")
    page.press("End")
    assert page.frame() == 5  # the focus is on the page
    page.value("document.getElementById('drawing').focus()")
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
    picture = "document.getElementById('drawing').toDataURL()"
    direct = page.value(picture)
    for frame in (700, 300):
        page.value(f"location.hash = '#frame={frame}'")
        page.until(f"document.documentElement.dataset.frame === '{frame}'")
    assert page.value(picture) == direct


def test_tracks_detections_merges_and_splits_are_drawn_where_readings_name_no_target(browser, tmp_path, bare):
    """Two targets cross: their groups merge before and split behind; each track has a colour of its own."""
    base = load("scans_crossing", ["record.events=true", "duration=40 s"])
    experiment.run(base, out=tmp_path / "x.h5")
    html_page.write([tmp_path / "x.h5"], tmp_path / "x.html")
    events = read(tmp_path / "x.h5", "events")
    page = browser.open(f"file://{tmp_path / 'x.html'}#frame=20")
    status = "document.getElementById('status').textContent"
    assert re.search(r"\d confirmed tracks?, \d+ detections", page.value(status)) and "of groups" not in page.value(
        status
    )
    assert page.value("document.body.innerText").count("track, with its number") == 1
    for what in ("merge", "split"):
        step = int(events.step[events.kind.astype(str) == what].iloc[0])
        page.value(f"location.hash = '#frame={step}'")
        page.until(f"document.documentElement.dataset.frame === '{step}'")
        assert f"1 {what} of groups of tracks" in page.value(status)
    assert page.value(PAINTED) > 500
    assert page.complaints() == [] and page.requests() == []


def test_nothing_moves_by_itself_and_with_reduced_motion_only_slow_rates_are_offered(browser, default):
    page = browser.open(f"file://{default}", reduced=True)
    wait = "new Promise(done => setTimeout(() => done(+document.documentElement.dataset.frame), 700))"
    begun = page.frame()
    assert page.value(wait) == begun
    assert page.value("document.getElementById('speed').selectedOptions[0].text").startswith("2/s")
    page.value("document.getElementById('play').click()")
    page.until("+document.documentElement.dataset.frame >= 1")


def test_what_is_stepped_to_is_spoken_and_what_is_played_is_not(browser, default):
    page = browser.open(f"file://{default}#frame=5")
    said = "document.getElementById('spoken').textContent"
    page.value("document.getElementById('ahead').click()")
    assert page.value(said).startswith("step 6 of 700")
    page.value("document.getElementById('play').click()")
    page.until("+document.documentElement.dataset.frame > 9")
    assert page.value(said).startswith("step 6 of 700")


def test_the_picture_and_its_button_fit_into_a_low_window(browser, default):
    page = browser.open(f"file://{default}", width=1200, height=900)
    page.order("Emulation.setDeviceMetricsOverride", width=844, height=390, deviceScaleFactor=1, mobile=True)
    play, drawing = (f"document.getElementById('{name}').getBoundingClientRect()" for name in ("play", "drawing"))
    page.until(f"{play}.bottom - {drawing}.top < 390")


def test_members_of_two_targets_are_told_apart(browser, tmp_path, bare):
    experiment.run(load("two_targets", ["duration=2.04 s", "tracker.particles=40"]), out=tmp_path / "x.h5")
    html_page.write([tmp_path / "x.h5"], tmp_path / "x.html")
    guess = read(tmp_path / "x.h5", "estimates").set_index(["step", "target"])
    page = browser.open(f"file://{tmp_path / 'x.html'}")
    for step in (38, 10, 50):
        page.value(f"location.hash = '#frame={step}'")
        page.until(f"document.documentElement.dataset.frame === '{step}'")
        told = re.findall(r"(\d+) members", page.value("document.getElementById('status').textContent"))
        assert list(map(int, told)) == guess.members[step].tolist()


def test_a_damaged_replay_is_hidden_and_others_are_in_reach(browser, tmp_path, bare):
    place = page_of_synthetic_result(tmp_path, copies=2)
    text = place.read_text()
    film = re.search(r'class="replay-data"[^>]*>([^<]*)<', text)[1]
    place.write_text(text.replace(film, film[:200] + "AAAA" + film[204:], 1))
    page = browser.open(f"file://{place}")
    assert page.value("document.documentElement.dataset.ready") == "failed"
    assert "its data are damaged" in page.value("document.getElementById('message').textContent")
    assert page.value("document.getElementById('player').offsetHeight") == 0
    page.value("const run = document.getElementById('run'); run.value = 1; run.dispatchEvent(new Event('change'))")
    page.until("document.documentElement.dataset.ready === 'yes'")
    assert page.value(PAINTED) > 500 and page.value("document.getElementById('message').offsetHeight") == 0


def test_dark_pages_are_printed_light(browser, default):
    page = browser.open(f"file://{default}")
    page.order("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    ground = "getComputedStyle(document.body).backgroundColor"
    page.until(f"{ground} === 'rgb(22, 24, 26)'")
    page.value("dispatchEvent(new Event('beforeprint'))")
    assert page.value(ground) == "rgb(255, 255, 255)"
    page.value("dispatchEvent(new Event('afterprint'))")
    assert page.value(ground) == "rgb(22, 24, 26)"


def test_a_long_name_does_not_widen_the_page(browser, tmp_path, bare):
    page = browser.open(f"file://{page_of_synthetic_result(tmp_path, name='long' * 300, copies=2)}", width=390)
    assert page.value("document.documentElement.scrollWidth") <= 390


@pytest.mark.parametrize("width", [375, 1200])
def test_the_page_is_no_wider_than_its_window(browser, default, width):
    page = browser.open(f"file://{default}", width=width)
    assert page.value("document.documentElement.scrollWidth") <= width
    assert page.value("document.getElementById('drawing').getBoundingClientRect().width") > 0.6 * min(width, 900)
    for name in ("play", "back", "ahead", "speed"):
        assert page.value(f"document.getElementById('{name}').getBoundingClientRect().height") >= 28, name


def test_a_hostile_name_is_shown_and_does_nothing(browser, tmp_path):
    page = browser.open(f"file://{page_of_synthetic_result(tmp_path, name=HOSTILE)}")
    assert page.value("document.title") == HOSTILE.strip()
    assert page.value("document.querySelector('h1').textContent") == HOSTILE
    assert page.value("document.images.length") == 0
    assert page.complaints() == [] and page.requests() == []


def test_what_were_not_escaped_would_not_run_either(browser, tmp_path):
    page = page_of_synthetic_result(tmp_path)
    page.write_text(page.read_text().replace("<main>", f"<main><b>{HOSTILE.removeprefix('</script>')}"))
    shown = browser.open(f"file://{page}")
    assert shown.value("document.images.length") == 1 and shown.value("document.title") == "invented"
    told = [said["entry"]["text"] for said in shown.complaints() if "entry" in said]
    assert len(told) >= 2 and all("Content Security Policy" in text for text in told)


@pytest.mark.parametrize("told", [{"estimates": False}, {"nodes": 100_000}, {"nodes": 1, "steps": 1}])
def test_odd_results_are_drawn_too(browser, tmp_path, told, bare):
    page = browser.open(f"file://{page_of_synthetic_result(tmp_path, **told)}#frame=1")
    assert page.value("document.documentElement.dataset.ready") == "yes" and page.frame() == 1
    assert page.complaints() == []


def test_a_browser_that_cannot_unpack_says_so(browser, tmp_path):
    page = page_of_synthetic_result(tmp_path)
    shown = browser.open(f"file://{page}")
    frame = browser.order("Page.addScriptToEvaluateOnNewDocument", source="delete window.DecompressionStream")
    browser.order("Page.reload")
    shown.until("document.documentElement?.dataset.ready === 'failed'")
    browser.order("Page.removeScriptToEvaluateOnNewDocument", identifier=frame["identifier"])
    assert "no DecompressionStream" in shown.value("document.getElementById('message').textContent")
    assert shown.value("document.querySelectorAll('figure svg').length") > 0
