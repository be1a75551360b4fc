"""What the datasheet of a radio says is the default of the link and the MAC, and what is written stays."""

from pathlib import Path

import pytest

from wsnsim.base.errors import ScenarioError
from wsnsim.base.medium_access import off_time
from wsnsim.models.access import Csma
from wsnsim.scenario.build import build, resolved
from wsnsim.scenario.datasheets import datasheet
from wsnsim.scenario.load import load
from wsnsim.scenario.registry import kinds
from wsnsim.scenario.texts import find_sheet, sheets

RECORDING = Path(__file__).parents[2] / "scenarios" / "recorded_links.yaml"
LINKS = {"disk": {}, "log_normal": {}, "recorded": load(str(RECORDING)).link.model_dump(exclude_unset=True)}


def scenario(radio, link="log_normal", mac="csma", energy=None, **base):
    """A small network with a radio, and what is written beside its kinds."""
    link, mac = ({"kind": one} if isinstance(one, str) else one for one in (link, mac))
    return load({
        "name": "radio", "step": "1 s", "duration": "2 s", "workload": {"kind": "beacons", "period": "60 s"},
        "deploy": {"kind": "uniform", "nodes": 4, "width": "40 m", "height": "40 m", "cover": False},
        "energy": {"kind": "states", "radio": radio, "processor": "msp430f1611"} | (energy or {}),
        "link": link, "mac": mac,
    } | base)  # fmt: skip


def issues(*given, **more):
    with pytest.raises(ScenarioError) as caught:
        build(scenario(*given, **more))
    return [tuple(line.split(": error: ")) for line in str(caught.value).splitlines()]


def test_the_table_has_every_link_and_every_radio():
    assert set(LINKS) == set(kinds("link")) and {"cc2420", "cc1000", "nrf52840_radio"} <= set(sheets("radio"))


@pytest.mark.parametrize("mac", list(kinds("mac")))
@pytest.mark.parametrize("link", list(LINKS))
@pytest.mark.parametrize("radio", sheets("radio"))
def test_every_radio_goes_with_every_link_and_every_mac(radio, link, mac):
    deploy = {} if link != "recorded" else {"deploy": load(str(RECORDING)).deploy.model_dump(exclude_unset=True)}
    found = scenario(radio, {"kind": link, **LINKS[link]}, mac, **deploy)
    setup, sheet = build(found), datasheet(find_sheet(radio, Path())).part
    assert load(resolved(found)) == found
    if mac != "ideal":
        assert (setup.mac.rate, setup.mac.turnaround) == (sheet.rate, sheet.turnaround)
    if link == "log_normal":
        assert (setup.link.sensitivity, setup.link.modulation) == (sheet.sensitivity, sheet.modulation)


def test_sending_over_the_ideal_channel_takes_no_time_with_a_datasheet_either():
    assert build(scenario("cc1000", mac="ideal")).mac.rate is None


@pytest.mark.parametrize(("key", "radio", "link", "mac"), [
    ("link.sensitivity", "nrf52840_radio", {"kind": "log_normal", "sensitivity": "-95 dBm"}, "csma"),
    ("link.modulation", "cc1000", {"kind": "log_normal", "modulation": "oqpsk"}, "csma"),
    ("mac.rate", "cc1000", "disk", {"kind": "csma", "rate": "250 kbit/s", "ack_wait": "1 s"}),
    ("mac.turnaround", "cc1000", "disk", {"kind": "csma", "turnaround": "0.192 ms"}),
    ("mac.ack_wait", "cc1000", "disk", {"kind": "csma", "ack_wait": "0.864 ms"}),
])  # fmt: skip
def test_a_written_value_that_contradicts_the_radio_is_refused(key, radio, link, mac):
    assert [path for path, _ in issues(radio, link, mac)] == [key]


def test_a_fitted_sensitivity_counts_beside_the_radio():
    fitted = {"kind": "log_normal", "sensitivity": "-91.7 dBm", "fitted_on": ["0123"]}
    assert build(scenario("cc2420", fitted)).link.sensitivity == -91.7


def test_durations_in_symbols_are_as_many_symbols_at_the_rate_of_the_radio():
    mac = build(scenario("cc1000", mac={"kind": "csma", "cca": "1 ms"})).mac
    assert mac.ack_wait == pytest.approx(216 / 19.2e3), "54 symbols of 4 bits"
    assert mac.backoff == pytest.approx(80 / 19.2e3) and mac.cca == 1e-3
    assert build(scenario("nrf52840_radio")).mac == build(scenario("cc2420")).mac == Csma()


def test_the_output_powers_of_link_and_energy_model_follow_each_other():
    given, power = {"kind": "log_normal", "power": "-5 dBm"}, {"power": "-5 dBm"}
    for setup in (build(scenario("cc2420", given)), build(scenario("cc2420", energy=power))):
        assert setup.link.power == setup.energy.power == -5.0
    assert issues("cc2420", given, energy={"power": "0 dBm"}) == [
        ("energy.power", "0 dBm is not link.power = -5 dBm: they must agree")
    ]
    ((_, message),) = issues("cc2420", {"kind": "log_normal", "power": "-4 dBm"})
    assert message.startswith("-4 dBm is not an output power of CC2420")


STATES = [None, "idle", "power_down", "regulator_off"]
SLOW = {("contikimac", "power_down"), ("contikimac", "regulator_off"), ("tdma", "regulator_off")}


@pytest.mark.parametrize("mac", list(kinds("mac")))
@pytest.mark.parametrize("state", STATES)
def test_no_mac_turns_a_radio_off_for_less_time_than_it_takes_to_stop_and_start(mac, state):
    energy = {} if state is None else {"off_state": state}
    if (mac, state) in SLOW:
        ((path, message),) = issues("cc2420", "disk", mac, energy=energy)
        assert path == "energy.off_state" and f"from {state}: choose an off_state that is left sooner" in message
        return
    setup = build(scenario("cc2420", "disk", mac, energy=energy))
    assert getattr(setup.mac, "shortest_off", 1.0) >= off_time(setup.energy) > 0.0


def test_contikimac_keeps_the_crystal_of_a_cc2420_on_unless_its_channel_checks_are_far_apart():
    """Contiki's driver only switches the receiver off: idle mode, from which the radio starts in 0.194 ms."""
    energy = build(scenario("cc2420", "disk", "contikimac")).energy
    assert (energy.off_state, energy.sleep_state) == ("idle", None), "nodes that sleep by a schedule are in power-down"
    apart = {"kind": "contikimac", "cca_gap": "1.2 ms", "shortest": 50}
    assert build(scenario("cc2420", "disk", apart)).energy.off_state is None, "power-down"
    short = {"kind": "contikimac", "frame_gap": "360 us", "cca_gap": "0.2 ms"}
    assert "mac.cca_gap" in [path for path, _ in issues("cc2420", "disk", short)]


@pytest.mark.parametrize(("key", "mac", "energy", "more"), [
    ("mac.slot", {"kind": "tsch", "slot": "3 ms", "rx_wait": "2.2 ms", "max_psdu": 20}, {}, {}),
    ("mac.interval", {"kind": "xmac", "interval": "3.5 ms"}, {"off_state": "regulator_off"}, {}),
    ("sleep.period", "csma", {}, {"sleep": {"kind": "duty_cycle", "period": "20 ms", "awake_share": 0.96}}),
])  # fmt: skip
def test_what_leaves_a_radio_no_time_to_start_is_refused(key, mac, energy, more):
    assert key in [path for path, _ in issues("cc2420", "disk", mac, energy=energy, **more)]


def test_a_wake_up_call_lasts_until_the_radio_of_the_called_node_is_on():
    with pytest.raises(ScenarioError, match=r"wakeup\.call: error: nodes would be called for 0\.001 s"):
        build(load("gmtt", ["wakeup.call=1 ms"]))
