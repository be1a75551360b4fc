"""The table of all built-in kinds of all roles: name, class and description, as strings.

    ROLES: {role name: Role}    AT_TOP: {key at the top of a scenario: Role}    Scope: which roles a scenario uses

Nothing is imported here: `wsnsim list` shows this table, and a test compares it with the classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

JIANG: Final = "Jiang, Song, Lin (2013)"
LIU: Final = "Liu, Wang (2012)"
WEI: Final = "Wei, Guo (2022)"
RUAN: Final = "Ruan, Wang, Yang, Zhang (2020)"
LI: Final = "Li, Jiang, Zhang, Zhang (2012)"
IEEE: Final = "IEEE 802.15.4-2006"
OFFLINE_ROLES: Final = ("prior", "deploy", "motion", "sensor", "tracker")
TARGET_ROLES: Final = (
    "prior", "motion", "sensor", "wakeup", "clusters", "acquire", "detection", "sink", "tracker",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """The description of one kind.

    Attributes:
        kind: its name in a scenario.
        path: module and class, 'package.module:Class'.
        idea: what it is, in one line.
        paper: its source.
        state: of a tracker: what is kept between steps, and where.
        messages: of a tracker: what is sent in a step.
        variants: of a tracker: the options that change the method.
        plugin: name and version of the package that adds it; '' if it comes with wsnsim.
    """

    kind: str
    path: str
    idea: str
    paper: str = ""
    state: str = ""
    messages: str = ""
    variants: str = ""
    plugin: str = ""


@dataclass(frozen=True)
class Role:
    """A role of a scenario.

    Attributes:
        name: the role's name, and its key in a scenario.
        purpose: what the role decides.
        port: name of the Protocol that its components satisfy.
        default: the kind of a role that is left out; None: the role must be given.
        kinds: the kinds that come with wsnsim.
        listed: the key of a list of several components, instead of one under the role's name; '' if not allowed.
        optional: the components stand in a list only, and the list may be empty.
    """

    name: str
    purpose: str
    port: str
    default: str | None
    kinds: tuple[Kind, ...]
    listed: str = ""
    optional: bool = False

    @property
    def of_network(self) -> bool:
        """Whether only scenarios with a network use the role."""
        return self.name not in OFFLINE_ROLES

    @property
    def of_targets(self) -> bool:
        """Whether only scenarios with targets use the role."""
        return self.name in TARGET_ROLES

    @property
    def offline_default(self) -> str | None:
        """The kind of the role in a scenario without a network. Default deployment: one node at the origin."""
        return "anchors" if self.name == "deploy" else self.default

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of a scenario under which components of the role stand."""
        return tuple(key for key in ("" if self.optional else self.name, self.listed) if key)

    @property
    def plural(self) -> str:
        """The plural of the role's name: trackers, energies, clusters."""
        if self.name == "energy":
            return "energies"
        return self.name if self.name.endswith("s") else self.name + "s"

    @property
    def group(self) -> str:
        """The entry-point group through which packages add kinds to the role."""
        return f"wsnsim.{self.plural}"


_ROLES: Final = (
    Role("prior", "what every filter is told at the start", "PriorModel", "around_truth", (
        Kind("around_truth", "wsnsim.models.acquire:AroundTruth",
            "a Gaussian whose mean is drawn around the true start", JIANG),
    )),
    Role("deploy", "where the nodes stand", "Deployment", None, (
        Kind("uniform", "wsnsim.models.deploy:Uniform", "uniform at random, redrawn until the field is covered", JIANG),
        Kind("grid", "wsnsim.models.deploy:Grid", "a regular grid"),
        Kind("jittered_grid", "wsnsim.models.deploy:JitteredGrid", "a regular grid, each node moved at random"),
        Kind("file", "wsnsim.models.deploy:FromFile", "positions from a CSV file with columns x, y"),
        Kind("anchors", "wsnsim.models.deploy:Anchors", "nodes at the places that the scenario lists"),
    )),
    Role("motion", "how the target moves", "MotionModel", None, (
        Kind("bounded_velocity", "wsnsim.models.motion:BoundedVelocity",
            "near-constant velocity, turned back beyond a bound", f"{JIANG}, eq. 1-4"),
        Kind("constant_velocity", "wsnsim.models.linear:ConstantVelocity",
            "near-constant velocity in the plane, with the noise inputs of two papers", f"{WEI}; {RUAN}"),
        Kind("constant_acceleration", "wsnsim.models.linear:ConstantAcceleration",
            "near-constant acceleration along a line", f"{LIU}, eq. 15-17"),
        Kind("ungm", "wsnsim.models.ungm:Ungm",
            "the univariate non-stationary growth model, a benchmark of one column", WEI),
        Kind("random_waypoint", "wsnsim.models.waypoints:RandomWaypoint",
            "straight legs between random points of an area, from a start that is stationary in time",
            f"{LI}; Navidi, Camp (2004); Le Boudec, Vojnovic (2005)"),
        Kind("waypoints", "wsnsim.models.waypoints:Waypoints",
            "straight legs between points with times, from a CSV file or the scenario"),
        Kind("gauss_markov", "wsnsim.models.mobility:GaussMarkov",
            "velocity that forgets itself gradually, about a mean", "Liang, Haas (2003)"),
        Kind("coordinated_turn", "wsnsim.models.mobility:CoordinatedTurn",
            "constant speed along arcs whose turn rate drifts", "Bar-Shalom, Li, Kirubarajan (2001), section 11.7"),
    ), listed="targets"),
    Role("sensor", "what a node measures of the target", "SensorModel", None, (
        Kind("acoustic_energy", "wsnsim.models.sensing:AcousticEnergy",
            "received energy that falls with a power of the distance", f"{JIANG}, eq. 5-8"),
        Kind("range", "wsnsim.models.ranging:Range", "distance from the node, with constant variance", LIU),
        Kind("range_from_origin", "wsnsim.models.ranging:RangeFromOrigin",
            "distance from the origin, wherever the node stands", f"{WEI}, experiment 3"),
        Kind("rssi", "wsnsim.models.ranging:Rssi",
            "received power in dBm, which falls with the logarithm of the distance", f"{RUAN}, eq. 4"),
        Kind("squared", "wsnsim.models.ungm:Squared", "a twentieth of the square of a state of one column",
            f"{WEI}, experiment 1"),
    )),
    Role("energy", "what each act costs in joules", "EnergyModel", None, (
        Kind("first_order", "wsnsim.models.energy:FirstOrder",
            "electronics per bit, amplifier per bit and distance squared", f"{JIANG}, eq. 9-11; Heinzelman (2000)"),
        Kind("first_order_2002", "wsnsim.models.energy:FirstOrder2002", "free space near, multipath beyond a crossover",
            "Heinzelman (2002)"),
        Kind("states", "wsnsim.models.energy:States",
            "power by state, from the datasheets of a radio and a processor (`wsnsim list parts`)"),
    )),
    Role("link", "who hears whom", "LinkModel", None, (
        Kind("disk", "wsnsim.models.links:Disk", "everyone within a fixed reach", JIANG),
        Kind("log_normal", "wsnsim.models.links:LogNormal",
            "power falls with the logarithm of the distance and differs from link to link; weak frames arrive seldom",
            f"Zuniga, Krishnamachari (2004); {IEEE}"),
    )),
    Role("mac", "when a frame gets the channel", "Mac", "ideal", (
        Kind("ideal", "wsnsim.models.access:IdealMac", "no contention; delivered within the instant", JIANG),
        Kind("csma", "wsnsim.models.access:Csma",
            "listen before sending, after a random backoff; acknowledged and repeated", f"{IEEE}, unslotted CSMA/CA"),
        Kind("tdma", "wsnsim.models.access:Tdma", "slots inside a cluster, given by its head; contention outside",
            "Heinzelman (2002)"),
    )),
    Role("packing", "how many packets of a burst travel in a frame", "Packing", "none", (
        Kind("none", "wsnsim.models.hardware:NoPacking", "each packet in a frame of its own", JIANG),
        Kind("frames", "wsnsim.models.hardware:Frames", "as many as a frame holds"),
    )),
    Role("routing", "which path a relayed message takes", "Routing", "minimum_energy", (
        Kind("minimum_energy", "wsnsim.models.links:MinimumEnergy", "the path that costs the fewest joules"),
        Kind("minimum_hop", "wsnsim.models.links:MinimumHop", "the path with the fewest hops"),
        Kind("greedy_geographic", "wsnsim.models.links:GreedyGeographic", "each hop goes nearest to the goal",
            "Karp, Kung (2000)"),
    )),
    Role("sleep", "which nodes sense and listen when", "SleepSchedule", "event_wake", (
        Kind("event_wake", "wsnsim.models.sleep:EventWake", "dormant nodes keep sensor and receiver on", JIANG),
        Kind("always_on", "wsnsim.models.sleep:AlwaysOn", "nobody ever sleeps"),
        Kind("ris", "wsnsim.models.sleep:RandomIndependent",
            "each node is awake for each of its periods with a probability, independently",
            f"Kumar, Lai, Balogh (2004); {LI}"),
        Kind("duty_cycle", "wsnsim.models.sleep:DutyCycle",
            "each node is awake for a fixed share of each period, all at once or staggered"),
    )),
    Role("cpu", "how long computing takes", "Cpu", "processor", (
        Kind("processor", "wsnsim.models.hardware:Processor",
            "cycles over the clock's rate; no time at all if none is given", JIANG),
    )),
    Role("clock", "how true the nodes' clocks are", "Clock", "perfect", (
        Kind("perfect", "wsnsim.models.hardware:PerfectClock", "every clock is true", JIANG),
        Kind("drift", "wsnsim.models.hardware:DriftingClock", "each clock runs fast or slow by a share of its own"),
    )),
    Role("detection", "how faithfully nodes report what they measure", "Detection", "perfect", (
        Kind("perfect", "wsnsim.models.hardware:PerfectDetection", "every reading is reported as it is", JIANG),
        Kind("imperfect", "wsnsim.models.hardware:ImperfectDetection",
            "readings are missed, made up, biased or stuck"),
    )),
    Role("sink", "who is told of every estimate", "Sink", "none", (
        Kind("none", "wsnsim.models.hardware:NoSink", "nobody: estimates stay with the heads", JIANG),
        Kind("node", "wsnsim.models.hardware:NearestNode",
            "the node nearest to a point, over as many hops as it takes"),
    )),
    Role("workload", "what the network does", "Workload", "tracking", (
        Kind("tracking", "wsnsim.models.workload:Tracking", "it follows its targets", JIANG),
        Kind("beacons", "wsnsim.models.workload:Periodic",
            "no target: every node broadcasts a beacon once a period"),
    )),
    Role("fault", "what goes wrong, when, and whom it hits", "FaultEvent", None, (
        Kind("crash", "wsnsim.models.faults:Crash", "nodes fall silent and lose what they knew"),
        Kind("restart", "wsnsim.models.faults:Restart", "nodes start anew: what they knew is lost"),
        Kind("drain", "wsnsim.models.faults:Drain", "nodes lose charge at once"),
        Kind("blackout", "wsnsim.models.faults:Blackout", "radios are jammed: they neither hear nor are heard"),
        Kind("link_loss", "wsnsim.models.faults:LinkLoss", "frames from and to nodes are lost"),
        Kind("clock_step", "wsnsim.models.faults:ClockStep", "clocks jump"),
        Kind("stuck", "wsnsim.models.faults:Stuck", "readings freeze"),
        Kind("bias", "wsnsim.models.faults:Bias", "readings are off by a constant"),
    ), listed="faults", optional=True),
    Role("wakeup", "how nodes ahead of the target are woken", "WakeUp", "none", (
        Kind("none", "wsnsim.models.wakeup:NoWakeUp", "nobody is woken ahead of the target", JIANG),
        Kind("directed_flood", "wsnsim.models.wakeup:DirectedFlood",
            "a message is handed on towards the prediction, and wakes the region about it", f"{LI}, section 2.2"),
        Kind("experience_zones", "wsnsim.models.wakeup:ExperienceZones",
            "every neighbour is called, and tracks with a probability that depends on its zone",
            "Ren, Li, Gao, Cheng (2009), a reconstruction"),
        Kind("region", "wsnsim.models.wakeup:Region",
            "the next head is told first, and calls its neighbours in the region about the prediction",
            "Yang, Xing, Shi, Pan (2007), a reconstruction"),
    )),
    Role("clusters", "who leads, who follows, and until when", "ClusterPolicy", "strongest_signal", (
        Kind("strongest_signal", "wsnsim.models.clusters:StrongestSignal",
            "the loudest node leads until too few of its members sense", f"{JIANG}, section 2.3"),
        Kind("central", "wsnsim.models.clusters:Central",
            "one head for good, near a fixed point; whoever senses is a member"),
        Kind("moving_head", "wsnsim.models.clusters:MovingHead",
            "a head anew at each step: the node nearest to the prediction, or that read the target nearest", LI),
    )),
    Role("acquire", "how a track starts anew from readings", "Acquire", "readings", (
        Kind("readings", "wsnsim.models.acquire:FromReadings",
            "position from the readings that arrived, the rest from the prior"),
    )),
    Role("tracker", "the tracking strategy", "Tracker", None, (
        Kind("pso_mhpf", "wsnsim.trackers.pso_mhpf:PsoMhpf",
            "particle filter on the members; resampling is a swarm's move under a Metropolis-Hastings test", JIANG,
            state="particles on the active members; mean and covariance in the head",
            messages="a local estimate up per member; moved particles when membership changes",
            variants="measurements own|all, acceptance gaussian|transition|likelihood, random_factors, "
            "step_length one|dt, estimate_when after|before, resample_first, resample_always, "
            "fusion share|inverse_variance, feedback, handover particles|gaussian"),
        Kind("ipf", "wsnsim.trackers.information_pf:InformationPf",
            "particle filter in the head that draws from an extended Kalman filter's update", JIANG,
            state="particles in the head, each with a covariance",
            messages="a reading up per member",
            variants="proposal per_particle|local|cloud, handover particles|gaussian"),
        Kind("ppf", "wsnsim.trackers.parallel_pf:ParallelPf",
            "bootstrap particle filter split evenly over the members; the head resamples the whole by counts", JIANG,
            state="particles on the active members; mean, covariance and weights in the head",
            messages="readings up and down; weights and a mean up; when resampling counts down, surplus particles",
            variants="measurements all|own, handover particles|gaussian"),
        Kind("central_pf", "wsnsim.trackers.centralised:CentralPf",
            "bootstrap particle filter in one head on all readings: the reference", JIANG,
            state="particles in the head",
            messages="a reading up per member",
            variants="handover particles|gaussian"),
        Kind("rkf", "wsnsim.trackers.relay_kalman:RelayKalman",
            "one Kalman filter updated with every reading by the probability that it comes from the target", LIU,
            state="mean, covariance and a probability a sensor, in the head",
            messages="a reading up per member",
            variants="spread false|true"),
        Kind("imsf", "wsnsim.trackers.interacting_kalman:InteractingKalman",
            "a Kalman filter a sensor, mixed at each step by the probabilities of a Markov chain of sensors", LIU,
            state="mean, covariance and probability of a filter a sensor, in the head",
            messages="a reading up per member",
            variants="mixing corrected|printed"),
        Kind("pf", "wsnsim.trackers.sir:Sir",
            "the textbook particle filter: predict, weigh, resample at every step", f"{WEI}; {RUAN}",
            state="particles in the head",
            messages="a reading up per member",
            variants="handover particles|gaussian"),
        Kind("cs_pf", "wsnsim.trackers.cuckoo_pf:CuckooPf",
            "particle filter whose resampling is a cuckoo search: Levy flights and replaced nests", WEI,
            state="particles in the head",
            messages="a reading up per member",
            variants="variant literal|resample_first|metropolis, alpha random|fixed, fitness gaussian|absolute, "
            "move all|position, handover particles|gaussian"),
        Kind("ics_pf", "wsnsim.trackers.cuckoo_pf:ImprovedCuckooPf",
            "cuckoo search particle filter whose steps and replacement shrink over the generations", WEI,
            state="particles in the head",
            messages="a reading up per member",
            variants="variant literal|resample_first|metropolis, fitness gaussian|absolute, move all|position, "
            "handover particles|gaussian"),
        Kind("gpf", "wsnsim.trackers.gaussian_pf:GaussianPf",
            "particles drawn from a Gaussian, weighed, and summed up in a Gaussian: no resampling", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants=""),
        Kind("pso_gpf", "wsnsim.trackers.gaussian_pf:SwarmGaussianPf",
            "Gaussian particle filter whose predicted particles fly as a swarm before they are weighed", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants="move position|all"),
        Kind("gsa_gpf", "wsnsim.trackers.gaussian_pf:GravitationalGaussianPf",
            "Gaussian particle filter whose predicted particles attract each other by their likelihoods", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants="acceptance always|greedy, move position|all"),
        Kind("ekf", "wsnsim.trackers.ekf:ExtendedKalman",
            "extended Kalman filter on all readings, or on the nearest sensor's alone: a reference",
            state="mean and covariance in the head",
            messages="a reading up per member; or a poll down and a reading up, of the nearest",
            variants="readings all|nearest"),
        Kind("grid", "wsnsim.trackers.grid:GridFilter",
            "the exact posterior of a state of one column, on a grid: a reference",
            state="a density on a grid, in the head",
            messages="a reading up per member",
            variants=""),
        Kind("trilateration", "wsnsim.trackers.trilateration:Trilateration",
            "the weighted centroid of the circles' intersections, without memory: a baseline", RUAN,
            state="the last position found",
            messages="a reading up per member",
            variants=""),
        Kind("gmtt", "wsnsim.trackers.grey:GreyTracking",
            "least squares on the ranges, and a grey model of the last fixes that predicts the next", LI,
            state="the last fixes with their times, in the head",
            messages="a reading up per member",
            variants="correction tail|literal|none, report fix|prediction, shift, window"),
        Kind("tsstp", "wsnsim.trackers.markov:TwoPhase",
            "least squares on the ranges; the next position is the last", f"Ren, Li, Gao, Cheng (2009), after {LI}",
            state="the last two fixes, in the head",
            messages="a reading up per member",
            variants=""),
        Kind("cluster", "wsnsim.trackers.mixture_pf:MixturePf",
            "Rao-Blackwellised particle filter over whether the target keeps its course or turns",
            f"Yang, Xing, Shi, Pan (2007), after {LI}",
            state="modes, each with a Kalman filter, in the head",
            messages="a reading up per member",
            variants=""),
        Kind("ris", "wsnsim.trackers.awake_only:AwakeOnly",
            "least squares on the ranges of whoever is awake: no prediction, no memory", LI,
            state="the last fix, in the head",
            messages="a reading up per member",
            variants=""),
    )),
)  # fmt: skip
ROLES: Final = {role.name: role for role in _ROLES}
AT_TOP: Final = {key: role for role in _ROLES for key in role.keys}
"""The role of each key at the top of a scenario."""


@dataclass(frozen=True)
class Scope:
    """Which roles a scenario uses: with or without a network, with or without targets."""

    network: bool = True
    targets: bool = True

    def uses(self, role: Role) -> bool:
        """Return whether a run builds components of the role."""
        return (self.network or not role.of_network) and (self.targets or not role.of_targets)

    def default(self, role: Role) -> str | None:
        """Return the kind of a role that is left out; None: the role must be given."""
        return role.default if self.network else role.offline_default
