"""Wei, Guo (2022): what is run for table 2 and figures 8 to 11: a target on a straight line, seen by one distance.

Beside it stand what else the paper may have meant, and a set-up of ours in which the target's place can be known.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from wsnsim.papers.reproduction import Claim, Experiment, Order, Picture, Variant
from wsnsim.papers.wei2022 import SECONDS, TABLE_2
from wsnsim.papers.wei2022.growth import BOUND, LONG, OWN, PICTURES, picture

COLUMNS: Final = ("px", "vx", "py", "vy")
ON_THE_CIRCLE: Final = {
    "pf": "where on its circle the target is, no reading tells; the bound is strict only in table_2_start_drawn",
    "cs_pf": "as PF; and the search moves velocities, which no fitness holds",
    "ics_pf": f"as CS-PF; {LONG}",
}


def _table_2(reasons: Mapping[str, str]) -> list[Claim | Order]:
    return [
        Claim(f"RMSE of {column}", kind, f"column:{column}", figure, "table 2", BOUND, reasons[kind])
        for kind, row in TABLE_2.items()
        for column, figure in zip(COLUMNS, row, strict=True)
    ]


def _references(reasons: Mapping[str, str]) -> list[Claim | Order]:
    return [
        Claim(f"RMSE of {column}", name, f"column:{column}", None, "reference", BOUND, reason)
        for name, reason in reasons.items()
        for column in ("px", "py")
    ]


def _orders_2(where: tuple[str, str, str], *reasons: str) -> list[Claim | Order]:
    measures = (("position", "rmse"), ("vx", f"{OWN}:vx"), ("vy", f"{OWN}:vy"))
    return [
        Order(f"RMSE of {name}, of a run", one, other, measure, figure, reason)
        for (name, measure), figure in zip(measures, where, strict=True)
        for (one, other), reason in zip((("cs_pf", "pf"), ("ics_pf", "cs_pf")), reasons, strict=True)
    ]


def _run_times() -> list[Claim | Order]:
    """Seconds, which two machines do not share, and their ratios, held against those of operations."""
    more, equal = "11 likelihoods a particle and step, where PF has 1", "as many likelihoods as CS-PF"
    return [
        *(
            Claim("run time of a run, s", kind, "median:cpu_seconds", seconds, "section 4.2", "",
                  "the text does not say whether of one run or of its 100, nor on which machine", judged=False)
            for kind, seconds in SECONDS.items()
        ),
        *(
            Claim(f"operations over those of {name}", one, f"{OWN}:operations_over_{other}",
                  SECONDS[one] / SECONDS[other], "section 4.2", "", f"operations as stated, seconds there: {reason}")
            for one, other, name, reason in (
                ("cs_pf", "pf", "PF", more), ("ics_pf", "pf", "PF", more), ("ics_pf", "cs_pf", "CS-PF", equal)
            )
        ),
    ]  # fmt: skip


def _range(kind: str, *more: str) -> Variant:
    return Variant(f"range_{kind}", more)


LITERAL_2: Final = {kind: _range(kind) for kind in TABLE_2}
CAREFUL: Final = {
    "ics_pf, position": _range("ics_pf", "tracker.move=position"),
    "ics_pf, position, resample first": _range("ics_pf", "tracker.move=position", "tracker.variant=resample_first"),
    "pf, 5000": _range("pf", "tracker.particles=5000"),
    "ekf": _range("pf", "tracker.kind=ekf"),
    "ekf, told that it goes straight": _range("pf", "tracker.kind=ekf", "motion.variances=[1e-6]"),
}
"""Without `metropolis`: this motion's noise has no density."""
WHY_CAREFUL: Final = {
    "ics_pf, position": "our repair: the search moves places alone",
    "ics_pf, position, resample first": "our repair: and resampling takes up the likelihood once",
    "pf, 5000": "PF with 25 times the particles",
    "ekf": "with the same Q / R = 0.72",
    "ekf, told that it goes straight": "with Q = 1e-6: what one distance gives to a filter that knows the motion",
}
TABLE_2_RUNS: Final = Experiment(
    name="table_2",
    title="Table 2, figures 8 to 11: a straight line, seen by one distance",
    variants={**LITERAL_2, **CAREFUL},
    quick=30,
    full=100,
    claims=(
        *_table_2(ON_THE_CIRCLE),
        *_orders_2(("figure 11", "figure 9", "figure 10"), "the search moves velocities, which no fitness holds", LONG),
        *_references(WHY_CAREFUL),
        *_run_times(),
        *(
            Claim("operations", kind, "mean:cycles", None, "reference", "", "stated by the tracker, for a whole run")
            for kind in TABLE_2
        ),
    ),
    pictures=(
        picture(8, "trajectories", (9.5, 4.2)),
        picture(9, "velocity in x"),
        picture(10, "velocity in y"),
        picture(11, "position error", (7.5, 4.8)),
    ),
    record=("truth", "estimates"),
)  # fmt: skip


def _other_truth(name: str, title: str, reason: str, *sets: str) -> Experiment:
    claims = tuple(_table_2(dict.fromkeys(TABLE_2, reason)))
    return Experiment(name, title, LITERAL_2, 30, 100, claims, (), ("truth", "estimates"), sets, literal=False)


TABLE_2_START_DRAWN: Final = _other_truth(
    "table_2_start_drawn",
    "Table 2, if starts were drawn from the prior",
    "starts are drawn from the filters' prior [our choice]: on average over them no filter is below the bound",
    "motion.start=[71, 2.66, 18.9, 7.8]",
    "motion.start_sd=[1.224744871391589, 1.183215956619923, 0.948683298050514, 0.173205080756888]",
)
TABLE_2_NOISY_TRUTH: Final = _other_truth(
    "table_2_noisy_truth",
    "Table 2, if the truth had the process noise",
    "the truth moves with the noise that the filters believe in [our choice]; no strict bound for a single start",
    "motion.truth_noise=true",
)

# Our second set-up: four anchors, where the target's place can be known.


def _anchors(kind: str, particles: int, *more: str) -> Variant:
    return Variant("range_anchors", (f"tracker.kind={kind}", f"tracker.particles={particles}", *more))


ANCHORED: Final = {
    "pf": _anchors("pf", 200),
    "cs_pf": _anchors("cs_pf", 200, "tracker.move=position"),
    "ics_pf": _anchors("ics_pf", 200, "tracker.move=position"),
    "cs_pf, all columns": _anchors("cs_pf", 200, "tracker.move=all"),
    "ics_pf, all columns": _anchors("ics_pf", 200, "tracker.move=all"),
    "pf, 20000": _anchors("pf", 20000),
    "ekf": Variant("range_anchors", ("tracker.kind=ekf",)),
}
OURS: Final = "in our set-up: 5 cm, Q = 1e-4, starts drawn from the prior, places moved alone [our choice]"
WHY_ANCHORED: Final = {
    "pf": "200 particles for a likelihood of 5 cm; with 100 times as many, see below",
    "cs_pf": "the search moves places alone",
    "ics_pf": "the search moves places alone; the published 0.031 m and 0.025 m would be possible here",
    "cs_pf, all columns": "literal: velocities fly, too",
    "ics_pf, all columns": "literal: velocities fly, too",
    "pf, 20000": "PF with 100 times the particles",
    "ekf": "a Gaussian is enough, at four readings a step",
}
FOUR_ANCHORS: Final = Experiment(
    name="four_anchors",
    title="The order of table 2 with four anchors, where the target's place can be known",
    variants=ANCHORED,
    quick=30,
    full=100,
    claims=(
        *_orders_2(("table 2",) * 3, OURS, OURS),
        *_references(WHY_ANCHORED),
    ),
    pictures=(
        Picture("four_anchors", "As Wei 2022, figure 11: four anchors", f"{PICTURES}:four_anchors", (7.5, 4.8)),
    ),
    record=("truth", "estimates"),
    literal=False,
)  # fmt: skip

EXPERIMENTS: Final = (TABLE_2_RUNS, TABLE_2_START_DRAWN, TABLE_2_NOISY_TRUTH, FOUR_ANCHORS)
