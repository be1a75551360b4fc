"""Field data become what scenarios read: readings, nodes, tracks and links, as tables in SI units with a summary.

readings(files), nodes(files), track(files), links(files) -> Imported
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.base.errors import RunError, UsageError, counted
from wsnsim.interop.conventions import USUALLY, Conventions, column_roles, decimal, plain, turned
from wsnsim.interop.source_rows import SourceRows, columns_of, without
from wsnsim.interop.tables import RawTable, listed, numeric
from wsnsim.interop.traces import NodeSummary, Trace, demand_choice
from wsnsim.models.bearing import TURN
from wsnsim.models.k7file import HIGHEST_CHANNEL
from wsnsim.models.recorded_track import movers_said
from wsnsim.models.row_checks import TextColumn
from wsnsim.models.unit_checks import other_than_stated, other_units, slower_than_stated

ANGULAR: Final = ("bearing", "azimuth", "angle")
LAWS: Final = {"m": "range", "rad": "bearing", "dBm": "rssi"}
FROM_EAST: Final = (
    "angles are taken counterclockwise from the x-axis, which points east; --angle clockwise-from-north says otherwise"
)
MOST_POWER: Final = 50.0
"""dBm: 100 W; greater numbers stand for something else."""
MANY_NODES: Final = 20
"""From so many readings on, a node for each of them is a doubtful number (our choice)."""
UNKNOWN_POWER: Final = -100.0
"""dBm: stands for the received power of links of which only the delivery ratio is known."""
PACKETS, INTERVAL, CHANNEL = 100, 10, 26
"""Packets of a burst, ms between them, and the channel, of links for which they are not stated (our choice)."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What files became.

    Attributes:
        kind: 'readings', 'nodes', 'track' or 'links'.
        table: The canonical columns, in SI units (levels in dBm); rows are sorted.
        facts: Rows, nodes, first and last time (s), rate (1/s), unit and origin, as far as they are known.
        notes: What was left out and why, and what was assumed.
    """

    kind: str
    table: pd.DataFrame
    facts: Mapping[str, Any]
    notes: Sequence[str]

    def text(self) -> str:
        """The file that a scenario reads: CSV, or K7 for links."""
        rows = str(self.table.to_csv(index=False, float_format=decimal, lineterminator="\n"))
        return f"{json.dumps(self.facts['header'])}\n{rows}" if self.kind == "links" else rows

    def block(self, path: str) -> str:
        """The lines of a scenario that read the file, once it is written to `path`."""
        file = f"path: {json.dumps(path, ensure_ascii=False)}"
        if self.kind == "nodes":
            return f"deploy: {{kind: file, {file}, fit: true, cover: false}}"
        if self.kind == "links":
            return f"link: {{kind: recorded, {file}, channel: {self.facts['channels'][0]}, wrap: true}}"
        file = f"{file}, time_origin: {decimal(self.facts['first'])}"
        if self.kind == "track":
            return f"motion: {{kind: recorded_track, {file}}}"
        return f"sensor: {{kind: recorded, {file}, law: {{kind: {LAWS.get(self.facts['unit'], 'range')}}}}}"


def readings(files: Sequence[str], how: Conventions = USUALLY) -> Imported:
    """The readings of files, long or wide (a column per node); without nodes in it, a file is that of one node.

    Raises:
        UsageError: An option does not fit the files.
        RunError: A file or a row cannot be used; the message names file and line.
    """
    rows = SourceRows(files, how, "readings", ("time", "node", "reading", "target"), _long)
    (values, unit), positive = rows.in_unit("reading", ("m", "dBm", "rad")), ""
    negative = values[rows.kept] < 0.0
    if not unit and {plain(rows.named("reading")), plain(how.node_prefix).strip("_")} & {"rssi", "rss"}:
        unit = "dBm"
        positive = ", though they are positive" * bool((values[rows.kept] > 0.0).all())
        rows.notes.append(f"readings called rssi are taken for levels in dBm{positive}; --unit says otherwise")
    elif not unit and negative.any() and negative.all():
        unit = "dBm"
        rows.notes.append("all readings are negative: they are taken for levels in dBm; --unit says otherwise")
    elif not unit and negative.any():
        count = counted(int(negative.sum()), "negative reading")
        rows.notes.append(f"{count}, which no range has: --unit or --missing says why")
    if unit == "rad" or how.angle or plain(rows.named("reading")) in ANGULAR:
        rows.notes += [FROM_EAST] * (not how.angle)
        wrong, degrees = np.abs(values) > TURN * (1.0 + 1e-9), rows.remedy("--unit deg")
        rows.refuse(wrong, lambda i: f"a bearing must be within ±2π rad, is {values[i]:g}, degrees? Write: {degrees}")
        values, unit = turned(values, how.angle), "rad"
    elif not unit and rows.kept.any():
        rows.notes.append("readings are taken for ranges in m; --unit says otherwise")
    table = pd.DataFrame({"time": rows.times(), "node": rows.texts("node"), "reading": values})
    rows.leave_out(~table.time.between(*rows.span(), inclusive="left").to_numpy(), "before --from or from --until on")
    if "target" in rows.frame:
        codes, known = pd.factorize(rows.texts("target"), sort=True)
        rows.notes.append("targets: " + ", ".join(f"{number} is '{name}'" for number, name in enumerate(known[:10])))
        table["target"] = codes
    if unit == "dBm" and not positive:
        rows.refuse(values > MOST_POWER, lambda i: f"a level must be below {MOST_POWER:g} dBm, is {values[i]:g}, no "
                    f"reading? Write: {rows.remedy(f'--missing {values[i]:g}')}")  # fmt: skip
    if MANY_NODES < len(table) == table.node.nunique():
        rows.notes.append(f"each row is of another node: does '{rows.named('node')}' name nodes? --column node= takes "
                          "a file as that of one node")  # fmt: skip
    keys = [name for name in table if name != "reading"]
    if how.repeated:
        if how.repeated == "mean" and unit == "rad":
            raise UsageError("--repeated mean: a mean of angles depends on where they wrap: give first or last")
        again = table[rows.kept].duplicated(keys).sum()
        rows.notes += [f"{counted(again, 'more row')} of a time and node: the {how.repeated} of each counts"] * bool(
            again
        )
        table = table[rows.kept].groupby(keys, as_index=False)["reading"].agg(how.repeated)
    else:
        table = rows.once(table, keys, lambda i: f"repeats time {table.time[i]:.15g} s and node '{table.node[i]}' with "
                          "another reading: --repeated first, last or mean says which counts")  # fmt: skip
    return _imported(rows, table, {"unit": unit, **_rate(table, "node")})


def nodes(files: Sequence[str], how: Conventions = USUALLY) -> Imported:
    """The positions of nodes: id, x, y and perhaps z in m. Raises UsageError and RunError as `readings`."""
    rows = SourceRows(files, how, "nodes", ("id", "x", "y", "z", "lon", "lat"))
    names = rows.texts("id") if "id" in rows.frame else np.arange(len(rows.frame)).astype(str)
    places, origin = rows.places()
    table = pd.DataFrame({"id": names, **places})
    table = rows.once(table, ["id"], lambda i: f"the node '{names[i]}' stands at another place already")
    if len(table) > 1 and not np.ptp(table[["x", "y"]].to_numpy(), axis=0).any():
        rows.notes.append(f"all {len(table)} nodes stand at one place: --column x=NAME names another column")
    return _imported(rows, table, {"nodes": len(table), "origin": origin})


def track(files: Sequence[str], how: Conventions = USUALLY) -> Imported:
    """The trajectories of files: time, id, x, y and perhaps z in m. Raises UsageError and RunError as `readings`."""
    rows = SourceRows(files, how, "track", ("time", "id", "x", "y", "z", "lon", "lat", "speed"))
    times, names = rows.times(), rows.texts("id") if "id" in rows.frame else rows.stems()
    places, origin = rows.places()
    speeds = (
        rows.numbers("speed", optional=True) if "speed" in rows.frame and not origin else np.full(len(times), np.nan)
    )
    table = pd.DataFrame({"time": times, "id": names, **places, "speed": speeds})
    _demand_one_mover(rows, table)
    several = "several movers in one track? Name their column: --column id=NAME"
    table = rows.once(
        table, ["id", "time"], lambda i: f"'{names[i]}' is at another place at {times[i]:.15g} s; {several}"
    )
    for name, one in table.groupby("id", sort=False):
        moves = [one[each].to_numpy() for each in ("time", "x", "y", "speed")]
        if said := slower_than_stated(*moves):
            raise RunError(f"{files[0]}: '{name}': {said}, {other_units(files[0], 'track')}")
        rows.notes += [f"'{name}' {said}" for said in [other_than_stated(*moves)] if said]
    return _imported(rows, table.drop(columns="speed"), {"origin": origin, "span": rows.span(), **_rate(table, "id")})


def _demand_one_mover(rows: SourceRows, table: pd.DataFrame) -> None:
    """Raise UsageError if a column that is not used, or a file without a chosen column, names several movers."""
    if rows.how.names.get("id") == "":
        return
    for number, unused in enumerate(rows.unused):
        here = (rows.frame.file == number).to_numpy()
        for column in unused:
            names = pd.Series(unused[column].astype(str).str.strip().to_numpy(), table.index[here])
            for _, one in table[here & rows.kept].groupby("id"):
                codes, known = pd.factorize(names[one.index])
                column_, points = TextColumn(tuple(known), codes), (one[key].to_numpy() for key in ("time", "x", "y"))
                if said := movers_said(rows.files[number], column, column_, *points):
                    raise UsageError(said)


def trace_of(imported: Imported, path: str, ids: Collection[str]) -> Trace:
    """The chosen movers of an imported track, as a trace. Raises UsageError unless the choice is clear."""
    table = imported.table if "z" in imported.table else imported.table.assign(z=np.nan)
    movers = {str(name): one[["time", "x", "y", "z"]].to_numpy() for name, one in table.groupby("id", sort=False)}
    known = {name: NodeSummary(len(one), float(one[0, 0]), float(one[-1, 0])) for name, one in movers.items()}
    demand_choice(path, known, ids)
    return Trace(path, {name: movers[name] for name in ids or movers}, known)


def links(files: Sequence[str], how: Conventions = USUALLY) -> Imported:
    """Recorded links from tables of delivery ratios: src, dst, prr and perhaps time, channel, power; or a matrix.

    Raises:
        UsageError, RunError: As `readings`.
    """
    rows = SourceRows(files, how, "links", ("time", "src", "dst", "prr", "channel", "power"), _pairs)
    source, receiver, (ratios, _) = rows.texts("src"), rows.texts("dst"), rows.in_unit("prr", ("",))
    rows.leave_out(source == receiver, "of a node and itself")
    wrong, percent = (ratios < 0.0) | (ratios > 1.0), rows.remedy("--unit %")
    rows.refuse(
        wrong, lambda i: f"a delivery ratio must be within 0 and 1, is {ratios[i]:g}, percent? Write: {percent}"
    )
    times = rows.times() if "time" in rows.frame else np.zeros(len(ratios))
    channels, powers = (rows.numbers(name, optional=True) if name in rows.frame else np.full(len(ratios), usual)
                        for name, usual in (("channel", CHANNEL), ("power", np.nan)))  # fmt: skip
    rows.refuse(~np.isin(channels, range(HIGHEST_CHANNEL + 1)), lambda i: f"a channel must be one of 0 to "
                f"{HIGHEST_CHANNEL}, is {channels[i]:g}")  # fmt: skip
    known = len({*source[rows.kept], *receiver[rows.kept]})
    dates = pd.Series(pd.to_datetime(np.round(times * 1e3), unit="ms")).dt.strftime("%Y-%m-%dT%H:%M:%S.%f")
    table = pd.DataFrame({"datetime": dates, "src": source, "dst": receiver, "channel": channels, "mean_rssi": powers})
    table = rows.once(table.assign(pdr=ratios, tx_count=PACKETS), ["datetime", "src", "dst", "channel"], lambda i: (
        f"the link from '{source[i]}' to '{receiver[i]}' has another ratio at this time already: a column time makes "
        "several rounds"))  # fmt: skip
    table, all_ = table[table.pdr > 0.0].astype({"channel": np.int64}), len(table)
    rows.notes += ["all delivery ratios are 0"] * bool(all_ and not len(table))
    if unknown := int(table.mean_rssi.isna().sum()):
        rows.notes.append(f"received powers that are not known: {unknown:,}, for which {UNKNOWN_POWER:g} dBm stands")
    table = table.fillna({"mean_rssi": UNKNOWN_POWER})
    used = sorted(set(table.channel.tolist()))
    header = {"tx_length": PACKETS, "interframe_duration": INTERVAL, "channels": used, "node_count": known}
    return _imported(rows, table, {"nodes": known, "channels": used, "header": header})


def _imported(rows: SourceRows, table: pd.DataFrame, facts: Mapping[str, Any]) -> Imported:
    """What rows became. Raises RunError if none is left."""
    rows.notes += rows.unseen
    if not len(table):
        raise RunError("\n  ".join([f"{', '.join(rows.files)}: no row can be used", *rows.notes]))
    return Imported(rows.kind, table.reset_index(drop=True), {"rows": len(table), **facts}, rows.notes)


def _long(raw: RawTable, roles: dict[str, str], how: Conventions) -> pd.DataFrame:
    """A row per reading: as it is in the file, of the one node of a file, or melted from a column per node."""
    if "node" in roles:
        return columns_of(raw, roles, how)
    if "reading" in roles and not how.node_prefix:
        return columns_of(raw, roles, how).assign(node=Path(raw.path).name.split(".")[0])
    roles.pop("reading", None)
    free = [name for name in raw.frame if name not in roles.values() and name.startswith(how.node_prefix)]
    names = [name for name in free if not column_roles(raw.path, [name], ("x", "y", "z", "lon", "lat"), {})
             and numeric(raw.frame[name]).notna().any()]  # fmt: skip
    if not names:
        raise without(raw.path, raw.frame, "node")
    wide = raw.frame.rename(columns={theirs: ours for ours, theirs in roles.items()})
    part = wide.melt(list(roles), names, "node", "reading", ignore_index=False)
    part["node"] = part["node"].str.removeprefix(how.node_prefix)
    known = listed([name.removeprefix(how.node_prefix) for name in names])
    part.attrs |= {"used": names, "note": f"a column for each of {len(names)} nodes: {known}"}
    return part


def _pairs(raw: RawTable, roles: dict[str, str], how: Conventions) -> pd.DataFrame:
    """A row per link: as it is in the file, or from a square matrix whose rows are senders, columns receivers."""
    if {"src", "dst", "prr"} <= set(roles):
        return columns_of(raw, roles, how)
    counts = {name: theirs for theirs in raw.frame if (name := plain(theirs)) in ("sent", "received")}
    if {"src", "dst"} <= set(roles) and len(counts) == 2:
        part = columns_of(raw, roles, how)
        part["prr"] = numeric(raw.frame[counts["received"]]) / numeric(raw.frame[counts["sent"]])
        part.attrs |= {"used": [*counts.values()], "note": "ratios are those of received to sent"}
        return part
    frame, size = raw.frame, len(raw.frame)
    receivers = list(frame.columns)[-size:]
    if len(frame.columns) not in (size, size + 1):
        raise without(raw.path, frame, next(name for name in ("src", "dst", "prr") if name not in roles))
    roles.clear()
    senders = frame.iloc[:, 0].astype(str) if len(frame.columns) > size else receivers
    part = frame[receivers].assign(src=senders).melt(["src"], receivers, "dst", "prr", ignore_index=False)
    part.attrs["used"] = list(frame.columns)
    return part


def _rate(table: pd.DataFrame, name: str) -> dict[str, Any]:
    """Number of nodes or movers, first and last time, and the median rate (1/s) of one of them."""
    if not len(table):
        return {}
    codes, times = pd.factorize(table[name])[0], table.time.to_numpy()
    order = np.lexsort((times, codes))
    apart = np.diff(times[order])[np.diff(codes[order]) == 0]
    rate = {"rate": float(1.0 / np.median(apart))} if (apart > 0.0).any() else {}
    return {"nodes": int(codes.max()) + 1, "first": float(times.min()), "last": float(times.max()), **rate}
