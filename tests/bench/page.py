"""The tables and the figure of docs/performance.md, and docs/performance.csv, from the rows of a benchmark.

    make bench; python -m tests.bench.page --new results/bench.json --old OLDER.json    take these rows, then write
    python -m tests.bench.page                                                         write from docs/performance.json

`OLDER.json` holds the rows that the same benchmark gave in an older tree; rows are matched by name.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HOME = Path(__file__).parents[2]
ROWS, PAGE, TABLE, FIGURE = (HOME / "docs" / f"performance.{ending}" for ending in ("json", "md", "csv", "png"))
GROUPS = ("lossy", "seam", "filters", "batch", "startup", "sleeping", "scale", "campaigns", "results", "scenarios")
"""Groups of `tests.bench.measures.GROUPS` whose rows are published."""
SHOWN = (
    *(f"{name}: CPU of one run"
      for name in ("pso_mhpf", "pso_mhpf_real", "jiang_field", "gmtt", "field_1m", "beacons")),
    "10,000 standalone runs of the bootstrap filter (ungm_pf), batch over composed",
    "first run after installation ready within, wall",
    "the same with kernels cached, wall",
    "wsnsim run field_1m, memory in all",
    "beacons, log-normal, N=400: ours / ns-3's receptions a CPU second",
)  # fmt: skip
"""Names of the rows that the page shows."""
RECEPTION = re.compile(r"beacons, (?P<radio>.+), N=(?P<nodes>\d+): CPU a reception in range")
"""Names of the rows that the figure shows."""
Row = dict[str, Any]


def merged(new: list[Row], old: list[Row]) -> list[Row]:
    """The rows of `new`, each with `before`: the value of the row of that name in `old`, None where there is none."""
    values = {row["name"]: row["value"] for row in old}
    return [row | {"before": values.get(row["name"])} for row in new]


def bounded(rows: list[Row]) -> str:
    """How many bounds are kept, and the table of the rows that miss theirs."""
    judged = [row for row in rows if row["group"] in GROUPS and row["within"] is not None]
    missed = [row for row in judged if not row["within"]]
    lines = [f"Of {len(judged)} bounds, {len(judged) - len(missed)} are kept. These are missed:", ""]
    lines += ["| what | before | now | bound |", "| --- | --- | --- | --- |"]
    for row in missed:
        lines.append(f"| {_words(row)} | {number(row['before'])} | {number(row['value'])} | {limit(row)} |")
    return "\n".join(lines)


def measured(rows: list[Row]) -> str:
    """The table of the rows that the page shows."""
    found = {row["name"]: row for row in rows}
    lines = ["| what | now | note |", "| --- | --- | --- |"]
    lines += [f"| {_words(row)} | {number(row['value'])} | {row['note']} |" for row in map(found.get, SHOWN) if row]
    return "\n".join(lines)


def table(rows: list[Row]) -> str:
    """All published rows as CSV."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(["group", "what", "before", "now", "unit", "bound", "kept", "note"])
    for row in rows:
        if row["group"] in GROUPS:
            values = (f"{value:.6g}" if value is not None else "" for value in (row["before"], row["value"]))
            kept = {True: "yes", False: "no", None: ""}[row["within"]]
            lines.writerow([row["group"], row["name"].strip(), *values, row["unit"], limit(row), kept, row["note"]])
    return text.getvalue()


def number(value: float | None) -> str:
    """A value with three significant digits, from ten thousand on with commas; `-` for none."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def limit(row: Row) -> str:
    """What a row's value should be."""
    parts = [] if row["bound"] is None else [f"≤ {number(row['bound'])}"]
    return ", ".join(parts + ([] if row["at_least"] is None else [f"≥ {number(row['at_least'])}"]))


def _words(row: Row) -> str:
    name = row["name"].strip()
    unit = f", {row['unit']}" if row["unit"] and not name.endswith(row["unit"]) else ""
    return f"{name}{unit}".replace("|", "\\|")


def blocks(document: Row) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    rows = document["rows"]
    return {"machine": document["machine"], "bounds": bounded(rows), "rows": measured(rows)}


def spliced(text: str, name: str, block: str) -> str:
    """A page with one of its blocks replaced. Raises ValueError if it has no such block, or several."""
    pattern = re.compile(f"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    found, count = pattern.subn(lambda mark: f"{mark[1]}{block}\n{mark[2]}", text)
    if count != 1:
        raise ValueError(f"the page has {count} blocks called {name}")
    return found


def write_blocks(page: Path, blocks: Mapping[str, str]) -> None:
    """Replace blocks of a page, by name."""
    text = page.read_text(encoding="utf-8")
    for name, block in blocks.items():
        text = spliced(text, name, block)
    page.write_text(text, encoding="utf-8")


def curves(rows: list[Row], key: str = "value") -> dict[str, list[tuple[int, float]]]:
    """{radio: (nodes, cost of a reception in timeouts) in ascending order}, now or `before`."""
    found: dict[str, list[tuple[int, float]]] = {}
    for row in rows:
        if (match := RECEPTION.match(row["name"])) and row[key] is not None:
            found.setdefault(match["radio"], []).append((int(match["nodes"]), row[key]))
    return {radio: sorted(points) for radio, points in found.items()}


def draw(rows: list[Row], file: Path) -> None:
    """Draw what a reception costs against the number of nodes, a line a radio; dashed: before."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    before = curves(rows, "before")
    for order, (radio, points) in enumerate(curves(rows).items()):
        axes.plot(*zip(*points, strict=True), marker="o", markersize=4, color=f"C{order}", label=radio)
        if radio in before:
            axes.plot(*zip(*before[radio], strict=True), "--", color=f"C{order}", alpha=0.6)
    sizes = sorted({nodes for points in curves(rows).values() for nodes, _ in points})
    axes.set(xscale="log", yscale="log", xlabel="nodes", ylabel="CPU a reception [bare SimPy timeouts]")
    axes.set_xticks(sizes, [f"{nodes:,}" for nodes in sizes], minor=False)
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(frameon=False, title="solid: now, dashed: before", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.savefig(file, dpi=110, metadata={"Software": None})


def main() -> None:
    """Take rows if files of them are given, then write the page's blocks and its figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.page", description=__doc__.splitlines()[0])
    parser.add_argument("--new", type=Path, help="rows of this tree, as make bench writes them")
    parser.add_argument("--old", type=Path, help="rows of an older tree")
    options = parser.parse_args()
    if options.new:
        new = json.loads(options.new.read_text(encoding="utf-8"))
        old = json.loads(options.old.read_text(encoding="utf-8"))["rows"] if options.old else []
        document = {"machine": new["machine"], "rows": merged(new["rows"], old)}
        ROWS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    document = json.loads(ROWS.read_text(encoding="utf-8"))
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks(document).items():
        text = spliced(text, name, block)
    PAGE.write_text(text, encoding="utf-8")
    TABLE.write_text(table(document["rows"]), encoding="utf-8")
    draw(document["rows"], FIGURE)


if __name__ == "__main__":
    main()
