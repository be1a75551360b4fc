"""Whether a result is reproducible: its scenario is run again and the results are compared.

verify(path) -> Verification
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of, rerun_source
from wsnsim.recording import provenance, read_table, read_text, tables
from wsnsim.scenario import build, load


@dataclass(frozen=True)
class Verification:
    """Whether a result is reproducible; one row per run."""

    ok: bool
    text: str
    rows: tuple[Mapping[str, Any], ...]


def verify(path: Path) -> Verification:
    """Run a result's scenario again, and compare fingerprints, estimates and energy of every run.

    With the same CPU features and package versions all bits must be equal. Otherwise values are compared with a
    relative tolerance of 1e-6, and the text says so: NumPy's logarithm and exponential differ in the last bit between
    CPUs.
    """
    resolved = rerun_source(path)
    parts = build(load(resolved))
    stored = json.loads(read_text(path, "provenance_json"))
    here = provenance("", parts.seed)
    differing = _differing(stored, here)
    runs = read_table(path, "runs")
    kept = read_table(path, "estimates") if "estimates" in tables(path) else {}
    rows = []
    for index, replicate in enumerate(runs["replicate"].tolist()):
        memory = Memory({"estimates": True})
        again = replicate_of(parts, replicate, memory).run
        before = {name: column[kept["replicate"] == replicate] for name, column in kept.items()}
        rows.append(_compare(replicate, {name: column[index] for name, column in runs.items()}, again, before, memory))
    ok = all(row["equal"] or (bool(differing) and row["close"]) for row in rows)
    return Verification(ok, _verification_text(Path(path), rows, differing, _commits(stored, here), ok), tuple(rows))


def _compare(
    replicate: int, before: Mapping[str, Any], again: Mapping[str, Any], kept: Mapping[str, Any], memory: Memory
) -> dict[str, Any]:
    """The row of one run: whether everything is equal, and whether it is close."""
    pairs: list[tuple[Any, Any]] = [
        (kept[name], column) for name, column in memory.table("estimates").items() if name in kept
    ]
    pairs += [(before[name], again[name]) for name in ("energy", "rmse")]
    # A file of an earlier version has no `event_fingerprint`: its `fingerprint` was that of the events.
    again_name = "fingerprint" if "event_fingerprint" in before else "event_fingerprint"
    stored, repeated = int(before["fingerprint"]), int(again[again_name])
    equal = all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
    close = all(
        np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=1e-6, atol=1e-9, equal_nan=True) for a, b in pairs
    )
    return {
        "replicate": replicate,
        "fingerprint": stored,
        "again": repeated,
        "equal": stored == repeated and equal,
        "close": close,
    }


def _differing(stored: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Names of what differs between the origin of a result and this one, and can change the last bit."""
    names = {"python": "Python", "packages": "packages", "cpu_features": "CPU features"}
    found = [word for name, word in names.items() if stored.get(name) != here.get(name)]
    if stored.get("engine") == "batch" and any(kind.startswith("tracker ") for kind in stored.get("plugins", ())):
        found.append("engine")  # the whole runs of a plug-in are close to composed runs, not equal
    return found


def _commits(stored: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """A line with both commits if another commit origin the result; it does not excuse a difference."""
    before, now = ((origin.get("git") or {}).get("commit", "no checkout")[:12] for origin in (stored, here))
    return f"  made by commit {before}, run again by {now}" if before != now else ""


def _verification_text(path: Path, rows: list[dict[str, Any]], differing: list[str], commits: str, ok: bool) -> str:
    lines = [f"{path}: " + ("repeats" if ok else "DOES NOT REPEAT")]
    lines += [commits] if commits else []
    if differing:
        lines.append(f"  origin with other {' and '.join(differing)}: compared to 1e-6 instead of to the last bit")
    for row in rows:
        verdict = "equal" if row["equal"] else "close" if row["close"] else "different"
        lines.append(
            f"  replicate {row['replicate']}: {verdict}, fingerprint {row['fingerprint']:016x} / {row['again']:016x}"
        )
    return "\n".join(lines)
