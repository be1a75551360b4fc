"""Who may import a plug-in: reading commands never do, others by the origin of its name."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import pytest

import wsnsim
from tests.campaign.inline_engine import InlineEngine
from wsnsim import scenario
from wsnsim.analysis import error_bounds
from wsnsim.base.errors import ScenarioError
from wsnsim.campaign import task
from wsnsim.cli import main
from wsnsim.cli.shared import every_command
from wsnsim.scenario import Plugins, fields, registry

SIDE = '''
from pathlib import Path

from wsnsim import part
from wsnsim.trackers.bootstrap_pf import Pf

with (Path(__file__).parent / "imported").open("a") as marker:
    marker.write("once ")


@part
class Effect(Pf):
    """A tracker whose import leaves a mark."""
'''
LAB = """
extends: ungm_pf
name: lab
duration: 6 s
tracker: {kind: "side:Effect", particles: 20}
"""
NEEDS = "needs plug-in side:Effect; --plugins allows it"
IMPORTS = "wsnsim: imports side ("


def forget() -> None:
    """Undo imports of the plug-in."""
    sys.modules.pop("side", None)
    fields.part_model.cache_clear()
    task._scenario.cache_clear()


@pytest.fixture(scope="module", autouse=True)
def _inline() -> Iterator[None]:
    """Perform tasks in this process, which takes less time; tests/campaign/test_local_engine.py has workers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wsnsim.cli.campaign_session.engine_of", lambda *_: InlineEngine())
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a plug-in, a scenario that names it, its result, and a campaign of it."""
    place = tmp_path_factory.mktemp("lab")
    (place / "side.py").write_text(SIDE)
    (place / "lab.yaml").write_text(LAB)
    path, here = list(sys.path), Path.cwd()
    os.chdir(place)
    try:
        lab = str(place / "lab.yaml")
        assert main(["run", lab, "--out", "lab.h5", "--replicates", "2", "--quiet"]) == 0
        assert main(["sweep", lab, "--vary", "seed=1,2", "--out", "campaign", "--quiet"]) == 0
    finally:
        os.chdir(here)
        sys.path[:] = path
        registry.SEARCHED.clear()
        forget()
    (place / "imported").unlink()
    return place


@pytest.fixture
def lab(made: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder as working directory; nothing of it is imported yet."""
    monkeypatch.chdir(made)
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder not in ("", str(made))])
    monkeypatch.setattr(registry, "SEARCHED", [])
    forget()
    (made / "imported").unlink(missing_ok=True)
    yield made
    forget()


def imported(lab: Path) -> bool:
    return (lab / "imported").exists()


OF_OTHERS = {
    "collect": ("campaign", 0, False),
    "compare": ("campaign", 0, True),
    "diff": ("lab.h5 lab.h5", 0, False),
    "export": ("lab.h5 --parquet parquet --csv csv --mat lab.mat", 0, False),
    "fit": ("lab.h5 --nodes lab.yaml", 1, False),
    "import": ("ns3 lab.yaml", 1, False),
    "info": ("lab.yaml", 2, True),
    "lifetime": ("lab.h5", 2, True),
    "plot": ("lab.h5 --out lab.png", 0, True),
    "report": ("lab.h5 --out lab.html", 0, True),
    "trace": ("lab.h5 --step 1", None, False),
    "recover": ("lab.h5 --out recovered.h5", None, False),
    "check": ("lab.h5", 2, True),
    "run": ("lab.h5 --out again.h5", 2, True),
    "verify": ("lab.h5", 2, True),
    "sweep": ("campaign", 0, False),
    "list": ("trackers", 0, False),
    "schema": ("", 0, False),
    "new": ("fresh", None, False),
    "reproduce": ("nobody", 2, False),
    "watch": ("lab.h5 --exit --no-browser", 2, False),
}
"""Of each command: its words, its exit code (None: not looked at), and whether it says that it needs a plug-in."""


@pytest.mark.thorough(fast=["report", "watch"])
@pytest.mark.parametrize("command", sorted(every_command()))
def test_no_command_imports_what_a_file_of_others_names(
    command: str, lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words, code, needs = OF_OTHERS[command]
    ended = main([command, *words.split()])
    said = "".join(capfd.readouterr())
    assert not imported(lab)
    assert str(lab) not in sys.path
    assert "internal error" not in said and "Traceback" not in said and IMPORTS not in said
    assert code is None or ended == code, said
    assert (NEEDS in said) is needs


def test_a_campaign_of_others_is_plotted_without_its_plugin(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", "campaign", "--out", "lab.svg"]) == 0
    assert IMPORTS not in capfd.readouterr().err and not imported(lab)
    assert Path("lab.svg").stat().st_size > 1_000


@pytest.mark.thorough
def test_a_result_is_described_without_its_plugin(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "lab.h5"]) == 0
    assert NEEDS not in "".join(capfd.readouterr()) and not imported(lab)


@pytest.mark.thorough(fast=["run lab.h5 --out again.h5"])
@pytest.mark.parametrize(
    "words",
    [
        "plot lab.h5 --out lab.png",
        "report lab.h5 --out lab.html",
        "run lab.h5 --out again.h5",
        "verify lab.h5",
    ],
)
def test_the_option_allows_it_and_the_import_is_announced(
    words: str, lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main([*words.split(), "--plugins"]) == 0
    said = "".join(capfd.readouterr())
    assert NEEDS not in said
    assert said.count(f"{IMPORTS}{lab / 'side.py'}), plug-in of tracker.kind") == 1
    assert imported(lab)


@pytest.mark.thorough
def test_a_scenario_of_the_caller_imports_what_it_names_and_quiet_commands_do_not_say_so(
    lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "lab.yaml", "--out", "again.h5"]) == 0
    assert IMPORTS in capfd.readouterr().err
    forget()
    assert main(["run", "lab.yaml", "--out", "again.h5", "--quiet"]) == 0
    assert IMPORTS not in capfd.readouterr().err


def test_an_override_of_a_result_is_the_callers(lab: Path) -> None:
    assert main(["run", "lab.h5", "--set", "tracker.kind=side:Effect", "--out", "again.h5", "--quiet"]) == 0
    assert imported(lab)


@pytest.mark.thorough
def test_permission_reaches_the_workers_of_a_resumed_campaign(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["sweep", "lab.yaml", "--vary", "seed=1,2", "--out", "resumed", "--shard", "1/2", "--quiet"]
    assert main(words) == 0
    forget()
    capfd.readouterr()
    assert main(["sweep", "resumed", "--quiet"]) == 2
    assert NEEDS in capfd.readouterr().err
    assert main(["sweep", "resumed", "--quiet", "--plugins"]) == 0
    assert imported(lab)


@pytest.mark.thorough
def test_the_command_that_resumes_a_campaign_with_a_plugin_gives_the_permission(
    lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (next(Path("campaign").glob("*/r*.h5"))).write_bytes(b"damaged")
    assert main(["compare", "campaign", "--plugins", "--quiet"]) == 3
    assert "resume with: wsnsim sweep campaign --plugins\n" in capfd.readouterr().err


# a result that was changed, to get at what its scenario does not name


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of a shipped tracker."""
    out = tmp_path_factory.mktemp("honest") / "honest.h5"
    wsnsim.run(scenario.load("ungm_pf", ["duration=6 s"]), replicates=1, out=out)
    return out


@pytest.mark.thorough(fast=["a list"])
@pytest.mark.parametrize(
    "change",
    [
        lambda resolved: {"scenario/resolved_json": {"extends": "lab.yaml"}},
        lambda resolved: {"scenario/resolved_json": resolved | {"sensor": {"kind": "side:Effect"}}},
        lambda resolved: {"scenario/resolved_json": resolved | {"targets": [{"kind": "side:Effect"}]}},
        lambda resolved: {"scenario/resolved_json": resolved | {"workload": {"kind": "side:Effect"}}},
        lambda resolved: {"scenario/source_yaml": LAB},
        lambda resolved: {"provenance_json": {"overrides": ["tracker.kind=side:Effect"]}},
    ],
    ids=["extends", "another role", "a list", "workload", "source", "overrides"],
)
def test_no_text_of_a_result_is_a_way_around(change: Any, lab: Path, honest: Path) -> None:
    path = shutil.copy(honest, lab / "changed.h5")
    with h5py.File(path, "r+") as file:
        for name, content in change(json.loads(file["scenario/resolved_json"][()])).items():
            old = file[name][()].decode()
            del file[name]
            whole = {**json.loads(old), **content} if name == "provenance_json" else content
            file[name] = whole if isinstance(whole, str) else json.dumps(whole)
    for command in (["verify"], ["check"], ["run", "--out", "x.h5", "--quiet"]):
        main([*command, str(path)])
        assert not imported(lab), command
    error_bounds.found_bound(path, "in_range", plugins=False)  # what plot and report do
    assert not imported(lab)


# from Python


def test_python_imports_what_the_caller_names_and_of_a_result_only_what_is_installed(lab: Path) -> None:
    with pytest.raises(ScenarioError, match="needs plug-in side:Effect"):
        wsnsim.load(lab / "lab.h5")
    with pytest.raises(ScenarioError, match="plugins=True"):
        wsnsim.run("lab.h5", out=lab / "again.h5")
    with pytest.raises(ScenarioError):
        wsnsim.experiment.simulate_run("lab.h5")
    assert not imported(lab)
    assert wsnsim.load("lab.h5", plugins=True).tracker.kind == "side:Effect"
    assert imported(lab)
    assert wsnsim.load({"extends": "lab.yaml"}).tracker.kind == "side:Effect"


ENTRY_POINTS = "[wsnsim.trackers]\neffect = side:Effect\n"


def test_kinds_of_installed_packages_are_imported_from_a_result_but_not_to_show_it(
    lab: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    info = tmp_path / "sidelab-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: sidelab\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    (tmp_path / "side.py").write_text(SIDE)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    registry._installed.cache_clear()
    try:
        named = {**scenario.resolved(scenario.load("ungm_pf")), "tracker": {"kind": "effect"}}
        with pytest.raises(ScenarioError, match="needs plug-in effect; --plugins allows it"):
            scenario.load(named, plugins=Plugins.NONE)
        assert not (tmp_path / "imported").exists()
        assert scenario.load(named, plugins=Plugins.INSTALLED).tracker.kind == "effect"
        assert (tmp_path / "imported").exists()
    finally:
        registry._installed.cache_clear()


def test_a_package_in_a_searched_folder_is_not_installed(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "sidelab-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: sidelab\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.chdir(tmp_path)
    registry.search([""])
    registry._installed.cache_clear()
    try:
        assert "effect" not in registry.kinds("tracker")
    finally:
        registry._installed.cache_clear()


# where a plug-in is found


def test_a_plugin_stands_beside_the_scenario_and_the_message_says_where_it_was_looked_for(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert scenario.load(lab / "lab.yaml").tracker.kind == "side:Effect"
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "lost.yaml").write_text(LAB.replace("side:", "nowhere:"))
    assert main(["run", "sub/lost.yaml"]) == 2
    beside = f"beside the scenario ({tmp_path / 'sub'}), in the working directory or on Python's path"
    assert f"nowhere:Effect: there is no module 'nowhere' {beside}" in capfd.readouterr().err


def test_another_module_of_the_same_name_does_not_stand_in_for_the_plugin(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario.load(lab / "lab.yaml")
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "side.py").write_text(SIDE)
    with pytest.raises(ScenarioError, match=r"not .*side.py beside the scenario: rename the latter"):
        scenario.load(tmp_path / "lab.yaml")
    monkeypatch.chdir(tmp_path)
    assert scenario.load(scenario.resolved(scenario.load(lab / "lab.yaml"))).tracker.kind == "side:Effect"


@pytest.mark.thorough(fast=["os:path"])
@pytest.mark.parametrize(
    "kind",
    [":", "side:", ":Effect", "..:X", ".side:X", "../side:X", "a" * 5000 + ":X", "\0:X", "os:path", "side:no", "é:X"],
)
def test_a_name_that_no_plugin_has_is_a_finding(kind: str, lab: Path) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario.load({"extends": "lab.yaml", "tracker": {"kind": kind}})
    assert len(refused.value.issues) == 1
    with pytest.raises(ScenarioError, match="needs plug-in"):
        scenario.load({"extends": "ungm_pf", "tracker": {"kind": kind}}, plugins=Plugins.NONE)


# check


@pytest.mark.thorough
def test_check_survives_a_plugin_that_exits_or_hangs(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (lab / "exits.py").write_text("import os\nos._exit(0)\n")
    (lab / "hangs.py").write_text("import time\ntime.sleep(3600)\n")
    for name in ("exits", "hangs"):
        (lab / f"{name}.yaml").write_text(LAB.replace("side:", f"{name}:"))
    assert main(["check", "exits.yaml", "hangs.yaml", "--timeout", "0.5"]) == 2
    said = capfd.readouterr()
    assert "exits.yaml: error: plug-in exits:Effect ended the process that checked it (exit code 0)\n" in said.err
    assert "hangs.yaml: error: plug-in hangs:Effect gave no answer within 0.5 s (--timeout)\n" in said.err
    assert said.err.count("wsnsim: imports ") == 2
    assert not {"exits", "hangs"} & set(sys.modules)


STUDY = """
source: Mine
experiments:
  - name: few
    title: one variant
    variants: {pf: ungm_pf}
    runs: {quick: 1, full: 1}
    sets: [duration=3 s]
    claims: [{of: pf, quantity: steps, measure: "mean:own"}]
"""
STUDY_CODE = """
from pathlib import Path

with (Path(__file__).parents[1] / "imported").open("a") as marker:
    marker.write("once ")

MEASURES = {"own": lambda data, variant: data.of_runs(variant, "steps")}
"""


def test_the_code_of_a_study_is_imported_by_the_command_that_names_its_folder_and_by_no_other(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("wsnsim.papers.reproduce.LocalEngine", InlineEngine)
    Path("mine").mkdir()
    Path("mine/study.yaml").write_text(STUDY)
    Path("mine/study.py").write_text(STUDY_CODE)
    for words in ("check mine/study.yaml", "info mine/study.yaml", "run mine/study.yaml", "list scenarios"):
        main(words.split())
        assert not imported(lab), words
    assert main(["reproduce", "mine", "--quiet", "--json"]) == 0
    assert Path("imported").read_text() == "once " and '"measured": 2.0' in capsys.readouterr().out
