"""The visits of a lifetime, simulated like the runs of a campaign: in workers, resumable, each file complete or absent.

make = VisitsInWorkers(scenario, folder, engine)
Estimation(setup, plan, make).run()
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, final

from wsnsim.base.errors import RunError
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.version import __version__
from wsnsim.campaign.code_changes import code_id, code_of_resolved
from wsnsim.campaign.engines import WHOLE, CampaignProgress, Engine
from wsnsim.campaign.runner import run_campaign
from wsnsim.lifetimes.library import Library, Visit
from wsnsim.lifetimes.stored_visits import of_visits, read_visits, write_point
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.recording.provenance import digest_of
from wsnsim.scenario.registry import Plugins, access


@final
class VisitsInWorkers:
    """A `lifetimes.estimate.Make`: visits that are in the folder are read, the others are simulated and kept there.

    Args:
        scenario: the scenario, with its block `lifetime`.
        folder: where visits are kept; those of other scenarios, or of other code, may be there.
        engine: makes what runs the tasks.
        report: called with the progress over all visits that were asked for so far.
        should_stop: asked several times a second whether to stop.
    """

    def __init__(
        self, scenario: Any, folder: Path, engine: Callable[[], Engine],
        report: Callable[[CampaignProgress], object] = lambda progress: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self._folder, self._engine = Folder(folder), engine
        self._report, self._should_stop = report, should_stop
        self._scenario = of_visits(scenario)
        self._code = code_of_resolved([json.loads(self._scenario)])
        self._first: dict[frozenset[int], int] = {}
        self._before, self._wall = 0, 0.0

    def __call__(self, setup: NetworkSetup, visit: Visit, numbers: Sequence[int], dead: frozenset[int]) -> Library:
        """The library of some visits.

        Raises:
            RunError: a visit failed. KeyboardInterrupt: it was stopped. ResultError: a file cannot be read.
        """
        first = self._first.setdefault(dead, numbers[0])
        point = f"v{digest_of([self._scenario, sorted(dead), first, code_id(self._code)])[:16]}"
        self._folder.write_scenario(point, self._scenario)
        write_point(self._folder.path / point, dead, first)
        count = max(numbers) + 1 - first
        self._folder.write_manifest(
            Manifest("visits", (), (PointOnDisk(point, {}, "", count),), 1, __version__, code=self._code)
        )
        self._run()
        return read_visits([self._folder.batch(point, n - first, n - first) for n in numbers], dead)

    def _run(self) -> None:
        last = CampaignProgress(0, 0, 0, 0.0, None)

        def report(now: CampaignProgress) -> None:
            nonlocal last
            last = now
            done, total = self._before + now.done, self._before + now.total
            self._report(replace(now, done=done, total=total, wall=self._wall + now.wall))

        outcome = run_campaign(
            self._folder, self._engine(), WHOLE, report, self._should_stop, access=access(Plugins.ANY)
        )
        if self._should_stop():
            raise KeyboardInterrupt
        if outcome.failed or outcome.missing:
            reasons = list(dict.fromkeys(outcome.failed.values())) or [outcome.stopped or "visits are missing"]
            raise RunError(f"visits could not be simulated: {reasons[0]}")
        self._before, self._wall = self._before + last.total, self._wall + last.wall
