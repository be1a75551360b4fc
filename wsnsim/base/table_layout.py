"""What of a scenario decides which columns its tables have.

table_layout(setup) -> TableLayout
"""

from __future__ import annotations

from typing import Any, NamedTuple

from wsnsim.base.radio_duty import DutyCycledMac
from wsnsim.base.setups import RadioSetup, Setup, TrackingSetup
from wsnsim.base.vector_readings import components_of


class TableLayout(NamedTuple):
    """What `tables.columns_of` needs to know of a scenario.

    Attributes:
        states: The (name, unit) of each of the motion model's columns; none without a target.
        position: Which of them are the position; none without a target.
        components: The number of components of a reading.
        duty_cycled: Whether a MAC switches radios off.
    """

    states: tuple[tuple[str, str], ...] = ()
    position: tuple[int, ...] = ()
    components: int = 1
    duty_cycled: bool = False

    @property
    def keywords(self) -> dict[str, Any]:
        """All but `states`, as keyword arguments of the recorders of a result."""
        return {
            "position": self.position or None,
            "components": self.components,
            "duty_cycled": self.duty_cycled,
        }


def table_layout(setup: Setup) -> TableLayout:
    """The layout of the tables of a scenario's runs."""
    duty_cycled = isinstance(setup, RadioSetup) and isinstance(setup.mac, DutyCycledMac)
    if not isinstance(setup, TrackingSetup):
        return TableLayout(duty_cycled=duty_cycled)
    motion = setup.motions[0]
    states = tuple(zip(motion.columns, motion.units, strict=True))
    return TableLayout(states, motion.position, len(components_of(setup.sensor)), duty_cycled)
