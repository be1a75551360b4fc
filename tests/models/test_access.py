"""MAC parameters: frames and their durations by hand, in symbols of 16 µs; and the issues of impossible values."""

import dataclasses

import pytest

from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup
from wsnsim.models.access import Csma, IdealMac, Tdma
from wsnsim.models.appointed import Appointed
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import FirstOrder, States
from wsnsim.models.hardware import Frames, NoPacking, Processor
from wsnsim.models.workloads import NearestNode, NoSink, Periodic, Tracking

SYMBOL = 16e-6
TEXT = {"name": "X", "source": "a sheet"}
SLOW = States(
    radio=RadioSheet(
        **TEXT, levels=(0.0,), transmit=(0.03,), rate=19.2e3,
        **dict.fromkeys(("receive", "listen", "sleep", "wake", "wake_power", "doze", "doze_power"), 0.0),
        **dict.fromkeys(("turnaround", "turnaround_power", "sensitivity", "noise"), 0.0),
    ),
    processor=ProcessorSheet(**TEXT, rate=8e6, run=5e-3, idle=1e-4, sleep=1e-5, wake=0.0),
)  # fmt: skip


def company(kind=NetworkSetup, **given):
    """A setup whose other components are None."""
    nothing = dict.fromkeys(field.name for field in dataclasses.fields(kind))
    roles = {"energy": FirstOrder(), "sink": NoSink(), "workload": Periodic(), "packing": NoPacking(),
             "dt": 1.0, "clusters": Appointed()}  # fmt: skip
    return kind(**nothing | {role: part for role, part in roles.items() if role in nothing} | given)


def issues(part, parts=None):
    found = part.check(parts or company())
    return [(".".join(map(str, issue.path)), issue.message) for issue in found]


def test_a_packet_of_twelve_bytes_is_on_the_air_for_58_symbols():
    mac = Csma()
    assert mac.bits(96) == 8 * (6 + 11 + 12) == 232
    assert mac.airtime(mac.bits(96)) == pytest.approx(58 * SYMBOL) == pytest.approx(928e-6)
    assert mac.bits(1) == mac.bits(8) == mac.bits(0) + 8
    assert mac.payload_bits == 8 * 116


def test_an_acknowledgement_comes_within_the_wait_for_it():
    """12 symbols of turnaround and 22 of acknowledgement; the standard waits for 54."""
    mac = Csma()
    assert mac.turnaround + mac.airtime(mac.ack_bits) == pytest.approx((12 + 22) * SYMBOL)
    assert mac.ack_wait == pytest.approx((20 + 12 + 10 + 12) * SYMBOL)


def test_a_psdu_of_up_to_eighteen_bytes_is_followed_by_the_short_spacing():
    mac = Csma()
    assert mac.spacing(mac.bits(8 * 7)) == mac.sifs == pytest.approx(12 * SYMBOL)  # 11 + 7 bytes
    assert mac.spacing(mac.bits(8 * 8)) == mac.lifs == pytest.approx(40 * SYMBOL)


def test_the_defaults_are_the_standards_in_symbols():
    mac = Csma()
    assert (mac.backoff, mac.cca) == (pytest.approx(20 * SYMBOL), pytest.approx(8 * SYMBOL))
    assert (mac.min_be, mac.max_be, mac.max_backoffs, mac.max_retries, mac.acks) == (3, 5, 4, 3, True)
    assert (mac.mechanism, Tdma().mechanism, IdealMac().mechanism) == ("csma", "tdma", "ideal")
    assert IdealMac().rate is None
    assert Tdma().contention == pytest.approx(440 * SYMBOL), "aMinCAPLength"


def test_a_slot_holds_its_frame_between_two_guards_and_the_acknowledgement_if_there_is_one():
    assert not Tdma().acks
    assert Tdma().slot_needed(232) == pytest.approx(928e-6 + 0.5e-3)
    needed = Tdma(acks=True, guard=0.0).slot_needed(232)
    assert needed == pytest.approx((12 + 58 + 12 + 22) * SYMBOL), "a turnaround before it"
    members = int(0.04 / Tdma().slot_needed(232))
    assert members == 28  # of one step of Jiang's, as the docstring says


@pytest.mark.parametrize("mac", [IdealMac(), IdealMac(rate=250e3), Csma(), Tdma(), Tdma(slot=1.5e-3)])
def test_the_defaults_have_no_issues(mac):
    for parts in (company(mac=mac), company(BeaconSetup, mac=mac), company(TrackingSetup)):
        assert issues(mac, parts) == []


@pytest.mark.parametrize(
    ("mac", "path", "words"),
    [
        (Csma(min_be=4, max_be=3), "mac.max_be", "less than mac.min_be = 4"),
        (Csma(header=30, max_psdu=30), "mac.header", "mac.max_psdu = 30"),
        (Csma(max_psdu=22), "mac.max_psdu", "a packet of 96 bits does not fit a frame, which carries 88 bits"),
        (Csma(ack_wait=500e-6), "mac.ack_wait", "at least 0.000544 s"),
        (Tdma(ack_wait=500e-6), "mac.ack_wait", "outside slots"),
        (Tdma(slot=1.4e-3), "mac.slot", "at least 0.001428 s"),
        (Tdma(max_be=2), "mac.max_be", "less than mac.min_be = 3"),
    ],
)
def test_contradictions_in_a_mac_are_issues(mac, path, words):
    ((found, message),) = issues(mac)
    assert found == path
    assert words in message


def test_without_acknowledgements_no_wait_is_needed():
    assert issues(Csma(ack_wait=500e-6, acks=False)) == []


@pytest.mark.parametrize("mac", [IdealMac(rate=250e3), Csma()])
def test_the_rate_is_that_of_the_datasheets_radio(mac):
    ((path, message),) = issues(mac, company(energy=SLOW))
    assert path == "mac.rate"
    assert "19200 bit/s" in message
    assert issues(IdealMac(rate=19.2e3), company(energy=SLOW)) == []
    assert issues(IdealMac(), company(energy=SLOW)) == []


def test_reports_and_beacons_fit_a_frame():
    assert issues(Csma(), company(sink=NearestNode(bits=928))) == []
    ((path, message),) = issues(Csma(), company(sink=NearestNode(bits=929)))
    assert (path, "a report of 929 bits" in message) == ("sink.bits", True)
    ((path, message),) = issues(Csma(), company(BeaconSetup, workload=Periodic(bits=1000)))
    assert (path, "a beacon of 1000 bits" in message) == ("workload.bits", True)


def test_beacons_are_not_due_before_they_can_be_sent():
    assert Tracking().mechanism == "tracking"
    assert Periodic().mechanism == "beacons"
    for mac in (IdealMac(), IdealMac(rate=250e3), Csma()):
        assert issues(Periodic(), company(BeaconSetup, mac=mac)) == []
    ((path, message),) = issues(Periodic(period=2e-3, bits=480), company(BeaconSetup, mac=Csma()))
    assert (path, "0.002464 s" in message) == ("workload.period", True)  # 17 + 60 bytes
    ((path, _),) = issues(Periodic(bits=1000), company(BeaconSetup, mac=IdealMac(rate=999.0)))
    assert path == "workload.period"


def test_frames_are_filled_as_far_as_they_hold():
    assert NoPacking().packets(8, 928) == 1
    assert Frames().packets(96, 928) == 9
    assert Frames(most=4).packets(96, 928) == 4
    assert Frames(most=40).packets(96, 928) == 9
    assert Frames().packets(1000, 928) == 1


def test_packing_needs_frames_with_enough_room():
    assert issues(Frames(), company(mac=Csma())) == issues(Frames(most=9), company(mac=Csma())) == []
    ((path, message),) = issues(Frames(most=10), company(mac=Csma()))
    assert (path, "which holds 9" in message) == ("packing.most", True)
    ((path, message),) = issues(Frames(), company(mac=IdealMac()))
    assert (path, "'ideal'" in message) == ("packing.kind", True)


def test_the_cpu_runs_at_the_rate_of_the_data_sheets_processor():
    assert issues(Processor(), company(energy=SLOW)) == []
    assert issues(Processor(rate=8e6), company(energy=SLOW)) == []
    ((path, message),) = issues(Processor(rate=16e6), company(energy=SLOW))
    assert (path, "8e+06 Hz" in message) == ("cpu.rate", True)
    assert issues(Processor(rate=16e6), company(TrackingSetup)) == []
