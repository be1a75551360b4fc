"""Scenarios run from Python: `simulate` makes one run in memory, `run` many, in memory or in a file.

`quiet` tells what a network spends without a target.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, Unpack

import wsnsim.experiment as experiment
from wsnsim.api.arguments import Changes, of_runs, overrides_of, renamed, result_file, shown
from wsnsim.api.result import Result
from wsnsim.base.errors import UsageError
from wsnsim.base.runs import Progress, run_number, run_numbers
from wsnsim.base.setups import NetworkSetup
from wsnsim.lifetimes.quiet import QuietPower, quiet_power
from wsnsim.recording.atomic_files import sole_writer
from wsnsim.scenario import Overrides
from wsnsim.scenario.build import build
from wsnsim.scenario.load import demand_scenario

Source: TypeAlias = Any
"""A scenario: the name of a shipped one, a file, a dict, what `load` returned, or a result file to be run again."""


def simulate(
    scenario: Source,
    *,
    seed: int | None = None,
    overrides: Overrides | None = (),
    keep: Iterable[str] | None = (),
    replicate: int = 0,
    progress: bool | Callable[[float], None] | None = None,
    plugins: bool = False,
    **changes: Unpack[Changes],
) -> Result:
    """Make one Monte Carlo run in memory. The same arguments give the same result, in any process.

    Example::

        simulate("pso_mhpf", tracker=PsoMhpf(particles=200), overrides={"link.reach": "60 m"}, keep=["events"])

    Args:
        scenario: a name, a file, a dict (whose values may be components), or what `load` returned.
        seed: the seed, if not that of the scenario.
        overrides: values to change, {'link.reach': '60 m'} or ['link.reach=60 m']. Numbers are in SI units.
        keep: tables to record beside those that the scenario records, such as 'events'.
        replicate: number of the run, from 0.
        progress: whether to show a progress bar (by default in notebooks), or a function of the simulated time (s).
        plugins: whether a result file may name any plug-in, as in `load`.
        changes: roles and other keys of the scenario: `tracker=Ekf()`, `link={"reach": "60 m"}`, `mac="csma"`,
            `duration="10 s"`.

    Returns:
        The result. It is in memory; `result.save(path)` writes it.

    Raises:
        ScenarioError: the scenario is invalid; every error is named with its key.
        RunError: the simulation failed.
        UsageError: there is no such argument or table.
    """
    chosen = overrides_of("simulate", changes, overrides, seed, keep)
    replicate = run_number(replicate)
    loaded = _loaded(scenario, chosen, plugins)
    given = (lambda now: progress(now.time)) if callable(progress) else progress
    with shown(given, loaded.name, "run", of_runs) as report:
        made = experiment.run_in_memory(loaded, replicates=[replicate], command_line="wsnsim.simulate", progress=report)
    return Result(*made)


def run(  # noqa: PLR0913
    scenario: Source,
    *,
    replicates: int | Sequence[int] | None = None,
    out: str | Path | None = None,
    seed: int | None = None,
    overrides: Overrides | None = (),
    keep: Iterable[str] | None = (),
    progress: bool | Callable[[Progress], None] | None = None,
    batch: bool = True,
    plugins: bool = False,
    timeout: float | None = None,
    **changes: Unpack[Changes],
) -> Result:
    """Make many Monte Carlo runs of a scenario, in a result file or in memory.

    Example::

        run("pso_mhpf", replicates=30, out="results/pso_mhpf.h5")

    Args:
        scenario: a name, a file, a dict (whose values may be components), or what `load` returned.
        replicates: number of runs, or the numbers of the runs; by default the number that the scenario says.
        out: the result file, which gets its name once it is complete; None: the result is in memory.
        seed: the seed, if not that of the scenario.
        overrides: values to change, {'link.reach': '60 m'} or ['link.reach=60 m']. Numbers are in SI units.
        keep: tables to record beside those that the scenario records, such as 'events'.
        progress: True for a progress bar, False for none, or a function that is called with a `Progress`. By default
            there is a bar in notebooks.
        batch: whether standalone runs are made many at once where the tracker offers it. The tables are the same.
        plugins: whether a result file may name any plug-in, as in `load`.
        timeout: time limit of one run in s, after which it fails; None: there is none.
        changes: roles and other keys of the scenario: `tracker=Ekf()`, `link={"reach": "60 m"}`, `mac="csma"`,
            `duration="10 s"`.

    Returns:
        The result, which reads its tables from the file if there is one.

    Raises:
        ScenarioError: the scenario is invalid; every error is named with its key.
        RunError: a simulation failed.
        StorageError: the file cannot be written.
        UsageError: there is no such argument or table, or `replicates` is no number of runs.
    """
    chosen = overrides_of("run", changes, overrides, seed, keep)
    if replicates is not None:
        replicates = run_numbers(replicates)
    target = None if out is None else result_file("out", out)
    loaded = _loaded(scenario, chosen, plugins)
    options: dict[str, Any] = {"replicates": replicates, "command_line": "wsnsim.run", "batch": batch}
    with shown(progress, loaded.name, "runs", of_runs) as report:
        options |= {"timeout": timeout, "progress": report}
        if target is None:
            return Result(*experiment.run_in_memory(loaded, **options))
        with sole_writer(target):
            return Result(experiment.run(loaded, out=target, **options))


def quiet(
    scenario: Source,
    *,
    dead: Iterable[int] = (),
    run: bool = False,
    replicate: int = 0,
    seed: int | None = None,
    overrides: Overrides | None = (),
    plugins: bool = False,
    **changes: Unpack[Changes],
) -> QuietPower:
    """The power of a network without a target, once it has settled, by node and cause.

    In closed form where the components have one, which takes milliseconds; else from a run of an hour or more. Faults
    of the scenario do not happen, and batteries last.

    Example::

        quiet("li_xmac", overrides={"mac.interval": "0.5 s"}).frame().mean()

    Args:
        scenario: what `simulate` takes, with a network.
        dead: numbers of nodes that are dead: they spend nothing, and others do not hear them.
        run: measure it in a run even where there is a closed form.
        replicate: number of the run whose network it is.
        seed: the seed, if not that of the scenario.
        overrides: values to change, as in `simulate`.
        plugins: whether a result file may name any plug-in, as in `load`.
        changes: roles and other keys of the scenario, as in `simulate`.

    Returns:
        `watts` and their standard `error`, (causes, N) each, why it was `measured`, and `frame()`.

    Raises:
        ScenarioError: the scenario is invalid.
        RunError: the simulation failed.
        UsageError: there is no such argument or node, or the scenario has no network that tracks targets.
    """
    loaded = _loaded(scenario, overrides_of("quiet", changes, overrides, seed, ()), plugins)
    setup = build(loaded)
    if not isinstance(setup, NetworkSetup):
        raise UsageError(f"quiet: '{loaded.name}' has no network that waits for targets: it has no quiet power")
    return quiet_power(setup, frozenset(dead), run_number(replicate), run)


def _loaded(scenario: Source, chosen: Sequence[Any], plugins: bool) -> Any:
    """The checked scenario of a caller."""
    demand_scenario(scenario)
    with renamed():
        return experiment.load(scenario, chosen, plugins)
