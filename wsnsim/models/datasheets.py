"""Datasheets: the power of a radio and of a processor in each state, and the time and power of changes between states.

A scenario names a datasheet (`radio: cc2420`) or writes its fields. The files of the shipped datasheets give the
source of each value. The modulation of a radio gives its bit error rate, and the probability that a frame arrives.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.part import Quantity, part
from wsnsim.models.bounds import BIT_RATE, CLOCK_RATE, LEVEL, SPAN

Modulation: TypeAlias = Literal["oqpsk", "ncfsk"]
_K: Final = np.arange(2, 17)
_RATES: Final = 20.0 * (1.0 / _K - 1.0)
_WEIGHTS: Final = np.array([(-1) ** k * math.comb(16, k) for k in _K.tolist()]) / 30.0
_MOST_RATIO: Final = 1e3
"""Above this ratio the bit error rate is zero: exp(-500)."""


def bit_error(ratio: Floats, modulation: Modulation) -> Floats:
    """Return the probability of a bit error at ratios (not in dB) of signal to noise and interference.

    O-QPSK with 16 chip sequences: 8/15 · 1/16 · Σ_{k=2}^{16} (-1)^k C(16, k) exp(20 ratio (1/k - 1)).
    Non-coherent FSK: exp(-ratio / 2) / 2.

    Source: IEEE 802.15.4-2006, E.4.1.8, eq. 7; Proakis, "Digital communications", for FSK.
    """
    ratio = np.asarray(np.minimum(ratio, _MOST_RATIO))
    if modulation == "ncfsk":
        return 0.5 * np.exp(-0.5 * ratio)
    wrong = np.exp(ratio[..., None] * _RATES) @ _WEIGHTS
    return np.maximum(wrong, 0.0)


def success(error: Floats, bits: float) -> Floats:
    """Return the probability that none of the bits is wrong."""
    return np.exp(bits * np.log1p(-error))


@cache
def snr_for(probability: float, bits: float, modulation: Modulation) -> float:
    """Return the signal-to-noise ratio at which a frame of this length arrives with a probability (by bisection)."""
    low, high = 0.0, _MOST_RATIO
    for _ in range(200):
        middle = 0.5 * (low + high)
        arrives = float(success(bit_error(np.array(middle), modulation), bits))
        low, high = (middle, high) if arrives < probability else (low, middle)
    return high


def snr_at_sensitivity(modulation: Modulation) -> float:
    """Return the signal-to-noise ratio at which 1 % of PSDUs of 20 bytes are lost (IEEE 802.15.4-2006, 6.1.7)."""
    return snr_for(0.99, 160, modulation)


WATTS: Final = Quantity("W", ge=0.0, le=1e3)


class RadioSleep(NamedTuple):
    """A sleep state of a radio: its power in W, the time in s to listening, and the mean power in W of that time."""

    power: float
    wake: float
    wake_power: float


@part
class RadioSheet:
    """The datasheet of a radio: `transmit[i]` watts at `levels[i]` dBm of output power."""

    name: Annotated[str, "name of the radio"]
    source: Annotated[str, "the document with the values"]
    rate: Annotated[float, BIT_RATE, "bit rate on the air"]
    receive: Annotated[float, WATTS, "power while receiving a frame"]
    listen: Annotated[float, WATTS, "power in idle listening"]
    levels: Annotated[tuple[float, ...], LEVEL, "output powers that can be selected"]
    transmit: Annotated[tuple[float, ...], WATTS, "power while sending, at each of the output powers"]
    sleep: Annotated[float, WATTS, "power while asleep"]
    wake: Annotated[float, SPAN, "time from asleep to listening"]
    wake_power: Annotated[float, WATTS, "mean power from asleep to listening"]
    doze: Annotated[float, SPAN, "time from listening to asleep"]
    doze_power: Annotated[float, WATTS, "power from listening to asleep"]
    turnaround: Annotated[float, SPAN, "time between receiving and sending"]
    turnaround_power: Annotated[float, WATTS, "power between receiving and sending"]
    sensitivity: Annotated[float, LEVEL, "sensitivity of the receiver"]
    noise: Annotated[
        float, LEVEL, "noise floor of the receiver, for information: a link derives its own from the sensitivity"
    ]
    modulation: Annotated[Modulation, "oqpsk: IEEE 802.15.4 at 2.4 GHz; ncfsk: non-coherent FSK"] = "oqpsk"
    voltage: Annotated[
        float | None, Quantity("V", ge=0.0, le=100.0), "supply voltage at which the powers hold, for information"
    ] = None
    sleep_states: Annotated[tuple[str, ...], "names of the states that `energy.sleep_state` can select"] = ()
    sleep_powers: Annotated[tuple[float, ...], WATTS, "power in each of the sleep states"] = ()
    sleep_wakes: Annotated[tuple[float, ...], SPAN, "time from each sleep state to listening"] = ()
    sleep_wake_powers: Annotated[tuple[float, ...], WATTS, "mean power from each sleep state to listening"] = ()

    def __post_init__(self) -> None:
        """Raise ValueError if levels and powers, or the values of the sleep states, do not match."""
        if not self.levels:
            raise ValueError("levels must name at least one output power, such as [0]")
        if len(self.levels) != len(self.transmit):
            raise ValueError(f"levels has {len(self.levels)} items and transmit {len(self.transmit)}: one a level")
        if len(set(self.levels)) < len(self.levels):
            raise ValueError(f"levels names an output power twice: {', '.join(f'{x:g}' for x in self.levels)} dBm")
        for name in ("sleep_powers", "sleep_wakes", "sleep_wake_powers"):
            if len(getattr(self, name)) != len(self.sleep_states):
                count = len(getattr(self, name))
                raise ValueError(f"sleep_states has {len(self.sleep_states)} items and {name} {count}: one a state")

    def sleeping(self, state: str | None) -> RadioSleep:
        """The sleep state of a name; None: `sleep`, `wake` and `wake_power`.

        Raises:
            ValueError: the radio has no such state.
        """
        if state is None:
            return RadioSleep(self.sleep, self.wake, self.wake_power)
        at = self.sleep_states.index(state)
        return RadioSleep(self.sleep_powers[at], self.sleep_wakes[at], self.sleep_wake_powers[at])


@part
class ProcessorSheet:
    """The datasheet of a processor. A cycle costs `energy_per_cycle`, or `run / rate` if that is left out."""

    name: Annotated[str, "name of the processor"]
    source: Annotated[str, "the document with the values"]
    rate: Annotated[float, CLOCK_RATE, "clock rate"]
    run: Annotated[float, WATTS, "power while computing"]
    idle: Annotated[float, WATTS, "power while waiting with the clock running"]
    sleep: Annotated[float, WATTS, "power while sleeping with its memory kept"]
    wake: Annotated[float, SPAN, "time from sleeping to computing"]
    energy_per_cycle: Annotated[
        float | None, Quantity("J", ge=0.0, le=1.0), "energy of one cycle; left out: from `run` and `rate`"
    ] = None

    @property
    def cycle(self) -> float:
        """Joules of one cycle."""
        return self.run / self.rate if self.energy_per_cycle is None else self.energy_per_cycle
