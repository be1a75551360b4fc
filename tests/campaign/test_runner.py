"""The decisions of the runner, with an engine that simulates nothing: any order of outcomes, deaths, shards, stops."""

from __future__ import annotations

import functools
import itertools
import os
import random
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given
from hypothesis import settings as tries
from hypothesis import strategies as st

from wsnsim.analysis import campaigns, statistics
from wsnsim.analysis.campaign_info import ReplicateCounts
from wsnsim.campaign import WHOLE, CampaignOutcome, CampaignProgress, Shard, run_campaign
from wsnsim.campaign.engines import EngineError, FinishedTask, WorkerLost
from wsnsim.campaign.runner import MAX_LOSSES
from wsnsim.campaign.task import Task, TaskOutcome, is_timeout
from wsnsim.recording.folder import Folder, consecutive

from .campaign_files import bare_campaign, files_of

Where = tuple[str, int]
MOODS = ("raises", "killed", "crashes", "hangs")
SAID = {"killed": "", "crashes": "Fatal Python error: Segmentation fault\n", "hangs": "Timeout (0:00:05)!\n"}


class Pool:
    """An engine whose workers write a file per task; a replicate with a mood fails its task, or kills all workers."""

    def __init__(self, folder: Folder, moods: Mapping[Where, str] = {}, workers: int = 2, seed: int = 0) -> None:
        self.folder, self.moods, self.workers = folder, moods, workers
        self.window = 2 * workers
        self.left_out: dict[str, str] = {}
        self.under_way: list[Task] = []
        self.written: Counter[Where] = Counter()
        self.deaths: Counter[str] = Counter()
        self.taken: list[str] = []
        self.closed = False
        self._random = random.Random(seed)

    def submit(self, task: Task) -> None:
        assert len(self.under_way) < self.window
        self.taken.append(task.name)
        self.under_way.append(task)

    def finished(self, timeout: float) -> list[FinishedTask]:
        begun = self.under_way[: self.workers]
        if not begun:
            return []
        task = self._random.choice(begun)
        mood = next((self.moods[at] for at in replicates_of(task) if at in self.moods), "")
        if mood in SAID:
            return self._die(begun, task, SAID[mood])
        self.under_way.remove(task)
        if mood:
            return [FinishedTask(task, TaskOutcome("failed", mood))]
        return [FinishedTask(task, self._write(task))]

    def _die(self, begun: list[Task], guilty: Task, words: str) -> list[FinishedTask]:
        """A worker dies, and the others with it; each leaves its marker."""
        self.deaths[guilty.name] += 1
        for task in begun:
            mark = self.folder.marker(task.session, task.name)
            mark.parent.mkdir(exist_ok=True)
            mark.write_text(words if task is guilty else "")
        everyone, self.under_way = self.under_way, []
        self._random.shuffle(everyone)
        return [FinishedTask(task, WorkerLost("a process died")) for task in everyone]

    def _write(self, task: Task) -> TaskOutcome:
        place = self.folder.batch(task.point, task.first, task.last)
        if place.exists():
            return TaskOutcome("exists")
        self.written.update(replicates_of(task))
        place.parent.mkdir(exist_ok=True)
        place.write_text(task.name)
        return TaskOutcome("done", seconds=0.1, size=1)

    def cancel_pending(self) -> list[Task]:
        waiting, self.under_way = self.under_way[self.workers :], self.under_way[: self.workers]
        return waiting

    def close(self) -> None:
        self.closed = True


def replicates_of(task: Task) -> Iterator[Where]:
    return ((task.point, number) for number in range(task.first, task.last + 1))


def all_of(replicates: Mapping[str, int]) -> set[Where]:
    return {(point, number) for point, count in replicates.items() for number in range(count)}


def on_disk(folder: Folder) -> set[Where]:
    return {(point.id, number) for point in folder.manifest().points for number in folder.done(point.id)}


def missing_of(ended: CampaignOutcome) -> set[Where]:
    return {(point, number) for point, numbers in ended.missing.items() for number in numbers}


CAMPAIGNS = st.dictionaries(st.sampled_from("abcd"), st.integers(1, 13), min_size=1)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return bare_campaign(tmp_path, {"a": 7, "b": 5}, block=3)


# everything is run once


@pytest.mark.thorough
@given(
    data=st.data(), replicates=CAMPAIGNS, block=st.integers(1, 6), workers=st.integers(1, 4), seed=st.integers(0, 99)
)
def test_all_that_can_be_run_is_run_once_and_the_rest_is_named(
    data: st.DataObject, replicates: dict[str, int], block: int, workers: int, seed: int
) -> None:
    everything = sorted(all_of(replicates))
    moods = data.draw(st.dictionaries(st.sampled_from(everything), st.sampled_from(MOODS), max_size=4))
    with tempfile.TemporaryDirectory() as place:
        folder = bare_campaign(Path(place), replicates, block, timeout=5.0)
        pool = Pool(folder, moods, workers, seed)
        ended = run_campaign(folder, pool)
        assert on_disk(folder) == set(everything) - set(moods)
        assert set(pool.written.values()) <= {1}
        assert missing_of(ended) == set(moods) == {_where(name) for name in ended.failed}
        assert ended.failed.keys() == folder.failures().keys()
        assert ended.complete == (not moods) and ended.stopped == "" and pool.closed
        assert ended.done == len(everything) - len(moods)
        assert not list(folder.path.glob("running/*"))


def _where(name: str) -> Where:
    point, _, numbers = name.partition(".r")
    first, last = map(int, numbers.split("-"))
    assert first == last
    return point, first


@pytest.mark.thorough
@given(
    replicates=CAMPAIGNS, block=st.integers(1, 6), of=st.integers(1, 5), ruled=st.booleans(), seed=st.integers(0, 99)
)
def test_parts_share_nothing_and_are_together_everything(
    replicates: dict[str, int], block: int, of: int, ruled: bool, seed: int
) -> None:
    found: Counter[Where] = Counter()
    for number in range(1, of + 1):
        with tempfile.TemporaryDirectory() as place:
            rule = {"metric": "rmse", "half_width": 0.99, "at_least": 3, "at_most": 3}
            folder = bare_campaign(Path(place), replicates, block, until=rule if ruled else None)
            ended = run_campaign(folder, Pool(folder, {}, 2, seed), Shard(number, of))
            assert ended.complete
            found.update(on_disk(folder))
    assert set(found) == all_of(dict.fromkeys(replicates, 3) if ruled else replicates)
    assert set(found.values()) == {1}


def test_what_is_there_is_not_touched_and_files_do_not_cross_the_border_of_a_block(tmp_path: Path) -> None:
    folder = bare_campaign(tmp_path, {"a": 7}, block=5)
    run_campaign(folder, Pool(folder))
    before = files_of(tmp_path)
    assert list(before) and sorted(before) == ["a/r00000-00004.h5", "a/r00005-00006.h5"]
    bare_campaign(tmp_path, {"a": 12}, block=5)
    ended = run_campaign(folder, Pool(folder))
    after = files_of(tmp_path)
    assert (ended.done, ended.found) == (5, 7)
    assert {name: after[name] for name in before} == before
    assert sorted(after.keys() - before.keys()) == ["a/r00007-00009.h5", "a/r00010-00011.h5"]


@given(numbers=st.sets(st.integers(0, 60)), block=st.integers(1, 9))
def test_runs_cover_the_numbers_and_stay_within_blocks(numbers: set[int], block: int) -> None:
    runs = list(consecutive(sorted(numbers), block))
    assert [n for first, last in runs for n in range(first, last + 1)] == sorted(numbers)
    assert all(first // block == last // block for first, last in runs)
    for (_, last), (first, _) in itertools.pairwise(runs):
        assert first > last + 1 or first % block == 0


# which task is blamed


def test_a_block_that_raises_is_tried_one_by_one(folder: Folder) -> None:
    pool = Pool(folder, {("a", 1): "raises"})
    ended = run_campaign(folder, pool)
    assert pool.taken.count("a.r00000-00002") == 1
    assert {"a.r00000-00000", "a.r00001-00001", "a.r00002-00002"} <= set(pool.taken)
    assert ended.failed == {"a.r00001-00001": "raises"}
    assert folder.failures()["a.r00001-00001"].splitlines() == ["raises", "replicate 1, key = a"]


def test_what_kills_its_worker_without_a_word_is_run_alone_before_it_is_given_up(folder: Folder) -> None:
    class Watched(Pool):
        def _die(self, begun: list[Task], guilty: Task, words: str) -> list[FinishedTask]:
            company.append((guilty.name, len(self.under_way)))
            return super()._die(begun, guilty, words)

    company: list[tuple[str, int]] = []
    ended = run_campaign(folder, Watched(folder, {("b", 4): "killed"}, workers=2))
    assert ended.failed == {"b.r00004-00004": "killed its worker twice (killed from outside, perhaps out of memory)"}
    assert [name for name, others in company if others == 1][-2:] == ["b.r00003-00004", "b.r00004-00004"]


@pytest.mark.parametrize("mood", ["hangs", "crashes"])
def test_neighbours_of_a_death_that_is_explained_are_not_suspects(tmp_path: Path, mood: str) -> None:
    """They are the next to be run, beside the others."""
    folder = bare_campaign(tmp_path, {"a": 20}, block=1, timeout=5.0)
    neighbours: list[set[str]] = []

    class Watched(Pool):
        def _die(self, begun: list[Task], guilty: Task, words: str) -> list[FinishedTask]:
            neighbours.append({task.name for task in self.under_way} - {guilty.name})
            return super()._die(begun, guilty, words)

        def submit(self, task: Task) -> None:
            if neighbours:
                neighbours[0].discard(task.name)
                together.append((len(self.under_way), len(neighbours[0])))
            super().submit(task)

    together: list[tuple[int, int]] = []
    pool = Watched(folder, {("a", 3): mood}, workers=4)
    assert set(run_campaign(folder, pool).failed) == {"a.r00003-00003"}
    assert together[6] == (6, 0)


def test_a_crash_says_where_it_was(folder: Folder) -> None:
    ended = run_campaign(folder, Pool(folder, {("a", 6): "crashes"}))
    assert ended.failed == {"a.r00006-00006": "killed its worker twice (Segmentation fault)"}
    assert "Fatal Python error: Segmentation fault" in folder.failures()["a.r00006-00006"]


def test_what_takes_too_long_is_given_up_at_once(tmp_path: Path) -> None:
    folder = bare_campaign(tmp_path, {"a": 4}, block=1, timeout=5.0)
    pool = Pool(folder, {("a", 2): "hangs"})
    ended = run_campaign(folder, pool)
    assert ended.failed == {"a.r00002-00002": "took more than 5 s"} and pool.deaths["a.r00002-00002"] == 1
    assert is_timeout(folder.failures()["a.r00002-00002"])


def test_a_whole_point_of_crashes_costs_no_other_point(tmp_path: Path) -> None:
    folder = bare_campaign(tmp_path, {"a": 10, "b": 10}, block=5)
    ended = run_campaign(folder, Pool(folder, {("a", n): "killed" for n in range(10)}))
    assert missing_of(ended) == {("a", n) for n in range(10)} == {_where(name) for name in ended.failed}


def test_tasks_that_are_lost_before_they_begin_are_not_tried_for_ever(folder: Folder) -> None:
    class Losing(Pool):
        def finished(self, timeout: float) -> list[FinishedTask]:
            everyone, self.under_way = self.under_way, []
            return [FinishedTask(task, WorkerLost("gone")) for task in everyone]

    pool = Losing(folder)
    ended = run_campaign(folder, pool)
    assert missing_of(ended) == all_of({"a": 7, "b": 5}) and max(Counter(pool.taken).values()) == MAX_LOSSES
    assert set(ended.failed.values()) == {f"was lost with its worker {MAX_LOSSES} times"}


def test_what_failed_once_and_is_done_now_is_no_failure_any_more(folder: Folder) -> None:
    """Also where the replicate comes in a block, this time."""
    run_campaign(folder, Pool(folder, {("a", 1): "raises", ("b", 0): "raises"}))
    for name in ("r00000-00000", "r00002-00002"):
        (folder.path / "a" / f"{name}.h5").unlink()
    assert run_campaign(folder, Pool(folder, {("b", 0): "raises"})).failed == {"b.r00000-00000": "raises"}
    assert list(folder.failures()) == ["b.r00000-00000"]


# when to stop


@pytest.mark.thorough
@given(seed=st.integers(0, 999), of=st.integers(1, 3), workers=st.integers(1, 4), block=st.integers(1, 7))
@tries(max_examples=8, phases=[Phase.generate])
def test_the_stopping_rule_depends_on_the_replicates_alone(seed: int, of: int, workers: int, block: int) -> None:
    rule = {"metric": "rmse", "half_width": 0.1, "at_least": 5, "at_most": 60}
    counts: dict[str, int] = {}
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as place:
        patch.setattr(campaigns, "metric", _known)
        for number in range(1, of + 1):
            folder = bare_campaign(Path(place) / str(number), dict.fromkeys("abc", 5), block, until=rule)
            assert run_campaign(folder, Pool(folder, {}, workers, seed), Shard(number, of)).complete
            for point in folder.manifest().points:
                if done := folder.done(point.id):
                    counts[point.id] = ReplicateCounts(folder, folder.manifest()).wanted(point)
                    assert done == set(range(counts[point.id]))
    assert counts == {point: _enough(point) for point in "abc"}


SPREADS = {"a": 0.1, "b": 0.3, "c": 3.0}


def _known(folder: Folder, point: str, name: str, replicates: int) -> tuple[np.ndarray, np.ndarray]:
    """Figures that are told of the replicates that are there."""
    seen = np.array([n in folder.done(point) for n in range(replicates)])
    return np.where(seen, _drawn(point)[:replicates], np.nan), seen


def _drawn(point: str) -> np.ndarray:
    return 1.0 + SPREADS[point] * np.random.default_rng(8).normal(size=60)


@functools.cache
def _enough(point: str, failed: frozenset[int] = frozenset()) -> int:
    """The first look, each of half as many replicates more, at which the interval is narrow; or the last."""
    for look in (5, 7, 10, 15, 22, 33, 49):
        seen = [value for number, value in enumerate(_drawn(point)[:look]) if number not in failed]
        _, low, high, _ = statistics.median(np.array(seen))
        if (high - low) / 2 <= 0.1 * np.median(seen):
            return look
    return 60


@pytest.mark.thorough(fast=["killed-7"])
@pytest.mark.parametrize("block", [1, 3, 7])
@pytest.mark.parametrize("mood", ["raises", "killed"])
def test_under_a_rule_a_point_goes_on_with_its_other_runs_after_some_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mood: str, block: int
) -> None:
    rule = {"metric": "rmse", "half_width": 0.1, "at_least": 5, "at_most": 60}
    monkeypatch.setattr(campaigns, "metric", _known)
    folder = bare_campaign(tmp_path, dict.fromkeys("abc", 5), block, until=rule)
    failing = frozenset({1, 4, 8})
    ended = run_campaign(folder, Pool(folder, {("b", number): mood for number in failing}))
    counts = {point: _enough(point, failing if point == "b" else frozenset()) for point in "abc"}
    assert counts["b"] > 8 and len(ended.failed) == 3
    assert missing_of(ended) == {("b", number) for number in failing}
    assert on_disk(folder) == all_of(counts) - missing_of(ended)
    points = folder.manifest().points
    assert {point.id: ReplicateCounts(folder, folder.manifest()).wanted(point) for point in points} == counts
    again = run_campaign(folder, Pool(folder))
    assert again.complete and not folder.failures()
    assert on_disk(folder) >= all_of({point: _enough(point) for point in "abc"})


def test_a_point_of_which_most_runs_fail_gets_no_further_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rule = {"metric": "rmse", "half_width": 0.1, "at_least": 5, "at_most": 60}
    monkeypatch.setattr(campaigns, "metric", _known)
    folder = bare_campaign(tmp_path, {"c": 5}, 2, until=rule)
    ended = run_campaign(folder, Pool(folder, {("c", number): "raises" for number in range(60)}))
    assert len(ended.failed) == 5 and not on_disk(folder)


def test_told_to_stop_it_ends_what_runs_and_begins_nothing(folder: Folder) -> None:
    pool = Pool(folder)
    asked: list[int] = []

    def stop() -> bool:
        asked.append(len(pool.taken))
        return len(asked) > 2

    ended = run_campaign(folder, pool, should_stop=stop)
    assert ended.stopped == "interrupted" and not ended.complete and pool.closed
    assert len(pool.taken) == asked[-1] and not pool.under_way
    assert 0 < ended.done == len(on_disk(folder))
    assert missing_of(ended) == all_of({"a": 7, "b": 5}) - on_disk(folder)
    again = Pool(folder)
    assert run_campaign(folder, again).complete and not set(again.written) & set(pool.written)


@pytest.mark.parametrize("status", ["storage", "version"])
def test_where_no_task_could_be_written_none_is_begun(folder: Folder, status: Any) -> None:
    class Full(Pool):
        def _write(self, task: Task) -> TaskOutcome:
            return TaskOutcome(status, "no space") if self.written else super()._write(task)

    pool = Full(folder, workers=1)
    ended = run_campaign(folder, pool)
    assert ended.stopped == "no space" and not ended.failed and not ended.complete
    assert len(pool.taken) <= 3 and ended.done == 3


def test_a_worker_that_was_left_out_is_named_in_the_outcome(folder: Folder) -> None:
    pool = Pool(folder)
    pool.left_out["tcp://a:1"] = "has 2 threads"
    assert run_campaign(folder, pool).left_out == {"tcp://a:1": "has 2 threads"}


def test_an_engine_that_is_gone_ends_the_campaign_with_its_words(folder: Folder) -> None:
    class Gone(Pool):
        def finished(self, timeout: float) -> list[FinishedTask]:
            if self.written:
                raise EngineError("the scheduler is gone")
            return super().finished(timeout)

    pool = Gone(folder)
    ended = run_campaign(folder, pool)
    assert ended.stopped == "the scheduler is gone" and ended.done and not ended.complete and pool.closed


def test_whatever_is_raised_lets_the_engine_go(folder: Folder) -> None:
    class Interrupted(Pool):
        def finished(self, timeout: float) -> list[FinishedTask]:
            raise KeyboardInterrupt

    pool = Interrupted(folder)
    with pytest.raises(KeyboardInterrupt):
        run_campaign(folder, pool)
    assert pool.closed


# progress


def test_progress_counts_replicates_up_to_all_of_this_part(folder: Folder) -> None:
    told: list[CampaignProgress] = []
    run_campaign(folder, Pool(folder, {("a", 0): "raises"}), on_progress=told.append)
    assert [p.done for p in told] == sorted(p.done for p in told)
    assert {p.total for p in told} == {12} and (told[-1].done, told[-1].failed) == (11, 1)
    assert told[0].left is None or told[0].done
    assert told[-1].left == 0.0
    run_campaign(folder, Pool(folder), on_progress=told.append)
    assert (told[-1].done, told[-1].failed, told[-1].total) == (12, 0, 12)


def test_the_time_left_does_not_count_what_workers_compiled(folder: Folder) -> None:
    class Compiling(Pool):
        def _write(self, task: Task) -> TaskOutcome:
            return replace(super()._write(task), seconds=10.0, compiling=9.0)

    told: list[CampaignProgress] = []
    run_campaign(folder, Compiling(folder), on_progress=told.append)
    estimated = [p for p in told if p.done]
    assert len(estimated) > 3
    for p in estimated:
        assert p.left == pytest.approx(0.1 * p.wall / p.done * (p.total - p.done))


def test_a_session_is_named_after_its_process_and_no_two_alike(folder: Folder) -> None:
    names = set()

    class Listening(Pool):
        def submit(self, task: Task) -> None:
            names.add(task.session)
            super().submit(task)

    run_campaign(folder, Listening(folder), WHOLE)
    for place in folder.path.glob("a/*.h5"):
        place.unlink()
    run_campaign(folder, Listening(folder), WHOLE)
    assert len(names) == 2 and all(f"-{os.getpid()}-" in name for name in names)
