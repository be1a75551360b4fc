"""The figures of docs/low_power_listening.md are those of runs."""

from pathlib import Path

import numpy as np
import pytest

from tests.network.low_power import LISTEN, SEND, joules, low_power
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import States
from wsnsim.models.low_power_listening import ContikiMac, XMac

PAGE = Path(__file__).parents[2] / "docs" / "low_power_listening.md"
MACS = (XMac(), ContikiMac(), ContikiMac(phase_lock=False))
COUNT, EVERY = 40, 1.37


def table():
    """{row: its three values} of the page."""
    rows = [line.strip("|").split("|") for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:2] == "| "]
    return {row[0].strip(): [float(value) for value in row[1:]] for row in rows[2:]}


def measured(mac, unicasts):
    """(2,) s of radio on and (2,) J of two nodes, after unicasts from the first to the second."""
    network = low_power(mac, horizon=COUNT * EVERY + 5.0)
    for i in range(unicasts):
        network.env.run(until=1.0 + EVERY * i)
        assert network.unicast(0, 1).packets == 1
    network.env.run(until=COUNT * EVERY + 5.0)
    network.nodes.close()
    heard = ("idle", "rx", "overhear")
    on = [sum(joules(network, cause, node) for cause in heard) / LISTEN for node in (0, 1)]
    on = [seconds + joules(network, "tx_electronics", node) / SEND for node, seconds in enumerate(on)]
    return np.array(on), network.nodes.ledger.spent.copy()


@pytest.mark.parametrize("column", range(3))
def test_the_table_is_that_of_runs(column):
    shown = [values[column] for values in table().values()]
    quiet, active = measured(MACS[column], 0), measured(MACS[column], COUNT)
    seconds = COUNT * EVERY + 5.0
    on, spent = (active[0] - quiet[0]) / COUNT, (active[1] - quiet[1]) / COUNT
    found = [100.0 * quiet[0][0] / seconds, 1e6 * quiet[1][0] / seconds, *(1e3 * on), *(1e6 * spent)]
    for value, text, digits in zip(found, shown, (3, 0, 1, 1, 0, 0), strict=True):
        assert value == pytest.approx(text, abs=0.51 * 10.0**-digits)


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
