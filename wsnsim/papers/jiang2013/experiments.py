"""Jiang, Song, Lin (2013): what is run for section 5, figures 2 to 9, and for what sections 2 to 5 leave open.

Figure 3 is of 100 runs; the paper gives no other number, so that stands for figures 4 to 9, too [our choice].
"""

from __future__ import annotations

from itertools import product
from typing import Final

from wsnsim.papers.jiang2013 import CLUSTERS, ENERGY, RMSE, STEP_ENERGY
from wsnsim.papers.reproduction import Claim, Experiment, Order, Picture, Variant

Claims = list[Claim | Order]

LITERAL: Final = {"pso_mhpf": "PSO-MHPF", "ipf": "IPF", "ppf": "PPF"}
STRICT: Final = "unconditional"
TIGHT: Final = "per_trajectory"
MEASURES: Final = "wsnsim.papers.jiang2013.measures"


def _picture(number: int, title: str, size: tuple[float, float] = (7.0, 5.2)) -> Picture:
    draw = f"wsnsim.papers.jiang2013.pictures:figure_{number}"
    return Picture(f"figure_{number}", f"Jiang 2013, figure {number}: {title}", draw, size)


# Figures 2 and 4 to 9: one target through the field, and the three trackers behind it.

REPAIRED: Final = {
    "pso_mhpf, all readings": Variant("pso_mhpf", ("tracker.measurements=all",)),
    "pso_mhpf, resample first": Variant("pso_mhpf", ("tracker.resample_first=true",)),
    **{f"{kind}, noise x100": Variant(kind, ("tracker.filter_noise_scale=100",)) for kind in LITERAL},
}
REFERENCES: Final = {
    "ekf": Variant("jiang_field", ("tracker.kind=ekf",)),
    "central_pf, 5000 particles": Variant("central_pf", ("tracker.particles=5000",)),
    "central_pf, noise x100": Variant("central_pf", ("tracker.filter_noise_scale=100",)),
}
WHY_RMSE: Final = {
    "pso_mhpf": "intensity, noise, prior and length of a run are ours, the paper gives none [our choice]",
    "ipf": "single runs go astray, and make the mean: of 100 runs 6 have an RMSE above 20 m; see the median",
    "ppf": "the printed process noise is about 1 mm a step: 400 resampled particles starve; see 'ppf, noise x100'",
}
WHY_RMSE_ORDER: Final = {
    ("pso_mhpf", "ipf"): "literal against literal; IPF weighs with all readings, a member of PSO-MHPF with its own",
    ("pso_mhpf", "ppf"): "literal against literal; with noise x100 PPF is the better of the two",
    ("ipf", "ppf"): "literal against literal; with noise x100 PPF is the better of the two",
}
WHY_ENERGY: Final = {
    "pso_mhpf": "about 0.9 J are steps with a handover, 0.5 J steps in which particles move: figure 6 has neither",
    "ipf": "about 1.5 J are handovers: each particle's covariance goes along [our choice]; see 'ipf, one proposal ...'",
    "ppf": "particles change node at each resampling, through the head, each as a packet of its own",
}
WHY_ENERGY_ORDER: Final = {
    ("pso_mhpf", "ipf"): "what a handover carries decides: as many packets a step, but IPF's covariances go along",
    ("pso_mhpf", "ppf"): "only PPF exchanges particles at each resampling",
    ("ipf", "ppf"): "only PPF exchanges particles at each resampling",
}
WHY_ELSE: Final = {
    "pso_mhpf, all readings": "members weigh with all readings of the cluster; one alone tells a distance, no place",
    "pso_mhpf, resample first": "a resampling uses the weights before the move: better at the median, not safe",
    "pso_mhpf, noise x100": "100 times the true process covariance in the filter [our choice]",
    "ipf, noise x100": "100 times the true process covariance in the filter [our choice]; single runs go far astray",
    "ppf, noise x100": "100 times the true process covariance in the filter [our choice]",
    "ekf": "a Gaussian in the head, and a packet a reading; single runs go astray, and make the mean",
    "central_pf, 5000 particles": "every reading, one head, no energy limit; with the true noise 5000 starve, too",
    "central_pf, noise x100": "every reading, one head, no energy limit, 400 particles",
}
FAIR: Final = "literal against literal says more of PPF's starved particles than of the strategies"
WHY_LOST: Final = "lost: the mean error of the last 100 steps is above 20 m [our choice]"


def _own(kind: str, name: str) -> str:
    """A measure of our own: 'mean' or 'median' over runs."""
    return f"{kind}_of:{MEASURES}:{name}"


def _fair_orders() -> Claims:
    """The order of figure 9 again, where each filter has the process noise that suits it."""
    return [
        Order("RMSE of a run", one, "ppf, noise x100", "rmse", "figure 9, fair", FAIR, literal=False)
        for one in ("pso_mhpf", "pso_mhpf, noise x100", "pso_mhpf, all readings")
    ]


def _level(quantity: str, name: str, published: float, why: str) -> Claim:
    read = quantity.endswith("share")
    factor = 1.2 if read else 2.0
    return Claim(quantity, "pso_mhpf", _own("mean", name), published, "figure 6", "", why, read=read, factor=factor)


def _references(name: str, why: str) -> Claims:
    """Rows of a variant that the paper does not have."""
    return [
        Claim("RMSE, m", name, "rmse", None, "", STRICT, why),
        Claim("RMSE of a run, median, m", name, "median:rmse", None, "", TIGHT),
        Claim("network energy, J", name, "mean:energy"),
    ]


def _tracking() -> Claims:
    return [
        *(Claim("RMSE, m", kind, "rmse", RMSE[kind], "figure 9", STRICT, why) for kind, why in WHY_RMSE.items()),
        *(Claim("RMSE of a run, median, m", kind, "median:rmse", None, "", TIGHT) for kind in LITERAL),
        *(Order("RMSE of a run", *pair, "rmse", "figure 9", why) for pair, why in WHY_RMSE_ORDER.items()),
        *(
            Claim("network energy, J", kind, "mean:energy", ENERGY[kind], "figure 8", "", why)
            for kind, why in WHY_ENERGY.items()
        ),
        *(Order("network energy", *pair, "mean:energy", "figure 8", why) for pair, why in WHY_ENERGY_ORDER.items()),
        *(Claim("tracks lost, share", kind, "share:lost", None, "figure 7, one run", "", WHY_LOST) for kind in LITERAL),
        Claim("clusters", "pso_mhpf", _own("mean", "clusters"), CLUSTERS["pso_mhpf"], "figure 6", "",
              "in 700 steps, a length that we chose with these 16 clusters in view", judged=False),
        *_fair_orders(),
        _level(
            "least step energy of a cluster, J", "least_level", STEP_ENERGY[0],
            "a step without moves costs about 0.3 mJ; our total divided by 700 steps is 2.3 mJ, about what is printed",
        ),
        _level(
            "largest step energy of a cluster, J", "largest_level", STEP_ENERGY[1],
            "as above; the largest are short clusters, in which particles change node at most steps",
        ),
        _level(
            "steps on their cluster's level, share", "on_level", 1.0,
            "N_act changes within a cluster, and estimates sent with it; handovers and moved particles stand out",
        ),
        *(claim for name, why in WHY_ELSE.items() for claim in _references(name, why)),
    ]  # fmt: skip


TRACKING: Final = Experiment(
    name="figures_4_to_9",
    title="Figures 2 and 4 to 9: one target through the field",
    variants={**{kind: Variant(kind) for kind in LITERAL}, **REPAIRED, **REFERENCES},
    quick=10,
    full=100,
    claims=tuple(_tracking()),
    pictures=(
        _picture(2, "the first cluster", (6.0, 6.4)),
        _picture(4, "the heads' path, and their members", (6.0, 6.4)),
        _picture(5, "the heads' path and the target's", (6.0, 6.4)),
        _picture(6, "what the network spends in a step, PSO-MHPF"),
        _picture(7, "tracks", (9.4, 6.0)),
        _picture(8, "what the network has spent", (10.5, 4.8)),
        _picture(9, "RMSE (eq. 26)", (8.6, 7.4)),
    ),
    record=("estimates", "truth", "nodes", "clusters", "energy_steps"),
)

# Figure 3: how many particles, and how many iterations.

FIRST_CLUSTER: Final = (
    (-52.87, -40.14), (-73.82, -59.80), (-46.12, -106.51), (-33.38, -92.34), (-55.94, -4.60), (-15.40, -86.42),
    (-76.34, -92.85), (-37.38, -7.91), (-84.19, -87.05), (-26.26, -87.41), (-97.49, -66.81), (1.35, -41.04),
    (-20.90, -38.31), (-31.21, -12.58),
)  # fmt: skip
"""m: the nodes of the first cluster of replicate 0, the head first, to the centimetre."""
READINGS: Final = ("own", "all")
PARTICLES: Final = (100, 200, 400, 800, 1600)
ITERATIONS: Final = (1, 2, 4, 8)
WHY_CURVES: Final = {
    "own": "the literal reading: with its own reading alone a member is metres off, however many particles it has, "
    "so that being close says nothing",
    "all": "members weigh with all readings of the cluster [our reading of figure 3]",
}


def cell(readings: str, particles: int, iterations: int) -> str:
    """The name of a variant of figure 3."""
    return f"{readings} readings, {particles} particles, {iterations} iteration{'s' if iterations > 1 else ''}"


def _cells() -> dict[str, Variant]:
    names = ("measurements", "particles", "iterations")
    return {
        cell(*which): Variant("pso_mhpf", tuple(f"tracker.{name}={x}" for name, x in zip(names, which, strict=True)))
        for which in product(READINGS, PARTICLES, ITERATIONS)
    }


def _curves(readings: str) -> Claims:
    """What the text says of figure 3; it prints no number, 'almost a decade' and 'close' are read as 10 and as 1."""
    why = WHY_CURVES[readings]
    return [
        *(
            Claim("RMSE over that of 1600 particles", cell(readings, particles, count),
                  f"over:{cell(readings, 1600, count)}", ratio, f"{word}, figure 3", "", why, read=True,
                  factor=2.0 if ratio > 1.0 else 1.2, literal=readings == "own")
            for particles, count, ratio, word in (
                (100, 1, 10.0, "'almost a decade'"), (400, 2, 1.0, "'close'"), (800, 2, 1.0, "'close'"),
            )
        ),
        Claim("RMSE over that after 8 iterations", cell(readings, 400, 2), f"over:{cell(readings, 400, 8)}", 1.0,
              "'near its end', figure 3", "", why, read=True, factor=1.2, literal=readings == "own"),
        *(
            Order("RMSE of a run", cell(readings, 1600, count), cell(readings, 100, count), "rmse", "figure 3", why,
                  literal=readings == "own")
            for count in (1, 2)
        ),
        *(
            Order("RMSE of a run", cell(readings, particles, 2), cell(readings, particles, 1), "rmse", "figure 3", why,
                  literal=readings == "own")
            for particles in (100, 400, 1600)
        ),
        *(
            Claim("RMSE, m", cell(readings, particles, count), "rmse", None, "", STRICT)
            for particles, count in product((100, 400, 1600), (1, 2))
        ),
    ]  # fmt: skip


PLACES: Final = f"places: {[list(place) for place in FIRST_CLUSTER]}"
CONVERGENCE: Final = Experiment(
    name="figure_3",
    title="Figure 3: error against particles and iterations, in the first cluster; 1.2 s of it [our choice]",
    variants=_cells(),
    quick=10,
    full=100,
    claims=tuple(claim for readings in READINGS for claim in _curves(readings)),
    pictures=(_picture(3, "error against particles and iterations", (9.5, 5.0)),),
    record=("estimates",),
    sets=(
        f"deploy={{kind: anchors, {PLACES}, width: 400 m, height: 400 m, centre: [0, 0]}}",
        "duration=1.2 s",
        "prior.sd=[15, 10, 15, 10]",
        "tracker.resample_always=true",
    ),
    block=20,
)

# What the paper leaves open, or says twice.

WHY_SETS: Final = {
    "pso_mhpf, all readings, resample first": (
        "both repairs at once; all readings alone are better, see figures 4 to 9",
        "tracker.measurements=all",
        "tracker.resample_first=true",
    ),
    "pso_mhpf, 70 iterations": ("table 2's B + J; the text of section 5 says 2", "tracker.iterations=70"),
    "pso_mhpf, eq. 18": (
        "no random factors, as printed: with a step of one the recursion has a double root of -1 and swings up",
        "tracker.random_factors=false",
    ),
    "pso_mhpf, eq. 18, step T, 70 iterations": (
        "no random factors, as printed, and eq. 19 with the time step: stable",
        "tracker.random_factors=false",
        "tracker.step_length=dt",
        "tracker.iterations=70",
    ),
    "pso_mhpf, likelihood alone": (
        "eq. 20 with a flat prior [our choice]: a move asks the member's own reading, and nothing else",
        "tracker.acceptance=likelihood",
    ),
    "pso_mhpf, estimate before": (
        "eq. 16 read literally: the estimate is taken before the move",
        "tracker.estimate_when=before",
    ),
    "pso_mhpf, unknown gains": (
        "the filter takes the gains, within 30 % of 1, for 1; the paper does not say what it knows",
        "tracker.gains=unknown",
    ),
    "pso_mhpf, noise Q": ("the process covariance is Q alone, in truth and filter", "motion.noise=q_only"),
    "pso_mhpf, Gaussian handover": (
        "our repair: a handover of 4 packets in place of 400 particles",
        "tracker.handover=gaussian",
    ),
    "ipf, one proposal from Q": ("an EKF from Q a particle: no covariances to hand over", "tracker.proposal=local"),
    "ipf, one proposal for all": ("one EKF for all particles: no covariances to hand over", "tracker.proposal=cloud"),
    **{
        f"{kind}, 10 cycles": (
            "10 cycles an operation, as software floats take; else the same",
            "cpu.cycles_per_flop=10",
        )
        for kind in LITERAL
    },
}
"""By variant: why it is run, and what is set in it."""
OURS: Final = ("pso_mhpf, all readings, resample first", "pso_mhpf, Gaussian handover")
"""Of these, the repairs: no reading of the paper, so nothing is published of them."""


def _readings() -> Claims:
    found: Claims = []
    for name, (why, *_) in WHY_SETS.items():
        kind = name.split(",")[0]
        rmse, energy = (None, None) if name in OURS else (RMSE[kind], ENERGY[kind])
        found += [
            Claim("RMSE, m", name, "rmse", rmse, "figure 9", STRICT, why),
            Claim("RMSE of a run, median, m", name, "median:rmse", None, "", TIGHT),
            Claim("network energy, J", name, "mean:energy", energy, "figure 8", "", why),
        ]
    return found


READ_OTHERWISE: Final = Experiment(
    name="readings",
    title="What sections 2 to 5 leave open, one reading at a time",
    variants={name: Variant(name.split(",")[0], tuple(sets)) for name, (_, *sets) in WHY_SETS.items()},
    quick=5,
    full=30,
    claims=tuple(_readings()),
    record=("estimates",),
    literal=False,
)

# What the network lets a tracker know.

NETWORK: Final = Experiment(
    name="network_bounds",
    title="Figure 9 beside the bounds for the readings of active members, and for those that arrived",
    variants={kind: Variant(kind) for kind in LITERAL},
    quick=5,
    full=20,
    claims=tuple(
        Claim(f"RMSE of a run, median, m; bound: {words}", kind, "median:rmse", None, "figure 9", readings)
        for readings, words in ((TIGHT, "in range"), ("active", "active members"), ("arrived", "arrived"))
        for kind in LITERAL
    ),
    record=("events", "estimates", "clusters"),
)

EXPERIMENTS: Final[tuple[Experiment, ...]] = (TRACKING, CONVERGENCE, READ_OTHERWISE, NETWORK)
