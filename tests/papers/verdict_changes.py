"""The verdicts on the papers' main rows and claims in two revisions, with the reason of each change, as Markdown.

python -m tests.papers.verdict_changes OLD [NEW]      two git revisions; without NEW, the pages as they are

The outcome is that of the newer page's table of claims; what is derived does not count, whatever its verdict.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.readme_results import PAPERS, shown_rows

HOME = Path(__file__).parents[2]
HEADS = ("paper", "number or order", "variant", "published", "before", "after", "outcome", "reason")
UNKNOWN = "-"


class Claimed(NamedTuple):
    """What a revision's page says of a main row: published and measured value, verdict, and whether it counts."""

    published: str
    measured: str
    verdict: str
    experiment: str


def text_of(name: str, revision: str) -> str:
    """The page of a paper in a revision; as it is in the folder if none is named."""
    path = f"docs/papers/{name}.md"
    if not revision:
        return (HOME / path).read_text(encoding="utf-8")
    return subprocess.run(
        ["git", "show", f"{revision}:{path}"], cwd=HOME, capture_output=True, text=True, check=True
    ).stdout


def claims(name: str, text: str) -> dict[tuple[str, ...], Claimed]:
    """{(experiment, quantity, variant): what is said}; of an order, whose second row is not counted, the first row."""
    found: dict[tuple[str, ...], Claimed] = {}
    for row in shown_rows(name, text):
        cells = row.cells
        if cells["verdict"] not in ("not published", "not judged"):
            said = Claimed(cells.get("published", UNKNOWN), cells["measured [95 %]"], cells["verdict"], row.experiment)
            found.setdefault((row.experiment, unplaced(row.quantity), cells["variant"]), said)
    return found


def unplaced(quantity: str) -> str:
    """A quantity without its place, which may be corrected between revisions."""
    return quantity.rpartition(" (")[0] or quantity


def outcomes(text: str) -> dict[tuple[str, str], str]:
    """{(quantity without its place, variant): outcome, and what it is counted among} of a page's table of claims."""
    _, _, after = text.replace("\\", "").partition("### Claims of ")
    rows = [
        line.strip("| ").split(" | ")
        for line in after.partition("Verdicts on")[0].splitlines()
        if line.startswith("| ")
    ]
    return {(unplaced(row[0]), row[1]): f"{row[-1]}, {row[2]}" for row in rows[2:]}


def reason(old: Claimed | None, new: Claimed | None) -> str:
    """Why two revisions say something else."""
    if old is None:
        return "new reading, or new main row"
    if new is None:
        return "no longer a main row"
    if old.published != new.published:
        return "the published value is read differently"
    return "new runs" if old.measured != new.measured else "counting rule"


def changes(old: str, new: str) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each main row whose verdict differs or no longer counts, and of those that are new or gone."""
    for name in PAPERS:
        texts = [text_of(name, revision) for revision in (old, new)]
        (before, after), now = (claims(name, text) for text in texts), outcomes(texts[1])
        for key in dict.fromkeys([*before, *after]):
            one, two = before.get(key), after.get(key)
            counted = now.get(key[1:], UNKNOWN)
            if one is None or two is None or one.verdict != two.verdict or "derived" in counted:
                published = next(each.published for each in (two, one) if each)
                said = [each.verdict if each else UNKNOWN for each in (one, two)]
                yield name, f"{key[0]}: {key[1]}", key[2], published, *said, counted, reason(one, two)


def counts(revision: str) -> Iterator[str]:
    """Yield the lines that count the claims of each paper in a revision."""
    for name in PAPERS:
        lines = text_of(name, revision).splitlines()
        yield from (line for line in lines if line.startswith(f"- {name}: ") and "not counted, " not in line)


def main(revisions: Sequence[str]) -> None:
    """Print the counts of both revisions and the table of changes."""
    old, new = (*revisions, "")[:2]
    print(
        f"Before ({old}):\n", *counts(old), f"\nAfter ({new or 'the pages as they are'}):\n", *counts(new), "", sep="\n"
    )
    for row in (HEADS, ("---",) * len(HEADS), *changes(old, new)):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
