"""Processor time of this tree over that of another tree, scenario by scenario, in one run.

    python -m tests.bench.against OTHER_TREE [--alternations 20] [--scenarios pso_mhpf,beacons,gmtt,field_1m]

Three processes stay alive: this tree, the other tree, and the other tree again. Each simulates a scenario once for
warm-up, then they take turns. The last column, the other tree over itself, says how much the machine alone accounts
for. Runs stay in memory: nothing is written to a file.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

WORKER = """
import sys, time
import wsnsim
from wsnsim.base.tables import Memory
for line in sys.stdin:
    name = line.strip()
    scenario = wsnsim.load(name)
    began = time.process_time()
    wsnsim.experiment.simulate_run(scenario, 0, Memory())
    print(time.process_time() - began, flush=True)
"""


class Worker:
    """A process that simulates scenarios with the code of one tree, and tells the processor time of each."""

    def __init__(self, tree: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", WORKER], cwd=tree, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def seconds(self, scenario: str) -> float:
        """Simulate a scenario once; its processor time in s."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(scenario + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())


def ratios(workers: list[Worker], scenario: str, alternations: int) -> tuple[list[float], list[float], list[float]]:
    """This tree's times, its ratios to the other tree, and the other tree's ratios to itself, pair by pair."""
    for worker in workers:
        worker.seconds(scenario)
    own, against, itself = [], [], []
    for turn in range(alternations):
        order = workers if turn % 2 == 0 else workers[::-1]
        taken = {id(worker): worker.seconds(scenario) for worker in order}
        this, other, again = (taken[id(worker)] for worker in workers)
        own.append(this)
        against.append(this / other)
        itself.append(again / other)
    return own, against, itself


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path)
    parser.add_argument("--alternations", type=int, default=20)
    parser.add_argument("--scenarios", default="pso_mhpf,beacons,gmtt,field_1m")
    arguments = parser.parse_args()
    trees = [Path.cwd(), arguments.other.resolve(), arguments.other.resolve()]
    print(f"{'scenario':12} {'CPU, s':>8} {'ratio':>7} {'quartiles':>15} {'other/itself':>13} {'quartiles':>15}")
    for scenario in arguments.scenarios.split(","):
        own, against, itself = ratios([Worker(tree) for tree in trees], scenario, arguments.alternations)
        cells = []
        for values in (against, itself):
            low, middle, high = statistics.quantiles(values, n=4)
            cells += [f"{middle:.3f}", f"{low:.3f}-{high:.3f}"]
        seconds = statistics.median(own)
        print(f"{scenario:12} {seconds:8.3f} {cells[0]:>7} {cells[1]:>15} {cells[2]:>13} {cells[3]:>15}", flush=True)


if __name__ == "__main__":
    main()
