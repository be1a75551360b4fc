"""What a result file holds, as `wsnsim info FILE` shows it.

info(path) -> dict        info_text(path) -> str
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wsnsim.analysis.answer import answer
from wsnsim.analysis.phrases import fitting, wrapped
from wsnsim.analysis.plot_data import stored_json
from wsnsim.analysis.quantities import QUANTITIES, beside, medians, name_of, values, worth_showing
from wsnsim.analysis.result_facts import ResultFacts, facts_of_file
from wsnsim.base.errors import counted
from wsnsim.base.results import COUNTS, FILES, ROWS
from wsnsim.recording import attributes, read_table, tables


def info(path: str | Path, plugins: bool = False, facts: ResultFacts | None = None) -> dict[str, Any]:
    """The contents of a result file; of its long tables, only the errors are read.

    `plugins` says whether plug-ins that the result's scenario names are imported for the bound in the answer. `facts`
    are those of the file, if they are already known.

    Keys: file, answer (see `answer.answer`; '' if no run has finished), bytes, status, schema_version, wsnsim_version,
    name, seed, replicates, tables ({name: {rows, columns, bytes}}), figures ({key of `quantities.QUANTITIES`: value}),
    medians (see `quantities.medians`),
    position_unit, fingerprints, provenance.
    """
    root, sizes, facts = attributes(path), tables(path), facts or facts_of_file(path)
    scenario = stored_json(path, "scenario/resolved_json")
    runs = read_table(path, "runs") if "runs" in sizes else {}
    return {
        "file": str(path),
        "answer": answer(path, plugins=plugins, facts=facts),
        "bytes": Path(path).stat().st_size,
        **{key: root[key] for key in ("status", "schema_version", "wsnsim_version")},
        **{key: scenario.get(key) for key in ("name", "seed")},
        "replicates": len(runs["replicate"]) if runs else None,
        "tables": {
            name: {"rows": size.rows, "columns": list(size.columns), "bytes": size.stored_bytes}
            for name, size in sizes.items()
        },
        "figures": values(facts),
        "medians": medians(facts),
        "position_unit": facts.unit,
        "fingerprints": [f"{value:016x}" for value in runs.get("fingerprint", ())],
        "provenance": stored_json(path, "provenance_json"),
    }


def info_text(path: str | Path, plugins: bool = False) -> str:
    """The contents of a result file for a terminal: the answer in a sentence first."""
    facts = facts_of_file(path)
    about = info(path, plugins, facts)
    scenario = f"{about['name']}, seed {about['seed']}" if about["name"] else "(not stored)"
    runs = "" if about["replicates"] is None else f", {counted(about['replicates'], 'Monte Carlo run')}"
    lines = [
        *wrapped(about["answer"]),
        f"{about['file']}: {about['status']}, {_size(about['bytes'])}",
        f"scenario     {scenario}{runs}",
        *_provenance_lines(about["provenance"], about["wsnsim_version"]),
        "",
        *_table_lines(about["tables"]),
    ]
    if about["figures"]:
        lines += ["", *_figure_lines(facts)]
    if len(about["fingerprints"]) == 1:
        lines.append(f"{'fingerprint':<25}{about['fingerprints'][0]}")
    return fitting(lines, " " * 13)


def _figure_lines(facts: ResultFacts) -> list[str]:
    shown, middles, unit = worth_showing(facts), medians(facts), facts.unit
    names = {key: name_of(key, facts.count) for key in shown}
    width = max(map(len, names.values()), default=0) + 2
    return [
        f"{names[key]:<{width}}{QUANTITIES[key].text(value, unit)}"
        f"  {beside(key, middles, facts.consistent, unit)}".rstrip()
        for key, value in shown.items()
    ]


def _provenance_lines(origin: dict[str, Any], version: str) -> list[str]:
    if not origin:
        return [f"made by      wsnsim {version}"]
    commit = origin.get("git") or {}
    tree = f" (commit {commit['commit'][:12]}{', changed' * commit['dirty']})" if commit else ""
    versions = origin.get("packages", {})
    return [
        f"made by      wsnsim {version}{tree}, Python {origin.get('python')}, NumPy {versions.get('numpy')}",
        f"command      {origin.get('command_line')}",
        f"from, to     {origin.get('start')}, {origin.get('end', 'not ended')}",
        *(["engine       batch: many standalone runs at once"] if origin.get("engine") == "batch" else []),
        f"machine      {origin.get('platform')} ({' '.join(origin.get('cpu_features', []))})",
        *_recorded_lines(origin),
    ]


def _recorded_lines(origin: dict[str, Any]) -> list[str]:
    """The recorded files that the runs read, their digests, and the rows that were left out."""
    counts, rows = origin.get(COUNTS, {}), origin.get(ROWS, [])
    lines = []
    for name, digest in origin.get(FILES, {}).items():
        skipped = f", {counted(counts[name], 'row')} left out" if name in counts else ""
        lines.append(f"recorded     {name} ({digest}){skipped}")
        lines += [f"             {row}" for row in rows if row.startswith(f"{name}:")]
    return lines


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
