"""What the readings themselves say: residuals under the laws of the other tracks, scatter, and how many were heard.

track_residuals(tracks, name) -> TrackResiduals      figures_in_words(tracks) -> [line, ...]
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.fitting.fitted_law import figures
from wsnsim.papers.reality.recording import TrackFolder

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
    return len(cells) / (steps * len(sample.ids))


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
