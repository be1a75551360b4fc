"""Mobility of ns-3: ns-2 movement traces (`setdest`), and logs of course changes.

Two formats, told apart line by line:

    $node_(3) set X_ 12.5                                 position from the beginning; also Y_, Z_
    $ns_ at 4.0 "$node_(3) setdest 80.0 20.0 1.5"         from 4 s towards (80, 20) at 1.5 m/s; at rest on arrival
    $ns_ at 9.0 "$node_(3) set X_ 30.0"                   jumps
    now=+4s node=3 pos=10:20:0 vel=1.2:0:0                 MobilityHelper::EnableAscii, and a callback on CourseChange

The first format is read as ns-3's `Ns2MobilityHelper` reads it: a command replaces the one before it. Between two
course changes the velocity is constant, as with the models of ns-3 that move along straight legs. Where the next course
change is not where the velocity leads, the node jumps; a jump takes `JUMP` (our choice).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError
from wsnsim.interop.traces import TraceEntry, ascending, finite_number
from wsnsim.models.csvfile import LONGEST_SHOWN, open_text

JUMP: Final = 1e-6
"""s: the time between two places of a jump."""
SAME_PLACE: Final = 1e-3
"""m, relative to the greatest coordinate beyond 1000 m: distance that the rounding of a log explains (our choice)."""
ASCII_DIGITS: Final = 6
"""Significant digits of the coordinates in a log, unless the program that wrote it says otherwise."""
DESTINATION, PLACE, COURSE = "setdest", "set", "course"
AXES: Final = ("X_", "Y_", "Z_")

NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?"
"""As all patterns here: possessive, so that a text is read once, however long it is."""
_NODE = r"\$node_\((?P<node>\d++)\)"
_SET = re.compile(rf"{_NODE}\s++set\s++(?P<axis>[XYZ]_)\s++(?P<value>\S++)\s*+$")
_AT = re.compile(r"\$\w++\s++at\s++(?P<time>\S++)\s++\"?(?P<command>[^\"]*+)\"?\s*+$")
_GO = re.compile(rf"{_NODE}\s++setdest\s++(?P<x>\S++)\s++(?P<y>\S++)\s++(?P<speed>\S++)\s*+$")
_COURSE = re.compile(r"now=(?P<time>\S++)\s++node=(?P<node>\S++)\s++pos=(?P<pos>\S++)\s++vel=(?P<vel>\S++)\s*+$")
_TIME = re.compile(rf"(?P<number>{NUMBER})(?P<unit>[a-z]*+)")
SECONDS: Final = {
    "": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15,
    "min": 60.0, "h": 3600.0, "d": 86400.0, "y": 365 * 86400.0,
}  # fmt: skip
SKIPPED: Final = ("#", "$god_", "$ns_ at", "$topo", "set ")
ALLOWED: Final = (
    "'$node_(I) set X_ V', '$ns_ at T \"$node_(I) setdest X Y SPEED\"' or 'now=T node=I pos=X:Y:Z vel=X:Y:Z' is allowed"
    " (a table with the header `t id x y` is read by wsnsim import sumo)"
)


def entries(path: str) -> Iterator[TraceEntry]:
    """Yield the entries of a trace. Raises RunError with file and line if a line cannot be read."""
    with open_text(path) as file:
        for line, text in enumerate(file, start=1):
            words = text.strip()
            if words and (entry := _entry(words, path, line)):
                yield entry


def track(path: str, kept: Sequence[TraceEntry], end: float) -> Floats:
    """(n, 4) time, x, y, z of one node, from its beginning to the last time of the trace."""
    logged = [entry for entry in kept if entry.word == COURSE]
    if logged and len(logged) < len(kept):
        other = next(entry for entry in kept if entry.word != COURSE)
        raise RunError(
            f"{path}:{other.line}: node {other.node} has course changes and commands; one of both is allowed"
        )
    rows = _of_courses(logged, end) if logged else _of_commands(path, kept, end)
    return ascending(rows)


def _entry(words: str, path: str, line: int) -> TraceEntry | None:
    """The entry of a line; None for lines about other things."""
    place = f"{path}:{line}"
    if words.startswith("now="):
        return _course(words, place, line)
    time, command = math.nan, words
    if scheduled := _AT.match(words):
        if "$node_" not in scheduled["command"]:
            return None  # such as $god_ and `stop`
        time, command = finite_number(scheduled["time"], f"{place}: the time"), scheduled["command"].strip()
        if time < 0:
            raise RunError(f"{place}: the time must not be negative, is {time:g}")
    elif words.startswith(SKIPPED):
        return None
    if found := _GO.match(command):
        if math.isnan(time):
            raise RunError(f"{place}: setdest needs a time: '$ns_ at T \"$node_(I) setdest X Y SPEED\"'")
        values = tuple(finite_number(found[name], f"{place}: {name}") for name in ("x", "y", "speed"))
        if values[2] < 0:
            raise RunError(f"{place}: the speed must not be negative, is {values[2]:g}")
        return TraceEntry(line, found["node"], time, DESTINATION, values)
    if found := _SET.match(command):
        value = finite_number(found["value"], f"{place}: {found['axis']}")
        return TraceEntry(line, found["node"], time, PLACE, (float(AXES.index(found["axis"])), value))
    raise RunError(f"{place}: cannot read {words[:80]!r}; {ALLOWED}")


def _course(words: str, place: str, line: int) -> TraceEntry:
    """The entry of a course change."""
    found = _COURSE.match(words)
    if not found:
        raise RunError(f"{place}: cannot read {words[:80]!r}; 'now=T node=I pos=X:Y:Z vel=X:Y:Z' is allowed")
    time = _TIME.fullmatch(found["time"])
    if not time or time["unit"] not in SECONDS:
        raise RunError(
            f"{place}: cannot read the time {found['time'][:LONGEST_SHOWN]!r}; such as +4s or +4e+09ns is allowed"
        )
    values = []
    for name, triple in (("pos", found["pos"]), ("vel", found["vel"])):
        numbers = triple.split(":")
        if len(numbers) != 3:
            raise RunError(f"{place}: {name} must be three numbers X:Y:Z, is {triple[:LONGEST_SHOWN]!r}")
        values += [finite_number(number, f"{place}: {name}") for number in numbers]
    return TraceEntry(line, found["node"], float(time["number"]) * SECONDS[time["unit"]], COURSE, tuple(values))


Rows = list[tuple[float, float, float, float]]


def _of_courses(logged: Sequence[TraceEntry], end: float) -> Rows:
    """The points at course changes, with the legs between them; the last leg goes on to the end of the log."""
    rows: Rows = []
    last: dict[float, TraceEntry] = {entry.time: entry for entry in logged}  # several at one time: the last counts
    courses = [last[time] for time in sorted(last)]
    for before, after in zip([None, *courses], courses, strict=False):
        if before is not None:
            there = _moved(before, after.time)
            if math.dist(there[:2], after.values[:2]) > _rounding(before, after):
                rows.append((max(after.time - JUMP, before.time), *_moved(before, after.time - JUMP)))
        rows.append((after.time, *_moved(after, after.time)))
    if end > courses[-1].time:
        rows.append((end, *_moved(courses[-1], end)))
    return rows


def _moved(course: TraceEntry, time: float) -> tuple[float, float, float]:
    """Where a course leads by a time."""
    x, y, z, vx, vy, vz = course.values
    passed = time - course.time
    return x + vx * passed, y + vy * passed, z + vz * passed


def _rounding(before: TraceEntry, after: TraceEntry) -> float:
    """How far (m) the end of a leg may be from the next place because numbers of a log have six digits."""
    largest = max(1.0, *(abs(value) for value in (*before.values[:2], *after.values[:2])))
    speed = max(abs(before.values[3]), abs(before.values[4]))
    return max(SAME_PLACE, 10.0 ** (1 - ASCII_DIGITS) * (largest + speed * (after.time - before.time)))


def _of_commands(path: str, kept: Sequence[TraceEntry], end: float) -> Rows:
    """The points at which the movement of an ns-2 trace changes."""
    x, y, z = (_initial(path, kept, axis) for axis in range(3))
    rows: Rows = [(0.0, x, y, z)]
    goal: tuple[float, float, float] | None = None  # of the present leg: x, y and time of arrival
    scheduled = sorted((entry for entry in kept if not math.isnan(entry.time)), key=lambda entry: entry.time)
    for entry in scheduled:
        time = entry.time
        if goal is not None:
            x, y = _on_the_way(rows[-1], goal, min(time, goal[2]))
            if goal[2] < time:
                rows.append((goal[2], x, y, z))
            goal = None
        rows.append((max(time - JUMP, rows[-1][0]) if entry.word == PLACE else time, x, y, z))
        if entry.word == DESTINATION:
            goal = _goal(entry, x, y)
        else:
            x, y, z = (entry.values[1] if axis == entry.values[0] else old for axis, old in enumerate((x, y, z)))
            rows.append((time, x, y, z))
    if goal is not None:
        rows.append((goal[2], goal[0], goal[1], z))
    if end > rows[-1][0]:
        rows.append((end, *rows[-1][1:]))
    return rows


def _initial(path: str, kept: Sequence[TraceEntry], axis: int) -> float:
    """The coordinate from the beginning; z may be missing."""
    found = [entry for entry in kept if math.isnan(entry.time) and entry.values[0] == axis]
    if not found and axis < 2:
        entry = kept[0]
        raise RunError(f"{path}:{entry.line}: node {entry.node} has no initial {AXES[axis]}: '$node_({entry.node}) set "
                       f"{AXES[axis]} V' is missing")  # fmt: skip
    return found[-1].values[1] if found else math.nan


def _goal(entry: TraceEntry, x: float, y: float) -> tuple[float, float, float] | None:
    """Where a command leads and when it arrives; None if it stops the node, or the node is there."""
    goal_x, goal_y, speed = entry.values
    far = math.dist((x, y), (goal_x, goal_y))
    return (goal_x, goal_y, entry.time + far / speed) if speed > 0 and far > 0 else None


def _on_the_way(start: tuple[float, ...], goal: tuple[float, float, float], time: float) -> tuple[float, float]:
    """x and y at a time between the start of a leg, (time, x, y, z), and its goal, (x, y, time)."""
    share = (time - start[0]) / (goal[2] - start[0])
    return start[1] + share * (goal[0] - start[1]), start[2] + share * (goal[1] - start[2])
