"""The command that fits laws of sensors and links to recorded data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from wsnsim.base.errors import UsageError
from wsnsim.cli import shared
from wsnsim.cli.shared import PATH, echo, echo_json, group, plot_path, writable

FAMILIES: Final = ("auto", "normal", "student_t")
LAWS: Final = ("rssi", "range", "log_normal")


@group.command()
@click.argument("data", metavar="DATA...", nargs=-1, required=True, type=PATH)
@click.option("--nodes", type=PATH, metavar="FILE", help="CSV with id, x, y and perhaps z of the nodes, in m.")
@click.option("--law", metavar="|".join(LAWS), default=LAWS[0], show_default=True, help="Law to fit.")
@click.option(
    "--test", type=PATH, multiple=True, metavar="FILE", help="Recorded readings on which the fitted law is tested."
)
@click.option(
    "--track", type=PATH, multiple=True, metavar="FILE",
    help="Trajectory with time, x, y and perhaps z: one for all files, or one per file, test files last.",
)  # fmt: skip
@click.option("--column", multiple=True, metavar="OURS=THEIRS", help="What DATA and --track call a column: node=who.")
@click.option("--node-column", multiple=True, metavar="OURS=THEIRS", help="What --nodes calls a column: id=anchor.")
@click.option("--gains/--no-gains", default=True, show_default=True, help="Fit a gain for each node.")
@click.option(
    "--heights/--no-heights",
    default=None,
    help="Distances in space or in the plane; default: in space if heights are known.",
)
@click.option(
    "--noise", type=click.Choice(FAMILIES), default="auto", show_default=True, help="Family of the white noise."
)
@click.option(
    "--block", type=float, metavar="S", help="Least length (s) of the blocks from which intervals are computed."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, metavar="S", help="Seed of the bootstrap; default 0.")
@click.option("--in-sample", is_flag=True, help="Allow a test on readings that were fitted; the output says so.")
@click.option("--skip-bad-rows", is_flag=True, help="Leave out rows that cannot be used, and name them.")
@click.option(
    "--out", "-o", type=PATH, metavar="YAML", help="Write a file with the fitted block, which a scenario can extend."
)
@click.option(
    "--readings", type=PATH, metavar="FILE",
    help="With --out: write a sensor that plays the readings of this file; filters assume the law.",
)  # fmt: skip
@click.option("--plot", "figure", type=PATH, metavar="PLOT", help="Write the residual plots: .png, .svg or .pdf.")
@click.option("--power", type=float, metavar="DBM", help="For links: transmit power; default 0 dBm.")
@click.option(
    "--frame", type=click.IntRange(1, 127), metavar="BYTES", help="For links: length of the packets; default 100."
)
@shared.json_option
def fit(
    data: tuple[Path, ...],
    nodes: Path | None,
    law: str,
    test: tuple[Path, ...],
    track: tuple[Path, ...],
    column: tuple[str, ...],
    node_column: tuple[str, ...],
    out: Path | None,
    readings: Path | None,
    figure: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Fit a sensor or link model (a law) to recorded data.

    DATA are CSV files, one per track, with the columns time, node, reading, and x, y and perhaps z of the target. With
    the law log_normal, DATA are recorded links (K7). Both may be compressed (.gz). --out writes the fitted law as a
    block that a scenario can extend.
    """
    import wsnsim.fitting as fitting

    if readings is not None and (out is None or law == "log_normal"):
        raise UsageError("--readings goes with --out and a law of readings")
    read = [*data, *(path for path in (nodes, readings) if path), *test, *track]
    default, context = click.core.ParameterSource.DEFAULT, click.get_current_context()
    # what the command line gives: other options do not exist for every law
    asked = {name: value for name, value in options.items() if context.get_parameter_source(name) is not default}
    renamed = {"columns": renamed_columns(column), "node_columns": renamed_columns(node_column, "--node-column")}
    asked |= {name: given for name, given in {"tracks": track, **renamed}.items() if given}
    out, figure = target(out, "law.yaml", read), target(figure, getattr(figure, "name", ""), read)
    if figure is not None:
        plot_path(figure)
    found = fitting.fit(data, nodes, law, test, **asked)
    recorded = None
    if isinstance(found, fitting.Fit) and readings is not None and out is not None:
        recorded = found.recorded_sensor(readings, out.parent, asked.get("columns"), options["in_sample"])
    written = [path for path in (out, figure) if path]
    if out is not None:
        from wsnsim.recording.atomic_files import write_text_atomically

        write_text_atomically(out, found.yaml(recorded) if recorded else found.yaml())  # type: ignore[call-arg]
    if figure is not None:
        found.plot(figure)
    if as_json:
        echo_json(found.as_json() | {"written": [str(path) for path in written]})
        return
    echo(found.text())
    for path in written:
        echo(f"{path}: written")


def target(path: Path | None, default: str, read: Sequence[Path]) -> Path | None:
    """The path of a file to be written, which must not be one that is read."""
    if path is None:
        return None
    for other in read:
        if path.exists() and other.exists() and path.samefile(other):
            raise UsageError(f"{path} is one of the files that are read; write to another one")
    return writable(path, Path(default))


def renamed_columns(texts: Sequence[str], option: str = "--column") -> dict[str, str]:
    """The names of columns by ours."""
    meant = "COLUMN=CELL, such as tag=7" if option == "--where" else "OURS=THEIRS, such as reading=rssi"
    found = {}
    for text in texts:
        ours, sign, theirs = text.partition("=")
        if not (ours and sign and theirs):
            raise UsageError(f"{option} {text}: must be {meant}")
        found[ours.strip()] = theirs.strip()
    return found
