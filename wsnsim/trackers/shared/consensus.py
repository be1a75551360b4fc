"""Average consensus over the participants of a network without a head: one loop for all filters, and their number.

    yield from neighbourhood(rounds)                  each learns its neighbours and, in several rounds, who there is
    yield from average(rounds, weights)               of the vectors in the members' memories

Each round is a broadcast of every participant.
`metropolis`: x_i += Σ_j w_ij (x_j - x_i), w_ij = 1 / (1 + max(d_i, d_j)) by the numbers of neighbours d (Metropolis
weights; Xiao, Boyd, Lall 2005): symmetric, so that the mean stays, as long as no frame is lost.
`ratio`: two sums that are divided in the end, of which each node passes equal shares on; it sends running sums, so that
a later frame brings what a lost one would have (Hadjicostis, Vaidya, Domínguez-García 2016).
A parcel of which a packet is lost counts as lost. A neighbour whose frame of the count is lost counts once it is heard;
until then both give its values another weight in the mean.
"""

from __future__ import annotations

from functools import partial
from typing import Final, Literal, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.requests import Exchange, Flow, Local, Member, Parcel
from wsnsim.trackers.shared.peers import received
from wsnsim.trackers.shared.readings import number_packets, parcel

ConsensusWeights: TypeAlias = Literal["metropolis", "ratio"]
VALUES: Final = "values"
"""In a member's memory: the vector (n,) that is averaged."""
NEIGHBOURS: Final = "neighbours"
"""The number of neighbours that the member has heard."""
KNOWN: Final = "known"
_NEW: Final = "new"
_SUM: Final = "sum"
_HEARD: Final = "heard"


def neighbourhood(rounds: int = 1) -> Flow[None]:
    """Let each participant count its neighbours and, over so many hops, all participants: they pass on who they know.

    The first round is one packet each, the ids of later ones are those that a participant has learned in the last.
    """
    yield Local(_introduce, 1.0)
    for number in range(rounds):
        yield Exchange(_introduction)
        yield Local(partial(_learn, first=number == 0), _learn_cycles)


def counted(member: Member) -> int:
    """How many participants a member knows of, itself included."""
    return len(member.memory[KNOWN])


def average(rounds: int, weights: ConsensusWeights) -> Flow[None]:
    """Average `VALUES` over the participants, who know the numbers of their neighbours."""
    mix = _mix_ratio if weights == "ratio" else _mix
    if weights == "ratio":
        yield Local(_open_sums, _mix_cycles)
    for _ in range(rounds):
        yield Exchange(partial(_values, weights=weights))
        yield Local(mix, _mix_cycles)
    if weights == "ratio":
        yield Local(_close_sums, _mix_cycles)


def _introduce(member: Member) -> None:
    member.memory[KNOWN] = member.memory[_NEW] = (member.id,)


def _introduction(member: Member) -> Parcel | None:
    """The ids that a member has learned last; None if these are none."""
    ids = member.memory[_NEW]
    return parcel(ids, number_packets(len(ids)), "known") if ids else None


def _learn(member: Member, first: bool) -> None:
    heard = received(member, "known")
    if first:
        member.memory[NEIGHBOURS] = len(heard)
    known = set(member.memory[KNOWN])
    new = sorted({node for _, ids in heard for node in ids} - known)
    member.memory[KNOWN], member.memory[_NEW] = tuple(sorted(known.union(new))), tuple(new)


def _learn_cycles(member: Member) -> float:
    return float(len(member.memory[KNOWN]))


def _values(member: Member, weights: ConsensusWeights) -> Parcel:
    """What a member sends in a round: its vector and the number of its neighbours, or its running sum."""
    if weights == "ratio":
        sums = member.memory[_SUM]
        return parcel(sums.copy(), number_packets(sums.size), "consensus")
    values = member.memory[VALUES]
    content = (values.copy(), member.memory[NEIGHBOURS])
    return parcel(content, number_packets(values.size + 1), "consensus")


def _mix(member: Member) -> None:
    heard, values = received(member, "consensus"), member.memory[VALUES]
    own, mixed = _counted_neighbours(member, len(heard)), values.copy()
    for _, (other, neighbours) in heard:
        mixed += (other - values) / (1.0 + max(own, neighbours))
    member.memory[VALUES] = mixed


def _counted_neighbours(member: Member, heard: int) -> int:
    """The number of neighbours, which is at least as many as are heard: frames of the count may have been lost."""
    member.memory[NEIGHBOURS] = number = max(int(member.memory[NEIGHBOURS]), heard)
    return number


def _mix_cycles(member: Member) -> float:
    return 3.0 * (1 + int(member.memory[NEIGHBOURS])) * int(member.memory[VALUES].size)


def _open_sums(member: Member) -> None:
    member.memory[VALUES] = np.append(member.memory[VALUES], 1.0)
    member.memory[_SUM], member.memory[_HEARD] = _share(member), {}


def _mix_ratio(member: Member) -> None:
    """Take the own share and what the running sums of neighbours have grown by; pass shares of that on."""
    heard = member.memory[_HEARD]
    values = _share(member)
    for source, sums in received(member, "consensus"):
        values += sums - heard.get(source, 0.0)
        heard[source] = sums.copy()
    member.memory[VALUES] = values
    _counted_neighbours(member, len(heard))
    member.memory[_SUM] = member.memory[_SUM] + _share(member)


def _share(member: Member) -> Floats:
    share: Floats = member.memory[VALUES] / (1.0 + member.memory[NEIGHBOURS])
    return share


def _close_sums(member: Member) -> None:
    values = member.memory[VALUES]
    member.memory[VALUES] = values[:-1] / values[-1]
