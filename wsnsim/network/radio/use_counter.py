"""Numbers of repeated uses within one step, from which random keys are derived."""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple


class UseCounter:
    """Counts how often each link or sender was used in the present step.

    A random draw of a frame is derived from the step and this number. It therefore does not depend on earlier steps.
    """

    def __init__(self) -> None:
        self._uses: dict[Hashable, tuple[int, int]] = {}

    def next(self, user: Hashable, step: int) -> int:
        """Return 1 for the first use in a step, 2 for the second, and so on."""
        last_step, count = self._uses.get(user, (-1, 0))
        count = count + 1 if last_step == step else 1
        self._uses[user] = step, count
        return count


class LossSamples(NamedTuple):
    """The key of the random losses of a network, and the numbers of the frames that may be lost."""

    key: int
    uses: UseCounter
