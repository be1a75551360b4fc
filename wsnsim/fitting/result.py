"""A law fitted to readings, with its texts and its figure."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wsnsim.base.errors import UsageError
from wsnsim.fitting import texts
from wsnsim.fitting.data_files import digest_of, names_in
from wsnsim.fitting.fitted_law import FittedLaw


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
