"""X-MAC: closed forms of idle power, latency, strobes and energy; who hears strobes, and what they do then."""

from math import floor

import numpy as np
import pytest

from tests.network.low_power import (
    ACK,
    IDLE_PROCESSOR,
    LISTEN,
    OFF_TIME,
    PAIR,
    SEND,
    SLEEP,
    START,
    START_TIME,
    STOP,
    STOP_TIME,
    SWITCHING,
    TURNAROUND,
    joules,
    low_power,
    phases,
    spent,
)
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.low_power_listening import XMac
from wsnsim.models.sleep import DutyCycle

STROBE, GAP = 17 * 8 / 250e3, 864e-6 + TURNAROUND
PERIOD, WINDOW = STROBE + GAP, 2 * STROBE + GAP
DATA, SPACING, ASSESSMENT = 29 * 8 / 250e3, 640e-6, GAP + 128e-6
INTERVAL = 0.125
AT_ONCE = XMac(interval=INTERVAL, first_backoff=0.0)


def mean_strobes_before(interval):
    """The mean number of strobes before the one that is heard, if a train begins at a random phase.

    A train that begins in the first PERIOD of a window is heard at once. Otherwise the next window begins after u,
    uniform between 0 and interval - PERIOD, and the strobe is heard that begins at or after it: ceil(u / PERIOD).
    """
    periods = (interval - PERIOD) / PERIOD
    whole = floor(periods)
    return PERIOD / interval * (whole * (whole + 1) / 2 + (periods - whole) * (whole + 1))


def strobes_before(phase, begin, interval=INTERVAL):
    """How many strobes precede the one that is heard, if a train begins at a time; `phase`: of the destination."""
    until_window = (phase - begin) % interval
    return 0 if until_window > interval - PERIOD else int(np.ceil(until_window / PERIOD))


def strobes_of(network, node=0):
    code = network.log.code("strobe")
    return sum(row["what"] == code and row["node"] == node for row in network.rows("send"))


def test_the_idle_power_is_that_of_one_window_an_interval():
    network, _ = spent(XMac(interval=INTERVAL), 100.0, positions=[(0, 0), (50, 0), (90, 0)])
    share, windows = WINDOW / INTERVAL, 100.0 / INTERVAL
    for node in range(3):
        assert joules(network, "idle", node) == pytest.approx(100.0 * share * LISTEN, rel=1e-9)
        assert joules(network, "switch", node) == pytest.approx(windows * (START + STOP), rel=1e-9)
        off = 100.0 - windows * (WINDOW + START_TIME + STOP_TIME)
        assert joules(network, "sleep", node) == pytest.approx(off * SLEEP + 100.0 * IDLE_PROCESSOR, rel=1e-9)


@pytest.mark.thorough
def test_a_unicast_takes_half_an_interval_on_average_and_the_exchange():
    """At each of evenly spread phases it takes exactly what they say; and their mean is the closed form."""
    network = low_power(AT_ONCE)
    phase, count = phases(network)[1], 48
    exchange = STROBE + (TURNAROUND + ACK) + TURNAROUND + DATA
    for i in range(count):
        begin, before = (3 * i + 1 + (i + 0.5) / count) * INTERVAL, network.counters.transmissions
        network.env.run(until=begin)
        burst = network.unicast(0, 1)
        first = begin + OFF_TIME + ASSESSMENT + TURNAROUND
        expected = strobes_before(phase, first)
        assert network.counters.transmissions - before == expected + 1 + 3, "and two acknowledgements, and the data"
        assert burst.heard_at == pytest.approx(first + expected * PERIOD + exchange, abs=1e-9)
    mean = np.mean([strobes_before(phase, begin) for begin in np.linspace(0.0, INTERVAL, 100_000)])
    assert mean == pytest.approx(mean_strobes_before(INTERVAL), rel=1e-3)
    assert mean * PERIOD == pytest.approx((INTERVAL - PERIOD) / 2, rel=0.01), "half an interval, but for half a period"


def test_nobody_answers_all_strobes_of_a_train_and_it_is_tried_again():
    network = low_power(XMac(interval=INTERVAL, max_retries=1))
    network.nodes.crash(1)
    burst = network.unicast(0, 1)
    assert burst.packets == 0 and network.counters.retries == 1
    assert strobes_of(network) == 2 * (floor(INTERVAL / PERIOD) + 2)


def test_a_broadcast_has_strobes_for_a_whole_interval_and_then_one_frame():
    network = low_power(AT_ONCE, [*PAIR, (0, 60), (20, 20)])
    burst = network.broadcast(0)
    assert set(burst.received) == {1, 2, 3}
    assert strobes_of(network) == floor(INTERVAL / PERIOD) + 2
    frames = [row for row in network.rows("send") if row["packets"]]
    assert len(frames) == 1 and network.counters.frames_sent == 1 and network.counters.delivered == 3
    longest = OFF_TIME + AT_ONCE.latency(96).broadcast
    assert network.env.now == pytest.approx(longest, abs=1e-9), "the radio starts, and it takes as long as it may"


def test_the_energy_of_a_unicast_is_what_its_exchange_says():
    """The sender is on from its assessment to the spacing at the end, the receiver from a strobe to its linger."""
    seconds = 2.0
    network, burst = spent(AT_ONCE, seconds, lambda network: network.unicast(0, 1))
    count = strobes_of(network)
    quiet, _ = spent(AT_ONCE, seconds)
    sent = count * STROBE + DATA
    on = ASSESSMENT + count * PERIOD - GAP + TURNAROUND + (TURNAROUND + ACK) + (TURNAROUND + DATA)
    on += TURNAROUND + ACK + SPACING
    woken = sum(0 <= phases(network)[0] + i * INTERVAL <= on for i in range(16))
    extra = {cause: joules(network, cause, 0) - joules(quiet, cause, 0) for cause in ("idle", "switch", "rx", "sleep")}
    turns = 2 * (count + 1) * TURNAROUND
    assert burst.packets == 1
    assert joules(network, "tx_electronics", 0) == pytest.approx(sent * SEND, rel=1e-9)
    assert extra["rx"] == pytest.approx(2 * ACK * LISTEN, rel=1e-9)
    assert extra["switch"] == pytest.approx(START + STOP + turns * SWITCHING - woken * (START + STOP), rel=0.01)
    assert extra["idle"] == pytest.approx((on - sent - 2 * ACK - turns - woken * WINDOW) * LISTEN, rel=0.01)
    switched = joules(network, "switch", 1) - joules(quiet, "switch", 1)
    assert switched == pytest.approx(4 * TURNAROUND * SWITCHING, rel=1e-9), "it was on already when it was woken"
    total = sum(joules(network, cause, 1) - joules(quiet, cause, 1) for cause in ("idle", "rx", "tx_electronics"))
    heard = GAP - 864e-6 + ACK + TURNAROUND + DATA + 10e-3
    assert total == pytest.approx(expected_receiver(network, heard), rel=0.01)


def expected_receiver(network, heard):
    """Joules of the receiver beyond its windows: the last strobe ended one window early, then it was on."""
    last = max(row["time"] for row in network.rows("receive") if row["node"] == 1 and row["packets"] == 0)
    begin = last - (last - phases(network)[1]) % INTERVAL
    left = begin + WINDOW - last
    lost = 2 * 2 * TURNAROUND * LISTEN
    return (heard - left) * LISTEN - 2 * ACK * (LISTEN - SEND) - lost


def test_a_sender_that_hears_strobes_to_its_own_destination_sends_its_data_without_strobes():
    network = low_power(AT_ONCE, [*PAIR, (25, 25)])
    first = full_burst(0, 1, Parcel("payload", 1, PACKET_BITS, "test"), 0)
    second = full_burst(2, 1, Parcel("payload", 1, PACKET_BITS, "test"), 0)
    phase = phases(network)[1]
    begin = phase + 2 * INTERVAL - 0.06
    ends = []
    network.at(begin, lambda: ends.append(network.mac.send([first])))
    network.at(begin + 0.01, lambda: ends.append(network.mac.send([second])))
    network.env.run(until=begin + 0.2)
    assert first.packets == second.packets == 1 and all(end.processed for end in ends)
    assert strobes_of(network, 0) > 30 and strobes_of(network, 2) == 0
    assert second.heard_at - first.heard_at < AT_ONCE.linger and network.counters.retries == 0


def test_a_sender_that_hears_strobes_to_somebody_else_waits_with_its_radio_off():
    network = low_power(AT_ONCE, [*PAIR, (25, 25), (25, -25)])
    phase = phases(network)[1]
    begin = phase + 2 * INTERVAL - 0.06
    bursts = [full_burst(node, to, Parcel("payload", 1, PACKET_BITS, "test"), 0) for node, to in ((0, 1), (2, 3))]
    for late, burst in zip((0.0, 0.01), bursts, strict=True):
        network.at(begin + late, lambda burst=burst: network.mac.send([burst]))
    network.env.run(until=begin + 0.01 + OFF_TIME + ASSESSMENT + WINDOW + 1e-6)
    assert not network.mac._radios.is_held(2) and strobes_of(network, 2) == 0
    network.env.run(until=begin + 2.0)
    assert bursts[0].packets == bursts[1].packets == 1 and bursts[1].heard_at > bursts[0].heard_at


def test_who_hears_a_strobe_for_somebody_else_sleeps_on():
    """The third node hears one strobe a window and pays for it; the rest of its window is saved."""
    places = [*PAIR, (25, 25)]
    network, _ = spent(AT_ONCE, 1.0, lambda network: network.unicast(0, 1), positions=places)
    quiet, _ = spent(AT_ONCE, 1.0, positions=places)
    strobes = [row for row in network.rows("overhear") if row["node"] == 2 and row["bits"] == 8 * 17]
    assert len(strobes) <= 1
    saved = joules(quiet, "idle", 2) - joules(network, "idle", 2)
    heard = joules(network, "overhear", 2)
    assert heard == pytest.approx(len(strobes) * STROBE * LISTEN) and saved >= heard - 1e-12
    assert saved <= WINDOW * LISTEN + 1e-12


def test_what_is_on_the_air_out_of_range_does_not_keep_a_window_open():
    places = [*PAIR, (0, 40), (135, 0), (185, 0)]

    def send(*pairs):
        def act(network):
            return network.mac.send([
                full_burst(a, b, Parcel("payload", 1, PACKET_BITS, "test"), 0) for a, b in pairs
            ])  # fmt: skip

        return act

    alone, _ = spent(AT_ONCE, 1.0, send((0, 1)), positions=places)
    both, _ = spent(AT_ONCE, 1.0, send((0, 1), (3, 4)), positions=places)
    for cause in ("idle", "overhear"):
        assert joules(both, cause, 2) == pytest.approx(joules(alone, cause, 2), rel=1e-12)
    assert strobes_of(both, 3) > 0


def broadcast_until(network, time, act):
    """Broadcast from node 0, and do something at a time."""
    burst = full_burst(0, EVERYONE, Parcel("payload", 1, PACKET_BITS, "test"), 0)
    network.mac.send([burst])
    network.at(time, lambda: act(network))
    return burst


def test_receivers_turn_the_radio_on_for_a_broadcast_although_its_sender_has_died():
    def crash(network):
        network.nodes.crash(0)
        network.mac.silence(0)

    network = low_power(AT_ONCE)
    broadcast_until(network, INTERVAL - 1e-3, crash)
    network.env.run(until=OFF_TIME + AT_ONCE.latency(96).broadcast - 1e-3)
    assert network.mac._radios.is_held(1)
    network.env.run(until=INTERVAL + 0.05)
    assert not network.mac._radios.is_held(1) and not network.rows("receive")[-1]["packets"]


@pytest.mark.parametrize(("strobes", "stays"), [(1, True), (2, False)])
def test_a_receiver_turns_off_for_a_broadcast_only_if_it_can_be_on_again_in_time(strobes, stays):
    """After the last strobe a broadcast begins in 0.86 ms; a CC2420 needs 1.1 ms to turn off and on from power-down."""
    network = low_power(AT_ONCE)
    train = OFF_TIME + ASSESSMENT + TURNAROUND + (AT_ONCE.strobes - 1 - strobes) * PERIOD
    network.mac._radios._phases[1] = (train + PERIOD / 2) % INTERVAL

    def forget(network):
        network.nodes.crash(1)
        network.mac.silence(1)
        network.nodes.restart(1, network.env.now)

    broadcast_until(network, 0.05, forget)  # the strobe that it has heard in its window before
    heard = train + PERIOD + STROBE
    network.env.run(until=heard + 1e-5)
    assert network.mac._radios.is_held(1) == stays
    network.env.run(until=heard + 0.1)
    assert any(row["packets"] for row in network.rows("receive"))


def test_a_receiver_that_crashed_has_forgotten_that_a_broadcast_follows():
    def crash_and_restart(network):
        network.nodes.crash(1)
        network.mac.silence(1)
        network.nodes.restart(1, network.env.now)

    network = low_power(AT_ONCE)
    network.mac._radios._phases[1] = 0.03
    burst = broadcast_until(network, 0.1, crash_and_restart)
    network.env.run(until=INTERVAL + 0.02)
    assert burst.received == {}, "it heard a strobe at 0.03 s, and next wakes at 0.155 s"


def test_a_node_that_falls_asleep_before_a_broadcast_follows_is_not_woken_by_it():
    schedule = DutyCycle(period=4.0, awake_share=0.25, phases="synchronous")
    network = low_power(AT_ONCE, [*PAIR, (0, 40)], sleep=schedule)
    network.nodes.keep_awake(2)
    network.mac._radios._phases[:] = 0.05
    network.env.run(until=0.91)
    burst = network.broadcast(0)
    heard = {row["node"] for row in network.rows("receive")}
    assert 1.0 < network.env.now < 1.1 and heard == {1, 2} and set(burst.received) == {2}
