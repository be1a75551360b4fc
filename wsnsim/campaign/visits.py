"""The visits of a lifetime, simulated like the runs of a campaign: in workers, resumable, each file complete or absent.

make = VisitsInWorkers(scenario, folder, engine)
Estimation(setup, plan, make).run()
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, final

from wsnsim.base.errors import RunError
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.version import __version__
from wsnsim.campaign.code_changes import code_id, code_of_resolved
from wsnsim.campaign.engines import WHOLE, CampaignProgress, Engine
from wsnsim.campaign.runner import run_campaign
from wsnsim.lifetimes.estimate import Estimation
from wsnsim.lifetimes.library import Library, Visit
from wsnsim.lifetimes.outcome import outcome_of
from wsnsim.lifetimes.planning import lifetime_plan
from wsnsim.lifetimes.stored_visits import of_visits, read_visits, write_point
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk
from wsnsim.recording.provenance import digest_of
from wsnsim.scenario.registry import Plugins, access

Stopping = Callable[[], AbstractContextManager[Callable[[], bool]]]


def estimate_lifetime(scenario: Any, folder: Path, engine: Callable[[], Engine], **options: Any) -> dict[str, Any]:
    """The outcome of a scenario's lifetime; see `lifetimes.outcome`.

    Args:
        scenario: what `load` returned.
        folder: where visits are kept, so that a second call goes on where the first ended.
        engine: makes what runs the tasks.
        options: `report` and `stopping` of `VisitsInWorkers`.

    Raises:
        UsageError: the scenario has no lifetime. ScenarioError: it is invalid. RunError: a visit failed.
    """
    setup, plan = lifetime_plan(scenario)
    # later epochs begin at shares of dead nodes, and where routes change
    make = VisitsInWorkers(scenario, folder, engine, most=plan.most + plan.later * len(plan.epochs), **options)
    return outcome_of(Estimation(setup, plan, make).run(), scenario)


@final
class VisitsInWorkers:
    """A `lifetimes.estimate.Make`: visits that are in the folder are read, the others are simulated and kept there.

    Args:
        scenario: the scenario, with its block `lifetime`.
        folder: where visits are kept; those of other scenarios, or of other code, may be there.
        engine: makes what runs the tasks.
        report: called with the progress; its total is `most`, or what was asked for so far if that is more.
        most: largest number of visits.
        stopping: while visits are simulated, this context gives a function that is asked whether to stop.
    """

    def __init__(
        self, scenario: Any, folder: Path, engine: Callable[[], Engine],
        report: Callable[[CampaignProgress], object] = lambda progress: None, most: int = 0,
        stopping: Stopping = lambda: nullcontext(lambda: False),
    ) -> None:  # fmt: skip
        self._folder, self._engine = Folder(folder), engine
        self._report, self._stopping, self._most = report, stopping, most
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
            total = max(self._most, self._before + now.total)
            self._report(replace(now, done=self._before + now.done, total=total, wall=self._wall + now.wall, left=None))

        with self._stopping() as should_stop:
            outcome = run_campaign(self._folder, self._engine(), WHOLE, report, should_stop, access=access(Plugins.ANY))
            if should_stop():
                raise KeyboardInterrupt
        if outcome.failed or outcome.missing:
            reasons = list(dict.fromkeys(outcome.failed.values())) or [outcome.stopped or "visits are missing"]
            raise RunError(f"visits could not be simulated: {reasons[0]}")
        self._before, self._wall = self._before + last.total, self._wall + last.wall
