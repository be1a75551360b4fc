"""A folder of recorded tracks, and the laws that are fitted to all but one of them.

recording(folder) -> TrackFolder      .tracks -> name, file, length, shape      .laws(name) -> fitted to the others
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.fitting.data_files import ReadingOptions, read_nodes, read_sample
from wsnsim.fitting.estimation import FitOptions, fit_sample
from wsnsim.fitting.fitted_law import LAWS, figures
from wsnsim.fitting.located_readings import SAME_SHARE, LocatedReadings, share
from wsnsim.fitting.result import Fit
from wsnsim.papers.toolkit import Bools, Floats, UsageError, open_text

RECEIVERS: Final = "receivers.csv"
TRACKS: Final = ("*.csv", "*.csv.gz")
FORM: Final = LAWS["rssi"]
BLOCK: Final = 10.0
"""Length (s) of the blocks for intervals, which are not used here."""
CLOSED: Final = 0.1
"""A track is rectangular if its end is nearer to its start than this share of its path (registered)."""
HEADER: Final = ("time", "receiver", "rssi", "x", "y")


class WalkedTrack(NamedTuple):
    """A track: its name, its file, its length in s and in m, and whether it returns to its start."""

    name: str
    path: Path
    seconds: float
    metres: float
    rectangular: bool


class Laws(NamedTuple):
    """The laws for a track, each as the mapping of a sensor `rssi`.

    Attributes:
        plain: path loss alone, with independent normal noise.
        gains: path loss and a gain of each receiver; the noise has the variance of all that is left.
        whole: the same with what is left split into a correlated part and an independent one of the fitted family.
        spread: standard deviation of the gains, in dB.
    """

    plain: Mapping[str, Any]
    gains: Mapping[str, Any]
    whole: Mapping[str, Any]
    spread: float


@dataclass(frozen=True)
class TrackFolder:
    """The tracks of a folder."""

    folder: Path
    tracks: tuple[WalkedTrack, ...]
    sample: LocatedReadings

    @property
    def nodes(self) -> Path:
        """The file of the receivers."""
        return self.folder / RECEIVERS

    @functools.cached_property
    def fits(self) -> dict[str, Fit]:
        """For each track, the law with gains that is fitted to all others."""
        count = len(self.tracks)
        return {
            track.name: fit_sample(
                self.sample.of([i for i in range(count) if i != index]), FORM, FitOptions(block=BLOCK)
            )
            for index, track in enumerate(self.tracks)
        }

    def laws(self, name: str) -> Laws:
        """The laws that are fitted to all tracks but this one."""
        fit = self.fits[name]
        plain = fit.plain
        whole = fit.sensor | {"fitted_on": list(fit.digests)}
        common: dict[str, Any] = {key: whole[key] for key in ("d0", "target_height", "fitted_on") if key in whole}
        columns = [column.name for column in FORM.coefficients]
        gains: dict[str, Any] = {"kind": "rssi", **{key: whole[key] for key in (*columns, "gains")}, **common}
        loss: dict[str, Any] = {
            "kind": "rssi",
            **dict(zip(columns, map(_rounded, plain.coefficients), strict=True)),
            **common,
        }
        spread = float(np.std(whole["gains"]))
        return Laws(
            loss | {"sd": _rounded(plain.noise.total)}, gains | {"sd": _rounded(fit.model.noise.total)}, whole, spread
        )

    def of(self, name: str) -> LocatedReadings:
        """The readings of a track."""
        return self.sample.of([index for index, track in enumerate(self.tracks) if track.name == name])


@functools.cache
def recording(folder: Path) -> TrackFolder:
    """The tracks of a folder: files with time, receiver, rssi, x and y (perhaps z), and `receivers.csv`.

    Raises:
        UsageError: there are no receivers, or fewer than two tracks; two files have one name or the same readings; a
            name cannot be that of a track.
        RunError: a file cannot be used; names file and line.
    """
    if not (folder / RECEIVERS).is_file():
        raise UsageError(f"{folder}: a folder of recorded tracks needs {RECEIVERS} with receiver, x and y (perhaps z)")
    files = [path for path in sorted({path for form in TRACKS for path in folder.glob(form)}) if _is_track(path)]
    if len(files) < 2:
        raise UsageError(
            f"{folder}: needs at least two tracks (CSV files with the columns {', '.join(HEADER)}), has {len(files)}: "
            "the law of a track is fitted to the others"
        )
    names = [path.name.removesuffix(".gz").removesuffix(".csv") for path in files]
    _check_names(files, names)
    nodes = read_nodes(str(folder / RECEIVERS), {})
    sample = read_sample([str(path) for path in files], nodes, FORM, ReadingOptions(skip_bad_rows=True))
    _check_independent(sample)
    own = [sample.tracks == index for index in range(len(files))]
    return TrackFolder(folder, tuple(map(functools.partial(_track, sample), names, files, own)), sample)


def _check_names(files: Sequence[Path], names: Sequence[str]) -> None:
    """Raises UsageError if two files are the same track, or if a name holds what separates the words of a variant."""
    named: dict[str, Path] = {}
    for path, name in zip(files, names, strict=True):
        if ", " in name:
            raise UsageError(f"{path}: the name of a track must not contain ', ', which separates words of variants")
        if name in named:
            raise UsageError(f"{named[name]} and {path} are both track '{name}': leave one of them in the folder")
        named[name] = path


def _check_independent(sample: LocatedReadings) -> None:
    """Raises UsageError if two tracks share readings: the law of one would be fitted to those of the other."""
    keys = [sample.keys(index) for index in range(len(sample.files))]
    for first, second in itertools.combinations(range(len(keys)), 2):
        if (part := share(keys[first], keys[second])) >= SAME_SHARE:
            raise UsageError(
                f"{sample.files[first].path} and {sample.files[second].path} share {part:.1%} of their readings: the "
                "law of a track is fitted to the others; leave one of them in the folder"
            )


def _is_track(path: Path) -> bool:
    """Whether the header of a file names the columns of a track."""
    with open_text(str(path)) as file:
        return set(HEADER) <= {name.strip() for name in file.readline().split(",")}


def _track(sample: LocatedReadings, name: str, path: Path, own: Bools) -> WalkedTrack:
    times: Floats = sample.times[own]
    metres = float(sample.travelled[own].max())
    ends = sample.points[own][[0, -1], :2]
    rectangular = math.dist(*ends.tolist()) < CLOSED * metres
    return WalkedTrack(name, path, float(times.max() - times.min()), metres, rectangular)


def _rounded(value: float) -> float:
    """The value with six significant digits."""
    return float(f"{value:.6g}")


SHORT: Final = 0.25
"""Readings of one receiver within this (s) are compared for the scatter at nearly one place."""


class TrackResiduals(NamedTuple):
    """The residuals of a track under the laws that are fitted to the others.

    Attributes:
        plain: (n,) under path loss alone.
        gains: (n,) with a gain of each receiver.
        sd: standard deviations (dB) of both, about zero.
        kurtosis: of both; 3 if normal.
        correlation: of both, at 1 s.
        scatter: standard deviation (dB) of readings of one receiver within 0.25 s, from their differences.
    """

    plain: Floats
    gains: Floats
    sd: tuple[float, float]
    kurtosis: tuple[float, float]
    correlation: tuple[float, float]
    scatter: float


def track_residuals(found: TrackFolder, name: str) -> TrackResiduals:
    """The residuals of a track."""
    sample, fit = found.of(name), found.fits[name]
    both = [figures(model, sample) for model in (fit.plain, fit.model)]
    return TrackResiduals(
        fit.plain.residuals(sample),
        fit.model.residuals(sample),
        (both[0].rmse, both[1].rmse),
        (both[0].kurtosis, both[1].kurtosis),
        (both[0].correlation, both[1].correlation),
        scatter(found, name),
    )


def scatter(found: TrackFolder, name: str) -> float:
    """The standard deviation (dB) of readings of one receiver that are less than 0.25 s apart; NaN without any."""
    sample = found.of(name)
    first, second = sample.pairs
    near = sample.times[second] - sample.times[first] < SHORT
    squares = (sample.readings[second][near] - sample.readings[first][near]) ** 2
    return math.sqrt(float(squares.mean()) / 2.0) if near.any() else math.nan


def heard_share(found: TrackFolder, name: str, step: float) -> float:
    """The share of receivers and steps in which a track has a reading."""
    sample = found.of(name)
    numbers = np.ceil((sample.times - sample.times.min()) / step - 1e-9).astype(np.int64)
    steps = math.floor(float(np.ptp(sample.times)) / step)
    kept = (numbers > 0) & (numbers <= steps)
    cells = np.unique(np.column_stack([numbers, sample.nodes])[kept], axis=0)
    return len(cells) / (steps * len(sample.deployment.ids))


def figures_in_words(found: TrackFolder) -> list[str]:
    """Lines on the residuals of all tracks."""
    every = [track_residuals(found, track.name) for track in found.tracks]
    gains = [gain for fit in found.fits.values() for gain in fit.sensor["gains"]]

    def span(values: list[float], form: str) -> str:
        known = [value for value in values if math.isfinite(value)]
        return f"{min(known):{form}} to {max(known):{form}}" if known else "unknown"

    lines = [f"gains of the receivers: {span(gains, '+.1f')} dB"]
    for word, at in (("under path loss alone", 0), ("with gains", 1)):
        lines.append(
            f"residuals {word}: {span([each.sd[at] for each in every], '.1f')} dB, kurtosis "
            f"{span([each.kurtosis[at] for each in every], '.1f')}, correlation at 1 s "
            f"{span([each.correlation[at] for each in every], '.2f')}"
        )
    pooled = span([each.scatter for each in every], ".1f")
    return [*lines, f"scatter of readings of one receiver within {SHORT:g} s: {pooled} dB"]
