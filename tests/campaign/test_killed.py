"""After kill -9 at any moment, nothing is lost, no finished task is repeated, and no partial file counts as a result.

WSNSIM_KILLS=50 pytest tests/campaign/test_killed.py      fifty campaigns instead of two
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from wsnsim.campaign import CampaignOutcome, CampaignProgress, engines, prepare, run_campaign
from wsnsim.campaign.engines import LocalEngine
from wsnsim.scenario.sweep import load_sweep

from .campaign_files import assert_same, files_of, tables_of
from .inline_engine import InlineEngine
from .moody_tracker import TRUSTED, sweep_of, write_sweep
from .processes import children, environment, lives, wait_for

KILLS = int(os.environ.get("WSNSIM_KILLS", "2"))
WORKERS = 1 if KILLS <= 2 else 2
POINTS: list[Mapping[str, Any]] = [{"pause": pause} for pause in (0.02, 0.021, 0.022)]
FILES = 9
"""Files of three points with five replicates each, in blocks of two."""


@pytest.fixture
def sweep(lab: Path) -> str:
    return write_sweep(lab / "moods.yaml", sweep_of(POINTS, 5))


@pytest.fixture
def truth(sweep: str, lab: Path) -> Any:
    """The tables of a campaign that is not killed."""
    folder = prepare(load_sweep(sweep), lab / "truth")
    assert run_campaign(folder, InlineEngine(), access=TRUSTED).complete
    assert len(files_of(folder.path)) == FILES
    return tables_of(folder.path)


def assert_resumable(sweep: str, place: Path, truth: Any) -> None:
    """The missing tasks are run, existing files stay, and the tables equal those of a campaign that was not killed."""
    before = files_of(place)
    folder = prepare(load_sweep(sweep), place)
    ended: CampaignOutcome = run_campaign(folder, LocalEngine(WORKERS) if KILLS > 2 else InlineEngine(), access=TRUSTED)
    assert ended.complete and not ended.failed
    after = files_of(place)
    assert {name: after[name] for name in before} == before and len(after) == FILES
    assert not list(place.rglob("*.tmp")) and not list(place.glob("running/*"))
    assert_same(tables_of(place), truth)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(KILLS // 2))
def test_a_campaign_whose_driver_is_killed_goes_on_and_its_workers_end(
    lab: Path, sweep: str, truth: Any, seed: int
) -> None:
    chance = random.Random(seed)
    place, wanted = lab / "killed", chance.randrange(FILES)
    command = [sys.executable, "-m", "wsnsim", "sweep", sweep, "-o", str(place), "-j", str(WORKERS), "-q"]
    driver = subprocess.Popen(command, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if wanted:
        wait_for(lambda: len(files_of(place)) >= wanted or driver.poll() is not None, 300)
        time.sleep(chance.uniform(0.0, 0.1))
    else:
        time.sleep(chance.uniform(0.0, 3.0))
    workers = children(driver.pid)
    driver.kill()
    driver.wait()
    wait_for(lambda: not any(map(lives, workers)), 60)
    assert_resumable(sweep, place, truth)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(KILLS - KILLS // 2))
def test_a_campaign_whose_worker_is_killed_is_completed_all_the_same(
    lab: Path, sweep: str, truth: Any, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies = bool(seed % 2) and sys.platform == "linux"
    monkeypatch.setattr(engines, "_can_be_copied", lambda: copies)
    chance = random.Random(seed)
    wanted, killed = chance.randrange(10), []
    later = time.monotonic() + (chance.uniform(0.0, 3.0) if not wanted else 0.0)

    def watch(progress: CampaignProgress) -> None:
        """Kill one worker, once, when enough is done."""
        workers = [process.pid for process in multiprocessing.active_children() if process.pid]
        if not killed and progress.done >= wanted and time.monotonic() > later and workers:
            killed.append(chance.choice(workers))
            time.sleep(chance.uniform(0.0, 0.1))
            os.kill(killed[0], signal.SIGKILL)

    folder = prepare(load_sweep(sweep), lab / "killed")
    ended = run_campaign(folder, LocalEngine(WORKERS), on_progress=watch, access=TRUSTED)
    assert killed and ended.complete and not ended.failed
    assert_resumable(sweep, folder.path, truth)


@pytest.mark.thorough
def test_a_file_that_was_not_finished_is_not_taken_for_one(lab: Path, sweep: str, truth: Any) -> None:
    """Partial files of a dead writer are written by hand."""
    folder = prepare(load_sweep(sweep), lab / "killed")
    whole = next((lab / "truth").glob("*/r00000-00001.h5"))
    dead = subprocess.Popen(["true"])
    dead.wait()
    host = folder.marker("s", "t").name.split(".")[-3]
    for share in (0.0, 0.5, 1.0):
        text = whole.read_bytes()[: int(share * whole.stat().st_size)]
        (folder.path / whole.parent.name / f"r00000-00001.{host}.{dead.pid}-{int(9 * share)}.tmp").write_bytes(text)
    assert_resumable(sweep, folder.path, truth)
