"""A law fitted to readings, as text, as YAML that a scenario can extend, and as plain values for JSON."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import RunError, ScenarioError, UsageError, counted
from wsnsim.base.version import __version__
from wsnsim.fitting.data_files import digest_of, names_in
from wsnsim.fitting.fitted_law import Evaluation, FittedLaw, FittedValue, ResidualFigures
from wsnsim.fitting.located_readings import DataFile
from wsnsim.models.row_checks import summarised
from wsnsim.scenario import load

SKEWED: Final = 0.2
"""Skewness from which it is said that the families of noise have none."""
NEARLY_ALL: Final = 0.995
"""It is said that the white part of the noise is nearly zero if more than this share of sd is correlated."""
MUCH: Final = 0.3
"""It is said that the target's height changes if that moves expected readings by more than this share of sd."""
FIGURES: Final = ("RMSE", "skewness", "kurtosis", "correlation at 1 s", "mean log density")


def value_lines(values: Mapping[str, FittedValue]) -> list[str]:
    """The estimates with their intervals as a table."""
    rows = [
        [name, f"{value.value:.4g}", interval_text(value.low, value.high, value.approximate), value.unit, value.about]
        for name, value in values.items()
    ]
    return table_lines(["", "estimate", "95 % interval", "unit", "description"], rows)


def _figure_rows(fit: FittedLaw) -> Iterator[list[str]]:
    """A row for each law on the train readings and on each test file."""
    fitted, plain = fit.train
    name = fit.model.form.kind
    rows: list[tuple[str, ResidualFigures, ResidualFigures]] = [("train", fitted, plain)]
    rows += [(f"{'IN SAMPLE' if row.in_sample else 'test'} {row.file.path}", row.fitted, row.plain) for row in fit.test]
    for where, own, simple in rows:
        yield [where, "fitted", *_figures(own)]
        yield [where, f"{name} alone, normal noise", *_figures(simple)]


def _figures(found: ResidualFigures) -> list[str]:
    shape = f"{found.skewness:.2f}", f"{found.kurtosis:.2f}"
    return [f"{found.rmse:.3f}", *shape, f"{found.correlation:.2f}", f"{found.log_likelihood:.3f}"]


def _notes(fit: FittedLaw) -> Iterator[str]:
    """How the intervals came about, which family of noise was chosen, and what the sensor cannot express."""
    yield (
        f"Readings are correlated: intervals come from {_clusters(fit)}, all links together: a sandwich (CR2) for "
        "coefficients and gains, a bootstrap for the rest."
    )
    for reason in dict.fromkeys(value.approximate for value in fit.values.values() if value.approximate):
        names = ", ".join(name for name, value in fit.values.items() if value.approximate == reason)
        yield f"Approximate intervals, which may hold the truth in fewer than 95 % of recordings: {names}: {reason}."
    if any(gain.readings and math.isnan(gain.low) for gain in fit.gains):
        yield "A gain has no interval where one block or stay alone determines it."
    known = " and ".join(f"{aic:.1f} ({name})" for name, aic in fit.basis.aic.items() if math.isfinite(aic))
    yield f"Noise: {fit.model.noise.family}; AIC {known}, with readings taken as independent."
    skewness = fit.train[0].skewness
    if abs(skewness) > SKEWED:
        yield f"The residuals have a skewness of {skewness:.2f}; both families are symmetric."
        sample, worst = fit.sample, np.abs(fit.residuals).argmax()
        file, node = sample.files[sample.tracks[worst]].path, sample.deployment.ids[sample.nodes[worst]]
        reading = f"{sample.readings[worst]:.15g} {fit.model.form.reading_unit}"
        where = f"reading {reading} of {node} at {sample.times[worst]:.15g} s in {file}:{sample.lines[worst]}"
        yield (
            f"The largest residual: {fit.residuals[worst]:.3g} {fit.model.form.unit}, {where}. An outlier? Delete this "
            f"row, or import its source again, with --missing (in the source's unit) and --out {shlex.quote(file)}."
        )
    if fit.gains:
        constants = fit.model.form.constants.capitalize()
        yield f"{constants} have the sum 0 over the nodes with readings, and are not shrunk; a node without has 0."
    yield from _doubts(fit)
    if fit.basis.stays == fit.basis.blocks:
        yield "The target never moves: errors that links keep at a place are part of sd, as if they were white noise."
    elif "shadowing" not in fit.values:
        yield "No part of the noise is correlated along the path beyond doubt: shadowing is left out."
    yield from bad_row_notes([*fit.sample.files, *(row.file for row in fit.test)])
    if not fit.test:
        yield "Not judged on other readings: name some with --test."


def _doubts(fit: FittedLaw) -> Iterator[str]:
    """What can hardly be meant, and what the sensor or filters take otherwise than it was fitted."""
    form, values, noise, height = fit.model.form, fit.values, fit.model.noise, fit.target_height
    yield from refused("sensor", fit.sensor)
    if "eta" in values and values["eta"].value <= 0.0:
        yield "Implausible: strength grows with distance. Are names, units, times and places right?"
    if "shadowing" in values and values["shadowing"].value > NEARLY_ALL * noise.total:
        yield "Implausible: the white part of the noise is nearly zero. Is the law wrong along the path?"
    if "total" in values:
        yield f"Filters take readings as independent: the file widens their noise to {fit.law['sd']:g} {form.unit}."
    elif "shadowing" in values:
        yield f"The sensor `{form.kind}` has no shadowing: sd includes the part that is correlated along the path."
    if not form.has("dof") and fit.basis.aic["student_t"] < fit.basis.aic["normal"]:
        yield f"The sensor `{form.kind}` has normal noise alone: heavy tails are left out."
    if height is not None:
        level = np.insert(fit.sample.points[:, :2], 2, height, axis=1)
        moved = fit.model.residuals(dataclasses.replace(fit.sample, points=level)) - fit.residuals
        if math.sqrt(float((moved**2).mean())) > MUCH * noise.total:
            yield f"Filters take the target's height as {height:g} m, but it changes: their sd should be larger."


def refused(role: str, block: Mapping[str, Any]) -> Iterator[str]:
    """Yield why no scenario can have a fitted block, if none can."""
    try:
        load({"extends": "ekf_real", "name": "fitted", role: block})
    except ScenarioError as error:
        yield f"No scenario can have this law: {error}"


def _clusters(fit: FittedLaw) -> str:
    """The blocks that count as independent."""
    basis, links = fit.basis, f"{len(np.unique(fit.sample.nodes))} links"
    if basis.stays == basis.blocks:
        return f"{basis.stays} stays of {links}"
    stays = f", {basis.stays} of them stays" if basis.stays else ""
    return f"{basis.blocks} blocks of {links}, of at least {basis.seconds:.3g} s and {basis.path:.3g} m{stays}"


def bad_row_notes(files: Sequence[DataFile]) -> Iterator[str]:
    """Which rows were skipped, if any were."""
    skipped = [row for file in files for row in file.bad_rows]
    if skipped:
        yield f"{len(skipped)} bad row{'s were' if len(skipped) > 1 else ' was'} skipped:"
        yield from (f"  {row}" for row in summarised(skipped))


def block_lines(role: str, block: Mapping[str, Any], values: Mapping[str, FittedValue]) -> Iterator[str]:
    """The block of a role in YAML, with the interval of each fitted value in a comment."""
    yield f"{role}:"
    for name, value in block.items():
        fitted = values.get(name)
        note = f"   # 95 %: {interval_text(fitted.low, fitted.high, fitted.approximate)}" if fitted is not None else ""
        yield f"  {name}: {json.dumps(value, ensure_ascii=False)}{note}"


def file_text(file: DataFile, what: str = "readings") -> str:
    """A file with the number of its readings, and of rows that were skipped."""
    bad = f" ({len(file.bad_rows)} bad rows skipped)" if file.bad_rows else ""
    return f"{file.path}, {file.readings:,} {what}{bad}"


def _test_text(row: Evaluation, unit: str) -> str:
    what = "IN SAMPLE, " if row.in_sample else ""
    figures = f"RMSE {row.fitted.rmse:.3f} {unit}, mean log density {row.fitted.log_likelihood:.3f}"
    return f"{file_text(row.file)}, {what}{figures}"


def interval_text(low: float, high: float, approximate: str = "") -> str:
    """An interval as text, marked if it is approximate."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "unknown"
    return f"{low:.4g} to {high:.4g}{' (approximate)' if approximate else ''}"


def one_line(text: str) -> str:
    """The text without line breaks, which would end a comment."""
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def table_lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with columns of equal width."""
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in [heads, *rows]
    ]


@dataclass(frozen=True)
class Fit(FittedLaw):
    """A law fitted to recorded readings: `sensor` is its block in a scenario, `values` and `gains` have intervals."""

    def yaml(self, recorded: Mapping[str, Any] | None = None) -> str:
        """The block `sensor` as text that a scenario can extend, with its origin in comments.

        Args:
            recorded: the keys of a sensor with recorded readings, as `recorded_sensor` gives them; without them the
                sensor samples its readings from the law.

        Raises:
            RunError: no scenario can have this law.
        """
        for reason in refused("sensor", self.sensor):
            raise RunError(reason)
        head = [
            f"Law '{self.model.form.kind}', fitted by wsnsim fit {__version__}; a scenario can extend this file.",
            *(f"train: {file_text(file)}, {file.digest}" for file in self.sample.files),
            *(f"test: {_test_text(row, self.model.form.unit)}, {row.file.digest}" for row in self.test),
            *([] if self.test else ["test: none"]),
        ]
        if recorded is None:
            block = [*block_lines("sensor", self.sensor, self.values)]
            if "total" in self.values:
                block += ["tracker:", "  assumes: {inflate: true}   # shadowing widens the noise that filters assume"]
        else:
            values = {**self.values, "sd": self.values.get("total", self.values["sd"])}
            law = (f"  {line}" for line in block_lines("law", self.law, values))
            block = [*block_lines("sensor", recorded, {}), *law]
        return "\n".join([*(f"# {one_line(line)}" for line in head), *block]) + "\n"

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
        form = self.model.form
        readings, tracks = counted(len(self.sample.readings), "reading"), counted(len(self.sample.files), "track")
        place = "in space" if self.model.heights else "in the plane"
        lines = [f"law {form.kind} of distances {place}, fitted to {readings} of {tracks}:"]
        lines += [f"  {file_text(file)}" for file in self.sample.files]
        lines += ["", *value_lines(self.values)]
        if self.gains:
            ends = [[round(each, 4) + 0.0 for each in (g.value, g.low, g.high)] for g in self.gains]
            rows = [[gain.node, f"{value:.4g}", interval_text(low, high), f"{gain.readings:,}"]
                    for gain, (value, low, high) in zip(self.gains, ends, strict=True)]  # fmt: skip
            lines += ["", *table_lines(["node", f"{form.constants} [{form.unit}]", "95 % interval", "readings"], rows)]
        lines += ["", *table_lines(["readings", "law", *FIGURES], list(_figure_rows(self)))]
        lines += ["", *_notes(self)]
        return "\n".join(lines)

    def as_json(self) -> dict[str, Any]:
        """All figures as plain values."""
        basis, (fitted, plain) = self.basis, self.train
        return {
            "law": self.model.form.kind,
            "heights": self.model.heights,
            "sensor": self.sensor,
            "values": {name: value._asdict() for name, value in self.values.items()},
            "gains": [gain._asdict() for gain in self.gains],
            "aic": dict(basis.aic),
            "blocks": {"count": basis.blocks, "seconds": basis.seconds, "path": basis.path, "stays": basis.stays},
            "train": {
                "files": [dataclasses.asdict(file) for file in self.sample.files],
                "fitted": fitted._asdict(),
                "plain": plain._asdict(),
            },
            "test": [
                dataclasses.asdict(row.file)
                | {"in_sample": row.in_sample, "fitted": row.fitted._asdict(), "plain": row.plain._asdict()}
                for row in self.test
            ],
        }

    def plot(self, out: str | Path) -> Path:
        """Write the figure of the residuals as PNG, SVG or PDF, and return its path."""
        from wsnsim.fitting.plots import plot_fit

        return plot_fit(self, Path(out))
