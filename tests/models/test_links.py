"""Link models, modulations and routing components."""

import dataclasses

import numpy as np
import pytest

from wsnsim.base.rng import derive_all
from wsnsim.base.setups import BeaconSetup
from wsnsim.models.datasheets import bit_error, snr_at_sensitivity, snr_for, success
from wsnsim.models.links import Disk, GreedyGeographic, LogNormal, MinimumEnergy, MinimumHop
from wsnsim.models.sleep import EventWake
from wsnsim.models.wakeup import NoWakeUp


def keys(number, seed=1):
    return derive_all(seed, np.arange(number))


def powers(link, distance, number=200_000):
    return link.powers(np.full(number, distance), keys(number, 1), keys(number, 2))


def test_a_disk_ends_at_its_range():
    disk = Disk()
    assert disk.perfect
    assert disk.audible == disk.reach
    heard = disk.powers(np.array([0.0, 75.0, 75.001]), keys(3), keys(3))
    assert np.array_equal(heard, [0.0, 0.0, -np.inf])
    assert np.array_equal(disk.senses(heard), [True, True, False])
    assert np.array_equal(disk.reception(heard, 232, 0.0), [1.0, 1.0, 0.0])


def test_a_disk_loses_the_stated_share_of_frames_and_all_disturbed_ones():
    disk = Disk(loss=0.3)
    assert not disk.perfect
    assert not disk.captures
    heard = np.array([0.0, 0.0, -np.inf])
    assert disk.reception(heard, 88, 0.0) == pytest.approx([0.7, 0.7, 0.0])
    assert disk.reception(heard, 1000, np.array([0.0, 1e-12, 0.0])) == pytest.approx([0.7, 0.0, 0.0])


@pytest.mark.parametrize(("modulation", "symbols", "gain"), [("oqpsk", 16, 20.0), ("ncfsk", 2, 1.0)])
@pytest.mark.parametrize("energy", [2.0, 6.0, 9.0])
def test_the_bit_error_rate_is_that_of_a_noncoherent_receiver(modulation, symbols, gain, energy):
    """The receiver takes the largest of M envelopes: |√E + n|² against M - 1 of noise alone; M/2 / (M - 1) bits err.

    500,000 symbols: four standard errors of the share of wrong symbols.
    """
    draw, number = np.random.default_rng(5), 500_000
    real, imaginary = draw.normal(scale=np.sqrt(0.5), size=(2, number))
    right = (np.sqrt(energy) + real) ** 2 + imaginary**2
    largest = -np.log1p(-(draw.random(number) ** (1.0 / (symbols - 1))))  # of M - 1 exponentials, by inversion
    share = symbols / 2 / (symbols - 1)
    wrong = np.mean(largest > right)
    tolerance = 4.0 * share * np.sqrt(wrong * (1 - wrong) / number)
    assert float(bit_error(np.array(energy / gain), modulation)) == pytest.approx(share * wrong, abs=tolerance)


@pytest.mark.parametrize("modulation", ["oqpsk", "ncfsk"])
def test_half_the_bits_are_wrong_without_a_signal_and_none_with_a_strong_one(modulation):
    errors = bit_error(np.array([0.0, 1e-6, 0.1, 1.0, 10.0, 1e3, 1e30]), modulation)
    assert errors[0] == pytest.approx(0.5, abs=1e-12)
    assert np.all(np.diff(errors) <= 0)
    assert 0.0 <= errors[-1] < 1e-200


@pytest.mark.parametrize("modulation", ["oqpsk", "ncfsk"])
def test_at_the_sensitivity_one_psdu_of_twenty_bytes_in_a_hundred_is_lost(modulation):
    link = LogNormal(modulation=modulation, sensitivity=-90.0)
    assert link.reception(np.array([-90.0]), 160, 0.0) == pytest.approx([0.99], abs=1e-12)
    ratio = np.array(snr_at_sensitivity(modulation))
    assert float(1 - (1 - bit_error(ratio, modulation)) ** 160) == pytest.approx(0.01, abs=1e-12)
    assert link.noise == pytest.approx(1e-9 / ratio)


def test_the_ratio_for_a_probability_is_the_inverse_of_the_probability_at_a_ratio():
    for probability in (1e-3, 0.5, 0.99):
        ratio = np.array(snr_for(probability, 232, "oqpsk"))
        assert float(success(bit_error(ratio, "oqpsk"), 232)) == pytest.approx(probability, rel=1e-9)


def test_the_mean_link_meets_the_sensitivity_at_46_metres():
    """0 dBm - 55 dB - 24 dB log10(d) = -95 dBm at 10^(40/24) m."""
    link = LogNormal()
    assert link.reach == pytest.approx(46.4, abs=0.05)
    assert LogNormal(shadowing=0.0, asymmetry=0.0).powers(np.array([link.reach]), keys(1), keys(1)) == pytest.approx(
        [-95.0]
    )


def test_distances_below_a_metre_count_as_a_metre():
    quiet = LogNormal(shadowing=0.0, asymmetry=0.0)
    assert quiet.powers(np.array([0.0, 0.5, 1.0, 10.0]), keys(4), keys(4)) == pytest.approx([-55, -55, -55, -79])


def test_links_scatter_as_stated_and_end_at_three_deviations():
    """A normal within three deviations has 0.9733 of the variance: 1 - 2·3 φ(3) / (2Φ(3) - 1)."""
    only_shadowed = LogNormal(asymmetry=0.0)
    scatter = powers(only_shadowed, 10.0) + 79.0
    assert np.abs(scatter).max() <= 12.0
    assert scatter.mean() == pytest.approx(0.0, abs=4 * 4 / np.sqrt(scatter.size))
    assert scatter.var() == pytest.approx(16 * 0.97334, rel=4 * np.sqrt(2 / scatter.size))
    both = powers(LogNormal(), 10.0) + 79.0
    assert both.var() == pytest.approx(16.25 * 0.97334, rel=4 * np.sqrt(2 / both.size))


def test_the_two_directions_of_a_link_share_its_shadowing():
    distances, pairs = np.full(1000, 10.0), keys(1000, 1)
    there, back = (LogNormal().powers(distances, pairs, directions) for directions in (keys(1000, 2), ~keys(1000, 2)))
    assert np.std(there - back) == pytest.approx(np.sqrt(0.97334), rel=0.1), "1 dB between the directions"
    assert there + back == pytest.approx(2 * LogNormal(asymmetry=0.0).powers(distances, pairs, pairs))
    assert np.array_equal(there, LogNormal().powers(distances, pairs, keys(1000, 2)))
    even = LogNormal(asymmetry=0.0)
    assert np.array_equal(even.powers(distances, pairs, keys(1000, 2)), even.powers(distances, pairs, keys(1000, 3)))


@pytest.mark.parametrize("interference", ["overlap", "sinr"])
def test_frames_are_heard_within_the_audible_distance_only(interference):
    link = LogNormal(interference=interference)
    assert np.all(powers(link, link.audible * 1.000001) == -np.inf)
    spread = np.linspace(link.reach, link.audible, 200_000)
    heard = link.powers(spread, keys(spread.size, 1), keys(spread.size, 2))
    assert spread[np.isfinite(heard)].max() > 0.6 * link.audible
    assert heard[np.isfinite(heard)].min() >= link.floor


def test_a_power_below_the_floor_would_neither_arrive_nor_be_sensed_nor_interfere():
    link, capturing = LogNormal(), LogNormal(interference="sinr")
    below = np.array([link.floor - 1e-6])
    assert link.reception(below, 88, 0.0)[0] < 1e-3 <= link.reception(below + 2e-6, 88, 0.0)[0]
    assert not link.senses(below)[0]
    assert 10 ** (capturing.floor / 10) == pytest.approx(0.1 * capturing.noise)
    assert LogNormal(carrier_sense=-110.0).floor == -110.0
    assert not link.senses(np.array([-np.inf]))[0]
    assert link.senses(np.array([-95.0]))[0]


@pytest.mark.parametrize(("mode", "busy_from"), [(1, -77.0), (2, -95.0), (3, -95.0)])
def test_the_channel_is_busy_by_its_power_or_by_a_frame_that_is_recognised(mode, busy_from):
    """CC2420: a CCA_THR of -32 and an RSSI offset of -45 dBm; in its default, mode 3, a frame makes it busy too."""
    link = LogNormal(cca_mode=mode)
    assert np.array_equal(link.senses(np.array([busy_from - 1e-9, busy_from])), [False, True])
    assert (LogNormal().carrier_sense, LogNormal().cca_mode) == (-32 - 45, 3)
    deaf = LogNormal(cca_mode=mode, carrier_sense=-110.0, sensitivity=-90.0)
    assert deaf.senses(np.array([-100.0]))[0] == (mode != 2)


def test_weaker_and_longer_frames_arrive_less_often():
    link = LogNormal()
    arriving = link.reception(np.array([-90.0, -95.0, -96.0, -97.0, -98.0, -99.0, -np.inf]), 232, 0.0)
    assert np.all(np.diff(arriving) < 0)
    assert arriving[0] == pytest.approx(1.0)
    assert arriving[-1] == 0.0
    short, long = (link.reception(np.array([-97.0]), bits, 0.0)[0] for bits in (116, 232))
    assert long == pytest.approx(short**2)


def test_an_interferer_as_loud_as_the_noise_costs_three_decibels():
    link = LogNormal(interference="sinr")
    assert link.captures
    clean = link.reception(np.array([-96.0]), 232, 0.0)
    disturbed = link.reception(np.array([-96.0 + 10 * np.log10(2)]), 232, np.array([link.noise]))
    assert disturbed == pytest.approx(clean, rel=1e-9)


def test_the_stronger_of_two_frames_survives_where_frames_capture_and_neither_where_they_do_not():
    strong, weak = -70.0, -75.0
    milliwatts = 10 ** (np.array([weak, strong]) / 10)
    survives = LogNormal(interference="sinr").reception(np.array([strong, weak]), 232, milliwatts)
    assert survives[0] > 0.999
    assert survives[1] < 1e-6
    assert np.array_equal(LogNormal().reception(np.array([strong, weak]), 232, milliwatts), [0.0, 0.0])
    assert not LogNormal().captures


def test_a_power_below_the_sensitivity_at_one_metre_is_an_issue():
    parts = BeaconSetup(**dict.fromkeys(field.name for field in dataclasses.fields(BeaconSetup)))
    assert list(LogNormal().check(parts)) == []
    (issue,) = LogNormal(power=-50.0).check(parts)
    assert issue.path == ("link", "power")
    assert "-105 dBm at 1 m" in issue.message


def test_routing_components_name_what_a_path_minimises():
    assert (MinimumEnergy().weight, MinimumHop().weight, GreedyGeographic().weight) == ("energy", "hop", "greedy")
    assert NoWakeUp().mechanism == "none"
    assert EventWake().always_listening
