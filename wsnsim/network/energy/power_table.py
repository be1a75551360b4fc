"""The power of a node in each state. A state is a mode and a level: what the radio does while the node listens.

    state = level * MODES + mode

Level 0 is that of a node at the start: its radio listens always, or follows the first duty of a duty-cycled MAC. With
such a MAC, the radio listens at level HELD, and follows one of the other duties at the levels after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeVar

from wsnsim.base.arrays import Floats
from wsnsim.base.medium_access import RadioDuty, SwitchesRadio
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.tables import CAUSE, CAUSES

IDLE, SLEEP, SENSE, SWITCH = CAUSE["idle"], CAUSE["sleep"], CAUSE["sense"], CAUSE["switch"]
ON: Final = len(CAUSES)
"""Stands for a cause: the seconds in which radios are on are added up as joules are."""
MODES: Final = len(Mode)
HELD: Final = 1
"""The level of a radio that a duty-cycled MAC has switched on."""
AWAKE, ASLEEP, SCHEDULED = int(Mode.AWAKE), int(Mode.ASLEEP), int(Mode.SCHEDULED)
Number = TypeVar("Number", float, Floats)


def level_of(duty: int) -> int:
    """Return the level at which radios follow a duty, given its number."""
    return duty if duty == 0 else duty + 1


class PowerTable:
    """The power of a node in each state.

    Lists have one item a state. In SCHEDULED it is that of the time awake.

    Attributes:
        model: The energy model.
        duties: The duties of the MAC; none if radios listen always.
        radio: W of the radio while it does what it does by default: listen, or sleep if it follows a duty. Not charged
            while it sends or receives.
        radio_cause: On which that is booked.
        share: Share of the time in which it does that.
        listening: W of listening beside it, by the duty; mean over its interval.
        switching: W of the starts and stops of the radio, by the duty; mean over its interval.
        processor: W of the processor.
        processor_cause: On which that is booked.
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
            searching: Power in W that a node which is awake spends on measurements, to find targets.
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
        self.radio: list[float] = []
        self.share: list[float] = []
        self.listening: list[float] = []
        self.switching: list[float] = []
        self.processor: list[float] = []
        self.sensor: list[float] = []
        self.on: list[float] = []
        self.off: list[float] = []
        self.radio_cause: list[int] = []
        self.processor_cause: list[int] = []
        self.scheduled: list[bool] = []
        for duty in levels:
            for mode in Mode:
                self._add(mode, duty, searching, standby)

    def _add(self, mode: Mode, duty: RadioDuty | None, searching: float, standby: float) -> None:
        """Add the state of a mode and a duty; None: the radio listens."""
        power = self.model.mode_power(Mode.AWAKE if mode is Mode.SCHEDULED else mode)
        radio, cause = float(power.radio), SLEEP if power.radio_sleeps else IDLE
        if mode is Mode.ASLEEP:
            radio += standby
        listens = mode not in (Mode.ASLEEP, Mode.DOWN)
        share, listening, switching, on = 1.0, 0.0, 0.0, 1.0 if listens else 0.0
        if listens and duty is not None and duty.on < duty.interval:
            on, rate = duty.on / duty.interval, duty.starts / duty.interval
            share = max(1.0 - on - rate * self._switch_time, 0.0)
            listening, switching = radio * on, rate * (self.start + self.stop)
            radio, cause = self._off if share else 0.0, SLEEP
        self.radio.append(radio)
        self.radio_cause.append(cause)
        self.share.append(share)
        self.listening.append(listening)
        self.switching.append(switching)
        self.processor.append(float(power.processor))
        self.processor_cause.append(SLEEP if power.processor_sleeps else IDLE)
        self.sensor.append(searching if mode in (Mode.AWAKE, Mode.SCHEDULED) else 0.0)
        self.on.append(on)
        self.off.append(1.0 if on < 1.0 else 0.0)
        self.scheduled.append(mode is Mode.SCHEDULED)

    def powers(self, state: int) -> list[tuple[int, float]]:
        """(cause, W) of a state other than SCHEDULED, with ON if the MAC is duty-cycled."""
        result = [
            (self.radio_cause[state], self.radio[state] * self.share[state]),
            (self.processor_cause[state], self.processor[state]),
            (SENSE, self.sensor[state]),
        ]
        if self.duties:
            result += (IDLE, self.listening[state]), (SWITCH, self.switching[state]), (ON, self.on[state])
        return result

    def total(self, state: int) -> float:
        """W of a state other than SCHEDULED."""
        power = self.radio[state] * self.share[state] + self.processor[state] + self.sensor[state]
        return power + self.listening[state] + self.switching[state] if self.duties else power

    def largest(self) -> float:
        """W of the dearest state."""
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
        """(cause, joules) of a time by schedule of which a part is awake, at a level. Numbers, or arrays.

        Args:
            awake: Seconds awake.
            passed: Seconds in total.
            switched: Joules of switching between awake and asleep.
            busy: Seconds of the time awake in which the radio is booked elsewhere.
            computed: Seconds of the time awake in which the processor is booked elsewhere.
            level: The level of the state.
        """
        asleep, up = passed - awake, level * MODES + AWAKE
        result = [
            (self.radio_cause[up], self.radio[up] * (self.share[up] * awake - busy)),
            (self.processor_cause[up], self.processor[up] * (awake - computed)),
            (SENSE, self.sensor[up] * awake),
            (self.radio_cause[ASLEEP], self.radio[ASLEEP] * asleep),
            (self.processor_cause[ASLEEP], self.processor[ASLEEP] * asleep),
            (SWITCH, switched),
        ]
        if self.duties:
            result += (IDLE, self.listening[up] * awake), (SWITCH, self.switching[up] * awake)
        return result


def _switching(model: ContinuousPower) -> tuple[float, float, float]:
    """Seconds of a start and a stop of the radio together, joules of a start, and of a stop."""
    if not isinstance(model, SwitchesRadio):
        return 0.0, 0.0, 0.0
    (up, start), (down, stop) = model.radio_start(), model.radio_stop()
    return up + down, start, stop
