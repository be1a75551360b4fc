"""The columns of the tables `runs` and `tracks`: one row says how a run went, or how a target was tracked in it."""

from __future__ import annotations

from typing import Final

from wsnsim.base.columns import REPLICATE, STATUSES, TARGET, column, position_column

RUNS: Final = (
    REPLICATE,
    column("status", "u1", "", "how the run ended", STATUSES),
    column("steps", "u4", "1", "number of simulated steps after that of the start; without targets, of all steps"),
    position_column("rmse", "root mean square position error over steps and targets"),
    position_column("median_error", "median position error over steps and targets"),
    column("lost", "u1", "1", "lost at the end: 1 if a track is lost at its last step"),
    column("losses", "u4", "1", "number of track losses, those that ended included; summed over targets"),
    column("time_lost", "f8", "s", "time for which a track was lost, mean over targets; NaN without a target"),
    column("lost_share", "f8", "1", "share of steps at which a track was lost, mean over targets"),
    column("lost_window", "f8", "s", "time without a good estimate after which a track is lost; NaN without a target"),
    position_column("lost_limit", "error above which an estimate is none that is good; NaN without a target"),
    column("nees", "f8", "1", "mean of estimates.nees per position column; 1: consistent, above 1: overconfident"),
    column("nees_median", "f8", "1", "median of estimates.nees per position column; in the plane, 0.69 is consistent"),
    column("singular", "u4", "1", "estimates whose position covariance is singular, and which have no NEES"),
    column("nis", "f8", "1", "sum of estimates.nis per degree of freedom; 1: consistent; NaN without innovations"),
    column("energy", "f8", "J", "energy that the network consumed; NaN without a network"),
    column("handovers", "u4", "1", "number of handovers begun"),
    column("frames_sent", "u8", "1", "bursts sent, each hop counted"),
    column(
        "frames_lost",
        "u8",
        "1",
        "bursts of which a packet was lost; for a broadcast, at a living node within communication range",
    ),
    column("packets_sent", "u8", "1", "packets sent, each hop counted"),
    column("in_range", "u8", "1", "intended receptions: one per frame and node that it was meant for"),
    column("delivered", "u8", "1", "of these, successful receptions; of whole bursts where a burst is not fragmented"),
    column(
        "collided",
        "u8",
        "1",
        "of these, receptions lost to another frame, to jamming or to the node's own transmission",
    ),
    column("access_failures", "u8", "1", "frames dropped because the channel was busy at every assessment"),
    column("retries", "u8", "1", "retransmissions: frames sent again because no acknowledgement arrived"),
    column("cycles", "f8", "1", "operations that the tracker declared, summed over all nodes"),
    column(
        "tracked",
        "f8",
        "1",
        "share of steps with an estimate in time from at least one measurement, mean over targets",
    ),
    column(
        "tracked_three",
        "f8",
        "1",
        "share of steps with an estimate in time from at least three measurements, mean over targets",
    ),
    column("awake", "f8", "1", "share of time that nodes were awake, mean over nodes; NaN without a network"),
    column(
        "radio_on",
        "f8",
        "1",
        "share of time that radios were on (sending, receiving or listening), mean over nodes; left out where the"
        " radio of a node that is awake always is",
    ),
    column(
        "hurried",
        "f8",
        "1",
        "share of time at the short wake interval `mac.near`, mean over nodes; NaN without it, and left out with"
        " `radio_on`",
    ),
    column("alive", "u4", "1", "nodes alive at the end"),
    column("first_death", "f8", "s", "time of the first node death; NaN if no node died"),
    column("half_dead", "f8", "s", "time at which half of the nodes had died; NaN if fewer died"),
    column(
        "coverage",
        "f8",
        "1",
        "fraction of the field within sensing range of a living node at the end; NaN without a network",
    ),
    column(
        "cpu_seconds",
        "f8",
        "s",
        "processor time of the run, without compilation; runs made at once share theirs evenly",
    ),
    column(
        "fingerprint",
        "u8",
        "",
        "64-bit digest of event_fingerprint and of all estimates (time, step, target, mean, covariance)",
    ),
    column(
        "event_fingerprint",
        "u8",
        "",
        "64-bit digest of the events (time, node, kind, peer, bits); without a network, of the estimated means",
    ),
)
"""One row per Monte Carlo run."""

TRACKS: Final = (
    REPLICATE,
    TARGET,
    position_column("rmse", "root mean square position error over steps"),
    position_column("median_error", "median position error over steps"),
    column("lost", "u1", "1", "lost at the end: 1 if the track is lost at its last step"),
    column(
        "losses",
        "u4",
        "1",
        "number of track losses: stretches of at least runs.lost_window whose error is above runs.lost_limit or without"
        " an estimate",
    ),
    column("time_lost", "f8", "s", "time for which the track was lost: the length of these stretches"),
    column("lost_share", "f8", "1", "share of steps at which the track was lost"),
    column(
        "lost_at",
        "f8",
        "s",
        "time of the first track loss: when its stretch had lasted for runs.lost_window; NaN if there is none",
    ),
    column("reacquired", "u4", "1", "number of reacquisitions: the track was initiated again from measurements"),
    column("late", "u4", "1", "steps without an estimate before the next step, skipped steps included"),
    column("reports", "u4", "1", "number of estimates"),
    column("delay", "f8", "s", "latency at the cluster head: median time from a step to its estimate; NaN without one"),
    column("received", "u4", "1", "number of estimates that reached the sink"),
    column(
        "report_delay",
        "f8",
        "s",
        "end-to-end latency: median time from a step until its estimate is at the sink; NaN if none arrived",
    ),
    column("due", "u4", "1", "number of reports due at the sink; 0 without a sink"),
    column("in_time", "f8", "1", "share of due reports that arrived before the next step; NaN without a sink"),
    column("tracked", "f8", "1", "share of steps with an estimate in time from at least one measurement"),
    column("tracked_three", "f8", "1", "share of steps with an estimate in time from at least three measurements"),
    position_column("mean_error", "mean position error over steps"),
    position_column("mean_error_three", "mean position error over steps with at least three measurements"),
    position_column("rmse_three", "root mean square position error over steps with at least three measurements"),
    position_column("median_error_three", "median position error over steps with at least three measurements"),
    column("woken", "u4", "1", "wake-ups for this target, summed over steps"),
    column(
        "ineffective",
        "u4",
        "1",
        "unnecessary wake-ups: of these, by other nodes with the target out of sensing range",
    ),
    column("ineffective_twenty", "u4", "1", "unnecessary wake-ups in the first twenty steps"),
    column("called", "u4", "1", "calls on the wake-up radio, one per node"),
    column("dismissed", "u4", "1", "of these, calls to nodes that did not track afterwards"),
    column(
        "handover_bits",
        "f8",
        "1",
        "bits sent for a handover, each hop counted, mean over those that arrived; NaN without one",
    ),
)
"""One row per target of a run."""
