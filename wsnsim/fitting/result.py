"""A law fitted to readings, with its texts and its figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wsnsim.fitting import texts
from wsnsim.fitting.fitted_law import FittedLaw


@dataclass(frozen=True)
class Fit(FittedLaw):
    """A law fitted to recorded readings: `sensor` is its block in a scenario, `values` and `gains` have intervals."""

    def yaml(self) -> str:
        """The block `sensor` as text that a scenario can extend, with its origin in comments."""
        return texts.sensor_yaml(self)

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
