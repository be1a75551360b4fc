"""A comparison as a table for a terminal, and its answer in a sentence: which point has the least error.

    text(compared) -> str
    answer(found) -> 'ekf has the smallest median per-run RMSE: 0.412 m, better than pf by the paired tests.'

How often the best point loses its target stands beside its error, which is over all runs. Where runs are not paired,
the sentence says whether intervals overlap, which decides nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import pandas as pd

from wsnsim.analysis.answer import SEEN, percent
from wsnsim.analysis.campaign_info import label, point_name
from wsnsim.analysis.comparison import ENERGY, MOST_LOST, Comparison
from wsnsim.analysis.conclusions import (
    DEGENERATED,
    DIFFERENT_PARTICLES,
    ERRORS,
    PACKETS_DECIDED,
    number,
    shows_difference,
    verdicts,
)
from wsnsim.analysis.phrases import aligned, wrapped
from wsnsim.analysis.plot_data import bracketed
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.errors import counted, printable
from wsnsim.base.tables import MORE_IS_BETTER, ONE_IS_BEST, UNLABELLED
from wsnsim.bounds.least_errors import FAULTLESS

MOST_SENTENCES: Final = 3
"""Groups up to which each has a sentence of its own (our choice)."""


def answer(found: Comparison) -> str:
    """The sentence; of each group of points in turn if other keys vary, too. Empty if there is nothing to compare."""
    names = found.by or found.keys
    others = [key for key in found.keys if key not in names]
    groups: dict[str, list[int]] = {}
    for row in range(len(found.table)):
        where = ", ".join(f"{key} = {label([_plain(found.table[key].iloc[row])])}" for key in others)
        groups.setdefault(where, []).append(row)
    if len(groups) > MOST_SENTENCES:
        return _counted(found, [found.table.iloc[rows] for rows in groups.values()], names, others)
    said = [(where, _of_group(found, found.table.iloc[rows], names)) for where, rows in groups.items()]
    return " ".join(f"{where}: {text}" if where else text for where, text in said if text)


def _counted(found: Comparison, groups: list[pd.DataFrame], names: tuple[str, ...], others: list[str]) -> str:
    """In how many groups each point is the best, the most frequent one first."""
    ranked = [(known, _order(known, found.metric)) for known in map(_with_value, groups) if len(known) > 1]
    alone = [known.loc[order.index[0]] for known, order in ranked if (order == order.iloc[0]).sum() == 1]
    if not alone:
        return ""
    first, *rest = Counter(_name(best, names) for best in alone).most_common(MOST_SENTENCES)
    more = "".join(f", {point} at {count}" for point, count in rest)
    name = f"{_word(found.metric)} median {run_metric_name(found.metric)}"
    return f"{first[0]} has the {name} at {first[1]} of {len(groups)} values of {' and '.join(others)}{more}."


def _with_value(table: pd.DataFrame) -> pd.DataFrame:
    """The points whose metric is known."""
    return table[table["median"].map(math.isfinite)]


def _order(known: pd.DataFrame, metric: str) -> pd.Series:
    """The ranks of the points, the best first."""
    return known["median"].map(lambda value: _rank(value, metric)).sort_values(kind="stable")


def _of_group(found: Comparison, table: pd.DataFrame, names: tuple[str, ...]) -> str:
    """The sentence on the points of one group; empty if fewer than two have a value."""
    known = _with_value(table)
    if len(known) < 2:
        return ""
    best = known.loc[_order(known, found.metric).index[0]]
    tied = int((known["median"].map(number) == number(best["median"])).sum())  # what is shown must differ
    name, point = f"median {run_metric_name(found.metric)}", _name(best, names)
    value = f"{number(best['median'])}{f' {found.unit}' if found.unit not in ('', '1') else ''}"
    if tied > 1:
        return f"No point alone has the {_word(found.metric)} {name}: {tied} points have {value}."
    rest = _tested(found, best, known, names) + _losses(best, known, names, found.lost)
    return f"{point} has the {_word(found.metric)} {name}: {value}{rest}."


def _tested(found: Comparison, best: pd.Series, known: pd.DataFrame, names: tuple[str, ...]) -> str:
    """What the paired tests show of the best point; where none has it, whether its interval overlaps with others."""
    if "pairs" not in known:
        return _overlap(best, known, names)
    pairs, bases = known[known["pairs"] >= LEAST], known[known["pairs"].isna()]
    if best.name in bases.index:
        beaten, hint = pairs[[shows_difference(pair) for _, pair in pairs.iterrows()]], ""
    else:
        pairs = pairs.loc[pairs.index == best.name]
        beaten = bases if not pairs.empty and shows_difference(best) else bases[:0]
        hint = f"; --baseline {_name(best, names)} tests it against all" * (len(known) > 2 and not pairs.empty)
    if pairs.empty:
        return _overlap(best, known, names)
    rank = "better" if found.metric in ERRORS else "higher" if found.metric in MORE_IS_BETTER else "lower"
    listed = ", ".join(_name(row, names) for _, row in beaten.iterrows())
    return (
        f", {rank} than {listed} by the paired tests" if listed else ", but no paired test shows a difference"
    ) + hint


def _overlap(best: pd.Series, known: pd.DataFrame, names: tuple[str, ...]) -> str:
    """Whether the interval of the best point overlaps with others."""
    others = known.drop(index=best.name)
    if others.empty or not all(map(math.isfinite, (best["median_low"], *known["median_low"]))):
        return ""
    met = others[(others["median_low"] <= best["median_high"]) & (others["median_high"] >= best["median_low"])]
    if met.empty:
        return ", and its 95 % interval overlaps with no other"
    shown = ", ".join(_name(row, names) for _, row in met.head(3).iterrows())
    more = f" and {len(met) - 3} more" if len(met) > 3 else ""
    return f", and its 95 % interval overlaps with that of {shown}{more}"


def _losses(best: pd.Series, known: pd.DataFrame, names: tuple[str, ...], rule: str) -> str:
    """In how many runs the best point loses its target, and which point does so least; empty if it never does."""
    if not best["ever_lost"] > 0.0:
        return ""
    least = known.loc[known["ever_lost"].idxmin()]
    said = f"; it loses the target{f' ({rule})' if rule else ''} in {percent(best['ever_lost'])} of its runs"
    if least["ever_lost"] == best["ever_lost"]:
        return f"{said}, and no other in fewer"
    return f"{said}, {_name(least, names)} in the fewest: {percent(least['ever_lost'])}"


def _rank(value: float, metric: str) -> float:
    """What is least for the best value of a metric."""
    return (
        abs(math.log(value)) if metric in ONE_IS_BEST and value > 0.0 else -value if metric in MORE_IS_BETTER else value
    )


def _word(metric: str) -> str:
    return "most consistent" if metric in ONE_IS_BEST else "largest" if metric in MORE_IS_BETTER else "smallest"


def _name(row: pd.Series, names: tuple[str, ...]) -> str:
    """The point's values of the compared keys; numbers with their keys."""
    return point_name(names, [_plain(row[name]) for name in names])


def _plain(value: Any) -> Any:
    return None if value is pd.NA or value != value else value


DIFFERENCE: Final = "difference"
"""The first column of what is about pairs of points."""
MOST_LATE: Final = 3
"""Points up to which a hint gives the latency of each (our choice)."""


def text(found: Comparison, explain: bool = False) -> str:
    """The answer in a sentence, the table, what its pairs show, and notes; `explain`: also what the columns mean."""
    table = found.table
    heads, rows = columns(found)
    counts = table["replicates"]
    many = f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
    title = f"{found.name}: {len(table)} point{'s' * (len(table) != 1)}, {many} run{'s' * (many != '1')} each"
    below = [*notes(found), *(_meanings(found) if explain else [])]
    return "\n".join(
        [
            *wrapped(answer(found)),
            *wrapped(title, indent="  "),
            *aligned([heads, *rows], len(found.keys), heads.index(DIFFERENCE) if DIFFERENCE in heads else 0),
            *(line for said in conclusions(found) for line in wrapped(said, "- ")),
            *(line for note in below for line in wrapped(note, "  ")),
        ]
    )


OF_A_PAPER: Final = ("median", "bound", "ever_lost", "energy", "p_holm")
"""Columns that a table in a paper has, beside the settings; as many as fit a column of the page."""


SHORTER: Final = {"tracker.kind": "tracker", "Wilcoxon p": "p"}
"""Headings in a paper, where every character counts."""


def latex(found: Comparison) -> str:
    """The columns that a paper shows as LaTeX, for the package booktabs; `--csv` has all."""
    heads, rows = columns(found, OF_A_PAPER)
    heads = [SHORTER.get(head, head.replace(" per-run", "")) for head in heads]
    lines = [" & ".join(map(_in_latex, row)) + r" \\" for row in [heads, *rows]]
    sides = "l" * len(found.keys) + "r" * (len(heads) - len(found.keys))
    begin = f"\\begin{{tabular}}{{{sides}}}"
    return "\n".join([begin, r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule", r"\end{tabular}", ""])


def _in_latex(text: str) -> str:
    """The text with LaTeX's own characters escaped."""
    words = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(words.get(c) or (f"\\{c}" if c in "&%$#_{}" else c) for c in printable(text))


def conclusions(found: Comparison) -> list[str]:
    """What the pairs show: a sentence each if they are few, else one for all that are alike; then each hint once."""
    if "conclusion" not in found.table:
        return []
    paired = found.table[found.table["conclusion"] != ""]
    return [*(paired["conclusion"] if len(paired) <= MOST_SENTENCES else _alike(found, paired)), *_hints(paired)]


def _alike(found: Comparison, paired: pd.DataFrame) -> list[str]:
    """A sentence on all pairs of which the same holds."""
    groups: dict[str, list[str]] = {}
    for _, row in paired.iterrows():
        for verdict in verdicts(row, found.metric):
            groups.setdefault(verdict, []).append(label(_plain(row[key]) for key in found.keys))
    base = point_name(found.by, [found.baseline])
    return [f"{verdict.format(base)}: {', '.join(names)}" for verdict, names in groups.items()]


def _hints(paired: pd.DataFrame) -> list[str]:
    """Each hint once: the latencies of the points that it is on, and what is said of particles."""
    pieces = dict.fromkeys(piece for hint in paired["hint"] for piece in hint.split("; ") if piece)
    particles = [piece for piece in pieces if piece.startswith(DIFFERENT_PARTICLES) or DEGENERATED in piece]
    late = list(dict.fromkeys(piece.removeprefix(PACKETS_DECIDED) for piece in pieces if piece not in particles))
    more = [f"and {len(late) - MOST_LATE} more points"] if len(late) > MOST_LATE else []
    said = [PACKETS_DECIDED + "; ".join([*late[:MOST_LATE], *more])] if late else []
    return [f"hint: {text}" for text in [*said, *particles]]


def columns(found: Comparison, only: Sequence[str] = ()) -> tuple[list[str], list[list[str]]]:
    """Return the headings of the table, and the cells of each row as texts; `only`: of these columns and the keys."""
    table, name, shown = found.table, run_metric_name(found.metric), _shown_parts(found)
    faultless = " without faults" * (FAULTLESS in found.of_bounds)
    candidates: list[tuple[bool, str, str, Cells]] = [
        *((True, key, key, _each(_setting)) for key in found.keys),
        (table["replicates"].nunique() > 1, "runs", "replicates", _each(_setting)),
        (True, f"median {name}{bracketed(found.unit)}", "median", _spreads),
        (True, "mean", "mean", _each(_number)),
        (shown["nees"], "median over steps", "nees_median", _each(_number)),
        (shown["nees"], "singular", "singular", _each("{:.0f}".format)),
        (shown["bound"], f"CRLB{faultless}", "bound", _each(_number)),
        (shown["tracked"], "tracked", "tracked", _each(_percents)),
        (True, "ever lost", "ever_lost", _each(_percents) if only else _shares),
        (shown["lost at the end"], "at the end", "lost_fraction", _each(_percents)),
        (found.metric != ENERGY and (table["energy"] > 0).any(), "energy [J]", "energy", _each(_number)),
        (shown["front"], "Pareto", "front", _each({True: "*", False: ""}.__getitem__)),
        (shown["difference"], DIFFERENCE, DIFFERENCE, _spreads),
        (shown["difference"], "effect", "effect", _each(partial(_number, digits=2))),
        (shown["difference"], "Wilcoxon p", "p_holm", _each(partial(_number, digits=2))),
        (shown["McNemar"], "McNemar p of losses", "p_losses_holm", _each(partial(_number, digits=2))),
    ]
    kept = {*found.keys, *(only or table.columns)}
    chosen = [(head, cells(table, column)) for wanted, head, column, cells in candidates if wanted and column in kept]
    return [head for head, _ in chosen], [list(row) for row in zip(*(cells for _, cells in chosen), strict=True)]


def _shown_parts(found: Comparison) -> dict[str, bool]:
    """Which optional columns say something. The Pareto front needs energy and a metric beside it."""
    table = found.table
    difference = "difference" in table and table["pairs"].notna().any()
    of_error = found.metric != ENERGY and found.metric not in ONE_IS_BEST
    return {
        "nees": found.metric == "nees",
        "bound": "bound" in table and table["bound"].notna().any(),
        "tracked": (table["tracked"] < SEEN).any(),
        "lost at the end": found.metric != "lost" and (table["lost_fraction"] != table["ever_lost"]).any(),
        "front": of_error and (table["energy"] > 0).any(),
        "difference": difference,
        "McNemar": difference and table["p_losses"].notna().any(),
    }


def notes(found: Comparison) -> Iterator[str]:
    """What a reader must know beside the table."""
    table, few = found.table, found.table["replicates"].max() < LEAST
    unknown = int((table["replicates"] - table["known"]).sum())
    yield f"[ , ]: 95 % intervals{f'; of medians only from {LEAST} runs on' if few else ''}" + (
        f"; lost: {found.lost}" if found.lost else ""
    )
    if _shown_parts(found)["front"] and (table["ever_lost"] > MOST_LOST).all():
        yield "no point is on the Pareto front: each loses its target in more than 5 % of its runs"
    if unknown:
        name = run_metric_name(found.metric)
        yield f"without {name}: {counted(unknown, 'run')}; medians and means are over the others"
    for head, said in (("no bound: ", found.unbounded), ("of the bound: ", found.of_bounds)):
        if said:
            yield f"{head}{said}"
    yield from filter(None, (found.same, found.replayed, found.unpaired))


def _meanings(found: Comparison) -> list[str]:
    """What the columns that are shown mean."""
    table, name, shown = found.table, run_metric_name(found.metric), _shown_parts(found)
    better = "larger" if found.metric in MORE_IS_BETTER else "smaller"
    among = "point of its group" if found.by and set(found.keys) - set(found.by) else "point"
    survivors = ", over the runs in which neither lost its target at any time (difference_all: over all runs)"
    some_lost = shown["difference"] and found.metric in ERRORS and (table["pairs"] < table["common"]).any()
    candidates = [
        (True, "intervals: of medians and differences by bootstrap, of shares by Wilson's score"),
        (True, "ever lost: share of the runs that lost a target at any time"),
        (found.metric in ONE_IS_BEST,
         f"{name}: per degree of freedom; 1 is consistent, above 1 overconfident, below 1 cautious"),
        (shown["nees"],
         "median over steps: of each run, median over runs; a consistent filter has 0.69 in the plane, 0.45 on a"
         " line; singular: steps of all runs with a singular covariance, which have no NEES"),
        (shown["tracked"],
         "tracked: share of the steps with an estimate in time"
         + f"; {name} is over the steps with an estimate" * (found.metric not in UNLABELLED)),
        (shown["front"] and table["front"].any(),
         f"Pareto: * is on the Pareto front: no other {among} has both a {better} median {name} and less"
         " energy; points with more than 5 % of their runs lost at any time are left out"),
        (shown["difference"],
         f"difference: median over runs of the paired difference from {found.baseline}{survivors if some_lost else ''};"
         " effect: rank-biserial correlation, from -1 (always less) to 1 (always more);"
         " Wilcoxon p: signed-rank test, Holm-corrected over all tests; the interval is of each pair alone"),
        (shown["McNemar"],
         "McNemar p: exact test of runs lost by one of the two alone, Holm-corrected over all tests"),
        (shown["bound"],
         "CRLB: trajectory-conditional Cramer-Rao lower bound of all readings in range, median over runs;"
         " not a strict bound: a filter may be below it on some trajectories (--json also has the posterior CRLB)"),
    ]  # fmt: skip
    return [note for wanted, note in candidates if wanted]


Cells = Callable[[pd.DataFrame, str], list[str]]
"""The texts of a column of a table, from the columns of its name."""


def _each(cell: Callable[[Any], str]) -> Cells:
    return lambda table, column: [cell(value) for value in table[column]]


def _setting(value: Any) -> str:
    return "-" if _plain(value) is None else label([value])


def _percents(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "-"


def _spreads(table: pd.DataFrame, column: str) -> list[str]:
    ends = zip(*(table[f"{column}{end}"] for end in ("", "_low", "_high")), strict=True)
    numbers = [(_number(value), _number(low), _number(high)) for value, low, high in ends]
    return [value if "-" in (value, low) else f"{value} [{low}, {high}]" for value, low, high in numbers]


def _shares(table: pd.DataFrame, column: str) -> list[str]:
    ends = zip(*(100.0 * table[f"{column}{end}"] for end in ("", "_low", "_high")), strict=True)
    return [f"{value:.0f} % [{low:.0f}, {high:.0f}]" for value, low, high in ends]
