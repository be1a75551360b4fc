"""The commands that take data of others: mobility traces of other simulators, recorded readings and links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from wsnsim.base.errors import RunError, ScenarioError, UsageError
from wsnsim.cli import shared
from wsnsim.cli.shared import PATH, echo, echo_json, group, not_the_result, writable

if TYPE_CHECKING:
    from wsnsim.interop import NodeSummary, TraceFormat
    from wsnsim.interop.trajectories import PlacedTracks, Placement

FORMATS: Final = ("ns3", "sumo")
MOST_SHOWN: Final = 40
"""Nodes that --list shows."""


def _finite(_: click.Context, option: click.Parameter, value: float | None) -> float | None:
    """The value of an option, refused if it is no finite number."""
    if value is not None and not math.isfinite(value):
        raise UsageError(f"{option.opts[0]} {value}: give a finite number of seconds, such as 12.5")
    return value


@group.command("import")
@click.argument("kind", metavar="ns3|sumo", type=click.Choice(FORMATS))
@click.argument("trace", metavar="FILE", type=PATH)
@click.option("--id", "ids", multiple=True, metavar="ID", help="Node or vehicle to import; each --id becomes a target.")
@click.option("--list", "listed", is_flag=True, help="Only list the nodes or vehicles of the file.")
@click.option(
    "--out", "-o", type=PATH, metavar="FILE",
    help="FILE.csv: the track; FILE.yaml: the track and a scenario. Default ID.csv.",
)  # fmt: skip
@click.option(
    "--nodes",
    type=PATH,
    metavar="CSV",
    help="For a scenario: positions (m) of the sensor nodes; --origin shifts a copy of them, as it shifts the tracks.",
)
@click.option("--unit", default="m", show_default=True, metavar="UNIT", help="Unit of the file's coordinates.")
@click.option("--time-unit", default="s", show_default=True, metavar="UNIT", help="Unit of the file's times.")
@click.option("--from", "start", type=float, callback=_finite, metavar="S", help="Time (s) at which the track begins.")
@click.option("--until", "end", type=float, callback=_finite, metavar="S", help="Time (s) at which the track ends.")
@click.option("--time-origin", type=float, callback=_finite, metavar="S", help="Time (s) of the file that becomes 0.")
@click.option(
    "--origin", metavar="X,Y|centre", help="Position (m) that becomes (0, 0): X,Y, or the centre of the tracks."
)
@shared.json_option
def import_(kind: str, trace: Path, ids: tuple[str, ...], listed: bool, as_json: bool, **options: Any) -> None:
    """Import a mobility trace of ns-3 or SUMO as a trajectory.

    `ns3` reads movement traces of ns-2 ($node_(0) setdest ...) and logs of course changes
    (MobilityHelper::EnableAscii). `sumo` reads floating car data (--fcd-output), XML or CSV. A file may be compressed
    with gzip, and may be larger than the memory.
    """
    if listed:
        if ids:
            raise UsageError("--list shows all nodes: leave out --id")
        from wsnsim.interop import summarised

        _echo_nodes(summarised(str(trace), _format(kind)), as_json)
        return
    _echo_written(_imported(kind, trace, ids, options), as_json)


def _imported(kind: str, trace: Path, ids: tuple[str, ...], options: dict[str, Any]) -> dict[str, Any]:
    """Import, and return what was written."""
    out: Path | None = options["out"]
    if out is not None and out.suffix not in (".csv", ".yaml"):
        raise UsageError(f"--out {out}: give a file that ends in .csv (the track) or .yaml (a scenario with it)")
    as_scenario = out is not None and out.suffix == ".yaml"
    if options["nodes"] is not None and not as_scenario:
        raise UsageError("--nodes goes with a scenario: --out FILE.yaml")
    how = _placement(options, as_scenario)
    if out is not None:
        not_the_result(writable(out, out), trace, "track") if trace.exists() else writable(out, out)
    import wsnsim.interop as traces
    from wsnsim.interop import trajectories

    read = traces.read(str(trace), _format(kind), tuple(dict.fromkeys(ids)))
    tracks = trajectories.placed(read, how)
    if out is None:
        first = next(iter(trajectories.files_of(tracks.tracks, Path("_")).values()))
        out = Path(f"{first.stem.removeprefix('__')}.csv") if len(tracks.tracks) == 1 else Path("track.csv")
        if out.exists():
            raise UsageError(f"{out} exists: --out FILE.csv names another file, or this one to replace it")
    _demand_valid(options["nodes"], out, trace, tracks)
    files = _written(options["nodes"], out, trace, tracks)
    known = {
        node: {"points": len(track), "first": float(track[0, 0]), "last": float(track[-1, 0])}
        for node, track in tracks.tracks.items()
    }
    return {"files": [str(file) for file in files], "origin": list(tracks.origin), "tracks": known}


def _written(nodes: Path | None, out: Path, trace: Path, tracks: PlacedTracks) -> list[Path]:
    """Write the tracks, or a scenario with its tracks and the shifted copy of the positions; returns the files."""
    from wsnsim.interop import trajectories

    if out.suffix != ".yaml":
        return trajectories.write_csv(tracks.tracks, out)
    named, copies = _nodes(nodes, out, trace, tracks)
    return [*copies, *trajectories.write_scenario(tracks, out, trace.name, named)]


def _demand_valid(nodes: Path | None, out: Path, trace: Path, tracks: PlacedTracks) -> None:
    """Raise UsageError, before anything is written, if the track or scenario could not be loaded."""
    import tempfile

    import wsnsim.scenario as scenarios
    from wsnsim.models.recorded_track import RecordedTrack

    with tempfile.TemporaryDirectory(prefix=".import-", dir=out.parent) as folder:
        files = _written(nodes, Path(folder) / out.name, trace, tracks)
        try:
            if out.suffix == ".yaml":
                scenarios.build(scenarios.load(files[-1]))
            else:
                _ = [RecordedTrack(path=str(file)).track for file in files]
        except (ScenarioError, RunError) as error:
            said = error.issues[0].message if isinstance(error, ScenarioError) else str(error)
            reason = said.replace(f"{folder}/", "")
            raise UsageError(f"{out}: is not written, since it could not be loaded: {reason}") from None


def _nodes(nodes: Path | None, out: Path, trace: Path, tracks: PlacedTracks) -> tuple[Path | None, list[Path]]:
    """The file of positions as the scenario names it, and the shifted copy that was written for another origin.

    Raises:
        UsageError: The file does not exist, or the copy would replace it, the trace or a track.
        RunError: A position cannot be read. The message names file and line.
        StorageError: The copy cannot be written.
    """
    if nodes is None:
        return None, []
    if not nodes.is_file():
        raise UsageError(f"--nodes {nodes}: file does not exist")
    place = nodes.resolve()
    if tracks.origin == (0.0, 0.0):
        return Path(nodes.name) if place.parent == out.resolve().parent else place, []
    from wsnsim.interop import trajectories

    copy = out.with_name(f"{out.stem}_nodes.csv")
    taken = [nodes, trace, *trajectories.files_of(tracks.tracks, out).values()]
    if copy.resolve() in [path.resolve() for path in taken]:
        raise UsageError(f"{copy} would be replaced by the shifted positions: give another name to --out")
    trajectories.write_shifted_nodes(nodes, copy, tracks.origin)
    return Path(copy.name), [copy]


def _format(kind: str) -> TraceFormat:
    """The module of a format."""
    from wsnsim.interop import ns3, sumo

    return ns3 if kind == "ns3" else sumo


def _placement(options: dict[str, Any], as_scenario: bool) -> Placement:
    """How times and places are converted, from the options."""
    from wsnsim.interop.trajectories import CENTRE, Placement

    origin = _origin(options["origin"])
    if origin is None and as_scenario and options["nodes"] is None:
        origin = CENTRE
    return Placement(
        _factor(options["unit"], "m", "--unit"), _factor(options["time_unit"], "s", "--time-unit"),
        options["start"], options["end"], options["time_origin"], origin,
    )  # fmt: skip


def _factor(unit: str, base: str, option: str) -> float:
    """What one of a unit is in `base`."""
    from wsnsim.scenario.units import UnitError, si

    try:
        return si(f"1 {unit}", base)
    except UnitError as error:
        raise UsageError(f"{option} {unit}: {error}") from None


def _origin(text: str | None) -> tuple[float, float] | str | None:
    """The place that a text names."""
    if text in (None, "centre"):
        return text
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = float("nan")
    if not abs(x) + abs(y) < float("inf"):
        raise UsageError(f"--origin {text}: give two numbers in m, such as 500000,4180000, or centre")
    return x, y


def _echo_nodes(nodes: dict[str, NodeSummary], as_json: bool) -> None:
    """Print what a file holds of each node."""
    if as_json:
        echo_json(
            {"nodes": {name: {"entries": n.entries, "first": n.first, "last": n.last} for name, n in nodes.items()}}
        )
        return
    width = max(len("id"), *(min(len(name), MOST_SHOWN) for name in nodes))
    echo(f"{'id':<{width}}  entries      first       last")
    for name, node in list(nodes.items())[:MOST_SHOWN]:
        echo(f"{name:<{width}}  {node.entries:>7}  {node.first:>9g}  {node.last:>9g}")
    if len(nodes) > MOST_SHOWN:
        echo(f"and {len(nodes) - MOST_SHOWN} more (all with --json)")


def _echo_written(answer: dict[str, Any], as_json: bool) -> None:
    """Print what was written."""
    if as_json:
        echo_json(answer)
        return
    for node, track in answer["tracks"].items():
        echo(f"{node}: {track['points']} points, {track['first']:g} to {track['last']:g} s")
    for file in answer["files"]:
        echo(f"{file}: written")
    if answer["files"][-1].endswith(".yaml"):
        echo(f"run it with: wsnsim run {answer['files'][-1]}")


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
    renamed = {"columns": _renamed_columns(column), "node_columns": _renamed_columns(node_column)}
    asked |= {name: given for name, given in {"tracks": track, **renamed}.items() if given}
    out, figure = _target(out, "law.yaml", read), _target(figure, "residuals.png", read)
    if figure is not None:
        from wsnsim.analysis.figure_style import suffix_of

        suffix_of(figure)
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


def _target(path: Path | None, default: str, read: Sequence[Path]) -> Path | None:
    """The path of a file to be written, which must not be one that is read."""
    if path is None:
        return None
    writable(path, Path(default))
    for other in read:
        if path.exists() and other.exists() and path.samefile(other):
            raise UsageError(f"{path} is one of the files that are read; write to another one")
    return path


def _renamed_columns(texts: Sequence[str]) -> dict[str, str]:
    """The names of columns by ours."""
    found = {}
    for text in texts:
        ours, sign, theirs = text.partition("=")
        if not (ours and sign and theirs):
            raise UsageError(f"--column {text}: must be OURS=THEIRS, such as reading=rssi")
        found[ours.strip()] = theirs.strip()
    return found
