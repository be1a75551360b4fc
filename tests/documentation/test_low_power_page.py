"""The figures of docs/low_power_listening.md are those of runs."""

import pytest

from tests.bench.page import spliced
from tests.documentation.low_power_page import HORIZON, MACS, PAGE, blocks, radio_on
from tests.network.low_power import low_power
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import States
from wsnsim.models.low_power_listening import ContikiMac, XMac


@pytest.mark.parametrize("name", MACS)
def test_radios_are_on_for_the_share_of_time_that_the_run_states(name):
    on, share = radio_on(MACS[name], 3)
    assert on.sum() / (2.0 * HORIZON) == pytest.approx(share, rel=1e-9)


def test_the_page_is_made_from_runs():
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks().items():
        assert spliced(text, name, block) == text, "python -m tests.documentation.low_power_page writes it"


def test_an_idle_radio_is_off_for_as_long_as_contiki_says():
    (duty,) = ContikiMac().duties
    with_turning_on = (duty.on + duty.starts * 194e-6) / duty.interval
    assert duty.on / duty.interval == pytest.approx(0.0031, abs=5e-5)
    assert with_turning_on == pytest.approx(0.0062, abs=5e-5) and 0.992 < 1.0 - with_turning_on < 0.996


def test_a_measured_board_that_samples_the_channel_takes_the_published_current():
    volts, asleep = 3.0, 0.788e-3  # joules are compared as currents, so that the voltage cancels
    phases = {"startup": (0.396e-3, 5.45e-3), "calibration": (0.772e-3, 9.55e-3), "stop": (0.032e-3, 5e-3)}
    listening, interval = 3.24e-3, 99.6e-3 + 3.24e-3 + sum(seconds for seconds, _ in phases.values())
    wake = phases["startup"][0] + phases["calibration"][0]
    start = sum(phases[name][0] * phases[name][1] for name in ("startup", "calibration"))
    board = RadioSheet(
        name="eZ430-RF2500", source="Watteyne 2009", rate=250e3, receive=18.3e-3 * volts, listen=18.3e-3 * volts,
        levels=(0.0,), transmit=(21.2e-3 * volts,), sleep=asleep * volts, wake=wake, wake_power=start / wake * volts,
        doze=phases["stop"][0], doze_power=phases["stop"][1] * volts, turnaround=192e-6, turnaround_power=0.0549,
        sensitivity=-89.0, noise=-100.0,
    )  # fmt: skip
    nothing = ProcessorSheet(
        name="in the board's current", source="-", rate=8e6, run=0.0, idle=0.0, sleep=0.0, wake=0.0
    )
    mac = XMac(interval=interval, listen=listening)
    network = low_power(mac, energy=States(radio=board, processor=nothing), horizon=1000 * interval)
    network.env.run(until=1000 * interval)
    network.nodes.close()
    mean = network.nodes.ledger.spent[0] / (volts * 1000 * interval)
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"ours takes {1e3 * mean:.3f} mA; 1.450 mA are published" in page
    assert mean == pytest.approx(1.450e-3, rel=0.03)
