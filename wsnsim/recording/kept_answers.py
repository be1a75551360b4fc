"""Answers that take seconds to compute, kept in a file of a campaign's folder: bounds, and the rows of a reproduction.

    kept = KeptAnswers(folder.path / KEPT / "bounds.json")
    kept.answer({"scenario": ..., "runs": 100}, compute)

An answer depends on its question and on this package's code, whose digest is in the file. Answers of other code, and
a file that is damaged, count as missing. In a folder that cannot be written, nothing is kept. The file may be deleted.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, final

from wsnsim.base.errors import StorageError
from wsnsim.base.regular_files import read_regular
from wsnsim.recording.atomic_files import write_text_atomically
from wsnsim.recording.code_digests import code_digest

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
        self._answers = _load(place)

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


def _load(place: Path) -> dict[str, Any]:
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
