"""An estimated lifetime in words: the answer, the table of criteria, who dies first and why, and what is left out.

text(point) -> str          several(points) -> str, a table with a row for each
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from wsnsim.analysis.phrases import aligned, width, wrapped
from wsnsim.base.errors import counted

HOUR, DAY, YEAR = 3600.0, 86_400.0, 365.25 * 86_400.0
Point = Mapping[str, Any]
NAMES: Final = {
    "first_death": "first node dead", "dead_10": "10 % of nodes dead", "half_dead": "half of nodes dead",
    "coverage": "coverage below {}", "sink": "routes to a sink below {}", "tracked": "tracked below {}",
}  # fmt: skip
SHARES: Final = {"coverage": "coverage", "sink": "connected", "tracked": "tracked"}


def text(point: Point) -> str:
    """The whole answer, at most 100 columns wide."""
    lines = [*wrapped(answer(point)), "", *_table(point), "", *wrapped(_energy(point)), *_first(point)]
    lines += wrapped(_baseline(point))
    for title, items in (("notes", point["notes"]), ("not modelled", point["not_modelled"])):
        lines += [f"{title}:"] if items else []
        lines += [
            line
            for item in items
            for line in textwrap.wrap(item, width(), initial_indent="  - ", subsequent_indent="    ")
        ]
    return "\n".join(lines)


def answer(point: Point) -> str:
    """The sentence with the first death, the half-dead time and what is tracked."""
    rows = {row["criterion"]: row for row in point["criteria"]}
    first, unit = rows["first_death"], _unit(point)
    start = _tracked_at_start(point)
    if not math.isfinite(first["median"]):
        words = (
            f"No node dies within {_time(point['horizon'], unit)} in {_share(1 - first['met'])} of networks like this"
        )
        return f"{words}; {start}."
    words = f"The first node dies after {_time(first['median'], unit)} (95 % of networks like this: "
    words += _span(first["low"], first["high"], point, unit)
    if math.isfinite(first["mean"]):
        half = (first["mean_high"] - first["mean_low"]) / 2.0
        words += f"; mean {_number(first['mean'] / unit[0])} ± {_number(half / unit[0])}"
    words += ")"
    for name, what in (("dead_10", "a tenth of the nodes"), ("half_dead", "half of them")):
        if name in rows and math.isfinite(rows[name]["median"]):
            words += f", {what} after {_number(rows[name]['median'] / unit[0])}"
    if not math.isnan(first["tracked"]):
        start += f", {_share(first['tracked'])} when the first node has died"
    return f"{words}; {start}."


def several(points: Sequence[Point], labels: Sequence[str]) -> str:
    """A table with a row for each of several scenarios, whose networks, visits and seeds are the same."""
    unit = _unit(points[0])
    rows = [["", "first death", "95 %", "half dead", "tracked", "then", "quiet", "visit", "two-term"]]
    for label, point in zip(labels, points, strict=True):
        found = {row["criterion"]: row for row in point["criteria"]}
        first, half = found["first_death"], found.get("half_dead")
        rows.append([
            label, _in(first["median"], point, unit), _span(first["low"], first["high"], point, unit),
            _in(half["median"], point, unit) if half else "-", _share(point["libraries"][0]["tracked"]),
            _share(first["tracked"]), _share(_quiet_share(point)), f"{point['joules']:.3g} J",
            _in(point["baseline"], point, unit),
        ])  # fmt: skip
    foot = (
        f"Times in {unit[1]}. tracked: share of steps at the start, and when the first node has died; quiet: share of "
    )
    foot += "the energy spent without a target; visit: energy that a visit adds; two-term: battery / (quiet power + "
    foot += "rate × visit). All have the same seed: where the scenarios allow, the same network and the same visits."
    return "\n".join([*aligned(rows), "", *wrapped(foot), *_gain(points, labels, unit)])


def _gain(points: Sequence[Point], labels: Sequence[str], unit: tuple[float, str]) -> Iterator[str]:
    """A sentence on who lives longest until the first death."""
    medians = [point["criteria"][0]["median"] for point in points]
    if len(points) < 2 or not all(map(math.isfinite, medians)):
        return
    best = max(range(len(points)), key=medians.__getitem__)
    others = [other for other in range(len(points)) if other != best]
    apart = [o for o in others if points[o]["criteria"][0]["mean_high"] < points[best]["criteria"][0]["mean_low"]]
    words = f"'{labels[best]}' lives longest until the first death, {_time(medians[best], unit)}"
    sure = "the confidence intervals of the means do not overlap with any other" if len(apart) == len(others) else (
        f"but the confidence intervals of {counted(len(others) - len(apart), 'mean')} overlap with it or are unknown"
    )  # fmt: skip
    yield from wrapped(f"{words} ({_share(points[best]['criteria'][0]['tracked'])} tracked then); {sure}.")


def _table(point: Point) -> list[str]:
    unit = _unit(point)
    rows = [[f"in {unit[1]}", "median", "95 % of networks", "mean, 95 % confidence", "met", "tracked then"]]
    for row in point["criteria"]:
        name = row["criterion"]
        mean = "-"
        if math.isfinite(row["mean"]):
            low, high = (_number(row[key] / unit[0]) for key in ("mean_low", "mean_high"))
            mean = f"{_number(row['mean'] / unit[0])}, {low} to {high}"
        label = NAMES[name].format(_share(point["shares"].get(SHARES.get(name, ""), 0.0)))
        span = _span(row["low"], row["high"], point, unit)
        rows.append([label, _in(row["median"], point, unit), span, mean, _share(row["met"]), _share(row["tracked"])])
    counts = " + ".join(str(each["visits"]) for each in point["libraries"])
    shown = [*aligned(rows), "", *wrapped(
        f"From {point['paths']} sample paths with {counts} simulated visits, each simulated with and without the target"
        f"; coverage and tracked are shares of those at the start. {_tracked_at_start(point).capitalize()}."
    )]  # fmt: skip
    if point["end"] < point["horizon"] and any(row["met"] < 1.0 for row in point["criteria"]):
        shown += wrapped("Paths end when 60 % of the nodes are dead: > stands for later than the median of these ends.")
    if point["tolerance"]:
        shown += wrapped(f"Interruptions up to {point['tolerance']:g} s do not count.")
    return shown


def _tracked_at_start(point: Point) -> str:
    share = point["libraries"][0]["tracked"]
    return (
        "no target comes"
        if math.isnan(share)
        else f"{_share(share)} of the steps with a target are tracked at the start"
    )


def _quiet_share(point: Point) -> float:
    quiet, visits = sum(point["causes"]["quiet"]), sum(point["causes"]["visits"])
    return float(quiet / (quiet + visits)) if quiet + visits else math.nan


def _energy(point: Point) -> str:
    causes = point["causes"]
    total = sum(causes["quiet"]) + sum(causes["visits"])
    if not total:
        return "The nodes consume nothing."
    parts = [
        f"{name} {_share((quiet + visits) / total)}"
        for name, quiet, visits in zip(causes["cause"][:4], causes["quiet"], causes["visits"], strict=False)
    ]
    visit = f"visits ({point['rate'] * HOUR:.3g} an hour, of {point['seconds']:.3g} s and {point['joules']:.3g} J each)"
    return (
        f"{_share(_quiet_share(point))} of the energy is spent without a target, "
        f"{_share(1 - _quiet_share(point))} by {visit}. The mean node takes {total * 1e3:.3g} mW: {', '.join(parts)}."
    )


def _first(point: Point) -> Iterator[str]:
    for row in point["first"]:
        words = (
            f"Node {row['node']} dies first in {_share(row['share'])} of the paths: it takes {row['ratio']:.2f} times "
        )
        words += f"the mean power, {_share(row['quiet'])} of it without a target (mostly {row['quiet_cause']})"
        rest = "" if row["quiet"] > 0.9995 else f", the rest mostly {row['visits_cause']}"
        yield from wrapped(f"{words}{rest}.")


def _baseline(point: Point) -> str:
    unit = _unit(point)
    return f"Two terms, battery / (quiet power + rate × visit), give the mean node {_time(point['baseline'], unit)}."


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
    known = math.isfinite(seconds)
    return _number(seconds / unit[0]) if known else f"> {_number(point['end'] / unit[0])}"


def _span(low: float, high: float, point: Point, unit: tuple[float, str]) -> str:
    """An interval, of which one end or both may lie beyond the end of the paths."""
    return _in(low, point, unit) if math.isinf(low) else f"{_in(low, point, unit)} to {_in(high, point, unit)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _share(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.0f} %"
