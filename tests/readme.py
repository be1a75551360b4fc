"""The README's tables of results anew: `make readme`, from campaigns in results/reproduce and results/readme.

python -m tests.readme                          runs what is missing: two hours on two cores if nothing is there
python -m tests.readme commercial_radio         these blocks only: papers, li2012, frontier, run_times, or a table
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import wsnsim
from tests.readme_tables import TABLES
from wsnsim.papers.paper import PAGES

HOME = Path(__file__).parents[1]
BLOCK = r"(<!-- {name}: made by make readme -->\n).*?(<!-- end of {name} -->)"
BLOCKS = {
    "papers": ("jiang2013", "liu2012", "wei2022", "ruan2020", "--full"),
    "li2012": ("li2012", "--full"),
    "frontier": ("frontier", "--full", "--only", "frontier"),
}
REGISTERED = "- registered "
"""How lines with answers to hypotheses begin: docs/frontier.md has these."""
CAMPAIGNS = HOME / "results/reproduce/full"
TIMES = "run_times"
PICTURES = ("jiang2013_figure_9.png", "frontier_frontier.png")


def told(*words: str) -> str:
    """What `wsnsim reproduce` answers as Markdown."""
    command = [sys.executable, "-m", "wsnsim", "reproduce", "--markdown", *words]
    said = subprocess.run(command, cwd=HOME, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()
    return "\n".join(line for line in said.splitlines() if not line.startswith(REGISTERED))


def table(name: str) -> str:
    """A table of `readme_tables`, from its campaign, whose missing runs are made. Equal commands share a campaign."""
    words, made = TABLES[name]
    folder = HOME / "results/readme" / next(key for key, (command, _) in TABLES.items() if command == words)
    command = [sys.executable, "-m", "wsnsim", *words, "--out", str(folder)]
    subprocess.run(command, cwd=HOME, stdout=subprocess.DEVNULL, check=True)
    return made(wsnsim.read(folder, "tracks"), wsnsim.read(folder, "runs"))


def run_times() -> str:
    """A row per paper: the command that reproduces it, its runs, and the processor time that they took."""
    rows = ["| command | experiments | Monte Carlo runs | processor time of the runs |", "| --- | --- | --- | --- |"]
    for page in PAGES:
        folders = sorted(place.parent for place in (CAMPAIGNS / page).glob("*/campaign.json"))
        runs = [wsnsim.read(folder, "runs", ["replicate", "cpu_seconds"]) for folder in folders]
        minutes = sum(run["cpu_seconds"].sum() for run in runs) / 60.0
        command = f"`wsnsim reproduce {page} --full`"
        rows.append(f"| {command} | {len(folders)} | {sum(map(len, runs)):,} | {minutes:.1f} min |")
    return "\n".join(rows)


def spliced(text: str, name: str, block: str) -> str:
    """The README with a block replaced. Raises ValueError if it has no such block."""
    pattern = re.compile(BLOCK.format(name=name), re.DOTALL)
    found, count = pattern.subn(lambda mark: f"{mark[1]}{block}\n{mark[2]}", text)
    if count != 1:
        raise ValueError(f"README.md has {count} blocks called {name}")
    return found


def main(names: Sequence[str]) -> None:
    """Write blocks of README.md and the pictures that it shows; all if none is named."""
    readme, figures = HOME / "README.md", HOME / "results/figures"
    drawn = ("--figures", str(figures))
    for name in names or (*BLOCKS, *TABLES, TIMES):
        block = run_times() if name == TIMES else table(name) if name in TABLES else told(*BLOCKS[name], *drawn)
        readme.write_text(spliced(readme.read_text(encoding="utf-8"), name, block), encoding="utf-8")
    for picture in () if names else PICTURES:
        shutil.copyfile(figures / picture, HOME / "docs" / picture)


if __name__ == "__main__":
    main(sys.argv[1:])
