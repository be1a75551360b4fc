"""Every kind of every role: its name in a scenario, where its class lives, and what it is, as strings.

Nothing heavy is imported here: `wsnsim list` reads these rows, and a test compares them with the classes. A kind comes
from this table, from an installed package (entry-point groups `wsnsim.trackers`, `wsnsim.motions` ...: `Role.group`),
or from a dotted path written as the kind itself (`kind: mylab.trackers:Mine`). The table wins where names collide.

    load_class(find("tracker", "pso_mhpf")) -> the class
"""

from __future__ import annotations

import functools
import importlib
from dataclasses import dataclass
from typing import Any, Final

from wsnsim.base.errors import UsageError, did_you_mean

JIANG: Final = "Jiang, Song, Lin (2013)"
LIU: Final = "Liu, Wang (2012)"
WEI: Final = "Wei, Guo (2022)"
RUAN: Final = "Ruan, Wang, Yang, Zhang (2020)"
BENCH_ROLES: Final = ("prior", "deploy", "motion", "sensor", "tracker")


@dataclass(frozen=True)
class Row:
    """One kind. `state`, `messages` (a step) and `variants` are a tracker's; `plugin` is the package it came with."""

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
    """A role of a scenario: what it decides, its port, the kind it has when left out (None: it must be given).

    `of_network`: a scenario without a network can leave it out.
    """

    name: str
    purpose: str
    port: str
    default: str | None
    rows: tuple[Row, ...]

    @property
    def of_network(self) -> bool:
        """Whether only a network needs it."""
        return self.name not in BENCH_ROLES

    @property
    def bench_default(self) -> str | None:
        """The kind it has without a network: one node at the origin deploys itself."""
        return "anchors" if self.name == "deploy" else self.default

    @property
    def plural(self) -> str:
        """The role's name for several of a kind: trackers, energies, clusters."""
        if self.name == "energy":
            return "energies"
        return self.name if self.name.endswith("s") else self.name + "s"

    @property
    def group(self) -> str:
        """The entry-point group that adds kinds to the role."""
        return f"wsnsim.{self.plural}"


_ROLES: Final = (
    Role("prior", "what every filter is told at the start", "PriorModel", "around_truth", (
        Row("around_truth", "wsnsim.models.acquire:AroundTruth",
            "a Gaussian whose mean is drawn around the true start", JIANG),
    )),
    Role("deploy", "where the nodes stand", "Deployment", None, (
        Row("uniform", "wsnsim.models.deploy:Uniform", "uniform at random, redrawn until the field is covered", JIANG),
        Row("grid", "wsnsim.models.deploy:Grid", "a regular grid"),
        Row("jittered_grid", "wsnsim.models.deploy:JitteredGrid", "a regular grid, each node moved at random"),
        Row("file", "wsnsim.models.deploy:FromFile", "positions from a CSV file with columns x, y"),
        Row("anchors", "wsnsim.models.deploy:Anchors", "nodes at the places that the scenario lists"),
    )),
    Role("motion", "how the target moves", "MotionModel", None, (
        Row("bounded_velocity", "wsnsim.models.motion:BoundedVelocity",
            "near-constant velocity, turned back beyond a bound", f"{JIANG}, eq. 1-4"),
        Row("constant_velocity", "wsnsim.models.linear:ConstantVelocity",
            "near-constant velocity in the plane, with the noise inputs of two papers", f"{WEI}; {RUAN}"),
        Row("constant_acceleration", "wsnsim.models.linear:ConstantAcceleration",
            "near-constant acceleration along a line", f"{LIU}, eq. 15-17"),
        Row("ungm", "wsnsim.models.ungm:Ungm",
            "the univariate non-stationary growth model, a benchmark of one column", WEI),
    )),
    Role("sensor", "what a node measures of the target", "SensorModel", None, (
        Row("acoustic_energy", "wsnsim.models.sensing:AcousticEnergy",
            "received energy that falls with a power of the distance", f"{JIANG}, eq. 5-8"),
        Row("range", "wsnsim.models.ranging:Range", "distance from the node, with constant variance", LIU),
        Row("range_from_origin", "wsnsim.models.ranging:RangeFromOrigin",
            "distance from the origin, wherever the node stands", f"{WEI}, experiment 3"),
        Row("rssi", "wsnsim.models.ranging:Rssi",
            "received power in dBm, which falls with the logarithm of the distance", f"{RUAN}, eq. 4"),
        Row("squared", "wsnsim.models.ungm:Squared", "a twentieth of the square of a state of one column",
            f"{WEI}, experiment 1"),
    )),
    Role("energy", "what each act costs in joules", "EnergyModel", None, (
        Row("first_order", "wsnsim.models.energy:FirstOrder",
            "electronics per bit, amplifier per bit and distance squared", f"{JIANG}, eq. 9-11; Heinzelman (2000)"),
        Row("first_order_2002", "wsnsim.models.energy:FirstOrder2002", "free space near, multipath beyond a crossover",
            "Heinzelman (2002)"),
    )),
    Role("link", "who hears whom", "LinkModel", None, (
        Row("disk", "wsnsim.models.links:Disk", "everyone within a fixed reach", JIANG),
    )),
    Role("mac", "when a frame gets the channel", "Mac", "ideal", (
        Row("ideal", "wsnsim.models.links:IdealMac", "no contention; delivered within the instant", JIANG),
    )),
    Role("routing", "which path a relayed message takes", "Routing", "minimum_energy", (
        Row("minimum_energy", "wsnsim.models.links:MinimumEnergy", "the path that costs the fewest joules"),
        Row("minimum_hop", "wsnsim.models.links:MinimumHop", "the path with the fewest hops"),
    )),
    Role("sleep", "which nodes sense and listen when", "SleepSchedule", "event_wake", (
        Row("event_wake", "wsnsim.models.sleep:EventWake", "dormant nodes keep sensor and receiver on", JIANG),
    )),
    Role("wakeup", "how nodes ahead of the target are woken", "WakeUp", "none", (
        Row("none", "wsnsim.models.wakeup:NoWakeUp", "nobody is woken ahead of the target", JIANG),
    )),
    Role("clusters", "who leads, who follows, and until when", "ClusterPolicy", "strongest_signal", (
        Row("strongest_signal", "wsnsim.models.clusters:StrongestSignal",
            "the loudest node leads until too few of its members sense", f"{JIANG}, section 2.3"),
        Row("central", "wsnsim.models.clusters:Central",
            "one head for good, near a fixed point; whoever senses is a member"),
    )),
    Role("acquire", "how a track starts anew from readings", "Acquire", "readings", (
        Row("readings", "wsnsim.models.acquire:FromReadings",
            "position from the readings that arrived, the rest from the prior"),
    )),
    Role("tracker", "the tracking strategy", "Tracker", None, (
        Row("pso_mhpf", "wsnsim.trackers.pso_mhpf:PsoMhpf",
            "particle filter on the members; resampling is a swarm's move under a Metropolis-Hastings test", JIANG,
            state="particles on the active members; mean and covariance in the head",
            messages="a local estimate up per member; moved particles when membership changes",
            variants="measurements own|all, acceptance gaussian|transition|likelihood, random_factors, "
            "step_length one|dt, estimate_when after|before, resample_first, resample_always, "
            "fusion share|inverse_variance, feedback, handover particles|gaussian"),
        Row("ipf", "wsnsim.trackers.information_pf:InformationPf",
            "particle filter in the head that draws from an extended Kalman filter's update", JIANG,
            state="particles in the head, each with a covariance",
            messages="a reading up per member",
            variants="proposal per_particle|local|cloud, handover particles|gaussian"),
        Row("ppf", "wsnsim.trackers.parallel_pf:ParallelPf",
            "bootstrap particle filter split evenly over the members; the head resamples the whole by counts", JIANG,
            state="particles on the active members; mean, covariance and weights in the head",
            messages="readings up and down; weights and a mean up; when resampling counts down, surplus particles",
            variants="measurements all|own, handover particles|gaussian"),
        Row("central_pf", "wsnsim.trackers.centralised:CentralPf",
            "bootstrap particle filter in one head on all readings: the reference", JIANG,
            state="particles in the head",
            messages="a reading up per member",
            variants="handover particles|gaussian"),
        Row("rkf", "wsnsim.trackers.relay_kalman:RelayKalman",
            "one Kalman filter updated with every reading by the probability that it comes from the target", LIU,
            state="mean, covariance and a probability a sensor, in the head",
            messages="a reading up per member",
            variants="spread false|true"),
        Row("imsf", "wsnsim.trackers.interacting_kalman:InteractingKalman",
            "a Kalman filter a sensor, mixed at each step by the probabilities of a Markov chain of sensors", LIU,
            state="mean, covariance and probability of a filter a sensor, in the head",
            messages="a reading up per member",
            variants="mixing corrected|printed"),
        Row("pf", "wsnsim.trackers.sir:Sir",
            "the textbook particle filter: predict, weigh, resample at every step", f"{WEI}; {RUAN}",
            state="particles in the head",
            messages="a reading up per member",
            variants="handover particles|gaussian"),
        Row("cs_pf", "wsnsim.trackers.cuckoo_pf:CuckooPf",
            "particle filter whose resampling is a cuckoo search: Levy flights and replaced nests", WEI,
            state="particles in the head",
            messages="a reading up per member",
            variants="variant literal|resample_first|metropolis, alpha random|fixed, fitness gaussian|absolute, "
            "move all|position, handover particles|gaussian"),
        Row("ics_pf", "wsnsim.trackers.cuckoo_pf:ImprovedCuckooPf",
            "cuckoo search particle filter whose steps and replacement shrink over the generations", WEI,
            state="particles in the head",
            messages="a reading up per member",
            variants="variant literal|resample_first|metropolis, fitness gaussian|absolute, move all|position, "
            "handover particles|gaussian"),
        Row("gpf", "wsnsim.trackers.gaussian_pf:GaussianPf",
            "particles drawn from a Gaussian, weighed, and summed up in a Gaussian: no resampling", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants=""),
        Row("pso_gpf", "wsnsim.trackers.gaussian_pf:SwarmGaussianPf",
            "Gaussian particle filter whose predicted particles fly as a swarm before they are weighed", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants="move position|all"),
        Row("gsa_gpf", "wsnsim.trackers.gaussian_pf:GravitationalGaussianPf",
            "Gaussian particle filter whose predicted particles attract each other by their likelihoods", RUAN,
            state="mean and covariance in the head",
            messages="a reading up per member",
            variants="acceptance always|greedy, move position|all"),
        Row("ekf", "wsnsim.trackers.ekf:ExtendedKalman",
            "extended Kalman filter on all readings, or on the nearest sensor's alone: a reference",
            state="mean and covariance in the head",
            messages="a reading up per member; or a poll down and a reading up, of the nearest",
            variants="readings all|nearest"),
        Row("grid", "wsnsim.trackers.grid:GridFilter",
            "the exact posterior of a state of one column, on a grid: a reference",
            state="a density on a grid, in the head",
            messages="a reading up per member",
            variants=""),
        Row("trilateration", "wsnsim.trackers.trilateration:Trilateration",
            "the weighted centroid of the circles' crossings, without memory: a baseline", RUAN,
            state="the last position found",
            messages="a reading up per member",
            variants=""),
    )),
)  # fmt: skip
ROLES: Final = {role.name: role for role in _ROLES}


def role_named(word: str) -> Role:
    """The role of this name, singular or plural. Raises UsageError with the nearest one."""
    for role in _ROLES:
        if word in (role.name, role.plural):
            return role
    raise UsageError(f"unknown role '{word}' ({did_you_mean(word, [role.plural for role in _ROLES])})")


def kinds(role: str) -> dict[str, Row]:
    """Every kind of a role by name, installed plug-ins included; importing none of them."""
    own = {row.kind: row for row in ROLES[role].rows}
    return own | {row.kind: row for row in _installed().get(ROLES[role].group, ()) if row.kind not in own}


def find(role: str, kind: str) -> Row:
    """The row of a kind, or of the class that a dotted path names. Raises LookupError with the nearest kind."""
    if ":" in kind:
        return Row(kind, kind, "")
    known = kinds(role)
    if kind not in known:
        raise LookupError(f"unknown {role} '{kind}' ({did_you_mean(kind, known)})")
    return known[kind]


def load_class(row: Row) -> type[Any]:
    """The class of a row. Raises ImportError with the import's own reason, in one line."""
    module, _, name = row.path.partition(":")
    named = row.path if row.kind == row.path else f"'{row.kind}' ({row.path})"
    try:
        found: Any = importlib.import_module(module)
        for step in name.split("."):
            found = getattr(found, step)
    except (Exception, SystemExit) as reason:  # whatever a plug-in's module may raise
        said = " ".join(str(reason).split())
        raise ImportError(f"{named} cannot be imported: {type(reason).__name__}: {said}") from reason
    if not isinstance(found, type):
        raise ImportError(f"{named} is no class")
    return found


@functools.cache
def _installed() -> dict[str, tuple[Row, ...]]:
    import importlib.metadata  # slow to import, and not needed to say what a command does

    groups: dict[str, tuple[Row, ...]] = {}
    for group in (role.group for role in _ROLES):
        points = sorted(importlib.metadata.entry_points(group=group), key=lambda point: point.name)
        if points:
            groups[group] = tuple(_row(point) for point in points)
    return groups


def _row(point: Any) -> Row:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "an installed package"
    return Row(point.name, point.value, f"plug-in of {package}", plugin=package)
