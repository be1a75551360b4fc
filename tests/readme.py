"""The README's tables of results anew: `make readme`, from campaigns in results/reproduce.

python -m tests.readme        runs what is missing, which takes an hour and a half on two cores if nothing is there
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

HOME = Path(__file__).parents[1]
BLOCK = r"(<!-- {name}: made by make readme -->\n).*?(<!-- end of {name} -->)"
BLOCKS = {
    "papers": ("jiang2013", "liu2012", "wei2022", "ruan2020", "--full"),
    "li2012": ("li2012", "--quick"),
    "frontier": ("frontier", "--quick"),
}
PICTURES = ("jiang2013_figure_9.png", "frontier_frontier.png")


def told(*words: str) -> str:
    """What `wsnsim reproduce` answers as Markdown."""
    command = [sys.executable, "-m", "wsnsim", "reproduce", "--markdown", *words]
    return subprocess.run(command, cwd=HOME, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


def spliced(text: str, name: str, block: str) -> str:
    """The README with a block replaced. Raises ValueError if it has no such block."""
    pattern = re.compile(BLOCK.format(name=name), re.DOTALL)
    found, count = pattern.subn(lambda mark: f"{mark[1]}{block}\n{mark[2]}", text)
    if count != 1:
        raise ValueError(f"README.md has {count} blocks called {name}")
    return found


def main() -> None:
    """Write README.md and the pictures that it shows."""
    readme, figures = HOME / "README.md", HOME / "results/figures"
    text = readme.read_text(encoding="utf-8")
    for name, words in BLOCKS.items():
        text = spliced(text, name, told(*words, "--figures", str(figures)))
    readme.write_text(text, encoding="utf-8")
    for picture in PICTURES:
        shutil.copyfile(figures / picture, HOME / "docs" / picture)


if __name__ == "__main__":
    main()
