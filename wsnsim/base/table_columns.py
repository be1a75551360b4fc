"""The columns of each table of a result, with units, descriptions and the words of category columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
    """One column of a table.

    Attributes:
        name: Its name.
        dtype: NumPy type.
        units: SI unit; '1' for a count, '' for an identifier.
        description: What it holds.
        meanings: Words of a category column, in the order of their codes.
        smooth: Whether neighbouring values are similar, so that shuffling bytes compresses them.
        of_position: Whether it has the unit of the motion model's position, usually metres.
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


_REPLICATE = _c("replicate", "u4", "", "number of the Monte Carlo run")
_TARGET = _c("target", "u2", "", "number of the target")
_STEP = _c("step", "u4", "", "number of the step; step 0 is the start")
_TIME = _c("time", "f8", "s", "simulated time", smooth=True)
_NODE = _c("node", "i4", "", "number of the node")

TABLES: Final[dict[str, tuple[Column, ...]]] = {
    "runs": (
        _REPLICATE,
        _c("status", "u1", "", "how the run ended", STATUSES),
        _c("steps", "u4", "1", "number of simulated steps after the start"),
        _error("rmse", "root mean square position error over steps and targets"),
        _error("median_error", "median position error over steps and targets"),
        _c("lost", "u1", "1", "lost at the end: 1 if a track is lost in its last window of steps"),
        _c("losses", "u4", "1", "number of track losses, those that ended included; summed over targets"),
        _c("time_lost", "f8", "s", "time for which a track was lost, mean over targets; NaN without a target"),
        _c("lost_share", "f8", "1", "share of steps at which a track was lost, mean over targets"),
        _c("nees", "f8", "1", "mean of estimates.nees per position column; 1: consistent, above 1: overconfident"),
        _c("nis", "f8", "1", "sum of estimates.nis per degree of freedom; 1: consistent; NaN without innovations"),
        _c("energy", "f8", "J", "energy that the network consumed; NaN without a network"),
        _c("handovers", "u4", "1", "number of handovers begun"),
        _c("frames_sent", "u8", "1", "bursts sent, each hop counted"),
        _c(
            "frames_lost",
            "u8",
            "1",
            "bursts of which a packet was lost; for a broadcast, at a living node within communication range",
        ),
        _c("packets_sent", "u8", "1", "packets sent, each hop counted"),
        _c("in_range", "u8", "1", "intended receptions: one per frame and node that it was meant for"),
        _c("delivered", "u8", "1", "of these, successful receptions; of whole bursts where a burst is not fragmented"),
        _c(
            "collided",
            "u8",
            "1",
            "of these, receptions lost to another frame, to jamming or to the node's own transmission",
        ),
        _c("access_failures", "u8", "1", "frames dropped because the channel was busy at every assessment"),
        _c("retries", "u8", "1", "retransmissions: frames sent again because no acknowledgement arrived"),
        _c("cycles", "f8", "1", "operations that the tracker declared, summed over all nodes"),
        _c(
            "tracked",
            "f8",
            "1",
            "share of steps with an estimate in time from at least one measurement, mean over targets",
        ),
        _c(
            "tracked_three",
            "f8",
            "1",
            "share of steps with an estimate in time from at least three measurements, mean over targets",
        ),
        _c("awake", "f8", "1", "share of time that nodes were awake, mean over nodes; NaN without a network"),
        _c("alive", "u4", "1", "nodes alive at the end"),
        _c("first_death", "f8", "s", "time of the first node death; NaN if no node died"),
        _c("half_dead", "f8", "s", "time at which half of the nodes had died; NaN if fewer died"),
        _c(
            "coverage",
            "f8",
            "1",
            "fraction of the field within sensing range of a living node at the end; NaN without a network",
        ),
        _c("cpu_seconds", "f8", "s", "processor time of the run"),
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
        _c("lost", "u1", "1", "lost at the end: 1 if the track is lost in its last window of steps"),
        _c(
            "losses",
            "u4",
            "1",
            "number of track losses: each begins when the mean error of a window exceeds the limit or half of its"
            " estimates are missing, and ends when the mean error is at most half of the limit",
        ),
        _c("time_lost", "f8", "s", "time for which the track was lost; the first window counts as a whole"),
        _c("lost_share", "f8", "1", "share of steps at which the track was lost"),
        _c(
            "lost_at",
            "f8",
            "s",
            "time of the first track loss: the end of the first window that is lost; NaN if there is none",
        ),
        _c("reacquired", "u4", "1", "number of reacquisitions: the track was initiated again from measurements"),
        _c("late", "u4", "1", "steps without an estimate before the next step, skipped steps included"),
        _c("reports", "u4", "1", "number of estimates"),
        _c("delay", "f8", "s", "latency at the cluster head: median time from a step to its estimate; NaN without one"),
        _c("received", "u4", "1", "number of estimates that reached the sink"),
        _c(
            "report_delay",
            "f8",
            "s",
            "end-to-end latency: median time from a step until its estimate is at the sink; NaN if none arrived",
        ),
        _c("due", "u4", "1", "number of reports due at the sink; 0 without a sink"),
        _c("in_time", "f8", "1", "share of due reports that arrived before the next step; NaN without a sink"),
        _c("tracked", "f8", "1", "share of steps with an estimate in time from at least one measurement"),
        _c("tracked_three", "f8", "1", "share of steps with an estimate in time from at least three measurements"),
        _error("mean_error", "mean position error over steps"),
        _error("mean_error_three", "mean position error over steps with at least three measurements"),
        _error("rmse_three", "root mean square position error over steps with at least three measurements"),
        _error("median_error_three", "median position error over steps with at least three measurements"),
        _c("woken", "u4", "1", "wake-ups for this target, summed over steps"),
        _c(
            "ineffective",
            "u4",
            "1",
            "unnecessary wake-ups: of these, by other nodes with the target out of sensing range",
        ),
        _c("ineffective_twenty", "u4", "1", "unnecessary wake-ups in the first twenty steps"),
        _c("called", "u4", "1", "calls on the wake-up radio, one per node"),
        _c("dismissed", "u4", "1", "of these, calls to nodes that did not track afterwards"),
        _c(
            "handover_bits",
            "f8",
            "1",
            "bits sent for a handover, each hop counted, mean over those that arrived; NaN without one",
        ),
    ),
    "nodes": (
        _REPLICATE,
        _NODE,
        _c("x", "f8", "m", "position", smooth=True),
        _c("y", "f8", "m", "position", smooth=True),
        _c("x_assumed", "f8", "m", "position that filters and heads assume", smooth=True),
        _c("y_assumed", "f8", "m", "position that filters and heads assume", smooth=True),
        _c("gain", "f8", "1", "gain of the node's sensor"),
        _c("energy_initial", "f8", "J", "energy at the start"),
        _c("energy_left", "f8", "J", "residual energy at the end"),
        _c("died_at", "f8", "s", "time of the node's death; NaN if it lives"),
    ),
    "truth": (_REPLICATE, _TARGET, _STEP, _TIME),
    "estimates": (
        _REPLICATE,
        _TARGET,
        _STEP,
        _TIME,
        _c("issued", "f8", "s", "time at which the head had the estimate; NaN for a skipped step"),
        _error("sd_x", "estimated standard deviation of the first position column"),
        _error("sd_y", "estimated standard deviation of the second position column"),
        Column("cov_xy", "f8", "m2", "estimated covariance of the two position columns", of_position=True),
        _error("error", "position error: distance from the ground truth; NaN for a skipped step"),
        _c("head", "i4", "", "cluster head; -1 if there is none"),
        _c("active", "u2", "1", "members with a measurement, the head included"),
        _c("members", "u2", "1", "cluster members, the head included"),
        _c("readings", "u2", "1", "measurements used in this step, on any node"),
        _c("received", "f8", "s", "time at which the sink had the estimate; NaN if it did not arrive"),
        _c("late", "u1", "1", "1 if there was no estimate before the next step"),
        _c("woken", "u2", "1", "nodes that were woken for this target at this step"),
        _c(
            "ineffective",
            "u2",
            "1",
            "unnecessary wake-ups: of these, by other nodes with the target out of sensing range",
        ),
        _c(
            "effective_particles",
            "f8",
            "1",
            "effective number of particles at the head; NaN without particles",
        ),
        _c("nees", "f8", "1", "normalised estimation error squared of the position; NaN if skipped or P is singular"),
        _c("nis", "f8", "1", "normalised innovation squared of the step's update; NaN without one"),
        _c("nis_dof", "u4", "1", "measurements that the innovation is of: the expectation of nis"),
        _c("gaussian", "u1", "1", "1 if the posterior is Gaussian: linear Gaussian models and a filter exact for them"),
    ),
    "covariances": (_REPLICATE, _TARGET, _STEP),
    "events": (
        _REPLICATE,
        _TIME,
        _STEP,
        _c("target", "i2", "", "number of the target; -1 if the event concerns none"),
        _NODE,
        _c("kind", "u1", "", "what happened", KINDS),
        _c("what", "u1", "", "content of the parcel, or detail of the event"),
        _c("frame", "u4", "", "number of the burst; 0 if none"),
        _c("sequence", "u4", "", "number of the message, the same on every hop; 0 if none"),
        _c("peer", "i4", "", "the other node; -1 for a broadcast or none"),
        _c("packets", "u4", "1", "packets in the burst: sent, or received"),
        _c("bits", "u4", "1", "bits in the burst: sent, or listened to"),
        _c("joules", "f8", "J", "energy that this node consumed"),
        _c("cause", "u1", "", "cause of the consumption; tx is both transmit causes", EVENT_CAUSES),
    ),
    "energy": (
        _REPLICATE,
        _NODE,
        _c("cause", "u1", "", "cause of the consumption", CAUSES),
        _c("joules", "f8", "J", "energy consumed; rows of zero are left out"),
    ),
    "energy_steps": (
        _REPLICATE,
        _STEP,
        _TIME,
        _c("cause", "u1", "", "cause of the consumption", CAUSES),
        _c("joules", "f8", "J", "energy that the network consumed in this step; rows of zero are left out"),
    ),
    "clusters": (
        _REPLICATE,
        _TARGET,
        _c("cluster", "u4", "", "number of the cluster within the track"),
        _c("formed", "f8", "s", "time of its formation"),
        _c("released", "f8", "s", "time of its release; NaN if the run ended before"),
        _c("head", "i4", "", "cluster head"),
        _c("members", "u2", "1", "number of members, the head included"),
        _c("previous_head", "i4", "", "cluster head that handed over to it; -1 if none did"),
        _c("hops", "u2", "1", "hops of the handover; 0 if there was none"),
        _c("handover_bits", "u8", "1", "bits sent for the handover to it, each hop counted"),
    ),
    "wakeups": (
        _REPLICATE,
        _TARGET,
        _c("step", "u4", "", "number of the step that nodes are woken for"),
        _TIME,
        _c("node", "i4", "", "cluster head that wakes them"),
        _c("sequence", "u4", "", "number of the message in the table events; 0 if it was not sent"),
        _c("x", "f8", "m", "centre of the region that is woken", smooth=True),
        _c("y", "f8", "m", "centre of the region that is woken", smooth=True),
        _c("radius", "f8", "m", "radius of the region"),
        _c("expires", "f8", "s", "time at which the message expires"),
        _c("foreseen", "u1", "1", "1 if the centre is a prediction, 0 if it is the last fix"),
        _c("forwards", "u2", "1", "nodes that forwarded the message"),
        _c("called", "u2", "1", "calls on the wake-up radio, one per node"),
        _c("dismissed", "u2", "1", "of these, nodes that did not track"),
        _c("woken", "u2", "1", "nodes that track at the step"),
        _c("ineffective", "u2", "1", "of these, nodes with the target out of sensing range"),
        _c("expired", "u2", "1", "nodes that dropped the message because it had expired"),
    ),
    "links": (
        _REPLICATE,
        _c("source", "i4", "", "sending node"),
        _NODE,
        _c("distance", "f8", "m", "distance between the two nodes"),
        _c("power", "f8", "dBm", "received power; 0 if the link model has none"),
        _c("chance", "f8", "1", "probability of receiving a beacon without interference"),
        _c("sent", "u4", "1", "beacons sent by the source"),
        _c("received", "u4", "1", "of these, beacons received by the node"),
    ),
    "particles": (
        _REPLICATE,
        _TARGET,
        _STEP,
        _NODE,
        _c("weight", "f8", "1", "weight of the particle; the weights of a step sum to 1"),
    ),
    "tracker_state": (
        _REPLICATE,
        _TARGET,
        _STEP,
        _c("name", "u1", "", "name of the quantity, given by the tracker"),
        _c("index", "u4", "", "index into the quantity's values"),
        _c("value", "f8", "", "value at this index; the tracker defines its unit"),
    ),
}
OFF_BY_DEFAULT: Final = ("covariances", "links", "particles", "tracker_state")
RECORDED_BY_DEFAULT: Final = {name: name not in OFF_BY_DEFAULT for name in TABLES}
