"""The size of the package: code lines and files of each part, and how many of its modules a run imports.

    python -m tests.size

Blank lines, comments and docstrings are not counted. Tables of text in `wsnsim/` and the studies in `scenarios/` are
data, and stand in rows of their own.
"""

from __future__ import annotations

import ast
import itertools
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

HOME = Path(__file__).parents[1]
DATA = (".pyi", ".table", ".yaml", ".json", ".csv", ".css", ".js", ".html")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(text: str) -> int:
    """The lines of a module without blank lines, comments and docstrings."""
    lines = {number for number, line in enumerate(text.splitlines(), 1) if line.strip()[:1] not in ("", "#")}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(lines)


def sizes(paths: Iterable[Path]) -> tuple[int, int]:
    """(files, code lines) of modules."""
    counted = [code_lines(path.read_text(encoding="utf-8")) for path in paths]
    return len(counted), sum(counted)


def imported_by_a_run() -> Counter[str]:
    """How many modules of each package one step of the shipped scenario imports."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["run", "scenarios/pso_mhpf.yaml", "--set", "duration=0.08 s", "--out", f"{folder}/one.h5"]
        code = f"import sys, wsnsim.cli; wsnsim.cli.main({words}); print(*sys.modules)"
        ended = subprocess.run([sys.executable, "-c", code], cwd=HOME, capture_output=True, text=True, check=True)
    names = [name for name in ended.stdout.splitlines()[-1].split() if name.partition(".")[0] == "wsnsim"]
    return Counter(_part(name.split(".")) for name in names)


def main() -> None:
    """Print a row for each part, and their sums."""
    parts: dict[str, list[Path]] = {}
    for path in sorted((HOME / "wsnsim").rglob("*.py")):
        parts.setdefault(_part(path.relative_to(HOME).parts), []).append(path)
    imported = imported_by_a_run()
    print(f"{'':18}  files  code lines  imported by a run")
    for part, paths in parts.items():
        files, lines = sizes(paths)
        print(f"{part:18}{files:7}{lines:12,}{imported[part]:19}")
    files, lines = sizes(itertools.chain.from_iterable(parts.values()))
    print(f"{'together':18}{files:7}{lines:12,}{imported.total():19}")
    files, lines = sizes((HOME / "scenarios").rglob("*.py"))
    print(f"{'scenarios, Python':18}{files:7}{lines:12,}")
    data = [path for path in (HOME / "wsnsim").rglob("*") if path.suffix in DATA]
    print(f"{'wsnsim, data':18}{len(data):7}{sum(path.read_text('utf-8').count(chr(10)) for path in data):12,}")


def _part(names: Sequence[str]) -> str:
    """The package of a module, or 'wsnsim' for those that are in none."""
    return names[1] if len(names) > 2 or ((HOME / "wsnsim" / names[-1]).is_dir() and len(names) > 1) else "wsnsim"


if __name__ == "__main__":
    main()
