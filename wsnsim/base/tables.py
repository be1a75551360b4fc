"""The tables of a result: what the network writes, the file stores and pandas reads.

A category column holds small unsigned integers; its meanings travel with it. The words of `events.what` and
`tracker_state.name` grow at run time (a tracker names its own parcels and quantities): a recorder holds them as
`Words`, and writes their meanings when it closes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

KINDS: Final = (
    "wake", "sleep", "sense", "elect", "join", "announce", "allocate", "send", "receive", "drop", "collide", "compute",
    "estimate", "handover", "relay", "lost", "reacquire", "crash", "restart", "death", "overhear", "fault", "report",
    "acquire", "call", "called", "leave", "return", "stay", "resume",
)  # fmt: skip
CAUSES: Final = ("tx_electronics", "tx_amplifier", "rx", "overhear", "cpu", "sense", "idle", "sleep", "switch", "leak")
EVENT_CAUSES: Final = ("none", "tx", "rx", "overhear", "cpu", "sense", "idle", "sleep", "switch", "leak")
STATUSES: Final = ("complete", "partial", "failed")
KIND: Final = {name: code for code, name in enumerate(KINDS)}
CAUSE: Final = {name: code for code, name in enumerate(CAUSES)}
EVENT_CAUSE: Final = {name: code for code, name in enumerate(EVENT_CAUSES)}


@dataclass(frozen=True, slots=True)
class Column:
    """One column: NumPy type, SI unit ('1' for a count, '' for an identifier), what it holds, its categories.

    `of_position`: it has the unit of the motion model's position, metres as a rule.
    """

    name: str
    dtype: str
    units: str
    description: str
    meanings: tuple[str, ...] = ()
    smooth: bool = False
    of_position: bool = False


def _c(
    name: str, dtype: str, units: str, description: str, meanings: tuple[str, ...] = (), smooth: bool = False
) -> Column:
    return Column(name, dtype, units, description, meanings, smooth)


def _error(name: str, description: str) -> Column:
    return Column(name, "f8", "m", description, of_position=True)


_REPLICATE = _c("replicate", "u4", "", "number of the replicate")
_TARGET = _c("target", "u2", "", "number of the target")
_STEP = _c("step", "u4", "", "number of the step; step 0 is the start")
_TIME = _c("time", "f8", "s", "simulated time", smooth=True)
_NODE = _c("node", "i4", "", "number of the node")

TABLES: Final[dict[str, tuple[Column, ...]]] = {
    "runs": (
        _REPLICATE,
        _c("status", "u1", "", "how the run ended", STATUSES),
        _c("steps", "u4", "1", "steps simulated after the start"),
        _error("rmse", "root mean square position error over steps and targets"),
        _error("median_error", "median position error over steps and targets"),
        _c("lost", "u1", "1", "1 if a track was lost at the end"),
        _c("energy", "f8", "J", "energy that the network spent; NaN without a network"),
        _c("handovers", "u4", "1", "handovers begun"),
        _c("frames_sent", "u8", "1", "bursts put on the air, each hop counted"),
        _c(
            "frames_lost",
            "u8",
            "1",
            "bursts of which a packet did not arrive; of a broadcast, at a living node within reach",
        ),
        _c("packets_sent", "u8", "1", "packets put on the air, each hop counted"),
        _c("in_range", "u8", "1", "receptions that frames could have had: one a frame and node it was meant for"),
        _c("delivered", "u8", "1", "of these, had: whole bursts where a burst is not cut into frames"),
        _c("collided", "u8", "1", "of these, lost to another frame, to jamming, or to the node's own sending"),
        _c("access_failures", "u8", "1", "frames given up because the channel was never free"),
        _c("retries", "u8", "1", "frames sent again because no acknowledgement came"),
        _c("cycles", "f8", "1", "operations that the tracker stated, on all nodes"),
        _c("tracked", "f8", "1", "share of steps with an estimate in time, from one reading or more, of all targets"),
        _c("tracked_three", "f8", "1", "the same from three readings or more"),
        _c("awake", "f8", "1", "share of the nodes' time that they were awake; NaN without a network"),
        _c("alive", "u4", "1", "nodes alive at the end"),
        _c("first_death", "f8", "s", "when the first node died; NaN if none did"),
        _c("half_dead", "f8", "s", "when half of the nodes had died; NaN if they had not"),
        _c(
            "coverage",
            "f8",
            "1",
            "fraction of the field within sensing range of a living node at the end; NaN without a network",
        ),
        _c("cpu_seconds", "f8", "s", "processor time that the run took"),
        _c(
            "fingerprint",
            "u8",
            "",
            "64-bit digest of event_fingerprint and of all estimates (time, step, target, mean, covariance)",
        ),
        _c(
            "event_fingerprint",
            "u8",
            "",
            "64-bit digest of the events (time, node, kind, peer, bits); without a network, of the estimated means",
        ),
    ),
    "tracks": (
        _REPLICATE,
        _TARGET,
        _error("rmse", "root mean square position error over steps"),
        _error("median_error", "median position error over steps"),
        _c("lost", "u1", "1", "1 if the track was lost at the end"),
        _c("lost_at", "f8", "s", "when the track was first lost: the end of its first bad window; NaN if it never was"),
        _c("reacquired", "u4", "1", "how often the track was started anew from readings"),
        _c("late", "u4", "1", "estimates that missed their step, skipped steps included"),
        _c("reports", "u4", "1", "estimates issued"),
        _c("delay", "f8", "s", "median time from a step to its estimate; NaN without one"),
        _c("received", "u4", "1", "estimates that reached the sink"),
        _c("report_delay", "f8", "s", "median time from a step until the sink had its estimate; NaN if it had none"),
        _c("due", "u4", "1", "reports that were due to the sink; 0 without one"),
        _c("in_time", "f8", "1", "share of these that the sink had before the next step; NaN without a sink"),
        _c("tracked", "f8", "1", "share of steps with an estimate in time, from one reading or more"),
        _c("tracked_three", "f8", "1", "share of steps with an estimate in time, from three readings or more"),
        _error("mean_error", "mean position error over steps"),
        _error("mean_error_three", "the same over steps with three readings or more"),
        _error("rmse_three", "root mean square position error over steps with three readings or more"),
        _error("median_error_three", "median position error over steps with three readings or more"),
        _c("woken", "u4", "1", "nodes that woke, or were told to track, step by step"),
        _c("ineffective", "u4", "1", "of these, nodes told though the target was out of their range"),
        _c("ineffective_twenty", "u4", "1", "the same in the first twenty steps"),
        _c("called", "u4", "1", "nodes called on the wake-up radio"),
        _c("dismissed", "u4", "1", "of these, nodes that did not track then"),
    ),
    "nodes": (
        _REPLICATE,
        _NODE,
        _c("x", "f8", "m", "position", smooth=True),
        _c("y", "f8", "m", "position", smooth=True),
        _c("gain", "f8", "1", "gain of the node's sensor"),
        _c("energy_initial", "f8", "J", "charge at the start"),
        _c("energy_left", "f8", "J", "charge at the end: initial less spent"),
        _c("died_at", "f8", "s", "when the node died; NaN if it lives"),
    ),
    "truth": (_REPLICATE, _TARGET, _STEP, _TIME),
    "estimates": (
        _REPLICATE,
        _TARGET,
        _STEP,
        _TIME,
        _c("issued", "f8", "s", "when the head had the estimate; NaN for a skipped step"),
        _error("sd_x", "standard deviation of the position that the filter claims, in its first column"),
        _error("sd_y", "the same in its second column, if it has one"),
        _error("error", "distance from the true position; NaN for a skipped step"),
        _c("head", "i4", "", "node that leads; -1 if none does"),
        _c("active", "u2", "1", "members that sense, the head included"),
        _c("members", "u2", "1", "members of the cluster, the head included"),
        _c("readings", "u2", "1", "readings that entered this step's computation, on whichever node"),
        _c("received", "f8", "s", "when the sink had the estimate; NaN without a sink"),
        _c("late", "u1", "1", "1 if the estimate missed its step"),
        _c("woken", "u2", "1", "nodes that woke at this step for this target, or had been told to track at it"),
        _c(
            "ineffective", "u2", "1", "of these, nodes woken or told by others though the target was out of their range"
        ),
        _c(
            "effective_particles",
            "f8",
            "1",
            "effective number of the particles that the head knows; NaN if it has none",
        ),
    ),
    "events": (
        _REPLICATE,
        _TIME,
        _STEP,
        _c("target", "i2", "", "number of the target; -1 if the event concerns none"),
        _NODE,
        _c("kind", "u1", "", "what happened", KINDS),
        _c("what", "u1", "", "what the parcel carried, or a word on the event"),
        _c("frame", "u4", "", "number of the burst on the air; 0 if none"),
        _c("sequence", "u4", "", "number of the message, kept over hops; 0 if none"),
        _c("peer", "i4", "", "the other node; -1 for a broadcast or none"),
        _c("packets", "u4", "1", "packets in the burst (sent, or arrived)"),
        _c("bits", "u4", "1", "bits in the burst (sent, or listened to)"),
        _c("joules", "f8", "J", "energy that this node spent on it"),
        _c("cause", "u1", "", "what the energy went into; tx is both transmit causes", EVENT_CAUSES),
    ),
    "energy": (
        _REPLICATE,
        _NODE,
        _c("cause", "u1", "", "what the energy went into", CAUSES),
        _c("joules", "f8", "J", "energy spent; rows of zero are left out"),
    ),
    "energy_steps": (
        _REPLICATE,
        _STEP,
        _TIME,
        _c("cause", "u1", "", "what the energy went into", CAUSES),
        _c("joules", "f8", "J", "energy that the network spent in this step; rows of zero are left out"),
    ),
    "clusters": (
        _REPLICATE,
        _TARGET,
        _c("cluster", "u4", "", "number of the cluster within the track"),
        _c("formed", "f8", "s", "when it formed"),
        _c("released", "f8", "s", "when it dissolved; NaN if the run ended first"),
        _c("head", "i4", "", "node that leads"),
        _c("members", "u2", "1", "members, the head included"),
        _c("previous_head", "i4", "", "head that handed over to it; -1 if none did"),
        _c("hops", "u2", "1", "hops that the handover took; 0 if none"),
        _c("handover_bits", "u8", "1", "bits put on the air to hand over to it, each hop counted"),
    ),
    "wakeups": (
        _REPLICATE,
        _TARGET,
        _c("step", "u4", "", "number of the step that nodes are woken for"),
        _TIME,
        _c("node", "i4", "", "main node that has them woken"),
        _c("sequence", "u4", "", "number of the message in the events; 0 if it never got the channel"),
        _c("x", "f8", "m", "centre of the region", smooth=True),
        _c("y", "f8", "m", "centre of the region", smooth=True),
        _c("radius", "f8", "m", "of the region"),
        _c("expires", "f8", "s", "until when the message is heeded"),
        _c("foreseen", "u1", "1", "1 if the centre is a prediction, 0 if it is the last fix"),
        _c("forwards", "u2", "1", "nodes that handed the message on"),
        _c("called", "u2", "1", "nodes called on the wake-up radio"),
        _c("dismissed", "u2", "1", "of these, nodes that did not track"),
        _c("woken", "u2", "1", "nodes that track for the step"),
        _c("ineffective", "u2", "1", "of these, out of their sensors' range of the target"),
        _c("expired", "u2", "1", "nodes that dropped the message as expired"),
    ),
    "links": (
        _REPLICATE,
        _c("source", "i4", "", "node that sends"),
        _NODE,
        _c("distance", "f8", "m", "between the two"),
        _c("power", "f8", "dBm", "received power; 0 where the link model knows none"),
        _c("chance", "f8", "1", "probability that a beacon arrives where nothing disturbs it"),
        _c("sent", "u4", "1", "beacons of the source"),
        _c("received", "u4", "1", "of these, received by the node"),
    ),
    "particles": (_REPLICATE, _TARGET, _STEP, _NODE, _c("weight", "f8", "1", "normalised over the whole set")),
    "tracker_state": (
        _REPLICATE,
        _TARGET,
        _STEP,
        _c("name", "u1", "", "name of the quantity, given by the tracker"),
        _c("index", "u4", "", "index into the quantity's values"),
        _c("value", "f8", "", "value at this index; the tracker defines its unit"),
    ),
}
STATE_AFTER: Final = {"truth": "time", "estimates": "issued", "particles": "node"}
"""Tables that carry the motion model's state columns, and after which column."""
METRICS: Final = tuple(
    column.name
    for column in TABLES["runs"]
    if column.name not in ("replicate", "status", "fingerprint", "event_fingerprint", "cpu_seconds")
)
"""The columns of `runs` that are figures of a run, the same each time that it is repeated."""
MORE_IS_BETTER: Final = ("delivered", "tracked", "tracked_three", "alive", "first_death", "half_dead", "coverage")
"""Of these, those of which one wants more."""
RECORDED_BY_DEFAULT: Final = {name: name not in ("links", "particles", "tracker_state") for name in TABLES}


def columns_of(
    table: str, states: Sequence[tuple[str, str]] = (), position: Sequence[int] | None = None
) -> tuple[Column, ...]:
    """The table's columns for a motion model, given by its state columns as (name, unit) and which are the position.

    The state columns stand in their place, positions have the model's unit, and one of one column has no `sd_y`.
    """
    columns = TABLES[table]
    if position is not None:
        unit = states[position[0]][1]
        columns = tuple(replace(c, units=unit) if c.of_position else c for c in columns)
        columns = tuple(c for c in columns if c.name != "sd_y" or len(position) > 1)
    if table not in STATE_AFTER:
        return columns
    cut = 1 + next(i for i, column in enumerate(columns) if column.name == STATE_AFTER[table])
    state = tuple(_c(name, "f8", unit, "state of the target", smooth=True) for name, unit in states)
    return columns[:cut] + state + columns[cut:]


class Words:
    """The words of a category that grows at run time, each with its code. Holds at most 256."""

    def __init__(self, words: Iterable[str] = ("",)) -> None:
        self._codes = {word: code for code, word in enumerate(words)}

    def code(self, word: str) -> int:
        """The word's code, a new one if it is new."""
        code = self._codes.setdefault(word, len(self._codes))
        assert code < 256, f"more than 256 different words in a category column, the last being {word!r}"
        return code

    def all(self) -> tuple[str, ...]:
        """The words, in the order of their codes."""
        return tuple(self._codes)


class Memory:
    """A recorder that keeps everything in memory, for notebooks and tests: `memory.table('estimates')['error']`."""

    def __init__(self, wanted: Mapping[str, bool] | None = None) -> None:
        self._wanted = dict(RECORDED_BY_DEFAULT if wanted is None else wanted)
        self._pieces: dict[str, list[Mapping[str, Any]]] = {}
        self.words = Words()
        self.state_names = Words(())

    def wants(self, table: str) -> bool:
        return self._wanted.get(table, False)

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        self._pieces.setdefault(table, []).append(columns)

    def table(self, name: str) -> dict[str, np.ndarray]:
        """The columns written so far, joined."""
        pieces = [equally_long(piece) for piece in self._pieces.get(name, [])]
        return {key: np.concatenate([piece[key] for piece in pieces]) for key in (pieces[0] if pieces else ())}


def equally_long(columns: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The columns of one `write` as arrays of one length: a scalar stands for a column of itself."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(values) for values in columns.values()))
    return dict(zip(columns, arrays, strict=True))
