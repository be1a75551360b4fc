"""Recorded links: packet delivery ratios that were measured in a testbed, link by link and round by round.

    RecordedLinks(path="links.k7.gz", channel=26).heard(number, source) -> ids, powers, ratios

`base.radio` is the port by which the network asks for them; `k7file` reads the recording.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.errors import Issue, RunError, did_you_mean
from wsnsim.base.initial_conditions import joined_by_name, node_names
from wsnsim.base.part import Quantity, part
from wsnsim.base.radio import BurstyLosses, HeardLinks
from wsnsim.base.setups import Setup
from wsnsim.models.bounds import DURATION, LENGTH, PERIOD, PROBABILITY, number_of_nodes
from wsnsim.models.csvfile import demand_digest
from wsnsim.models.k7file import HIGHEST_CHANNEL, read_links
from wsnsim.models.link_recording import LinkRecording
from wsnsim.models.row_checks import row_texts


class _Played(NamedTuple):
    """The recording as a run plays it: R complete rounds of one channel, between the nodes of the scenario.

    Attributes:
        names: The recording's name of each node.
        lengths: (R,) duration of each round in s.
        ends: (R N,) end of the links of each round and sender in the arrays below.
        ids, powers, ratios: (n,) receivers, mean powers in dBm and ratios, by round, sender and receiver.
    """

    names: tuple[str, ...]
    lengths: Floats
    ends: Ints
    ids: Ints
    powers: Floats
    ratios: Floats


@part
class RecordedLinks:
    """Links that were recorded in a testbed: a frame arrives with the packet delivery ratio of its link and round.

    The recording is a K7 file. A round is one burst of packets of every sender on the channel. A link without a row in
    a round was not heard, and has the ratio 0 in that round: ratios are never taken from other rounds. The same holds
    for all links of a sender of which no node heard anything in a round, whether it was down or out of range. A first
    or last round in which senders of the next one are missing is left out, and so is a burst that the file's beginning
    or end may have cut: the rest of its round is played.

    The run begins with the round `start`. A round lasts as long as the recording took until the next one on this
    channel (the last one: the median), or `round_length`. Frames that overlap are both lost where both are heard. A
    node takes the channel for busy during the frames of every sender that it has heard in the round, however rarely,
    and the ratio holds for frames of any length (our choices: no more is known). The nodes of the recording are those
    of the deployment with the same names, or numbers; with `map`, node i is the recording's node `map[i]`, whatever its
    name. The places of nodes play no part in what is heard.

    With `burstiness: gilbert_elliott`, a link is good or bad, each for an exponentially distributed time. Bad states
    last `bad_time` on average, good ones so long that the stationary mean is the recorded ratio. A link whose ratio is
    not between `bad` and `good` loses frames independently. This is an assumption: the recording has means of whole
    bursts of packets, which say nothing of the order of losses.

    Source: Gilbert (1960), "Capacity of a burst-noise channel"; Elliott (1963), "Estimates of error rates for codes on
    burst-noise channels": two states with loss rates; that they last for times instead of bits is ours.
    """

    captures: ClassVar[bool] = False
    perfect: ClassVar[bool] = False
    audible: ClassVar[float] = math.inf

    path: Annotated[str, "K7 file with the recorded links, plain or compressed with gzip"]
    channel: Annotated[int, Quantity("", ge=0, le=HIGHEST_CHANNEL), "IEEE 802.15.4 channel of the recording"] = 26
    start: Annotated[int, Quantity("", ge=0), "round with which the run begins, from 0"] = 0
    round_length: Annotated[float | None, DURATION, "duration of a round; default: as it was recorded"] = None
    wrap: Annotated[bool, "whether the first round follows the last one; otherwise the run must not be longer"] = False
    map: Annotated[
        tuple[int | str, ...], "the recording's name of each node of the scenario, in their order; default: the same"
    ] = ()
    reach: Annotated[float, LENGTH, "distance for which a broadcast is amplified; it does not limit links"] = 75.0
    burstiness: Annotated[Literal["none", "gilbert_elliott"], "how losses of a link depend on each other"] = "none"
    bad_time: Annotated[float, PERIOD, "mean duration of a link's bad state"] = 1.0
    good: Annotated[float, PROBABILITY, "probability that a frame arrives in a good state"] = 1.0
    bad: Annotated[float, PROBABILITY, "probability that a frame arrives in a bad state"] = 0.0
    skip_bad_rows: Annotated[bool, "whether rows of the file that cannot be used are left out"] = False
    digest: Annotated[str, "digest of the file; '': that of the present file, which the result stores"] = ""

    def __post_init__(self) -> None:
        """Raises ValueError if a bad state is as good as a good one, or a node occurs twice."""
        if self.bad >= self.good:
            raise ValueError(f"bad must be less than good, got {self.bad:g} and {self.good:g}")
        names = [str(name) for name in self.map]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"map must name each node of the recording once, {twice[0]} stands there more often")

    @property
    def losses(self) -> BurstyLosses | None:
        """How losses of one link depend on each other; None if they are independent."""
        return None if self.burstiness == "none" else BurstyLosses(self.bad_time, self.good, self.bad)

    @cached_property
    def recording(self) -> LinkRecording:
        """The whole recording. Raises RunError with file and line if it cannot be used."""
        demand_digest(self.path, self.digest)
        return read_links(self.path, self.skip_bad_rows)

    def with_nodes(self, names: tuple[str, ...]) -> RecordedLinks:
        """The links between nodes of these names, unless `map` says which nodes they are in the recording."""
        return self if self.map else dataclasses.replace(self, map=names)

    @property
    def rounds(self) -> int:
        """The number of rounds of the channel that were recorded as a whole."""
        return int(self.recording.complete[self.channel].sum())

    def round_end(self, number: int) -> float:
        """The simulated time in s at which a round ends; `number` counts from 0, the round `start`."""
        lengths = np.roll(self._played.lengths, -self.start) if self.wrap else self._played.lengths[self.start :]
        if not self.wrap and number >= lengths.size - 1:
            return math.inf
        whole, rest = divmod(number + 1, lengths.size)
        return float(whole * lengths.sum() + lengths[:rest].sum())

    def heard(self, number: int, source: int) -> HeardLinks:
        """The links of a sender in a round; `number` counts from 0, the round `start`."""
        played = self._played
        at = (self.start + number) % played.lengths.size * len(played.names) + source
        here = slice(played.ends[at - 1] if at else 0, played.ends[at])
        return HeardLinks(played.ids[here], played.powers[here], played.ratios[here])

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) -inf: no link follows from a distance."""
        return np.full(np.shape(distances), -np.inf)

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) the probability over a link with ratio 1: 1 for a frame that is heard undisturbed, else 0."""
        return np.where(np.isfinite(powers) & (np.asarray(interference) <= 0.0), 1.0, 0.0)

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node takes the channel for busy: it does if it has heard the sender in this round."""
        return np.isfinite(powers)

    def skipped_rows(self, setup: Setup) -> list[str]:
        """The rows that are left out, a text each with file, line and reason."""
        return row_texts(self.path, self.recording.bad)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield issues: a file, a channel, nodes or rounds that there are not, or a run that lasts longer."""
        try:
            recording = self.recording
        except RunError as error:
            yield Issue(("link", "path"), str(error))
            return
        if self.channel not in recording.complete:
            known = ", ".join(map(str, recording.complete))
            yield Issue(("link", "channel"), f"{self.path} has no channel {self.channel}; it has {known}")
            return
        try:
            yield from self._unknown_nodes(setup, recording.nodes)
        except RunError as error:
            yield Issue(("link", "map"), f"{error}; name the recording's node of each node, in their order")
            return
        yield from self._missing_rounds(setup)

    def _unknown_nodes(self, setup: Setup, known: tuple[str, ...]) -> Iterator[Issue]:
        """Yield issues for names that the recording lacks, and if their number is not that of the scenario's nodes.

        Raises:
            RunError: the nodes of the scenario have no names, or none of them is in the recording.
        """
        nodes = number_of_nodes(setup.deploy)
        if not (self.map or hasattr(type(setup.deploy), "names")) and nodes not in (None, len(known)):
            said = f"{self.path} has {len(known)} nodes, but the scenario {nodes}: say which, in their order"
            yield Issue(("link", "map"), said)
            return
        names = tuple(map(str, self.map)) or node_names(setup, nodes)
        found = joined_by_name(names, known, "the nodes of the scenario", self.path)
        for i in np.flatnonzero(found < 0).tolist():
            near = did_you_mean(names[i], known)
            yield Issue(("link", "map", i), f"{self.path} has no node {names[i]} ({near})")
        if self.map and nodes not in (None, len(self.map)):
            yield Issue(("link", "map"), f"names {len(self.map)} nodes, but the scenario has {nodes}")

    def _missing_rounds(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the recording ends before the run, or before the run begins."""
        rounds = self.rounds
        if not rounds:
            yield Issue(("link", "channel"), f"{self.path} has no whole round of channel {self.channel}")
            return
        if self.start >= rounds:
            yield Issue(
                ("link", "start"), f"must be less than the {rounds} rounds of channel {self.channel}, is {self.start}"
            )
            return
        lasts = float(self._lengths()[self.start :].sum())
        if not self.wrap and setup.duration > lasts:
            yield Issue(
                ("link", "wrap"),
                f"the run of {setup.duration:g} s is longer than the {rounds - self.start} rounds from "
                f"link.start on, which last {lasts:g} s; give wrap: true, or a longer round_length",
            )

    def _lengths(self) -> Floats:
        """(R,) duration of each complete round in s."""
        complete, starts = self.recording.complete[self.channel], self.recording.starts[self.channel]
        if self.round_length is not None:
            return np.full(self.rounds, self.round_length)
        if starts.size == 1:
            on = self.recording.channels == self.channel
            return np.array([max(np.ptp(self.recording.times[on]), 1.0)])
        between = np.diff(starts)
        return np.append(between, np.median(between))[complete]

    @cached_property
    def _played(self) -> _Played:
        """The recording as a run plays it."""
        recording = self.recording
        names = tuple(map(str, self.map)) or recording.nodes
        ours = joined_by_name(recording.nodes, names, self.path, "the nodes of the scenario")
        complete = recording.complete[self.channel]
        number = np.cumsum(complete) - 1
        sources, ids = ours[recording.sources], ours[recording.receivers]
        chosen = (recording.channels == self.channel) & (recording.ratios > 0.0) & (sources >= 0) & (ids >= 0)
        chosen &= complete[np.minimum(recording.rounds, complete.size - 1)]
        senders = number[recording.rounds[chosen]] * len(names) + sources[chosen]
        order = np.lexsort((ids[chosen], senders))
        ends = np.searchsorted(senders[order], np.arange(self.rounds * len(names)), side="right")
        powers, ratios = recording.powers[chosen][order], recording.ratios[chosen][order]
        return _Played(names, self._lengths(), ends, ids[chosen][order], powers, ratios)
