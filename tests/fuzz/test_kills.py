"""The script of `kills`, with few kills; `python -m tests.fuzz.kills --kills 50` has more."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import Any

import pytest

from tests.campaign.campaign_files import tables_of
from tests.campaign.inline_engine import InlineEngine
from tests.fuzz import kills
from wsnsim.campaign import prepare, run_campaign
from wsnsim.scenario.sweep import load_sweep


@pytest.mark.thorough
@pytest.mark.parametrize("options", [[], ["--dask"]], ids=["local", "Dask"])
def test_campaigns_that_are_killed_lose_and_double_nothing(
    options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    if options:
        pytest.importorskip("distributed")
    assert kills.main(["--kills", "3", *options]) == 0
    assert re.match(r"[3-9] kills \(.*\), \d campaigns of 48 tasks", capsys.readouterr().out)


@pytest.mark.thorough
def test_a_lost_run_and_a_leftover_are_found(tmp_path: Path) -> None:
    written = {"scenario": "ungm_pf", "set": {"duration": "2 s"}, "name": "c", "block": 1}
    plan = load_sweep({**written, "grid": {"tracker.particles": [10]}, "replicates": 3})
    folder = prepare(plan, tmp_path / "c")
    assert run_campaign(folder, InlineEngine()).complete
    nobody: Any = None
    work = kills.Killing(tmp_path, "", (), tables_of(folder.path), 3, random.Random(0), nobody)
    work.check(folder.path)
    first, *_ = folder.path.glob("*/r*.h5")
    (folder.path / "running").mkdir(exist_ok=True)
    marks = [first.with_suffix(".tmp"), folder.path / "running" / "x.log"]
    for mark in marks:
        mark.touch()
    assert sorted(kills.leftovers(folder.path)) == sorted(marks)
    first.unlink()
    with pytest.raises(AssertionError):
        work.check(folder.path)
