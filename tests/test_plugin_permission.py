"""Who may import a plug-in: reading commands never do, others by the origin of its name."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import pytest

import wsnsim
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.campaign import task
from wsnsim.cli import main
from wsnsim.cli.shared import group
from wsnsim.scenario import Plugins, registry, schema

SIDE = '''
from pathlib import Path

from wsnsim import part
from wsnsim.trackers.sir import Sir

with (Path(__file__).parent / "imported").open("a") as marker:
    marker.write("once ")


@part
class Effect(Sir):
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
    schema.part_model.cache_clear()
    task._scenario.cache_clear()


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
        assert main(["sweep", lab, "--vary", "seed=1,2", "--out", "campaign", "-j", "1", "--quiet"]) == 0
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


READING = {
    "collect": ["campaign"],
    "compare": ["campaign"],
    "diff": ["lab.h5", "lab.h5"],
    "export": ["lab.h5", "--parquet", "parquet"],
    "info": ["lab.h5"],
    "plot": ["lab.h5", "--out", "lab.png"],
    "report": ["lab.h5", "--out", "lab.html"],
    "trace": ["lab.h5", "--step", "1"],
    "recover": ["lab.h5", "--out", "recovered.h5"],
    "check": ["lab.h5"],
    "run": ["lab.h5", "--out", "again.h5"],
    "verify": ["lab.h5"],
    "sweep": ["campaign"],
    "list": ["trackers"],
    "schema": [],
    "new": ["fresh"],
    "reproduce": ["nobody"],
}


@pytest.mark.parametrize("command", sorted(group.commands))
def test_no_command_imports_what_a_file_of_others_names(
    command: str, lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    main([command, *READING[command]])
    said = "".join(capfd.readouterr())
    assert not imported(lab)
    assert str(lab) not in sys.path
    assert "internal error" not in said and "Traceback" not in said and IMPORTS not in said


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("plot lab.h5 --out lab.png", 0),
        ("report lab.h5 --out lab.html", 0),
        ("info lab.yaml", 2),
        ("check lab.h5", 2),
        ("run lab.h5 --out again.h5", 2),
        ("verify lab.h5", 2),
        ("compare campaign", 0),
    ],
)
def test_what_needs_a_plugin_says_so(words: str, code: int, lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(words.split()) == code
    assert NEEDS in "".join(capfd.readouterr())
    assert not imported(lab)


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


def test_permission_reaches_the_workers_of_a_resumed_campaign(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["sweep", "lab.yaml", "--vary", "seed=1,2", "--out", "resumed", "-j", "1", "--shard", "1/2", "--quiet"]
    assert main(words) == 0
    forget()
    capfd.readouterr()
    assert main(["sweep", "resumed", "-j", "1", "--quiet"]) == 2
    assert NEEDS in capfd.readouterr().err
    assert main(["sweep", "resumed", "-j", "1", "--quiet", "--plugins"]) == 0
    assert imported(lab)


def test_the_command_that_resumes_a_campaign_with_a_plugin_gives_the_permission(
    lab: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (next(Path("campaign").glob("*/r*.h5"))).write_bytes(b"damaged")
    assert main(["compare", "campaign", "--plugins", "-j", "1", "--quiet"]) == 3
    assert "resume with: wsnsim sweep campaign --plugins\n" in capfd.readouterr().err


# a result that was changed, to get at what its scenario does not name


def changed(path: Path, change: Any) -> str:
    """A copy of a result of a shipped tracker with other texts."""
    out = path / "changed.h5"
    wsnsim.run(scenario.load("ungm_pf", ["duration=6 s"]), replicates=1, out=out)
    with h5py.File(out, "r+") as file:
        for name, text in change(json.loads(file["scenario/resolved_json"][()])).items():
            old = file[name][()].decode()
            del file[name]
            file[name] = text if isinstance(text, str) else json.dumps(json.loads(old) | text)
    return str(out)


@pytest.mark.parametrize("command", ["verify", "check", "plot", "report", "run"])
@pytest.mark.parametrize(
    "change",
    [
        lambda resolved: {"scenario/resolved_json": json.dumps({"extends": "lab.yaml"})},
        lambda resolved: {"scenario/resolved_json": json.dumps(resolved | {"sensor": {"kind": "side:Effect"}})},
        lambda resolved: {"scenario/resolved_json": json.dumps(resolved | {"targets": [{"kind": "side:Effect"}]})},
        lambda resolved: {"scenario/resolved_json": json.dumps(resolved | {"workload": {"kind": "side:Effect"}})},
        lambda resolved: {"scenario/source_yaml": LAB},
        lambda resolved: {"provenance_json": {"overrides": ["tracker.kind=side:Effect"]}},
    ],
    ids=["extends", "another role", "a list", "workload", "source", "overrides"],
)
def test_no_text_of_a_result_is_a_way_around(command: str, change: Any, lab: Path) -> None:
    path = changed(lab, change)
    words = {"verify": [], "check": [], "plot": ["--out", "x.png"], "report": ["--out", "x.html"]}
    main([command, path, *words.get(command, ["--out", "x.h5", "--quiet"])])
    assert not imported(lab)


# from Python


def test_python_imports_what_the_caller_names_and_of_a_result_only_what_is_installed(lab: Path) -> None:
    with pytest.raises(ScenarioError, match="needs plug-in side:Effect"):
        wsnsim.load(lab / "lab.h5")
    with pytest.raises(ScenarioError, match="plugins=True"):
        wsnsim.run("lab.h5", out=lab / "again.h5")
    with pytest.raises(ScenarioError):
        wsnsim.simulate("lab.h5")
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


def test_another_module_of_the_same_name_does_not_stand_in_for_the_plugin(lab: Path, tmp_path: Path) -> None:
    scenario.load(lab / "lab.yaml")
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "side.py").write_text(SIDE)
    with pytest.raises(ScenarioError, match=r"not .*side.py beside the scenario: rename the latter"):
        scenario.load(tmp_path / "lab.yaml")


# check


def test_check_survives_a_plugin_that_exits_or_hangs(lab: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (lab / "exits.py").write_text("import os\nos._exit(0)\n")
    (lab / "hangs.py").write_text("import time\ntime.sleep(3600)\n")
    for name in ("exits", "hangs"):
        (lab / f"{name}.yaml").write_text(LAB.replace("side:", f"{name}:"))
    assert main(["check", "exits.yaml", "hangs.yaml", "lab.yaml", "--timeout", "0.5"]) == 2
    said = capfd.readouterr()
    assert "exits.yaml: error: plug-in exits:Effect ended the process that checked it (exit code 0)\n" in said.err
    assert "hangs.yaml: error: plug-in hangs:Effect gave no answer within 0.5 s (--timeout)\n" in said.err
    assert said.err.count(IMPORTS) == 1
    assert "side" not in sys.modules
