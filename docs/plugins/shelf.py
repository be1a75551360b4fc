"""A battery that has stood on a shelf, and has less than its nominal charge."""

from typing import Annotated

from wsnsim import Quantity, part
from wsnsim.plugins import BatteryFields


@part
class Shelf(BatteryFields):
    """A battery that has lost a share of its charge in each year before the run."""

    years: Annotated[float, Quantity("", ge=0.0, le=20.0), "years on the shelf"] = 2.0
    fading: Annotated[float, Quantity("", ge=0.0, lt=1.0), "share lost in each"] = 0.03

    def nominal(self, battery):
        return battery * (1.0 - self.fading) ** self.years
