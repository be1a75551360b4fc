"""What the datasheet of a radio says is the default of the link and the MAC, and what is written stays."""

from pathlib import Path

import pytest

from wsnsim.base.errors import ScenarioError
from wsnsim.models.access import Csma
from wsnsim.scenario.build import build, resolved
from wsnsim.scenario.datasheets import datasheet
from wsnsim.scenario.files import find_sheet, sheets
from wsnsim.scenario.load import load
from wsnsim.scenario.registry import kinds

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
