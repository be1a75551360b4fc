"""THE MAIN PATH: scenario → setup → truth → world (or offline run) → rows → file.

    simulate_run(scenario, replicate=0, recorder=None) -> Summary      one run; pure except for what the recorder gets
    run(scenario, replicates=30, out=path) -> Report                   many runs in one HDF5 file
    run_in_memory(scenario, replicates=[0]) -> (Report, MemoryResult)  the same without a file

`scenario` is what `load` takes: a file, the name of a shipped scenario, a plain dict, or a result.

From top to bottom: `load` returns the checked scenario, and `scenarios.build` its setup. `_one_run` samples the truth,
lets the world run, and writes the rows. `run` puts the rows of many runs into one file.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import wsnsim.scenario as scenarios
from wsnsim.base.errors import plugin_faults_of_run
from wsnsim.base.initial_conditions import (
    InitialConditions,
    sample_initial_conditions,
    sample_paths,
    sample_positions,
)
from wsnsim.base.plugin_code import plugin_classes
from wsnsim.base.process import contained, gc_frozen, limited, time_limit
from wsnsim.base.results import Report, RunResult, Summary, provenance_of, summarise
from wsnsim.base.rows import RunStart, follower_of
from wsnsim.base.runs import OnTime, Progress, run_numbers, throttled
from wsnsim.base.setups import BeaconSetup, NetworkSetup, Setup, TrackingSetup, table_layout
from wsnsim.base.tables import Memory, Recorder
from wsnsim.models.compilation import announced, compilation_seconds, compilation_wall, time_without_compilation
from wsnsim.models.coverage import coverage_of_living
from wsnsim.network.imperfect_readings import StandaloneReports
from wsnsim.network.result_rows import network_result, write_tables
from wsnsim.network.world import World
from wsnsim.offline import offers_batch
from wsnsim.recording.provenance import provenance
from wsnsim.recording.writer import MemoryResult, ResultFile
from wsnsim.scenario import Overrides, Plugins
from wsnsim.scenario.texts import is_result
from wsnsim.stored_scenario import scenario_of_result

if TYPE_CHECKING:
    from wsnsim.offline.batch import Batches

__all__ = [
    "Progress", "Report", "Summary", "load", "replicate_of", "run", "run_in_memory", "simulate_run",
]  # fmt: skip

Source = Any
"""What `load` takes, or the Scenario that it gives."""


def load(source: Source, overrides: Overrides = (), plugins: bool = False) -> Any:
    """Return the checked Scenario of a file, of a shipped scenario's name, of a dict, or of a result.

    Args:
        source: what to load.
        overrides: values that replace those of the source: {'link.reach': '80 m'}, or ['link.reach=80 m']. In a
            mapping, a value may be a component: {'tracker': PsoMhpf(particles=200)}.
        plugins: whether a result may name any plug-in. Without it, only those that installed packages offer are
            imported, since a result may come from others. A scenario of the caller imports what it names.

    Raises:
        ScenarioError: with every issue found, each at its place in the text.
        ResultError: the result cannot be read.
        UsageError: the source is none of these, or the overrides are neither a mapping nor a list.
    """
    if isinstance(source, os.PathLike):
        source = Path(source)
    if isinstance(source, str | Path) and is_result(source):
        allowed = Plugins.ANY if plugins else Plugins.INSTALLED
        return scenario_of_result(Path(source), allowed, overrides)
    return scenarios.load(source, overrides)


def simulate_run(
    scenario: Source,
    replicate: int = 0,
    recorder: Recorder | None = None,
    progress: OnTime | None = None,
    plugins: bool = False,
) -> Summary:
    """One Monte Carlo run of a scenario. The same arguments give the same rows, in any process and in any order.

    Args:
        scenario: What `load` takes, or a Scenario.
        replicate: Number of the run, from 0.
        recorder: Where the rows go; without one they are dropped.
        progress: Called now and then with the simulated time (s).
        plugins: Whether a result may name any plug-in, as in `load`.

    Raises:
        ScenarioError: The scenario is invalid.
        RunError: The simulation failed.
    """
    setup = scenarios.build(load(scenario, plugins=plugins))
    return replicate_of(setup, replicate, recorder or Memory({}), progress)


def replicate_of(setup: Setup, replicate: int, recorder: Recorder, progress: OnTime | None = None) -> Summary:
    """One Monte Carlo run of a scenario that is built.

    Raises:
        RunError: The simulation failed, or code of a plug-in did before or after it. Plug-ins that take part are named.
    """
    classes = plugin_classes(vars(setup).values())
    with plugin_faults_of_run(setup.seed, replicate, classes), contained(classes):
        return _one_run(setup, replicate, recorder, progress)


def _one_run(setup: Setup, replicate: int, recorder: Recorder, progress: OnTime | None) -> Summary:
    """Truth, world, rows. The clock starts when positions and trajectories are known."""
    started = time_without_compilation()
    if isinstance(setup, BeaconSetup):
        with gc_frozen():
            result = _without_targets(setup, replicate, recorder, progress)
        return summarise(setup, replicate, result, (), recorder, started + compilation_seconds())
    assert isinstance(setup, TrackingSetup)
    conditions = sample_initial_conditions(setup, replicate)
    if (follower := follower_of(recorder)) is not None:
        follower.begin(RunStart(setup, replicate, conditions.positions, conditions.truths))
    if isinstance(setup, NetworkSetup):
        with gc_frozen():
            result = _in_network(setup, replicate, conditions, recorder, progress)
    else:
        from wsnsim.offline.offline_run import OfflineRun

        result = OfflineRun(setup, replicate, conditions, recorder, StandaloneReports).run(progress)
    return summarise(setup, replicate, result, conditions.truths, recorder, started + compilation_seconds())


def _without_targets(setup: BeaconSetup, replicate: int, recorder: Recorder, progress: OnTime | None) -> RunResult:
    """A run of a network without a target: no tracks, no errors."""
    from wsnsim.network.workload_world import WorkloadWorld

    positions = sample_positions(setup, setup.link.reach, replicate)
    if (follower := follower_of(recorder)) is not None:
        follower.begin(RunStart(setup, replicate, positions, ()))
    outcome = WorkloadWorld(setup, replicate, positions, setup.streams(replicate), recorder).run(progress)
    write_tables(outcome, replicate, setup, recorder)
    return network_result(outcome, setup)


def _in_network(
    setup: NetworkSetup, replicate: int, conditions: InitialConditions, recorder: Recorder, progress: OnTime | None
) -> RunResult:
    """A run of a network that tracks targets."""
    paths = sample_paths(setup, conditions.truths, replicate)
    outcome = World(setup, replicate, conditions, paths, setup.streams(replicate), recorder).run(progress)
    write_tables(outcome, replicate, setup, recorder)
    covered = coverage_of_living(setup.deploy, setup.sensor.reach, outcome.nodes.positions, outcome.nodes.living)
    return network_result(outcome, setup, covered)


def run(  # noqa: PLR0913
    scenario: Source,
    *,
    replicates: int | Sequence[int] | None = None,
    out: Path,
    command_line: str = "",
    progress: Callable[[Progress], None] | None = None,
    batch: bool = True,
    on_compile: Callable[[], None] | None = None,
    code: str = "",
    plugins: bool = False,
    watched: Callable[[Recorder], Recorder] | None = None,
    timeout: float | None = None,
) -> Report:
    """Run a scenario several times, into one HDF5 file that gets its name only once it is complete.

    Args:
        scenario: What `load` takes, or a Scenario.
        replicates: Number of runs, or the numbers of the runs; by default the number that the scenario says.
        out: Path of the file.
        command_line: The command that is stored in the file's provenance.
        progress: Called at most ten times a second.
        batch: Whether standalone runs are made many at once where the tracker offers it. The tables are the same.
        on_compile: Called when the first kernel is compiled, if one is: kernels are cached once on a machine.
        code: Digest of the code, which is stored in the file's provenance; a campaign gives it.
        plugins: Whether a result may name any plug-in, as in `load`.
        watched: Returns the recorder that stands before the file and passes on all rows, as for a live view.
        timeout: Time limit of one run (s), after which it fails; None: there is none.

    Raises:
        ScenarioError: The scenario is invalid.
        RunError: A simulation failed.
        StorageError: The file cannot be written.
        UsageError: `replicates` is neither a number of runs nor a list of different run numbers.
    """
    runs = _RunSeries(scenario, replicates, plugins, batch, timeout)
    result = ResultFile(Path(out), runs.layout.states, runs.setup.record, **runs.layout.keywords)
    made_by = {"command_line": command_line, "code": code}
    return runs.make(result, Path(out), made_by, progress, on_compile, watched)


def run_in_memory(
    scenario: Source,
    *,
    replicates: int | Sequence[int] | None = None,
    command_line: str = "",
    progress: Callable[[Progress], None] | None = None,
    batch: bool = True,
    plugins: bool = False,
    timeout: float | None = None,
) -> tuple[Report, MemoryResult]:
    """Run a scenario several times without a file.

    Args:
        scenario: What `load` takes, or a Scenario.
        replicates: Number of runs, or the numbers of the runs; by default the number that the scenario says.
        command_line: The command that is stored in the provenance.
        progress: Called at most ten times a second.
        batch: Whether standalone runs are made many at once where the tracker offers it. The tables are the same.
        plugins: Whether a result may name any plug-in, as in `load`.
        timeout: Time limit of one run (s), after which it fails; None: there is none.

    Returns:
        The report, and the tables, which `save` writes as `run` would have written them.

    Raises:
        ScenarioError: The scenario is invalid.
        RunError: A simulation failed.
        UsageError: `replicates` is neither a number of runs nor a list of different run numbers.
    """
    runs = _RunSeries(scenario, replicates, plugins, batch, timeout)
    result = MemoryResult(runs.layout.states, runs.setup.record, **runs.layout.keywords)
    return runs.make(result, Path(), {"command_line": command_line}, progress), result


class _RunSeries:
    """The runs of a scenario that go into one result.

    Attributes:
        setup: The setup of the scenario.
        layout: The layout of the tables.
    """

    def __init__(
        self, scenario: Source, replicates: int | Sequence[int] | None, plugins: bool, batch: bool,
        timeout: float | None,
    ) -> None:  # fmt: skip
        self._began, self._compiled, self._timeout = time.monotonic(), compilation_seconds(), time_limit(timeout)
        self._scenario = load(scenario, plugins=plugins)
        self.setup = scenarios.build(self._scenario)
        self.layout = table_layout(self.setup)
        self._numbers = run_numbers(self._scenario.replicates if replicates is None else replicates)
        several = len(self._numbers) > 1 and not self._timeout  # a block holds many runs
        self._batch = batch and several and offers_batch(self.setup)

    def make(
        self, result: ResultFile | MemoryResult, out: Path, origin: Mapping[str, str],
        progress: Callable[[Progress], None] | None, on_compile: Callable[[], None] | None = None,
        watched: Callable[[Recorder], Recorder] | None = None,
    ) -> Report:  # fmt: skip
        """Make the runs; their tables and texts go to `result`."""
        loaded, setup = self._scenario, self.setup
        with announced(on_compile), result as file:
            file.set_text("scenario/source_yaml", loaded.source_yaml)
            resolved = {**scenarios.resolved(loaded), "replicates": len(self._numbers)}
            file.set_text("scenario/resolved_json", json.dumps(resolved))
            made_by = provenance(origin["command_line"], setup.seed, scenarios.plugins(loaded), loaded.overrides)
            made_by |= provenance_of(setup) | ({"code": origin["code"]} if origin.get("code") else {})
            file.set_text("provenance_json", json.dumps({**made_by, "engine": "composed"}))
            batches: Batches | None = None
            if self._batch:
                from wsnsim.offline.batch import Batches

                batches = Batches(setup, file, StandaloneReports, time_without_compilation)
            prepared = time.monotonic() - self._began - compilation_wall()

            def reporting(first: Progress) -> OnTime | None:
                return throttled(progress, first, self._began, lambda: prepared + compilation_wall())

            summaries = self._make_all(watched(file) if watched else file, batches, reporting)
            if batches and batches.used:
                file.set_text("provenance_json", json.dumps({**made_by, "engine": "batch"}))
        wall, compiled = time.monotonic() - self._began, compilation_seconds() - self._compiled
        return Report(loaded, tuple(summaries), out, wall, self.layout.states, self.layout.position, compiled)

    def _make_all(
        self, recorder: Recorder, batches: Batches | None, reporting: Callable[[Progress], OnTime | None]
    ) -> list[Summary]:
        """Make all runs, in blocks while there are `batches` of them, else one by one."""
        summaries: list[Summary] = []
        setup, numbers = self.setup, self._numbers
        while len(summaries) < len(numbers):
            left = numbers[len(summaries) :]
            with contained(plugin_classes(vars(setup).values()) if batches else ()):
                block = batches.next(left) if batches else []
            number = len(summaries) + max(len(block), 1) - 1
            on_time = reporting(Progress(number, len(numbers), 0.0, setup.duration, 0.0))
            if not block:
                one = partial(replicate_of, setup, left[0], recorder, on_time)
                summaries.append(limited(one, self._timeout, f"the run (seed {setup.seed}, replicate {left[0]})"))
            summaries += block
            if on_time:
                on_time(setup.duration)
        return summaries
