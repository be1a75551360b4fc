"""What the air keeps count of, whichever way frames get the channel."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Counts:
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
