"""Campaigns whose processes are killed at random instants: nothing is lost, doubled or left behind.

    python -m tests.fuzz.kills --kills 50                    drivers and workers of local campaigns
    python -m tests.fuzz.kills --kills 50 --dask             the same on a Dask scheduler with two workers
    python -m tests.fuzz.kills --kills 3 --tasks 10000       one campaign of this many tasks

A driver gets SIGKILL, SIGTERM or SIGINT, a worker SIGKILL, after a random number of tasks and a random time; then the
same command resumes the campaign. At its end its tables are compared, bit by bit, with those of a campaign that nobody
killed, and its folder must hold no temporary file and no marker. The instants depend on the seed and on the machine.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import wsnsim
from tests.campaign.campaign_files import assert_same, files_of, tables_of
from tests.campaign.inline_engine import InlineEngine
from tests.campaign.moody_tracker import TRUSTED, sweep_of, write_moody_tracker, write_sweep
from tests.campaign.processes import children, lives, wait_for
from tests.campaign_cluster.dask_processes import Lab, lab
from wsnsim.campaign import prepare, run_campaign
from wsnsim.scenario.sweep import load_sweep

SIGNALS: Final = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
POINTS: Final = (0.01, 0.011, 0.012, 0.013)
"""Pauses (s) of the tracker in each of a run's three steps, one for each point."""
PATIENCE: Final = 120.0


@dataclass
class Killing:
    """Campaigns of one sweep in a folder, and what was done to them.

    Attributes:
        place: the folder.
        sweep: the sweep's file.
        options: further options of the command.
        truth: the tables of the campaign that nobody killed.
        tasks: number of tasks of a campaign.
        chance: what decides on instants and victims.
        lab: where commands are started.
        dask: the process whose children are Dask's workers, None for local ones.
        kills: number of kills by what was killed how.
        campaigns: complete campaigns.
        sessions: commands that were started.
    """

    place: Path
    sweep: str
    options: Sequence[str]
    truth: Any
    tasks: int
    chance: random.Random
    lab: Lab
    dask: subprocess.Popen[bytes] | None = None
    kills: Counter[str] = field(default_factory=Counter)
    campaigns: int = 0
    sessions: int = 0

    def until(self, kills: int) -> None:
        """Kill processes until `kills` were killed and the last campaign is complete."""
        while self.kills.total() < kills or not self.campaigns:
            folder = self.place / f"c{self.campaigns}"
            while not self.session(folder, self.kills.total() < kills):
                pass
            self.check(folder)
            self.campaigns += 1

    def session(self, folder: Path, kill: bool) -> bool:
        """Start or resume a campaign, kill a process or none, and return whether the campaign is complete."""
        before = files_of(folder) if self.tasks < 1000 else {}
        wanted = len(list(folder.glob("*/r*.h5"))) + self.chance.randrange(max(2, self.tasks // 4))
        driver = self.lab.wsnsim("sweep", self.sweep, "-o", str(folder), "-q", *self.options)
        self.sessions += 1
        if kill:
            with contextlib.suppress(AssertionError):  # it may wait for workers
                wait_for(lambda: driver.poll() is not None or len(list(folder.glob("*/r*.h5"))) >= wanted, PATIENCE)
            time.sleep(self.chance.uniform(0.0, 0.2))
            self.kill(driver, folder)
        output = driver.communicate()
        assert driver.returncode in (0, 3, 130, 143, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT), output
        assert b"Traceback" not in output[1] and b"internal error" not in output[1], output
        after = files_of(folder) if before else {}
        assert before.items() <= after.items(), "a finished file was written again"
        return driver.returncode == 0

    def kill(self, driver: subprocess.Popen[bytes], folder: Path) -> None:
        """Kill the driver or one of the workers, if they live."""
        number = self.chance.choice(SIGNALS)
        if number == signal.SIGINT:  # while Python starts, Ctrl-C gives its own traceback
            wait_for(lambda: driver.poll() is not None or children(driver.pid) or _is_begun(folder), PATIENCE)
        workers = children(self.dask.pid if self.dask else driver.pid)
        if driver.poll() is not None:
            return
        if self.chance.random() < 0.4 and workers:
            self.kills["worker SIGKILL"] += 1
            _send(self.chance.choice(workers), signal.SIGKILL)
            return
        self.kills[f"driver {number.name}"] += 1
        driver.send_signal(number)
        driver.wait(PATIENCE)
        if not self.dask:
            wait_for(lambda: not any(map(lives, workers)), 30.0)

    def check(self, folder: Path) -> None:
        """Compare the tables of a complete campaign with the truth, and look for leftovers."""
        assert_same(tables_of(folder), self.truth)
        assert len(list(folder.glob("*/r*.h5"))) == self.tasks
        wait_for(lambda: not leftovers(folder))  # workers of Dask end what a killed driver had sent

    def report(self) -> str:
        """The figures in one line."""
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.kills.items()))
        return (
            f"{self.kills.total()} kills ({kinds}), {self.campaigns} campaigns of {self.tasks} tasks, {self.sessions}"
            f" sessions, {self.campaigns * self.tasks} tasks: 0 rows lost, 0 doubled, 0 leftovers, 0 tracebacks"
        )


def _is_begun(folder: Path) -> bool:
    """Whether a driver of Dask workers, of which no killed one is left, has connected to the scheduler."""
    return any(lives(int(mark.name.split(".")[-2])) for mark in folder.glob("running/driver.*.log"))


def leftovers(folder: Path) -> list[Path]:
    """Temporary files and markers in a campaign's folder."""
    return [*folder.rglob("*.tmp"), *folder.glob("running/*")]


def _send(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


@contextlib.contextmanager
def killing(place: Path, seed: int, tasks: int, dask: bool) -> Iterator[Killing]:
    """What is needed to kill: a lab, a sweep, and its truth."""
    write_moody_tracker(place)
    if tasks:  # runs that can be made many at once, so that the truth takes less than what is tested
        grid = {"tracker.particles": [10 + n for n in range(10)]}
        sweep = {"name": "many", "scenario": "ungm_pf", "set": {"duration": "2 s"}, "grid": grid, "block": 1}
        sweep |= {"replicates": tasks // len(grid["tracker.particles"])}
    else:
        sweep = sweep_of([{"pause": pause} for pause in POINTS], 12, block=1)
    count = 10 * sweep["replicates"] if tasks else len(POINTS) * 12
    with lab(place) as made:
        truth = prepare(load_sweep({**sweep, "block": 500 if tasks else 1}), place / "truth")
        assert run_campaign(truth, InlineEngine(), access=TRUSTED).complete
        options, workers = ["-j", "2"], None
        if dask:
            file = made.scheduler("kills")
            workers = made.worker(file, "--nworkers", "2")
            options = ["--scheduler-file", str(file)]
        path = write_sweep(place / "kills.yaml", sweep)
        yield Killing(place, path, options, tables_of(truth.path), count, random.Random(seed), made, workers)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--dask", action="store_true", help="on a Dask scheduler")
    parser.add_argument("--tasks", type=int, default=0, help="tasks of the campaign, a multiple of ten")
    given = parser.parse_args(arguments)
    began = time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="wsnsim-kills-") as place,
        killing(Path(place), given.seed, given.tasks, given.dask) as work,
    ):
        work.until(given.kills)
        print(f"{work.report()}; {time.monotonic() - began:.0f} s, wsnsim {wsnsim.__version__}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
