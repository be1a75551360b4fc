"""The command that exports tables for other tools."""

from __future__ import annotations

from pathlib import Path

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli.shared import PATH, echo, group, not_the_result, reading, writable


@group.command()
@click.argument("result", metavar="FILE|DIR", type=PATH)
@click.option("--csv", "csv_folder", type=PATH, metavar="DIR", help="Write a CSV file per table into this folder.")
@click.option(
    "--parquet", "parquet_folder", type=PATH, metavar="DIR", help="Write a Parquet file per table into this folder."
)
@click.option("--mat", "matlab_file", type=PATH, metavar="FILE.mat", help="Write one MATLAB file, a struct per table.")
@click.option("--table", "tables", multiple=True, metavar="NAME", help="Export only this table; default all.")
def export(
    result: Path,
    csv_folder: Path | None,
    parquet_folder: Path | None,
    matlab_file: Path | None,
    tables: tuple[str, ...],
) -> None:
    """Export tables as CSV, Parquet or MATLAB files.

    FILE is a result, DIR the folder of a campaign.
    """
    if csv_folder is None and parquet_folder is None and matlab_file is None:
        raise UsageError("say what to write: --csv DIR, --parquet DIR or --mat FILE.mat")
    if matlab_file is not None:
        _check_matlab_file(matlab_file, result)
    with reading(result):
        from wsnsim.analysis import frames

        for folder, write in ((csv_folder, frames.csv), (parquet_folder, frames.parquet)):
            if folder is not None:
                for file, rows in write(result, folder, tables):
                    echo(f"{file}: {rows:,} rows")
        if matlab_file is not None:
            for table, rows in frames.matlab(result, matlab_file, tables):
                echo(f"{matlab_file}: {table}: {rows:,} rows")


def _check_matlab_file(file: Path, result: Path) -> None:
    """Raise UsageError if the MATLAB file cannot be written there, before anything is read."""
    if file.suffix != ".mat":
        raise UsageError(f"--mat {file}: the name of a MATLAB file ends in .mat")
    try:
        writable(file, file)
    except UsageError as error:
        raise UsageError(str(error).replace("--out ", "--mat ")) from None
    if result.exists():
        not_the_result(file, result, "MATLAB file")
