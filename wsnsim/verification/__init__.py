"""Whether a result is reproducible: its scenario is run again, and everything that it holds is compared.

verify(path) -> Verification
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import wsnsim.experiment as experiment
from wsnsim.base.errors import ResultError
from wsnsim.recording import attributes, read_json, read_table, read_text, tables
from wsnsim.recording.provenance import provenance
from wsnsim.recording.rows import PARTIAL
from wsnsim.scenario import Plugins
from wsnsim.stored_scenario import rerun_source, scenario_of_result
from wsnsim.verification.repetition import DIGESTS, NOT_REPEATED, RepeatedTable, compare_source, compare_tables

LAST_REPLICATE: Final = 2**31
"""Greatest number of a run; a file with greater ones is damaged."""
MOST_SHOWN: Final = 6
"""Number of differing columns that the text names for a run."""
UNCHECKED: Final = ("the provenance's command line, commit, machine and times",)
"""What no second run can repeat."""
LEAST_LEFT: Final = len(UNCHECKED) + sum(map(len, NOT_REPEATED.values()))
"""Number of entries of `left` if all that can be compared was compared."""


@dataclass(frozen=True)
class Verification:
    """Whether a result is reproducible.

    Attributes:
        ok: whether it is.
        text: the answer in words.
        rows: one per run: `replicate`, `fingerprint` and `again` (stored and repeated), `equal` (bit by bit), `close`
            (up to rounding), `differing` (the columns that are not equal).
        faults: what is wrong with the file as a whole, as sentences.
        compared: {table: its number of rows in the result}.
        left: what could not be compared.
    """

    ok: bool
    text: str
    rows: tuple[Mapping[str, Any], ...]
    faults: tuple[str, ...] = ()
    compared: Mapping[str, int] | None = None
    left: tuple[str, ...] = ()


def verify(path: str | Path, plugins: bool = False) -> Verification:
    """Run a result's scenario again, and compare every table, the fingerprints, and the source text.

    With the same CPU features and package versions all bits must be equal. Otherwise floating-point values may differ
    by rounding, and the text says so: NumPy's logarithm and exponential differ in the last bit between CPUs. A
    fingerprint follows from the values: if they are equal bit by bit, so must it be.

    Args:
        path: the result.
        plugins: whether its scenario may import any plug-in that it names; without it, only those that installed
            packages offer.

    Raises:
        ResultError: the file cannot be read, or has a run with an impossible number.
        ScenarioError: its scenario is invalid.
        RunError: a run failed.
    """
    path = Path(path)
    stored, allowed = read_json(path, "provenance_json"), Plugins.ANY if plugins else Plugins.INSTALLED
    scenario = scenario_of_result(path, allowed)
    partial = attributes(path)["status"] == PARTIAL
    here = provenance("", scenario.seed)
    replicates, faults = _replicates(path, scenario.replicates, partial)
    with tempfile.TemporaryDirectory(prefix="wsnsim-verify-") as folder:
        again = Path(folder) / "again.h5"
        experiment.run(scenario, replicates=replicates, out=again, batch=False)
        runs, differing = compare_tables(path, again, partial)
        rows = [_row(path, again, replicate, compared) for replicate, compared in runs.items()]
    source, resolved = read_text(path, "scenario/source_yaml"), rerun_source(path)
    differing_source, unknown = compare_source(source, stored.get("overrides", ()), resolved, allowed)
    faults += [*differing, *differing_source]
    excuses = _excuses(stored, here)
    ok = not faults and all(row["equal"] or (bool(excuses) and row["close"]) for row in rows)
    compared = {name: size.rows for name, size in tables(path).items()}
    left = (*_not_compared(partial), *unknown)
    origins = _commits(stored, here)
    if excuses:
        origins.append(f"origin with other {' and '.join(excuses)}: values may differ by rounding")
    found = Verification(ok, "", tuple(rows), tuple(faults), compared, left)
    return replace(found, text=_text(path, found, compared, origins))


def _replicates(path: Path, wanted: int, partial: bool) -> tuple[list[int], list[str]]:
    """The numbers of the runs in a result, and what is wrong with them."""
    numbers = read_table(path, "runs", ["replicate"])["replicate"].tolist()
    faults = []
    if not partial and len(numbers) != wanted:
        faults.append(f"table runs has {len(numbers)} rows, its scenario asks for {wanted} runs")
    if len(set(numbers)) != len(numbers):
        faults.append("table runs has several rows of one run")
    if not numbers:  # a recovered file may have lost its runs, but not their rows
        for name in (name for name, size in tables(path).items() if "replicate" in size.columns):
            numbers += read_table(path, name, ["replicate"])["replicate"].tolist()
    chosen = sorted(set(numbers)) or [0]
    if chosen[0] < 0 or chosen[-1] > LAST_REPLICATE:
        raise ResultError(f"{path}: has a run with the number {chosen[0] if chosen[0] < 0 else chosen[-1]}")
    return chosen, faults


def _row(path: Path, again: Path, replicate: int, compared: Sequence[RepeatedTable]) -> dict[str, Any]:
    """The entry of `Verification.rows` for one run, from its compared tables."""
    stored, repeated = (_digests(file, replicate) for file in (path, again))
    digests_agree = stored == repeated
    columns = [f"{table.table}.{name}" for table in compared for name in table.differing]
    values = [name for name in columns if name.removeprefix("runs.") not in DIGESTS]
    lengths = [
        f"{each.table} ({each.rows[0]} rows, not {each.rows[1]})" for each in compared if each.rows[0] != each.rows[1]
    ]
    same_values = not values and not lengths
    return {
        "replicate": replicate,
        "fingerprint": stored.get("fingerprint", 0),
        "again": repeated["fingerprint"],
        "equal": same_values and digests_agree,
        # equal values must have equal digests; if values differ by rounding, digests differ
        "close": all(table.close for table in compared) and (digests_agree or not same_values),
        "differing": [*lengths, *values, *([] if digests_agree or not same_values else ["runs.fingerprint"])],
    }


def _digests(path: Path, replicate: int) -> dict[str, int]:
    """The digests of one run; none if the table `runs` lacks it."""
    runs = read_table(path, "runs")
    rows = (runs["replicate"] == replicate).nonzero()[0]
    return {name: int(runs[name][rows[0]]) for name in DIGESTS if name in runs and rows.size}


def _not_compared(partial: bool) -> tuple[str, ...]:
    """What of the tables and texts was not compared."""
    columns = [f"{table}.{name}" for table, names in NOT_REPEATED.items() for name in names]
    rows = ["the rows that were not recovered"] if partial else []
    return (*columns, *rows, *UNCHECKED)


def _excuses(stored: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """What differs between the origin of a result and this machine, and excuses differences in the last bits."""
    names = {"python": "Python", "packages": "packages", "cpu_features": "CPU features"}
    found = [word for name, word in names.items() if stored.get(name) != here.get(name)]
    if stored.get("engine") == "batch" and any(kind.startswith("tracker ") for kind in stored.get("plugins", ())):
        found.append("engine")  # its batch of whole runs may round differently from the runs here
    return found


def _commits(stored: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """A line with both commits if another commit made the result; it does not excuse a difference."""
    before, now = ((origin.get("git") or {}).get("commit", "no checkout")[:12] for origin in (stored, here))
    return [f"made by commit {before}, run again by {now}"] if before != now else []


def _text(path: Path, found: Verification, compared: Mapping[str, int], origins: Sequence[str]) -> str:
    """The answer in words."""
    answer = "repeats" if len(found.left) <= LEAST_LEFT else "repeats as far as it could be compared"
    sizes = ", ".join(f"{name} ({count} rows)" for name, count in compared.items())
    details = [f"compared: {sizes}", f"not compared: {'; '.join(found.left)}"]
    lines = [f"  {line}" for line in (*origins, *found.faults, *_row_texts(found.rows), *details)]
    return "\n".join([f"{path}: {answer if found.ok else 'DOES NOT REPEAT'}", *lines])


def _row_texts(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for row in rows:
        verdict = "equal" if row["equal"] else "close" if row["close"] else "different"
        shown = [*row["differing"][:MOST_SHOWN], *(["..."] if len(row["differing"]) > MOST_SHOWN else [])]
        where = f" in {', '.join(shown)}" if shown else ""
        prints = f"{row['fingerprint']:016x} / {row['again']:016x}"
        yield f"replicate {row['replicate']}: {verdict}{where}, fingerprint {prints}"
