"""A campaign on disk: complete files, removed leftovers, and refused folders."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from wsnsim.base.errors import ResultError, StorageError, UsageError
from wsnsim.campaign import collect, prepare, reopen, run_campaign
from wsnsim.cli import main
from wsnsim.recording.folder import Folder
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import bare_campaign, files_of
from .test_runner import Pool


def dead_pid() -> int:
    """The process id of an ended process."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def plan(**said: Any) -> Any:
    return load_sweep({"scenario": "ungm_pf", "grid": {"tracker.particles": [20, 40]}, "replicates": 3, **said})


# what is stored


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{"extends": "../secret.yaml"}', "extends another file, which no scenario of a campaign does"),
        (b"[1]", "is damaged: it is no scenario"),
        (b"{", "is damaged: it is not JSON"),
        (b"[" * 100_000, "is damaged: it is not JSON"),
        (b"\xff", "is damaged: it is not UTF-8"),
    ],
)
def test_a_stored_scenario_that_no_campaign_writes_is_refused_with_its_name(
    tmp_path: Path, text: bytes, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = prepare(plan(name="c"), tmp_path / "c")
    point = folder.manifest().points[0].id
    place = tmp_path / "c" / point / "scenario.json"
    place.write_bytes(text)
    with pytest.raises(ResultError) as caught:
        folder.scenario(point)
    assert str(caught.value) == f"{place}: {said}"
    assert main(["sweep", str(tmp_path / "c"), "-q"]) == 1
    assert capsys.readouterr().err == f"wsnsim: error: {place}: {said}\n"


# what is done


def test_only_a_file_with_its_final_name_counts(tmp_path: Path) -> None:
    folder = bare_campaign(tmp_path, {"a": 12})
    (tmp_path / "a").mkdir()
    for name in ("r00000-00004.h5", "r00007-00007.h5", "r00005-00006.here.1.tmp", "r1-2.h5", "notes.txt"):
        (tmp_path / "a" / name).touch()
    assert folder.done("a") == {0, 1, 2, 3, 4, 7}
    assert folder.missing("a", 9) == [5, 6, 8]
    assert folder.done("b") == set()


def test_what_the_dead_left_is_removed_and_what_the_living_and_others_write_is_not(tmp_path: Path) -> None:
    folder = bare_campaign(tmp_path, {"a": 1})
    mark = folder.marker("s", "a.r00000-00000")
    host, own, dead = mark.name.split(".")[-3], os.getpid(), dead_pid()
    kept = [f"a/r0.{host}.{own}.tmp", f"a/r0.another.{dead}.tmp", "a/own.tmp", f"running/s.a.{host}.{own}.log"]
    gone = [f"a/r0.{host}.{dead}.tmp", f"a/r0.{host}.{dead}-1.tmp", f"campaign.json.{host}.{dead}.tmp"]
    gone.append(f"running/s.a.{host}.{dead}.log")
    for name in (*kept, *gone):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    folder.remove_leftovers()
    assert [name for name in (*kept, *gone) if (tmp_path / name).exists()] == kept


def test_files_of_other_machines_are_removed_when_they_were_not_written_for_a_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the clock of the disk, whatever the clock of this machine says."""
    folder = bare_campaign(tmp_path, {"a": 3})
    (tmp_path / "running").mkdir()
    names = (
        "campaign.json.elsewhere.7-1.tmp",
        "a/r00000-00001.elsewhere.7.tmp",
        "running/s.a.r00000-00001.other.8.log",
    )
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    written = (tmp_path / names[0]).stat().st_mtime
    for hours, left in ((23, 3), (25, 0)):
        monkeypatch.setattr("wsnsim.recording.atomic_files._time_of_disk", lambda folder, h=hours: written + 3600.0 * h)
        folder.remove_leftovers()
        assert sum((tmp_path / name).exists() for name in names) == left
    monkeypatch.undo()
    old = tmp_path / names[2]
    old.touch()
    os.utime(old, (1.0, 1.0))
    monkeypatch.setattr("time.time", lambda: 0.0)
    folder.remove_leftovers()
    assert not old.exists() and not list(tmp_path.glob("tmp*"))


def test_a_manifest_comes_back_as_it_was_written(tmp_path: Path) -> None:
    folder = prepare(plan(), tmp_path / "c", by=["tracker.particles"], baseline="20")
    manifest = folder.manifest()
    assert (manifest.keys, manifest.by, manifest.baseline) == (("tracker.particles",), ("tracker.particles",), "20")
    assert [dict(point.settings) for point in manifest.points] == [{"tracker.particles": 20}, {"tracker.particles": 40}]
    assert reopen(tmp_path / "c").manifest() == manifest


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        '"x"',
        "null",
        '{"schema_version": 2}',
        '{"schema_version": "1", "points": []}',
        "\udcff",
        "ZERO",
    ],
)
def test_a_damaged_manifest_is_named_as_such(tmp_path: Path, text: str) -> None:
    folder = bare_campaign(tmp_path, {"a": 1})
    place = tmp_path / "campaign.json"
    if text == "ZERO":
        text = place.read_text().replace('"block": 5', '"block": 0')
    place.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ResultError, match=r"campaign.json: is damaged: ."):
        folder.manifest()


@pytest.mark.parametrize(("schema", "age"), [(1, "an older"), (99, "a newer")])
def test_a_campaign_of_another_version_is_refused_in_one_sentence(tmp_path: Path, schema: int, age: str) -> None:
    folder = bare_campaign(tmp_path, {"a": 1})
    said = json.loads((tmp_path / "campaign.json").read_text()) | {"schema_version": schema, "wsnsim_version": "9.9"}
    (tmp_path / "campaign.json").write_text(json.dumps(said))
    with pytest.raises(
        ResultError,
        match=rf"written by {age} wsnsim \(9\.9\), whose files .* does not read: use that version, or make .*$",
    ):
        folder.manifest()


def test_what_cannot_be_put_in_place_leaves_nothing_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = bare_campaign(tmp_path, {"a": 1})
    before = (tmp_path / "campaign.json").read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match=r"campaign.json: cannot be written: No space left on device"):
        folder.write_manifest(folder.manifest())
    folder.write_failure("a.r00000-00000", "there is no room for this")
    assert (tmp_path / "campaign.json").read_bytes() == before
    assert [place.name for place in tmp_path.rglob("*") if place.is_file()] == ["campaign.json"]


# where a campaign may be


def test_a_campaign_killed_before_it_had_a_manifest_is_begun_anew(tmp_path: Path) -> None:
    folder = prepare(plan(), tmp_path / "c")
    (tmp_path / "c" / "campaign.json").unlink()
    (tmp_path / "c" / f"campaign.json.host.{dead_pid()}.tmp").touch()
    assert prepare(plan(), tmp_path / "c").manifest().points == folder.manifest().points


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "file").touch()
    for place, words in ((tmp_path, "is not empty and holds no campaign"), (tmp_path / "file", "is a file")):
        with pytest.raises(UsageError, match=words):
            prepare(plan(), place)
        with pytest.raises(UsageError, match=words):
            collect([prepare(plan(), tmp_path / "part")], Folder(place))
    assert sorted(place.name for place in tmp_path.iterdir()) == ["file", "part", "thesis.tex"]


def test_another_campaigns_folder_is_refused(tmp_path: Path) -> None:
    prepare(plan(name="one"), tmp_path / "c")
    with pytest.raises(UsageError, match="holds the campaign 'one', not 'two'; give another folder"):
        prepare(plan(name="two"), tmp_path / "c")


def test_results_of_another_version_are_not_mixed(tmp_path: Path) -> None:
    prepare(plan(), tmp_path)
    place = tmp_path / "campaign.json"
    place.write_text(place.read_text().replace('"wsnsim_version": "', '"wsnsim_version": "9'))
    for again in (lambda: prepare(plan(), tmp_path), lambda: reopen(tmp_path)):
        with pytest.raises(UsageError, match=r"was started with wsnsim 9.*are not mixed"):
            again()


def test_an_empty_folder_holds_no_campaign(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="holds no campaign"):
        reopen(tmp_path)


# a block keeps its size, and parts come together


def test_the_size_of_a_block_stays_that_of_the_first_session(tmp_path: Path) -> None:
    prepare(plan(block=2), tmp_path)
    assert prepare(plan(block=7), tmp_path).manifest().block == 2


def test_parts_are_collected_once_and_what_is_there_stays(tmp_path: Path) -> None:
    parts = [prepare(plan(replicates=8, block=2), tmp_path / name) for name in ("one", "two")]
    points = [point.id for point in parts[0].manifest().points]
    for part, numbers in zip(parts, [(0, 2), (2, 4, 6)], strict=True):
        for first in numbers:
            part.batch(points[0], first, first + 1).write_text(part.path.name)
    into = Folder(tmp_path / "all")
    collect(parts, into)
    collect(parts, into)
    assert {name: text for name, (_, text) in files_of(into.path).items()} == {
        f"{points[0]}/r0000{first}-0000{first + 1}.h5": owner
        for first, owner in ((0, b"one"), (2, b"one"), (4, b"two"), (6, b"two"))
    }
    before = files_of(into.path)
    collect([parts[1]], into)
    assert files_of(into.path) == before and into.missing(points[1], 8) == list(range(8))


def test_parts_of_different_campaigns_are_not_brought_together(tmp_path: Path) -> None:
    one = prepare(plan(), tmp_path / "one")
    for name, other in (("block", plan(block=3)), ("points", plan(set={"duration": "9 s"})), ("name", plan(name="n"))):
        part = prepare(other, tmp_path / name)
        with pytest.raises(UsageError, match=f"another campaign: {name} differs"):
            collect([one, part], Folder(tmp_path / "all"))
    assert not (tmp_path / "all").exists()


def test_more_points_and_fewer_replicates_leave_what_is_there(tmp_path: Path) -> None:
    folder = prepare(plan(), tmp_path)
    run_campaign(folder, Pool(folder))
    before = files_of(tmp_path)
    folder = prepare(plan(replicates=1, grid={"tracker.particles": [10, 40, 20]}), tmp_path)
    pool = Pool(folder)
    run_campaign(folder, pool)
    assert len(pool.written) == 1 and before.items() <= files_of(tmp_path).items()


def test_runs_of_other_points_and_replicates_are_counted_as_outside_the_campaign(tmp_path: Path) -> None:
    folder = prepare(plan(), tmp_path)
    run_campaign(folder, Pool(folder))
    assert folder.outside_manifest(folder.manifest()) == 0
    for changed, outside in (({"replicates": 1}, 4), ({"grid": {"tracker.particles": [20]}}, 3)):
        folder = prepare(plan(**changed), tmp_path)
        assert folder.outside_manifest(folder.manifest()) == outside
