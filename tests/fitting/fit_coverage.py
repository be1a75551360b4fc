"""How often the 95 % intervals of `wsnsim fit` hold the truth, in recordings that are simulated from a known law.

python -m tests.fitting.fit_coverage docs [DESIGN ...]     fit 1,000 recordings of each design, or of those alone; write
                                                           the outcomes of all fits into fit_coverage.json beside this
                                                           file, the table beside the page, and its ends into it
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import pandas as pd
from scipy import stats

from tests.helpers.recorded_walks import HEIGHT, Walks
from wsnsim.fitting.data_files import DataFile
from wsnsim.fitting.estimation import FitOptions, fit_sample
from wsnsim.fitting.fitted_law import LAWS, FittedGain, FittedValue
from wsnsim.fitting.located_readings import LocatedReadings, NodeTable
from wsnsim.fitting.result import Fit

FITS: Final = 1_000
HELD: Final = Path(__file__).with_name("fit_coverage.json")
PAGE: Final = "explanation/fits.md"
TABLE: Final = "explanation/fit_coverage.csv"
HOLD, ROUGHLY = "hold the truth [%]", "approximate ones that do [%]"
COLUMNS: Final = ("design", "what it is", "quantity", HOLD, "fits", ROUGHLY, "approximate fits")
MARKS: Final = ("<!-- coverage: begin -->\n", "<!-- coverage: end -->\n")
ANCHORS: Final = np.array([(0.0, 0.0), (30.0, 0.0), (30.0, 40.0), (0.0, 40.0)])
POINTS: Final = np.array([(5.0, 7.0), (22.0, 12.0), (14.0, 31.0), (9.0, 22.0), (25.0, 33.0)])
HOLDS, MISSES, ROUGHLY_HOLDS, ROUGHLY_MISSES, NONE = "10+~-"
"""Outcomes of a fit: the interval holds the truth or not; the same if it is said to be approximate; no interval."""
Outcomes: TypeAlias = dict[str, dict[str, str]]
"""{design: {quantity: the outcome of each fit}}"""


@dataclass(frozen=True)
class Design:
    """Recordings of a target that walks, or that stands still at `points`, among `nodes` receivers."""

    words: str
    law: Walks
    gains: bool = False
    nodes: int = 8
    stays: bool = False

    @property
    def constant(self) -> str:
        """What the constant of a node is called."""
        return "bias of a node minus their mean" if self.law.law == "range" else "gain"

    @property
    def truth(self) -> dict[str, float]:
        """The true value of each quantity; nothing can tell constant errors of links from noise if nothing moves."""
        law = self.law
        found = {"z0": law.z0, "eta": law.eta, "sd": law.sd, "shadowing": law.shadowing}
        found |= {"decorrelation": law.decorrelation}
        if law.law == "range":
            found = {"bias": law.z0, "sd": float(np.hypot(law.sd, law.shadowing))}
            found |= {"shadowing": law.shadowing, "decorrelation": law.decorrelation} if law.shadowing else {}
        elif self.stays or not law.shadowing:
            found = {"z0": law.z0, "eta": law.eta, "sd": float(np.hypot(law.sd, law.shadowing))}
        if np.isfinite(law.dof):
            found["dof"] = law.dof
        return found | ({self.constant: float(self.law.nodes()[1][0])} if self.gains else {})

    def sample(self, seed: int) -> LocatedReadings:
        """The readings of one recording."""
        rng = np.random.default_rng(seed)
        places, gains = (part[: self.nodes] for part in self.law.nodes())
        walks = [self.law.walk(rng) for _ in range(self.law.tracks)]
        if self.stays:
            places = np.column_stack([ANCHORS, np.full(len(ANCHORS), HEIGHT)])
            walks = [np.tile([*point, HEIGHT], (30, 1)) for point in POINTS]
        gains = gains[: len(places)] if self.gains else np.zeros(len(places))
        readings = [self.law.readings(rng, walk, places, gains) for walk in walks]
        steps, count = readings[0].shape
        times = np.tile(np.arange(steps).repeat(count) * self.law.dt, len(walks))
        nodes = np.tile(np.arange(count), steps * len(walks))
        points = np.concatenate(walks).repeat(count, axis=0)
        table = NodeTable(tuple(f"n{i}" for i in range(count)), places)
        files = tuple(DataFile(f"track{i}.csv", "", steps * count) for i in range(len(walks)))
        return LocatedReadings(
            times,
            nodes,
            np.concatenate(readings).ravel(),
            points,
            np.arange(len(walks)).repeat(steps * count),
            table,
            files,
        )

    def fit(self, seed: int) -> Fit:
        """The fit to one recording."""
        return fit_sample(self.sample(seed), LAWS[self.law.law], FitOptions(gains=self.gains))

    def outcomes(self, fits: int) -> dict[str, str]:
        """The outcomes of the fits of the first recordings."""
        found = [self._outcome(self.fit(seed)) for seed in range(fits)]
        return {name: "".join(row[name] for row in found) for name in found[0]}

    def _outcome(self, fit: Fit) -> dict[str, str]:
        values: dict[str, FittedValue | FittedGain] = {**fit.values}
        values |= {self.constant: fit.gains[0]} if fit.gains else {}
        shadowed = bool(self.law.shadowing) and not self.stays
        return {
            **{name: _outcome(values.get(name), true) for name, true in self.truth.items()},
            SHADOWED: HOLDS if ("shadowing" in fit.values) == shadowed else MISSES,
            FAMILY: HOLDS if np.isfinite(fit.model.noise.dof) == np.isfinite(self.law.dof) else MISSES,
        }


SHADOWED: Final = "whether there is `shadowing`"
FAMILY: Final = "family of the noise"


def _outcome(value: FittedValue | FittedGain | None, true: float) -> str:
    if value is None or np.isnan(value.low):
        return NONE
    holds = value.low <= true <= value.high
    if getattr(value, "approximate", ""):
        return ROUGHLY_HOLDS if holds else ROUGHLY_MISSES
    return HOLDS if holds else MISSES


RANGES: Final = Walks("range", z0=0.4, sd=0.2, shadowing=0.0)
DESIGNS: Final = {
    "path": Design("8 links without gains, four walks of 60 s and 30 m", Walks()),
    "stays": Design(
        "4 links, the target stands still at 5 points", Walks(z0=-50.0, eta=2.0, sd=1.0, shadowing=6.0), stays=True
    ),
    "few links": Design("2 links, else as `path`", Walks(), nodes=2),
    "gains": Design("8 links with gains of their own, else as `path`", Walks(), gains=True),
    "heavy tails": Design("Student's t with 5 degrees of freedom, else as `gains`", Walks(dof=5.0), gains=True),
    "white": Design("no noise is correlated, else as `gains`", Walks(shadowing=0.0), gains=True),
    "biases": Design(
        "ranges of 8 anchors with biases of their own and white noise, else as `path`", RANGES, gains=True
    ),
    "biases in clutter": Design(
        "as `biases`, with noise that is correlated", replace(RANGES, shadowing=0.3), gains=True
    ),
}


def below(outcomes: Outcomes) -> dict[tuple[str, str], float]:
    """For each cell, the probability of so few hits at a coverage of 95 %, with Holm's correction.

    Cells are the intervals that are not said to be approximate.
    """
    counts = {
        (design, name): (text.count(HOLDS), text.count(HOLDS) + text.count(MISSES))
        for design, row in outcomes.items()
        for name, text in row.items()
        if name not in (SHADOWED, FAMILY)
    }
    raw = {cell: float(stats.binom.cdf(hits, fits, 0.95)) for cell, (hits, fits) in counts.items() if fits}
    found, least = {}, 0.0
    for rank, cell in enumerate(sorted(raw, key=lambda name: raw[name])):
        least = max(least, min(1.0, raw[cell] * (len(raw) - rank)))
        found[cell] = least
    return found


def shares(outcomes: Outcomes) -> pd.DataFrame:
    """Per cent of the intervals that hold the truth, a row for each design and quantity; approximate ones apart."""
    rows = []
    for design, row in outcomes.items():
        for name, text in row.items():
            counts = [(text.count(holds), text.count(misses))
                      for holds, misses in ((HOLDS, MISSES), (ROUGHLY_HOLDS, ROUGHLY_MISSES))]  # fmt: skip
            found = [100.0 * holds / (holds + misses) if holds + misses else np.nan for holds, misses in counts]
            rows.append((design, DESIGNS[design].words, name, found[0], sum(counts[0]), found[1], sum(counts[1])))
    return pd.DataFrame(rows, columns=COLUMNS)


def table(outcomes: Outcomes) -> str:
    """All shares as CSV."""
    return shares(outcomes).to_csv(index=False, float_format="%.1f", lineterminator="\n")


def markdown(outcomes: Outcomes) -> str:
    """The least and the largest share of all designs, in Markdown."""
    found = shares(outcomes)
    decided = found["quantity"].isin((SHADOWED, FAMILY))
    lines = [
        f"- an interval holds the truth: {_range(found[HOLD][~decided])}; least p: {min(below(outcomes).values()):.2g}",
        f"- one that is said to be approximate: {_range(found[ROUGHLY][~decided])}",
        *(
            f"- {name}, rightly decided: {_range(found[HOLD][found['quantity'] == name])}"
            for name in (SHADOWED, FAMILY)
        ),
    ]
    return "\n".join([*lines, ""])


def _range(values: pd.Series) -> str:
    return f"{values.min():.1f} to {values.max():.1f} %"


def in_document(text: str) -> str:
    """The ends that a page holds."""
    return text.partition(MARKS[0])[2].partition(MARKS[1])[0]


def held() -> Outcomes:
    """The outcomes of the last study."""
    return json.loads(HELD.read_text(encoding="utf-8"))


def main() -> None:
    """Fit all recordings, and write outcomes, table and page."""
    chosen = sys.argv[2:] or DESIGNS
    outcomes = {name: DESIGNS[name].outcomes(FITS) if name in chosen else held()[name] for name in DESIGNS}
    HELD.write_text(json.dumps(outcomes, indent=1) + "\n", encoding="utf-8")
    page = Path(sys.argv[1]) / PAGE
    pattern = re.escape(MARKS[0]) + ".*?" + re.escape(MARKS[1])
    text = re.sub(
        pattern, lambda _: MARKS[0] + markdown(outcomes) + MARKS[1], page.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    page.write_text(text, encoding="utf-8")
    page.with_name(Path(TABLE).name).write_text(table(outcomes), encoding="utf-8")


if __name__ == "__main__":
    main()
