"""The figures of docs/low_power_listening.md, from runs of two nodes.

python -m tests.documentation.low_power_page     make the runs and write the page's blocks
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any, Final

import numpy as np

from tests.bench.page import spliced
from tests.network.low_power import CC2420, IN_IDLE, LISTEN, PROCESSOR, SEND, SWITCHING, joules, low_power
from wsnsim.models.energy import States
from wsnsim.models.low_power_listening import ContikiMac, XMac

PAGE: Final = Path(__file__).parents[2] / "docs" / "low_power_listening.md"
MACS: Final = {
    "X-MAC": XMac(),
    "ContikiMAC": ContikiMac(),
    "ContikiMAC, `phase_lock: false`": ContikiMac(phase_lock=False),
}
COUNT, EVERY = 50, 1.37
"""Unicasts after the first one, which finds the phase of its destination, and s between them: 25 phases twice."""
HORIZON: Final = (COUNT + 1) * EVERY + 5.0
ROWS: Final = {
    "radio on, idle (%)": 3,
    "power, idle (µW)": 0,
    "a unicast adds at the sender: radio on (ms)": 1,
    "at the receiver: radio on (ms)": 1,
    "at the sender (µJ)": 0,
    "at the receiver (µJ)": 0,
}
"""{row of the table: its digits after the point}."""


def ended(mac: Any, unicasts: int, **sheet: float) -> Any:
    """A network of two nodes after unicasts from the first to the second, and the share of time with radios on."""
    radio = dataclasses.replace(IN_IDLE if isinstance(mac, ContikiMac) else CC2420, **sheet)
    network = low_power(mac, energy=States(radio=radio, processor=PROCESSOR), horizon=HORIZON)
    for i in range(unicasts):
        network.env.run(until=1.0 + EVERY * i)
        assert network.unicast(0, 1).packets == 1
    network.env.run(until=HORIZON)
    share = network.nodes.consumption.radio_on()
    network.nodes.close()
    return network, share


def radio_on(mac: Any, unicasts: int) -> Any:
    """(2,) s in which the radio of each node was on, and the share of both that the run states.

    Starts and stops take no energy here, so that the cause `switch` is turnarounds alone.
    """
    network, share = ended(mac, unicasts, wake_power=0.0, doze_power=0.0)
    powers = {"idle": LISTEN, "rx": LISTEN, "overhear": LISTEN, "tx_electronics": SEND, "switch": SWITCHING}
    seconds = [sum(joules(network, cause, node) / power for cause, power in powers.items()) for node in (0, 1)]
    return np.array(seconds), share


@functools.cache
def measured(name: str) -> dict[str, float]:
    """{row of the table: its value} of a MAC; what unicasts add is the mean over those after the first."""
    mac = MACS[name]
    idle, first, last = (ended(mac, unicasts)[0].nodes.ledger.spent.copy() for unicasts in (0, 1, COUNT + 1))
    quiet, began, on = (radio_on(mac, unicasts)[0] for unicasts in (0, 1, COUNT + 1))
    added, spent = (on - began) / COUNT, (last - first) / COUNT
    values = (100.0 * quiet[0] / HORIZON, 1e6 * idle[0] / HORIZON, *(1e3 * added), *(1e6 * spent))
    return dict(zip(ROWS, map(float, values), strict=True))


def blocks() -> dict[str, str]:
    """{name of a block of the page: its text}."""
    columns = [measured(name) for name in MACS]
    lines = [f"| | {' | '.join(MACS)} |", "| --- " * (1 + len(MACS)) + "|"]
    lines += [f"| {row} | {' | '.join(f'{values[row]:.{digits}f}' for values in columns)} |"
              for row, digits in ROWS.items()]  # fmt: skip
    sender, receiver = (columns[1][row] for row in list(ROWS)[2:4])
    second = (
        f"Over one second, ours adds {sender / 10.0:.2f} % at a sender with phase lock and {receiver / 10.0:.2f} % at "
        "its receiver, for 12 bytes."
    )
    return {"unicasts": "\n".join(lines), "second": second}


def main() -> None:
    """Write the blocks of the page."""
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks().items():
        text = spliced(text, name, block)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
