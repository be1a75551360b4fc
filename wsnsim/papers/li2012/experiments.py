"""Li, Jiang, Zhang, Zhang (2012): what the paper prints for GMTT, TSSTP and Cluster (figures 3 to 6), and what is run.

The paper prints no table; its numbers stand in the text beside the figures. It tells no number of runs: 40 are a full
run [our choice]. TSSTP and Cluster are reconstructions from a sentence each. How often the target is located it does
not tell either: once a report is the literal reading, every 2 s ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from wsnsim.papers.li2012.reasons import CHOICES, EVERY_2_S, EVERY_10_S
from wsnsim.papers.reproduction import Claim, Experiment, Order, Picture, Variant

SOURCE: Final = "Li 2012"
TRACKED: Final = 1.0
"""Figure 3: what the tracking probability of all three is near to at a high density, read as 400 nodes [our choice]."""
ERROR: Final[Mapping[str, float]] = {"cluster": 2.0, "gmtt": 2.5, "tsstp": 4.0}
"""Figure 4, metres, at 300 nodes: about so much; GMTT after a larger start."""
DELAY: Final[Mapping[str, tuple[float, float]]] = {"tsstp": (0.02, 0.06), "gmtt": (0.04, 0.09), "cluster": (0.2, 0.3)}
"""Figure 5, seconds: between these two it varies."""
NEAR: Final = 1.2
"""Up to this ratio two shares are of the same order."""

REPAIRED: Final = "gmtt, repaired"
GREY: Final = ("gmtt", REPAIRED)
NODES: Final = (200, 250, 300, 350, 400)
LOW, MIDDLE, HIGH = 200, 300, 400
LEVELS: Final = ("tsstp", "tsstp low", "tsstp high")
TRACKERS: Final[Mapping[str, Variant]] = {
    "gmtt": Variant("gmtt", ("tracker.shift=0", "tracker.correction=literal")),
    REPAIRED: Variant("gmtt"),
    "tsstp": Variant("tsstp"),
    **{f"tsstp {level}": Variant("tsstp", (f"wakeup.levels={level}",)) for level in ("low", "high")},
    "cluster": Variant("cluster"),
    "ris": Variant("ris"),
}
"""`gmtt` is as printed; repaired, 500 m are added to positions, the tail of residuals is modelled. `tsstp` is mid."""
LITERAL: Final = ("gmtt", "tsstp", "cluster")
"""What the paper tells of; the rest is repaired, of other levels [our choice], or not in its figures."""
TABLES: Final = ("estimates", "truth", "nodes")
OWN: Final = "wsnsim.papers.li2012.measures"


def _named(tracker: str, nodes: int) -> str:
    return f"{tracker}, {nodes}"


def _variants(trackers: Sequence[str], densities: Sequence[int]) -> dict[str, Variant]:
    """A tracker at some densities, each by its name."""
    return {
        _named(tracker, nodes): Variant(found.scenario, (f"deploy.nodes={nodes}", *found.sets))
        for tracker in trackers
        for nodes in densities
        for found in (TRACKERS[tracker],)
    }


def _pictures(suffix: str, words: str) -> tuple[Picture, ...]:
    titles = ("tracking probability", "tracking error", "tracking delay", "nodes told in vain")
    draw = "wsnsim.papers.li2012.pictures:figure_"
    return tuple(
        Picture(f"figure_{n}{suffix}", f"Li 2012, figure {n}: {title}, located {words}", f"{draw}{n}", (9.5, 4.4))
        for n, title in enumerate(titles, 3)
    )


def _order(
    words: str, pair: Sequence[str], nodes: int, measure: str, where: str, reason: str, told: bool = True
) -> Order:
    """That the first tracker is below the second at a density; `told` by the paper in as many words, or ours."""
    one, other = (_named(tracker, nodes) for tracker in pair)
    return Order(words, one, other, measure, where, reason, literal=told and set(pair) <= set(LITERAL))


def _rivals(levels: Sequence[str]) -> list[tuple[str, str]]:
    """GMTT or Cluster before TSSTP, at each of its levels."""
    return [(one, level) for level in levels for one in (*GREY, "cluster")]


# Figure 3: how often the target is tracked.

SHARES: Final = {"tracked": "one reading or more", "tracked_three": "three readings or more"}


def _figure_3(why: Mapping[str, str], levels: Sequence[str]) -> list[Claim | Order]:
    """At a low density TSSTP is below both, as it loses the target; at a high one all are near to 1."""
    found: list[Claim | Order] = []
    for column, said in SHARES.items():
        words, measure = f"share of steps tracked by {said}", f"tracks_mean:{column}"
        below = [(level, one) for one, level in _rivals(levels)]
        found += [_order(words, pair, LOW, f"tracks:{column}", "figure 3", why[column]) for pair in below]
        found += [
            Claim(words, _named(tracker, HIGH), measure, TRACKED, "figure 3", reason=why["near 1"], read=True,
                  factor=NEAR, literal=tracker in LITERAL)
            for tracker in (*GREY, *levels, "cluster")
        ]  # fmt: skip
        found += [
            Claim(words, _named(tracker, LOW), measure, None, "figure 3, no number printed", literal=tracker in LITERAL)
            for tracker in (*GREY, "tsstp", "cluster", "ris")
        ]
    words, where = "re-acquisitions a run", "text of figure 3"
    return found + [_order(words, it, LOW, "tracks:reacquired", where, why["lost"]) for it in _rivals(levels)]


# Figure 4: how far off, at 300 nodes.


def _figure_4(why: Mapping[str, str], levels: Sequence[str]) -> list[Claim | Order]:
    """The levels, their order and why, and that GMTT starts with more."""
    found: list[Claim | Order] = []
    for tracker in ("cluster", *GREY, *levels):
        steps, start = ("6 to 20", "later_{}") if tracker in GREY else ("1 to 20", "{}_error")
        found += [
            Claim(f"{kind} error of steps {steps}, m", _named(tracker, MIDDLE),
                  f"{kind}_of:{OWN}:{start.format(kind)}", ERROR[TRACKERS[tracker].scenario], "figure 4",
                  reason=why.get(f"{tracker}, {kind}", why[tracker]), literal=tracker in LITERAL)
            for kind in ("mean", "median")
        ]  # fmt: skip
    pairs = [*(("cluster", one) for one in GREY), *_rivals(levels)]
    found += [
        _order(f"{kind} error of steps 1 to 20", pair, MIDDLE, f"{kind}_of:{OWN}:{kind}_error", "figure 4",
               why["error order"])
        for kind in ("mean", "median")
        for pair in pairs
    ]  # fmt: skip
    found += [
        _order("ranges a step, of steps 1 to 20", (level, one), MIDDLE, f"mean_of:{OWN}:ranges", "text of figure 4",
               why["ranges"])
        for one, level in _rivals(levels)
    ]  # fmt: skip
    return [*found, *_starts(why["start"]), *_limits(why["limit"])]


def _starts(reason: str) -> list[Claim | Order]:
    """That GMTT's error is larger at the start than later, and more so than Cluster's."""
    words, measure = "median error of steps 1 to 5 less that of steps 6 to 20, m", f"median_of:{OWN}:start_excess"
    return [
        *(Claim(words, _named(one, MIDDLE), measure, None, "figure 4: 'larger at the start'", reason=reason,
               literal=one in LITERAL) for one in GREY),
        *(_order(words, ("cluster", one), MIDDLE, measure, "figure 4", reason) for one in GREY),
    ]  # fmt: skip


def _limits(reason: str) -> list[Claim | Order]:
    """What is possible: for a fix of one step's ranges, and what is had where there are three or more."""
    found: list[Claim | Order] = [
        Claim("RMS error of a fix of three ranges or more, m", _named(tracker, MIDDLE), "tracks_median:rmse_three",
              None, "reference", f"own:{OWN}:fix_bound", "root mean square of a run, median over runs",
              literal=tracker in LITERAL)
        for tracker in (*GREY, "tsstp", "cluster", "ris")
    ]  # fmt: skip
    least = Claim("Cramér-Rao bound on a fix of all ranges in reach, m", _named("gmtt", MIDDLE),
                  f"median_of:{OWN}:fix_bound", None, "bound", reason=reason)  # fmt: skip
    return [*found, least]


# Figure 5: how late, at 300 nodes.


def _figure_5(why: Mapping[str, str]) -> list[Claim | Order]:
    """The ranges, at the main node and at the sink, the order, and the computing that explains it."""
    places = {"at the main node": "delay", "at the sink": "report_delay"}
    found: list[Claim | Order] = [
        Claim(f"{end} delay {place} of the first 20, s", _named(tracker, MIDDLE), f"median_of:{OWN}:{end}_{column}",
              figure, "figure 5", reason=why[f"delay {name}"], literal=tracker in LITERAL)
        for place, column in places.items()
        for tracker in ("tsstp", *GREY, "cluster")
        for name in (TRACKERS[tracker].scenario,)
        for end, figure in zip(("least", "greatest"), DELAY[name], strict=True)
    ]  # fmt: skip
    slower = [("tsstp", "cluster"), *((one, "cluster") for one in GREY)]
    found += [
        _order(f"median delay {place}", pair, MIDDLE, f"tracks:{column}", "figure 5", why["delay order"])
        for place, column in places.items()
        for pair in (*(("tsstp", one) for one in GREY), *slower)
    ]
    words = "operations a run"
    return found + [_order(words, it, MIDDLE, "mean:cycles", "text of figure 5", why["operations"]) for it in slower]


# Figure 6: who is told in vain.


def _figure_6(why: Mapping[str, str], levels: Sequence[str]) -> list[Claim | Order]:
    """GMTT and Cluster far below TSSTP, all growing with the density, TSSTP most."""
    words, measure = "nodes told in vain in 20 steps", "tracks:ineffective_twenty"
    found: list[Claim | Order] = [
        _order(words, pair, nodes, measure, "figure 6", why["vain"])
        for nodes in (LOW, MIDDLE, HIGH)
        for pair in _rivals(levels if nodes == MIDDLE else ("tsstp",))
    ]
    found += [
        Order(words, _named(it, LOW), _named(it, HIGH), measure, "figure 6", why["growth"], it in LITERAL)
        for it in (*GREY, "tsstp", "cluster")
    ]
    found += [
        _order(f"{words}, more at {HIGH} nodes than at {LOW}", pair, HIGH, f"mean_of:{OWN}:vain_growth",
               "text of figure 6", why["most"])
        for pair in _rivals(("tsstp",))
    ]  # fmt: skip
    found += [
        _order("energy of the network, J", pair, MIDDLE, "mean:energy", "'efficiency', figure 6", why["energy"], False)
        for pair in _rivals(levels)
    ]
    return found + [
        Claim(words, _named(tracker, MIDDLE), "tracks_mean:ineffective_twenty", None, "figure 6, no number printed",
              literal=tracker in LITERAL)
        for tracker in (*GREY, *levels, "cluster")
    ]  # fmt: skip


def _claims(why: Mapping[str, str], levels: Sequence[str]) -> tuple[Claim | Order, ...]:
    """All that the four figures claim, with TSSTP at these levels."""
    return (*_figure_3(why, levels), *_figure_4(why, levels), *_figure_5(why), *_figure_6(why, levels))


# What the paper leaves open.

LEFT_OPEN: Final[Mapping[str, tuple[str, ...]]] = {
    REPAIRED: (),
    f"{REPAIRED}, shift 0": ("tracker.shift=0",),
    f"{REPAIRED}, literal correction": ("tracker.correction=literal",),
    f"{REPAIRED}, no correction": ("tracker.correction=none",),
    f"{REPAIRED}, prediction reported": ("tracker.report=prediction",),
}
"""The repaired GMTT, and one thing otherwise each, at 300 nodes; `gmtt` as printed is among the figures."""


def _left_open() -> list[Claim | Order]:
    """What each choice does to figures 3 and 4, and what the values chosen afterwards do to 4 and 5."""
    found: list[Claim | Order] = []
    for name in LEFT_OPEN:
        reason = CHOICES[name]
        found += [
            Claim("share of steps tracked by one reading or more", name, "tracks_mean:tracked", None, "figure 3"),
            Claim("re-acquisitions a run", name, "tracks_mean:reacquired", None, "not in the paper"),
            Claim("mean error of steps 6 to 20, m", name, f"mean_of:{OWN}:later_mean", ERROR["gmtt"], "figure 4",
                  reason=reason),
            Claim("median error of steps 6 to 20, m", name, f"median_of:{OWN}:later_median", ERROR["gmtt"], "figure 4",
                  reason=reason),
        ]  # fmt: skip
    for tracker in DELAY:
        name = f"{tracker} calibrated"
        found += [
            Claim(f"{kind} error of steps 1 to 20, m", name, f"{kind}_of:{OWN}:{kind}_error", ERROR[tracker],
                  "figure 4", reason=CHOICES["calibrated"])
            for kind in ("mean", "median")
        ]  # fmt: skip
        found += [
            Claim(f"{end} delay at the sink of the first 20, s", name, f"median_of:{OWN}:{end}_report_delay", figure,
                  "figure 5", reason=CHOICES["calibrated"])
            for end, figure in zip(("least", "greatest"), DELAY[tracker], strict=True)
        ]  # fmt: skip
    return found


FIGURES: Final = Experiment(
    name="figures_3_6",
    title="Figures 3 to 6, located every 2 s, five times a report: our choice, another reading",
    variants={
        **_variants((*GREY, "tsstp", "cluster"), NODES),
        **_variants(("tsstp low", "tsstp high", "ris"), (LOW, MIDDLE, HIGH)),
    },
    quick=8,
    full=40,
    claims=_claims(EVERY_2_S, LEVELS),
    pictures=_pictures("", "every 2 s (our choice)"),
    record=TABLES,
    block=4,
    literal=False,
)
ONCE_A_REPORT: Final = Experiment(
    name="every_10_s",
    title="Figures 3 to 6, located every 10 s, once a report: the literal reading",
    variants=_variants((*GREY, "tsstp", "cluster", "ris"), (LOW, MIDDLE, HIGH)),
    quick=10,
    full=40,
    claims=_claims(EVERY_10_S, ("tsstp",)),
    pictures=_pictures("_every_10_s", "every 10 s (once a report)"),
    record=TABLES,
    sets=("step=10 s", "duration=1000 s"),
    quick_sets=("duration=200 s",),
)
OPEN: Final = Experiment(
    name="left_open",
    title="What the paper leaves open, at 300 nodes, located every 2 s: other readings",
    variants={
        **{name: Variant("gmtt", sets) for name, sets in LEFT_OPEN.items()},
        **{f"{tracker} calibrated": Variant(f"{tracker}_calibrated") for tracker in DELAY},
    },
    quick=8,
    full=40,
    claims=tuple(_left_open()),
    record=("estimates",),
    block=4,
    literal=False,
)
EXPERIMENTS: Final[tuple[Experiment, ...]] = (FIGURES, ONCE_A_REPORT, OPEN)
