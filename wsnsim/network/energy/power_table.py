"""The power of a node in each state. A state is a mode, and a level that says what the radio does in it.

    state = level * MODES + mode

Level 0 is that of a node at the start: its radio listens always, or follows the first duty of a duty-cycled MAC. With
such a MAC, the radio listens at level HELD, and follows one of the other duties at the levels after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numpy as np

from wsnsim.base.arrays import Floats, scalars
from wsnsim.base.medium_access import RadioDuty, SwitchesRadio
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.network.energy.ledger import Charges
from wsnsim.network.node_states import SleepStates

ON: Final = len(CAUSES)
"""A pseudo-cause: under it, seconds with the radio on are summed like joules under causes."""
MODES: Final = len(Mode)
HELD: Final = 1
"""The level of a radio that a duty-cycled MAC has switched on."""
IDLE, SLEEP, SENSE, SWITCH = CAUSE["idle"], CAUSE["sleep"], CAUSE["sense"], CAUSE["switch"]
AWAKE, ASLEEP, SCHEDULED = int(Mode.AWAKE), int(Mode.ASLEEP), int(Mode.SCHEDULED)
Number = TypeVar("Number", float, Floats)


class PowerTable:
    """The power of a node in each state.

    Lists have one item per state. Items of mode SCHEDULED are for the time in which the node is awake.

    Attributes:
        model: The energy model.
        duties: The duties of the MAC; none if radios listen always.
        radio: W of the radio in its default: listening, or sleep if it follows a duty. Not charged while it sends or
            receives.
        radio_cause: The cause under which that is booked.
        share: Share of the time in which the radio is in its default.
        listening: W of listening by the duty, in addition; mean over its interval.
        switching: W of the starts and stops of the radio by the duty; mean over its interval.
        processor: W of the processor.
        processor_cause: The cause under which that is booked.
        sensor: W of measurements that look for targets.
        on: Share of the time in which the radio is on.
        off: 1 if the radio is off by default, else 0.
        scheduled: Whether the mode is SCHEDULED.
        start, stop: Joules of switching a radio on, and off.
        listen: W of listening.
        off_power: W of a radio that the MAC of an awake node has turned off, and of its wake-up receiver.
    """

    def __init__(
        self, model: ContinuousPower, duties: Sequence[RadioDuty] = (), searching: float = 0.0, standby: float = 0.0
    ) -> None:
        """Find the powers.

        Args:
            model: The energy model.
            duties: The duties of the MAC.
            searching: Mean power in W of the measurements with which an awake node looks for targets.
            standby: Power in W of the wake-up receiver of a node that sleeps.
        """
        self.model = model
        self.duties = tuple(duties)
        levels: list[RadioDuty | None] = [*self.duties[:1], None, *self.duties[1:]]
        self._switch_time, self.start, self.stop = _switching(model)
        asleep = float(model.mode_power(Mode.ASLEEP).radio)
        self._off = float(model.radio_off()) if hasattr(model, "radio_off") else asleep
        self.off_power = self._off + standby
        self.listen = float(model.mode_power(Mode.AWAKE).radio)
        states = [self._state(mode, duty, searching, standby) for duty in levels for mode in Mode]
        columns = [list(column) for column in zip(*states, strict=True)]
        self.radio, self.radio_cause, self.share, self.listening, self.switching = columns[:5]
        self.processor, self.processor_cause, self.sensor, self.on, self.off, self.scheduled = columns[5:]

    def _state(self, mode: Mode, duty: RadioDuty | None, searching: float, standby: float) -> tuple[Any, ...]:
        """The state of a mode and a duty, in the order of the attributes; None: the radio listens."""
        power = self.model.mode_power(Mode.AWAKE if mode is Mode.SCHEDULED else mode)
        radio, cause = float(power.radio), SLEEP if power.radio_sleeps else IDLE
        if mode is Mode.ASLEEP:
            radio += standby
        listens = mode not in (Mode.ASLEEP, Mode.DOWN)
        share, listening, switching, on = 1.0, 0.0, 0.0, 1.0 if listens else 0.0
        if listens and duty is not None and duty.on < duty.interval:
            on, starts_per_s = duty.on / duty.interval, duty.starts / duty.interval
            share = max(1.0 - on - starts_per_s * self._switch_time, 0.0)
            listening, switching = radio * on, starts_per_s * (self.start + self.stop)
            radio, cause = self._off if share else 0.0, SLEEP
        processor, processor_cause = float(power.processor), SLEEP if power.processor_sleeps else IDLE
        sensor = searching if mode in (Mode.AWAKE, Mode.SCHEDULED) else 0.0
        off, scheduled = 1.0 if on < 1.0 else 0.0, mode is Mode.SCHEDULED
        of_radio = radio, cause, share, listening, switching
        return *of_radio, processor, processor_cause, sensor, on, off, scheduled

    def powers(self, state: int) -> list[tuple[int, float]]:
        """(cause, W) of a state other than SCHEDULED, with ON if the MAC is duty-cycled."""
        watts = self.by_state(state, passed=1.0, busy=0.0, computed=0.0)
        return [*watts, (ON, self.on[state])] if self.duties else watts

    def total(self, state: int) -> float:
        """W of a state other than SCHEDULED."""
        power: float = self.radio[state] * self.share[state] + self.processor[state] + self.sensor[state]
        if self.duties:
            power = power + self.listening[state] + self.switching[state]
        return power

    def largest(self) -> float:
        """W of the state that consumes most."""
        return max(map(self.total, range(len(self.radio))))

    def by_state(self, state: int, passed: Number, busy: Number, computed: Number) -> list[tuple[int, Number]]:
        """(cause, joules) of a time in a state other than SCHEDULED; see `by_schedule`.

        With a duty-cycled MAC, the last two are those of listening and switching by the duty.
        """
        result = [
            (self.radio_cause[state], self.radio[state] * (self.share[state] * passed - busy)),
            (self.processor_cause[state], self.processor[state] * (passed - computed)),
            (SENSE, self.sensor[state] * passed),
        ]
        if self.duties:
            result += (IDLE, self.listening[state] * passed), (SWITCH, self.switching[state] * passed)
        return result

    def by_schedule(
        self,
        awake: Number,
        passed: Number,
        switched: Number,
        busy: Number | float = 0.0,
        computed: Number | float = 0.0,
        level: int = 0,
    ) -> list[tuple[int, Number]]:
        """(cause, joules) of a time in which a node follows its sleep schedule; for one node, or arrays of nodes.

        Args:
            awake: Seconds awake.
            passed: Seconds in total.
            switched: Joules of switching between awake and asleep.
            busy: Seconds of the time awake in which the radio is booked elsewhere.
            computed: Seconds of the time awake in which the processor is booked elsewhere.
            level: The level of the state.
        """
        asleep, awake_state = passed - awake, level * MODES + AWAKE
        result = [
            (self.radio_cause[awake_state], self.radio[awake_state] * (self.share[awake_state] * awake - busy)),
            (self.processor_cause[awake_state], self.processor[awake_state] * (awake - computed)),
            (SENSE, self.sensor[awake_state] * awake),
            (self.radio_cause[ASLEEP], self.radio[ASLEEP] * asleep),
            (self.processor_cause[ASLEEP], self.processor[ASLEEP] * asleep),
            (SWITCH, switched),
        ]
        if self.duties:
            result += (IDLE, self.listening[awake_state] * awake), (SWITCH, self.switching[awake_state] * awake)
        return result


def _switching(model: ContinuousPower) -> tuple[float, float, float]:
    """(s of a start and a stop of the radio together, J of a start, J of a stop)."""
    if not isinstance(model, SwitchesRadio):
        return 0.0, 0.0, 0.0
    (start_time, start), (stop_time, stop) = model.radio_start(), model.radio_stop()
    return start_time + stop_time, start, stop


class RadioLevels:
    """The radios of all nodes; without a duty-cycled MAC it holds nothing.

    Attributes:
        active: Whether the MAC is duty-cycled.
        added: {cause: (N,) joules that the MAC added to those of the duty since the node was settled; negative if it
            subtracted some}
    """

    def __init__(self, table: PowerTable, size: int) -> None:
        self.active = bool(table.duties)
        joules = np.zeros((2, size if self.active else 0))
        self.added = {IDLE: joules[0], SWITCH: joules[1]}
        self._listened, self._switched = scalars(joules[0]), scalars(joules[1])
        self._held: dict[int, tuple[float, bool]] = {}
        self._duty_level: dict[int, int] = {}
        self._scheduled_level: dict[int, int] = {}
        self._awake = [0.0] * (len(table.radio) // MODES)  # s of settled nodes with schedules, by level

    def is_held(self, node: int) -> bool:
        """Whether the radio of a node is held on."""
        return node in self._held

    def hold(self, node: int, now: float, on: bool) -> None:
        """A radio is held on from now on; `on`: it was on already."""
        self._held[node] = now, on

    def release(self, node: int) -> tuple[float, bool, int]:
        """A radio is no longer held; returns since when it was held, whether it was on before, and its level now."""
        since, on = self._held.pop(node)
        return since, on, self._duty_level.get(node, 0)

    def set_duty(self, node: int, index: int) -> int:
        """A node follows another duty; returns the level of that."""
        self._duty_level[node] = level = index + (index > 0)  # radios that are held on are at level 1
        return level

    def add(self, node: int, listened: float, switched: float) -> None:
        """Add joules of listening and of switching to the cost of a node's duty; they may be negative."""
        self._listened[node] += listened
        self._switched[node] += switched

    def of(self, node: int) -> tuple[float, float]:
        """Joules of listening and of switching that were added since a node was settled."""
        return (self._listened[node], self._switched[node]) if self.active else (0.0, 0.0)

    def with_added(self, node: int, charges: Charges) -> list[tuple[int, float]]:
        """The charges of a node's duty, listening and switching, with what was added."""
        (_, listened), (_, switched) = charges
        return [(IDLE, listened + self._listened[node]), (SWITCH, switched + self._switched[node])]

    def settle(self, node: int, charges: Charges, awake: float, level: int) -> None:
        """Carry over charges that are negative (more subtracted than accrued), and add awake seconds of schedules."""
        self._listened[node], self._switched[node] = (min(joules, 0.0) for _, joules in charges)
        if node in self._scheduled_level:
            self._awake[level] += awake

    def enter(self, node: int, level: int, scheduled: bool) -> None:
        """A settled node is at a level from now on; `scheduled`: it follows a sleep schedule."""
        self._scheduled_level.pop(node, None)
        if scheduled and level:
            self._scheduled_level[node] = level

    def forget(self, node: int) -> None:
        """Forget a node that goes down: its radio starts again at level 0."""
        self._held.pop(node, None)
        self._duty_level.pop(node, None)

    def awake(self, sleep_states: SleepStates, settled_at: Floats, now: float) -> list[float]:
        """Seconds for which nodes with schedules were awake at each level; 0 at level 0, which needs no correction."""
        result = list(self._awake)
        if self._scheduled_level:
            nodes = np.fromiter(self._scheduled_level, np.int64)
            awake, _ = sleep_states.tally(nodes, settled_at[nodes], now)
            for level, seconds in zip(self._scheduled_level.values(), awake.tolist(), strict=True):
                result[level] += seconds
        return result if self.active else []
