"""The optional port of a link model whose links are given one by one, instead of by distance, and change in time."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Floats, Ints


class HeardLinks(NamedTuple):
    """The links of one sender in one round.

    Attributes:
        ids: (n,) the nodes that hear it, ascending.
        powers: (n,) received power in dBm.
        ratios: (n,) probability that a frame arrives.
    """

    ids: Ints
    powers: Floats
    ratios: Floats


class BurstyLosses(NamedTuple):
    """The Gilbert-Elliott model of a link: it is good or bad, each for an exponentially distributed time.

    Attributes:
        bad_time: Mean duration of a bad state in s.
        good: Probability that a frame arrives in a good state.
        bad: The same in a bad state.
    """

    bad_time: float
    good: float
    bad: float


@runtime_checkable
class RecordsLinks(Protocol):
    """Optional port of a link model that knows each link by itself, for one round after the other."""

    @property
    def losses(self) -> BurstyLosses | None:
        """How losses of one link depend on each other; None if they are independent."""

    def round_end(self, number: int) -> float:
        """The simulated time in s at which a round ends; `number` counts from 0. Infinity: it is the last one."""

    def heard(self, number: int, source: int) -> HeardLinks:
        """The links of a sender in a round."""
