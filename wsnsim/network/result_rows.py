"""The outcome of a run of a network, its tables: energy by step, reports to sinks and errors of clocks among them.

write_tables(outcome, replicate, setup, recorder)     network_result(outcome, setup, coverage) -> RunResult
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.frames import Counters
from wsnsim.base.mechanisms import SyncMechanism
from wsnsim.base.results import RunResult, RunTotals, TrackResult
from wsnsim.base.sensing import gain_factors
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.base.sleeping import WakeUpRound
from wsnsim.base.tables import CAUSES, KIND, SPENT, Recorder
from wsnsim.network.clocks import Clocks
from wsnsim.network.clusters.track import ClusterRecord, Track, TrackBook
from wsnsim.network.event_log import EventLog, event, then
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.transport import Transport

NAN = float("nan")
REPORT = KIND["report"]
CLOCK_COLUMNS = ("step", "time", "error", "error_max", "spread", "spread_max", "synchronised")


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
        late_readings: {target: number of readings that its tracker used in a later step}; empty if it uses none.
        book: the tracks of readings that name no target.
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
    late_readings: Mapping[int, int] = field(default_factory=dict)
    book: TrackBook | None = None


def write_tables(outcome: NetworkOutcome, replicate: int, setup: RadioSetup, recorder: Recorder) -> None:
    """Write the tables `nodes`, `energy`, `clusters` and `wakeups` of a finished run."""
    trait_names = setup.sensor.trait_names if isinstance(setup, NetworkSetup) else ()
    _write(recorder, "nodes", replicate, _nodes(outcome.nodes, trait_names))
    _write(recorder, "energy", replicate, _energy(outcome.nodes))
    for track in outcome.tracks:
        write_clusters(replicate, recorder, track)
        if track.rounds:
            _write(recorder, "wakeups", replicate, {"target": track.target, **_wakeups(track.rounds)})


def write_clusters(replicate: int, recorder: Recorder, track: Track) -> None:
    """Write the rows of the table `clusters` of a track, or of a group of them."""
    names = [each.name for each in fields(ClusterRecord)]
    _write(recorder, "clusters", replicate, {"target": track.target, **_columns(track.clusters, names)})


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
    if outcome.book is not None:
        columns = outcome.book.columns(setup.filter_motion(0), outcome.received, setup.dt)
        clusters = outcome.book.clusters + sum(len(group.clusters) for group in outcome.tracks)
        return RunResult(outcome.steps, (), totals, joules, clusters, setup.report_every, columns)
    late = {target: {"late_readings": used} for target, used in outcome.late_readings.items()}
    tracks = [
        TrackResult(t.estimates, t.heads, network_columns(outcome, t), _track_columns(t) | late.get(t.target, {}))
        for t in outcome.tracks
    ]
    clusters = sum(len(track.clusters) for track in outcome.tracks)
    return RunResult(outcome.steps, tracks, totals, joules, clusters, setup.report_every)


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
        energy=float(sum(nodes.ledger.totals[: len(SPENT)])),
        handovers=sum(track.handovers for track in outcome.tracks) + (outcome.book.handovers if outcome.book else 0),
        cycles=outcome.cycles,
        awake=outcome.awake,
        radio_on=outcome.radio_on,
        hurried=None if outcome.radio_on is None else outcome.hurried,
        first_death=deaths[0] if deaths else NAN,
        half_dead=deaths[half - 1] if len(deaths) >= half else NAN,
        coverage=coverage,
        **{name: getattr(outcome.counters, name) for name in RunTotals._fields if hasattr(outcome.counters, name)},
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
        "energy_initial": nodes.initial_energies(),
        "energy_left": nodes.residual_energies(),
        **({} if nodes.storage is None or not nodes.storage.restarts else {"harvested": nodes.storage.harvested}),
        "died_at": died,
    }


def _energy(nodes: Nodes) -> dict[str, Any]:
    plain = nodes.storage is None  # otherwise `spent` is what a node lacks of a full charge
    consumers = np.flatnonzero(nodes.ledger.spent if plain else nodes.ledger.joules.any(axis=0))
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


class ReportRows:
    """The reports that nodes have sent to sinks, each with what became of it.

    Args:
        env: The clock.
        log: The event log.
        transport: What reports are sent with.
    """

    def __init__(self, env: simpy.Environment, log: EventLog, transport: Transport) -> None:
        self._env = env
        self._log = log
        self._transport = transport
        self._sent: list[tuple[Datagram, int, float]] = []

    def send(self, report: Datagram, target: int) -> simpy.Event:
        """Send a report to a sink. Its arrival is logged before the event fires that says that it has ended."""
        self._sent.append((report, target, self._env.now))
        ended = self._transport.carry([report], target)
        then(ended, self._log_arrival, report, target)
        return ended

    def write(self, replicate: int, recorder: Recorder) -> None:
        """Write the table, unless no report was sent."""
        if not self._sent or not recorder.wants("reports"):
            return
        reports, targets, times = zip(*self._sent, strict=True)
        columns = {
            "target": np.array(targets),
            "node": np.array([report.source for report in reports]),
            "time": np.array(times),
            "received": np.array([report.arrived_at if report.arrived else NAN for report in reports]),
            "sink": np.array([report.to if report.arrived else -1 for report in reports]),
            "hops": np.array([report.hops if report.arrived else 0 for report in reports]),
            "bits": np.array([report.bits for report in reports]),
        }
        recorder.write("reports", {"replicate": replicate, **columns})

    def _log_arrival(self, report: Datagram, target: int) -> None:
        if report.arrived:
            now, log = self._env.now, self._log
            log.add(
                event(now, log.step, target, report.to, REPORT, log.code("report"), peer=report.source, packets=1)
            )  # fmt: skip


class EnergySteps:
    """The table `energy_steps`: the network's totals at the ends of steps, from which its rows are computed."""

    def __init__(self, env: simpy.Environment, nodes: Nodes, recorder: Recorder) -> None:
        self._wanted = recorder.wants("energy_steps")
        self._env = env
        self._nodes = nodes
        self._totals: list[list[float]] = [nodes.totals_now()[:]]
        self._steps: list[int] = []
        self._times: list[float] = [env.now]

    def close(self, step: int) -> None:
        """Attribute to a step what was spent since the last call."""
        if not self._wanted:
            return
        self._totals.append(self._nodes.totals_now()[:])
        self._steps.append(step)
        self._times.append(self._env.now)

    def end(self, step: int) -> None:
        """Settle all nodes, and close the last step."""
        if self._wanted:
            scheduled = self._nodes.consumption.network.scheduled(np.array(self._times))
            self._totals = (np.array(self._totals) + scheduled).tolist()
        self._nodes.close()
        self.close(step)

    def write(self, replicate: int, dt: float, recorder: Recorder) -> None:
        """Write the table if it is wanted. Rows of zero are left out."""
        if not self._wanted:
            return
        spent = np.diff(_rising(np.array(self._totals)), axis=0)
        rows, causes = np.nonzero(spent)
        if rows.size:
            steps = np.array(self._steps)[rows]
            columns = {"step": steps, "time": steps * dt, "cause": causes, "joules": spent[rows, causes]}
            recorder.write("energy_steps", {"replicate": replicate, **columns})


def _rising(totals: Floats) -> Floats:
    """(T, causes) totals that never fall and end as given.

    They fall where a frame under way, during which its radio is not idle, is subtracted before its time has passed, and
    where rounding does so: the next steps are then less.
    """
    rising: Floats = np.minimum(np.maximum.accumulate(totals, axis=0), totals[-1])
    return rising


class ClockErrors:
    """The table `clocks`: the errors of clocks at the beginnings of steps."""

    def __init__(self, clocks: Clocks, nodes: Nodes, sync: SyncMechanism, recorder: Recorder) -> None:
        self._wanted = recorder.wants("clocks")
        self._clocks, self._nodes, self._sync = clocks, nodes, sync
        self._rows: list[tuple[float, ...]] = []

    def note(self, step: int, now: float) -> None:
        """Note the errors of the nodes that are up, at the beginning of a step."""
        if not self._wanted or not self._nodes.living.any():
            return
        up = np.flatnonzero(self._nodes.living)
        errors = self._clocks.error(up, now)
        sizes, spreads = np.abs(errors), np.abs(errors - errors.mean())
        synchronised = sum(map(self._sync.is_synchronised, up.tolist())) / len(up)
        self._rows.append((step, now, sizes.mean(), sizes.max(), spreads.mean(), spreads.max(), synchronised))

    def write(self, replicate: int, recorder: Recorder) -> None:
        """Write the table if it is wanted."""
        if self._rows:
            columns = dict(zip(CLOCK_COLUMNS, np.array(self._rows).T, strict=True))
            recorder.write("clocks", {"replicate": replicate, **columns})
