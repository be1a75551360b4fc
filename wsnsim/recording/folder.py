"""A campaign on disk: a manifest, a folder of result files a point, and what went wrong.

    DIR/campaign.json               the manifest: keys, points, replicates; written anew, and whole, at every start
    DIR/<point>/scenario.json       the point's scenario, every default spelt out
    DIR/<point>/r00000-00004.h5     replicates 0 to 4 of it; a file that has its name is whole
    DIR/failed/<task>.txt           why replicates could not be run
    DIR/running/                    what workers leave that were killed

Which replicates are done is which files exist, and nothing else.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, final

from wsnsim.base.errors import ResultError
from wsnsim.recording.layout import cannot_write, reason
from wsnsim.recording.reader import read_table, tables

MANIFEST: Final = "campaign.json"
SCENARIO: Final = "scenario.json"
SCHEMA_VERSION: Final = 1
BATCH: Final = re.compile(r"r(\d{5,})-(\d{5,})\.h5")
LEFT: Final = re.compile(r".*\.(?P<host>[^.]+)\.(?P<pid>\d+)(-\d+)?\.tmp")


@dataclass(frozen=True)
class PointOnDisk:
    """A point of the manifest: its folder's name, what sets it apart, its world, how many replicates it has at most."""

    id: str
    settings: Mapping[str, Any]
    world: str
    replicates: int


@dataclass(frozen=True)
class Manifest:
    """What a campaign's folder is about. `by`: the keys whose values are compared; `source`: the sweep's text."""

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

    def point(self, name: str) -> PointOnDisk:
        """The point of this id."""
        return next(point for point in self.points if point.id == name)


class Batch(NamedTuple):
    """A result file that holds replicates `first` to `last` of a point."""

    path: Path
    first: int
    last: int


@final
class Folder:
    """One campaign's directory. Nothing is kept in memory: whoever asks is told what is on disk."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def holds_campaign(self) -> bool:
        """Whether there is a manifest."""
        return (self.path / MANIFEST).is_file()

    def holds_only_scenarios(self) -> bool:
        """Whether there is nothing but what a campaign puts in place before its manifest."""
        files = [place for place in self.path.rglob("*") if not place.is_dir()]
        return all(place.name == SCENARIO or LEFT.fullmatch(place.name) for place in files)

    def manifest(self) -> Manifest:
        """What the campaign is about.

        Raises:
            ResultError: there is no manifest, it is damaged, or of a newer wsnsim.
        """
        place = self.path / MANIFEST
        try:
            said = json.loads(place.read_text(encoding="utf-8"))
            version = said.pop("schema_version")
            if version > SCHEMA_VERSION:
                raise ResultError(f"{place}: was written by a newer wsnsim ({said.get('wsnsim_version')})")
            points = tuple(PointOnDisk(**point) for point in said.pop("points"))
            keys, by = (tuple(said.pop(name, ())) for name in ("keys", "by"))
            if min(said["block"], *(point.replicates for point in points)) < 1:
                raise ValueError("block and replicates are at least 1")
            return Manifest(points=points, keys=keys, by=by, **said)
        except FileNotFoundError:
            raise ResultError(f"{self.path}: holds no campaign (there is no {MANIFEST})") from None
        except OSError as error:
            raise ResultError(f"{place}: cannot be read: {reason(error)}") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ResultError(f"{place}: is damaged: {type(error).__name__}: {error}") from error

    def write_manifest(self, manifest: Manifest) -> None:
        """Put the manifest in place, whole."""
        said = {"schema_version": SCHEMA_VERSION, **asdict(manifest)}
        self._put(self.path / MANIFEST, json.dumps(said, indent=1, ensure_ascii=False))

    def write_scenario(self, point: str, resolved: str) -> None:
        """Put a point's scenario in place, if it is not there, or is damaged: the point's name is made of its text."""
        place = self.path / point / SCENARIO
        try:
            whole = place.read_bytes() == resolved.encode()
        except OSError:
            whole = False
        if not whole:
            self._put(place, resolved)

    def scenario(self, point: str) -> str:
        """A point's scenario, as JSON."""
        place = self.path / point / SCENARIO
        try:
            return place.read_text(encoding="utf-8")
        except OSError as error:
            raise ResultError(f"{place}: cannot be read: {reason(error)}") from error

    def batch(self, point: str, first: int, last: int) -> Path:
        """The name of the file of replicates `first` to `last`."""
        return self.path / point / f"r{first:05d}-{last:05d}.h5"

    def batches(self, point: str) -> list[Batch]:
        """The point's result files, in the order of their replicates."""
        try:
            names = [place.name for place in (self.path / point).iterdir()]
        except FileNotFoundError:
            return []
        found = [(name, BATCH.fullmatch(name)) for name in names]
        return sorted(
            (Batch(self.path / point / name, int(match[1]), int(match[2])) for name, match in found if match),
            key=lambda batch: (batch.first, batch.last),
        )

    def done(self, point: str) -> set[int]:
        """The replicates of a point that are on disk."""
        return {number for batch in self.batches(point) for number in range(batch.first, batch.last + 1)}

    def outside_manifest(self, manifest: Manifest) -> tuple[int, int]:
        """What is on disk and not of the campaign as it is now: (points, replicates of its points)."""
        own = {point.id: point.replicates for point in manifest.points}
        there = {place.parent.name for place in self.path.glob("*/r*.h5")}
        more = sum(sum(number >= most for number in self.done(point)) for point, most in own.items())
        return len(there - own.keys()), more

    def missing(self, point: str, replicates: int) -> list[int]:
        """Which of the point's first replicates are not on disk."""
        done = self.done(point)
        return [number for number in range(replicates) if number not in done]

    def set_aside(self, point: str) -> list[Path]:
        """Rename the point's files that cannot be read, so that their replicates are missing; their new names.

        Every column is read: what was changed within shows in the checksums.
        """
        moved = []
        for batch in self.batches(point):
            try:
                for table in tables(batch.path):
                    read_table(batch.path, table)
            except ResultError:
                moved.append(batch.path.rename(batch.path.with_name(f"{batch.path.name}.damaged")))
        return moved

    def copy_in(self, batch: Batch, point: str) -> None:
        """Take over a result file of another folder, whole or not at all."""
        place = self.batch(point, batch.first, batch.last)
        tmp = self._beside(place)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(batch.path, tmp)
            self._settle(tmp, place)
        except OSError as error:
            with contextlib.suppress(OSError):
                tmp.unlink(missing_ok=True)
            raise cannot_write(place, error) from error

    def write_failure(self, task: str, words: str) -> None:
        """Say why replicates could not be run; a disk that takes nothing more takes no word either."""
        with contextlib.suppress(ResultError):
            self._put(self.path / "failed" / f"{task}.txt", words)

    def failures(self) -> dict[str, str]:
        """What could not be run, and why."""
        return {place.stem: place.read_text(encoding="utf-8") for place in sorted(self.path.glob("failed/*.txt"))}

    def forget_failure(self, task: str) -> None:
        """It could be run after all, or is to be tried again."""
        (self.path / "failed" / f"{task}.txt").unlink(missing_ok=True)

    def marker(self, session: str, task: str) -> Path:
        """The file that a worker keeps while it runs a task, and that stays behind if the worker is killed."""
        return self.path / "running" / f"{session}.{task}.{_host()}.{os.getpid()}.log"

    def markers(self, session: str, task: str = "*") -> list[Path]:
        """What workers that were killed left behind in this session."""
        return sorted(self.path.glob(f"running/{session}.{task}.*.log"))

    def marker_texts(self, session: str, task: str) -> list[str]:
        """What the marks of a task say."""
        found = []
        for place in self.markers(session, task):
            with contextlib.suppress(FileNotFoundError):  # another worker has just ended it
                found.append(place.read_text(encoding="utf-8", errors="replace"))
        return found

    def remove_markers(self, session: str, task: str) -> None:
        """The task is to begin anew."""
        for place in self.markers(session, task):
            place.unlink(missing_ok=True)

    def remove_leftovers(self) -> None:
        """Remove what killed processes of this machine left: temporary files, and marks of tasks."""
        for place in [*self.path.glob("*.tmp"), *self.path.glob("*/*.tmp")]:
            owner = LEFT.fullmatch(place.name)
            if owner and owner["host"] == _host() and not _lives(int(owner["pid"])):
                place.unlink(missing_ok=True)
        for place in self.path.glob("running/*.log"):
            host, pid = place.name.split(".")[-3:-1]
            if host == _host() and pid.isdigit() and not _lives(int(pid)):
                place.unlink(missing_ok=True)

    def _put(self, place: Path, text: str) -> None:
        """A text file that has its name only once it is whole."""
        tmp = self._beside(place)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            tmp.write_text(text, encoding="utf-8")
            self._settle(tmp, place)
        except OSError as error:
            with contextlib.suppress(OSError):
                tmp.unlink(missing_ok=True)
            raise cannot_write(place, error) from error

    @staticmethod
    def _beside(place: Path) -> Path:
        return place.with_name(f"{place.name}.{_host()}.{os.getpid()}.tmp")

    @staticmethod
    def _settle(tmp: Path, place: Path) -> None:
        """Give a file its name once what it holds is on the disk."""
        with tmp.open("rb+") as file:
            os.fsync(file.fileno())
        tmp.replace(place)


def runs_of(numbers: Sequence[int], block: int) -> Iterator[tuple[int, int]]:
    """Replicates as (first, last) without a gap, none across the border of a block of fixed size.

    So the border does not depend on how many were asked for, nor on who asks.
    """
    start = 0
    for i in range(1, len(numbers) + 1):
        ends = i == len(numbers) or numbers[i] != numbers[i - 1] + 1 or numbers[i] % block == 0
        if ends:
            yield numbers[start], numbers[i - 1]
            start = i


def _host() -> str:
    return re.sub(r"\W", "-", socket.gethostname().split(".")[0]) or "host"


def _lives(pid: int) -> bool:
    """Whether a process of this machine runs; one that has ended does not, though nobody has asked how it ended."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0] != "Z"
    except (OSError, IndexError):  # no Linux
        return True
