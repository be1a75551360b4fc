"""`python -m tests.bench [--json FILE] [--quick]`: a table on the terminal, the same as JSON in a file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tests.bench.measures import all_rows


def main() -> None:
    """Measure everything, print a line a figure."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description="wsnsim's benchmark: ratios within one run"
    )
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    options = parser.parse_args()
    rows = []
    for row in all_rows(repeats=3 if options.quick else 9):
        rows.append(row)
        bound = (
            ""
            if row.get("bound") is None
            else f"   bound {row['bound']:g}: {'within' if row['within'] else 'EXCEEDED'}"
        )
        print(f"{row['name']:<58} {row['value']:>11.4g} {row['unit']}{bound}", flush=True)
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps({"schema_version": 1, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
