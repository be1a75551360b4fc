"""ContikiMAC: closed forms of idle power, latency, copies and energy; phase lock, fast sleep, broadcasts."""

from math import floor

import numpy as np
import pytest

from tests.network.low_power import (
    ACK,
    IDLE_PROCESSOR,
    IN_IDLE,
    LISTEN,
    PAIR,
    SEND,
    STOP,
    STOP_TIME,
    TURNAROUND,
    joules,
    low_power,
    phases,
    spent,
)
from wsnsim.base.frames import EVERYONE, full_burst
from wsnsim.base.requests import Parcel
from wsnsim.models.low_power_listening import ContikiMac

T_R, T_C, T_I = 192e-6, 500e-6, 400e-6
FRAME = 29 * 8 / 250e3
SLEEP, START_TIME, START = IN_IDLE.sleep, IN_IDLE.wake, IN_IDLE.wake * IN_IDLE.wake_power
OFF_TIME = START_TIME + STOP_TIME
"""A sender listens at the earliest when its radio has stopped and started."""
PERIOD, ASSESSMENT, INTERVAL, SPACING = FRAME + T_I, T_C + 2 * T_R, 0.125, 640e-6
UNLOCKED = ContikiMac(first_backoff=0.0, phase_lock=False)
LOCKED = ContikiMac(first_backoff=0.0)


def copies_of(network, node=0):
    return sum(row["node"] == node and row["packets"] > 0 for row in network.rows("send"))


def woken_at(phase, first, interval=INTERVAL):
    """When an assessment of a node first hears a train that begins at a time, and which copy it hears whole.

    It is the one during which the assessment ends if it began before that copy, otherwise the next one.
    """
    turn = floor((first - phase) / interval)
    ends = (T_R, 2 * T_R + T_C)
    for time in sorted(phase + (turn + more) * interval + end for more in range(3) for end in ends):
        if time < first:
            continue
        copy, into = divmod(time - first, PERIOD)
        if into < FRAME:
            return time, int(copy) + (into > T_R)
    raise AssertionError("every train is heard")


def test_the_idle_power_is_that_of_two_assessments_an_interval():
    """0.31 % of the time for two assessments of 192 µs at 8 Hz."""
    network, _ = spent(ContikiMac(), 100.0, positions=[(0, 0), (50, 0), (90, 0)])
    checks = 2 * 100.0 / INTERVAL
    for node in range(3):
        assert joules(network, "idle", node) == pytest.approx(checks * T_R * LISTEN, rel=1e-9)
        assert joules(network, "switch", node) == pytest.approx(checks * (START + STOP), rel=1e-9)
        off = 100.0 - checks * (T_R + START_TIME + STOP_TIME)
        assert joules(network, "sleep", node) == pytest.approx(off * SLEEP + 100.0 * IDLE_PROCESSOR, rel=1e-9)
    assert checks * T_R / 100.0 == pytest.approx(0.0031, abs=5e-5)


@pytest.mark.thorough
def test_a_unicast_without_phase_lock_takes_half_an_interval_and_the_next_copy():
    network = low_power(UNLOCKED)
    phase, count = phases(network)[1], 48
    for i in range(count):
        begin, before = (3 * i + 1 + (i + 0.5) / count) * INTERVAL, network.counters.transmissions
        network.env.run(until=begin)
        burst = network.unicast(0, 1)
        first = begin + OFF_TIME + ASSESSMENT + TURNAROUND
        _, copy = woken_at(phase, first)
        assert network.counters.transmissions - before == copy + 2, "the first copy that is heard whole is answered"
        assert burst.heard_at == pytest.approx(first + copy * PERIOD + FRAME, abs=1e-9)
    waits = [woken_at(phase, 0.0)[0] for phase in np.linspace(0.0, INTERVAL, 5000)]
    assert np.mean(waits) == pytest.approx(INTERVAL / 2, rel=0.01)
    assert network.counters.frames_sent == network.counters.delivered == count, "all copies of a frame count as one"


@pytest.mark.thorough
def test_with_phase_lock_a_sender_begins_shortly_before_its_destination_wakes():
    """Each unicast takes what the destination's wake-ups say, from when it begins; the mean is the closed form.

    A request at any time waits for half an interval on average. The first copy comes 1.5 guards and a period before the
    copy that was acknowledged last, an interval on; the copy that is acknowledged now is, on average, at its place.
    """
    network, count, guard = low_power(LOCKED), 400, LOCKED.guard
    last = network.unicast(0, 1).heard_at - FRAME
    counts, latencies = [], []
    for i in range(count):
        network.env.run(until=(3 * i + 3 + i / count) * INTERVAL)
        now, before = network.env.now, network.counters.transmissions
        burst = network.unicast(0, 1)
        copies = network.counters.transmissions - before - 1
        first = burst.heard_at - FRAME - (copies - 1) * PERIOD
        assert burst.heard_at == pytest.approx(
            first + woken_at(phases(network)[1], first)[1] * PERIOD + FRAME, abs=1e-9
        )
        expected = last - PERIOD + INTERVAL * np.ceil((first - last) / INTERVAL)
        assert guard - 1e-9 <= expected - first <= 2 * guard + 1e-9, "between two guards and one before it"
        assert now <= first - ASSESSMENT - TURNAROUND + 1e-9 < now + INTERVAL + guard
        counts.append(copies)
        latencies.append(burst.heard_at - now)
        last = burst.heard_at - FRAME
    mean = INTERVAL / 2 + ASSESSMENT + TURNAROUND + 1.5 * guard + PERIOD + FRAME
    assert np.mean(latencies) == pytest.approx(mean, rel=0.01)
    assert np.mean(counts) == pytest.approx(1.5 * guard / PERIOD + 2, rel=0.01)
    assert network.counters.retries == 0


def test_a_burst_teaches_a_sender_when_its_first_frame_woke_the_destination():
    """The frames after it are sent to a node that is awake: when they are acknowledged says nothing of its wake-ups."""
    network = low_power(LOCKED)
    assert network.unicast(0, 1, packets=3).packets == 3
    for i in range(6):
        network.env.run(until=network.env.now + 0.6 + 0.013 * i)
        before, begin = network.counters.transmissions, network.env.now
        assert network.unicast(0, 1, packets=3).packets == 3
        assert network.counters.transmissions - before <= 2 * (LOCKED.guard / PERIOD + 2) + 3 + 6
        assert network.env.now - begin < INTERVAL + 0.05
    assert network.counters.retries == 0


def test_a_sender_that_misses_its_destination_forgets_when_it_wakes_and_tries_a_whole_interval():
    network = low_power(LOCKED)
    network.unicast(0, 1)
    network.mac._radios._phases[1] = (phases(network)[1] + INTERVAL / 2) % INTERVAL
    network.env.run(until=network.env.now + 1.0)
    burst = network.unicast(0, 1)
    assert burst.packets == 1 and network.counters.retries == 1
    before = copies_of(network)
    assert network.unicast(0, 1).packets == 1 and copies_of(network) - before < 8, "it knows the new phase"


def test_a_broadcast_is_repeated_for_a_whole_interval_and_delivered_once():
    network = low_power(LOCKED, [*PAIR, (0, 60), (20, 20)])
    burst = network.broadcast(0)
    assert set(burst.received) == {1, 2, 3}
    assert copies_of(network) == floor(INTERVAL / PERIOD) + 2
    assert (network.counters.frames_sent, network.counters.in_range, network.counters.delivered) == (1, 3, 3)
    assert network.env.now < LOCKED.latency(96).broadcast + 1e-3
    heard = [row["node"] for row in network.rows("receive")]
    assert all(1 <= heard.count(node) <= 2 for node in (1, 2, 3)), "who has received it sleeps until the next wake-up"


def test_a_node_that_hears_the_frame_of_somebody_else_sleeps_after_it():
    """The third node wakes, hears the end of one copy and the next one whole, and turns the radio off."""
    network, _ = spent(UNLOCKED, 1.0, lambda network: network.unicast(0, 1), positions=[*PAIR, (25, 30)])
    quiet, _ = spent(UNLOCKED, 1.0, positions=[*PAIR, (25, 30)])
    overheard = joules(network, "overhear", 2)
    assert overheard in (pytest.approx(0.0), pytest.approx(FRAME * LISTEN), pytest.approx(ACK * LISTEN))
    extra = joules(network, "idle", 2) - joules(quiet, "idle", 2)
    assert extra <= (FRAME + T_I + T_R) * LISTEN + 1e-9


def test_the_energy_of_a_unicast_is_what_its_copies_say():
    seconds = 2.0
    network, burst = spent(UNLOCKED, seconds, lambda network: network.unicast(0, 1))
    quiet, _ = spent(UNLOCKED, seconds)
    count = copies_of(network)
    assert burst.packets == 1
    assert joules(network, "tx_electronics", 0) == pytest.approx(count * FRAME * SEND, rel=1e-9)
    assert joules(network, "rx", 0) == pytest.approx(ACK * LISTEN, rel=1e-9)
    on = ASSESSMENT + count * PERIOD - T_I + TURNAROUND + TURNAROUND + ACK + SPACING
    missed = sum(0 <= phases(network)[0] + i * INTERVAL - OFF_TIME <= on for i in range(16))
    idle = on - count * FRAME - ACK - 2 * count * TURNAROUND - 2 * missed * T_R
    extra = joules(network, "idle", 0) - joules(quiet, "idle", 0)
    assert extra == pytest.approx(idle * LISTEN, rel=0.01)
    first = OFF_TIME + ASSESSMENT + TURNAROUND
    wakes, copy = woken_at(phases(network)[1], first)
    assert count == copy + 1
    received = first + (count - 1) * PERIOD + FRAME
    listened = received - wakes - FRAME  # the turnarounds before and after the acknowledgement are switching
    if (wakes - phases(network)[1]) % INTERVAL < 2 * T_R:
        listened -= T_R
    assert joules(network, "rx", 1) == pytest.approx(FRAME * LISTEN, rel=1e-9)
    assert joules(network, "tx_electronics", 1) == pytest.approx(ACK * SEND, rel=1e-9)
    extra = joules(network, "idle", 1) - joules(quiet, "idle", 1)
    assert extra == pytest.approx(listened * LISTEN, rel=0.01)


def test_an_acknowledgement_is_detected_that_is_too_weak_for_the_assessment_of_the_channel():
    network = low_power(UNLOCKED)
    network.topology.neighbours(1).senses[:] = False
    for i in range(4):
        network.env.run(until=1.0 + i)
        assert network.unicast(0, 1).packets == 1
    assert network.counters.retries == 0 and network.counters.collided == 0


def test_a_node_that_two_hidden_senders_wake_is_on_for_no_longer_than_it_pays_for():
    """Long copies of one sender and short ones of the other overlap at the node between them, at any of its phases."""
    places, law = [(0, 0), (60, 0), (-60, 0)], 0.06 * 2 * T_R / INTERVAL
    for phase in np.arange(0.024, 0.03, 0.0004) + OFF_TIME:
        network, released = low_power(UNLOCKED, places, horizon=0.06), []
        for node, bits in ((1, 928), (2, 96)):
            network.mac.send([full_burst(node, EVERYONE, Parcel("payload", 1, bits, "test"), 0)])
        network.mac._radios._phases[:] = (phase, 0.1, 0.1)
        network.mac._radios.on_release = lambda node, network=network, released=released: released.append(
            (node, network.env.now)
        )
        network.env.run(until=0.06)
        network.nodes.close()
        on = max(time for node, time in released if node == 0) - phase
        paid = sum(joules(network, cause, 0) for cause in ("idle", "overhear", "rx")) / LISTEN - law
        assert abs(paid - on) <= 2 * T_R + 1e-6, "but for the assessments themselves, which the duty charges"
