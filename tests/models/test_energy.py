"""Joules against hand counts."""

import dataclasses
import math

import pytest

from wsnsim.base.radio import ContinuousPower, Mode, continuous_power
from wsnsim.base.setups import BeaconSetup, TrackingSetup
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import FirstOrder, FirstOrder2002, States
from wsnsim.models.links import Disk, LogNormal

RADIO = RadioSheet(
    name="CC2420",
    source="SWRS041",
    rate=250e3,
    receive=62e-3,
    listen=62e-3,
    levels=(0.0, -5.0, -25.0),
    transmit=(57.42e-3, 46.2e-3, 29.04e-3),
    sleep=1.4e-3,
    wake=0.194e-3,
    wake_power=62e-3,
    doze=0.05e-3,
    doze_power=1.4e-3,
    turnaround=0.192e-3,
    turnaround_power=62e-3,
    sensitivity=-95.0,
    noise=-100.0,
)
PROCESSOR = ProcessorSheet(
    name="MSP430F1611", source="Tmote Sky", rate=8e6, run=5.4e-3, idle=163.5e-6, sleep=15.3e-6, wake=6e-6
)
MODES = list(Mode)


def states(**given):
    return States(**{"radio": RADIO, "processor": PROCESSOR} | given)


def radio_of(**given):
    return dataclasses.replace(RADIO, **given)


def issues(part, kind=BeaconSetup, **given):
    """What a part says of a scenario of which only what is given matters."""
    parts = kind(**dict.fromkeys(field.name for field in dataclasses.fields(kind)) | given)
    return [(".".join(map(str, issue.path)), issue.message) for issue in part.check(parts)]


def test_a_packet_of_twelve_bytes_over_seventy_five_metres():
    electronics, amplifier = FirstOrder().transmit(96, 75.0)
    assert electronics == pytest.approx(4.8e-6)  # 96 bit x 50 nJ
    assert amplifier == pytest.approx(54e-6)  # 96 bit x 100 pJ x 5625 m2
    assert FirstOrder().receive(96) == pytest.approx(4.8e-6)


def test_a_step_of_a_cluster_counted_by_hand():
    """Four members send one packet to the head, 10, 20, 30 and 40 m away; each computes 1000 operations."""
    model = FirstOrder()
    spent = sum(
        sum(model.transmit(96, distance)) + model.receive(96) + model.compute(1000) for distance in (10, 20, 30, 40)
    )
    by_hand = 8 * 96 * 50e-9 + 96 * 100e-12 * (100 + 400 + 900 + 1600) + 4 * 1000 * 0.67e-9 * 1.5**2
    assert spent == pytest.approx(by_hand)


def test_computing_costs_the_switched_capacitance_of_every_cycle():
    assert FirstOrder().compute(1000) == pytest.approx(1000 * 0.67e-9 * 2.25)
    assert FirstOrder2002(voltage=3.0).compute(1000) == pytest.approx(4 * FirstOrder2002().compute(1000))


def test_sensing_is_free_unless_it_is_given_a_price():
    for model in (FirstOrder, FirstOrder2002):
        assert model().sense() == 0.0
        assert model(sensing=1e-6).sense() == 1e-6
    assert states(sensing=2e-6).sense() == 2e-6


def test_the_crossover_follows_from_the_two_amplifiers_and_both_agree_there():
    model = FirstOrder2002()
    assert model.crossover == pytest.approx(87.7, abs=0.05)
    near, far = (model.transmit(1000, math.nextafter(model.crossover, to))[1] for to in (0.0, 1000.0))
    assert near == pytest.approx(far, rel=1e-9)
    assert FirstOrder2002(free_space=40e-12).crossover == pytest.approx(2 * model.crossover)


def test_free_space_falls_with_the_square_and_multipath_with_the_fourth_power():
    model = FirstOrder2002()
    assert model.transmit(8, 40.0) == (pytest.approx(8 * 50e-9), pytest.approx(8 * 10e-12 * 1600))
    assert model.transmit(8, 100.0)[1] == pytest.approx(8 * 0.0013e-12 * 1e8)
    assert model.receive(8) == pytest.approx(8 * 50e-9)


@pytest.mark.parametrize("kind", [FirstOrder, FirstOrder2002])
def test_in_the_papers_world_time_and_switching_cost_nothing(kind):
    model = kind()
    assert isinstance(model, ContinuousPower)
    assert all(model.mode_power(mode).radio == model.mode_power(mode).processor == 0.0 for mode in MODES)
    assert all(model.switching(a, b) == 0.0 for a in MODES for b in MODES)
    assert model.turnaround() == model.seconds(1e9) == 0.0


def test_a_first_order_node_may_be_given_a_price_for_time():
    model = FirstOrder(idle=10e-3, sleep=1e-3, switch=1e-6)
    powers = {mode: model.mode_power(mode) for mode in MODES}
    assert powers[Mode.DORMANT] == powers[Mode.AWAKE] == (10e-3, False, 0.0, False)
    assert powers[Mode.ASLEEP] == (1e-3, True, 0.0, True)
    assert powers[Mode.DOWN].radio == 0.0
    assert model.switching(Mode.ASLEEP, Mode.AWAKE) == model.switching(Mode.AWAKE, Mode.DORMANT) == 1e-6
    assert model.switching(Mode.AWAKE, Mode.AWAKE) == 0.0
    assert model.switching(Mode.AWAKE, Mode.DOWN) == model.switching(Mode.DOWN, Mode.DORMANT) == 0.0


def test_a_frame_costs_the_radios_power_for_its_airtime():
    """A packet of 12 bytes is 29 bytes on the air, 928 µs at 250 kbit/s."""
    assert states().transmit(232, 75.0) == (pytest.approx(57.42e-3 * 928e-6), 0.0)
    assert states().transmit(232, 1.0) == states().transmit(232, 75.0)
    assert states().receive(232) == pytest.approx(62e-3 * 928e-6)
    assert states(power=-25.0).transmit(232, 75.0)[0] == pytest.approx(29.04e-3 * 928e-6)


def test_computing_takes_time_and_the_power_of_a_running_processor():
    assert states().seconds(8e6) == 1.0
    assert states().compute(8e6) == pytest.approx(5.4e-3)
    per_cycle = dataclasses.replace(PROCESSOR, energy_per_cycle=1e-9)
    assert states(processor=per_cycle).compute(8e6) == pytest.approx(8e-3)


def test_a_dormant_node_listens_at_the_cost_of_receiving():
    """Two AA cells hold for 84 hours of listening, and for 3673 hours of sleep."""
    model = states()
    dormant, asleep, awake = (model.mode_power(mode) for mode in (Mode.DORMANT, Mode.ASLEEP, Mode.AWAKE))
    assert dormant == (62e-3, False, 15.3e-6, True)
    assert awake == (62e-3, False, 163.5e-6, False)
    assert asleep == (1.4e-3, True, 15.3e-6, True)
    assert model.battery / (dormant.radio + dormant.processor) / 3600 == pytest.approx(83.9, abs=0.1)
    assert model.battery / (asleep.radio + asleep.processor) / 3600 == pytest.approx(3674, abs=1)
    assert sum((model.mode_power(Mode.DOWN).radio, model.mode_power(Mode.DOWN).processor)) == 0.0


def test_changes_of_mode_cost_what_their_transitions_consume():
    model = states()
    radio_on, radio_off, processor_on = 0.194e-3 * 62e-3, 0.05e-3 * 1.4e-3, 6e-6 * 5.4e-3
    assert model.switching(Mode.ASLEEP, Mode.DORMANT) == pytest.approx(radio_on)
    assert model.switching(Mode.ASLEEP, Mode.AWAKE) == pytest.approx(radio_on + processor_on)
    assert model.switching(Mode.DORMANT, Mode.AWAKE) == pytest.approx(processor_on)
    assert model.switching(Mode.AWAKE, Mode.DORMANT) == 0.0
    assert model.switching(Mode.AWAKE, Mode.ASLEEP) == pytest.approx(radio_off)
    assert model.switching(Mode.DORMANT, Mode.ASLEEP) == pytest.approx(radio_off)
    assert all(model.switching(mode, mode) == 0.0 for mode in MODES)
    assert all(model.switching(mode, Mode.DOWN) == model.switching(Mode.DOWN, mode) == 0.0 for mode in MODES)
    assert model.turnaround() == pytest.approx(0.192e-3 * 62e-3)


def test_an_output_power_that_the_radio_does_not_have_is_a_fault_that_names_the_levels():
    ((path, message),) = issues(states(power=-4.0), link=Disk())
    assert path == "energy.power"
    assert "0, -5, -25 dBm (nearest: -5 dBm)" in message
    assert issues(states(power=-25.0), link=Disk()) == []


def test_the_energy_models_output_power_is_the_links():
    assert issues(states(), link=LogNormal()) == []
    ((path, message),) = issues(states(power=-5.0), link=LogNormal(power=0.0))
    assert path == "energy.power"
    assert "link.power = 0 dBm" in message
    assert issues(states(), kind=TrackingSetup) == []  # a bench has no link


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"levels": ()}, "at least one output power"),
        ({"levels": (0.0, -5.0)}, "levels has 2 items and transmit 3"),
        ({"levels": (0.0, -5.0, -5.0)}, "twice"),
    ],
)
def test_a_sheet_whose_levels_and_powers_do_not_match_is_refused(given, words):
    with pytest.raises(ValueError, match=words):
        radio_of(**given)


def test_a_model_without_power_over_time_has_none():
    assert continuous_power(object()) is None


def test_a_sleep_state_of_the_radio_is_chosen_by_name():
    radio = radio_of(
        sleep_states=("idle", "off"),
        sleep_powers=(1.4e-3, 1e-9),
        sleep_wakes=(0.2e-3, 2e-3),
        sleep_wake_powers=(60e-3, 8e-3),
    )
    powers = [states(radio=radio, sleep_state=state).mode_power(Mode.ASLEEP).radio for state in (None, "idle", "off")]
    assert powers == [RADIO.sleep, 1.4e-3, 1e-9]
    waking = [
        states(radio=radio, sleep_state=state).switching(Mode.ASLEEP, Mode.DORMANT) for state in (None, "idle", "off")
    ]
    assert waking == pytest.approx([0.194e-3 * 62e-3, 0.2e-3 * 60e-3, 2e-3 * 8e-3])
    assert issues(states(radio=radio, sleep_state="off")) == []
    ((path, message),) = issues(states(radio=radio, sleep_state="of"))
    assert (path, message) == ("energy.sleep_state", "'of' is not a sleep state of CC2420 (did you mean 'off'?)")
    ((path, message),) = issues(states(sleep_state="idle"))
    assert message == "CC2420 has no sleep states to select: leave it out"
