"""How often the rule of the verdicts says `reproduces`, if the true ratio of measured and published value is 1 or 1.3.

python -m tests.papers.verdict_power      write docs/verdict_power.csv and the curves beside it

The runs are log-normal, some of them astray. The intervals and verdicts are those of `wsnsim.papers.verdicts`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Floats
from wsnsim.papers.resampling import MEAN, MEDIAN, TIME_MEAN_RMSE, Sample, Statistic, weights
from wsnsim.papers.verdicts import ENOUGH, PublishedValue, judged_value, ratio_interval, verdict_on_ratio

COUNTS = (30, 100, 200, 400, 1600)
PUBLISHED_RUNS = (50, 100)
TRIALS = 200
MEDIAN_TRIALS = 60
RATIO = 1.3
TIMES = 16.0
SHARE = 0.02
NAN = float("nan")
ROWS = Path(__file__).parents[2] / "docs/verdict_power.csv"
COLUMNS = ("statistic, runs", "published runs", "runs", "reproduces at a ratio of 1, %", "at 1.3, %")


@dataclass(frozen=True)
class Scene:
    """A distribution of the runs: the spread of their logarithms, and the shares astray in ours and in the published.

    In the table, `words` names it. Where only ours go astray, this is what makes the ratio 1.3 or more.
    """

    words: str
    statistic: Statistic
    sigma: float
    astray: float = 0.0
    published_astray: float = 0.0
    counts: tuple[int, ...] = COUNTS

    @property
    def caused(self) -> bool:
        """Whether runs astray are the cause of the ratio."""
        return self.astray > self.published_astray


SCENES = (
    *(Scene(f"{name}, spread {sigma:g}", statistic, sigma)
      for statistic, name in ((MEAN, "mean"), (TIME_MEAN_RMSE, "RMSE")) for sigma in (0.2, 0.4, 0.8)),
    *(Scene(f"{name}, spread 0.2, 2 % of ours astray", statistic, 0.2, SHARE)
      for statistic, name in ((MEAN, "mean"), (TIME_MEAN_RMSE, "RMSE"))),
    *(Scene(f"{name}, spread {sigma:g}, 2 % of both astray", statistic, sigma, SHARE, SHARE)
      for statistic, name in ((MEAN, "mean"), (TIME_MEAN_RMSE, "RMSE")) for sigma in (0.2, 0.8)),
    Scene("median, spread 0.1", MEDIAN, 0.1, counts=(30, 200)),
    Scene("median, spread 0.8, 2 % of both astray", MEDIAN, 0.8, SHARE, SHARE, counts=(30, 200)),
)  # fmt: skip


def drawn(rng: np.random.Generator, runs: int, trials: int, sigma: float, astray: float) -> Floats:
    """(runs, trials) values of runs."""
    values = np.exp(sigma * rng.standard_normal((runs, trials)))
    found: Floats = np.where(rng.random((runs, trials)) < astray, TIMES * values, values)
    return found


def sample(values: Floats, statistic: Statistic) -> Sample:
    """A sample of runs (runs, ...), with an axis of tracks, and for an RMSE one of steps."""
    rows = values[:, None, None] if statistic is TIME_MEAN_RMSE else values[:, None]
    return Sample(np.arange(len(values)), rows, statistic)


def probabilities(scene: Scene, count: int, published_runs: int) -> tuple[float, float]:
    """The probabilities of `reproduces` for a true ratio of 1 and of 1.3 (or what runs astray make of it)."""
    few = scene.statistic is MEDIAN or count < ENOUGH
    trials = MEDIAN_TRIALS if scene.statistic is MEDIAN else TRIALS if count >= ENOUGH else 5
    rng = np.random.Generator(np.random.Philox(key=[count, published_runs]))
    ours = drawn(rng, count, trials, scene.sigma, scene.astray)
    theirs = drawn(rng, published_runs, trials, scene.sigma, scene.published_astray)
    if scene.statistic is MEDIAN:
        printed = np.median(theirs, axis=0)
    else:
        printed = sample(theirs, scene.statistic).at(np.ones((1, published_runs)))[0]
    if few:
        found = [_judged(scene, ours, printed / ratio, published_runs) for ratio in (1.0, RATIO)]
    else:
        low, high = ratio_interval(sample(ours, scene.statistic), printed, published_runs)
        found = [_share(low * ratio, high * ratio) for ratio in (1.0, RATIO)]
    return (NAN, found[0]) if scene.caused else (found[0], found[1])


def _judged(scene: Scene, ours: Floats, printed: Floats, runs: int) -> float:
    """The share of `reproduces`, each trial judged by itself."""
    return float(np.mean([
        judged_value(sample(one, scene.statistic), PublishedValue(float(value), runs)).verdict == "reproduces"
        for one, value in zip(ours.T, printed, strict=True)
    ]))  # fmt: skip


def _share(low: Floats, high: Floats) -> float:
    return float(np.mean([verdict_on_ratio(*ends) == "reproduces" for ends in zip(low, high, strict=True)]))


def former_rule(count: int, ratio: float = RATIO, sigma: float = 0.8, trials: int = TRIALS) -> float:
    """The share of `reproduces` by the rule before: the published mean is in our interval, or within 10 %."""
    rng = np.random.Generator(np.random.Philox(key=[count, 0]))
    ours = drawn(rng, count, trials, sigma, 0.0)
    now = ours.mean(axis=0)
    low, high = np.quantile(sample(ours, MEAN).at(weights(count, count)), [0.025, 0.975], axis=0)
    printed = np.exp(sigma**2 / 2.0) / ratio
    inside = (low <= printed) & (printed <= high) & (low >= printed / 2.0) & (high <= printed * 2.0)
    return float(np.mean(inside | (np.abs(now - printed) <= 0.1 * printed)))


def table() -> dict[str, list[tuple[float, float]]]:
    """{words and published runs: the probabilities by number of runs}; NaN where nothing is simulated."""
    return {
        f"{scene.words} | {runs}": [
            probabilities(scene, count, runs) if count in scene.counts else (NAN, NAN) for count in COUNTS
        ]
        for scene in SCENES
        for runs in PUBLISHED_RUNS
    }


def as_rows(found: dict[str, list[tuple[float, float]]]) -> pd.DataFrame:
    """The table as rows: per cent of `reproduces` for a true ratio of 1, and of 1.3."""
    named = ((*name.rsplit(" | ", 1), count, cell) for name, cells in found.items()
             for count, cell in zip(COUNTS, cells, strict=True))  # fmt: skip
    rows = [(words, int(runs), count, *np.round(100.0 * np.array(cell), 1)) for words, runs, count, cell in named]
    return pd.DataFrame(rows, columns=COLUMNS)


def stored() -> dict[str, list[tuple[float, float]]]:
    """The table that docs/verdict_power.csv holds."""
    found: dict[str, list[tuple[float, float]]] = {}
    for words, published, _, one, more in pd.read_csv(ROWS).itertuples(index=False):
        found.setdefault(f"{words} | {published}", []).append((one / 100.0, more / 100.0))
    return found


def draw(found: dict[str, list[tuple[float, float]]], file: Path) -> None:
    """Draw the curves for 100 published runs, and those of the rule before."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.2), sharey=True, layout="constrained")
    for name, cells in found.items():
        words, _, runs = name.partition(" | ")
        if runs == "100" and words.startswith("RMSE"):
            for axes, values in zip(panels, zip(*cells, strict=True), strict=True):
                axes.plot(COUNTS, 100.0 * np.array(values), marker="o", markersize=3, label=words)
    counts = (10, *COUNTS)
    former = [100.0 * former_rule(count) for count in counts]
    panels[1].plot(counts, former, "k--", label="the rule before: mean, spread 0.8")
    for axes, ratio in zip(panels, ("1", "1.3 (or more, where only ours go astray)"), strict=True):
        axes.set(xscale="log", xlabel="runs", title=f"true ratio {ratio}", ylim=(-2, 102))
    panels[0].set_ylabel("'reproduces' [%]")
    panels[1].legend(frameon=False, fontsize="small")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Write the table and the curves."""
    found = table()
    as_rows(found).to_csv(ROWS, index=False, lineterminator="\n")
    draw(found, ROWS.with_suffix(".png"))
    print("the rule before:", {count: former_rule(count) for count in (10, 30, 100, 400)})


if __name__ == "__main__":
    main()
