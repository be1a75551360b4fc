"""What the papers did not ask: error against joules for every tracker on one field, on an ideal and a realistic radio.

The field, target, sensors and prior are those of Jiang, Song, Lin (2013); nothing here has a published value. A
variant's name says its air before the colon:

    ideal              the paper's: nothing is lost, nothing takes time, listening is free
    CSMA               a CC2420: a frame a packet, frames contend (`bases/jiang2013_real.yaml`)
    CSMA packed        the same with nine packets a frame
    slots              the same with nine packets a frame, in slots that the head arranges, as `ekf_real.yaml` has it
    10 % awake         slots, and each node sleeps nine tenths of the time; the next head wakes the nodes ahead

Its last word is what tells it from its twin, the variant without that word. Trackers of ranges (GMTT, TSSTP, Cluster,
RIS) want another sensor, and are not here.
"""

from __future__ import annotations

from typing import Final

from wsnsim.papers.reproduction import Claim, Experiment, Picture, Variant

IDEAL: Final = "ideal"
MEASURES: Final = "wsnsim.papers.frontier.measures"
TIGHT: Final = "per_trajectory"
WORDS: Final = {
    "noise x100": "filter_noise_scale: 100",
    "Gaussian handover": "handover: gaussian",
    "all readings": "measurements: all",
    "own readings": "measurements: own",
    "greedy": "acceptance: greedy",
    "nearest": "readings: nearest",
    "100 particles": "particles: 100",
}
"""What each word of a variant's name sets in the tracker."""
PARTICLES: Final = {"gsa_gpf": 100, "ekf": 0, "rkf": 0, "imsf": 0}
"""Where it is not the 400 of the paper: what GSA costs grows with the square, and Kalman filters have none."""
OWN: Final = {"cs_pf": "move: position", "ics_pf": "move: position", "pso_mhpf": "iterations: 2"}
SCENARIOS: Final = {IDEAL: "jiang_field", "CSMA": "pso_mhpf_real", "CSMA packed": "pso_mhpf_packed"}
NO_SINK: Final = "sink={kind: none}"
SLEEP: Final = ("sleep={{kind: ris, period: 10 s, probability: {share}}}", "wakeup={kind: region}")

ON_IDEAL: Final = (
    "pso_mhpf", "pso_mhpf, noise x100", "pso_mhpf, Gaussian handover", "pso_mhpf, all readings",
    "pso_mhpf, all readings, noise x100", "pso_mhpf, all readings, Gaussian handover",
    "ipf", "ipf, noise x100", "ipf, Gaussian handover",
    "ppf", "ppf, own readings", "ppf, noise x100", "ppf, noise x100, Gaussian handover",
    "central_pf", "central_pf, noise x100",
    "pf", "pf, noise x100", "pf, noise x100, Gaussian handover",
    "cs_pf", "cs_pf, noise x100", "ics_pf", "ics_pf, noise x100",
    "gpf", "gpf, noise x100", "gpf, 100 particles", "pso_gpf", "pso_gpf, noise x100",
    "gsa_gpf", "gsa_gpf, greedy",
    "ekf", "ekf, noise x100", "ekf, nearest", "rkf", "rkf, noise x100", "imsf", "imsf, noise x100",
)  # fmt: skip
ON_CSMA: Final = ("pso_mhpf", "ipf", "ppf", "pf, noise x100", "ekf")
IN_SLOTS: Final = (
    "pso_mhpf, Gaussian handover", "pso_mhpf, all readings", "pso_mhpf, all readings, Gaussian handover",
    "ipf, Gaussian handover", "ppf, noise x100, Gaussian handover", "central_pf, noise x100",
    "pf, noise x100", "pf, noise x100, Gaussian handover", "cs_pf, Gaussian handover", "ics_pf, Gaussian handover",
    "gpf", "gpf, noise x100", "pso_gpf", "gsa_gpf, greedy",
    "ekf", "ekf, noise x100", "ekf, nearest", "rkf", "imsf",
)  # fmt: skip
ASLEEP: Final = {"10 % awake": ("0.1", ("ekf", "ekf, noise x100", "gpf")), "3 % awake": ("0.03", ("ekf",))}


def _tracker(strategy: str) -> str:
    """What is set of the tracker: 'pf, noise x100' -> 'tracker={kind: pf, particles: 400, filter_noise_scale: 100}'."""
    kind, *words = strategy.split(", ")
    fields = [f"kind: {kind}"]
    if (count := PARTICLES.get(kind, 400)) and "100 particles" not in words:
        fields.append(f"particles: {count}")
    return (
        f"tracker={{{', '.join([*fields, *([OWN[kind]] if kind in OWN else []), *(WORDS[word] for word in words)])}}}"
    )


def _variant(air: str, strategy: str) -> Variant:
    tracker = _tracker(strategy)
    if air in ASLEEP:
        share, _ = ASLEEP[air]
        return Variant("ekf_real", (NO_SINK, SLEEP[0].format(share=share), SLEEP[1], tracker))
    if air == "slots":
        everything = ("clusters={kind: central}",) if strategy.startswith("central_pf") else ()
        return Variant("ekf_real", (NO_SINK, *everything, tracker))
    if strategy.startswith("central_pf"):
        return Variant("central_pf", (tracker,))
    return Variant(SCENARIOS[air], (tracker,))


AIRS: Final = {
    IDEAL: ON_IDEAL,
    "CSMA": ON_CSMA,
    "CSMA packed": ("pso_mhpf, Gaussian handover",),
    "slots": IN_SLOTS,
    **{air: strategies for air, (_, strategies) in ASLEEP.items()},
}
VARIANTS: Final = {
    f"{air}: {strategy}": _variant(air, strategy) for air, strategies in AIRS.items() for strategy in strategies
}
HEARD: Final = ("ideal: ekf", "ideal: gpf", "slots: ekf", "slots: gpf", "10 % awake: ekf")
"""Variants that record who heard what, for the bound on the readings that arrived."""
STARVES: Final = "with the true process noise, about 1 mm a step, 400 resampled particles starve; see 'noise x100'"
TOO_SLOW: Final = "at 64 MHz and 10 cycles an operation [our choice] a step computes about {} ms, and lasts 40"
WHY: Final = {
    "ideal: pso_mhpf, all readings": "members weigh with all readings of the cluster; one tells a distance, no place",
    "ideal: ipf, Gaussian handover": "4 packets in place of 1704: new particles are drawn from one Gaussian",
    "ideal: ppf": STARVES,
    "ideal: ppf, own readings": "a member weighs with its own reading alone, a distance and no place",
    "ideal: central_pf": STARVES,
    "ideal: pf": STARVES,
    "ideal: cs_pf": "the search climbs the likelihood alone, and forgets the prediction",
    "ideal: gpf": "particles are drawn anew from a Gaussian at each step: nothing is resampled, nothing starves",
    "ideal: gpf, 100 particles": "some runs lose the target, with 400 particles hardly one",
    "ideal: ekf": "a packet a reading, and four a handover",
    "ideal: ekf, nearest": "one reading a step, a distance and no place",
    "CSMA: pso_mhpf": "a handover of 400 particles, a frame each, takes 1.4 s a hop: 35 steps",
    "CSMA: ipf": "each particle takes its covariance along: a handover is 1704 frames a hop",
    "CSMA: ppf": "particles change node at each resampling, through the head, a frame each",
    "CSMA: ekf": "no particles move, and a step computes 0.3 ms",
    "slots: ipf, Gaussian handover": TOO_SLOW.format(88),
    "slots: cs_pf, Gaussian handover": TOO_SLOW.format(243),
    "slots: ics_pf, Gaussian handover": TOO_SLOW.format(243),
    "slots: pso_gpf": TOO_SLOW.format(246),
    "slots: gsa_gpf, greedy": TOO_SLOW.format(211),
    "3 % awake: ekf": "8 of 256 nodes are awake of themselves: a third of the steps and more have no estimate in time",
}
"""By variant: why its error comes out as it does."""
WHY_ENERGY: Final = {
    "ideal: ppf": "particles change node at each resampling, through the head, each as a packet of its own",
    "ideal: cs_pf": "computing is three quarters of it: 11 likelihoods of all readings a particle and step",
    "slots: ekf": "listening is 98 % of it (replicate 0): what a tracker sends is lost in that",
    "10 % awake: ekf": "listening is still 88 % of it (replicate 0)",
}


def twin(variant: str) -> str:
    """The variant without its last word, '' if that is not run, or if it has none."""
    shorter = variant.rpartition(", ")[0]
    return shorter if shorter in VARIANTS else ""


def _claims() -> tuple[Claim, ...]:
    found = []
    for name in VARIANTS:
        found += [
            Claim("RMSE of a run, median, m", name, "median:rmse", None, "", TIGHT, WHY.get(name, "")),
            Claim("network energy, J", name, "mean:energy", reason=WHY_ENERGY.get(name, "")),
        ]
        if not name.startswith(IDEAL):
            found.append(Claim("steps with an estimate in time, share", name, "mean:tracked"))
        if twin(name):
            found += [
                Claim("RMSE of a run over that of its twin", name, f"median_of:{MEASURES}:rmse_over_twin"),
                Claim("energy over that of its twin", name, f"median_of:{MEASURES}:energy_over_twin"),
            ]
        if name in HEARD:
            found.append(Claim("bound for the readings that arrived, m", name, f"median_of:{MEASURES}:arrived"))
    return tuple(found)


def _recording(name: str, variant: Variant) -> Variant:
    tables = ("events", "estimates", "clusters") if name in HEARD else ()
    return Variant(variant.scenario, (*variant.sets, *(f"record.{table}=true" for table in tables)))


EXPERIMENTS: Final[tuple[Experiment, ...]] = (
    Experiment(
        name="frontier",
        title="Error against joules, of every tracker on one field",
        variants={name: _recording(name, variant) for name, variant in VARIANTS.items()},
        quick=10,
        full=30,
        claims=_claims(),
        pictures=(
            Picture("frontier", "Error against energy on the field of Jiang (2013)",
                    "wsnsim.papers.frontier.pictures:frontier", (12.0, 13.0)),
        ),
        sets=("record.events=false",),
        quick_sets=("duration=14 s",),
        says=f"{MEASURES}:conclusions",
    ),
)  # fmt: skip
