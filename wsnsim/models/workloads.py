"""Workloads: the network tracks targets, or its nodes send beacons or reports; their sinks, and the collection tree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.quiet import Upkeep
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import RadioSetup, Setup
from wsnsim.models.access import Framed, IdealMac
from wsnsim.models.bounds import COUNT, DURATION, PAYLOAD, PERIOD, PLACE, SECONDS, SPAN

SinkPoints: TypeAlias = Annotated[
    tuple[tuple[float, float], ...], PLACE, "x and y: each sink is the node nearest to one"
]
BEACON_BITS: Final = 88
"""Bits of a routing beacon: options 8, parent 16, cost 16 (TEP 123); link estimation: flags 8, number 8; position 32
(ours)."""
SETTLING: Final = 4.0
"""Longest intervals after which a collection tree has settled: the shorter ones before take one (our choice)."""
MOST_NODES: Final = 20_000
"""Nodes above which no sink is looked at."""


def sink_issues(setup: Setup, every: float | None, role: str = "sink") -> Iterator[Issue]:
    """Yield an issue for reports at times that are not steps, and for each sink that no route reaches.

    Args:
        setup: The scenario.
        every: Time between reports in s; None: every step.
        role: The role that names the sinks.
    """
    if every is not None:
        steps = every / setup.dt
        if abs(steps - round(steps)) > 1e-9 * steps or round(steps) < 1:
            yield Issue((role, "every"), f"{every:g} s must be a whole number of steps of {setup.dt:g} s")
    yield from _unreachable(setup, role)


def _unreachable(setup: Setup, role: str) -> Iterator[Issue]:
    """Yield an issue for each sink that no other node can reach over one link, where places are fixed."""
    if not isinstance(setup, RadioSetup):
        return
    positions = _fixed_positions(setup)
    if positions is None or not 1 < len(positions) <= MOST_NODES:
        return
    for sink in dict.fromkeys(int(_distances(positions, point).argmin()) for point in setup.sink_points):
        x, y = positions[sink].tolist()
        nearest = float(np.partition(_distances(positions, (x, y)), 1)[1])
        if nearest > setup.link.audible:
            yield Issue(
                (role,),
                f"no route reaches the sink, node {sink} at ({x:g}, {y:g}) m: the nearest other node is {nearest:.4g} m"
                f" away, and {_longest(setup)}",
            )


def _longest(setup: RadioSetup) -> str:
    """How long a link can be, in words."""
    if setup.link.audible == setup.link.reach:
        return f"the communication range is link.reach = {setup.link.reach:g} m"
    return f"no frame is heard beyond {setup.link.audible:.4g} m, even over the strongest link"


def _fixed_positions(setup: RadioSetup) -> Floats | None:
    """(N, 2) positions that are the same in every run, in m; None if they are random, or cannot be read."""
    if not getattr(setup.deploy, "fixed", False):
        return None
    try:
        return setup.deploy.draw(setup.link.reach, np.random.default_rng(0))
    except RunError:  # the deployment says so itself
        return None


def _distances(positions: Floats, point: tuple[float, float]) -> Floats:
    return np.hypot(positions[:, 0] - point[0], positions[:, 1] - point[1])


@part
class Tracking:
    """The network tracks targets."""

    mechanism: ClassVar[str] = "tracking"


@part
class Periodic:
    """A network without targets: every node broadcasts a beacon once per period, from a random phase on.

    The workload for comparing radios and simulators: what arrives depends on the radio alone.
    """

    mechanism: ClassVar[str] = "beacons"

    period: Annotated[float, PERIOD, "time between a node's beacons, on its own clock"] = 1.0
    bits: Annotated[int, PAYLOAD, "payload of a beacon"] = PACKET_BITS

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if a beacon takes longer than its period."""
        mac = setup.mac if isinstance(setup, RadioSetup) else None
        airtime = 0.0
        if isinstance(mac, Framed):
            airtime = mac.airtime(mac.bits(self.bits))
        elif isinstance(mac, IdealMac) and mac.rate is not None:
            airtime = self.bits / mac.rate
        if airtime > self.period:
            yield Issue(
                ("workload", "period"), f"a beacon of {self.bits} bits takes {airtime:g} s, more than its period"
            )


class ReportsEvery:
    """What sinks share that estimates are reported to."""

    every: float | None

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for reports at times that are not steps, and for sinks that no route reaches."""
        yield from sink_issues(setup, self.every)


@part
class NoSink:
    """No sink: the estimates stay at the cluster heads."""

    point: ClassVar[tuple[float, float] | None] = None
    bits: ClassVar[int] = 0
    every: ClassVar[float | None] = None


@part
class NearestNode(ReportsEvery):
    """The sink is the node nearest to a point. It receives the estimates over several hops (our choice), never sleeps.

    By default a report is one packet of Jiang et al. (2013), 12 bytes.
    """

    x: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    y: Annotated[float, PLACE, "the sink is the node nearest to (x, y)"] = 0.0
    bits: Annotated[int, PAYLOAD, "bits of a report"] = PACKET_BITS
    every: Annotated[float | None, DURATION, "time between reports; left out: every estimate is reported"] = None

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) in m."""
        return self.x, self.y


@part
class SeveralSinks(ReportsEvery):
    """Several sinks: the nodes nearest to some points. A report goes to one of them; sinks never sleep.

    With the shortest paths of the network (`minimum_energy`, `minimum_hop`) it is the sink with the cheapest path, with
    `greedy_geographic` the nearest that is reached. By default a report is one packet of Jiang et al. (2013), 12 bytes.
    """

    points: SinkPoints = ((0.0, 0.0),)
    bits: Annotated[int, PAYLOAD, "bits of a report"] = PACKET_BITS
    every: Annotated[float | None, DURATION, "time between reports; left out: every estimate is reported"] = None

    def __post_init__(self) -> None:
        """Raises ValueError if no point is listed."""
        if not self.points:
            raise ValueError("points must list at least one sink, such as [[0, 0]]")

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) of the first sink in m."""
        return self.points[0]


@part
class CollectionTreeProtocol:
    """Routes that nodes find and pay for: reports go up a collection tree, other datagrams from position to position.

    Every node broadcasts routing beacons with the cost of its route to a sink, its ETX: the expected number of
    transmissions. It learns the ETX of its links from beacons and acknowledgements, and takes the cheapest route.
    Beacons are sent when a Trickle timer says so, often at first and after a change, and rarely later (its redundancy
    constant is infinite, so that none is suppressed). Data frames carry the cost of their senders, which shows loops.
    Nodes that are cut off from all sinks are in loops, too, and the costs of their routes rise until they reach
    `largest_cost`. A network starts without a tree. A datagram to another node than a sink, such as a handover over
    several hops, goes to neighbours nearer to the destination, by the positions in beacons. Between a head and
    members in range there is one hop. To see what finding routes costs, compare with `kind: minimum_hop`, for which
    nodes know all links for nothing.

    Source: Gnawali, Fonseca, Jamieson, Moss, Levis (2009), "Collection tree protocol", SenSys: 32 retransmissions; TEP
    123; Trickle: RFC 6206. The intervals, the table of 10, the queue of 12, the hysteresis of 1.5 and 7 ms are those of
    TinyOS 2.1 for a CC2420 that always listens; over a duty-cycled MAC, where a beacon takes a wake interval, `i_min`
    should be some seconds. TEP 123 leaves `largest_cost` to the implementation, and TinyOS has none: 64 is that of
    Contiki's collection protocol (COLLECT_MAX_DEPTH). `patience`, `places` and `candidates` are ours.
    """

    weight: ClassVar[str] = "etx"

    i_min: Annotated[float, PERIOD, "I_min: shortest interval between a node's beacons"] = 0.128
    i_max: Annotated[float, PERIOD, "I_max: longest interval between a node's beacons"] = 512.0
    retries: Annotated[
        int, Quantity("", ge=0, le=1000), "how often a datagram is sent again over a hop, by the MAC or the node"
    ] = 32
    hysteresis: Annotated[
        float, Quantity("", ge=0.0, le=100.0), "ETX by which a route must be better than that over the parent"
    ] = 1.5
    largest_cost: Annotated[
        float, Quantity("", gt=0.0), "ETX from which on a route is not considered: nodes that are cut off have none"
    ] = 64.0
    table: Annotated[int, COUNT, "neighbours whose routes and links a node keeps"] = 10
    queue: Annotated[int, COUNT, "datagrams for sinks that a node holds"] = 12
    packet_time: Annotated[float, SPAN, "a node pauses for one to two times this after a frame"] = 7e-3
    patience: Annotated[float, SECONDS, "how long a datagram waits for a route"] = 10.0
    places: Annotated[int, COUNT, "neighbours whose positions a node keeps"] = 40
    candidates: Annotated[int, Quantity("", ge=1, le=100), "bursts of a node for a datagram that goes by position"] = 3

    def upkeep(self, setup: RadioSetup) -> tuple[Upkeep, ...]:
        """A beacon of every node in each of the longest intervals, which lost beacons shorten again and again."""
        return (Upkeep(BEACON_BITS, self.i_max, SETTLING * self.i_max, steady=setup.link.perfect),)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for intervals in the wrong order, and for a MAC whose senders learn nothing of arrivals."""
        if self.i_max < self.i_min:
            yield Issue(("routing", "i_max"), f"{self.i_max:g} s is less than routing.i_min = {self.i_min:g} s")
        if isinstance(setup, RadioSetup) and not getattr(setup.mac, "acks", True) and setup.mac.mechanism != "tdma":
            yield Issue(
                ("routing", "kind"),
                "ctp learns of its links from acknowledgements, and mac.acks is false: set mac.acks: true, or use "
                "minimum_hop",
            )


@part
class PeriodicCollection:
    """A network without targets: every node but the sinks reports once per period to a sink, from a random phase on.

    The workload for comparing ways to collect: which share of the reports arrives, when, at which sink, for how many
    joules. The table `reports` has a row for each.
    """

    mechanism: ClassVar[str] = "collection"

    points: SinkPoints = ((0.0, 0.0),)
    period: Annotated[float, PERIOD, "time between a node's reports, on its own clock"] = 60.0
    bits: Annotated[int, PAYLOAD, "bits of a report"] = PACKET_BITS
    start_at: Annotated[float, SECONDS, "when the first period begins"] = 0.0

    def __post_init__(self) -> None:
        """Raises ValueError if no point is listed."""
        if not self.points:
            raise ValueError("points must list at least one sink, such as [[0, 0]]")

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for each sink that no route reaches."""
        yield from sink_issues(setup, None, "workload")
