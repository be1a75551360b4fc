"""The interface of background consumption, and its absence.

Background consumption is the power that nodes draw over time: idle listening, sleep, and the measurements by which
they look for targets. It knows neither the nodes nor their ledger: `Nodes` requests charges and books them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.radio import Mode
from wsnsim.base.tables import CAUSES
from wsnsim.network.energy.ledger import Charges


class Consumption:
    """The background consumption of all nodes: here of nodes for which time costs nothing.

    Times in s, energies in J. While the radio of a node sends or receives, or its processor computes, the node's acts
    are booked elsewhere: the `mark_` methods exclude that time. `most` is what one node can consume at most in the
    whole run.
    """

    most: float = 0.0

    def start(self, battery: float, check: Callable[[int], None]) -> None:
        """Begin to watch batteries of a charge; `check(node)` is called when a node may have run out."""

    def pending(self, node: int) -> float:
        """Joules consumed since the node was last settled. Changes nothing."""
        return 0.0

    def pending_charges(self, nodes: Ints) -> Iterable[tuple[Ints, int, Floats]]:
        """(nodes, cause, joules) consumed since the nodes were settled, in pieces; negative if given back."""
        return ()

    def settle(self, node: int) -> Charges:
        """Return what a node has consumed since it was last settled, which the caller books."""
        return ()

    def watch(self, node: int, left: float) -> None:
        """Set a timer for a node with `left` joules, if it may run out before the end."""

    def runs_out(self, node: int, left: float) -> bool:
        """Whether `left` joules of a node are only what rounding leaves."""
        return False

    def mark_radio_busy(self, node: int, seconds: float) -> None:
        """The radio of a node sends or receives for this time."""

    def mark_radios_busy(self, nodes: Ints, seconds: float) -> None:
        """`mark_radio_busy` for different nodes (n,)."""

    def mark_computing(self, node: int, cycles: float) -> None:
        """The processor of a node computes for a number of cycles."""

    def mark_all_computing(self, nodes: Sequence[int], cycles: Sequence[float]) -> None:
        """`mark_computing` for several nodes in turn, each for cycles of its own."""

    def sleep_radio(self, node: int, seconds: float) -> Charges:
        """Return the charges of a radio that sleeps for this time, which the caller has marked as busy."""
        return ()

    def switching(self, node: int, mode: Mode) -> float:
        """Joules of the change of a node to a mode."""
        return 0.0

    def change_mode(self, node: int, mode: Mode) -> None:
        """A settled node is in another mode from now on."""

    def is_held(self, node: int) -> bool:
        """Whether a duty-cycled MAC has switched the radio of a node on."""
        return False

    def hold_radio(self, node: int, on: bool) -> None:
        """The radio of a settled node listens from now on; `on`: it did so already, in a wake-up of its duty."""

    def release_radio(self, node: int, missed: float | None) -> None:
        """The radio of a settled node that was held follows its duty again; it was held in `missed` wake-ups."""

    def set_duty(self, node: int, index: int) -> None:
        """A settled node follows another of the duties of its MAC; if its radio is held, afterwards."""

    def add_listening(self, node: int, seconds: float, starts: float) -> None:
        """The radio of a node that follows its duty listens for seconds more than that says, and starts more often."""

    def added(self, node: int) -> float:
        """Joules that the MAC added since the node was settled."""
        return 0.0

    def radio_on(self) -> float | None:
        """Share of the time of all nodes until now in which radios were on; None if those of awake nodes always are."""
        return None

    def correct(self, cause: int, joules: float) -> None:
        """Add to the network's total of a cause: a node that died could not pay what it consumed, or lost a rest."""

    def totals(self, settled: list[float]) -> list[float]:
        """The network's totals by cause until now, given the settled ones, without `scheduled_totals`."""
        return settled

    def scheduled_totals(self, times: Floats) -> Floats:
        """(T, causes) what all nodes would have consumed by each time, had they only followed their schedules."""
        return np.zeros((times.size, len(CAUSES)))
