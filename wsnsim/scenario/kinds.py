"""The table of all built-in kinds of all roles: name, class and description, as strings.

    ROLES: {role name: Role}    AT_TOP: {key at the top of a scenario: Role}

Nothing is imported here: `wsnsim list` shows this table, and a test compares it with the classes.
"""

from __future__ import annotations

from typing import Final

from wsnsim.scenario.roles import IEEE, JIANG, LI, LIU, RUAN, WEI, Kind, Role
from wsnsim.scenario.tracker_kinds import TRACKERS

_ROLES: Final = (
    Role("prior", "the prior of the target's state that filters are given", "PriorModel", "around_truth", (
        Kind("around_truth", "wsnsim.models.acquire:AroundTruth",
            "a Gaussian whose mean is sampled around the true start", JIANG),
    )),
    Role("deploy", "where the nodes stand", "Deployment", None, (
        Kind("uniform", "wsnsim.models.deploy:Uniform", "uniform over the field, sampled again until covered", JIANG),
        Kind("grid", "wsnsim.models.deploy:Grid", "a regular grid"),
        Kind("jittered_grid", "wsnsim.models.deploy:JitteredGrid", "a regular grid, each node moved at random"),
        Kind("file", "wsnsim.models.node_file:FromFile",
            "positions from a CSV file with columns x, y, and perhaps names (id) and heights (z)"),
        Kind("anchors", "wsnsim.models.deploy:Anchors", "nodes at the positions that the scenario lists"),
    )),
    Role("motion", "how the target moves", "MotionModel", None, (
        Kind("bounded_velocity", "wsnsim.models.motion:BoundedVelocity",
            "near-constant velocity, pulled back beyond a bound", f"{JIANG}, eq. 1-4"),
        Kind("constant_velocity", "wsnsim.models.linear:ConstantVelocity",
            "near-constant velocity in the plane, with the noise inputs of two papers", f"{WEI}; {RUAN}"),
        Kind("constant_acceleration", "wsnsim.models.linear:ConstantAcceleration",
            "near-constant acceleration along a line", f"{LIU}, eq. 15-17"),
        Kind("ungm", "wsnsim.models.ungm:Ungm",
            "the univariate nonstationary growth model, a scalar benchmark", WEI),
        Kind("random_waypoint", "wsnsim.models.waypoints:RandomWaypoint",
            "straight legs between random points of an area, from the stationary distribution",
            f"{LI}; Navidi, Camp (2004); Le Boudec, Vojnovic (2005)"),
        Kind("waypoints", "wsnsim.models.waypoints:Waypoints",
            "straight legs between points with times, from the scenario or a CSV file"),
        Kind("recorded_track", "wsnsim.models.recorded_track:RecordedTrack",
            "a recorded trajectory from a CSV file, interpolated linearly; the height too if it has one"),
        Kind("gauss_markov", "wsnsim.models.mobility:GaussMarkov",
            "velocity that reverts to a mean and is driven by noise", "Liang, Haas (2003)"),
        Kind("coordinated_turn", "wsnsim.models.mobility:CoordinatedTurn",
            "arcs at near-constant speed and turn rate", "Bar-Shalom, Li, Kirubarajan (2001), section 11.7"),
    ), listed="targets"),
    Role("sensor", "what a node measures of the target", "SensorModel", None, (
        Kind("acoustic_energy", "wsnsim.models.sensing:AcousticEnergy",
            "energy of a sound, which falls with a power of the distance", f"{JIANG}, eq. 5-8"),
        Kind("range", "wsnsim.models.ranging:Range", "distance from the node, with constant variance", LIU),
        Kind("range_from_origin", "wsnsim.models.ranging:RangeFromOrigin",
            "distance from the origin, wherever the node stands", f"{WEI}, experiment 3"),
        Kind("coordinate", "wsnsim.models.linear_sensing:Coordinate",
            "the target's coordinate along an axis of the node: linear, the Kalman filter is exact"),
        Kind("rssi", "wsnsim.models.rssi:Rssi",
            "received signal strength, which falls with the logarithm of the distance", f"{RUAN}, eq. 4"),
        Kind("bearing", "wsnsim.models.bearing:Bearing",
            "direction of the target from the node: an angle, with wrapped noise"),
        Kind("range_bearing", "wsnsim.models.bearing:RangeBearing",
            "distance and direction of the target from the node: readings of two components"),
        Kind("recorded", "wsnsim.models.recorded_readings:RecordedSensor",
            "readings that were recorded, from a CSV file; filters believe the law that is given for them"),
        Kind("squared", "wsnsim.models.ungm:Squared", "the square of a scalar state, divided by 20",
            f"{WEI}, experiment 1"),
    )),
    Role("energy", "the energy of each act, in joules", "EnergyModel", None, (
        Kind("first_order", "wsnsim.models.energy:FirstOrder",
            "electronics per bit, amplifier per bit and squared distance", f"{JIANG}, eq. 9-11; Heinzelman (2000)"),
        Kind("first_order_2002", "wsnsim.models.energy:FirstOrder2002",
            "free space up to a crossover distance, multipath fading beyond",
            "Heinzelman (2002)"),
        Kind("states", "wsnsim.models.energy:States",
            "power by state, from the datasheets of a radio and a processor (`wsnsim list parts`)"),
    )),
    Role("link", "which nodes receive each other", "LinkModel", None, (
        Kind("disk", "wsnsim.models.links:Disk", "nodes receive each other within a fixed range", JIANG),
        Kind("log_normal", "wsnsim.models.links:LogNormal",
            "log-normal shadowing per link; the packet error rate follows from the received power",
            f"Zuniga, Krishnamachari (2004); {IEEE}"),
        Kind("recorded", "wsnsim.models.recorded_links:RecordedLinks",
            "packet delivery ratios measured in a testbed, link by link and round by round, from a K7 file",
            "Gilbert (1960); Elliott (1963) for losses in bursts"),
    )),
    Role("mac", "when a frame gets the channel", "Mac", "ideal", (
        Kind("ideal", "wsnsim.models.access:IdealMac",
            "ideal channel: no contention, no collisions; frames arrive at once", JIANG),
        Kind("csma", "wsnsim.models.access:Csma",
            "carrier sense after a random backoff; acknowledgements and retransmissions", f"{IEEE}, unslotted CSMA/CA"),
        Kind("tdma", "wsnsim.models.access:Tdma",
            "slots that the head assigns to its members; CSMA/CA outside a cluster",
            "Heinzelman (2002)"),
    )),
    Role("packing", "how many packets of a burst a frame carries", "Packing", "none", (
        Kind("none", "wsnsim.models.hardware:NoPacking", "one packet per frame", JIANG),
        Kind("frames", "wsnsim.models.hardware:Frames", "as many packets as the payload of a frame holds"),
    )),
    Role("routing", "the path of a datagram that leaves its cluster", "Routing", "minimum_energy", (
        Kind("minimum_energy", "wsnsim.models.links:MinimumEnergy", "the path with the least energy"),
        Kind("minimum_hop", "wsnsim.models.links:MinimumHop", "the path with the fewest hops"),
        Kind("greedy_geographic", "wsnsim.models.links:GreedyGeographic",
            "each hop to the neighbour nearest to the destination",
            "Karp, Kung (2000)"),
    )),
    Role("sleep", "when nodes sense and listen", "SleepSchedule", "event_wake", (
        Kind("event_wake", "wsnsim.models.sleep:EventWake",
            "event-driven: dormant nodes keep sensor and receiver on", JIANG),
        Kind("always_on", "wsnsim.models.sleep:AlwaysOn", "nodes never sleep"),
        Kind("ris", "wsnsim.models.sleep:RandomIndependent",
            "random independent sleeping: a node is awake in each of its periods with a probability",
            f"Kumar, Lai, Balogh (2004); {LI}"),
        Kind("duty_cycle", "wsnsim.models.sleep:DutyCycle",
            "each node is awake in the first part of each period, synchronised or staggered"),
    )),
    Role("cpu", "the time of computations", "Cpu", "processor", (
        Kind("processor", "wsnsim.models.hardware:Processor",
            "cycles divided by the clock rate; no time without a rate", JIANG),
    )),
    Role("clock", "the errors of the nodes' clocks", "Clock", "perfect", (
        Kind("perfect", "wsnsim.models.hardware:PerfectClock", "every clock shows the true time", JIANG),
        Kind("drift", "wsnsim.models.hardware:DriftingClock", "each clock has a constant random rate error"),
    )),
    Role("detection", "missed detections, false alarms and sensor defects", "Detection", "perfect", (
        Kind("perfect", "wsnsim.models.hardware:PerfectDetection",
            "every reading is reported as it is measured", JIANG),
        Kind("imperfect", "wsnsim.models.hardware:ImperfectDetection",
            "missed detections, false alarms, biased and stuck sensors"),
    )),
    Role("sink", "the node that collects the estimates", "Sink", "none", (
        Kind("none", "wsnsim.models.hardware:NoSink", "no sink: estimates stay at the cluster heads", JIANG),
        Kind("node", "wsnsim.models.hardware:NearestNode",
            "the node nearest to a point, over several hops"),
    )),
    Role("workload", "what the network does", "Workload", "tracking", (
        Kind("tracking", "wsnsim.models.workload:Tracking", "the network tracks targets", JIANG),
        Kind("beacons", "wsnsim.models.workload:Periodic",
            "no targets: every node broadcasts a beacon once per period"),
    )),
    Role("fault", "what fails, when, and which nodes it hits", "FaultEvent", None, (
        Kind("crash", "wsnsim.models.faults:Crash", "nodes go down and lose their memory"),
        Kind("restart", "wsnsim.models.faults:Restart", "nodes restart and lose their memory"),
        Kind("drain", "wsnsim.models.faults:Drain", "nodes lose energy at once"),
        Kind("blackout", "wsnsim.models.faults:Blackout", "radios are jammed: they neither receive nor are received"),
        Kind("link_loss", "wsnsim.models.faults:LinkLoss", "frames from and to nodes are lost with a probability"),
        Kind("clock_step", "wsnsim.models.faults:ClockStep", "clocks jump"),
        Kind("stuck", "wsnsim.models.faults:Stuck", "readings stay at a value"),
        Kind("bias", "wsnsim.models.faults:Bias", "a constant is added to readings"),
    ), listed="faults", optional=True),
    Role("wakeup", "how nodes ahead of the target are woken", "WakeUp", "none", (
        Kind("none", "wsnsim.models.wakeup:NoWakeUp", "no node is woken ahead of the target", JIANG),
        Kind("directed_flood", "wsnsim.models.wakeup:DirectedFlood",
            "a message is forwarded towards the predicted position and wakes the region around it",
            f"{LI}, section 2.2"),
        Kind("experience_zones", "wsnsim.models.wakeup:ExperienceZones",
            "the head calls every neighbour; each tracks with a probability that depends on its zone",
            "Ren, Li, Gao, Cheng (2009), a reconstruction"),
        Kind("region", "wsnsim.models.wakeup:Region",
            "the next head gets the belief first and calls the region around the predicted position",
            "Yang, Xing, Shi, Pan (2007), a reconstruction"),
    )),
    Role("clusters", "which node is the cluster head, and when it hands over", "ClusterPolicy", "strongest_signal", (
        Kind("strongest_signal", "wsnsim.models.clusters:StrongestSignal",
            "the node with the strongest reading leads until too few of its members sense the target",
            f"{JIANG}, section 2.3"),
        Kind("central", "wsnsim.models.clusters:Central",
            "one fixed head; every node that senses the target is a member"),
        Kind("moving_head", "wsnsim.models.clusters:MovingHead",
            "a head chosen again at each step, near the predicted position", LI),
        Kind("appointed", "wsnsim.models.appointed:Appointed",
            "the head appoints the nodes near its prediction, and hands over before their information is too small"),
    )),
    Role("acquire", "how a track starts from readings: track initiation", "Acquire", "readings", (
        Kind("readings", "wsnsim.models.acquire:FromReadings",
            "the position from the readings that arrived, the rest from the prior"),
    )),
    Role("tracker", "the tracking strategy", "Tracker", None, TRACKERS),
)  # fmt: skip
ROLES: Final = {role.name: role for role in _ROLES}
AT_TOP: Final = {key: role for role in _ROLES for key in role.keys}
"""The role of each key at the top of a scenario."""
