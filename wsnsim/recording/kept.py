"""What is kept in a campaign's folder since it takes seconds to make: short tables of all files, and answers.

    read_consolidated(folder, "runs", files) -> its rows, and their number by file
    kept = KeptAnswers(folder.path / KEPT / "bounds.json")
    kept.answer({"scenario": ..., "runs": 100}, compute)

DIR/consolidated/TABLE.rows holds the rows, and a digest of the names, sizes, times and inodes of the files. It is used
only if the files are the same now and its digest is right; else the files are read, and it is written again as a
whole. An answer (bounds, the rows of a reproduction) depends on its question and on this package's code, whose digest
is in the file; answers of other code, and a file that is damaged, count as missing. In a folder that cannot be
written, nothing is kept. All of it may be deleted at any time.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.errors import StorageError
from wsnsim.base.files import read_regular
from wsnsim.base.runs import tracked
from wsnsim.recording.atomic_files import write_atomically, write_text_atomically
from wsnsim.recording.provenance import code_digest
from wsnsim.recording.reader import read_with_meanings
from wsnsim.recording.rows import PackedRows, read_packed_rows

FOLDER: Final = "consolidated"
FORMAT: Final = 1
SETTLED: Final = 50_000_000
"""Age (ns) from which on a change of a file changes its time; the clock of file systems is coarse."""


def read_consolidated(folder: Path, table: str, files: Sequence[Path]) -> tuple[PackedRows, Ints] | None:
    """The rows of a short table of these files of a campaign, and their number by file; None if columns differ.

    Raises:
        ResultError: a file cannot be read.
    """
    kept = folder / FOLDER / f"{table}.rows"
    stamp, settled = _stamp(files)
    if (found := _load(kept, stamp)) is not None:
        return found
    found = _read(files, table)
    if found is not None and settled and _stamp(files)[0] == stamp:
        with contextlib.suppress(StorageError):
            write_atomically(kept, lambda tmp: _save(tmp, found, stamp))
    return found


def _stamp(files: Sequence[Path]) -> tuple[str, bool]:
    """A digest of the state of the files, and whether all of them are old enough for another change to show."""
    digest, newest = hashlib.sha256(f"{FORMAT}".encode()), 0
    for file in files:
        try:
            state = file.stat()
        except OSError:
            return "", False
        newest = max(newest, state.st_ctime_ns, state.st_mtime_ns)
        about = state.st_size, state.st_mtime_ns, state.st_ctime_ns, state.st_ino
        digest.update(f"{file.parent.name}/{file.name}{about}".encode())
    return digest.hexdigest(), time.time_ns() - newest > SETTLED


def _load(kept: Path, stamp: str) -> tuple[PackedRows, Ints] | None:
    """The rows that are kept, and their number by file; None if they are missing, outdated or damaged."""
    try:
        digest, content = read_regular(kept).split(b"\n", 1)
        if digest.decode() != hashlib.sha256(content).hexdigest():
            return None
        head, rows = content.split(b"\n", 1)
        about = json.loads(head)
        records = np.frombuffer(rows, [(name, kind) for name, kind in about["types"]])
        words = {name: tuple(some) for name, some in about["words"].items()}
        counts = np.array(about["counts"], np.int64)
        known = about["stamp"] == stamp and counts.ndim == 1 and counts.sum() == len(records)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError, MemoryError):
        return None
    return (PackedRows(records, words), counts) if known else None


def _save(tmp: Path, rows: tuple[PackedRows, Ints], stamp: str) -> None:
    (records, words), counts = rows
    about = {"stamp": stamp, "types": records.dtype.descr, "words": dict(words), "counts": counts.tolist()}
    content = json.dumps(about).encode() + b"\n" + records.tobytes()
    tmp.write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def _read(files: Sequence[Path], table: str) -> tuple[PackedRows, Ints] | None:
    """The rows of the files, each read, and their number by file; None if they differ in their columns or words."""
    pieces = [_of_file(file, table) for file in tracked(files, "result files read")]
    first = pieces[0]
    types = {id(piece.records.dtype): piece.records.dtype for piece in pieces}  # files of a campaign share one
    if any(each != first.records.dtype for each in types.values()) or any(p.words != first.words for p in pieces):
        return None
    counts = np.array([len(piece.records) for piece in pieces], dtype=np.int64)
    return PackedRows(np.concatenate([piece.records for piece in pieces]), first.words), counts


def _of_file(file: Path, table: str) -> PackedRows:
    """The rows of one file, which holds them in one piece or by column."""
    packed = read_packed_rows(file, table)
    if packed is not None:
        return packed
    columns, words = read_with_meanings(file, table)
    dtype = np.dtype([(name, values.dtype.str) for name, values in columns.items()])
    records = np.empty(len(next(iter(columns.values()))), dtype)
    for name, values in columns.items():
        records[name] = values
    return PackedRows(records, words)


KEPT: Final = "kept"
"""The folder of kept answers in a campaign's folder."""


@final
class KeptAnswers:
    """The kept answers of one file.

    Args:
        place: the file; it need not exist.
    """

    def __init__(self, place: Path) -> None:
        self._place = place
        self._answers = _load_answers(place)

    def answer(self, question: Any, compute: Callable[[], Any]) -> Any:
        """The kept answer, or the computed one, which is then kept.

        Args:
            question: what the answer depends on, as JSON values.
            compute: the function that gives the answer as JSON values. Errors are not kept.
        """
        key = hashlib.sha256(_json(question).encode()).hexdigest()
        if key not in self._answers:
            self._answers[key] = json.loads(_json(compute()))
            with contextlib.suppress(StorageError):
                content = {"code": code_digest(), "digest": _digest(self._answers), "answers": self._answers}
                write_text_atomically(self._place, json.dumps(content))
        return self._answers[key]


def _load_answers(place: Path) -> dict[str, Any]:
    """The answers in the file; none if it is missing, damaged, or of other code."""
    try:
        content = json.loads(read_regular(place))
        answers: dict[str, Any] = content["answers"]
        return answers if (content["code"], content["digest"]) == (code_digest(), _digest(answers)) else {}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}


def _digest(answers: dict[str, Any]) -> str:
    return hashlib.sha256(_json(answers).encode()).hexdigest()


def _json(value: Any) -> str:
    """The value as JSON, the same text for equal values. NumPy's numbers become Python's."""
    return json.dumps(value, sort_keys=True, default=lambda number: number.item())
