"""The page of the tables of a result: every column with its type, unit and meaning."""

from __future__ import annotations

from collections.abc import Iterator

from wsnsim.base.tables import DUTY_CYCLED, METRICS, RECORDED_BY_DEFAULT, STATE_AFTER, TABLE_MEANINGS, TABLES, Column
from wsnsim_reference.markdown import code, escaped, generated, table

TYPES = {"u1": "uint8", "u2": "uint16", "u4": "uint32", "u8": "uint64", "i2": "int16", "i4": "int32", "f8": "float64"}


def page() -> str:
    """Return the text of the page."""
    rows = [
        [f"[{name}](#{name})", escaped(TABLE_MEANINGS[name]), "yes" if RECORDED_BY_DEFAULT[name] else "no"]
        for name in TABLES
    ]
    return generated(
        "Tables and columns",
        "A result is one HDF5 file with a table per subject. `wsnsim.read(file, table)` returns a table as a pandas "
        "DataFrame, and `wsnsim export FILE` writes CSV or Parquet. A scenario chooses the tables with `record`: "
        "`record: {readings: true}`. Values are in SI units; the unit 1 is a count or a share, and a column without "
        "a unit is an identifier or a category.",
        table(("table", "one row per", "recorded by default"), rows),
        "A column of a category holds the words of the last column of these tables as codes, from 0; "
        "`wsnsim.read` returns the words.",
        *(block for name in TABLES for block in _table(name)),
    )


def _table(name: str) -> Iterator[str]:
    yield f"## {name}"
    yield f"One row per {escaped(TABLE_MEANINGS[name])}." + (" Recorded by default." * RECORDED_BY_DEFAULT[name])
    if name in STATE_AFTER:
        yield (
            f"After `{STATE_AFTER[name]}` stand the columns of the motion model's state, such as `px`, `vx`, `py`, "
            "`vy` (`wsnsim info KIND` names them)."
        )
    if name == "covariances":
        yield "The upper triangle of the covariance follows, row by row: `cov_px_px`, `cov_px_vx`, ..."
    if name == "runs":
        yield (
            f"Metrics, which `wsnsim compare --metric` takes, are all columns but `replicate`, `status`, the "
            f"fingerprints and `cpu_seconds`. {' and '.join(map(code, DUTY_CYCLED))} exist only if the MAC switches "
            "radios off."
        )
    yield table(("column", "type", "unit", "meaning"), [_row(column) for column in TABLES[name]])


def _row(column: Column) -> list[str]:
    words = f": {', '.join(map(code, column.meanings))}" if column.meanings else ""
    unit = {"1": "1", "": "-"}.get(column.units, escaped(column.units))
    if column.of_position:
        unit += " *"
    return [code(column.name), TYPES[column.dtype], unit.replace(" *", " (of the position)"),
            escaped(column.description) + words]  # fmt: skip


assert set(METRICS) <= {column.name for column in TABLES["runs"]}
