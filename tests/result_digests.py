"""SHA-256 digests of every table of every shipped scenario, to show that a change leaves the results as they were.

    python -m tests.result_digests record FILE.json         run the scenarios of the tree in the working directory
    python -m tests.result_digests compare OLD.json NEW.json

Each shipped scenario runs once with each of the seeds 1, 2 and 3, all tables recorded but `particles` and `links`;
long scenarios run for a shorter duration (`SHORTER`). Two shipped sweeps run with one Monte Carlo run a point. A digest
covers one column: its name, type and bytes. `cpu_seconds` is left out of `runs`. `RENAMED` maps the columns and tables
of an older tree to today's.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

SEEDS = (1, 2, 3)
SHORTER = {
    "lifetime": "60.04 s", "liu_network": "101 s", "pso_mhpf_packed": "12.04 s", "information_driven": "14.04 s",
    "information_driven_real": "10.04 s", "information_driven_asleep": "10.04 s",
}  # fmt: skip
SWEEPS = ("iterations", "sleep_probability")
SWEEP_DURATIONS = {"iterations": "4.04 s", "sleep_probability": "42 s"}
TABLES = ("runs", "tracks", "truth", "estimates", "events", "energy", "energy_steps", "clusters", "nodes", "wakeups")
LEFT_OUT = {("runs", "cpu_seconds")}
RENAMED: dict[str, str] = {}
"""{'table.column' of an older tree: the same of this one}."""
ADDED: tuple[str, ...] = (
    "runs.losses", "runs.time_lost", "runs.lost_share", "tracks.losses", "tracks.time_lost", "tracks.lost_share",
    "tracks.handover_bits",
    "runs.nees", "runs.nis", "estimates.cov_xy", "estimates.nees", "estimates.nis", "estimates.nis_dof",
    "estimates.gaussian", "nodes.x_assumed", "nodes.y_assumed",
)  # fmt: skip
"""'table.column' that this tree has and an older one has not."""


def column_digests(path: Path) -> dict[str, str]:
    """{'table.column': SHA-256} of a result file."""
    import h5py

    found = {}
    with h5py.File(path) as file:
        for table in TABLES:
            for name, column in file.get(table, {}).items():
                if (table, name) not in LEFT_OUT:
                    values = column[...]
                    label = f"{values.dtype}{values.shape}".encode()
                    found[f"{table}.{name}"] = hashlib.sha256(label + values.tobytes()).hexdigest()
    return found


def scenario_digests(task: tuple[str, int]) -> tuple[str, dict[str, str]]:
    """The digests of one scenario at one seed."""
    import wsnsim

    name, seed = task
    overrides = [f"seed={seed}", *(f"record.{table}=true" for table in ("events", "energy_steps"))]
    if name in SHORTER:
        overrides.append(f"duration={SHORTER[name]}")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.h5"
        wsnsim.run(wsnsim.load(name, overrides), replicates=1, out=out)
        return f"{name} seed {seed}", column_digests(out)


def sweep_digests(name: str) -> dict[str, dict[str, str]]:
    """The digests of every file of a shipped sweep."""
    import subprocess

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "campaign"
        text = Path(f"scenarios/sweeps/{name}.yaml")
        command = [sys.executable, "-m", "wsnsim", "sweep", str(text), "--replicates", "1", "-o", str(out), "-j", "2",
                   "--quiet", "--set", f"duration={SWEEP_DURATIONS[name]}"]  # fmt: skip
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        paths = sorted(out.rglob("*.h5"))
        assert paths, f"sweep {name} left no result file"
        return {f"sweep {name} {path.relative_to(out)}": column_digests(path) for path in paths}


def record(out: Path, only: list[str]) -> None:
    """Write {run: {'table.column': digest}} of all shipped scenarios and of the sweeps, or of some scenarios only."""
    names = only or sorted(path.stem for path in Path("scenarios").glob("*.yaml"))
    tasks = [(name, seed) for name in names for seed in (SEEDS[:1] if only else SEEDS)]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        digests: dict[str, Any] = dict(pool.map(scenario_digests, tasks))
    for name in () if only else SWEEPS:
        digests.update(sweep_digests(name))
    out.write_text(json.dumps(digests, indent=0, sort_keys=True), encoding="utf-8")
    columns = sum(map(len, digests.values()))
    print(f"{len(digests)} result files, {columns} columns: {out}")


def compare(old: Path, new: Path, partly: bool) -> int:
    """Print what differs; 0 if nothing does. `partly`: only the runs that the new record holds."""
    before, after = (json.loads(path.read_text(encoding="utf-8")) for path in (old, new))
    if partly:
        before = {run: columns for run, columns in before.items() if run in after}
    wrong = [f"{run}: only in one of the two" for run in sorted(before.keys() ^ after.keys())]
    for run in sorted(before.keys() & after.keys()):
        was = {RENAMED.get(name, name): digest for name, digest in before[run].items()}
        now = {name: digest for name, digest in after[run].items() if name not in ADDED or name in was}
        wrong += [f"{run}: {name}" for name in sorted(was.keys() | now.keys()) if was.get(name) != now.get(name)]
    print("\n".join(wrong) if wrong else f"equal: {len(before)} result files, {sum(map(len, before.values()))} columns")
    return int(bool(wrong))


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("out", type=Path)
    recording.add_argument("--only", default="", help="names of scenarios, separated by commas; seed 1 only")
    comparing = commands.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument("--partly", action="store_true", help="compare only the runs that NEW holds")
    arguments = parser.parse_args()
    if arguments.command == "record":
        record(arguments.out, [name for name in arguments.only.split(",") if name])
        return 0
    return compare(arguments.old, arguments.new, arguments.partly)


if __name__ == "__main__":
    sys.exit(main())
