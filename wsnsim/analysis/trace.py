"""The description of one step of a run: readings, messages and their outcomes, estimates, and energy.

trace(path, step, replicate=0, target=None, limit=4) -> StepTrace;   text(trace);   as_json(trace)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wsnsim.analysis.event_groups import LoggedMessage, NodeAction, group_events
from wsnsim.analysis.logged_events import LoggedEvent, in_other_steps, layout_or_empty, rows_at
from wsnsim.analysis.multi_target import followed_estimates, is_unlabelled, swaps
from wsnsim.analysis.phrases import Sentence, StepContext, energy_in_words, fitting
from wsnsim.analysis.plot_data import Columns, number_span
from wsnsim.analysis.step_text import describe
from wsnsim.base.errors import ResultError, UsageError, counted
from wsnsim.recording import attributes, meanings, read_json, read_table, table_names

Record = Mapping[str, Any]


@dataclass(frozen=True)
class StepTrace:
    """One step of a run.

    Attributes:
        path: the result file.
        name: scenario and seed.
        replicate: number of the run.
        step: number of the step.
        start: start of the step, in s.
        dt: its length, in s.
        network: whether there is a network.
        units: units of the state columns.
        position: the state columns of the position.
        targets: {target: (truth, estimate)}, the rows of these tables, or None.
        acts: actions of nodes and messages, in the order in which they began.
        lines: their description.
        energy: J that the whole network spent in the step, by cause; None if not recorded.
        booked: J of the step's events (of the selected target), by cause.
        tracks: where readings name no target, the rows of `estimates` of the step; None: they name it. The estimates of
            targets are then those of the tracks that follow them.
        swaps: The events of identities that switch in the step, as `multi_target.swaps` derives them.
    """

    path: str
    name: str
    replicate: int
    step: int
    start: float
    dt: float
    network: bool
    units: Mapping[str, str]
    position: tuple[str, ...]
    targets: Mapping[int, tuple[Record | None, Record | None]]
    acts: Sequence[NodeAction | LoggedMessage]
    lines: Sequence[Sentence]
    energy: Mapping[str, float] | None
    booked: Mapping[str, float]
    tracks: Sequence[Record] | None = None
    swaps: Sequence[Record] = ()


def trace(path: str | Path, step: int, replicate: int = 0, target: int | None = None, limit: int = 4) -> StepTrace:
    """Describe one step of a result.

    Args:
        path: the result file.
        step: number of the step.
        replicate: number of the run.
        target: the target, or None for all.
        limit: number of similar messages up to which each is described; more are summed up.

    Raises:
        UsageError: there is no such run, step or target.
        ResultError: the file cannot be read, or holds no events.
    """
    scenario = read_json(path, "scenario/resolved_json")
    dt, network = float(scenario["step"]), scenario.get("network") != "none"
    _check(path, replicate, step)
    truths, estimates = (_of_run(path, table, replicate) for table in ("truth", "estimates"))
    unlabelled = is_unlabelled(path)
    held = [row for row in estimates if row["step"] == step] if unlabelled else []
    estimates = _of_run(path, "estimates", replicate, followed_estimates(path, replicate)) if unlabelled else estimates
    known = sorted({row["target"] for row in (*truths, *estimates)})
    if target is not None and target not in known:
        raise UsageError(f"{path}: no target {target}; it has {', '.join(map(str, known)) or 'none'}")
    if network and "events" not in table_names(path):
        raise ResultError(
            f"{path}: events were not recorded, so no step can be described; record them with: "
            f"wsnsim run {path} --set record.events=true --out FILE.h5"
        )
    rows = [
        row
        for row in (rows_at(path, replicate, step) if network else [])
        if unlabelled or target in (None, row.target) or row.target < 0
    ]
    chosen = known if target is None else [target]
    context = StepContext(
        _heads(rows, held or estimates, step),
        limit,
        {} if unlabelled else _issued(estimates, dt, path),
        unlabelled or len(known) > 1,
        "group" if unlabelled else "target",
    )
    acts = group_events(rows, in_other_steps(path, replicate, step, rows) if rows else {})
    switched = [swap for swap in swaps(path, replicate) if swap["step"] == step and swap["target"] in chosen]
    lines = sorted([*describe(acts, context), *map(_swap, switched)], key=lambda line: line.time)
    plan = layout_or_empty(path)
    return StepTrace(
        str(path), f"{scenario['name']}, seed {scenario['seed']}", replicate, step, step * dt, dt, network, plan.units,
        plan.position, {one: (_row(truths, one, step), _row(estimates, one, step)) for one in chosen}, acts,
        lines, _spent(path, replicate, step) if network else None, _booked(rows),
        held if unlabelled else None, switched,
    )  # fmt: skip


def _swap(swap: Record) -> Sentence:
    """A switched identity as a sentence."""
    said = f"swap: track {swap['track']} follows target {swap['target']}, as track {swap['before']} did before"
    return Sentence(swap["time"], swap["time"], said)


def text(picked: StepTrace) -> str:
    """The step for a terminal: positions of the targets, events in ms after its start, and energy."""
    run = f"replicate {picked.replicate}, step {picked.step}"
    lines = [f"{picked.path}: {picked.name}", f"{run}: from {picked.start:g} s to {picked.start + picked.dt:g} s"]
    for target, (truth, estimate) in picked.targets.items():
        where = f" is at {_place(picked, truth)}" if truth else ""
        lines.append(f"target {target}" + (" is absent" if "nan" in where else where))
        lines.append(f"  {_of_estimate(picked, estimate)}")
    lines += [f"track {row['track']}{' (tentative)' * (not row['confirmed'])}: {_place(picked, row)}, cluster head"
              f" {row['head']}" for row in picked.tracks or ()]  # fmt: skip
    if not picked.network:
        return fitting([*lines, "no network: nothing was sent and no energy was spent"], "    ")
    return fitting([*lines, "", *_happened(picked), "", *_cost(picked)], "    ")


def as_json(picked: StepTrace) -> dict[str, Any]:
    """The step as plain values; times in s."""
    return {
        "file": picked.path,
        **{key: getattr(picked, key) for key in ("replicate", "step", "start")},
        "seconds": picked.dt,
        "network": picked.network,
        "targets": {
            target: {"truth": truth, "estimate": estimate} for target, (truth, estimate) in picked.targets.items()
        },
        **({"tracks": list(picked.tracks), "swaps": list(picked.swaps)} if picked.tracks is not None else {}),
        "told": [line._asdict() for line in picked.lines],
        "acts": [asdict(act) for act in picked.acts if isinstance(act, NodeAction)],
        "messages": [asdict(act) | {"path": act.path} for act in picked.acts if isinstance(act, LoggedMessage)],
        "energy": picked.energy,
        "energy_of_events": dict(picked.booked),
    }


def _check(path: str | Path, replicate: int, step: int) -> None:
    """Raise UsageError unless the file has the run and the run has the step. Partial files are not checked."""
    if attributes(path)["status"] != "complete":
        return
    runs = read_table(path, "runs", ["replicate", "steps"])
    found = dict(zip(runs["replicate"].tolist(), runs["steps"].tolist(), strict=True))
    if replicate not in found:
        raise UsageError(f"{path}: no replicate {replicate}; it has {number_span(np.array(sorted(found)))}")
    if step > found[replicate]:
        raise UsageError(f"{path}: replicate {replicate} has steps 0 to {found[replicate]}, not {step}")


def _of_run(path: str | Path, table: str, replicate: int, columns: Columns | None = None) -> list[dict[str, Any]]:
    """The rows of one run as mappings, of the columns of a table; empty if the table was not recorded."""
    if columns is None:
        columns = read_table(path, table) if table in table_names(path) else {"replicate": np.empty(0)}
    rows = columns["replicate"] == replicate
    lists = {name: values[rows].tolist() for name, values in columns.items()}
    return [dict(zip(lists, values, strict=True)) for values in zip(*lists.values(), strict=True)]


def _row(rows: Sequence[dict[str, Any]], target: int, step: int) -> Record | None:
    return next((row for row in rows if row["target"] == target and row["step"] == step), None)


def _heads(rows: Sequence[LoggedEvent], estimates: Sequence[Record], step: int) -> frozenset[int]:
    """The cluster heads of the step, by the estimates and by the events that only heads have."""
    leads = {row["head"] for row in estimates if row["step"] == step}
    leads |= {row.node for row in rows if row.kind in ("announce", "allocate", "estimate", "handover")}
    return frozenset(leads - {-1})


def _issued(estimates: Sequence[Record], dt: float, path: str | Path) -> dict[tuple[int, float], str]:
    """The name of each estimate by target and time of issue."""
    plan = layout_or_empty(path)
    unit = f" {plan.units[plan.position[0]]}".rstrip() if plan.position else ""
    return {
        (row["target"], row["issued"]): f"the estimate of step {row['step']}, position error {row['error']:.3g}{unit}"
        + _late(row, dt)
        for row in estimates
        if row["issued"] == row["issued"]
    }


def _late(row: Record, dt: float) -> str:
    late = row["issued"] - (row["step"] + 1) * dt
    return f", late by {1e3 * late:.3g} ms" if row["late"] and late > 0 else ""


def _spent(path: str | Path, replicate: int, step: int) -> dict[str, float] | None:
    """The energy that the network spent in the step, by cause; None if not recorded."""
    if "energy_steps" not in table_names(path):
        return None
    table = read_table(path, "energy_steps", ["replicate", "step", "cause", "joules"])
    words = meanings(path, "energy_steps", "cause")
    at = (table["replicate"] == replicate) & (table["step"] == step)
    return {words[code]: joules for code, joules in zip(table["cause"][at], table["joules"][at].tolist(), strict=True)}


def _booked(rows: Sequence[LoggedEvent]) -> dict[str, float]:
    booked: dict[str, float] = {}
    for row in rows:
        if row.joules:
            booked[row.cause] = booked.get(row.cause, 0.0) + row.joules
    return booked


def _place(picked: StepTrace, row: Record) -> str:
    return ", ".join(f"{name} {row[name]:.4g} {picked.units[name]}".rstrip() for name in picked.position)


def _of_estimate(picked: StepTrace, row: Record | None) -> str:
    """The step's estimate with its error, time and readings; or the cluster head without an estimate."""
    if row is None and picked.tracks is not None:
        return "no confirmed track follows it"
    if row is None:
        return "no estimate: step 0 is the prior" if picked.step == 0 else "its estimates were not recorded"
    if np.isnan(row["issued"]):
        head = f"cluster head: node {row['head']}" if row["head"] >= 0 else "no cluster head"
        return f"no estimate of this step; {head}"
    unit = picked.units[picked.position[0]]
    after = row["issued"] - picked.start
    sentence = f"estimate {_place(picked, row)}: position error {row['error']:.3g} {unit}".rstrip()
    if not picked.network:
        return f"{sentence}, from {counted(row['readings'], 'reading')}"
    sentence += (
        f", issued by cluster head {row['head']} {_ms(after)} ms after the start of the step{_late(row, picked.dt)}"
    )
    sensed = f"{row['active']} of {counted(row['members'], 'member')} sensed"
    sentence += f"; {sensed}, {counted(row['readings'], 'reading')} used"
    received = row["received"]
    return sentence + (
        f"; at the sink {_ms(received - picked.start)} ms after the start" if received == received else ""
    )


def _happened(picked: StepTrace) -> list[str]:
    if not picked.lines:
        return ["nothing happened in this step"]
    spans = [_ms(line.time - picked.start) for line in picked.lines]
    ends = [_ms(line.until - picked.start) for line in picked.lines]
    left = [start if start == end else f"{start} … {end}" for start, end in zip(spans, ends, strict=True)]
    width = max(len(span) for span in [*left, "ms"])
    return [
        "ms".rjust(width),
        *(f"{span:>{width}}  {line.text}" for span, line in zip(left, picked.lines, strict=True)),
    ]


def _ms(seconds: float) -> str:
    return f"{round(1e3 * seconds, 3) + 0.0:.3f}"


def _cost(picked: StepTrace) -> list[str]:
    """The energy of the step, and the share of the events above."""
    booked = sum(picked.booked.values())
    events = f"the events above account for {energy_in_words(booked)}{_by_cause(picked.booked)}"
    if picked.energy is None:
        return [events]
    return [f"the network spent {energy_in_words(sum(picked.energy.values()))}{_by_cause(picked.energy)}", events]


def _by_cause(joules: Mapping[str, float]) -> str:
    parts = ", ".join(f"{cause.replace('_', ' ')} {energy_in_words(value)}" for cause, value in joules.items())
    return f": {parts}" if parts else ""
