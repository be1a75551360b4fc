"""Why each claim of Ruan (2020) comes out as it does, in a line: facts of our quick runs (50, or 10 in `table_1_...`).

By filter, by 'filter, particles' where that differs, and by 'better worse' for an order of two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

THROWN: Final = "with G0 = 100 a first move is up to G0 exp(-2) = 13.5 m long: the cloud is thrown apart"
MOST_LIKELY: Final = "the same at every N: the swarm gathers near the readings' most likely place"
BELOW: Final = f"{THROWN}; 0.31 m is below PF with 5000 particles, and below the bound, which is not strict here"

ORDERS: Final[Mapping[str, str]] = {
    "gsa_gpf pso_gpf": f"{THROWN}; accepted only where it improves, it is better",
    "pso_gpf gpf": "PSO-GPF stays at 0.44 to 0.45 m; GPF's median run improves from 0.92 to 0.45 and 0.37 m",
    "gpf pf": "GPF's median run is better at every N, without resampling; both lose runs, PF more of them at 50",
    "greedy pso_gpf": "our repair, moves only where they improve: better than the swarm at every N",
    "greedy gpf": "our repair; it stays at 0.40 to 0.43 m, and GPF's median run has 0.45 at 100 and 0.37 at 200",
    "share pso_gpf": f"{THROWN}; greedy, it has 0.43 m where PSO-GPF has 0.45 m",
    "share gpf": "GPF lost 7 of 50 runs, which make its mean: its median run is better than GSA-GPF's",
    "share pf": "PF lost 15 of 50 runs, which make its mean: its median run is better than GSA-GPF's",
    "growth": "in the median 0.22 m with PF and 0.08 m with GSA-GPF, but run by run not clearly so",
}
"""Of table 1 in the room."""
IN_ROOM: Final[Mapping[str, str]] = {
    "pf, 50": "15 of 50 runs lost, which make the mean: see the median",
    "pf, 100": "3 of 50 runs lost, which make the mean: see the median",
    "pf, 200": "1 of 50 runs lost",
    "gpf, 50": "7 of 50 runs lost, which make the mean: see the median",
    "gpf, 100": "4 of 50 runs lost, which make the mean: see the median",
    "gpf, 200": "1 of 50 runs lost",
    "pso_gpf": MOST_LIKELY,
    "gsa_gpf": f"{THROWN}; see the greedy rows",
    "gsa_gpf, 200": BELOW,
}
MANY: Final[Mapping[str, str]] = {
    "pf": "what 200 particles save here are lost runs: 15 of 50 with 50, 1 with 200",
    "gpf": "what 200 particles save here are lost runs: 7 of 50 with 50, 1 with 200",
    "pso_gpf": MOST_LIKELY,
    "gsa_gpf": "of an error that is three times the published one",
    "gpf pf": "both save lost runs, and more than half of the median run's error",
    "pso_gpf pf": "PSO-GPF is the same at every N",
    "gsa_gpf pf": "GSA-GPF goes from 1.43 to 0.91 m, PF saves lost runs",
    "gsa_gpf gpf": "GSA-GPF goes from 1.43 to 0.91 m, GPF saves lost runs",
    "gsa_gpf pso_gpf": "PSO-GPF is the same at every N, and so depends on it least",
}
REFERENCE: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("gsa_gpf, 50, greedy", "gsa_gpf, 100, greedy", "gsa_gpf, 200, greedy"),
        "our repair: a particle moves only to where it is more likely",
    ),
    "gsa_gpf, 100, G0 = 1": "a pull of the size of the cloud [our choice]: as GPF, lost runs included",
    "gsa_gpf, 100, all columns": "literal: velocities are pulled, too, and the distance does not count them",
    "pso_gpf, 100, all columns": "velocities fly, too: about the same",
    "pf, 5000": "PF with 50 times the particles",
    "ekf": "one Gaussian, linearised",
    "trilateration": "the weighted centroid of section 1.2, step by step, without a filter",
}

NO_TURN: Final = "no run lost: the truth has no noise, and a filter that knew that could have 0.16 m"
DIAGONAL: Final[Mapping[str, str]] = {
    "pf": NO_TURN,
    "gpf": NO_TURN,
    "pso_gpf": "the same at every N, as in the room",
    "gsa_gpf": THROWN,
    "gsa_gpf pso_gpf": THROWN,
    "pso_gpf gpf": "the swarm forgets the prediction, which is worth much here",
    "gpf pf": "about equal at 100, as neither loses a run",
}
TURN: Final[Mapping[str, str]] = {
    **DIAGONAL,
    "pf": "no run lost: the turn changes vy by 1 m/s, which is two deviations of a step's noise",
    "gpf": "no run lost: the turn changes vy by 1 m/s, which is two deviations of a step's noise",
}
ACCELERATIONS: Final[Mapping[str, str]] = {
    **DIAGONAL,
    "pf": "no run lost: with two inputs of noise in place of four the same particles are enough",
    "gpf": "no run lost: with two inputs of noise in place of four the same particles are enough",
    "gsa_gpf, 200": BELOW,
    "pso_gpf gpf": "the swarm forgets the prediction; GPF needs no help with two inputs of noise",
    "gpf pf": "about equal, as hardly a run of either is lost",
}
DIRECT: Final[Mapping[str, str]] = {
    **dict.fromkeys(("pf", "gpf", "pso_gpf", "gsa_gpf"), "every truth leaves the room, and ends 29 to 87 m from it"),
    **dict.fromkeys(
        ("gsa_gpf pso_gpf", "pso_gpf gpf", "gpf pf"), "most runs of each are lost, since the target leaves"
    ),
}

NOT_GSA: Final = "the same moves with G0 = 100, in a room of 6 m"
_INDOOR: Final[Mapping[str, str]] = {
    "gsa_gpf, 100 pf, 100": NOT_GSA,
    "pso_gpf, 100 pf, 100": "PF's median run is the better one, though the mean of its runs is worse",
    "gpf, 100 pf, 100": "as in the larger room",
    "gsa_gpf, 100 pso_gpf, 100": NOT_GSA,
    "gsa_gpf, 100 gpf, 100": NOT_GSA,
    "gsa_gpf, 100, greedy pso_gpf, 100": "our repair",
    "gsa_gpf, 100, greedy gpf, 100": "our repair; GPF's median run is better, though the mean of its runs is worse",
    **dict.fromkeys(
        ("pf, 100", "gpf, 100", "pso_gpf, 100", "gsa_gpf, 100"), "the paper prints no number for its one run"
    ),
    "gsa_gpf, 100, greedy": "our repair: a particle moves only to where it is more likely",
    "pf, 5000": REFERENCE["pf, 5000"],
    "ekf": "2 of 50 runs lost: at 3 dB² one Gaussian is not always enough",
    "trilateration": REFERENCE["trilateration"],
}
INDOOR: Final[Mapping[str, str]] = {key: f"of a surrogate: {why}" for key, why in _INDOOR.items()}
"""Of figures 4 and 5, whose recorded readings do not exist here."""
