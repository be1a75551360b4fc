"""TSCH parameters: the slot's times by hand, the closed form of idle slots, latencies, and impossible values."""

import pytest

from tests.models.test_access import company, issues
from wsnsim.base.medium_access import hop_latency
from wsnsim.models.hardware import DriftingClock
from wsnsim.models.tsch import HOPPING, Tsch


def test_the_defaults_are_the_timeslot_template_and_the_minimal_configuration():
    mac = Tsch()
    assert (mac.slot, mac.tx_offset, mac.rx_offset, mac.rx_wait) == (10e-3, 2.12e-3, pytest.approx(1.02e-3), 2.2e-3)
    assert (mac.rx_ack_delay, mac.tx_ack_delay, mac.ack_wait) == (0.8e-3, 1e-3, 0.4e-3)
    assert (mac.slotframe, mac.shared_slots, mac.max_retries) == (101, (0,), 3)
    assert sorted(mac.channels) == list(range(11, 27)) and mac.channels is HOPPING


def test_the_longest_frame_and_its_acknowledgement_fit_a_slot():
    mac = Tsch()
    longest = mac.bits(mac.payload_bits)
    assert mac.airtime(longest) == pytest.approx(4.256e-3), "macTsMaxTx"
    assert mac.slot_needed(longest) == pytest.approx(2.12e-3 + 4.256e-3 + 1e-3 + 19 * 32e-6)


def test_shared_cells_are_spread_evenly():
    assert Tsch(shared=4, slotframe=101).shared_slots == (0, 25, 50, 75)
    assert Tsch(shared=5, slotframe=5).shared_slots == (0, 1, 2, 3, 4)


def test_an_idle_node_listens_for_the_guard_time_in_each_of_its_cells():
    mac = Tsch(shared=2)
    first, second = mac.duties[:2]
    assert first == (pytest.approx(1.01), 2.0, pytest.approx(4.4e-3))
    assert second == (pytest.approx(1.01), 3.0, pytest.approx(6.6e-3)), "one cell of its own"
    assert Tsch().duties[0].on / Tsch().interval == pytest.approx(0.00218, abs=1e-5)


def test_a_hop_takes_a_slotframe_at_most_without_contention():
    assert hop_latency(Tsch(), 96).broadcast == pytest.approx(1.01 + 2.12e-3 + 928e-6)
    assert hop_latency(Tsch(), 96).unicast == pytest.approx(1.01 + 2.12e-3 + 928e-6 + 1e-3 + 608e-6)
    assert hop_latency(Tsch(shared=4), 96).broadcast == pytest.approx(0.26 + 2.12e-3 + 928e-6), "26 slots at most"


@pytest.mark.parametrize(
    ("mac", "path", "words"),
    [
        (Tsch(channels=()), "mac.channels", "no channel is left"),
        (Tsch(channels=(11, 12, 11)), "mac.channels", "channel 11 stands more than once"),
        (Tsch(slot=7e-3), "mac.slot", "133 bytes and its acknowledgement at 250000 bit/s: at least 0.007984 s"),
        (Tsch(slot=7e-3, acks=False, slotframe=7), "", ""),
        (Tsch(shared=6, slotframe=5), "mac.shared", "more than mac.slotframe = 5 slots"),
        (Tsch(rx_wait=12e-3), "mac.rx_wait", "longer than a slot"),
        (Tsch(rx_wait=4.4e-3), "mac.tx_offset", "0.00212 s is too early"),
        (Tsch(tx_ack_delay=1.3e-3), "mac.tx_ack_delay", "does not listen"),
        (Tsch(slot=1e-3, slotframe=7), "mac.slot", "0.001 s is too short"),
        (Tsch(eb_period=1.0), "mac.eb_period", "at least 1.01 s"),
        (Tsch(min_be=8), "mac.max_be", "less than mac.min_be = 8"),
        (Tsch(cell_bits=800, max_psdu=60), "mac.cell_bits", "800 bits do not fit"),
        (Tsch(eb_bytes=60, max_psdu=60), "mac.eb_bytes", "60 bytes do not fit"),
    ],
)
def test_contradictions_are_issues(mac, path, words):
    found = issues(mac)
    assert [where for where, _ in found] == ([path] if path else [])
    assert all(words in message for _, message in found)


def test_drift_beyond_the_guard_is_refused_with_the_period_that_is_needed():
    """Two clocks, each 3 sd off: 180 ppm at 30 ppm; the guard of 1.1 ms lasts for 6.1 s."""
    setup = company(clock=DriftingClock(sd=30e-6))
    ((path, message),) = issues(Tsch(keep_alive=10.0), setup)
    assert path == "mac.keep_alive"
    assert "0.0018 s" in message and "at most 6.11 s" in message
    assert issues(Tsch(), setup) == issues(Tsch(keep_alive=10.0)) == []
    ((path, message),) = issues(Tsch(keep_alive=None), setup)
    assert path == "mac.eb_period" and "at most 6.11 s" in message, "beacons are all that corrects"
    assert issues(Tsch(keep_alive=None, eb_period=6.0), setup) == []
    assert issues(Tsch(keep_alive=None, eb_period=None), setup) == [], "what happens to a network without corrections"


def test_a_rate_is_known_to_a_tick_in_the_first_keep_alive():
    ((path, message),) = issues(Tsch(keep_alive_compensated=200.0), company(clock=DriftingClock(sd=30e-6)))
    assert path == "mac.keep_alive_compensated"
    assert "at most 180 s" in message
