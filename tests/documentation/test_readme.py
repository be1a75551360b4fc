"""What the README shows works as it is printed there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import wsnsim
from tests.readme import spliced
from tests.readme_tables import DENSITIES, RADIO_ROWS, SLEEPERS, TABLES, commercial_radio, sleeping, sleeping_rarely
from wsnsim.base.errors import ScenarioError
from wsnsim.cli.shared import group
from wsnsim.papers.paper import PAPERS, paper
from wsnsim.scenario import resolved
from wsnsim.scenario.sweep import load_sweep
from wsnsim.testing import check_tracker

README = (Path(__file__).parents[2] / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
SCENARIO, RADIO, RECORDED, APPOINTED, SLEEP, SWEEP = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
READS, PLAIN, TRACKER = PYTHON


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the README's scenario, shortened, and its result."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "results").mkdir()
    (folder / "pso_mhpf.yaml").write_text(SCENARIO.replace("duration: 28 s", "duration: 1 s"))
    wsnsim.run(folder / "pso_mhpf.yaml", out=folder / "results" / "pso_mhpf.h5")
    return folder


def test_the_scenario_is_the_shipped_one(tmp_path):
    (tmp_path / "pso_mhpf.yaml").write_text(SCENARIO)
    assert resolved(wsnsim.load(tmp_path / "pso_mhpf.yaml")) == resolved(wsnsim.load("pso_mhpf"))


def test_the_lines_of_a_radio_that_can_fail_run_with_any_scenario(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: pso_mhpf\nname: mine\n{RADIO}")
    run = wsnsim.simulate(wsnsim.load(path, ["duration=14 s", "tracker.kind=ekf"]))
    assert run.run["collided"] > 0 and run.joules["idle"] > 100


def test_the_lines_of_a_recorded_world_run_on_a_shipped_track(tmp_path):
    shipped = Path("scenarios/recorded/ble").resolve()
    lines = RECORDED.replace("receivers.csv", f"{shipped}/receivers.csv").replace("walk", f"{shipped}/straight_04")
    head = "name: mine\nnetwork: none\nduration: 24 s\nstep: 0.25 s\ntracker: {kind: ekf}\nprior: {sd: [1, 1, 1, 1]}\n"
    (tmp_path / "mine.yaml").write_text(head + lines)
    assert wsnsim.simulate(tmp_path / "mine.yaml").run["rmse"] < 5.0


def test_the_lines_of_appointed_clusters_run_with_any_scenario_whose_tracker_is_in_the_head(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: jiang_field\nname: mine\n{APPOINTED}", encoding="utf-8")
    assert wsnsim.simulate(wsnsim.load(path, ["duration=2 s", "tracker.kind=ekf"])).run["rmse"] < 5.0


def test_the_lines_of_a_network_that_sleeps_run_with_any_scenario_whose_tracker_is_in_the_head(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: pso_mhpf\nname: mine\n{SLEEP}")
    run = wsnsim.simulate(wsnsim.load(path, ["step=1 s", "tracker.kind=ekf", "motion.noise=q_only"]))
    assert 0.25 < run.run["awake"] < 0.6 and run.tracks[0]["woken"] > 0


def test_the_message_about_a_mistake_is_the_one_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bad.yaml").write_text(SCENARIO.replace("height:", "heigth:"))
    with pytest.raises(ScenarioError) as caught:
        wsnsim.load("bad.yaml")
    (shown,) = re.findall(r"^bad\.yaml.*$", README, re.MULTILINE)
    assert str(caught.value).splitlines()[0] == shown


def test_the_comparisons_of_trackers_are_plans_whose_points_have_the_names_shown():
    """Those of the command lines and that of Python."""
    shown = re.findall(r"wsnsim compare (\w+) --trackers '?([^' ]+)'? --rep", README)
    shown += re.findall(r'wsnsim\.sweep\("(\w+)", trackers="([^"]+)"', README)
    assert len(shown) == 3
    for source, trackers in shown:
        points = load_sweep(source, trackers=trackers).points
        assert ",".join(*zip(*(point.settings.values() for point in points), strict=True)) == trackers


def test_every_command_is_shown():
    assert set(re.findall(r"^\| `wsnsim (\w+)", README, re.MULTILINE)) == set(group.commands)


def test_every_room_is_shown():
    shown = set(re.findall(r"^  (\w+)(?:/|\.py) ", README, re.MULTILINE))
    rooms = {path.stem for path in Path(wsnsim.__file__).parent.iterdir() if not path.name.startswith("_")}
    assert shown == rooms


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


def test_the_tracker_keeps_the_rules_and_runs_from_a_scenario(folder, monkeypatch):
    (folder / "mylab.py").write_text(TRACKER)
    monkeypatch.syspath_prepend(folder)
    import mylab

    check_tracker(mylab.Loudest())
    text = re.sub(r"tracker:.*", 'tracker: {kind: "mylab:Loudest", sd: 30 m}', (folder / "pso_mhpf.yaml").read_text())
    (folder / "loudest.yaml").write_text(text)
    report = wsnsim.run(folder / "loudest.yaml", out=folder / "loudest.h5")
    assert report.summaries[0].run["rmse"] < 60.0


def test_the_sweep_is_one_and_its_blocks_are_combined(tmp_path):
    (tmp_path / "mine.yaml").write_text(SWEEP)
    plan = load_sweep(tmp_path / "mine.yaml")
    assert plan.name == "mine"
    assert len(plan.points) == 3 * 4 * 2 * 20
    assert plan.until is not None
    assert plan.replicates == plan.until.at_most == 200


def block(name):
    """What `make readme` wrote between its marks."""
    (text,) = re.findall(rf"<!-- {name}: made by make readme -->\n(.*?)<!-- end of {name} -->", README, re.DOTALL)
    return text.strip()


def test_the_table_of_the_papers_has_a_row_for_each_main_claim_with_what_was_published():
    text = block("papers") + "\n" + block("li2012")
    lines = [line.strip("|").split(" | ") for line in text.splitlines() if re.match(r"\| [a-z]+\d{4}, ", line)]
    shown = {tuple(cell.strip().replace("\\", "") for cell in line[:4]) for line in lines}
    claimed, orders = set(), 0
    for name in PAPERS:
        for experiment, claim in paper(name).main:
            orders += bool(claim.other)
            number = getattr(claim, "published", None)
            published = "-" if number is None else ("about " if claim.read else "") + f"{number:.4g}"
            claimed.add((f"{name}, {experiment.name}", claim.label, claim.variant, published))
    assert shown == claimed
    assert len(lines) == len(claimed) + orders > 50, "an order has a second row: the median of the paired differences"


def test_the_frontier_says_who_is_cheapest_and_what_is_on_the_pareto_front_on_either_radio():
    lines = block("frontier").splitlines()
    assert [re.match(r"- (\w+) radio, (\w+)", line).groups() for line in lines] == [
        (radio, word) for radio in ("ideal", "realistic") for word in ("cheapest", "Pareto")
    ]


def test_every_picture_that_is_shown_is_there():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert len(shown) >= 3 and all((Path(__file__).parents[2] / name).stat().st_size > 20_000 for name in shown)


def test_tables_of_the_commercial_radio_and_of_sleeping_networks_have_their_marks_and_a_row_each():
    sleepers = [*SLEEPERS.values()]
    for name, labels in (("commercial_radio", RADIO_ROWS), ("sleeping", sleepers * 3), ("sleeping_rarely", sleepers)):
        rows = block(name).splitlines()[2:]
        assert all(f"`{label}`" in row for label, row in zip(labels, rows, strict=True))
        assert f"\n{TABLES[name][1].__name__}\n" in spliced(README, name, TABLES[name][1].__name__)


def test_the_row_of_a_scenario_on_the_commercial_radio_is_what_a_hand_would_compute():
    runs = pd.DataFrame({"scenario": name, "steps": 700, "rmse": float(i), "energy": 440.0 + i}
                        for name in RADIO_ROWS for i in range(6))  # fmt: skip
    tracks = pd.DataFrame({"scenario": name, "reports": 690, "late": 12, "delay": 0.004 + i / 1000, "lost": i == 5,
                           "losses": int(i > 3)} for name in RADIO_ROWS for i in range(6))  # fmt: skip
    lines = commercial_radio(tracks, runs).splitlines()
    assert "steps with an estimate, of 700" in lines[0] and len(lines) == 9
    cells = lines[-1].strip("| ").split(" | ")
    assert cells[0].startswith("`ekf_real`") and cells[1:4] == ["690", "2", "6.5 ms"]
    assert cells[4].startswith("2.5 [") and cells[5:] == ["1, 2 of 6", "442"]


def test_the_rows_of_sleeping_networks_are_what_a_hand_would_compute():
    points = [(name, nodes, step) for name in SLEEPERS for nodes in DENSITIES for step in (2.0, 10.0)]
    of = [{"scenario": name, "deploy.nodes": nodes, "step": step} for name, nodes, step in points for _ in range(6)]
    runs = pd.DataFrame(of).assign(steps=100)
    tracks = pd.DataFrame(of).assign(
        tracked=0.914, tracked_three=0.625, median_error_three=1.75, delay=0.024, report_delay=np.nan, received=12,
        due=20, ineffective_twenty=24, ineffective=670, dismissed=260, reacquired=12,
    )  # fmt: skip
    lines = sleeping(tracks, runs).splitlines()
    assert lines[2] == "| 200 | `gmtt, literal` | 91.4 [91.4, 91.4] | 62.5 | 1.75 | 24 ms, - | 60 | 24 | 2.6 |"
    assert lines[3].startswith("|  | `gmtt, repaired` | ") and len(lines) == 17
    first = sleeping_rarely(tracks, runs).splitlines()[2]
    assert first == "| `gmtt, literal` | 91.4 [91.4, 91.4] | 62.5 | 1.75 | 12 | 6.7 |"


def test_no_entry_of_the_changelog_and_no_term_of_the_glossary_stands_twice():
    root = Path(__file__).parents[2]
    entries = re.findall(r"^- .*", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    rows = re.findall(r"^\| ([^|(]+?) (?:\([^|]*\) )?\|", (root / "docs/glossary.md").read_text(encoding="utf-8"), re.M)
    terms = [term.removesuffix(" of a claim") for term in rows if term not in ("term", "---", "short")]
    assert len(entries) > 20 and len(set(entries)) == len(entries)
    assert len(terms) > 100 and len(set(terms)) == len(terms)
