"""A fit as text, as YAML that a scenario can extend, and as plain values for JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from wsnsim.base.version import __version__
from wsnsim.fitting.fitted_law import Evaluation, FittedLaw, ResidualFigures
from wsnsim.fitting.located_readings import DataFile

FIGURES: Final = ("RMSE", "skewness", "kurtosis", "correlation at 1 s", "mean log density")


def fit_text(fit: FittedLaw) -> str:
    """The estimates with intervals, the gains, and the figures of residuals, as tables."""
    form = fit.model.form
    readings = f"{len(fit.sample.readings):,}".replace(",", " ")
    place = "in space" if fit.model.heights else "in the plane"
    lines = [f"law {form.kind} of distances {place}, fitted to {readings} readings of {len(fit.sample.files)} tracks:"]
    lines += [f"  {_file_text(file)}" for file in fit.sample.files]
    lines += ["", *_table(["", "estimate", "95 % interval", "unit", "description"], _value_rows(fit))]
    if fit.gains:
        rows = [[g.node, f"{g.value:.2f}", _interval(g.low, g.high), str(g.readings)] for g in fit.gains]
        lines += ["", *_table(["node", f"gain [{form.unit}]", "95 % interval", "readings"], rows)]
    lines += ["", *_table(["readings", "law", *FIGURES], list(_figure_rows(fit)))]
    lines += ["", *_notes(fit)]
    return "\n".join(lines)


def sensor_yaml(fit: FittedLaw) -> str:
    """The block `sensor` with its origin in comments: train and test files, intervals and held-out figures."""
    head = [
        f"Law '{fit.model.form.kind}', fitted by wsnsim fit {__version__}; a scenario can extend this file.",
        *(f"train: {_file_text(file)}, {file.digest}" for file in fit.sample.files),
        *(f"test: {_test_text(row, fit.model.form.unit)}, {row.file.digest}" for row in fit.test),
        *([] if fit.test else ["test: none"]),
    ]
    body = ["sensor:"]
    for name, value in fit.sensor.items():
        fitted = fit.values.get(name)
        note = f"   # 95 %: {_interval(fitted.low, fitted.high)}" if fitted is not None else ""
        body.append(f"  {name}: {json.dumps(value, ensure_ascii=False)}{note}")
    return "\n".join([*(f"# {_one_line(line)}" for line in head), *body]) + "\n"


def fit_json(fit: FittedLaw) -> dict[str, Any]:
    """All figures as plain values in SI units and dB."""
    fitted, plain = fit.train
    return {
        "law": fit.model.form.kind,
        "heights": fit.model.heights,
        "sensor": fit.sensor,
        "values": {name: value._asdict() for name, value in fit.values.items()},
        "gains": [gain._asdict() for gain in fit.gains],
        "aic": dict(fit.basis.aic),
        "blocks": {"count": fit.basis.blocks, "seconds": fit.basis.seconds},
        "train": {
            "files": [_file_json(file) for file in fit.sample.files],
            "fitted": fitted._asdict(),
            "plain": plain._asdict(),
        },
        "test": [
            _file_json(row.file)
            | {"in_sample": row.in_sample, "fitted": row.fitted._asdict(), "plain": row.plain._asdict()}
            for row in fit.test
        ],
    }


def _value_rows(fit: FittedLaw) -> list[list[str]]:
    return [
        [name, f"{value.value:.4g}", _interval(value.low, value.high), value.unit, value.about]
        for name, value in fit.values.items()
    ]


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
    blocks = f"{fit.basis.blocks} blocks of {fit.basis.seconds:.3g} s (all nodes together)"
    yield (
        f"Residuals are correlated: intervals come from {blocks}: a sandwich for coefficients and gains, a bootstrap "
        "of blocks for the rest."
    )
    normal, student = fit.basis.aic["normal"], fit.basis.aic["student_t"]
    yield (
        f"Noise: {fit.model.noise.family}; AIC {normal:.1f} (normal) and {student:.1f} (student_t), with readings "
        "taken as independent."
    )
    if fit.gains:
        yield "Gains have the sum 0 over the nodes with readings, and are not shrunk; a node without readings has 0."
    if fit.model.noise.shadowing <= 0.0:
        yield "No part of the noise is correlated along the path beyond doubt: shadowing is left out."
    if fit.model.form.kind == "range":
        yield "The sensor `range` has no bias: its sd is that of reading minus distance about 0."
    skipped = sum(len(file.bad_rows) for file in [*fit.sample.files, *(row.file for row in fit.test)])
    if skipped:
        yield f"{skipped} bad row{'s were' if skipped > 1 else ' was'} skipped:"
        for file in [*fit.sample.files, *(row.file for row in fit.test)]:
            yield from (f"  {row}" for row in file.bad_rows)
    if not fit.test:
        yield "Not judged on other readings: name some with --test."


def _file_text(file: DataFile) -> str:
    bad = f" ({len(file.bad_rows)} bad rows skipped)" if file.bad_rows else ""
    return f"{file.path}, {file.readings} readings{bad}"


def _test_text(row: Evaluation, unit: str) -> str:
    what = "IN SAMPLE, " if row.in_sample else ""
    figures = f"RMSE {row.fitted.rmse:.3f} {unit}, mean log density {row.fitted.log_likelihood:.3f}"
    return f"{_file_text(row.file)}, {what}{figures}"


def _file_json(file: DataFile) -> dict[str, Any]:
    return {"path": file.path, "digest": file.digest, "readings": file.readings, "bad_rows": list(file.bad_rows)}


def _interval(low: float, high: float) -> str:
    if not (math.isfinite(low) and math.isfinite(high)):
        return "unknown"
    return f"{low:.3g} to {high:.3g}"


def _one_line(text: str) -> str:
    """The text without line breaks, which would end a comment."""
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with columns of equal width."""
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in [heads, *rows]
    ]
