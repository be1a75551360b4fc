"""What the air keeps count of, whichever way frames get the channel."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass


@dataclass(slots=True)
class Counters:
    """Totals of a run. `numbers`: of frames on the air, acknowledgements included; the others leave them out.

    `in_range`: receptions that frames could have had; `delivered`, `collided` of these. `access_failures`: frames
    given up because the channel was never free. `retries`: frames sent again because no acknowledgement came.
    """

    numbers: int = 0
    frames_sent: int = 0
    frames_lost: int = 0
    packets_sent: int = 0
    in_range: int = 0
    delivered: int = 0
    collided: int = 0
    access_failures: int = 0
    retries: int = 0


class Uses:
    """How often something was used in the present step: what random draws that belong to a step are numbered by."""

    def __init__(self) -> None:
        self._known: dict[Hashable, tuple[int, int]] = {}

    def next(self, thing: Hashable, step: int) -> int:
        """1 for the first use of a thing in a step, 2 for the second, and so on."""
        known, count = self._known.get(thing, (-1, 0))
        count = count + 1 if known == step else 1
        self._known[thing] = step, count
        return count
