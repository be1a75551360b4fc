"""What must hold in every run of every valid scenario, found in the rows of its tables.

    broken(run) -> ["a sentence", ...]      empty if everything holds

Each property is a function of a `Run` that yields a sentence for each violation. None of them uses how the network
comes to its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from tests.fuzz.fates import packets_in_are_packets_out_and_lost
from tests.fuzz.given_frames import Frames, watched_frames
from tests.fuzz.listening import Listening, watched_schedules
from tests.fuzz.radios_on import RadiosOn, watched_radios
from wsnsim import experiment, scenario
from wsnsim.base.setups import Setup
from wsnsim.base.tables import CAUSE, CAUSES, EVENT_CAUSE, KIND, LOSSES, Memory
from wsnsim.experiment import Summary
from wsnsim.models.access import IdealMac
from wsnsim.trackers.information_driven import InformationDriven
from wsnsim.trackers.parallel_pf import ParallelPf
from wsnsim.trackers.pso_mhpf import PsoMhpf

ROUNDING: Final = 1e-9
"""Relative error of sums of thousands of floating-point numbers."""
BOOKED: Final = {name: (name,) for name in ("rx", "overhear", "cpu", "sense")} | {
    "tx": ("tx_electronics", "tx_amplifier")
}
"""Causes of consumption that have events, with those in the ledger."""
STARTS: Final = ("send", "relay")
ARRIVALS: Final = ("receive", "overhear", "collide")
ACTS: Final = (*STARTS, *ARRIVALS, "sense", "compute", "join", "announce", "elect", "allocate", "estimate", "handover")

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Run:
    """A finished run: its setup, tables and summary; which nodes and which radios listened, what the MAC was given."""

    setup: Setup
    memory: Memory
    summary: Summary
    listening: Listening
    frames: Frames
    radios: RadiosOn

    @cached_property
    def events(self) -> Columns:
        """The table of events; no columns without a network."""
        return self.memory.table("events")

    @cached_property
    def end(self) -> float:
        """The time at which the run ends, in s."""
        return self.setup.duration

    def rows(self, *kinds: str) -> np.ndarray:
        """(R,) the rows of the events of these kinds."""
        return np.flatnonzero(np.isin(self.events["kind"], [KIND[kind] for kind in kinds]))


def made(values: dict[str, Any], replicate: int = 0) -> Run:
    """The run of a scenario. Raises what `load`, `build` and the run raise."""
    setup = scenario.build(scenario.load(values))
    memory = Memory(setup.record)
    with watched_schedules() as listening, watched_frames() as frames, watched_radios() as radios:
        summary = experiment.replicate_of(setup, replicate, memory)
    return Run(setup, memory, summary, listening, frames, radios)


def broken(run: Run) -> list[str]:
    """The sentences of all properties that do not hold."""
    chosen = (*OF_ALL, *(OF_NETWORKS if run.events else ()))
    return [f"{rule.__name__}: {found}" for rule in chosen for found in rule(run)]


def estimates_are_finite(run: Run) -> Iterator[str]:
    """An estimate that was issued has a finite error and a positive variance, unless its covariance is none."""
    table = run.memory.table("estimates")
    if not table:
        return
    issued = np.isfinite(table["issued"])
    spreads = ("sd_x", "sd_y") if getattr(run.setup.tracker, "has_covariance", True) else ()
    for name in ("error", *spreads):
        if name in table and not np.isfinite(table[name][issued]).all():
            yield f"{name} of step {table['step'][issued & ~np.isfinite(table[name])][0]} is not finite"
    if (table["sd_x"][issued] < 0).any():
        yield "a standard deviation is negative"


def estimates_follow_their_step(run: Run) -> Iterator[str]:
    """An estimate is issued after its step has begun, and received after it was issued."""
    table = run.memory.table("estimates")
    if not table:
        return
    early = table["issued"] < table["time"] - ROUNDING * run.end
    if early.any():
        yield f"the estimate of step {table['step'][early][0]} was issued before its step"
    sooner = table["received"] < table["issued"] - ROUNDING * run.end
    if sooner.any():
        yield f"the sink had the estimate of step {table['step'][sooner][0]} before it was issued"
    if (np.isfinite(table["received"]) & ~np.isfinite(table["issued"])).any():
        yield "the sink received an estimate that was never issued"


def estimates_use_what_arrived(run: Run) -> Iterator[str]:
    """A step uses measurements of the head, and of nodes that sensed and of which something arrived at the head.

    A packet may carry what its sender measured in as many steps as the tracker packs.
    """
    table, events = run.memory.table("estimates"), run.events
    if not table:
        return
    if (table["active"] > table["members"]).any():
        yield "more members sense than there are"
    first = run.rows("send")[::-1]  # the first row counts: later ones are retransmissions and acknowledgements
    origins = dict(zip(events["sequence"][first].tolist(), events["node"][first].tolist(), strict=True))
    measured, heard = _measured(run), run.rows("receive")
    tracker = run.setup.tracker
    # members, and participants without a head, use their own measurements
    local = isinstance(tracker, PsoMhpf | ParallelPf) or getattr(tracker, "headless", False)
    packed = tracker.every if isinstance(tracker, InformationDriven) else 1
    wrong = max((abs(getattr(fault, "offset", 0.0)) for fault in run.setup.faults), default=0.0)
    stepped = (wrong + 3.0 * getattr(run.setup.clock, "offset", 0.0)) / run.setup.dt
    astray = int(np.ceil(stepped)) + (stepped > 0.0)  # steps by which time stamps of measurements may be wrong
    names = "target" if "target" in table else "track", "step", "time", "issued", "head", "readings"
    for target, step, time, issued, head, readings in zip(*(table[name].tolist() for name in names), strict=True):
        if not np.isfinite(issued) or readings == 0:
            continue
        age = step - measured[:, 1]
        named = measured[:, 3] == target if "target" in table else True
        taken = {tuple(row) for row in measured[(age >= -astray) & (age < packed + astray) & named, :3].tolist()}
        nodes = {node for node, *_ in taken}
        late = (events["time"][heard] >= time) & (events["time"][heard] <= issued) & (events["node"][heard] == head)
        known = set(nodes) if local else {head}
        known |= {origins.get(sequence, -1) for sequence in events["sequence"][heard][late].tolist()}
        if readings > sum(node in known for node, *_ in taken):
            who = f"{sorted(nodes)} sensed, the head {head} heard {sorted(known)}"
            yield f"step {step} uses {readings} measurements; {who}"


def _measured(run: Run) -> np.ndarray:
    """(M, 4) the node, the step, the number in its scan, and the target of measurements; -1: readings name none."""
    detections, rows = run.memory.table("detections"), run.rows("sense")
    if detections:
        columns = [detections[name].astype(int) for name in ("node", "step", "detection")]
        return np.stack([*columns, np.full(columns[0].size, -1)], axis=1)
    node, step, target = (run.events[name][rows].astype(int) for name in ("node", "step", "target"))
    return np.stack([node, step, np.zeros(rows.size, dtype=int), target], axis=1)


def the_ledger_closes(run: Run) -> Iterator[str]:
    """What each node spent is booked once: by cause, by step, and in the events of what costs by the act."""
    nodes, energy, steps = (run.memory.table(name) for name in ("nodes", "energy", "energy_steps"))
    total = run.summary.run["energy"]
    spent = np.zeros(nodes["node"].size)
    if energy:
        np.add.at(spent, energy["node"].astype(int), energy["joules"])
    left = nodes["energy_initial"] - nodes["energy_left"]
    slack = 1e-12 * nodes["energy_initial"].max() + 1e-15
    for node in np.flatnonzero(~np.isclose(spent, left, rtol=ROUNDING, atol=slack)):
        yield f"node {node} booked {spent[node]!r} J, and its battery lost {left[node]!r} J"
    for name, table in (("energy", energy), ("energy_steps", steps)):
        own = ~np.isin(table["cause"], [CAUSE[name] for name in LOSSES]) if table else np.zeros(0, dtype=bool)
        booked = float(table["joules"][own].sum()) if table else 0.0
        if not np.isclose(booked, total, rtol=ROUNDING, atol=1e-15):
            yield f"{name} sums to {booked!r} J, the run spent {total!r} J"
    yield from _events_without_a_booking(run, energy)


def _events_without_a_booking(run: Run, energy: Columns) -> Iterator[str]:
    for cause, names in BOOKED.items():
        rows = run.events["cause"] == EVENT_CAUSE[cause]
        logged = float(run.events["joules"][rows].sum())
        booked = sum(float(energy["joules"][energy["cause"] == CAUSE[name]].sum()) for name in names) if energy else 0.0
        if cause == "sense" and booked > logged:
            continue  # sensing over time has no events
        if not np.isclose(logged, booked, rtol=ROUNDING, atol=1e-15):
            yield f"events of {cause} sum to {logged!r} J, the ledger holds {booked!r} J"


def nobody_spends_more_than_its_battery(run: Run) -> Iterator[str]:
    """No node spends more than its battery, a node is dead if and only if it spent all, and no row is negative."""
    nodes, steps = run.memory.table("nodes"), run.memory.table("energy_steps")
    initial, left = nodes["energy_initial"], nodes["energy_left"]
    for node in np.flatnonzero(left < -1e-12 * initial):
        yield f"node {node} spent {-left[node]!r} J more than its battery of {initial[node]!r} J"
    dead = np.isfinite(nodes["died_at"])
    for node in np.flatnonzero(dead != (left <= 1e-12 * initial)):
        yield f"node {node} has {left[node]!r} J left and is {'dead' if dead[node] else 'alive'}"
    if steps and (steps["joules"] < -1e-12 * abs(run.summary.run["energy"])).any():
        yield f"a row of energy_steps is {steps['joules'].min()!r} J"
    if run.memory.table("energy") and (run.memory.table("energy")["joules"] < 0.0).any():
        yield "a row of the ledger is negative"
    if run.summary.run["alive"] != int((~dead).sum()) and not (run.events["kind"] == KIND["crash"]).any():
        yield f"{run.summary.run['alive']} nodes are alive, and {int((~dead).sum())} have not died"


def nothing_happens_before_its_cause(run: Run) -> Iterator[str]:
    """Whatever arrives was sent before by the node that it names; nothing happens before 0 or long after the end."""
    events = run.events
    if (events["time"] < 0.0).any():
        yield "an event is before the start"
    first: dict[tuple[int, int], float] = {}
    for row in run.rows(*STARTS):
        key = int(events["frame"][row]), int(events["node"][row])
        first[key] = min(first.get(key, np.inf), float(events["time"][row]))
    for row in run.rows("receive", "collide", "overhear"):
        key, time = (int(events["frame"][row]), int(events["peer"][row])), float(events["time"][row])
        if key[0] == 0:
            continue
        if key not in first:
            yield f"node {events['node'][row]} heard frame {key[0]} of node {key[1]}, who never sent it"
        elif time < first[key]:
            yield f"node {events['node'][row]} heard frame {key[0]} at {time!r} s, sent at {first[key]!r} s"
    clusters = run.memory.table("clusters")
    if clusters and (clusters["released"] < clusters["formed"]).any():
        yield "a cluster was released before it was formed"


def nobody_acts_while_down(run: Run) -> Iterator[str]:
    """Between a crash and the restart, and after its death, a node does nothing, but for the act that it died of."""
    events, down = run.events, {}
    acts, falls = {KIND[kind] for kind in ACTS}, {KIND["crash"], KIND["death"]}
    for time, node, kind in zip(*(events[name].tolist() for name in ("time", "node", "kind")), strict=True):
        if kind in falls:
            down[node] = time
        elif kind == KIND["restart"]:
            down.pop(node, None)
        elif kind in acts and down.get(node, time) != time:
            yield f"node {node} acted (kind {kind}) at {time!r} s, down since {down[node]!r} s"


def nobody_hears_while_asleep(run: Run) -> Iterator[str]:
    """A node that receives, overhears or loses a frame to a collision was listening when the frame began.

    On the ideal channel a frame is heard at its end, by whoever listens then.
    """
    if run.listening.schedules is None:
        return
    events, rate = run.events, getattr(run.setup.mac, "rate", None) or np.inf
    ideal = isinstance(run.setup.mac, IdealMac)
    ends: dict[int, list[tuple[float, float]]] = {}
    for row in run.rows(*STARTS):
        time = float(events["time"][row])  # that of the end of a frame, where frames take time
        ends.setdefault(int(events["frame"][row]), []).append((time - float(events["bits"][row]) / rate, time))
    for row in run.rows(*ARRIVALS):
        node, time = int(events["node"][row]), float(events["time"][row])
        before = [begin for begin, end in ends.get(int(events["frame"][row]), []) if end <= time]
        begin = max(before, default=time)
        if not run.listening.within(node, begin - 1e-9, time if ideal else begin + 1e-9):
            yield f"node {node} heard a frame at {time!r} s that began at {begin!r} s, when it was asleep"


def nobody_hears_with_the_radio_off(run: Run) -> Iterator[str]:
    """The radio of a node that receives or overhears a frame, or loses it to a collision, was on when it began.

    It was in a wake-up or a slot of its own, or it was held on, or its node was charged for the time.
    """
    events = run.events
    if run.radios.mac is None:
        return
    for row in run.rows(*ARRIVALS):
        node, frame = int(events["node"][row]), int(events["frame"][row])
        if events["joules"][row] > 0.0 and not run.radios.was_on(node, frame):
            yield f"node {node} heard frame {frame}, which ended at {events['time'][row]!r} s, with its radio off"


def packets_are_received_or_lost(run: Run) -> Iterator[str]:
    """Nobody receives more of a burst than was sent; counters of receptions and of packets are those of the events."""
    events, totals = run.events, run.summary.run
    sent: dict[int, int] = {}
    for row in run.rows(*STARTS):
        frame = int(events["frame"][row])
        sent[frame] = max(sent.get(frame, 0), int(events["packets"][row]))
    got: dict[tuple[int, int], int] = {}
    for row in run.rows("receive"):
        key = int(events["frame"][row]), int(events["node"][row])
        got[key] = got.get(key, 0) + int(events["packets"][row])
    for (frame, node), packets in got.items():
        if frame and packets > sent.get(frame, 0):
            yield f"node {node} received {packets} packets of frame {frame}, which had {sent.get(frame, 0)}"
    if totals["delivered"] + totals["collided"] > totals["in_range"]:
        yield f"{totals['delivered']} receptions and {totals['collided']} collisions of {totals['in_range']} in range"
    never_sent = int((events["frame"][run.rows("drop")] == 0).sum())
    if totals["frames_lost"] > totals["frames_sent"] + never_sent:
        yield f"{totals['frames_lost']} bursts lost of {totals['frames_sent']} and {never_sent} that were never sent"


OF_ALL: Final[tuple[Callable[[Run], Iterator[str]], ...]] = (estimates_are_finite, estimates_follow_their_step)
OF_NETWORKS: Final[tuple[Callable[[Run], Iterator[str]], ...]] = (
    the_ledger_closes, nobody_spends_more_than_its_battery, nothing_happens_before_its_cause, nobody_acts_while_down,
    nobody_hears_while_asleep, nobody_hears_with_the_radio_off, packets_are_received_or_lost,
    packets_in_are_packets_out_and_lost, estimates_use_what_arrived,
)  # fmt: skip
assert set(CAUSES) >= {name for names in BOOKED.values() for name in names}
