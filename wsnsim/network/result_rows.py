"""What a network leaves behind, as rows of the result's tables.

write_rows(outcome, replicate, parts, recorder)     network_result(outcome, setup, coverage) -> RunResult
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from wsnsim.base.ports import Recorder
from wsnsim.base.results import RADIO_COUNTERS, RunResult, RunTotals, TrackResult
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.base.tables import CAUSES
from wsnsim.network.clusters.track import ClusterRecord, Track
from wsnsim.network.nodes import Nodes
from wsnsim.network.outcome import NetworkOutcome

NAN = float("nan")


def write_rows(outcome: NetworkOutcome, replicate: int, parts: NetworkSetup, recorder: Recorder) -> None:
    """Write the tables of nodes, energy and clusters of a run that ended."""
    write_network(outcome.nodes, replicate, parts.sensor.trait_names, recorder)
    for track in outcome.tracks:
        _write(recorder, "clusters", replicate, {"target": track.target, **_clusters(track.clusters)})
        if track.rounds:
            _write(recorder, "wakeups", replicate, {"target": track.target, **_wakeups(track.rounds)})


def write_network(fleet: Nodes, replicate: int, trait_names: tuple[str, ...], recorder: Recorder) -> None:
    """Write the tables of nodes and energy."""
    _write(recorder, "nodes", replicate, _nodes(fleet, trait_names))
    _write(recorder, "energy", replicate, _energy(fleet))


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
        return RunResult(setup.steps, (), totals, joules)
    tracks = [TrackResult(t.estimates, t.heads, woken_rows(outcome, t), _counts(t)) for t in outcome.tracks]
    clusters = sum(len(track.clusters) for track in outcome.tracks)
    return RunResult(outcome.steps, tracks, totals, joules, clusters, setup.due_reports(outcome.steps))


def woken_rows(outcome: NetworkOutcome, track: Track) -> dict[str, Any]:
    """The columns of the table `estimates` that only a network has."""
    woken = outcome.woken[track.target, 1 : outcome.steps + 1]
    received = [outcome.received.get((track.target, step), NAN) for step in range(1, outcome.steps + 1)]
    return {"woken": woken[:, 0], "ineffective": woken[:, 1], "received": np.array(received)}


def _counts(track: Track) -> dict[str, int]:
    """The columns of the table `tracks` that only a network has."""
    called = {name: sum(getattr(one, name) for one in track.rounds) for name in ("called", "dismissed")}
    return {"reacquired": track.reacquired, **called}


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
        first_death=deaths[0] if deaths else NAN,
        half_dead=deaths[half - 1] if len(deaths) >= half else NAN,
        coverage=coverage,
        **{name: getattr(outcome.counts, name) for name in RADIO_COUNTERS},
    )


def _write(recorder: Recorder, table: str, replicate: int, columns: dict[str, Any]) -> None:
    if recorder.wants(table):
        recorder.write(table, {"replicate": replicate, **columns})


def _nodes(fleet: Nodes, trait_names: tuple[str, ...]) -> dict[str, Any]:
    gain = fleet.traits[:, trait_names.index("gain")] if "gain" in trait_names else np.ones(fleet.size)
    died = np.full(fleet.size, NAN)
    for node, time in fleet.died_at.items():
        died[node] = time
    return {
        "node": np.arange(fleet.size),
        "x": fleet.positions[:, 0],
        "y": fleet.positions[:, 1],
        "gain": gain,
        "energy_initial": np.full(fleet.size, fleet.battery),
        "energy_left": fleet.residual_energies(),
        "died_at": died,
    }


def _energy(fleet: Nodes) -> dict[str, Any]:
    touched = np.flatnonzero(fleet.ledger.spent)
    books = fleet.ledger.joules[:, touched].T
    row, cause = np.nonzero(books)
    return {"node": touched[row], "cause": cause, "joules": books[row, cause]}


def _clusters(clusters: Sequence[ClusterRecord]) -> dict[str, Any]:
    names = {"number": "cluster"}
    return {
        names.get(f.name, f.name): np.array([getattr(cluster, f.name) for cluster in clusters], dtype=np.float64)
        for f in fields(ClusterRecord)
    }


def _wakeups(rounds: Sequence[WakeUpRound]) -> dict[str, Any]:
    own = ("time", "node", "sequence", "foreseen", "forwards", "called", "dismissed", "woken", "ineffective", "expired")
    columns = {name: np.array([getattr(one, name) for one in rounds], dtype=np.float64) for name in own}
    for name in ("step", "radius", "expires"):
        columns[name] = np.array([getattr(one.message, name) for one in rounds], dtype=np.float64)
    columns["x"], columns["y"] = np.array([one.message.centre for one in rounds]).T
    return columns
