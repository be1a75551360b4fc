"""Liu, Wang (2012): what the paper prints for RKF and IMSF (table 1, figures 1 to 4), and what is run.

Figures 1 to 4 are curves without a number in the text; what it says of them is taken as orders, and as a ratio of 1
where two curves are "about equal".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from wsnsim.papers.reproduction import Claim, Experiment, Order, Picture, Variant

SOURCE: Final = "Liu 2012"
SECONDS: Final[Mapping[str, float]] = {"rkf": 47.7304, "imsf": 68.6893}
"""Table 1: run time of 50 runs, in MATLAB on a machine that is not named."""
RATIO: Final = SECONDS["imsf"] / SECONDS["rkf"]
OWN: Final = "median_of:wsnsim.papers.liu2012.measures"
MEAN: Final = "mean_of:wsnsim.papers.liu2012.measures"
TABLES: Final = ("truth", "estimates", "nodes")


def _picture(number: int, title: str, size: tuple[float, float]) -> Picture:
    draw = f"wsnsim.papers.liu2012.pictures:figure_{number}"
    return Picture(f"figure_{number}", f"Liu 2012, figure {number}: {title}", draw, size)


LITERAL: Final = {"rkf": Variant("rkf"), "imsf": Variant("imsf")}
FIGURES: Final = {"rkf": "figure 3", "imsf": "figure 4"}
OTHERS: Final = {
    "rkf, spread": Variant("rkf", ("tracker.spread=true",)),
    "imsf, mixing as printed": Variant("imsf", ("tracker.mixing=printed",)),
    "ekf, sensors in range": Variant("rkf", ("tracker={kind: ekf}", "sensor.beyond=silent")),
    "ekf, nearest sensor": Variant("rkf", ("tracker={kind: ekf, readings: nearest}", "sensor.beyond=silent")),
}
LACKS: Final = "our repair: with the spread of means that (14) lacks, one filter does what the mixture of eight does"
WHY: Final[Mapping[str, str]] = {
    "rkf": "as printed, (14) lacks the spread of means; a target that leaves the coverage is lost",
    "imsf": "(23) with weights on the whole bracket; a target that leaves the coverage is lost",
    "rkf, spread": LACKS,
    "imsf, mixing as printed": "literal: covariances grow where no reading holds them, and the track is lost",
    "ekf, sensors in range": "told which sensors are in range: at the bound",
    "ekf, nearest sensor": "told which sensor is nearest: a crisp relay",
}
"""Of the figures; the paper prints no number of any."""
RADII: Final = "radii of 400 m overlap at 150 m between sensors, so several are right at once, and any may be believed"
IN_TURN: Final = f"read as: sensors take part in the order in which they stand [our choice]; {RADII}"
PART: Final = (
    "a sensor takes part from 0.05 on [our choice]; a little longer with IMSF, as from 0.01 or 0.2 on; from 0.5 on less"
)
MACHINE: Final = "seconds here contain the compilation of the first run, and what else the machine does"
STATED: Final = "operations as the trackers state them, seconds there: eight predictions and mixtures in place of one"
TRACKING: Final = Experiment(
    name="figures_1_to_4",
    title="Figures 1 to 4, table 1: eight sensors along a line",
    variants={**LITERAL, **OTHERS},
    quick=20,
    full=50,
    claims=(
        Order("position RMSE of a run", "imsf", "rkf", "rmse", "figure 1", "less on most truths, by a tenth"),
        Order("position RMSE of a run", "imsf", "rkf, spread", "rmse", "figure 1, repaired", LACKS, literal=False),
        Order("position RMSE of a run", "imsf, mixing as printed", "rkf", "rmse", "figure 1, to the letter",
              WHY["imsf, mixing as printed"], literal=False),
        Claim("velocity RMSE of a run over that of RKF, median", "imsf", f"{OWN}:velocity_over_rkf", 1.0,
              "about equal, figure 2", "", "a little less", read=True),
        *(
            Claim("neighbouring sensors in their turn, share", kind, f"{MEAN}:in_turn", 1.0, figure, "", IN_TURN,
                  read=True, factor=1.2)
            for kind, figure in FIGURES.items()
        ),
        *(
            Claim("changes of the likeliest sensor to a neighbour, share", kind, f"{MEAN}:to_neighbours", None, figure,
                  "", RADII)
            for kind, figure in FIGURES.items()
        ),
        Order("steps that a sensor takes part", "rkf", "imsf", f"{OWN}:taking_part", "figures 3 and 4", PART),
        *(
            Claim("steps that a sensor takes part", kind, f"{MEAN}:taking_part", None, figure, "", PART)
            for kind, figure in FIGURES.items()
        ),
        Order("operations", "rkf", "imsf", "mean:cycles", "table 1", STATED),
        Claim("operations over those of RKF", "imsf", f"{OWN}:operations_over_rkf", RATIO, "table 1", "", STATED),
        Claim("run time over that of RKF, median", "imsf", f"{OWN}:seconds_over_rkf", RATIO, "table 1", "", MACHINE,
              judged=False),
        *(
            Claim("run time of 50 runs, s", kind, f"{OWN}:seconds_of_50", SECONDS[kind], "table 1", "", MACHINE,
                  judged=False)
            for kind in LITERAL
        ),
        *(
            claim
            for kind, why in WHY.items()
            for claim in (
                Claim("position RMSE, m", kind, "rmse", None, "figure 1", "unconditional", why),
                Claim("position RMSE of the tracks kept, m", kind, "rmse_of_kept", None, "figure 1"),
                Claim("position RMSE of a run, median, m", kind, "median:rmse", None, "figure 1", "per_trajectory"),
                Claim("velocity RMSE of the tracks kept, m/s", kind, "column_of_kept:vx", None, "figure 2"),
            )
        ),
    ),
    pictures=(
        _picture(1, "position error", (9.6, 4.6)),
        _picture(2, "velocity error", (9.6, 4.6)),
        _picture(3, "sensor probabilities of RKF", (8.0, 5.4)),
        _picture(4, "sensor probabilities of IMSF", (8.0, 5.4)),
    ),
    record=TABLES,
    block=10,
)  # fmt: skip

# What the paper leaves open.

CHANGES: Final[Mapping[str, tuple[str, ...]]] = {
    "no noise in the truth": ("motion.truth_noise=false",),
    "no radius": ("sensor.reach=.inf",),
    "own cell": ("sensor.own_cell=true", "sensor.beyond=silent"),
}
WHY_CHANGED: Final[Mapping[str, str]] = {
    "no noise in the truth": "the filters believe in a noise that the truth has not",
    "no radius": "all eight sensors are right at every step; their probabilities are about which",
    "own cell": "one sensor is heard at a time, so that both are the same filter, and the difference is zero",
}


def _of_change(name: str, why: str) -> list[Claim | Order]:
    """What figures 1 and 2 say, with one thing changed."""
    return [
        Order("position RMSE of a run", f"imsf, {name}", f"rkf, {name}", "rmse", "figure 1", why),
        Claim("velocity RMSE of a run over that of RKF, median", f"imsf, {name}", f"{OWN}:velocity_over_rkf", 1.0,
              "about equal, figure 2", "", why, read=True),
        *(
            Claim("position RMSE of a run, median, m", f"{kind}, {name}", "median:rmse", None, "figure 1",
                  "per_trajectory")
            for kind in LITERAL
        ),
    ]  # fmt: skip


READ_OTHERWISE: Final = Experiment(
    name="readings",
    title="Figures 1 and 2, if the truth had no noise, or sensors another range",
    variants={f"{kind}, {name}": Variant(kind, sets) for name, sets in CHANGES.items() for kind in LITERAL},
    quick=10,
    full=50,
    claims=tuple(claim for name, why in WHY_CHANGED.items() for claim in _of_change(name, why)),
    record=TABLES,
    block=10,
    literal=False,
)

EXPERIMENTS: Final[tuple[Experiment, ...]] = (TRACKING, READ_OTHERWISE)
