"""What the how-to guides and explanations show works as it is printed there."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

import wsnsim
from tests.documentation.pages_of_docs import ROOT, fences, text
from wsnsim.base.errors import ScenarioError
from wsnsim.scenario import resolved
from wsnsim.scenario.sweep import load_sweep

(SCENARIO,) = fences("docs/how-to/scenario.md", "yaml")
READS, PLAIN = fences("docs/how-to/results.md", "python")[:2]


def one(page: str, key: str, language: str = "yaml") -> str:
    """The only block of a page that holds a key."""
    (found,) = (block for block in fences(page, language) if key in block)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the scenario of the guide, shortened, and its result."""
    folder = tmp_path_factory.mktemp("guide")
    (folder / "results").mkdir()
    (folder / "pso_mhpf.yaml").write_text(SCENARIO.replace("duration: 28.04 s", "duration: 1.04 s"))
    wsnsim.run(folder / "pso_mhpf.yaml", out=folder / "results" / "pso_mhpf.h5")
    return folder


def test_the_scenario_is_the_shipped_one(tmp_path):
    (tmp_path / "pso_mhpf.yaml").write_text(SCENARIO)
    assert resolved(wsnsim.load(tmp_path / "pso_mhpf.yaml")) == resolved(wsnsim.load("pso_mhpf"))


def test_the_message_about_a_mistake_is_the_one_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bad.yaml").write_text(SCENARIO.replace("height:", "heigth:"))
    with pytest.raises(ScenarioError) as caught:
        wsnsim.load("bad.yaml")
    (shown,) = re.findall(r"^bad\.yaml.*$", text("docs/how-to/scenario.md"), re.MULTILINE)
    assert str(caught.value).splitlines()[0] == shown


def test_the_lines_of_a_radio_that_can_fail_run_with_any_scenario(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: pso_mhpf\nname: mine\n{one('docs/how-to/radio.md', 'blackout')}")
    run = wsnsim.experiment.simulate_run(wsnsim.load(path, ["duration=14 s", "tracker.kind=ekf"]))
    assert run.run["collided"] > 0 and run.joules["idle"] > 100


def test_the_lines_of_appointed_clusters_run_with_any_scenario_whose_tracker_is_in_the_head(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: jiang_field\nname: mine\n{one('docs/how-to/clusters.md', 'horizon')}", encoding="utf-8")
    assert wsnsim.experiment.simulate_run(wsnsim.load(path, ["duration=2 s", "tracker.kind=ekf"])).run["rmse"] < 5.0


def test_the_lines_of_a_network_that_sleeps_run_with_any_scenario_whose_tracker_is_in_the_head(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: pso_mhpf\nname: mine\n{one('docs/how-to/radio.md', 'directed_flood')}")
    slow = ["step=1 s", "duration=29 s", "tracker.kind=ekf"]
    run = wsnsim.experiment.simulate_run(wsnsim.load(path, [*slow, "motion.noise=q_only"]))
    assert 0.25 < run.run["awake"] < 0.6 and run.tracks[0]["woken"] > 0


def test_the_comparisons_of_trackers_are_plans_whose_points_have_the_names_shown():
    """Those of the command lines and that of Python."""
    shown = re.findall(r"wsnsim compare (\w+) --trackers '?([^' ]+)'? --rep", text("docs/how-to/campaigns.md"))
    shown += re.findall(r'wsnsim\.sweep\("(\w+)", trackers="([^"]+)"', text("docs/how-to/campaigns.md"))
    assert len(shown) == 3
    for source, trackers in shown:
        points = load_sweep(source, trackers=trackers).points
        assert ",".join(*zip(*(point.settings.values() for point in points), strict=True)) == trackers


def test_the_sweep_is_one_and_its_blocks_are_combined(tmp_path):
    (tmp_path / "mine.yaml").write_text(one("docs/how-to/campaigns.md", "latin_hypercube"))
    plan = load_sweep(tmp_path / "mine.yaml")
    assert plan.name == "mine"
    assert len(plan.points) == 3 * 4 * 2 * 20
    assert plan.until is not None
    assert plan.replicates == plan.until.at_most == 200


def test_a_guide_is_short():
    long = {page.name: len(page.read_text(encoding="utf-8").split()) for page in (ROOT / "docs/how-to").glob("*.md")}
    assert {name: words for name, words in long.items() if words > 900} == {}


def test_all_pages_that_are_written_by_hand_have_at_most_55_000_words():
    reference = {ROOT / "docs/reference" / f"{name}.md" for name in ("index", "python", "stability", "study")}
    pages = [page for page in (ROOT / "docs").rglob("*.md") if "reference" not in page.parts or page in reference]
    pages += [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    assert len(pages) > 80
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= 55_000


def test_every_package_is_shown():
    shown = set(re.findall(r"^  (\w+)(?:/|\.py) ", text("docs/explanation/architecture.md"), re.MULTILINE))
    packages = {
        path.stem for path in Path(wsnsim.__file__).parent.iterdir() if path.name[0] != "_" and path.name != "py.typed"
    }
    assert shown == packages


def test_a_result_is_read_in_five_lines(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(READS, names)
    assert len(names["estimates"]) == 25
    printed = capsys.readouterr().out
    assert "mean" in printed
    assert "estimate" in printed


def test_plain_h5py_and_pandas_read_the_same(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(PLAIN, names)
    pd.testing.assert_frame_equal(names["estimates"], wsnsim.read("results/pso_mhpf.h5", "estimates"))
