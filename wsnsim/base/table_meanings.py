"""What a row of each table of a result stands for: "one row per ..."."""

from __future__ import annotations

from typing import Final

TABLE_MEANINGS: Final[dict[str, str]] = {
    "runs": "Monte Carlo run: its status and its metrics",
    "tracks": "run and target: the metrics of one track",
    "nodes": "run and node: position, assumed position, gain, energy at the start and at the end",
    "truth": "run, target and step: the ground truth of the state",
    "estimates": "run, target and step: the estimate at the cluster head, its uncertainty and its error",
    "covariances": "run, target and step: the covariance of the whole state",
    "readings": "run, target, step and node: what a node measured",
    "events": "event: a message sent or received, a handover, an estimate, a wake-up, a death ...",
    "energy": "run, node and cause: the energy consumed",
    "energy_steps": "run, step and cause: the energy that the whole network consumed",
    "clocks": "run and step: the errors of the nodes' clocks",
    "clusters": "cluster: formation, release, cluster head, members and the handover to it",
    "wakeups": "wake-up message: who sent it, which region it wakes, and which nodes it reached",
    "reports": "report to a sink: when it was sent and received, over how many hops",
    "links": "directed link that was used by beacons: distance, received power, beacons sent and received",
    "particles": "run, target, step and particle: its node, state and weight",
    "tracker_state": "value that a tracker records of its own, such as the probability of a mode",
}
