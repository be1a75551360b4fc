"""Harvesters: what charges the batteries of nodes, from a trace of power or of irradiance."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.batteries import Income
from wsnsim.base.errors import RunError
from wsnsim.base.part import Quantity, part
from wsnsim.models import csvfile
from wsnsim.models.bounds import SHARE


@part
class Harvester:
    """A source of energy that charges the battery: a trace of power, or of irradiance on a panel.

    A row of the file holds until the next one. Before the first row there is nothing. After the last row the trace
    starts again if it `repeats`, one usual interval of rows later; otherwise there is nothing.
    """

    sheet: ClassVar[str] = ""

    path: Annotated[str, "CSV file, also .gz, with columns time (s) and either power (W) or irradiance (W/m²)"]
    area: Annotated[float, Quantity("m2", gt=0.0, le=1e6), "area of the panel, for a trace of irradiance"] = 0.01
    efficiency: Annotated[float, SHARE, "share of the irradiance on the panel that becomes power"] = 0.15
    charging: Annotated[float, SHARE, "share of the power that is stored; the rest is lost"] = 0.9
    restart: Annotated[float, SHARE, "share of the capacity at which a node that was empty starts again"] = 0.1
    repeats: Annotated[bool, "whether the trace starts again when it ends"] = False

    @cached_property
    def trace(self) -> tuple[Floats, Floats]:
        """Times (K + 1,) in s and the power (K,) in W from each to the next. Raises RunError if it cannot be read."""
        rows = csvfile.timed_rows(self.path, "powers", "power", "irradiance")
        given = dict(rows.numbers)
        times = given.pop("time")
        if len(given) != 1:
            raise RunError(f"{self.path}: give one of the columns power (W) and irradiance (W/m²), not {len(given)}")
        for row in np.flatnonzero(next(iter(given.values())) < 0.0)[:1].tolist():
            raise RunError(f"{self.path}:{rows.lines[row]}: a power is at least 0")
        watts = given["power"] if "power" in given else given["irradiance"] * self.area * self.efficiency
        lasts = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        return np.append(times, times[-1] + lasts), watts

    def income(self, time: float) -> Income:
        """The power that is offered at a time in s, and until when."""
        times, watts = self.trace
        turn = (time // times[-1]) * times[-1] if self.repeats else 0.0
        row = int(np.searchsorted(times, time - turn, side="right")) - 1
        if row >= len(watts):
            return Income(0.0, np.inf)
        return Income(float(watts[row]) if row >= 0 else 0.0, turn + float(times[row + 1]))
