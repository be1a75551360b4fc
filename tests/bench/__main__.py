"""`python -m tests.bench [--json FILE] [--quick] [--only GROUP]`: a table on the terminal, and as JSON in a file."""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
from importlib import metadata
from pathlib import Path
from typing import Any

from tests.bench.measures import GROUPS, all_rows


def main() -> None:
    """Measure everything, print a line a figure."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description="wsnsim's benchmark: ratios within one run"
    )
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--only", choices=GROUPS, help="one group of figures")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    options = parser.parse_args()
    rows = []
    for row in all_rows(repeats=3 if options.quick else 9, only=options.only):
        rows.append(row)
        print(line_of(row), flush=True)
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        written = [row | {"value": None if math.isnan(row["value"]) else row["value"]} for row in rows]
        document = {"schema_version": 2, "machine": machine(), "rows": written}
        options.json.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")


def line_of(row: dict[str, Any]) -> str:
    """One figure as a line: name, value, unit, and what it should be."""
    wanted = "" if row["bound"] is None else f"   bound {row['bound']:g}"
    wanted += "" if row["at_least"] is None else f"   at least {row['at_least']:g}"
    verdict = "" if row["within"] is None else f": {'within' if row['within'] else 'MISSED'}"
    note = f"   ({row['note']})" if row["note"] else ""
    return f"{row['name']:<66} {row['value']:>11.4g} {row['unit']}{wanted}{verdict}{note}"


def machine() -> str:
    """The processor, how many of it, and the versions that matter."""
    info = Path("/proc/cpuinfo")
    named = re.search(r"model name\s*: (.*)", info.read_text()) if info.exists() else None
    versions = [f"{name} {metadata.version(name)}" for name in ("numpy", "numba", "simpy", "h5py")]
    who = named[1] if named else platform.machine()
    return f"{who}, {os.cpu_count()} logical cores; Python {platform.python_version()}, {', '.join(versions)}"


if __name__ == "__main__":
    main()
