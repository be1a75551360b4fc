"""The outcome of a run of a network, and its rows of the result's tables.

write_tables(outcome, replicate, setup, recorder)     network_result(outcome, setup, coverage) -> RunResult
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.frames import Counters
from wsnsim.base.ports import Recorder
from wsnsim.base.results import RADIO_COUNTERS, RunResult, RunTotals, TrackResult
from wsnsim.base.sensing import gain_factors
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.base.tables import CAUSES
from wsnsim.network.clusters.track import ClusterRecord, Track
from wsnsim.network.nodes import Nodes

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class NetworkOutcome:
    """The state of a network at the end of a run.

    Attributes:
        nodes: the nodes, each with the energy that it has spent.
        counters: the counters of the radio.
        event_fingerprint: fingerprint of the event log.
        awake: share of the nodes' total time in which they were awake.
        radio_on: share of it in which their radios were on; None where the radio of a node that is awake always is.
        cycles: operations that trackers computed.
        hurried: share of the nodes' total time at the short wake interval; NaN where there is one interval.
        steps: number of the last step.
        tracks: one per target; none in a network without targets.
        woken: numbers of nodes that woke, and of those that woke unnecessarily, (targets, steps + 1, 2).
        received: time in s at which the sink received the estimate of (target, step).
    """

    nodes: Nodes
    counters: Counters
    event_fingerprint: int
    awake: float
    cycles: float = 0.0
    hurried: float = NAN
    steps: int = 0
    tracks: tuple[Track, ...] = ()
    woken: Ints = field(default_factory=lambda: np.zeros((0, 1, 2), dtype=np.int64))
    received: Mapping[tuple[int, int], float] = field(default_factory=dict)
    radio_on: float | None = None


def write_tables(outcome: NetworkOutcome, replicate: int, setup: RadioSetup, recorder: Recorder) -> None:
    """Write the tables `nodes`, `energy`, `clusters` and `wakeups` of a finished run."""
    trait_names = setup.sensor.trait_names if isinstance(setup, NetworkSetup) else ()
    _write(recorder, "nodes", replicate, _nodes(outcome.nodes, trait_names))
    _write(recorder, "energy", replicate, _energy(outcome.nodes))
    for track in outcome.tracks:
        names = [each.name for each in fields(ClusterRecord)]
        _write(recorder, "clusters", replicate, {"target": track.target, **_columns(track.clusters, names)})
        if track.rounds:
            _write(recorder, "wakeups", replicate, {"target": track.target, **_wakeups(track.rounds)})


def network_result(outcome: NetworkOutcome, setup: RadioSetup, coverage: float = NAN) -> RunResult:
    """The result of a run, with targets or without.

    Args:
        outcome: The state of the network at the end of the run.
        setup: The scenario.
        coverage: Fraction of the field that the living nodes sense; NaN without targets.
    """
    joules = {cause: total for cause, total in zip(CAUSES, outcome.nodes.ledger.totals, strict=True) if total}
    totals = _totals(outcome, coverage)
    if not isinstance(setup, NetworkSetup):
        return RunResult(outcome.steps + 1, (), totals, joules)
    tracks = [TrackResult(t.estimates, t.heads, network_columns(outcome, t), _track_columns(t)) for t in outcome.tracks]
    clusters = sum(len(track.clusters) for track in outcome.tracks)
    return RunResult(outcome.steps, tracks, totals, joules, clusters, setup.due_reports(outcome.steps))


def network_columns(outcome: NetworkOutcome, track: Track) -> dict[str, Any]:
    """The columns of the table `estimates` that only a network has."""
    woken = outcome.woken[track.target, 1 : outcome.steps + 1]
    received = [outcome.received.get((track.target, step), NAN) for step in range(1, outcome.steps + 1)]
    return {"woken": woken[:, 0], "ineffective": woken[:, 1], "received": np.array(received)}


def _track_columns(track: Track) -> dict[str, float]:
    """The columns of the table `tracks` that only a network has."""
    called, dismissed = (sum(map(attrgetter(name), track.rounds)) for name in ("called", "dismissed"))
    bits = [cluster.handover_bits for cluster in track.clusters if cluster.handover_bits]
    mean_bits = sum(bits) / len(bits) if bits else NAN
    return {"reacquired": track.reacquired, "called": called, "dismissed": dismissed, "handover_bits": mean_bits}


def _totals(outcome: NetworkOutcome, coverage: float) -> RunTotals:
    """The columns of the table `runs` that do not depend on estimates."""
    nodes = outcome.nodes
    deaths = sorted(nodes.died_at.values())
    half = (nodes.size + 1) // 2
    return RunTotals(
        event_fingerprint=outcome.event_fingerprint,
        alive=sum(nodes.alive),
        energy=float(sum(nodes.ledger.totals)),
        handovers=sum(track.handovers for track in outcome.tracks),
        cycles=outcome.cycles,
        awake=outcome.awake,
        radio_on=outcome.radio_on,
        hurried=None if outcome.radio_on is None else outcome.hurried,
        first_death=deaths[0] if deaths else NAN,
        half_dead=deaths[half - 1] if len(deaths) >= half else NAN,
        coverage=coverage,
        **{name: getattr(outcome.counters, name) for name in RADIO_COUNTERS},
    )


def _write(recorder: Recorder, table: str, replicate: int, columns: dict[str, Any]) -> None:
    if recorder.wants(table):
        recorder.write(table, {"replicate": replicate, **columns})


def _nodes(nodes: Nodes, trait_names: tuple[str, ...]) -> dict[str, Any]:
    gain = gain_factors(trait_names, nodes.traits)
    died = np.full(nodes.size, NAN) if nodes.died_at else np.broadcast_to(NAN, nodes.size)
    for node, time in nodes.died_at.items():
        died[node] = time
    return {
        "node": np.arange(nodes.size),
        "x": nodes.positions[:, 0],
        "y": nodes.positions[:, 1],
        "x_assumed": nodes.assumed.positions[:, 0],
        "y_assumed": nodes.assumed.positions[:, 1],
        "gain": gain,
        "energy_initial": np.broadcast_to(float(nodes.battery), nodes.size),
        "energy_left": nodes.residual_energies(),
        "died_at": died,
    }


def _energy(nodes: Nodes) -> dict[str, Any]:
    consumers = np.flatnonzero(nodes.ledger.spent)
    joules = nodes.ledger.joules[:, consumers].T
    row, cause = np.nonzero(joules)
    return {"node": consumers[row], "cause": cause, "joules": joules[row, cause]}


def _wakeups(rounds: Sequence[WakeUpRound]) -> dict[str, Any]:
    own = ("time", "node", "sequence", "foreseen", "forwards", "called", "dismissed", "woken", "ineffective", "expired")
    messages = [each.message for each in rounds]
    x, y = np.array([message.centre for message in messages]).T
    return {**_columns(rounds, own), **_columns(messages, ("step", "radius", "expires")), "x": x, "y": y}


def _columns(records: Sequence[Any], names: Sequence[str]) -> dict[str, Floats]:
    """One column per attribute."""
    return {name: np.array(list(map(attrgetter(name), records)), dtype=np.float64) for name in names}
