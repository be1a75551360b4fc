"""Datasheets: what a radio and a processor draw in each of their states, and what changing between them takes.

A scenario names a sheet (`radio: cc2420`) or writes its fields. The files of those that come with wsnsim say for each
value where it comes from.
"""

from __future__ import annotations

from typing import Annotated, Final

from wsnsim.base.part import Quantity, part
from wsnsim.models.modulation import Modulation

WATTS: Final = Quantity("W", ge=0.0, le=1e3)
SECONDS: Final = Quantity("s", ge=0.0, le=10.0)
LEVEL: Final = Quantity("dBm", ge=-200.0, le=60.0)


@part
class RadioSheet:
    """A radio by its datasheet: `transmit[i]` watts at `levels[i]` dBm of output power."""

    name: Annotated[str, "of the radio"]
    source: Annotated[str, "the document that the values come from"]
    rate: Annotated[float, Quantity("bit/s", ge=1.0, le=1e12), "of the air"]
    receive: Annotated[float, WATTS, "while it receives a frame"]
    listen: Annotated[float, WATTS, "while it listens and nothing comes"]
    levels: Annotated[tuple[float, ...], LEVEL, "output powers that can be set"]
    transmit: Annotated[tuple[float, ...], WATTS, "while it sends, at each of the output powers"]
    sleep: Annotated[float, WATTS, "while it is off"]
    wake: Annotated[float, SECONDS, "from off to listening"]
    wake_power: Annotated[float, WATTS, "meanwhile"]
    doze: Annotated[float, SECONDS, "from listening to off"]
    doze_power: Annotated[float, WATTS, "meanwhile"]
    turnaround: Annotated[float, SECONDS, "between receiving and sending"]
    turnaround_power: Annotated[float, WATTS, "meanwhile"]
    sensitivity: Annotated[float, LEVEL, "of the receiver"]
    noise: Annotated[float, LEVEL, "noise floor of the receiver, to know: a link derives its own from the sensitivity"]
    modulation: Annotated[Modulation, "oqpsk: IEEE 802.15.4 at 2.4 GHz; ncfsk: non-coherent FSK"] = "oqpsk"

    def __post_init__(self) -> None:
        """Refuse levels without their powers. Raises ValueError."""
        if not self.levels:
            raise ValueError("levels must name at least one output power, such as [0]")
        if len(self.levels) != len(self.transmit):
            raise ValueError(f"levels has {len(self.levels)} items and transmit {len(self.transmit)}: one a level")
        if len(set(self.levels)) < len(self.levels):
            raise ValueError(f"levels names an output power twice: {', '.join(f'{x:g}' for x in self.levels)} dBm")


@part
class ProcessorSheet:
    """A processor by its datasheet. It computes at `rate`; a cycle costs `run / rate` where there is no figure."""

    name: Annotated[str, "of the processor"]
    source: Annotated[str, "the document that the values come from"]
    rate: Annotated[float, Quantity("Hz", ge=1.0, le=1e12), "of its clock"]
    run: Annotated[float, WATTS, "while it computes"]
    idle: Annotated[float, WATTS, "while it waits, its clock running"]
    sleep: Annotated[float, WATTS, "while it sleeps, its memory kept"]
    wake: Annotated[float, SECONDS, "from sleeping to computing"]
    energy_per_cycle: Annotated[
        float | None, Quantity("J", ge=0.0, le=1.0), "of computing; left out: from `run` and `rate`"
    ] = None

    @property
    def cycle(self) -> float:
        """Joules of one cycle."""
        return self.run / self.rate if self.energy_per_cycle is None else self.energy_per_cycle
