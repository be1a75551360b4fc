"""A campaign on a disk that fails as network file systems do: nothing is lost or counted twice, and it can be resumed.

The faults are injected into the calls that touch the disk: renames that are refused, stale handles, and listings that
show fewer files than there are, or show them late.
"""

from __future__ import annotations

import errno
import os
import random
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from wsnsim.base.errors import ResultError, StorageError
from wsnsim.campaign import CampaignOutcome, prepare, run_campaign
from wsnsim.recording import atomic_files
from wsnsim.recording.folder import Folder
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import assert_same, files_of, tables_of
from .inline_engine import InlineEngine

RUNS = 6
SESSIONS = 60
"""Sessions after which a campaign on a failing disk is complete for certain."""


def begun(place: Path, replicates: int = RUNS) -> Folder:
    short = {"scenario": "ungm_pf", "set": {"duration": "3 s"}, "grid": {"tracker.particles": [20, 30]}}
    return prepare(load_sweep({**short, "replicates": replicates, "block": 2, "name": "c"}), place)


def run(folder: Folder) -> CampaignOutcome:
    return run_campaign(folder, InlineEngine())


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The tables of a campaign on a disk that works."""
    folder = begun(tmp_path_factory.mktemp("truth") / "c")
    assert run(folder).complete
    return tables_of(folder.path)


@pytest.fixture
def faults(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """faults(owner, name, number, share, seed): that call fails with this error number, in a share of all cases."""
    patches = pytest.MonkeyPatch()

    def inject(owner: Any, name: str, number: int, share: float, seed: int) -> None:
        chance, whole = random.Random(seed), getattr(owner, name)

        def failing(*arguments: Any, **named: Any) -> Any:
            if chance.random() < share:
                raise OSError(number, os.strerror(number))
            return whole(*arguments, **named)

        patches.setattr(owner, name, failing)

    inject.undo = patches.undo  # type: ignore[attr-defined]
    yield inject
    patches.undo()


def assert_whole(folder: Folder, truth: Any) -> None:
    """Every run is there once, with the bits of the disk that works, and nothing else was left."""
    assert run(folder).complete
    assert_same(tables_of(folder.path), truth)
    left = [*folder.path.rglob("*.tmp"), *folder.path.glob("running/*")]
    assert [place for place in left if str(os.getpid()) not in place.name] == [], "those of the living stay"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("owner", "name", "number"),
    [
        (Path, "replace", errno.EACCES),
        (Path, "replace", errno.ESTALE),
        (os, "fsync", errno.ESTALE),
        (os, "fsync", errno.EIO),
        (Path, "unlink", errno.ESTALE),
        (Path, "iterdir", errno.ESTALE),
        (Path, "mkdir", errno.ESTALE),
    ],
)
def test_calls_that_fail_now_and_then_end_sessions_and_lose_nothing(
    tmp_path: Path, truth: Any, faults: Any, owner: Any, name: str, number: int
) -> None:
    folder = begun(tmp_path / "c")
    faults(owner, name, number, 0.3, 7)
    complete = False
    for _ in range(SESSIONS):
        before = files_of(folder.path)
        try:
            ended = run(folder)
        except (StorageError, ResultError):
            continue
        assert before.items() <= files_of(folder.path).items(), "no finished file is written again"
        complete = ended.complete
        if complete:
            break
        assert ended.stopped or ended.failed
    assert complete
    faults.undo()
    assert_whole(folder, truth)


@pytest.mark.parametrize("number", [errno.ESTALE, errno.EIO])
def test_a_manifest_that_cannot_be_read_is_one_sentence(tmp_path: Path, faults: Any, number: int) -> None:
    folder = begun(tmp_path / "c")
    faults(Path, "open", number, 1.0, 0)
    with pytest.raises(ResultError, match=r"campaign\.json: cannot be read: \w"):
        folder.manifest()


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_listings_that_lack_files_cost_work_and_double_nothing(
    tmp_path: Path, truth: Any, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, chance, whole = begun(tmp_path / "c", 3), random.Random(seed), Path.iterdir
    run(folder)
    folder = begun(tmp_path / "c")  # blocks of two: the third run has a file of its own
    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", lambda path: (one for one in whole(path) if chance.random() < 0.5))
        for _ in range(4):
            run(folder)
    assert_whole(folder, truth)


class Late:
    """Answers of a disk as they were some calls before, as from the cache of a network file system; then of nothing."""

    def __init__(self, calls: int) -> None:
        self._calls = calls
        self._answers: dict[Any, deque[Any]] = {}

    def __call__(self, key: Any, answer: Any, nothing: Any) -> Any:
        """The answer to this question some calls ago."""
        answers = self._answers.setdefault(key, deque([nothing] * self._calls))
        answers.append(answer)
        return answers.popleft()


@pytest.mark.thorough
@pytest.mark.parametrize("calls", [1, 2, 7])
def test_listings_that_show_files_late_and_removed_ones_still_cost_sessions_only(
    tmp_path: Path, truth: Any, calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, late, iterdir, glob = begun(tmp_path / "c"), Late(calls), Path.iterdir, Path.glob
    sessions = 0
    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", lambda path: iter(late(path, [*iterdir(path)], [])))
        patch.setattr(Path, "glob", lambda path, *what: iter(late((path, *what), [*glob(path, *what)], [])))
        complete = False
        while not complete and sessions < SESSIONS:
            before = files_of_disk(folder, glob)
            complete = run(folder).complete
            sessions += 1
            assert before.items() <= files_of_disk(folder, glob).items(), "no finished file is written again"
    assert complete and sessions > 1, "what was not shown was not there: the session ended incomplete"
    assert_whole(folder, truth)


def files_of_disk(folder: Folder, glob: Any) -> dict[str, int]:
    """The time of modification of every result file, whatever listings say."""
    return {str(place): place.stat().st_mtime_ns for place in glob(folder.path, "*/r*.h5")}


@pytest.mark.thorough
def test_a_file_whose_existence_is_known_late_is_replaced_by_the_same_rows(
    tmp_path: Path, truth: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, late, iterdir, is_file = begun(tmp_path / "c"), Late(1), Path.iterdir, Path.is_file
    assert run(folder).complete
    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", lambda path: iter(late(path, [*iterdir(path)], [])))
        patch.setattr(
            Path, "is_file", lambda path: late(path, is_file(path), False) if path.suffix == ".h5" else is_file(path)
        )
        assert run(folder).done == 2 * RUNS, "it could not know that they were there"
    assert_whole(folder, truth)


@pytest.mark.thorough
@pytest.mark.parametrize("listing", range(4))
def test_while_a_slow_listing_is_made_another_session_may_finish_everything(
    tmp_path: Path, truth: Any, listing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The names are those of before; when they are known, each file is there."""
    folder, iterdir = begun(tmp_path / "c"), Path.iterdir
    lists, files = 0, dict[str, int]()

    def slow(path: Path) -> Iterator[Path]:
        nonlocal lists, files
        names = [*iterdir(path)]
        lists += 1
        if lists == listing + 1:
            assert run(folder).complete
            files = files_of_disk(folder, Path.glob)
        return iter(names)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", slow)
        assert run(folder).complete and files
    assert files_of_disk(folder, Path.glob) == files, "what the other session has written stays"
    assert_whole(folder, truth)


def test_a_refused_rename_leaves_the_former_file(tmp_path: Path, faults: Any) -> None:
    place = tmp_path / "x.json"
    atomic_files.write_text_atomically(place, "before")
    faults(Path, "replace", errno.EACCES, 1.0, 0)
    with pytest.raises(StorageError, match=r"x\.json: cannot be written: Permission denied"):
        atomic_files.write_text_atomically(place, "after")
    assert place.read_text() == "before" and list(tmp_path.iterdir()) == [place]
