"""Results of different code are not mixed: a changed tracker of ours or of a plug-in is named, refused, or noted."""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import wsnsim
from wsnsim.base.errors import UsageError
from wsnsim.campaign import code_changes, collect, engines, prepare, run_campaign
from wsnsim.campaign import task as tasks
from wsnsim.campaign.code_changes import changed_files
from wsnsim.cli import main
from wsnsim.papers import reproduce
from wsnsim.recording.folder import Folder
from wsnsim.scenario.registry import Plugins, access
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import files_of
from .inline_engine import InlineEngine
from .moody_tracker import sweep_of, write_sweep

RESULTS = Path("results/moods")
FLAG = "--accept-code-change"


@pytest.fixture(autouse=True)
def _inline(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "LocalEngine", InlineEngine)
    tasks._demand_code.cache_clear()


@pytest.fixture
def begun(lab: Path) -> str:
    """A sweep whose campaign is complete, with two runs."""
    (lab / "helper.py").write_text("")
    with (lab / "moody.py").open("a") as file:
        file.write("\nimport helper\n")
    sweep = write_sweep(lab / "moods.yaml", sweep_of([{"pause": 0.0}], 2))
    assert main(["sweep", sweep, "-q"]) == 0
    return sweep


def change(name: str) -> None:
    with Path(name).open("a") as file:
        file.write("# changed\n")
    tasks._demand_code.cache_clear()


def own_change(monkeypatch: pytest.MonkeyPatch, name: str = "wsnsim/trackers/ekf.py") -> None:
    """Pretend that a file of wsnsim has changed."""
    changed = {**code_changes.package_digests(), name: "0"}
    monkeypatch.setattr(code_changes, "package_digests", lambda: changed)
    tasks._demand_code.cache_clear()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["moody.py", "helper.py", "wsnsim/trackers/ekf.py"])
def test_a_changed_tracker_is_refused_and_named(
    begun: str, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_of(RESULTS)
    if name.startswith("wsnsim"):
        own_change(monkeypatch, name)
    else:
        change(name)
    for more in ([], ["--replicates", "4"]):
        capsys.readouterr()
        assert main(["sweep", begun, *more, "-q"]) == 2
        said = capsys.readouterr().err
        assert f"results/moods: its runs were made by other code; changed since: {name}: " in said
        assert FLAG in said and said.count("\n") == 1
    assert files_of(RESULTS) == before


def test_an_accepted_change_is_noted_with_the_runs_of_each_code(begun: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = files_of(RESULTS)
    change("moody.py")
    assert main(["sweep", begun, "--replicates", "6", FLAG, "-q"]) == 0
    assert before.items() < files_of(RESULTS).items()
    text = capsys.readouterr().out
    assert "code         accepted changes; runs: 2 by code " in text and ": moody.py" in text
    assert main(["sweep", begun, "--replicates", "6", "-q"]) == 0, "it is accepted once"
    for command in (["info", str(RESULTS)], ["compare", str(RESULTS), "--plugins", "-q"], ["collect", str(RESULTS)]):
        capsys.readouterr()
        assert main([*command, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        (noted,) = said["code_changes"]
        assert noted["changed"] == ["moody.py"]
        assert said["runs_by_code"] == {noted["before"]: 2, noted["after"]: 4}
    assert main(["info", str(RESULTS)]) == 0
    assert f"2 by code {noted['before']}, 4 by code {noted['after']}" in capsys.readouterr().out


def test_a_campaign_without_runs_has_no_code_to_keep_to(lab: Path) -> None:
    plan = load_sweep(sweep_of([{"pause": 0.0}], 2))
    prepare(plan, "c")
    change("moody.py")
    manifest = prepare(plan, "c").manifest()
    assert manifest.code_changes == () and manifest.code["moody"]["moody.py"]


def test_a_complete_campaign_is_shown_and_an_incomplete_one_is_not_resumed_from_its_folder(
    begun: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change("helper.py")
    capsys.readouterr()
    assert main(["sweep", str(RESULTS), "--plugins"]) == 0
    assert "results/moods is complete and only shown: its runs were made by other code" in capsys.readouterr().err
    next(RESULTS.glob("*/*.h5")).unlink()
    point = next(path.parent for path in RESULTS.glob("*/scenario.json"))
    (point / "r00000-00000.h5").write_bytes(b"")
    assert main(["sweep", str(RESULTS), "--plugins", "-q"]) == 2
    assert "changed since: helper.py" in capsys.readouterr().err
    (point / "r00000-00000.h5").unlink()
    assert main(["sweep", str(RESULTS), "--plugins", "-q"]) == 0, "no run is there"


@pytest.mark.thorough
def test_shards_of_different_code_are_not_merged(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep = write_sweep(lab / "moods.yaml", sweep_of([{"pause": 0.0}], 4))
    for shard in ("1", "2"):
        assert main(["sweep", sweep, "--shard", f"{shard}/2", "-o", shard, "-q"]) == 0
        change("moody.py")
    capsys.readouterr()
    assert main(["collect", "1", "2", "-o", "all"]) == 2
    assert "other code than those of the other folders (moody.py)" in capsys.readouterr().err
    assert not Path("all").exists()
    for _ in range(2):
        assert main(["collect", "1", "2", "-o", "all", FLAG, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert sorted(said["runs_by_code"].values()) == [2, 2] and len(said["code_changes"]) == 1


def test_a_worker_with_other_code_than_the_campaign_runs_nothing(lab: Path) -> None:
    folder = prepare(load_sweep(sweep_of([{"pause": 0.0}], 2)), "c")
    change("moody.py")
    ended = run_campaign(folder, InlineEngine(), access=access(Plugins.ANY))
    assert ended.stopped == ("the code of a worker differs from that with which the campaign was started: moody.py")
    assert not files_of(Path("c")) and not ended.failed


def test_from_python_a_change_is_refused_and_accepted(begun: str) -> None:
    change("moody.py")
    with pytest.raises(UsageError, match=r"accept_code_change=True"):
        wsnsim.sweep(begun, out=RESULTS)
    assert wsnsim.sweep(begun, out=RESULTS, accept_code_change=True).complete


@pytest.mark.thorough
def test_a_reproduction_is_refused_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paper, experiment = reproduce.chosen(["wei2022"])[0]
    folder = reproduce.begin(paper, experiment, tmp_path)
    folder.batch(folder.manifest().points[0].id, 0, 0).touch()
    own_change(monkeypatch)
    with pytest.raises(UsageError, match=r"changed since: wsnsim/trackers/ekf.py"):
        reproduce.begin(paper, experiment, tmp_path)
    begun = reproduce.begin(paper, experiment, tmp_path, accept_code_change=True).manifest()
    assert begun.code_changes[0]["changed"] == ["wsnsim/trackers/ekf.py"]


def test_differing_files_are_named_plugins_first_with_what_is_new_and_gone() -> None:
    before: Any = {"wsnsim": {"wsnsim/a.py": "1", "wsnsim/b.py": "1"}, "lab": {"lab.py": "1", "old.py": "1"}}
    after: Any = {"wsnsim": {"wsnsim/a.py": "2", "wsnsim/b.py": "1"}, "lab": {"lab.py": "1", "new.py": "1"}}
    assert changed_files(before, after) == ["new.py (new)", "old.py (gone)", "wsnsim/a.py"]
    assert changed_files(before, before) == []


@pytest.mark.thorough
def test_merged_folders_keep_the_changes_of_their_shards(begun: str) -> None:
    change("moody.py")
    assert main(["sweep", begun, FLAG, "-q"]) == 0
    manifest = collect([Folder(RESULTS)], Folder("all"))
    assert [noted["changed"] for noted in manifest.code_changes] == [["moody.py"]]


WRITING = os.O_CREAT | os.O_WRONLY | os.O_RDWR


def on_a_read_only_disk(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Refuse whatever would change the folder; the user of a test may be one whom no permissions bind."""

    def refusing(function: Callable[..., Any], writes: Callable[..., bool]) -> Callable[..., Any]:
        def called(place: Any, *others: Any, **given: Any) -> Any:
            inside = isinstance(place, str | os.PathLike) and Path(place).resolve().is_relative_to(folder.resolve())
            if inside and writes(*others, **given):
                raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(place))
            return function(place, *others, **given)

        return called

    monkeypatch.setattr(os, "open", refusing(os.open, lambda flags, *_, **__: bool(flags & WRITING)))
    monkeypatch.setattr(io, "open", refusing(io.open, lambda mode="r", *_, **__: bool(set(mode) & set("wax+"))))
    for name in ("mkdir", "unlink", "replace", "rename", "rmdir"):
        monkeypatch.setattr(os, name, refusing(getattr(os, name), lambda *_, **__: True))


def test_a_complete_campaign_is_shown_from_a_read_only_folder(
    begun: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    with monkeypatch.context() as patched:
        on_a_read_only_disk(patched, RESULTS)
        assert main(["sweep", str(RESULTS), "--plugins", "-q"]) == 0
        shown = capsys.readouterr()
    assert shown.out and not shown.err
    assert main(["sweep", str(RESULTS), "--plugins", "-q"]) == 0 and capsys.readouterr().out == shown.out
    next(RESULTS.glob("*/*.h5")).unlink()
    with monkeypatch.context() as patched:
        on_a_read_only_disk(patched, RESULTS)
        assert main(["sweep", str(RESULTS), "--plugins", "-q"]) == 2
        assert "cannot write" in capsys.readouterr().err
