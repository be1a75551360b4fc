"""The page shows what the tables hold, is complete and escaped, and keeps to its size."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from wsnsim.analysis.answer import answer
from wsnsim.analysis.quantities import BOUND_NAMES, QUANTITIES
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import TABLES
from wsnsim.report import html_page, page_sections, replay, scenario_words, svg_figures
from wsnsim.report.svg_figures import SvgFigure
from wsnsim.scenario import load, resolved

from .page_reader import PageReader, decoded, no_figures, replays_in
from .synthetic_results import ON_A_LINE, write_result

GLOSSARY = Path(__file__).parents[2] / "docs" / "glossary.md"
HOSTILE = "</script><script>alert(1)</script>{{script}}&$\\frac"


def cells_of(table):
    """{name of a quantity: its first cell} of the summary tables."""
    return dict(re.findall(r'<th scope="row"><span [^>]*>([^<]*)</span></th><td>(.*?)</td>', table))


@pytest.fixture(scope="module")
def page(real, tmp_path_factory):
    """The page of a simulated result."""
    out = tmp_path_factory.mktemp("page") / "real.html"
    html_page.write([real], out)
    return out.read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_page_is_whole_and_asks_for_nothing(page):
    read_page = PageReader(page)
    tags = [tag for tag, _ in read_page.tags]
    assert not {"iframe", "object", "embed", "base", "form", "audio", "video"} & set(tags)
    assert [at.get("type") for tag, at in read_page.tags if tag == "script"] == ["text/plain", None]
    policy = next(at["content"] for _, at in read_page.tags if at.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    for _, attributes in read_page.tags:
        for name in ("src", "href", "xlink:href", "srcset", "action"):
            assert attributes.get(name, "#").startswith(("#", "data:"))
    assert len(set(read_page.ids)) == len(read_page.ids)
    used = set(re.findall(r'url\(#([^)]+)\)|xlink:href="#([^"]+)"', page))
    assert used and {a or b for a, b in used} <= set(read_page.ids)


@pytest.mark.thorough
def test_the_summary_has_the_means_the_intervals_and_what_was_published(tmp_path):
    path = write_result(tmp_path / "x.h5", runs=8)
    table = page_sections.summary_table([path], ["x"], lambda scenario: ({"energy": 1.82}, "Jiang 2013", "why"))
    cells = cells_of(table)
    assert cells["Monte Carlo runs"] == "8"
    mean, low, high = re.match(r"([\d.]+) m <span[^>]*>\[([\d.]+), ([\d.]+)\]", cells["median per-run RMSE"]).groups()
    assert float(mean) == 4.5 and 1.5 < float(low) < 4.5 < float(high) < 7.5
    assert "published 1.82 J (Jiang 2013)" in cells["energy spent"]
    assert (
        "["
        not in re.search(
            r"<td>(.*?)</td>", page_sections.summary_table([write_result(tmp_path / "y.h5", runs=4)], ["y"])
        )[1]
    )


@pytest.mark.thorough
def test_the_same_result_gives_the_same_bytes(tmp_path):
    path = write_result(tmp_path / "x.h5", events=True, **ON_A_LINE)
    for name in ("a.html", "b.html"):
        html_page.write([path], tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.html", "b.html", "x.h5"]


@pytest.mark.thorough
def test_every_text_of_a_scenario_is_escaped(tmp_path):
    states = ((f"px{HOSTILE.replace('/', '')}", f"m{HOSTILE}"), ("vx", "m/s"))  # no column has a '/' in its name
    path = write_result(tmp_path / "<b>'\".h5", states, (0,), name=HOSTILE)
    html_page.write([path], tmp_path / "x.html")
    read_page = PageReader((tmp_path / "x.html").read_text(encoding="utf-8"))
    tags = [tag for tag, _ in read_page.tags]
    assert tags.count("script") == 2 and "b" not in tags
    shown = [text for tag, text in read_page.texts if HOSTILE in text]
    assert len(shown) >= 5
    header, _ = decoded(replays_in((tmp_path / "x.html").read_text(encoding="utf-8"))[0])
    assert HOSTILE in header["axes"][1]


@pytest.mark.thorough(fast=["told5-True-There is nothing to replay"])
@pytest.mark.parametrize(
    ("told", "drawn", "word"),
    [
        ({**ON_A_LINE, "estimates": False}, False, "No estimates are drawn: table estimates has no rows"),
        ({**ON_A_LINE, "without": ("events",)}, False, "table events was not recorded (record.events=true)"),
        ({**ON_A_LINE, "without": ("nodes",)}, True, "No nodes are drawn"),
        ({"status": "partial", "without": ("runs", "estimates")}, True, "the simulation did not finish"),
        ({**ON_A_LINE, "without": ("estimates",)}, False, "No estimates are drawn: table estimates was not recorded"),
        ({"without": tuple(name for name in TABLES if name != "runs")}, True, "There is nothing to replay"),
        ({"states": (), "place": None, "events": True}, True, "bursts sent"),
    ],
)
def test_a_result_that_lacks_something_still_gives_a_sound_page(tmp_path, monkeypatch, told, drawn, word):
    if not drawn:
        monkeypatch.setattr(html_page, "svg_figures", no_figures)
    path = write_result(tmp_path / "x.h5", **told)
    html_page.write([path], tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    PageReader(text)
    assert word in text


@pytest.mark.thorough
def test_a_hundred_thousand_nodes_fit_and_a_small_page_is_kept_to(tmp_path, monkeypatch):
    path = write_result(tmp_path / "x.h5", nodes=100_000, without=("energy_steps",))
    for limit in (html_page.LIMIT, 400_000):
        if limit < html_page.LIMIT:
            monkeypatch.setattr(html_page, "svg_figures", no_figures)
        made = html_page.write([path], tmp_path / "x.html", limit=limit)
        assert made.size == (tmp_path / "x.html").stat().st_size <= limit
        thinned = [note for note in made.notes if "of 100,000 nodes are drawn" in note]
        assert bool(thinned) == (limit < html_page.LIMIT)
        assert all(note in (tmp_path / "x.html").read_text() for note in thinned)


@pytest.mark.thorough
def test_several_results_stand_side_by_side_and_share_the_room(real, tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "svg_figures", no_figures)
    other = write_result(tmp_path / "y.h5", events=True)
    html_page.write([other, real, other], tmp_path / "x.html", limit=80_000)
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    PageReader(text)
    assert len(text.encode()) <= 80_000
    assert re.findall(r'class="replay-data" data-title="([^"]*)"', text) == [
        "synthetic, y.h5",
        "pso_mhpf",
        "synthetic, y.h5",
    ]
    assert decoded(replays_in(text)[1])[0]["last"] == 100


@pytest.mark.thorough
def test_figures_name_their_targets_and_say_whose_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(svg_figures, "MAX_TARGETS", 2)
    drawn, left_out = svg_figures.svg_figures(write_result(tmp_path / "x.h5", targets=3, **ON_A_LINE), 0)
    labels = [each.label for each in drawn if each.name not in ("error", "consistency")]
    assert labels == [
        f"{what} of replicate 0, target {of}" for what, of in (("track", 0), ("track", 1), ("px", 0), ("vx", 0))
    ]
    assert "only the tracks of the first 2 of 3 targets are drawn" in left_out


@pytest.mark.thorough
def test_of_several_results_the_least_important_figures_are_left_out_first(tmp_path, monkeypatch):
    sizes = {"x": (40_000, 9_000, 9_000), "y": (20_000, 30_000, 10_000)}

    def drawn(path, replicate, plugins):
        return [
            SvgFigure(f"{i}", f"figure {i}", f"<svg>{'x' * size}</svg>") for i, size in enumerate(sizes[path.stem])
        ], []

    monkeypatch.setattr(html_page, "svg_figures", drawn)
    paths = [write_result(tmp_path / f"{name}.h5", name=name) for name in sizes]
    written = html_page.write(paths, tmp_path / "x.html", limit=164_000)
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    shown = re.findall(r'aria-label="(figure \d)"', text)
    assert shown == ["figure 0", "figure 1", "figure 0"]
    left_out = [
        f"{name}, without figure {i}: the page would be too large" for name, i in (("x", 2), ("y", 1), ("y", 2))
    ]
    assert sorted(note.replace(": ", ", ", 1) for note in written.notes if "too large" in note) == left_out


def test_results_of_one_name_are_told_apart_by_as_many_folders_as_differ(tmp_path):
    results = (
        ("a", "one/b/r0.h5"), ("a", "two/b/r0.h5"), ("c", "x.h5"), ("d", "x.h5"), ("d", "y.h5"), ("e", "z"), ("e", "z"),
    )  # fmt: skip
    named = page_sections.names([{"name": name} for name, _ in results], [tmp_path / place for _, place in results])
    assert named == ["a, one/b/r0.h5", "a, two/b/r0.h5", "c", "d, x.h5", "d, y.h5", "e, z", "e, z"]


@pytest.mark.thorough
def test_a_file_whose_first_replicate_is_another_gives_a_page_of_that_one(tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "svg_figures", no_figures)
    path = write_result(tmp_path / "x.h5", runs=2, first=145)
    html_page.write([path], tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert "2 Monte Carlo runs (replicate 145 is replayed)" in text and replays_in(text)
    bare = write_result(tmp_path / "y.h5", runs=2, without=tuple(name for name in TABLES if name != "runs"))
    html_page.write([bare], tmp_path / "y.html")
    assert "is replayed" not in (tmp_path / "y.html").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_direction_of_writing_stays_within_its_name(tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "svg_figures", no_figures)
    name = "\u202egnp.exe"
    html_page.write([write_result(tmp_path / "x.h5", name=name)] * 2, tmp_path / "x.html")
    for tag, text in PageReader((tmp_path / "x.html").read_text(encoding="utf-8")).texts:
        assert name not in text or tag in ("title", "bdi", "pre")


def test_only_the_ids_of_a_figure_are_renamed_not_what_it_says():
    svg = '<svg><path id="a"/><use href="#a"/><text>id="a" url(#a)</text></svg>'
    assert 'id="f0-a"' in (made := page_sections._figure(SvgFigure("", "", svg), "0"))
    assert 'href="#f0-a"' in made and '<text>id="a" url(#a)</text>' in made


@pytest.mark.thorough
def test_another_replicate_is_replayed_and_one_that_is_not_there_is_refused(real, tmp_path):
    one, other = (decoded(replay.encode(real, run, 10**7).text)[1]["truth_x"] for run in (0, 1))
    assert not np.array_equal(one, other)
    with pytest.raises(UsageError, match="no replicate 2; it has 0, 1"):
        html_page.write([real], tmp_path / "x.html", 2)
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_a_page_that_cannot_be_written_leaves_nothing(real, tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "svg_figures", no_figures)
    with pytest.raises(ResultError, match=r"x\.html: cannot be written: No such file"):
        html_page.write([real], tmp_path / "none" / "x.html")
    (tmp_path / "x.html").mkdir()
    with pytest.raises(ResultError, match="cannot be written"):
        html_page.write([real], tmp_path / "x.html")
    assert [file.name for file in tmp_path.iterdir()] == ["x.html"]


def test_every_row_of_the_summary_is_explained_and_few_are_shown_unfolded(real):
    table = page_sections.summary_table([real], ["x"], bounds=True)
    shown, folded = table.split("<details>")
    assert 6 <= len(cells_of(shown)) <= 14 < len(cells_of(shown)) + len(cells_of(folded))
    explained = {name: said for said, name in re.findall(r'data-tip="([^"]+)">([^<]*)</span></th>', table)}
    assert {*cells_of(table)} == {*explained}
    assert explained["time-averaged RMSE"] == QUANTITIES["rmse"].definition


@pytest.mark.thorough
def test_the_bounds_are_shown_only_on_request(real):
    for bounds in (False, True):
        shown = cells_of(page_sections.summary_table([real], ["x"], bounds=bounds))
        assert (set(BOUND_NAMES.values()) <= set(shown)) == bounds


def test_the_legend_explains_marks_in_the_words_of_the_glossary():
    meanings = dict(
        re.findall(r"^\| ([^|]*?)(?: \([^|]*\))? \| (.*?) \| [^|]* \|$", GLOSSARY.read_text(), re.MULTILINE)
    )
    script = (Path(html_page.__file__).parent / "static" / "legend.js").read_text()
    said = dict(re.findall(r'^  (\w+): "(.*)",$', script, re.MULTILINE))
    terms = {"truth": "ground truth, ground-truth trajectory", "node": "node", "head": "cluster head",
             "member": "member", "energy": "residual energy"}  # fmt: skip
    for key, term in terms.items():
        assert said[key].split(";")[0] == meanings[term].split(";")[0], key


@pytest.mark.thorough
def test_several_results_have_an_answer_each_under_their_names(real, tmp_path, monkeypatch):
    monkeypatch.setattr(html_page, "svg_figures", no_figures)
    html_page.write([real, real], tmp_path / "x.html")
    said = answer(real)
    assert (tmp_path / "x.html").read_text().count(f"</bdi></b>: {said}</p>") == 2


@pytest.mark.parametrize(
    ("text", "overrides", "said"),
    [
        ("{extends: bases/field.yaml, name: x}", [], {}),
        ("{extends: gmtt.yaml, name: x, duration: 42 s, mac: {kind: xmac, interval: 1 s}}", [],
         {"gmtt.yaml": ["duration: 202 → 42", "mac.kind: csma → xmac"]}),
        ("{extends: gmtt, name: x}", ["clusters.quiet=null"], {"x": ["clusters.quiet: 0.012 → null"]}),
        ("{extends: ../../gmtt.yaml, name: x}", ["clusters.quiet=null"], {}),
        ("{extends: bases/jiang2013.yaml, name: x, tracker: {kind: ekf}, energy: {battery: 1 J}}", ["link.loss=0.1"],
         {"bases/jiang2013.yaml": ["energy.battery: 2 → 1"], "x": ["link.loss: 0 → 0.1"]}),
    ],
)  # fmt: skip
def test_a_page_says_what_was_changed_against_a_known_scenario_and_by_overrides(tmp_path, text, overrides, said):
    known = re.sub(r"extends: (\.\./)*", f"extends: {Path('scenarios').resolve()}/", text)
    (tmp_path / "x.yaml").write_text(known)
    values = resolved(load(tmp_path / "x.yaml", overrides))
    found = {name: scenario_words._changes_html(name, pairs)
             for name, pairs in scenario_words.changes(text, values, bool(overrides))}  # fmt: skip
    assert {name: re.findall("<li><bdi>(.*?)</bdi></li>", items) for name, items in found.items()} == said


@pytest.mark.parametrize("named", ["/etc/hostname", "../pyproject.toml", "a" * 300, "[x, y]", '"\\0"', "studies"])
def test_what_a_page_does_not_know_of_a_scenario_it_does_not_say(named):
    assert list(scenario_words.changes(f"{{extends: {named}, name: x}}", {"name": "x"}, True)) == []
    assert list(scenario_words.changes("[1", {}, True)) == []
