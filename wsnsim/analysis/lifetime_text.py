"""An estimated lifetime in words: the answer, the table of criteria, who dies first and why, and what is left out.

text([point]) -> str          text(points) -> str, a table with a row for each

A block of such a text is a sentence, or a table: rows of cells, the first of which is the head.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from wsnsim.analysis.phrases import aligned, energy_in_words, wrapped

HOUR, DAY, YEAR, NAN = 3600.0, 86_400.0, 365.25 * 86_400.0, math.nan
Point = Mapping[str, Any]
Block = str | list[list[str]]
NAMES: Final = {
    "first_death": "first node dead", "dead_10": "10 % of nodes dead", "half_dead": "half of nodes dead",
    "coverage": "coverage below {coverage}", "sink": "routes to a sink below {connected}",
    "tracked": "tracked below {tracked}",
}  # fmt: skip
TRACKS: Final = 0.9
"""The share of the steps with a target from which on a network counts as one that tracks (our choice)."""


def label(point: Point) -> str:
    """What distinguishes a point from the others of a comparison."""
    return str(point.get("label", point["name"]))


def _tracked(point: Point) -> float:
    """The share of steps tracked at the first death, or at the start if no node dies; NaN if no target comes."""
    then = point["criteria"][0]["tracked"]
    return float(point["libraries"][0]["tracked"] if math.isnan(then) else then)


def _error(point: Point) -> float:
    """RMSE in m of tracked steps over the visits at the start; NaN if it was not kept."""
    return float(point["libraries"][0].get("error", NAN))


def _tracks(point: Point) -> bool:
    """Whether a network tracks: it has an estimate at most steps, and the error is not that of a lost track."""
    return _tracked(point) >= TRACKS and not _error(point) > point.get("lost_limit", math.inf)


def text(points: Sequence[Point]) -> str:
    """The whole answer, at most 100 columns wide."""
    lines: list[str] = []
    for block in blocks(points):
        lines += (
            wrapped(block, indent="  " * (block[0] == "-")) if isinstance(block, str) else ["", *aligned(block), ""]
        )
    return "\n".join(lines).strip("\n")


def blocks(points: Sequence[Point]) -> Iterator[Block]:
    """The whole answer, which begins with the sentence of `answer`; of several points, what compares them."""
    return _whole(points[0]) if len(points) == 1 else _comparison(points)


def _whole(point: Point) -> Iterator[Block]:
    yield answer(point)
    yield _table(point)
    counts = " + ".join(str(each["visits"]) for each in point["libraries"])
    yield (
        f"From {point['paths']} sample paths with {counts} simulated visits, each simulated with and without the target"
        "; coverage and tracked are shares of those at the start."
    )
    if point["end"] < point["horizon"] and any(row["met"] < 1.0 for row in point["criteria"]):
        yield "Paths end when 60 % of the nodes are dead: > stands for later than the median of these ends."
    if point["tolerance"]:
        yield f"Interruptions up to {point['tolerance']:g} s do not count."
    yield _energy(point)
    yield from _first(point)
    terms = "battery / (quiet power + rate × visit) without self-discharge and harvesting"
    yield f"Two terms, {terms}, give the mean node {_time(point['baseline'], _unit(point))}."
    for title, items in (("notes", point["notes"]), ("not modelled", point["not_modelled"])):
        yield from [f"{title}:", *(f"- {item}" for item in items)] if items else []


def answer(point: Point) -> str:
    """The sentence with the first death, the half-dead time and what is tracked."""
    rows = {row["criterion"]: row for row in point["criteria"]}
    first, unit, start = rows["first_death"], _unit(point), point["libraries"][0]
    share = _share(start["tracked"])
    end = "no target comes" if share == "-" else f"{share} of the steps with a target are tracked at the start"
    if not math.isnan(start.get("error", NAN)):
        end += f" with an RMSE of {start['error']:.3g} m"
    if not math.isnan(first["tracked"]):
        end += f", {_share(first['tracked'])} when the first node has died"
    end += "; idle listening costs nothing in this model." if "idle" not in point["causes"]["cause"] else "."
    if not math.isfinite(first["median"]):
        horizon, none = _time(point["horizon"], unit), _share(1 - first["met"])
        return f"No node dies within {horizon} in {none} of networks like this; {end}"
    words = f"The first node dies after {_time(first['median'], unit)} (95 % of networks like this: "
    words += _span(first["low"], first["high"], point, unit)
    if math.isfinite(first["mean"]):
        half = (first["mean_high"] - first["mean_low"]) / 2.0
        words += f"; mean {_number(first['mean'] / unit[0])} ± {_number(half / unit[0])}"
    words += ")"
    for name, what in (("dead_10", "a tenth of the nodes"), ("half_dead", "half of them")):
        if name in rows and math.isfinite(rows[name]["median"]):
            words += f", {what} after {_number(rows[name]['median'] / unit[0])}"
    return f"{words}; {end}"


def _comparison(points: Sequence[Point]) -> Iterator[Block]:
    """A table with a row for each of several points, whose networks, visits and seeds are the same; what it says."""
    unit = min(map(_unit, points))
    rows = [["", "first death", "95 %", "tracked", "error", "quiet", "visit", "half dead"]]
    for point in points:
        first, *others = point["criteria"]
        error = _error(point)
        rows.append([
            label(point), _in(first["median"], point, unit), _span(first["low"], first["high"], point, unit),
            _share(_tracked(point)), "-" if math.isnan(error) else f"{error:.3g} m", _share(_quiet_share(point)),
            energy_in_words(point["joules"]),
            *(_in(row["median"], point, unit) for row in others if row["criterion"] == "half_dead"),
        ])  # fmt: skip
    yield [row[: min(map(len, rows))] for row in rows]
    yield from _conclusion(points, unit)
    yield (
        f"Times in {unit[1]}; 95 % of networks like this. tracked: share of the steps with a target, at the first "
        "death; error: RMSE of tracked steps over the visits at the start; quiet: share of the energy spent without a "
        "target; visit: energy that a visit adds, below 0 if it takes less than the idle listening in its place. All "
        "have the same seed: where the scenarios allow, the same network and the same visits. --page shows the whole "
        "answer of each."
    )
    if free := ", ".join(label(point) for point in points if "idle" not in point["causes"]["cause"]):
        yield f"Idle listening costs nothing in the model of {free}."


def _conclusion(points: Sequence[Point], unit: tuple[float, str]) -> Iterator[str]:
    """Sentences on who lives longest until the first death: of those that track, and of all."""
    tracking, named = [point for point in points if _tracks(point)], None
    enough = f"track at least {_share(TRACKS)} of the steps (our choice), with an error below that of a lost track"
    every = "Of all" if tracking else f"None is known to {enough}. Of all"
    for whose, among in ((f"Of those that {enough}, {len(tracking)} of {len(points)}", tracking), (every, points)):
        best = max(among, key=lambda point: (point["criteria"][0]["median"], -_error(point)), default=None)
        if best is None or best is named:
            continue
        named, first = best, best["criteria"][0]
        words = f"{whose}, '{label(best)}' lives longest until the first death, {_in(first['median'], best, unit)} "
        words += f"{unit[1]} ({_share(_tracked(best))} tracked then)"
        if count := len(among) - 1:
            near = count - sum(point["criteria"][0]["mean_high"] < first["mean_low"] for point in among)
            words += f"; confidence intervals of the mean that overlap with its, or are unknown: {near} of {count}"
        yield f"{words}."


def _table(point: Point) -> list[list[str]]:
    unit, shares = _unit(point), {name: _share(share) for name, share in point["shares"].items()}
    rows = [[f"in {unit[1]}", "median", "95 % of networks", "mean, 95 % confidence", "met", "tracked then"]]
    for row in point["criteria"]:
        mean, low, high = (_number(row[key] / unit[0]) for key in ("mean", "mean_low", "mean_high"))
        rows.append([
            NAMES[row["criterion"]].format(**shares), _in(row["median"], point, unit),
            _span(row["low"], row["high"], point, unit), "-" if math.isnan(row["mean"]) else f"{mean}, {low} to {high}",
            _share(row["met"]), _share(row["tracked"]),
        ])  # fmt: skip
    return rows


def _quiet_share(point: Point) -> float:
    quiet, visits = sum(point["causes"]["quiet"]), sum(point["causes"]["visits"])
    return float(quiet / (quiet + visits)) if quiet + visits else NAN


def _energy(point: Point) -> str:
    causes, quiet = point["causes"], _quiet_share(point)
    total = sum(causes["quiet"]) + sum(causes["visits"])
    if not total:
        return "The nodes consume nothing."
    each = zip(causes["cause"][:4], causes["quiet"], causes["visits"], strict=False)
    parts = ", ".join(f"{name} {_share((quiet + visits) / total)}" for name, quiet, visits in each)
    visit = (
        f"{point['rate'] * HOUR:.3g} an hour, of {point['seconds']:.3g} s and {energy_in_words(point['joules'])} each"
    )
    visit += ", less than the idle listening in its place" * (point["joules"] < 0.0)
    return (
        f"{_share(quiet)} of the energy is spent without a target, {_share(1 - quiet)} by visits ({visit}). The mean "
        f"node takes {total * 1e3:.3g} mW: {parts}."
    )


def _first(point: Point) -> Iterator[str]:
    if sum(row["share"] for row in point["first"]) > 1.0 + 1e-9:
        yield "Several nodes die first, at the same time: they spend the same."
        return
    for row in point["first"]:
        words = f"Node {row['node']} dies first in {_share(row['share'])} of the paths"
        if row["ratio"] < 1.005:  # more power than that of the mean node would explain it
            words += f", because of its battery or of visits unlike the {point['libraries'][0]['visits']} simulated"
        else:
            words += f": it takes {row['ratio']:.2f} times the mean power"
            words += f", {_share(row['quiet'])} of it without a target (mostly {row['quiet_cause']})"
            words += f", the rest mostly {row['visits_cause']}" * (row["quiet"] <= 0.9995)
        yield f"{words}."


def _unit(point: Point) -> tuple[float, str]:
    """The length in s of the unit of a point's times, and its name."""
    first = point["criteria"][0]["median"]
    reference = first if math.isfinite(first) else point["horizon"]
    if reference < 2 * HOUR:
        return 1.0, "s"
    return (HOUR, "hours") if reference < 3 * DAY else (DAY, "days") if reference < 4 * YEAR else (YEAR, "years")


def _time(seconds: float, unit: tuple[float, str]) -> str:
    return f"{_number(seconds / unit[0])} {unit[1]}"


def _in(seconds: float, point: Point, unit: tuple[float, str]) -> str:
    return _number(seconds / unit[0]) if math.isfinite(seconds) else f"> {_number(point['end'] / unit[0])}"


def _span(low: float, high: float, point: Point, unit: tuple[float, str]) -> str:
    """An interval, of which one end or both may lie beyond the end of the paths."""
    return _in(low, point, unit) if math.isinf(low) else f"{_in(low, point, unit)} to {_in(high, point, unit)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _share(value: float) -> str:
    return "-" if math.isnan(value) else f"{round(100 * value)} %"
