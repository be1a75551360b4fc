"""Gathering with a deadline: what the head has by then, how long it took, over how many hops, and that all is paid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.helpers.centroid_network import Centroid, Run, network_setup, reading_of, standing
from tests.network.radio_network import RadioNetwork
from wsnsim.base.errors import RunError
from wsnsim.base.part import part
from wsnsim.base.requests import PACKET_BITS, Gather, GatherReadings, Parcel
from wsnsim.models.access import Csma, IdealMac, Tdma
from wsnsim.models.clusters import Central
from wsnsim.models.faults import Crash
from wsnsim.models.links import Disk, MinimumHop
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.network.clusters.collection import Collection

STAR = [(0.0, 0.0), (20.0, 0.0), (0.0, 25.0), (-30.0, 0.0), (0.0, -35.0), (25.0, 25.0)]
ROW = [(0.0, 0.0), (60.0, 0.0), (120.0, 0.0), (180.0, 0.0)]
MACS = {"csma": Csma(), "slots": Tdma(), "ideal with a rate": IdealMac(rate=250e3)}


class Gathering:
    """One gather over a radio network, without a tracker: the masks, the journeys, and when the head went on."""

    def __init__(
        self, net: RadioNetwork, nodes: list[int], deadline: float | None = None, packets: int = 1,
        window: tuple[float, float] | None = None, one_hop: bool = True,
    ) -> None:  # fmt: skip
        collection = Collection(net.env, net.transport, 0, 0, window, one_hop)
        self.net, self.began = net, net.env.now
        parcels = [Parcel(float(node), packets, PACKET_BITS, "reading") for node in nodes]

        def head() -> Iterator[Any]:
            self.masks, self.journeys = yield from collection.gather(nodes, parcels, deadline)
            self.took = net.env.now - self.began

        net.env.run(until=net.env.process(head()))
        self.arrived = [node for node, mask in zip(nodes, self.masks, strict=True) if mask is not None]

    def delays(self) -> dict[int, float]:
        return {node: self.journeys.of(node)[0] for node in self.arrived}

    def heard(self) -> dict[int, float]:
        """{sender: seconds from the request until the head received its reading}, by the event log, to the very end."""
        self.net.env.run()
        word = self.net.log.code("reading")
        rows = [row for row in self.net.rows("receive") if (row["node"], row["what"]) == (0, word)]
        times: dict[int, float] = {}
        for row in rows:
            if row["time"] >= self.began:
                times.setdefault(row["peer"], row["time"] - self.began)
        return times


@pytest.mark.parametrize("mac", MACS.values(), ids=MACS)
def test_the_delay_of_a_parcel_is_when_the_event_log_says_that_the_head_received_it(mac) -> None:
    found = Gathering(RadioNetwork(STAR, mac=mac), [0, 1, 2, 3, 4, 5])
    assert found.arrived == [0, 1, 2, 3, 4, 5]
    delays, heard = found.delays(), found.heard()
    assert delays.pop(0) == 0.0 and found.journeys.of(0) == (0.0, 0)
    assert delays == pytest.approx(heard, rel=1e-12)
    assert len({*delays.values()}) == 5 and max(delays.values()) <= found.took
    assert [found.journeys.of(node)[1] for node in range(1, 6)] == [1] * 5


@pytest.mark.parametrize("mac", MACS.values(), ids=MACS)
def test_at_the_deadline_the_head_goes_on_with_what_it_has_received(mac) -> None:
    everything = Gathering(RadioNetwork(STAR, mac=mac), [1, 2, 3, 4, 5]).delays()
    third = sorted(everything.values())[2]
    found = Gathering(RadioNetwork(STAR, mac=mac), [0, 1, 2, 3, 4, 5], deadline=third + 1e-5)
    assert found.took == pytest.approx(third + 1e-5)
    assert {*found.arrived} == {0, *(node for node, delay in everything.items() if delay <= third)}
    heard = found.heard()
    assert heard == pytest.approx(everything), "those that come later are sent and received all the same"
    assert {node: delay for node, delay in found.delays().items() if node} == pytest.approx(
        {node: heard[node] for node in found.arrived if node}
    )


@pytest.mark.parametrize("mac", MACS.values(), ids=MACS)
def test_what_comes_after_the_deadline_is_paid_for_all_the_same(mac) -> None:
    spent = []
    for deadline in (None, 1e-3):
        found = Gathering(RadioNetwork(STAR, mac=mac), [1, 2, 3, 4, 5], deadline)
        found.net.env.run()
        spent.append(found.net.nodes.ledger.joules.copy())
        assert found.net.ledger_adds_up()
    assert np.array_equal(*spent) and spent[0].sum() > 0.0


@pytest.mark.parametrize("mac", MACS.values(), ids=MACS)
def test_a_head_that_gets_everything_before_the_deadline_does_not_wait_for_it(mac) -> None:
    patient = Gathering(RadioNetwork(STAR, mac=mac), [1, 2, 3, 4, 5], deadline=10.0)
    as_ever = Gathering(RadioNetwork(STAR, mac=mac), [1, 2, 3, 4, 5])
    assert patient.took == as_ever.took < 1.0
    assert patient.delays() == as_ever.delays()


@pytest.mark.parametrize("mac", [Csma(), Tdma()], ids=["csma", "slots"])
def test_with_a_deadline_of_0_the_head_has_its_own_parcel_alone(mac) -> None:
    found = Gathering(RadioNetwork(STAR, mac=mac), [0, 1, 2], deadline=0.0)
    assert (found.arrived, found.took) == ([0], 0.0)
    assert Gathering(RadioNetwork(STAR, mac=mac), [0], deadline=1.0).arrived == [0]
    assert Gathering(RadioNetwork(STAR, mac=mac), [], deadline=1.0).arrived == []


@pytest.mark.parametrize("one_hop", [True, False])
def test_on_an_ideal_radio_everything_arrives_within_the_instant_over_several_hops_too(one_hop) -> None:
    net = RadioNetwork(ROW, mac=IdealMac(), weight="hop")
    found = Gathering(net, [0, 1, 2, 3], deadline=0.0, one_hop=one_hop)
    assert found.arrived == [0, 1, 2, 3] and found.took == 0.0
    assert [found.journeys.of(node) for node in range(4)] == [(0.0, hops) for hops in range(4)]


def test_on_an_ideal_radio_a_deadline_adds_no_event() -> None:
    events = []
    for deadline in (None, 1.0):
        found = Gathering(RadioNetwork(STAR, mac=IdealMac()), [0, 1, 2], deadline)
        events.append(next(found.net.env._eid))
    assert events[0] == events[1]


@pytest.mark.parametrize("mac", [Csma(), IdealMac(rate=250e3)], ids=["csma", "ideal with a rate"])
def test_over_several_hops_a_parcel_has_arrived_once_its_last_hop_has(mac) -> None:
    found = Gathering(RadioNetwork(ROW, mac=mac, weight="hop"), [0, 1, 2, 3], one_hop=False)
    delays = found.delays()
    assert [found.journeys.of(node)[1] for node in range(4)] == [0, 1, 2, 3]
    heard = [row["time"] for row in found.net.rows("receive") if row["node"] == 0 and row["packets"]]
    assert sorted(delays.values())[1:] == pytest.approx(sorted(heard), rel=1e-12)
    nearest = Gathering(RadioNetwork(ROW, mac=mac, weight="hop"), [0, 1, 2, 3], delays[1] + 1e-6, one_hop=False)
    assert {*nearest.arrived} == {0, *(node for node, delay in delays.items() if delay <= delays[1] + 1e-6)}
    assert 3 not in nearest.arrived


@pytest.mark.parametrize("bits", [PACKET_BITS, 900], ids=["one a frame", "two frames a packet"])
def test_of_a_long_parcel_the_head_has_the_packets_that_came_before_the_deadline(bits) -> None:
    def sent(deadline):
        net, whole = RadioNetwork(STAR[:2], mac=Csma()), []
        collection = Collection(net.env, net.transport, 0, 0, None, True)

        def head():
            whole.append((yield from collection.gather([1], [Parcel("long", 4, bits, "long")], deadline)))

        net.env.run(until=net.env.process(head()))
        net.env.run()
        times = [row["time"] for row in net.rows("receive") if row["node"] == 0 and row["packets"]]
        return whole[0], times

    (masks, journeys), times = sent(None)
    frames = len(times) // 4
    assert masks[0].tolist() == [True] * 4 and journeys.of(1)[0] == pytest.approx(times[-1])
    (masks, journeys), again = sent(times[3 * frames - 1] + 1e-6)
    assert masks[0].tolist() == [True] * 3 + [False] and again == times
    assert journeys.of(1)[0] == pytest.approx(times[3 * frames - 1]), "that of the last packet that arrived"


def test_a_parcel_whose_acknowledgement_is_lost_has_arrived_when_it_was_first_received() -> None:
    net = RadioNetwork(STAR[:2], mac=Csma(), link=Disk(reach=75.0, loss=0.5), seed=3)
    again = 0
    for _ in range(30):
        found = Gathering(net, [1])
        heard = found.heard()
        assert found.delays() == pytest.approx(heard, rel=1e-9)
        again += bool(heard) and found.took > heard[1] + 2e-3
    assert again > 3, "some acknowledgements are lost, and the head waits for the end of the exchange"


def test_a_member_that_dies_before_its_slot_sends_nothing_and_the_head_goes_on_at_the_deadline() -> None:
    for deadline in (None, 0.05):
        net = RadioNetwork(STAR, mac=Tdma())
        Gathering(net, [1, 2, 3, 4, 5])
        net.env.run()
        slot = Tdma().slot_needed(8 * 29)
        net.at(net.env.now + 1.5 * slot, lambda net=net: net.nodes.spend(4, 0, 10.0))
        found = Gathering(net, [1, 2, 3, 4, 5], deadline)
        assert net.died and found.arrived == [1, 2, 3, 5]


@pytest.mark.parametrize(
    ("window", "deadline", "took"),
    [((0.02, 0.03), 0.01, 0.01), ((0.02, 0.03), 0.5, 0.03), ((0.004, 0.03), 0.02, None), ((0.004, 0.03), 0.0, 0.0)],
)
def test_a_head_with_a_window_goes_on_at_the_earlier_of_both(window, deadline, took) -> None:
    found = Gathering(RadioNetwork(STAR, mac=Csma()), [0, 1, 2, 3, 4, 5], deadline, window=window)
    as_ever = Gathering(RadioNetwork(STAR, mac=Csma()), [0, 1, 2, 3, 4, 5], window=window)
    assert found.took == pytest.approx(as_ever.took if took is None else took, abs=1e-9)
    heard = found.heard()
    assert {*found.arrived} == {0, *(node for node, delay in heard.items() if delay <= found.took)}


@part
class AtTheEnd(Csma):
    """A MAC of somebody else, which reports what arrived when the last burst has ended, and nothing before."""

    mechanism = "at_the_end"

    def start(self, services):
        return Ends(services)


class Ends:
    def __init__(self, services):
        self.services = services

    def send(self, bursts, head=None):
        signal = self.services.signal()
        self.services.call_later(0.02, signal.succeed)
        return signal

    def offer(self, node, payload_bits, done, code=0):
        done(None)

    def silence(self, node):
        pass


@pytest.mark.parametrize(("deadline", "arrived"), [(None, [1, 2]), (0.021, [1, 2]), (0.019, [])])
def test_with_a_mac_that_does_not_say_when_packets_arrive_they_arrive_at_the_end(deadline, arrived) -> None:
    found = Gathering(RadioNetwork(STAR, mac=AtTheEnd()), [1, 2], deadline)
    assert found.arrived == arrived
    assert found.delays() == pytest.approx(dict.fromkeys(arrived, 0.02))


class Hasty(Centroid):
    """A centroid tracker that goes on after a deadline; `request` makes its request."""

    def __init__(self, request: Any) -> None:
        super().__init__()
        self.request = request

    def step(self, belief: Any, scene: Any) -> Iterator[Any]:
        self.scenes.append(scene)
        try:
            self.answers.append((yield self.request()))
        except GeneratorExit:
            self.closed += 1
            raise
        return belief


NODES = [(0.0, 0.0), (30.0, 0.0), (0.0, 40.0)]
REQUESTS = {
    "parcels": lambda deadline: lambda: Gather(reading_of, deadline=deadline),
    "readings": lambda deadline: lambda: GatherReadings(deadline=deadline),
}


def followed(request: Any, steps: int = 3, nodes: Any = NODES, **changes: Any) -> tuple[Hasty, Run]:
    tracker = Hasty(request)
    return tracker, Run(network_setup(steps=steps, tracker=tracker, **changes), nodes, [standing((5.0, 5.0), steps)])


def pairs(answer: Any, values: Any) -> dict[int, Any]:
    return values if isinstance(values, dict) else dict(zip(answer.ids, values.tolist(), strict=True))


@pytest.mark.parametrize("form", REQUESTS)
@pytest.mark.parametrize("deadline", [None, 0.0, 1.0])
def test_a_tracker_is_told_delays_and_hops_on_an_ideal_radio(form, deadline) -> None:
    tracker, _ = followed(REQUESTS[form](deadline))
    assert len(tracker.answers) == 3
    for answer in tracker.answers:
        assert pairs(answer, answer.delays) == {0: 0.0, 1: 0.0, 2: 0.0}
        assert pairs(answer, answer.hops) == {0: 0, 1: 1, 2: 1}


@pytest.mark.parametrize("form", REQUESTS)
@pytest.mark.parametrize("mac", [IdealMac(), Csma()], ids=["ideal", "csma"])
def test_in_an_open_cluster_the_hops_are_those_of_the_path(form, mac) -> None:
    tracker, run = followed(
        REQUESTS[form](None), nodes=ROW, clusters=Central(), routing=MinimumHop(), mac=mac, link=Disk(reach=61.0),
        sensor=AcousticEnergy(reach=500.0), filter_sensor=AcousticEnergy(reach=500.0),
    )  # fmt: skip
    for answer in tracker.answers:
        assert pairs(answer, answer.hops) == {0: 0, 1: 1, 2: 2, 3: 3}
    assert len(run.events("relay", "reading")) >= 3 * len(tracker.answers)


@pytest.mark.parametrize("form", REQUESTS)
def test_readings_that_miss_the_deadline_are_not_counted_as_used(form) -> None:
    tracker, run = followed(REQUESTS[form](0.0), mac=Csma())
    assert [len(pairs(answer, answer.delays)) for answer in tracker.answers] == [1, 1, 1]
    assert run.memory.table("estimates")["readings"].tolist() == [1, 1, 1]
    assert len(run.events("receive", "reading")) == 6, "they arrive, too late"


@pytest.mark.parametrize("form", REQUESTS)
def test_a_head_that_dies_before_the_deadline_loses_its_belief_and_the_flow_is_closed(form) -> None:
    crash = Crash(at=0.081, nodes=(0,))  # 1 ms after the request of step 2, when no reading has arrived yet
    tracker, run = followed(REQUESTS[form](0.03), mac=Csma(), faults=(crash,))
    (lost,) = run.events("lost", "head_died")
    assert lost["time"] == pytest.approx(0.081)
    assert tracker.closed == 1 and len(tracker.answers) == len(tracker.scenes) - 1


@pytest.mark.parametrize(
    "request_of", [lambda bad: Gather(reading_of, deadline=bad), lambda bad: GatherReadings(deadline=bad)]
)
@pytest.mark.parametrize("bad", [-1e-9, float("nan")])
def test_a_deadline_that_is_no_time_is_refused(request_of, bad) -> None:
    with pytest.raises(RunError, match=r"requested the deadline .*: it must be a number of seconds, 0 or more"):
        request_of(bad)
