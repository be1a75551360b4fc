"""The fingerprint of a shipped scenario: digests of its tables, its metrics, and how two of them compare.

A fingerprint belongs to a kind of processor and to the versions of Python and of the numerical libraries. With the same
ones, every bit of every table is compared. Elsewhere, the metrics are compared to a tolerance.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import tempfile
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NamedTuple

from tests.result_digests import SHORTER, column_digests

FOLDER: Final = Path(__file__).parent
SCENARIOS: Final = FOLDER.parents[1] / "scenarios"
SEED: Final = 1
DURATIONS: Final = SHORTER
"""Scenarios that are run for a shorter time than they say."""
LIBRARIES: Final = ("numpy", "scipy", "numba", "llvmlite")
NO_METRICS: Final = ("replicate", "seed", "cpu_seconds", "fingerprint", "event_fingerprint")
"""Columns of `runs` that are no metrics."""
TOLERANCE: Final = 1e-6
"""Largest relative difference of a metric between kinds of processors: with AVX2 instead of AVX-512 it is 3e-9."""
SENSITIVE: Final = {"indoor_gsa_gpf": 0.5, "indoor_surrogate": 0.3, "ungm_cs_pf": 0.3, "ungm_ics_pf": 0.3}
"""The same of scenarios in which a last bit decides which particle is drawn. Between two generations of a processor it
is 0.25, 0.08, less than 1e-6 and less than 1e-6, with AVX2 0.06, less than 1e-6, less than 1e-6 and 0.02, with kernels
for a generic processor 0.37, less than 1e-6, 0.02 and less than 1e-6."""
NOT_OF_SENSITIVE: Final = ("nees", "nees_median", "singular", "lost", "losses", "lost_share", "time_lost", "reacquired")
"""Metrics of these scenarios that are not compared on other processors, since one rounding error can change them."""
COLLAPSED: Final = 1e6
"""A NEES above this is that of a cloud that has collapsed: of 1e38, no digit repeats elsewhere."""


class Machine(NamedTuple):
    """What decides the last bits: the kind of processor, and the versions of Python and of the libraries."""

    kind: str
    versions: Mapping[str, str]


def shipped() -> list[str]:
    """The names of the shipped scenarios, those that only a paper's study runs included."""
    return sorted(_paths())


def _paths() -> dict[str, Path]:
    """{name: file} of these scenarios."""
    files = [*SCENARIOS.glob("*.yaml"), *SCENARIOS.glob("papers/*/*.yaml")]
    return {path.stem: path for path in files if path.name != "study.yaml"}


def this_machine() -> Machine:
    """The machine of this process; of its kind are all with the same architecture and instruction sets."""
    from wsnsim.recording.provenance import cpu_features

    versions = {"python": ".".join(platform.python_version_tuple()[:2])} | {name: version(name) for name in LIBRARIES}
    return Machine(" ".join([platform.machine(), *cpu_features()]), versions)


def measured(name: str) -> dict[str, Any]:
    """{'tables': {table: digest}, 'metrics': {column of runs: value}} of one run of a shipped scenario."""
    import wsnsim

    overrides = [f"seed={SEED}", "record.events=true", "record.energy_steps=true"]
    overrides += [f"duration={DURATIONS[name]}"] if name in DURATIONS else []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.h5"
        wsnsim.run(wsnsim.load(str(_paths()[name]), overrides), replicates=1, out=out)
        return {"tables": _tables(column_digests(out)), "metrics": _metrics(out)}


def _tables(columns: Mapping[str, str]) -> dict[str, str]:
    """{table: digest of the digests of its columns}"""
    tables: dict[str, list[str]] = {}
    for name in sorted(columns):
        tables.setdefault(name.partition(".")[0], []).append(f"{name} {columns[name]}")
    return {table: hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16] for table, lines in tables.items()}


def _metrics(out: Path) -> dict[str, float | None]:
    """The numbers of the row of `runs`; None for NaN and infinity."""
    import wsnsim

    row = wsnsim.read(out, "runs").select_dtypes("number").iloc[0]
    values = {str(name): float(value) for name, value in row.items() if name not in NO_METRICS}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def place_of(name: str, folder: Path = FOLDER) -> Path:
    """The file of a scenario's fingerprint."""
    return folder / f"{name}.json"


def stored(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """The stored fingerprints of a scenario, by kind of processor; {} if there are none."""
    try:
        content: dict[str, Any] = json.loads(place_of(name, folder).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return content["kinds"] if content["duration"] == DURATIONS.get(name) else {}


def store(name: str, found: Mapping[str, Any], machine: Machine, folder: Path = FOLDER) -> None:
    """Store the fingerprint of this kind of processor. If results have changed, those of other kinds are dropped."""
    before = stored(name, folder)
    kept = {} if differences(name, before, found, machine) else before
    kinds = {**kept, machine.kind: {"versions": dict(machine.versions), **found}}
    content = {"duration": DURATIONS.get(name), "kinds": kinds}
    place_of(name, folder).write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def is_exact(before: Mapping[str, Any], machine: Machine) -> bool:
    """Whether the stored fingerprints include one of this kind of processor with these versions."""
    return machine.kind in before and before[machine.kind]["versions"] == machine.versions


def differences(name: str, before: Mapping[str, Any], found: Mapping[str, Any], machine: Machine) -> list[str]:
    """What differs from the stored fingerprints, a line each: tables whose bits differ, metrics before and after."""
    if not before:
        return ["has no stored fingerprint; make verify ARGS=--record stores one"]
    if not is_exact(before, machine):
        nearest = before.get(machine.kind) or before[min(before)]
        left = set(NOT_OF_SENSITIVE) if name in SENSITIVE else _collapsed(nearest["metrics"], found["metrics"])
        was, now = ({key: one[key] for key in one if key not in left} for one in (nearest["metrics"], found["metrics"]))
        return _differing_metrics(was, now, SENSITIVE.get(name, TOLERANCE))
    was, now = before[machine.kind]["tables"], found["tables"]
    tables = [table for table in sorted(was.keys() | now.keys()) if was.get(table) != now.get(table)]
    if not tables:
        return []
    metrics = _differing_metrics(before[machine.kind]["metrics"], found["metrics"], 0.0)
    return [f"tables that differ: {', '.join(tables)}", *metrics]


def _collapsed(*metrics: Mapping[str, float | None]) -> set[str]:
    return {key for key in ("nees", "nees_median") if all((one.get(key) or 0.0) > COLLAPSED for one in metrics)}


def _differing_metrics(
    before: Mapping[str, float | None], found: Mapping[str, float | None], tolerance: float
) -> list[str]:
    names = sorted(before.keys() | found.keys())
    pairs = [(name, before.get(name), found.get(name)) for name in names]
    return [f"{name}: {one} -> {other}" for name, one, other in pairs if not _close(one, other, tolerance)]


def _close(one: float | None, other: float | None, tolerance: float) -> bool:
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=tolerance, abs_tol=tolerance)
