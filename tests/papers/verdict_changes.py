"""The verdicts on the rows of the papers in two revisions, with the reason of each change, as Markdown.

python -m tests.papers.verdict_changes OLD [NEW]      two git revisions; without NEW, the files as they are
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterator, Sequence

import pandas as pd

from tests.readme_results import DOCS, PAPERS, rows_of

KEYS = ["experiment", "quantity", "variant"]
COLUMNS = [*KEYS, "kind", "counted", "paired", "published", "measured", "verdict"]
HEADS = ("paper", "experiment", "quantity", "variant", "before", "after", "counted among", "reason")


def rows(name: str, revision: str) -> pd.DataFrame:
    """The rows of a paper in a revision; as they are in the folder if none is named."""
    if not revision:
        return pd.read_csv(rows_of(name))
    command = ["git", "show", f"{revision}:docs/papers/{name}.csv"]
    answer = subprocess.run(command, cwd=DOCS.parent, capture_output=True, text=True, check=True)
    return pd.read_csv(io.StringIO(answer.stdout))


def reason(row: pd.Series) -> str:
    """Why two revisions say something else."""
    if row["_merge"] != "both":
        return "new row" if row["_merge"] == "right_only" else "no longer a row"
    if row["published_old"] != row["published_new"] and pd.notna(row["published_new"]):
        return "the published value is read differently"
    return "new runs" if row["measured_old"] != row["measured_new"] else "rule"


def changes(old: str, new: str) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each row whose verdict differs, and of those that are new or gone."""
    for name in PAPERS:
        before, after = (rows(name, revision)[COLUMNS].query("not paired") for revision in (old, new))
        both = before.merge(after, "outer", KEYS, suffixes=("_old", "_new"), indicator=True)
        for _, row in both[both["verdict_old"] != both["verdict_new"]].iterrows():
            kind = row["kind_new"] if row["counted_new"] is True else "-"
            said = [str(row[key]) for key in (*KEYS, "verdict_old", "verdict_new")]
            yield name, *said, kind, reason(row)


def main(revisions: Sequence[str]) -> None:
    """Print the table of changes."""
    old, new = (*revisions, "")[:2]
    for row in (HEADS, ("---",) * len(HEADS), *changes(old, new)):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
