"""What stands beside the pages of studies: CSV files with all rows, and what was registered before the runs.

as_csv(rows) -> str                                  registered(study) -> str, docs/registered/STUDY.txt word for word
hypotheses(study) -> {number: its words}             counts(answers) -> how many are yes, no and undecided
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

DOCS = Path(__file__).parents[2] / "docs"
ANSWERS = ("yes", "no", "undecided")
DIFFER = "with tests that differ"


def as_csv(rows: Iterable[Mapping[str, Any]]) -> str:
    """Rows as CSV: [value, low, high] takes three columns, and a mapping those of its keys."""
    table = pd.DataFrame([dict(_cells(row)) for row in rows])
    return table.to_csv(index=False, float_format="%.5g", lineterminator="\n")


def _cells(row: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in row.items():
        if isinstance(value, Mapping):
            yield from _cells(value, f"{before}{name}: ")
        elif isinstance(value, list | tuple):
            yield from ((f"{before}{name}{ending}", each) for ending, each in zip(("", " low", " high"), value))  # noqa: B905 (a share has its count as well)
        else:
            yield before + name, value


def write_files(files: Mapping[str, str]) -> None:
    """Write files of docs."""
    for name, content in files.items():
        (DOCS / name).write_text(content, encoding="utf-8")


def registered(study: str) -> str:
    """What was registered before the runs of a study."""
    return (DOCS / f"registered/{study}.txt").read_text(encoding="utf-8")


def hypotheses(study: str) -> dict[int, str]:
    """{number: words} of the registered hypotheses of a study."""
    found = re.findall(r"^(\d+)\. (.*?)(?=\n\d+\. |\n\n|\Z)", registered(study), re.MULTILINE | re.DOTALL)
    return {int(number): " ".join(words.split()) for number, words in found}


def counts(answers: Mapping[int, Sequence[str]]) -> str:
    """How many hypotheses have each answer in all of their tests, and which."""
    found = {number: these[0] if len({*these}) == 1 else DIFFER for number, these in answers.items() if these}
    said = []
    for word in ANSWERS if DIFFER not in found.values() else (*ANSWERS, DIFFER):
        numbers = [str(number) for number, each in found.items() if each == word]
        said.append(f"{len(numbers)} {word}" + f" ({', '.join(numbers)})" * bool(numbers))
    return f"Of {len(found)} hypotheses: {', '.join(said)}."


def answer_rows(study: str, answers: Mapping[str, Mapping[int, Sequence[str]]]) -> list[dict[str, Any]]:
    """A row for each registered hypothesis: its words, and how many of its tests have each answer, by column."""
    return [
        {"number": number, "hypothesis": words, **{head: _counted(of.get(number, ())) for head, of in answers.items()}}
        for number, words in hypotheses(study).items()
    ]


def _counted(answers: Sequence[str]) -> str:
    """'yes' where all answers are, else how many have each."""
    found = Counter(answers)
    return ", ".join(word if len(found) == 1 else f"{found[word]} {word}" for word in ANSWERS if found[word]) or "-"
