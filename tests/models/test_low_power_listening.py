"""Parameters of X-MAC and ContikiMAC: durations by hand, in symbols of 16 µs; and the issues of impossible values."""

import pytest

from tests.models.test_access import SLOW, company, issues
from wsnsim.models.low_power_listening import ContikiMac, XMac

SYMBOL = 16e-6


def test_a_listening_window_of_xmac_holds_a_whole_strobe_wherever_it_begins():
    """A strobe of 17 bytes is 34 symbols; the gap is the 54 symbols of the wait and 12 of the turnaround."""
    mac = XMac()
    assert mac.airtime(mac.strobe_bits) == pytest.approx(34 * SYMBOL)
    assert mac.gap == pytest.approx(66 * SYMBOL) and mac.period == pytest.approx(100 * SYMBOL)
    assert mac.window == mac.needed == pytest.approx(134 * SYMBOL)
    for late in range(100):
        starts = [late * SYMBOL + i * mac.period for i in range(3)]
        whole = [start for start in starts if start >= 0 and start + 34 * SYMBOL <= mac.window + 1e-12]
        assert whole, "a train whose first strobe begins so late after the wake-up"


def test_trains_of_strobes_and_copies_start_over_more_than_one_interval():
    mac = XMac(interval=0.125)
    assert mac.strobes == 80 and (mac.strobes - 1) * mac.period > 0.125
    contiki = ContikiMac(interval=0.125)
    bits = contiki.bits(96)
    assert (contiki.copies(bits) - 1) * contiki.period(bits) > 0.125
    assert contiki.copies(bits) == 96, "a frame of 928 µs and a gap of 400 µs"


def test_contikimac_pads_frames_so_that_no_channel_check_falls_beside_them():
    mac = ContikiMac()
    assert mac.bits(8) == 8 * 28 and mac.airtime(mac.bits(8)) > mac.cca_gap + 2 * mac.cca
    assert mac.bits(96) == 8 * 29, "a frame of 29 bytes is long enough"


def test_the_duty_of_contikimac_is_that_of_two_assessments():
    """Two assessments of 192 µs at 8 Hz: 0.31 % of the time."""
    (duty,) = ContikiMac(interval=0.125).duties
    assert (duty.starts, duty.on) == (2, pytest.approx(2 * 192e-6))
    assert duty.on / duty.interval == pytest.approx(0.0031, abs=5e-5)
    long, short = XMac(interval=0.5, near=0.125).duties
    assert (long.interval, short.interval, short.starts) == (0.5, 0.125, 1) and long.on == short.on == XMac().window


def test_a_hop_takes_up_to_one_interval_and_the_exchange():
    for mac in (XMac(interval=0.25), ContikiMac(interval=0.25)):
        latency = mac.latency(96)
        assert 0.25 < latency.broadcast < 0.28 and 0.25 < latency.unicast < 0.28


@pytest.mark.parametrize("kind", [XMac, ContikiMac])
def test_the_defaults_are_possible(kind):
    assert issues(kind()) == []
    assert issues(kind(interval=1.0, near=0.125)) == []


@pytest.mark.parametrize(("given", "path", "message"), [
    ({"listen": 2e-3}, "mac.listen", "may fall between two strobes: a whole strobe is heard in 0.002144 s"),
    ({"interval": 2e-3}, "mac.interval", "is not longer than a listening window of 0.002144 s"),
    ({"interval": 1.0, "near": 3e-3}, "mac.near", "is not mac.interval = 1 s divided by a power of two"),
    ({"interval": 1.0, "near": 0.3}, "mac.near", "(nearest: 0.25 s)"),
    ({"interval": 0.125, "near": 0.25}, "mac.near", "divided by a power of two"),
    ({"cca": 0.13}, "mac.interval", "0.125 s is not longer than a gap between strobes and a CCA of 0.131"),
    ({"acks": False}, "mac.acks", "acks: true is needed"),
    ({"ack_wait": 1e-4}, "mac.ack_wait", "is over before an acknowledgement"),
])  # fmt: skip
def test_xmac_says_what_cannot_be(given, path, message):
    found = issues(XMac(**given))
    assert len(found) == 1 and found[0][0] == path and message in found[0][1], found


@pytest.mark.parametrize(("given", "path", "message"), [
    ({"frame_gap": 350e-6}, "mac.frame_gap", "t_i = 0.00035 s must be longer than t_a + t_d"),
    ({"cca_gap": 400e-6}, "mac.cca_gap", "t_c = 0.0004 s must be longer than t_i (frame_gap) = 0.0004 s"),
    ({"shortest": 27}, "mac.shortest", "or nodes miss short frames; 28 bytes suffice"),
    ({"shortest": 133, "max_psdu": 100}, "mac.shortest", "133 bytes do not fit a frame, which has 106 on the air"),
    ({"interval": 1e-3, "cca": 300e-6, "shortest": 60}, "mac.interval", "is not longer than a wake-up of 0.0011 s"),
    ({"cca": 0.13}, "mac.interval", "0.125 s is not longer than a wake-up of 0.2605 s"),
    ({"cca_gap": 10e-3}, "mac.shortest", "no frame is so long (at most 133 bytes on the air): shorten cca_gap or cca"),
    ({"guard": 0.04}, "mac.guard", "a known phase saves nothing"),
    ({"acks": False}, "mac.acks", "acks: true is needed"),
])  # fmt: skip
def test_contikimac_says_what_cannot_be(given, path, message):
    found = issues(ContikiMac(**given))
    assert len(found) == 1 and found[0][0] == path and message in found[0][1], found


def test_a_rate_that_is_not_the_radios_is_an_issue():
    assert any(where == "mac.rate" for where, _ in issues(XMac(), company(energy=SLOW)))
