"""X-MAC and ContikiMAC among drifting clocks, schedules, crashes, deaths, capture, and nodes told to hurry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.network.low_power import CC2420, IN_IDLE, LISTEN, PAIR, PROCESSOR, joules, low_power, phases, spent
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.energy import FirstOrder, States
from wsnsim.models.hardware import DriftingClock, Frames, NoPacking, PerfectClock
from wsnsim.models.links import Disk, LogNormal
from wsnsim.models.low_power_listening import ContikiMac, XMac
from wsnsim.models.sleep import DutyCycle, EventWake, RandomIndependent

BOTH = pytest.mark.parametrize("kind", [XMac, ContikiMac])
INTERVAL = 0.125


def payload(packets=1):
    return Parcel("payload", packets, PACKET_BITS, "test")


def radios_off(network):
    """Whether no radio is held on."""
    return not network.mac._radios._reasons and not any(
        map(network.nodes.consumption.levels.is_held, range(network.nodes.size))
    )


@BOTH
def test_several_frames_for_one_destination_need_one_train(kind):
    one, five = low_power(kind()), low_power(kind())
    assert one.unicast(0, 1).packets == 1 and five.unicast(0, 1, packets=5).packets == 5
    more = five.counters.transmissions - one.counters.transmissions
    assert more in (8, 9, 10, 11, 12), "four frames and their acknowledgements, and a copy now and then"
    five.env.run(until=five.env.now + 0.1)
    assert radios_off(five)


@BOTH
def test_a_sender_listens_when_its_radio_can_have_started(kind):
    """A CC2420 stops and starts in 1.1 ms from power-down, and in 0.24 ms from idle mode."""
    network = low_power(kind(first_backoff=0.0))
    held, hold = [], network.mac._radios.hold
    network.mac._radios.hold = lambda *given: held.append(network.env.now) or hold(*given)
    network.env.run(until=1.0)
    network.unicast(0, 1)
    assert held[0] - 1.0 == pytest.approx(1.104e-3 if kind is XMac else 0.244e-3)


@BOTH
def test_wake_ups_keep_to_the_clocks_of_their_nodes(kind):
    """After 500 s a clock that runs 1 % fast has woken its node five more seconds' worth of times."""
    network = low_power(kind(first_backoff=0.0), clock=DriftingClock(sd=0.01))
    rates = network.clocks.rate(0), network.clocks.rate(1)
    assert rates[1] != 1.0
    network.env.run(until=500.0)
    burst = network.unicast(0, 1)
    on_clock = (burst.heard_at * rates[1] - phases(network)[1]) % INTERVAL
    assert burst.packets == 1 and on_clock < 8e-3, "it was heard within an exchange after a wake-up"


@BOTH
def test_a_node_that_sleeps_by_its_schedule_neither_wakes_for_strobes_nor_pays_for_wake_ups(kind):
    schedule = DutyCycle(period=4.0, awake_share=0.25, phases="synchronous")
    network = low_power(kind(max_retries=0), sleep=schedule, horizon=4.0)
    results = []

    def send():
        burst = full_burst(0, 1, payload(), 0)
        network.mac.send([burst]).callbacks.append(lambda _: results.append((network.env.now, burst.packets)))

    network.at(0.5, send)
    network.at(2.0, send)
    network.env.run(until=4.0)
    assert [packets for _, packets in results] == [1, 0], "it slept at the second one, and its sender was held awake"
    assert all(row["time"] < 1.0 for row in network.rows("receive") if row["node"] == 1)
    quiet, _ = spent(kind(), 4.0, sleep=schedule)
    (duty,) = kind().duties
    assert joules(quiet, "idle", 1) == pytest.approx(1.0 * duty.on / duty.interval * LISTEN + 163.5e-6, rel=1e-6)


@BOTH
def test_a_sender_that_crashes_in_its_train_ends_its_bursts_and_frees_who_waits(kind):
    network = low_power(kind(first_backoff=0.0), [*PAIR, (20, 20)])
    bursts = [full_burst(0, to, payload(2), 0) for to in (EVERYONE, 1)]
    ended = network.mac.send(bursts)

    def crash():
        network.nodes.crash(0)
        network.mac.silence(0)

    network.at(0.07, crash)
    network.env.run(until=ended)
    assert network.env.now == pytest.approx(0.07) and bursts[1].packets == 0
    network.env.run(until=1.0)
    assert radios_off(network)
    network.nodes.restart(0, network.env.now)
    assert network.unicast(0, 1).packets == 1
    assert network.unicast(1, 0).packets == 1


@BOTH
def test_a_receiver_that_crashes_in_an_exchange_is_tried_again_until_it_is_given_up(kind):
    network = low_power(kind(first_backoff=0.0, max_retries=1), PAIR)
    original = network.mac.channel.transmit

    def crash_when_answering(source, frame, on_end, asleep=None):
        sent = original(source, frame, on_end, asleep)
        if source == 1 and network.nodes.alive[1]:
            network.at(network.env.now + 3e-4, lambda: (network.nodes.crash(1), network.mac.silence(1)))
        return sent

    network.mac.channel.transmit = crash_when_answering
    burst = network.unicast(0, 1)
    assert network.counters.retries == 1 and not network.nodes.alive[1]
    assert burst.packets == (1 if kind is ContikiMac else 0), "a copy is the frame; a strobe is not"
    network.env.run(until=network.env.now + 1.0)
    assert radios_off(network)


@BOTH
def test_nodes_that_are_told_to_hurry_wake_more_often_for_a_while(kind):
    mac = kind(interval=1.0, near=0.125, first_backoff=0.0)
    network, _ = spent(mac, 8.0, lambda network: network.at(1.0, lambda: network.mac.use_short_interval([1], 5.0)))
    long, short = mac.duties
    expected = (4.0 * long.on / long.interval + 4.0 * short.on / short.interval) * LISTEN
    assert joules(network, "idle", 1) == pytest.approx(expected, rel=1e-9)
    assert joules(network, "idle", 0) == pytest.approx(8.0 * long.on / long.interval * LISTEN, rel=1e-9)


@pytest.mark.thorough
@BOTH
def test_a_unicast_to_a_node_that_hurries_takes_half_its_short_interval(kind):
    mac = kind(interval=1.0, near=0.125, first_backoff=0.0, **({} if kind is XMac else {"phase_lock": False}))
    for hurry, least, most, longest in ((False, 0.35, 0.65, 1.02), (True, 0.05, 0.09, 0.14)):
        network, latencies = low_power(mac), []
        for i in range(8):
            network.env.run(until=3.0 * i + 1.0 + i / 8.0 if not hurry else 3.0 * i + 1.0 + i / 64.0)
            if hurry:
                network.mac.use_short_interval([1], network.env.now + 2.0)
            begin, burst = network.env.now, network.unicast(0, 1)
            latencies.append(burst.heard_at - begin)
        assert least < np.mean(latencies) < most and max(latencies) < longest


@BOTH
def test_a_told_node_wakes_at_the_instants_of_the_long_interval_too(kind):
    network = low_power(kind(interval=1.0, near=0.25))
    ids = np.array([0, 1])
    times = phases(network)[1] + np.arange(5.0) + 1e-6
    for hurried in (False, True):
        if hurried:
            network.mac.use_short_interval([1], 10.0)
        assert all(network.mac._radios.offsets(ids, time)[0][1] < 1e-5 for time in times)


@BOTH
def test_neighbours_that_broadcast_at_once_are_heard_one_after_the_other(kind):
    network = low_power(kind(), [(0, 0), (30, 0), (0, 30), (20, 20)])
    bursts = [full_burst(node, EVERYONE, payload(), 0) for node in (0, 1, 2)]
    network.env.run(until=network.mac.send(bursts))
    heard = sum(len(burst.received) for burst in bursts)
    assert heard == 9 and network.counters.access_failures == 0


SCHEDULES = st.sampled_from([EventWake(), RandomIndependent(period=0.7, probability=0.5)])
BATTERIES = st.sampled_from([1e4, 5e-3, 2e-2, 5e-4])
LINKS = st.sampled_from([
    Disk(reach=75.0), LogNormal(), LogNormal(interference="sinr"),
])  # fmt: skip
ENERGIES = st.sampled_from(["states", "first_order"])


@pytest.mark.thorough
@settings(max_examples=6)
@given(
    st.sampled_from([XMac, ContikiMac]), st.integers(0, 10_000), SCHEDULES, BATTERIES, LINKS, ENERGIES,
    st.sampled_from([PerfectClock(), DriftingClock(sd=1e-3)]), st.sampled_from([NoPacking(), Frames()]),
)  # fmt: skip
def test_whatever_happens_bursts_end_ledgers_add_up_and_radios_are_turned_off(
    kind, seed, schedule, battery, link, energy, clock, packing
):
    draw = np.random.default_rng(seed)
    model = FirstOrder(battery=battery / 10, idle=0.06, sleep=1e-4, switch=1e-6)
    if energy == "states":
        model = States(radio=CC2420 if kind is XMac else IN_IDLE, processor=PROCESSOR, battery=battery)
    mac = kind(interval=float(draw.choice([0.05, 0.125])), near=0.025 if draw.random() < 0.3 else None)
    mac = mac if mac.near is None else kind(interval=0.05, near=0.025)
    network = low_power(mac, draw.uniform(0, 90, (7, 2)), energy=model, link=link, sleep=schedule, clock=clock,
                        packing=packing, seed=seed, horizon=4.0)  # fmt: skip
    unended = []

    def send():
        node = int(draw.integers(7))
        to = int(draw.choice([EVERYONE, *(set(range(7)) - {node})]))
        burst = full_burst(node, to, payload(int(draw.integers(1, 4))), 0)
        unended.append(burst)
        network.mac.send([burst]).callbacks.append(lambda _: unended.remove(burst))

    def fault():
        node = int(draw.integers(7))
        if network.nodes.alive[node]:
            network.nodes.crash(node)
            network.mac.silence(node)
        else:
            network.nodes.restart(node, network.env.now)

    for time in draw.uniform(0, 2, 25):
        network.at(time, send)
    for time in draw.uniform(0, 2, 5):
        network.at(time, fault)
    network.at(1.0, lambda: network.mac.use_short_interval(np.flatnonzero(network.nodes.living).tolist(), 1.5))
    network.env.run(until=20.0)
    assert not unended and radios_off(network)
    network.nodes.close()
    assert network.ledger_adds_up()
    assert (network.nodes.ledger.spent <= network.nodes.battery * (1 + 1e-12)).all()
