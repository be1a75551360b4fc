"""Ruan, Wang, Yang, Zhang (2020): what is run for table 1 and figures 1 and 2, and in place of figures 4 and 5.

Table 1 is of 50 runs; the indoor experiment is of one, whose recorded readings do not exist here: 50 simulated ones
stand in its place [our choice].
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

from wsnsim.papers.reproduction import Claim, Experiment, Order, Picture, Variant
from wsnsim.papers.ruan2020 import BETTER, TABLE_1
from wsnsim.papers.ruan2020.reasons import (
    ACCELERATIONS,
    DIAGONAL,
    DIRECT,
    IN_ROOM,
    INDOOR,
    MANY,
    ORDERS,
    REFERENCE,
    TURN,
)

COUNTS: Final = (50, 100, 200)
BOUND: Final = "per_trajectory"
GROWTH: Final = "median_of:wsnsim.papers.ruan2020.measures:growth"
SAVED: Final = "median_of:wsnsim.papers.ruan2020.measures:saved"
GREEDY: Final = "tracker.acceptance=greedy"
TABLES: Final = ("truth", "estimates")
BEST_FIRST: Final = ("gsa_gpf", "pso_gpf", "gpf", "pf")


def _filter(kind: str, particles: int, *more: str) -> Variant:
    return Variant(f"indoor_{kind}", (f"tracker.particles={particles}", *more))


def _picture(number: int, title: str, size: tuple[float, float]) -> Picture:
    draw = f"wsnsim.papers.ruan2020.pictures:figure_{number}"
    return Picture(f"figure_{number}", f"Ruan 2020, figure {number}: {title}", draw, size)


LITERAL: Final = {f"{kind}, {count}": _filter(kind, count) for kind in TABLE_1 for count in COUNTS}
REPAIRED: Final = {f"gsa_gpf, {count}, greedy": _filter("gsa_gpf", count, GREEDY) for count in COUNTS}
OTHERWISE: Final = {
    "gsa_gpf, 100, G0 = 1": _filter("gsa_gpf", 100, "tracker.G0=1"),
    "gsa_gpf, 100, all columns": _filter("gsa_gpf", 100, "tracker.move=all"),
    "pso_gpf, 100, all columns": _filter("pso_gpf", 100, "tracker.move=all"),
}
FILTERED: Final = {"pf, 5000": _filter("pf", 5000), "ekf": Variant("indoor_pf", ("tracker.kind=ekf",))}
MEASURED: Final = {"trilateration": Variant("indoor_pf", ("tracker.kind=trilateration",))}


def _table_1(reasons: Mapping[str, str], bound: str = BOUND) -> list[Claim | Order]:
    """Its twelve figures, and the medians of the same runs."""
    found: list[Claim | Order] = [
        Claim("RMSE, m", f"{kind}, {count}", "rmse", figure, "table 1", bound,
              reasons.get(f"{kind}, {count}") or reasons[kind])
        for kind, row in TABLE_1.items()
        for count, figure in row.items()
    ]  # fmt: skip
    return found + _medians(LITERAL)


def _medians(names: Mapping[str, Variant]) -> list[Claim | Order]:
    return [
        Claim("RMSE of a run, median, m", name, "median:rmse", None, "", BOUND, literal=name not in REPAIRED)
        for name in names
    ]


def _means(names: Mapping[str, Variant], reasons: Mapping[str, str], bound: str = BOUND) -> list[Claim | Order]:
    return [
        Claim("RMSE, m", name, "rmse", None, "reference", bound, reasons[name], literal=name not in REPAIRED)
        for name in names
    ]


def _orders(where: str, counts: tuple[int, ...], reasons: Mapping[str, str]) -> list[Claim | Order]:
    """Each filter of table 1 is better than the next."""
    return [
        Order("RMSE of a run", f"{one}, {count}", f"{other}, {count}", "rmse", where, reasons[f"{one} {other}"])
        for count in counts
        for one, other in pairwise(BEST_FIRST)
    ]


def _shares() -> list[Claim | Order]:
    """What section 3.1 says of table 1: PF depends most on the number of particles, GSA-GPF least."""
    pairs = (*((kind, "pf") for kind in BEST_FIRST[:-1]), *(("gsa_gpf", kind) for kind in ("gpf", "pso_gpf")))
    return [
        *(
            Claim(f"share by which its RMSE is below that of {other}", "gsa_gpf, 50", f"less_than:{other}, 50",
                  share, "section 3.1", "", ORDERS[f"share {other}"], factor=1.2)
            for other, share in BETTER.items()
        ),
        *(
            Claim("share of the RMSE at 50 particles that 200 save", f"{kind}, 200", f"less_than:{kind}, 50",
                  1.0 - row[200] / row[50], "from table 1", "", MANY[kind], factor=1.2)
            for kind, row in TABLE_1.items()
        ),
        *(
            Order("share of a run's RMSE at 50 particles that 200 save", f"{one}, 200", f"{other}, 200", SAVED,
                  "section 3.1", MANY[f"{one} {other}"])
            for one, other in pairs
        ),
    ]  # fmt: skip


def _of_figure_2() -> list[Claim | Order]:
    """The errors of all four grow, that of PF most."""
    growth = "growth of the error from first to last third of a run"
    return [
        *(
            Claim(f"{growth}, median, m", f"{kind}, 100", GROWTH, None, "figure 2", "",
                  "the text: that of all four grows, that of GSA-GPF stays in a small range")
            for kind in TABLE_1
        ),
        Order(growth, "gsa_gpf, 100", "pf, 100", GROWTH, "figure 2", ORDERS["growth"]),
    ]  # fmt: skip


TABLE_1_RUNS: Final = Experiment(
    name="table_1",
    title="Table 1, figures 1 and 2: a target in a room, three anchors",
    variants={**LITERAL, **REPAIRED, **OTHERWISE, **FILTERED, **MEASURED},
    quick=50,
    full=50,
    claims=(
        *_table_1(IN_ROOM),
        *_orders("table 1", COUNTS, ORDERS),
        *_shares(),
        *_of_figure_2(),
        *_means({**REPAIRED, **OTHERWISE, **FILTERED, **MEASURED}, REFERENCE),
        *_medians({**REPAIRED, **FILTERED}),
        *(
            Order("RMSE of a run", f"gsa_gpf, {count}, greedy", f"{other}, {count}", "rmse", "table 1, repaired",
                  ORDERS[f"greedy {other}"], literal=False)
            for count in COUNTS
            for other in ("pso_gpf", "gpf")
        ),
    ),
    pictures=(
        _picture(1, "tracks of one run, N = 100", (9.6, 5.4)),
        _picture(2, "tracking errors, N = 100", (9.6, 4.8)),
    ),
    record=TABLES,
    block=25,
)  # fmt: skip

# What the paper leaves open, or contradicts itself in.


def _other(name: str, title: str, reasons: Mapping[str, str], sets: tuple[str, ...], bound: str = BOUND) -> Experiment:
    """Table 1 with another truth, or another noise."""
    return Experiment(
        name=f"table_1_{name}",
        title=title,
        variants={**LITERAL, **REPAIRED, **FILTERED},
        quick=10,
        full=50,
        claims=(
            *_table_1(reasons, bound),
            *_orders("table 1", (100,), reasons),
            *_means({**REPAIRED, **FILTERED}, REFERENCE, bound),
        ),
        record=TABLES,
        sets=sets,
        block=10,
        literal=False,
    )


OPEN: Final = (
    _other(
        "diagonal",
        "Table 1, if the target goes straight: 0.5 m/s on each axis",
        DIAGONAL,
        ("motion.truth_noise=false", "motion.course=free"),
    ),
    _other(
        "turn",
        "Table 1, if it turns at half time: vy is reversed",
        TURN,
        ("motion.truth_noise=false", "motion.course=turn"),
    ),
    _other(
        "accelerations",
        "Table 1, if the noise has the two inputs of the printed Γ",
        ACCELERATIONS,
        ("motion.noise_input=accelerations", "motion.variances=[1]"),
    ),
    _other(
        "direct",
        "Table 1, if Q is the process covariance itself",
        DIRECT,
        ("motion.noise_input=direct", "motion.course=free"),
        "unconditional",
    ),
)

# Figures 4 and 5: a room of 6 m by 6 m, in simulation.


def _surrogate(kind: str, *more: str) -> Variant:
    return Variant("indoor_surrogate", (f"tracker.kind={kind}", *more))


ROOM: Final = {f"{kind}, 100": _surrogate(kind, "tracker.particles=100") for kind in TABLE_1}
BESIDE: Final = {
    "gsa_gpf, 100, greedy": _surrogate("gsa_gpf", GREEDY),
    "pf, 5000": _surrogate("pf", "tracker.particles=5000"),
    "ekf": Variant("indoor_surrogate", ("tracker={kind: ekf}",)),
    "trilateration": Variant("indoor_surrogate", ("tracker={kind: trilateration}",)),
}
INDOOR_RUNS: Final = Experiment(
    name="figures_4_and_5",
    title="Figures 4 and 5, a surrogate: 6 m by 6 m, 3 dB²",
    variants={**ROOM, **BESIDE},
    quick=50,
    full=50,
    claims=(
        *(
            Order("RMSE of a run", one, other, "rmse", where, INDOOR[f"{one} {other}"], literal="repaired" not in where)
            for where, one, other in (
                *(("figure 4", f"{kind}, 100", "pf, 100") for kind in BEST_FIRST[:-1]),
                *(("figure 5", "gsa_gpf, 100", f"{kind}, 100") for kind in ("pso_gpf", "gpf")),
                *(("figure 5, repaired", "gsa_gpf, 100, greedy", f"{kind}, 100") for kind in ("pso_gpf", "gpf")),
            )
        ),
        *_means({**ROOM, **BESIDE}, INDOOR),
        *_medians({**ROOM, **BESIDE}),
    ),
    pictures=(
        _picture(4, "tracks of one run, N = 100 (a simulated surrogate)", (9.6, 5.4)),
        _picture(5, "tracking errors, N = 100 (a simulated surrogate)", (9.6, 4.8)),
    ),
    record=TABLES,
    block=25,
)

EXPERIMENTS: Final[tuple[Experiment, ...]] = (TABLE_1_RUNS, *OPEN, INDOOR_RUNS)
