"""What a result file holds, as `wsnsim info FILE` shows it.

info(path) -> dict        info_text(path) -> str
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.base.tables import TABLES
from wsnsim.recording import attributes, read_table, read_text, tables

FIGURES: Final = {
    "rmse": ("RMSE of a run", "{:.3f}"),
    "median_error": ("median error", "{:.3f}"),
    "lost": ("runs that lost a track", "{:.1%}"),
    "energy": ("energy", "{:.4g} J"),
    "handovers": ("handovers", "{:.1f}"),
    "frames_sent": ("frames sent", "{:.0f}"),
    "frames_lost": ("frames lost", "{:.0f}"),
    "packets_sent": ("packets sent", "{:.0f}"),
    "cycles": ("operations", "{:,.0f}"),
    "alive": ("nodes alive", "{:.1f}"),
    "cpu_seconds": ("processor time", "{:.2f} s"),
}
"""Which columns of `runs` sum a file up, with the words and the form that a terminal shows."""
OF_POSITION: Final = tuple(column.name for column in TABLES["runs"] if column.of_position)
"""Which of them have the position's unit, that the file alone knows."""
OF_NETWORK: Final = ("handovers", "frames_lost", "alive")
"""Which of them say nothing of a scenario without a network, where no energy is spent."""


def info(path: str | Path) -> dict[str, Any]:
    """What a result file is about, without reading its long tables.

    Keys: file, bytes, status, schema_version, wsnsim_version, name, seed, replicates, tables ({name: {rows, columns,
    bytes}}), figures (means of `runs`; `lost` is the fraction of runs that lost a track), position_unit, fingerprints,
    provenance.
    """
    root = attributes(path)
    sizes = tables(path)
    scenario = _json(path, "scenario/resolved_json")
    runs = read_table(path, "runs") if "runs" in sizes else {}
    return {
        "file": str(path),
        "bytes": Path(path).stat().st_size,
        "status": root["status"],
        "schema_version": root["schema_version"],
        "wsnsim_version": root["wsnsim_version"],
        "name": scenario.get("name"),
        "seed": scenario.get("seed"),
        "replicates": len(runs["replicate"]) if runs else None,
        "tables": {
            name: {"rows": size.rows, "columns": list(size.columns), "bytes": size.stored_bytes}
            for name, size in sizes.items()
        },
        "figures": _figures(runs),
        "position_unit": _position_unit(root),
        "fingerprints": [f"{value:016x}" for value in runs.get("fingerprint", ())],
        "provenance": _json(path, "provenance_json"),
    }


def info_text(path: str | Path) -> str:
    """The same for a terminal."""
    about = info(path)
    scenario = f"{about['name']}, seed {about['seed']}" if about["name"] else "(not stored)"
    runs = "" if about["replicates"] is None else f", {about['replicates']} replicate{'s' * (about['replicates'] != 1)}"
    lines = [
        f"{about['file']}: {about['status']}, {_size(about['bytes'])}",
        f"scenario     {scenario}{runs}",
        *_provenance_lines(about["provenance"], about["wsnsim_version"]),
        "",
        *_table_lines(about["tables"]),
    ]
    if about["figures"]:
        lines += ["", *_figure_lines(about["figures"], about["position_unit"])]
    if len(about["fingerprints"]) == 1:
        lines.append(f"{'fingerprint':<25}{about['fingerprints'][0]}")
    return "\n".join(lines)


def _json(path: str | Path, name: str) -> dict[str, Any]:
    """One of the file's JSON texts; empty if the file holds none, as a run killed early leaves it."""
    try:
        return json.loads(read_text(path, name))
    except ResultError:
        return {}


def _figures(runs: dict[str, np.ndarray]) -> dict[str, float]:
    """Means over the runs of the file; those of a column that is nowhere known are left out."""
    known = {name: runs[name][np.isfinite(runs[name])] for name in FIGURES if name in runs}
    means = {name: float(values.mean()) for name, values in known.items() if values.size}
    left_out = () if "energy" in means else OF_NETWORK
    return {name: mean for name, mean in means.items() if name not in left_out}


def _position_unit(root: dict[str, Any]) -> str:
    """The unit of the errors; metres in a file that does not say which columns are the position."""
    return root["states"][root["position"][0]][1] if root["position"] else "m"


def _figure_lines(figures: dict[str, float], unit: str) -> list[str]:
    lines = []
    for name, value in figures.items():
        words, form = FIGURES[name]
        lines.append(f"{words:<25}{form.format(value)}{f' {unit}' if name in OF_POSITION else ''}".rstrip())
    return lines


def _provenance_lines(made: dict[str, Any], version: str) -> list[str]:
    if not made:
        return [f"made by      wsnsim {version}"]
    commit = made.get("git") or {}
    tree = f" (commit {commit['commit'][:12]}{', changed' * commit['dirty']})" if commit else ""
    versions = made.get("packages", {})
    return [
        f"made by      wsnsim {version}{tree}, Python {made.get('python')}, NumPy {versions.get('numpy')}",
        f"command      {made.get('command_line')}",
        f"from, to     {made.get('start')}, {made.get('end', 'not ended')}",
        f"machine      {made.get('platform')} ({' '.join(made.get('cpu_features', []))})",
    ]


def _table_lines(sizes: dict[str, dict[str, Any]]) -> list[str]:
    rows = [
        (name, f"{size['rows']:,}", str(len(size["columns"])), _size(size["bytes"])) for name, size in sizes.items()
    ]
    return [
        f"{name:<13}{count:>12}{wide:>9}{stored:>12}"
        for name, count, wide, stored in [("table", "rows", "columns", "stored"), *rows]
    ]


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} B" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"
