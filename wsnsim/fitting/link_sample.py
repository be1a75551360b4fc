"""Recorded links of one or several files as arrays: rows, pairs of nodes, and their distances.

A delivery curve gives the ratio of frames by their power above the sensitivity, as the link `log_normal` has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import joined_by_name
from wsnsim.fitting.data_files import digest_of, read_nodes, unread_names
from wsnsim.fitting.fitted_law import FittedValue
from wsnsim.fitting.located_readings import DataFile
from wsnsim.models.datasheets import bit_error, snr_at_sensitivity, success
from wsnsim.models.k7file import read_links
from wsnsim.models.link_recording import LinkRecording

CLEAR: Final = 0.9
"""Bursts with at least this delivery ratio have a mean power that is not biased by the packets that were lost."""


def delivery(above: Floats, frame: int) -> Floats:
    """The delivery ratio of frames of so many bytes at powers `above` the sensitivity (dB), without interference."""
    ratio = snr_at_sensitivity("oqpsk") * 10.0 ** (np.asarray(above) / 10.0)
    return success(bit_error(ratio, "oqpsk"), 8.0 * frame)


def margin(frame: int) -> float:
    """The power (dB) above the sensitivity from which bursts are clear."""
    above = np.linspace(-10.0, 20.0, 3001)
    return float(above[np.argmax(delivery(above, frame) >= CLEAR)])


def mean_power(distances: Floats, power: float, values: Mapping[str, FittedValue]) -> Floats:
    """(n,) mean received power in dBm of a transmitter of `power` dBm over these distances, in m."""
    loss, exponent = values["loss_at_1m"].value, values["exponent"].value
    return power - loss - 10.0 * exponent * np.log10(np.maximum(distances, 1.0))


LinkKeys: TypeAlias = frozenset[tuple[float, str, str, int, float]]


@dataclass(frozen=True)
class LinkRows:
    """Bursts that were heard, of all files.

    Attributes:
        sources: (n,) index of the sender.
        receivers: (n,) index of the receiver.
        powers: (n,) mean received power in dBm.
        ratios: (n,) packet delivery ratio.
        nodes: names of the nodes.
        places: (N, 3) of the nodes in m, NaN for an unknown z; None without positions.
        files: the files.
        keys: of each file, the time, sender, receiver, channel and power of each burst.
    """

    sources: Ints
    receivers: Ints
    powers: Floats
    ratios: Floats
    nodes: tuple[str, ...]
    places: Floats | None
    files: tuple[DataFile, ...]
    keys: tuple[LinkKeys, ...]

    @cached_property
    def directed(self) -> Floats:
        """(N, N) mean power of clear bursts from each node to each other; NaN without any."""
        count = len(self.nodes)
        clear = self.ratios >= CLEAR
        cells = (self.sources * count + self.receivers)[clear]
        numbers = np.bincount(cells, minlength=count * count)
        sums = np.bincount(cells, self.powers[clear], count * count)
        means = np.full(count * count, np.nan)
        means[numbers > 0] = sums[numbers > 0] / numbers[numbers > 0]
        return means.reshape(count, count)

    @cached_property
    def pairs(self) -> tuple[Ints, Ints]:
        """(P,), (P,) both nodes of each pair."""
        first, second = np.triu_indices(len(self.nodes), 1)
        return first.astype(np.int64), second.astype(np.int64)

    @property
    def differences(self) -> Floats:
        """(P,) mean power of one direction minus that of the other, of each pair; NaN where one was not clear."""
        first, second = self.pairs
        return self.directed[first, second] - self.directed[second, first]

    @property
    def means(self) -> Floats:
        """(P,) mean power of both directions of a pair, or of the only clear one; -inf where none was."""
        first, second = self.pairs
        both = np.stack([self.directed[first, second], self.directed[second, first]])
        heard: Bools = np.isfinite(both)
        sums = np.where(heard, both, 0.0).sum(axis=0)
        return np.where(heard.any(axis=0), sums / np.maximum(heard.sum(axis=0), 1), -np.inf)

    @property
    def distances(self) -> Floats:
        """(P,) distance in m between the nodes of each pair, at least 1 m; in space if all heights are known."""
        assert self.places is not None, "only links between nodes at known places have distances"
        first, second = self.pairs
        axes = 3 if np.isfinite(self.places[:, 2]).all() else 2
        apart = (self.places[first] - self.places[second])[:, :axes]
        result: Floats = np.maximum(np.sqrt((apart**2).sum(axis=1)), 1.0)
        return result


def read_link_rows(
    files: Sequence[str], nodes: str | None, columns: Mapping[str, str], skip_bad_rows: bool
) -> LinkRows:
    """The bursts of K7 files, with the places of their nodes if a file has them.

    Raises:
        RunError: a file cannot be used, or the place of a node is missing; the message names file and line.
    """
    recordings = [read_links(file, skip_bad_rows) for file in files]
    names = tuple(dict.fromkeys(name for recording in recordings for name in recording.nodes))
    parts: list[tuple[Ints, Ints, Floats, Floats]] = []
    described = []
    for file, recording in zip(files, recordings, strict=True):
        heard = np.isfinite(recording.powers)
        own = joined_by_name(recording.nodes, names, file, "all recorded links")
        parts.append((
            own[recording.sources[heard]], own[recording.receivers[heard]],
            recording.powers[heard], recording.ratios[heard],
        ))  # fmt: skip
        bad = tuple(f"{file}:{row.line}: {row.reason}" for row in recording.bad)
        described.append(DataFile(file, digest_of(file), int(heard.sum()), bad))
    sources, receivers, powers, ratios = (np.concatenate(column) for column in zip(*parts, strict=True))
    places = None if nodes is None else _places(nodes, names, columns)
    return LinkRows(sources, receivers, powers, ratios, names, places, tuple(described), tuple(map(_keys, recordings)))


def _keys(recording: LinkRecording) -> LinkKeys:
    """The time, sender, receiver, channel and power of each burst that was heard."""
    heard = np.isfinite(recording.powers)
    names = np.array(recording.nodes)
    columns = (
        recording.origin + recording.times, names[recording.sources], names[recording.receivers],
        recording.channels, recording.powers,
    )  # fmt: skip
    return frozenset(zip(*(column[heard].tolist() for column in columns), strict=True))


def _places(path: str, names: Sequence[str], columns: Mapping[str, str]) -> Floats:
    """(N, 3) the places of the nodes of these names."""
    table = read_nodes(path, columns)
    found = joined_by_name(names, table.ids, "the recorded links", path, lambda: unread_names(path, columns))
    if missing := [name for name, node in zip(names, found, strict=True) if node < 0]:
        raise RunError(f"{path}: lacks the place of {len(missing)} nodes of the links, such as '{missing[0]}'")
    return table.places[found]
