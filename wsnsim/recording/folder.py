"""A campaign on disk: a manifest, a folder of result files per point, and reports of failures.

    DIR/campaign.json               the manifest: keys, points, replicates; replaced as a whole at every start
    DIR/<point>/scenario.json       the point's scenario with every default
    DIR/<point>/r00000-00004.h5     its replicates 0 to 4; a file with this name is complete
    DIR/failed/<task>.txt           why a task failed
    DIR/consolidated/runs.rows      the rows of all files, to be read at once; see `kept`
    DIR/kept/                       answers that take long to compute; see `kept`
    DIR/running/                    markers of running tasks; those of killed workers stay

The existing files alone say which replicates are done.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, final

from wsnsim.base.errors import ResultError
from wsnsim.base.files import read_regular
from wsnsim.recording.atomic_files import (
    TEMPORARY,
    host,
    reason,
    remove_leftovers,
    write_atomically,
    write_text_atomically,
)
from wsnsim.recording.reader import read_table, tables
from wsnsim.recording.rows import SCHEMA_VERSION, demand_schema

MANIFEST: Final = "campaign.json"
SCENARIO: Final = "scenario.json"
BATCH: Final = re.compile(r"r([0-9]{5,7})-([0-9]{5,7})\.h5")
POINT_ID: Final = re.compile(r"\w[\w.\-]*")
MOST_NUMBERED: Final = 10_000_000
"""Replicates of a point: a larger number in a manifest is not believed."""


@dataclass(frozen=True)
class PointOnDisk:
    """A point of the manifest: its id (the folder's name), settings, world, and largest number of replicates."""

    id: str
    settings: Mapping[str, Any]
    world: str
    replicates: int


@dataclass(frozen=True)
class Manifest:
    """The content of campaign.json.

    Attributes:
        block: replicates per task.
        by: keys whose values are compared.
        until: the stopping rule.
        code: {part: {file: digest}} of the code that makes the runs: of wsnsim, and of each plug-in's module.
        code_changes: accepted changes of the code, each with `time`, `changed` files, and digests `before` and `after`.
    """

    name: str
    keys: tuple[str, ...]
    points: tuple[PointOnDisk, ...]
    block: int
    wsnsim_version: str
    by: tuple[str, ...] = ()
    baseline: str | None = None
    until: Mapping[str, Any] | None = None
    timeout: float | None = None
    source: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    code: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    code_changes: tuple[Mapping[str, Any], ...] = ()

    def point(self, name: str) -> PointOnDisk:
        """The point with this id."""
        return next(point for point in self.points if point.id == name)


class Batch(NamedTuple):
    """A result file with replicates `first` to `last` of a point."""

    path: Path
    first: int
    last: int


@final
class Folder:
    """A campaign's folder. Every answer is read from the disk; nothing is kept in memory."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def holds_campaign(self) -> bool:
        """Whether there is a manifest."""
        return (self.path / MANIFEST).is_file()

    def holds_only_scenarios(self) -> bool:
        """Whether the folder holds at most scenarios, which a campaign writes before its manifest."""
        files = [place for place in self.path.rglob("*") if not place.is_dir()]
        return all(place.name == SCENARIO or TEMPORARY.fullmatch(place.name) for place in files)

    def manifest(self) -> Manifest:
        """The manifest.

        Raises:
            ResultError: there is no manifest, it is damaged, or another version of wsnsim wrote it.
        """
        place = self.path / MANIFEST
        try:
            content = json.loads(read_regular(place))
            demand_schema(place, content.pop("schema_version"), content.get("wsnsim_version"))
            points = tuple(PointOnDisk(**point) for point in content.pop("points"))
            keys, by, changes = (tuple(content.pop(name, ())) for name in ("keys", "by", "code_changes"))
            counts = (content["block"], *(point.replicates for point in points))
            if not all(isinstance(count, int) and 1 <= count <= MOST_NUMBERED for count in counts):
                raise ValueError(f"block and replicates are at least 1 and at most {MOST_NUMBERED}")
            if not all(POINT_ID.fullmatch(point.id) for point in points):
                raise ValueError("the id of a point is no name of a folder")
            if not all(isinstance(files, dict) for files in [*content.get("code", {}).values(), *changes]):
                raise ValueError("the digests of the code are no mapping")
            return Manifest(points=points, keys=keys, by=by, code_changes=changes, **content)
        except (FileNotFoundError, NotADirectoryError):
            raise ResultError(f"{self.path}: holds no campaign (no {MANIFEST})") from None
        except OSError as error:
            raise ResultError(f"{place}: cannot be read: {reason(error)}") from error
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ResultError(f"{place}: is damaged: {type(error).__name__}: {error}") from error

    def write_manifest(self, manifest: Manifest) -> None:
        """Write the manifest, replacing the former one as a whole."""
        content = {"schema_version": SCHEMA_VERSION, **asdict(manifest)}
        write_text_atomically(self.path / MANIFEST, json.dumps(content, indent=1, ensure_ascii=False))

    def write_scenario(self, point: str, resolved: str) -> None:
        """Write a point's scenario if it is missing or damaged. The point's id is a digest of this text."""
        place = self.path / point / SCENARIO
        try:
            intact = read_regular(place) == resolved.encode()
        except OSError:
            intact = False
        if not intact:
            write_text_atomically(place, resolved)

    def scenario(self, point: str) -> str:
        """A point's scenario, as JSON: an object with every value, which extends no file.

        Raises:
            ResultError: it cannot be read, or is something else.
        """
        place = self.path / point / SCENARIO
        try:
            text = read_regular(place).decode("utf-8")
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            what = "UTF-8" if isinstance(error, UnicodeDecodeError) else "JSON"
            raise ResultError(f"{place}: is damaged: it is not {what}") from error
        except OSError as error:
            raise ResultError(f"{place}: cannot be read: {reason(error)}") from error
        if not isinstance(values, dict):
            raise ResultError(f"{place}: is damaged: it is no scenario")
        if "extends" in values:
            raise ResultError(f"{place}: extends another file, which no scenario of a campaign does")
        return text

    def batch(self, point: str, first: int, last: int) -> Path:
        """The path of the file with replicates `first` to `last`."""
        return self.path / point / f"r{first:05d}-{last:05d}.h5"

    def batches(self, point: str) -> list[Batch]:
        """The result files of a point, ordered by replicate.

        Raises:
            ResultError: the folder cannot be listed.
        """
        folder = self.path / point
        try:
            names = [place.name for place in folder.iterdir()]
        except FileNotFoundError:
            return []
        except OSError as error:
            raise ResultError(f"{folder}: cannot be read: {reason(error)}") from error
        matches = filter(None, map(BATCH.fullmatch, names))
        found = [Batch(folder / match[0], int(match[1]), int(match[2])) for match in matches]
        return sorted(found, key=lambda batch: (batch.first, batch.last))

    def done(self, point: str) -> set[int]:
        """The replicates of a point that are on disk."""
        return {number for batch in self.batches(point) for number in range(batch.first, batch.last + 1)}

    def outside_manifest(self, manifest: Manifest) -> int:
        """The number of runs on disk that the manifest does not contain."""
        own = {point.id: point.replicates for point in manifest.points}
        existing = {place.parent.name for place in self.path.glob("*/r*.h5")}
        return sum(number >= own.get(point, 0) for point in existing for number in self.done(point))

    def missing(self, point: str, replicates: int) -> list[int]:
        """The missing ones of a point's first replicates."""
        done = self.done(point)
        return [number for number in range(replicates) if number not in done]

    def set_aside(self, point: str) -> list[Path]:
        """Rename the files of a point that cannot be read, so that their replicates are missing; the new paths.

        Every column is read, because damage to values shows only in HDF5's checksums.
        """
        moved = []
        for batch in self.batches(point):
            try:
                for table in tables(batch.path):
                    read_table(batch.path, table)
            except ResultError:
                moved.append(batch.path.rename(batch.path.with_name(f"{batch.path.name}.damaged")))
        return moved

    def all_set_aside(self) -> list[Path]:
        """The same for the files of all points."""
        return [path for point in self.manifest().points for path in self.set_aside(point.id)]

    def state(self) -> list[Any]:
        """The state of the scenarios and result files: name, size, times and inode of each, as JSON values."""
        return [
            [f"{path.parent.name}/{path.name}", about.st_size, about.st_mtime_ns, about.st_ctime_ns, about.st_ino]
            for point in self.manifest().points
            for path in (self.path / point.id / SCENARIO, *(batch.path for batch in self.batches(point.id)))
            for about in (path.stat(),)
        ]

    def holds_results(self, manifest: Manifest) -> bool:
        """Whether a result file of the campaign's points is on disk."""
        return any(self.batches(point.id) for point in manifest.points)

    def copy_in(self, batch: Batch, point: str) -> None:
        """Copy a result file from another folder, as a whole or not at all."""
        write_atomically(self.batch(point, batch.first, batch.last), lambda tmp: shutil.copyfile(batch.path, tmp))

    def write_failure(self, task: str, words: str) -> None:
        """Write why a task failed. On a full disk, nothing is written."""
        with contextlib.suppress(ResultError):
            write_text_atomically(self.path / "failed" / f"{task}.txt", words)

    def failures(self) -> dict[str, str]:
        """The reports of failed tasks, by task."""
        places = sorted(place for place in self.path.glob("failed/*.txt") if place.is_file())
        return {place.stem: place.read_text(encoding="utf-8", errors="replace") for place in places}

    def given_up(self, point: str) -> set[int]:
        """The replicates of a point that have a report of their failure, and no file."""
        return {number for _, numbers in self._reports(point) for number in numbers} - self.done(point)

    def _reports(self, point: str) -> Iterator[tuple[Path, range]]:
        """The reports of a point's failures, each with its replicates."""
        for place in self.path.glob(f"failed/{point}.r*.txt"):
            if span := BATCH.fullmatch(f"{place.stem.removeprefix(f'{point}.')}.h5"):
                yield place, range(int(span[1]), int(span[2]) + 1)

    def forget_failures(self, point: str, done: range) -> None:
        """Delete the reports of replicates that succeeded in the end."""
        with contextlib.suppress(OSError):  # a report that stays is wrong, and no reason to end a campaign
            for place, numbers in self._reports(point):
                if numbers.start < done.stop and done.start < numbers.stop:
                    place.unlink(missing_ok=True)

    def marker(self, session: str, task: str) -> Path:
        """The path of the file that a worker keeps while it runs a task. It stays if the worker is killed."""
        return self.path / "running" / f"{session}.{task}.{host()}.{os.getpid()}.log"

    def markers(self, session: str, task: str = "*") -> list[Path]:
        """The markers of running and killed tasks of a session."""
        return sorted(self.path.glob(f"running/{session}.{task}.*.log"))

    def marker_texts(self, session: str, task: str) -> list[str]:
        """The texts of a task's markers."""
        found = []
        for place in self.markers(session, task):
            with contextlib.suppress(OSError):  # its worker has just finished
                found.append(read_regular(place).decode("utf-8", errors="replace"))
        return found

    def remove_markers(self, session: str, task: str) -> None:
        """Remove the markers of a task, before it is run again."""
        for place in self.markers(session, task):
            with contextlib.suppress(OSError):  # network file systems may say that it is stale
                place.unlink(missing_ok=True)

    def remove_leftovers(self) -> None:
        """Remove temporary files and markers of killed processes; see `atomic_files`."""
        remove_leftovers(self.path)


def consecutive(numbers: Sequence[int], block: int) -> Iterator[tuple[int, int]]:
    """(first, last) of each range of consecutive numbers, split at multiples of `block`.

    The splits are at fixed numbers, so that they do not depend on how many replicates are wanted.
    """
    start = 0
    for i in range(1, len(numbers) + 1):
        ends = i == len(numbers) or numbers[i] != numbers[i - 1] + 1 or numbers[i] % block == 0
        if ends:
            yield numbers[start], numbers[i - 1]
            start = i
