"""A law fitted to readings, and what a fit to recorded links has found, with their texts and figures."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError
from wsnsim.base.version import __version__
from wsnsim.fitting import texts
from wsnsim.fitting.data_files import digest_of, names_in
from wsnsim.fitting.fitted_law import FittedLaw, FittedValue
from wsnsim.fitting.link_sample import LinkRows, mean_power
from wsnsim.fitting.located_readings import DataFile
from wsnsim.fitting.texts import bad_row_notes, block_lines, file_json, file_text, interval_text, one_line, table_lines


@dataclass(frozen=True)
class Fit(FittedLaw):
    """A law fitted to recorded readings: `sensor` is its block in a scenario, `values` and `gains` have intervals."""

    def yaml(self, recorded: Mapping[str, Any] | None = None) -> str:
        """The block `sensor` as text that a scenario can extend, with its origin in comments.

        Args:
            recorded: the keys of a sensor with recorded readings, as `recorded_sensor` gives them; without them the
                sensor samples its readings from the law.
        """
        return texts.sensor_yaml(self, recorded)

    def recorded_sensor(
        self,
        readings: str | os.PathLike[str],
        folder: str | os.PathLike[str] = ".",
        columns: Mapping[str, str] | None = None,
        in_sample: bool = False,
    ) -> dict[str, Any]:
        """The keys of `sensor: {kind: recorded}` without its law, for a file of readings.

        Args:
            readings: CSV file with the columns time, node and reading.
            folder: where the path of the file begins in the scenario.
            columns: the file's name of each of our columns that has an unusual one.
            in_sample: whether the law may be judged on readings that it was fitted to.

        Raises:
            UsageError: the law was fitted to these readings, and `in_sample` is not said.
            RunError: the file cannot be read.
        """
        path, form = os.fspath(readings), self.model.form
        names = names_in(path, columns or {}, ("reading", form.kind))
        fitted = digest_of(path) in self.sensor.get("fitted_on", ())
        if fitted and not in_sample:
            raise UsageError(f"{path}: the law was fitted to these readings; give others, or say in_sample")
        block = {"kind": "recorded", "path": os.path.relpath(path, folder)}
        others = {ours: names[ours] for ours in ("time", "node", "reading") if names[ours] != ours}
        return block | ({"columns": others} if others else {}) | ({"in_sample": True} if fitted else {})

    def text(self) -> str:
        """The estimates and figures as tables."""
        return texts.fit_text(self)

    def as_json(self) -> dict[str, Any]:
        """All figures as plain values."""
        return texts.fit_json(self)

    def plot(self, out: str | Path) -> Path:
        """Write the figure of the residuals as PNG, SVG or PDF, and return its path."""
        from wsnsim.fitting.plots import plot_fit

        return plot_fit(self, Path(out))


LEVELS: Final = (0.1, 0.5, 0.9)
"""Delivery ratios at which powers are stated."""
WIDTH: Final = 1.0
"""Width (dB) of the bins in which these powers are found."""


class LinkEvaluation(NamedTuple):
    """How the fitted link does on a file.

    Attributes:
        file: the file.
        in_sample: whether the link was fitted to it.
        ratio_rmse: of delivery ratios, given the powers of the bursts.
        power_rmse: of the mean powers (dB) of pairs that were heard, given their distance; NaN without positions.
    """

    file: DataFile
    in_sample: bool
    ratio_rmse: float
    power_rmse: float


@dataclass(frozen=True)
class LinkFit:
    """The link `log_normal`, fitted to recorded links.

    Attributes:
        rows: the bursts that were fitted.
        values: estimates by the key of the scenario, with intervals.
        power: transmit power (dBm) of the recording, as it was stated.
        frame: length (bytes) of its packets, as it was stated.
        test: how the link does on other files, or on the same ones where that was asked for.
    """

    rows: LinkRows
    values: Mapping[str, FittedValue]
    power: float
    frame: int
    test: tuple[LinkEvaluation, ...] = ()

    @property
    def link(self) -> dict[str, Any]:
        """The block `link` of a scenario."""
        fitted = {name: float(f"{value.value:.5g}") for name, value in self.values.items()}
        return {"kind": "log_normal", "power": self.power} | fitted

    def mean_power(self, distances: Floats) -> Floats:
        """(n,) mean received power in dBm over these distances, in m."""
        return mean_power(distances, self.power, self.values)

    @property
    def curve(self) -> tuple[Floats, Floats]:
        """Powers (K,) in dBm and mean delivery ratios (K,) of the bursts around them."""
        bins = np.floor(self.rows.powers / WIDTH).astype(np.int64)
        found, index = np.unique(bins, return_inverse=True)
        counts = np.bincount(index.ravel())
        many = counts >= 20
        ratios = np.bincount(index.ravel(), self.rows.ratios) / counts
        return (found[many].astype(np.float64) + 0.5) * WIDTH, ratios[many].astype(np.float64)

    def yaml(self) -> str:
        """The block `link` as text that a scenario can extend, with its origin in comments."""
        head = [
            f"Link fitted by wsnsim fit {__version__}; a scenario can extend this file.",
            f"power and the length of packets ({self.frame} bytes) are as stated by the user, not recorded",
            *(f"train: {file_text(file, 'bursts')}, {file.digest}" for file in self.rows.files),
            *(f"test: {_test_text(row)}, {row.file.digest}" for row in self.test),
            *([] if self.test else ["test: none"]),
        ]
        if "exponent" not in self.values:
            head.append("no positions were given: path loss and shadowing have their defaults, not those of the links")
        return (
            "\n".join([*(f"# {one_line(line)}" for line in head), *block_lines("link", self.link, self.values)]) + "\n"
        )

    def text(self) -> str:
        """The estimates and figures as tables."""
        rows = [
            [name, f"{value.value:.4g}", interval_text(value.low, value.high), value.unit, value.about]
            for name, value in self.values.items()
        ]
        return "\n".join([
            f"link log_normal, fitted to {len(self.rows.ratios)} bursts between {len(self.rows.nodes)} nodes:",
            *(f"  {file_text(file, 'bursts')}" for file in self.rows.files), "",
            *table_lines(["", "estimate", "95 % interval", "unit", "description"], rows), "", *self._notes(),
        ])  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """All figures as plain values."""
        powers, ratios = self.curve
        return {
            "law": "log_normal",
            "link": self.link,
            "values": {name: value._asdict() for name, value in self.values.items()},
            "curve": {"power": powers.tolist(), "ratio": ratios.tolist()},
            "train": {"files": [file_json(file) for file in self.rows.files]},
            "test": [file_json(row.file) | {
                "in_sample": row.in_sample, "ratio_rmse": row.ratio_rmse, "power_rmse": row.power_rmse,
            } for row in self.test],
        }  # fmt: skip

    def plot(self, out: str | Path) -> Path:
        """Write the figure as PNG, SVG or PDF, and return its path."""
        from wsnsim.fitting.plots import LinkFigure, plot_links

        return plot_links(LinkFigure(self.rows, self.values, self.curve, self.frame, self.power), Path(out))

    def _notes(self) -> Iterator[str]:
        """How intervals came about, what the model cannot express, and the figures on test files."""
        yield "Intervals come from a bootstrap of nodes: all pairs of a node share its antenna."
        powers, ratios = self.curve
        reached = [(level, powers[np.argmax(ratios >= level)]) for level in LEVELS if (ratios >= level).any()]
        yield "Recorded delivery ratio: " + ", ".join(f"{level:g} at {power:.1f} dBm" for level, power in reached) + "."
        if "exponent" not in self.values:
            yield "Without positions (--nodes), path loss and shadowing cannot be fitted."
        for row in self.test:
            yield f"{'IN SAMPLE' if row.in_sample else 'Test'}: {_test_text(row)}."
        yield from bad_row_notes([*self.rows.files, *(row.file for row in self.test)])
        if not self.test:
            yield "Not judged on other links: name some with --test."


def _test_text(row: LinkEvaluation) -> str:
    power = f", of powers {row.power_rmse:.2f} dB" if math.isfinite(row.power_rmse) else ""
    return f"{file_text(row.file, 'bursts')}, RMSE of delivery ratios given power {row.ratio_rmse:.3f}{power}"
