"""Filters that average information over all participants: the information-weighted and the hybrid consensus filter.

Local: predict  neighbourhood  Exchange: information  Local: average ...  Local: update      the requests of a step
"""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow, Local, Member
from wsnsim.trackers.shared.consensus import VALUES, ConsensusWeights, average, counted, neighbourhood
from wsnsim.trackers.shared.peers import (
    PeerFilter,
    information_of,
    inversion_cycles,
    news_of,
    packed,
    store,
    unpacked,
    widened,
)

MOST = 10**6


@part
class AveragingFilter(PeerFilter):
    """What both filters share: rounds of average consensus, and the number of participants N.

    A subclass gives `values` and `update`.

    One further round of a packet each tells the participants their numbers of neighbours; if they are to count all
    participants, as many further rounds as those of the consensus tell them the ids of all within so many hops.
    """

    rounds: Annotated[int, Quantity("", ge=1, le=1000), "rounds of consensus in a step"] = 5
    weights: Annotated[ConsensusWeights, "how values are averaged: ratio where frames are lost"] = "metropolis"
    participants: Annotated[
        int | None, Quantity("", ge=1, le=MOST), "number of participants N; left out: counted, which is paid"
    ] = None

    def values(self, member: Member, scene: Scene) -> Floats:
        """The vector that is averaged."""
        raise NotImplementedError

    def update(self, member: Member, scene: Scene) -> None:
        """The belief that follows from the average."""
        raise NotImplementedError

    def fused(self, scene: Scene) -> Flow[None]:
        """The rounds, and the update."""
        cycles = 2.0 * inversion_cycles(len(scene.motion.columns))
        yield from neighbourhood(1 if self.participants is not None else self.rounds)
        yield Local(partial(self._open, scene=scene), cycles)
        yield from average(self.rounds, self.weights)
        yield Local(partial(self.update, scene=scene), cycles)

    def _open(self, member: Member, scene: Scene) -> None:
        member.memory[VALUES] = self.values(member, scene)

    def number(self, member: Member) -> int:
        """N, as it is given or as a participant has counted it."""
        return counted(member) if self.participants is None else self.participants


@part
class InformationConsensus(AveragingFilter):
    """Information-weighted consensus filter: the mean of J / N and the readings' information, times N.

    With equal priors, the right N, no loss and many rounds it is the central filter. Where the prior is nearly the same
    everywhere, a prior that counts 1 / N at each of N participants counts once.

    Source: Kamal, Farrell, Roy-Chowdhury (2013), algorithm 1.
    """

    def values(self, member: Member, scene: Scene) -> Floats:
        """v = J x / N + h and V = J / N + H."""
        vector, matrix = information_of(member)
        read, seen = widened(news_of(member, scene), scene)
        number = self.number(member)
        return packed(vector / number + read, matrix / number + seen)

    def update(self, member: Member, scene: Scene) -> None:
        """x⁺ = V⁻¹ v and J⁺ = N V."""
        vector, matrix = unpacked(member.memory[VALUES])
        number = self.number(member)
        store(member, number * vector, number * matrix)


@part
class HybridConsensus(AveragingFilter):
    """Hybrid consensus on measurements and on information: priors and readings are averaged apart.

    J⁺ = J̄ + N H̄ and J⁺ x⁺ = (J x)‾ + N h̄: the mean of priors is a covariance intersection, so that it never counts what
    they have in common twice; the readings, which have nothing in common, count fully. Where all participants know the
    same N this is the information-weighted filter, for more numbers in a parcel; it differs where they count different
    N, and with `participants: 1`, which is the cautious choice ω = 1.

    Source: Battistelli, Chisci, Mugnai, Farina, Graziano (2015), with ω = N.
    """

    def values(self, member: Member, scene: Scene) -> Floats:
        """J x and J, then h and H of the position."""
        return np.concatenate([packed(*information_of(member)), news_of(member, scene)])

    def update(self, member: Member, scene: Scene) -> None:
        """The correction."""
        values, size = member.memory[VALUES], len(scene.motion.columns)
        prior = size * (size + 3) // 2
        vector, matrix = unpacked(values[:prior])
        read, seen = widened(values[prior:], scene)
        number = self.number(member)
        store(member, vector + number * read, matrix + number * seen)
