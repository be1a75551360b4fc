"""Tables of results in docs/papers, the rows beside them, and the results of the README: `make readme`

python -m tests.readme                          runs what is missing: two hours on two cores if nothing is there
python -m tests.readme commercial_radio         these blocks only: one of BLOCKS
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

import wsnsim
from tests.readme_results import (
    COUNTED,
    OUTCOMES,
    PAPERS,
    counted_lines,
    frontier_opening,
    opening,
    outcome_table,
    results,
    rows_of,
)
from tests.readme_tables import TABLES
from wsnsim.papers.study import PAGES, study
from wsnsim.papers.table import CLAIM_MARKS, OTHER_BASES

HOME = Path(__file__).parents[1]
README, DOCS = HOME / "README.md", HOME / "docs"
BLOCK = r"(<!-- {name}: made by make readme -->\n).*?(<!-- end of {name} -->)"
REGISTERED = "- registered "
"""How lines with answers to hypotheses begin: docs/frontier.md and docs/duty_cycles.md have these."""
NOT_COUNTED = re.compile(rf"^\| .* \| (\w+)[^|]* \(({'|'.join(OTHER_BASES)})\) \|$")
"""A row of a claim that is not counted: its outcome, and what it rests on."""
MAIN = {
    "jiang2013": r"\(figure [89]\) \|",
    "li2012": r"300: (median error of steps 1 to 20|median delay at the main node|unnecessary wake-ups[^|,]*) minus ",
}
"""Rows of claims that are not counted and yet shown, since the paper is about them."""
CAMPAIGNS = HOME / "results/reproduce/full"
FIGURES = HOME / "results/figures"
OTHER = "other commits"
"""What is said of experiments whose runs are not here, or were made by several commits."""
COLUMNS = (
    "experiment", "reading", "quantity", "variant", "where", "kind", "counted", "basis", "literal", "paired",
    "published", "read", "measured", "low", "high", "statistic", "replicates", "published_runs",
    "published_runs_assumed", "verdict", "ratio_low", "ratio_high", "undecidable", "bound", "bound_kind", "median",
    "median_low", "median_high", "astray", "astray_low", "astray_high", "lost_fraction", "reacquired", "reason",
    "caution",
)  # fmt: skip
"""Columns of docs/papers/NAME.csv."""
PICTURES = ("jiang2013_figure_9.png",)
Made = Callable[[str], str]


def reproduced(name: str) -> str:
    """A row for each claim of a paper that is counted, as `wsnsim reproduce` gives them; all rows go into a CSV file.

    It also draws the paper's figures.
    """
    command = [sys.executable, "-m", "wsnsim", "reproduce", name, "--full", "--figures", str(FIGURES)]
    rows, said = (
        subprocess.run([*command, form], cwd=HOME, stdout=subprocess.PIPE, text=True, check=True).stdout
        for form in ("--json", "--markdown")
    )
    store_rows(name, json.loads(rows)["rows"])
    store_count(name, said)
    return shortened(name, said)


def store_count(name: str, said: str) -> None:
    """Replace the line of a paper in docs/papers/counted.txt: how many of its claims have each outcome."""
    (line,) = re.findall(rf"^- {name}: .*", said, re.MULTILINE)
    COUNTED.write_text(re.sub(rf"^- {name}: .*", lambda _: line, counted_lines(), flags=re.MULTILINE), encoding="utf-8")


def shortened(name: str, said: str) -> str:
    """The claims of a paper that are counted or MAIN; of the others, how many have each outcome."""
    lines = [line for line in said.splitlines() if not line.startswith((REGISTERED, f"- {name}, "))]
    apart = [line for line in lines if NOT_COUNTED.search(line) and not re.search(MAIN.get(name, "$^"), line)]
    others: dict[str, Counter[str]] = {}
    for found in filter(None, map(NOT_COUNTED.search, apart)):
        others.setdefault(found[2], Counter())[found[1]] += 1
    rows = [line for line in lines if line.startswith("| ") and line not in apart]
    marks = {name, *(mark for mark in CLAIM_MARKS if mark not in "\n".join(rows))}
    notes = [line for line in lines if line.startswith("- ") and line[2:].partition(": ")[0] not in marks]
    for basis, of in others.items():
        outcomes = ", ".join(f"{of[word]} {word}" for word in OUTCOMES if of[word])
        notes.append(f"- ({basis}), not counted, in [{name}.csv]({name}.csv) alone: {outcomes}")
    return "\n".join([*rows, "", *notes])


def store_rows(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write docs/papers/NAME.csv: every row of a paper, with its reading, intervals, verdict and reason."""
    table = pd.DataFrame(rows)[list(COLUMNS)]
    table.to_csv(rows_of(name), index=False, float_format="%.6g", lineterminator="\n")


def table(name: str) -> str:
    """A table of `readme_tables`, from its campaign, whose missing runs are made."""
    words, made = TABLES[name]
    folder = HOME / "results/readme" / name
    command = [sys.executable, "-m", "wsnsim", *words, "--out", str(folder)]
    subprocess.run(command, cwd=HOME, stdout=subprocess.DEVNULL, check=True)
    return made(wsnsim.read(folder, "tracks"), wsnsim.read(folder, "runs"))


def run_times(_: str = "") -> str:
    """A row per paper: the command that reproduces it, its runs, and the processor time that they took; then `commits`.

    What has not been run again keeps its row.
    """
    before = (DOCS / "papers/index.md").read_text(encoding="utf-8").splitlines()
    rows = ["| command | experiments | Monte Carlo runs | processor time of the runs |", "| --- | --- | --- | --- |"]
    for page in PAGES:
        folders = sorted(place.parent for place in (CAMPAIGNS / page).glob("*/campaign.json"))
        if not folders:
            rows += [line for line in before if line.startswith(f"| `wsnsim reproduce {page} --full`")]
            continue
        runs = [wsnsim.read(folder, "runs", ["replicate", "cpu_seconds"]) for folder in folders]
        minutes = sum(run["cpu_seconds"].sum() for run in runs) / 60.0
        command = f"`wsnsim reproduce {page} --full`"
        rows.append(f"| {command} | {len(folders)} | {sum(map(len, runs)):,} | {minutes:.1f} min |")
    return "\n".join([*rows, "", *commits()])


def commits() -> list[str]:
    """A line for each commit that made runs: papers and studies, with their experiments where those differ in it."""
    made: dict[str, list[str]] = {}
    for page in PAGES:
        of: dict[str, list[str]] = {}
        for experiment in study(page).experiments:
            of.setdefault(_commit(CAMPAIGNS / page / experiment.name / "campaign.json"), []).append(experiment.name)
        for commit, names in of.items():
            made.setdefault(commit, []).append(f"`{page}`" + (f" ({', '.join(names)})" if len(of) > 1 else ""))
    return [
        f"- {commit}: {', '.join(names)}" for commit, names in sorted(made.items(), key=lambda each: each[0] == OTHER)
    ]


def _commit(place: Path) -> str:
    """The commit that made all runs of a campaign, or OTHER."""
    found = json.loads(place.read_text(encoding="utf-8")) if place.exists() else {"code_changes": ["not here"]}
    return OTHER if found["code_changes"] else f"commit {found['provenance']['git']['commit'][:7]}"


BLOCKS: dict[str, tuple[Path, Made]] = {
    **{name: (DOCS / f"papers/{name}.md", reproduced) for name in PAPERS},
    "commercial_radio": (DOCS / "papers/commercial_radio.md", table),
    "run_times": (DOCS / "papers/index.md", run_times),
    **{
        f"{name}_counts": (DOCS / f"papers/{name}.md", lambda block: opening(block.removesuffix("_counts")))
        for name in PAPERS
    },
    "outcomes": (DOCS / "papers/index.md", lambda _: outcome_table()),
    "frontier_opening": (DOCS / "frontier.md", lambda _: frontier_opening()),
    "results": (README, lambda _: results()),
}
"""Name -> the file in which a block stands, and the function of its name that makes it; the last read the pages."""


def spliced(text: str, name: str, block: str) -> str:
    """A page with a block replaced. Raises ValueError if it has no such block."""
    pattern = re.compile(BLOCK.format(name=name), re.DOTALL)
    found, count = pattern.subn(lambda mark: f"{mark[1]}{block}\n{mark[2]}", text)
    if count != 1:
        raise ValueError(f"the page has {count} blocks called {name}")
    return found


def main(names: Sequence[str]) -> None:
    """Write blocks and the pictures beside them; all if none is named."""
    for name in names or BLOCKS:
        page, made = BLOCKS[name]
        block = made(name)
        page.write_text(spliced(page.read_text(encoding="utf-8"), name, block), encoding="utf-8")
    for picture in () if names else PICTURES:
        shutil.copyfile(FIGURES / picture, DOCS / picture)


if __name__ == "__main__":
    main(sys.argv[1:])
