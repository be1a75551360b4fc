"""The tables and the figure of docs/performance.md, from the rows of a benchmark.

    make bench; python -m tests.bench.page --new results/bench.json --old OLDER.json    take these rows, then write
    python -m tests.bench.page                                                         write from docs/performance.json

`OLDER.json` holds the rows that the same benchmark gave in an older tree; rows are matched by name.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HOME = Path(__file__).parents[2]
ROWS, PAGE, FIGURE = (HOME / "docs" / name for name in ("performance.json", "performance.md", "performance.png"))
TITLES = {
    "lossy": "The radio alone: beacons",
    "seam": "One run of PSO-MHPF",
    "filters": "The bootstrap filter against C",
    "batch": "Many runs of a filter without a network",
    "startup": "Start-up",
    "sleeping": "Networks that sleep",
    "scale": "Large fields",
    "campaigns": "Campaigns",
    "results": "Results of large campaigns",
    "trackers": "Trackers",
    "scenarios": "Every shipped scenario",
}
"""Groups of `tests.bench.measures.GROUPS` that the page shows, in its order."""
RECEPTION = re.compile(r"beacons, (?P<radio>.+), N=(?P<nodes>\d+): CPU a reception in range")
"""Names of the rows that the figure shows."""
Row = dict[str, Any]


def merged(new: list[Row], old: list[Row]) -> list[Row]:
    """The rows of `new`, each with `before`: the value of the row of that name in `old`, None where there is none."""
    values = {row["name"]: row["value"] for row in old}
    return [row | {"before": values.get(row["name"])} for row in new]


def bounded(rows: list[Row]) -> str:
    """The table of the rows that have a bound and are of a group that the page shows: before, now, bound, verdict."""
    lines = ["| what | before | now | bound | |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        if row["group"] in TITLES and (row["bound"] is not None or row["at_least"] is not None):
            within = {True: "kept", False: "**missed**", None: "not measured"}[row["within"]]
            lines.append(
                f"| {_words(row)} | {number(row['before'])} | {number(row['value'])} | {limit(row)} | {within} |"
            )
    return "\n".join(lines)


def measured(rows: list[Row], group: str) -> str:
    """The table of a group's rows: before, now, and the note."""
    lines = ["| what | before | now | note |", "| --- | --- | --- | --- |"]
    chosen = [row for row in rows if row["group"] == group]
    cells = [f"| {_words(row)} | {number(row['before'])} | {number(row['value'])} | {row['note']} |" for row in chosen]
    return "\n".join(lines + cells)


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
    tables = [f"### {title}\n\n{measured(rows, group)}" for group, title in TITLES.items() if _has(rows, group)]
    return {"machine": document["machine"], "bounds": bounded(rows), "rows": "\n\n".join(tables)}


def _has(rows: list[Row], group: str) -> bool:
    return any(row["group"] == group for row in rows)


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
    draw(document["rows"], FIGURE)


if __name__ == "__main__":
    main()
