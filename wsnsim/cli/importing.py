"""The commands that take data of others: field data, mobility traces of other simulators, recorded readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

import click

from wsnsim.base.errors import RunError, ScenarioError, UsageError, counted
from wsnsim.cli import shared
from wsnsim.cli.fitting import renamed_columns, target
from wsnsim.cli.shared import PATH, echo, echo_json, group, seconds_of

if TYPE_CHECKING:
    from wsnsim.interop.conventions import Conventions
    from wsnsim.interop.field_data import Imported
    from wsnsim.interop.traces import NodeSummary, Trace, TraceFormat
    from wsnsim.interop.trajectories import PlacedTracks, Placement

TRACES: Final = ("ns3", "sumo", "track")
TABLES: Final = ("readings", "nodes", "links")
ANGLES: Final = (
    "counterclockwise-from-east", "clockwise-from-north", "counterclockwise-from-north", "clockwise-from-east",
)  # fmt: skip
DATES, LATEST = 5e8, 1e11
"""s: times between are taken for dates from 1985 to 5138."""
MOST_SHOWN: Final = 40
"""Nodes that --list shows."""
READ: Final = (
    "columns",
    "column",
    "missing",
    "skip_bad_rows",
    "table",
    "where",
    "time_format",
    "rate",
    "angle",
    "node_prefix",
    "repeated",
)
"""Options that say how tables are read."""
MEANT_FOR: Final = {
    **dict.fromkeys(READ[:6], (*TABLES, "track")), **dict.fromkeys(READ[8:], ("readings",)),
    **dict.fromkeys(("ids", "listed", "nodes"), TRACES), "time_unit": ("ns3", "sumo"),
    **dict.fromkeys(("start", "end"), ("readings", *TRACES)),
    "time_format": ("readings", "links", "track"), "time_origin": ("readings", "links", *TRACES),
    "rate": ("readings", "track"), "crs": ("nodes", "track", "sumo"), "origin": ("nodes", *TRACES),
}  # fmt: skip
"""{option: kinds for which it has a meaning}; others have one for all."""


def _listed(_: click.Context, option: click.Parameter, value: str | None) -> tuple[str, ...]:
    """The words of a list with commas."""
    return tuple(word.strip() for word in value.split(",")) if value else ()


@group.command("import")
@click.argument("kind", metavar="readings|nodes|track|links|ns3|sumo", type=click.Choice((*TABLES, *TRACES)))
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=PATH)
@click.option("--id", "ids", multiple=True, metavar="ID", help="Mover to import; each --id becomes a target.")
@click.option("--list", "listed", is_flag=True, help="Only list the nodes, vehicles or movers of the file.")
@click.option(
    "--out", "-o", type=PATH, metavar="FILE",
    help="FILE.csv: the table or track; FILE.yaml: it and a scenario or a block. Default FILE_KIND.csv.",
)  # fmt: skip
@click.option(
    "--nodes",
    type=PATH,
    metavar="CSV",
    help="For a scenario: positions (m) of the sensor nodes; --origin shifts a copy of them, as it shifts the tracks.",
)
@click.option("--columns", callback=_listed, metavar="A,B,...", help="Names of the columns of a file without a header.")
@click.option("--column", multiple=True, metavar="OURS=THEIRS", help="What the files call a column: reading=level.")
@click.option("--where", multiple=True, metavar="COLUMN=CELL", help="Only rows that have this cell: --where tag=7.")
@click.option("--table", default="", metavar="NAME", help="The variable, sheet or list of a file that has several.")
@click.option("--rate", type=click.FloatRange(0, min_open=True), metavar="HZ", help="Rows per second, without times.")
@click.option("--unit", default="", metavar="UNIT", help="Unit of coordinates or readings: mm, km, mW, deg, % ...")
@click.option("--angle", type=click.Choice(ANGLES), metavar="FROM", help="Such as clockwise-from-north, for bearings.")
@click.option("--missing", callback=_listed, metavar="A,B,...", help="Values that stand for no reading: 100,-100,nan.")
@click.option(
    "--time-format", default="", metavar="FORM", help="A unit such as ms, or %d.%m.%Y %H:%M:%S. Default: ISO 8601 or s."
)
@click.option("--time-unit", default="s", show_default=True, metavar="UNIT", help="Unit of the times of a trace.")
@click.option("--time-origin", metavar="TIME", help="Time that becomes 0: s, or as the table has it.")
@click.option(
    "--from", "start", metavar="TIME", help="Time of the file where track or readings begin: s, or as the table has it."
)
@click.option("--until", "end", metavar="TIME", help="Time of the file at which they end; readings at it are left out.")
@click.option("--crs", type=click.Choice(["wgs84"]), help="Positions are longitudes and latitudes: project them.")
@click.option(
    "--origin", metavar="X,Y|centre", help="Position that becomes (0, 0): X,Y (with --crs LON,LAT), or centre."
)
@click.option("--node-prefix", default="", metavar="TEXT", help="What columns of nodes begin with, in wide tables.")
@click.option(
    "--repeated", type=click.Choice(["first", "last", "mean"]), help="Which of several readings of one time counts."
)
@click.option("--skip-bad-rows", is_flag=True, help="Leave out rows that cannot be used, and count them.")
@shared.json_option
def import_(kind: str, files: tuple[Path, ...], as_json: bool, **options: Any) -> None:
    """Import field data, or a mobility trace of ns-3 or SUMO.

    `readings`, `nodes`, `track` and `links` read tables: CSV with any separator, .xlsx, .parquet, .mat, JSON,
    GeoJSON, GPX, Cooja's .csc. `ns3` reads movement traces of ns-2 ($node_(0) setdest ...) and logs of course changes
    (MobilityHelper::EnableAscii). `sumo` reads floating car data (--fcd-output), XML or CSV. Texts may be compressed
    with gzip.
    """
    if kind in ("ns3", "sumo") and len(files) > 1:
        raise UsageError(f"{kind} reads one file, {len(files)} are given")
    shared.demand_meaning(lambda name: kind in MEANT_FOR.get(name, (*TABLES, *TRACES)), kind)
    if kind in TABLES:
        _echo_written(_table(kind, files, options), as_json)
    elif not options["listed"]:
        _echo_written(_imported(kind, files, options), as_json)
    else:
        from wsnsim.interop.traces import summarised

        if options["ids"]:
            raise UsageError("--list shows all nodes: leave out --id")
        if kind == "track":
            _echo_nodes(_tracks(files, options, None)[0].nodes, as_json)
        else:
            _echo_nodes(summarised(str(files[0]), _format(kind, options, [])), as_json)


def _conventions(options: dict[str, Any]) -> Conventions:
    """How tables are read, from the options."""
    from wsnsim.interop.conventions import Conventions

    place = options["origin"] if options["crs"] and options["origin"] != "centre" else None
    names = (*READ, "unit", "time_origin", "crs")
    given = {name: options[name] for name in names if options[name] and name not in ("column", "where")}
    none = {text[:-1]: "" for text in options["column"] if text.endswith("=")}
    named = renamed_columns([text for text in options["column"] if not text.endswith("=")])
    where = renamed_columns(options["where"], "--where")
    span = options["start"] or "", options["end"] or ""
    return Conventions(**given, names=named | none, where=where, origin=_origin(place, 3), span=span)


def _table(kind: str, files: Sequence[Path], options: dict[str, Any]) -> dict[str, Any]:
    """Import tables of readings, nodes or links, and return what was written."""
    out: Path = options["out"] or Path(f"{files[0].name.split('.')[0]}_{kind}.csv")
    data = out.with_suffix(".k7" if kind == "links" else ".csv")
    if out.suffix not in (".yaml", ".csv", data.suffix):
        raise UsageError(f"--out {out}: give a file that ends in {data.suffix} (the table) or .yaml (a block with it)")
    if options["out"] is None and data.exists():
        raise UsageError(f"{data} exists: --out FILE{data.suffix} names another file, --out {data} replaces it")
    if options["origin"] and not options["crs"]:
        raise UsageError("--origin goes with --crs wgs84: longitude and latitude that become (0, 0)")
    target(data, data.name, files)
    from wsnsim.interop import field_data
    from wsnsim.recording.atomic_files import write_text_atomically

    found = getattr(field_data, kind)([str(file) for file in files], _conventions(options))
    written = {data: found.text()} | ({out: f"{found.block(data.name)}\n"} if out.suffix == ".yaml" else {})
    for path, text in written.items():
        write_text_atomically(path, text)
    facts = {name: value for name, value in found.facts.items() if name != "header"}
    return {"files": [str(path) for path in written], **facts, "notes": found.notes, "block": found.block(data.name)}


def _tracks(files: Sequence[Path], options: dict[str, Any], ids: tuple[str, ...] | None) -> tuple[Trace, Imported]:
    """The trace of a table of tracks: of the chosen movers, or of all (None); and the table."""
    from wsnsim.interop import field_data

    how = _conventions(options)
    found = field_data.track([str(file) for file in files], how)
    if found.facts["origin"] and options["origin"] and not options["crs"]:
        raise UsageError("--origin: the file has degrees: give --crs wgs84 and --origin LON,LAT")
    return field_data.trace_of(found, str(files[0]), found.table.id.unique() if ids is None else ids), found


def _imported(kind: str, files: Sequence[Path], options: dict[str, Any]) -> dict[str, Any]:
    """Import tracks, and return what was written."""
    out, trace, ids = options["out"], files[0], tuple(dict.fromkeys(options["ids"]))
    if out is not None and out.suffix not in (".csv", ".yaml"):
        raise UsageError(f"--out {out}: give a file that ends in .csv (the track) or .yaml (a scenario with it)")
    as_scenario = out is not None and out.suffix == ".yaml"
    if options["nodes"] is not None and not as_scenario:
        raise UsageError("--nodes goes with a scenario: --out FILE.yaml")
    if options["crs"] and options["nodes"] is not None and options["origin"] is None:
        raise UsageError("--nodes and --crs: give --origin LON,LAT, that of the nodes")
    how = _placement(kind, options, as_scenario)
    target(out, getattr(out, "name", ""), files)
    import numpy as np

    from wsnsim.interop import traces, trajectories
    from wsnsim.models.unit_checks import other_units, too_close

    notes: list[str] = []
    if kind == "track":
        read, found = _tracks(files, options, ids)
        (start, end), notes = found.facts["span"], [*found.notes]
        how = replace(how, start=start, end=end)
    else:
        read = traces.read(str(trace), _format(kind, options, notes), ids)
        places = np.concatenate([each[:, 1:3] for each in read.tracks.values()])
        if not (options["crs"] or options["unit"]) and (said := too_close(places)):
            notes.append(f"{said}; {other_units(str(trace), kind)}")
    tracks = trajectories.placed(read, how)
    tracks = replace(tracks, notes=(*notes, *tracks.notes))
    if out is None:
        out = Path(f"{trace.name.split('.')[0]}_{kind}.csv")
        if taken := [path for path in trajectories.files_of(tracks.tracks, out).values() if path.exists()]:
            raise UsageError(f"{taken[0]} exists: --out FILE.csv names another file, or --out {out} replaces it")
    _demand_valid(options["nodes"], out, trace, tracks)
    written = _written(options["nodes"], out, trace, tracks)
    known = {
        node: {"points": len(track), "first": float(track[0, 0]), "last": float(track[-1, 0])}
        for node, track in tracks.tracks.items()
    }
    answer = {"files": [str(file) for file in written], "origin": list(tracks.origin), "tracks": known}
    block = (
        {} if as_scenario else {"block": trajectories.motion_block(tracks, trajectories.files_of(tracks.tracks, out))}
    )
    return answer | {"notes": list(tracks.notes), **block}


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


def _format(kind: str, options: dict[str, Any], notes: list[str]) -> TraceFormat:
    """The functions of a format; `notes` gets what is doubtful in it."""
    from wsnsim.interop import ns3, sumo

    if kind == "ns3":
        return ns3
    converted = bool(options["crs"] or options["unit"] or options["time_unit"] != "s")
    return SimpleNamespace(
        entries=partial(sumo.entries, degrees=bool(options["crs"])),
        track=partial(sumo.track, notes=None if converted else notes),
    )


def _placement(kind: str, options: dict[str, Any], as_scenario: bool) -> Placement:
    """How times and places are converted, from the options; those of a table are in SI units already."""
    import numpy as np

    from wsnsim.interop.conventions import converted
    from wsnsim.interop.trajectories import CENTRE, Placement

    if kind == "track" and options["crs"]:
        return Placement(sampled=True)
    origin = _origin(options["origin"], 3 if options["crs"] else 2)
    if origin is None and as_scenario and options["nodes"] is None and not options["crs"]:
        origin = CENTRE
    if kind == "track":
        return Placement(origin=origin, sampled=True)
    units = (options["unit"] or "m", "m", "--unit"), (options["time_unit"], "s", "--time-unit")
    metres, seconds = (float(converted(np.ones(1), unit, (base,), option)[0][0]) for unit, base, option in units)
    start, end, zero = (None if options[key] is None else seconds_of(f"--{name}", options[key])
             for name, key in (("from", "start"), ("until", "end"), ("time-origin", "time_origin")))  # fmt: skip
    return Placement(metres, seconds, start, end, zero, origin, bool(options["crs"]), sampled=kind != "ns3")


def _origin(text: str | None, most: int) -> Any:
    """The place that a text names, with two numbers or more."""
    if text in (None, "centre"):
        return text
    from wsnsim.models.csvfile import number_in

    place = tuple(map(number_in, text.split(",")))
    if not 2 <= len(place) <= most or not all(map(math.isfinite, place)):
        such = "m: 500000,4180000, or centre" if most == 2 else "degrees: 8.6,50.1, perhaps with a height in m"
        raise UsageError(f"--origin {text}: give two numbers in {such}")
    return place


def _echo_nodes(nodes: dict[str, NodeSummary], as_json: bool) -> None:
    """Print what a file holds of each node."""
    if as_json:
        echo_json(
            {"nodes": {name: {"entries": n.entries, "first": n.first, "last": n.last} for name, n in nodes.items()}}
        )
        return
    width = max(len("id"), *(min(len(name), MOST_SHOWN) for name in nodes))
    echo(f"{'id':<{width}}  entries  times")
    for name, node in list(nodes.items())[:MOST_SHOWN]:
        echo(f"{name:<{width}}  {node.entries:>7}  {_span(node.first, node.last)}")
    if len(nodes) > MOST_SHOWN:
        echo(f"and {len(nodes) - MOST_SHOWN} more (all with --json)")


def _span(first: float, last: float) -> str:
    """First and last time (s); of dates, which count from 1970, the first one and the seconds from it."""
    if first < DATES or last > LATEST:
        return f"{first:.12g} to {last:.12g} s"
    return f"{last - first:.10g} s from {datetime.fromtimestamp(first, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _echo_written(answer: dict[str, Any], as_json: bool) -> None:
    """Print what was written."""
    if as_json:
        echo_json(answer)
        return
    for node, track in answer.get("tracks", {}).items():
        echo(f"{node}: {counted(track['points'], 'point')}, {_span(track['first'], track['last'])}")
    if "rows" in answer:
        known = [counted(answer["nodes"], "node")] if "nodes" in answer else []
        known += [_span(answer["first"], answer["last"])] if "first" in answer else []
        known += [f"{answer['rate']:.4g}/s of a node"] if "rate" in answer else []
        echo(f"{counted(answer['rows'], 'row')}: {', '.join(known)}")
    for note in answer["notes"]:
        echo(f"  {note}")
    for file in answer["files"]:
        echo(f"{file}: written")
    if "block" in answer:
        echo(answer["block"])
    else:
        echo(f"run it with: wsnsim run {answer['files'][-1]}")
