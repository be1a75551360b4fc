"""The fit of the link `log_normal` to recorded links: sensitivity, asymmetry, and path loss if positions are known.

- Sensitivity: the delivery ratio of a burst, as a function of its mean power, is fitted by least squares.
- Asymmetry: root mean square of the difference between both directions of a pair.
- Path loss: maximum likelihood of the mean powers of pairs. A pair whose power is below the least one that is always
  received, or that was not heard at all, counts as being below that power (censored regression: Tobin 1958,
  "Estimation of relationships for limited dependent variables"); without this, far links seem too good.

Intervals come from a bootstrap of nodes, since all pairs of a node share its antenna: the weight of a pair is the
product of how often its two nodes were sampled (Davison, Hinkley 1997, "Bootstrap methods and their application", for
resampled units).

fit_links(files, nodes, test, options) -> LinkFit
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import optimize, special

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.errors import RunError
from wsnsim.base.version import __version__
from wsnsim.fitting.fitted_law import FittedValue, percentiles, resampled
from wsnsim.fitting.link_sample import LinkRows, delivery, margin, mean_power, read_link_rows
from wsnsim.fitting.located_readings import DataFile, is_shared, shared_with
from wsnsim.fitting.result import bad_row_notes, block_lines, file_text, one_line, refused, value_lines

STATED_RATIOS: Final = (0.1, 0.5, 0.9)
"""Delivery ratios at which powers are stated."""
CURVE_BIN: Final = 1.0
"""Width (dB) of the bins in which these powers are found."""


class LinkEvaluation(NamedTuple):
    """Errors of the fitted link on a file.

    Attributes:
        file: the file.
        in_sample: whether the link was fitted to it.
        ratio_rmse: RMSE of delivery ratios, given the powers of the bursts.
        power_rmse: RMSE (dB) of the mean powers of pairs that were heard, given their distance; NaN without positions.
    """

    file: DataFile
    in_sample: bool
    ratio_rmse: float
    power_rmse: float


@dataclass(frozen=True)
class LinkFit:
    """The link `log_normal`, fitted to recorded links.

    Attributes:
        rows: the bursts that were fitted.
        values: estimates by the key of the scenario, with intervals.
        power: transmit power (dBm) of the recording, as it was stated.
        frame: length (bytes) of its packets, as it was stated.
        test: errors on other files, or on the same ones if that was requested.
    """

    rows: LinkRows
    values: Mapping[str, FittedValue]
    power: float
    frame: int
    test: tuple[LinkEvaluation, ...] = ()

    @property
    def link(self) -> dict[str, Any]:
        """The block `link` of a scenario."""
        fitted = {key: float(f"{own.value:.5g}") for key, own in self.values.items() if math.isfinite(own.value)}
        digests = [file.digest for file in self.rows.files]
        return {"kind": "log_normal", "power": self.power} | fitted | {"fitted_on": digests}

    def mean_power(self, distances: Floats) -> Floats:
        """(n,) mean received power in dBm over these distances, in m."""
        return mean_power(distances, self.power, self.values)

    @property
    def curve(self) -> tuple[Floats, Floats]:
        """Powers (K,) in dBm and mean delivery ratios (K,) of the bursts around them."""
        bins = np.floor(self.rows.powers / CURVE_BIN).astype(np.int64)
        found, index = np.unique(bins, return_inverse=True)
        counts = np.bincount(index.ravel())
        many = counts >= 20  # the mean of fewer bursts is mostly chance
        ratios = np.bincount(index.ravel(), self.rows.ratios) / counts
        return (found[many].astype(np.float64) + 0.5) * CURVE_BIN, ratios[many].astype(np.float64)

    def yaml(self) -> str:
        """The block `link` as text that a scenario can extend. Raises RunError if no scenario can have this link."""
        for reason in refused("link", self.link):
            raise RunError(reason)
        head = [
            f"Link fitted by wsnsim fit {__version__}; a scenario can extend this file.",
            f"power and the length of packets ({self.frame} bytes) are as stated by the user, not recorded",
            *(f"train: {file_text(file, 'bursts')}, {file.digest}" for file in self.rows.files),
            *(f"test: {_test_text(row)}, {row.file.digest}" for row in self.test),
            *([] if self.test else ["test: none"]),
        ]
        if "exponent" not in self.values:
            head.append("no positions were given: path loss and shadowing have their defaults, not those of the links")
        return (
            "\n".join([*(f"# {one_line(line)}" for line in head), *block_lines("link", self.link, self.values)]) + "\n"
        )

    def text(self) -> str:
        """The estimates and figures as tables."""
        return "\n".join([
            f"link log_normal, fitted to {len(self.rows.ratios)} bursts between {len(self.rows.nodes)} nodes:",
            *(f"  {file_text(file, 'bursts')}" for file in self.rows.files), "",
            *value_lines(self.values), "", *self._notes(),
        ])  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """All figures as plain values."""
        powers, ratios = self.curve
        return {
            "law": "log_normal",
            "link": self.link,
            "values": {name: value._asdict() for name, value in self.values.items()},
            "curve": {"power": powers.tolist(), "ratio": ratios.tolist()},
            "train": {"files": [dataclasses.asdict(file) for file in self.rows.files]},
            "test": [dataclasses.asdict(row.file) | {
                "in_sample": row.in_sample, "ratio_rmse": row.ratio_rmse, "power_rmse": row.power_rmse,
            } for row in self.test],
        }  # fmt: skip

    def plot(self, out: str | Path) -> Path:
        """Write the figure as PNG, SVG or PDF, and return its path."""
        from wsnsim.fitting.plots import LinkFigure, plot_links

        return plot_links(LinkFigure(self.rows, self.values, self.curve, self.frame, self.power), Path(out))

    def _notes(self) -> Iterator[str]:
        """How intervals came about, what the model cannot express, and the figures on test files."""
        yield "Intervals come from a bootstrap of nodes: all pairs of a node share its antenna."
        powers, ratios = self.curve
        reached = [(level, powers[np.argmax(ratios >= level)]) for level in STATED_RATIOS if (ratios >= level).any()]
        levels = ", ".join(f"{level:g} at {power:.1f} dBm" for level, power in reached)
        yield f"Recorded delivery ratio: {levels or f'below {STATED_RATIOS[0]:g}, or of too few bursts at each power'}."
        yield "The sensitivity is that of the links as they are, with noise: it holds beside the datasheet of a radio."
        if "exponent" not in self.values:
            yield "Without positions (--nodes), path loss and shadowing cannot be fitted."
        yield from refused("link", self.link)
        for row in self.test:
            yield f"{'IN SAMPLE' if row.in_sample else 'Test'}: {_test_text(row)}."
        yield from bad_row_notes([*self.rows.files, *(row.file for row in self.test)])
        if not self.test:
            yield "Not judged on other links: name some with --test."


def _test_text(row: LinkEvaluation) -> str:
    power = f", of powers {row.power_rmse:.2f} dB" if math.isfinite(row.power_rmse) else ""
    return f"{file_text(row.file, 'bursts')}, RMSE of delivery ratios given power {row.ratio_rmse:.3f}{power}"


RESAMPLES: Final = 200
LOSS_RESAMPLES: Final = 60
"""Resamples for the path loss, whose fit takes longer."""
STEP: Final = 0.05
TRIED: Final = -110.0 + STEP * np.arange(1001)
"""Sensitivities (dBm) that are tried; the best one and its neighbours are joined by a parabola."""
FIT_BIN: Final = 0.1
"""Width (dB) of the bins of power in which delivery ratios are summed."""
FEWEST_PAIRS: Final = 10


@dataclass(frozen=True)
class LinkOptions:
    """How links are fitted.

    Attributes:
        power: transmit power (dBm) of the recording, which its files do not state.
        frame: length (bytes) of the recorded packets, headers included, which its files do not state reliably.
        node_columns: names of the columns id, x, y and z of the file of places, where they differ.
        skip_bad_rows: whether rows that cannot be used are left out and counted, instead of refused.
        seed: seed of the bootstrap.
        in_sample: whether the links may be judged on files that they were fitted to.
    """

    power: float = 0.0
    frame: int = 100
    node_columns: Mapping[str, str] = field(default_factory=dict)
    skip_bad_rows: bool = False
    seed: int = 0
    in_sample: bool = False


def fit_links(files: Sequence[str], nodes: str | None, test: Sequence[str], options: LinkOptions) -> LinkFit:
    """Fit the link `log_normal` to K7 files and judge it on others.

    Args:
        files: K7 files, also .gz.
        nodes: CSV file with id, x, y and perhaps z of the nodes; None: no path loss is fitted.
        test: K7 files on which the fitted link is judged.
        options: how links are fitted.

    Raises:
        UsageError: a test file shares rows with a fitted file, and `in_sample` is not set.
        RunError: a file cannot be used, or too few links were recorded.
    """
    rows = read_link_rows(files, nodes, options.node_columns, options.skip_bad_rows)
    judged = test or (files if options.in_sample else ())
    tests = [read_link_rows([file], nodes, options.node_columns, options.skip_bad_rows) for file in judged]
    known = {file.path: keys for file, keys in zip(rows.files, rows.keys, strict=True)}
    shared = [is_shared(each.files[0].path, shared_with(each.keys[0], known), options.in_sample) for each in tests]
    fitted = fit_link_rows(rows, options)
    judgements = (_evaluated(fitted, each, again) for each, again in zip(tests, shared, strict=True))
    return dataclasses.replace(fitted, test=tuple(judgements))


def fit_link_rows(rows: LinkRows, options: LinkOptions) -> LinkFit:
    """Fit the link to the bursts of files. Raises RunError if too few were recorded."""
    heard = np.isfinite(rows.means)
    if heard.sum() < FEWEST_PAIRS:
        raise RunError(f"only {heard.sum()} pairs of nodes have clear bursts: at least {FEWEST_PAIRS} are needed")
    weights = resampled(len(rows.nodes), RESAMPLES, options.seed)
    sensitivities = _sensitivities(rows, weights, options.frame)
    values = {
        "sensitivity": percentiles(sensitivities, "dBm", "power at which 1 % of frames of 20 bytes are lost"),
        "asymmetry": percentiles(_asymmetries(rows, weights), "dB", "standard deviation between both directions"),
    }
    if rows.places is not None:
        clear = values["sensitivity"].value + margin(options.frame)
        losses = _losses(rows, weights[: LOSS_RESAMPLES + 1], clear)
        values["loss_at_1m"] = percentiles(options.power - losses[:, 0], "dB", "path loss at 1 m")
        values["exponent"] = percentiles(losses[:, 1], "", "path-loss exponent")
        values["shadowing"] = percentiles(np.exp(losses[:, 2]), "dB", "standard deviation from link to link")
    return LinkFit(rows, values, options.power, options.frame)


def _sensitivities(rows: LinkRows, weights: Floats, frame: int) -> Floats:
    """(R,) the least-squares sensitivity, given delivery ratios, for each of the weightings (R, nodes) of nodes."""
    cells, cell = np.unique(np.rint(rows.powers / FIT_BIN), return_inverse=True)
    expected = delivery(cells * FIT_BIN - TRIED[:, None], frame)
    weight_sums, ratio_sums = np.empty((len(cells), len(weights))), np.empty((len(cells), len(weights)))
    for column, weight in enumerate(weights):
        each = weight[rows.sources] * weight[rows.receivers]
        weight_sums[:, column] = np.bincount(cell.ravel(), each, len(cells))
        ratio_sums[:, column] = np.bincount(cell.ravel(), each * rows.ratios, len(cells))
    # Σ w (expected - ratio)² without Σ w ratio², which is the same for all sensitivities
    costs = expected**2 @ weight_sums - 2.0 * expected @ ratio_sums
    best = np.clip(np.argmin(costs, axis=0), 1, len(TRIED) - 2)
    before, least, after = (costs[best + step, np.arange(len(weights))] for step in (-1, 0, 1))
    bend = before - 2.0 * least + after
    between = np.where(bend > 0.0, 0.5 * (before - after) / np.where(bend > 0.0, bend, 1.0), 0.0)
    result: Floats = TRIED[best] + STEP * np.clip(between, -1.0, 1.0)
    return result


def _asymmetries(rows: LinkRows, weights: Floats) -> Floats:
    """(R,) root mean square of the difference between the two directions, for weightings of nodes."""
    first, second = rows.pairs
    squares = rows.differences**2
    known = np.isfinite(squares)
    each = weights[:, first[known]] * weights[:, second[known]]
    total = each.sum(axis=1)
    return np.sqrt((each @ squares[known]) / np.where(total > 0.0, total, np.nan))


def _losses(rows: LinkRows, weights: Floats, clear: float) -> Floats:
    """(R, 3) mean power at 1 m, exponent and log of the shadowing, for weightings of nodes."""
    first, second = rows.pairs
    logs, powers = 10.0 * np.log10(rows.distances), rows.means
    if np.ptp(logs) < 0.1:
        raise RunError("all nodes are equally far from each other: the exponent is not determined")
    seen = powers >= clear
    if seen.sum() < FEWEST_PAIRS:
        raise RunError(f"only {seen.sum()} pairs have clear links: at least {FEWEST_PAIRS} are needed")
    slope, level = np.polyfit(logs[seen], powers[seen], 1)
    start = np.array([level, max(-slope, 1.0), math.log(float((powers[seen] - level - slope * logs[seen]).std()))])
    data = _Censored(logs, np.where(seen, powers, clear), seen)
    found: list[Floats] = []
    for weight in weights:
        solution = optimize.minimize(data.cost, start, weight[first] * weight[second], method="BFGS", jac=True)
        start = solution.x if not found else start  # resamples begin at the estimate
        found.append(solution.x)
    return np.array(found)


class _Censored(NamedTuple):
    """The pairs of the path-loss fit.

    Attributes:
        logs: (P,) 10 log10 of their distances.
        powers: (P,) their mean powers in dBm; of a pair that is not `seen`, the limit below which its power is.
        seen: (P,) whether the power of the pair is known.
    """

    logs: Floats
    powers: Floats
    seen: Bools

    def cost(self, values: Floats, weights: Floats) -> tuple[float, Floats]:
        """The negative log-likelihood of (power at 1 m, exponent, log of the shadowing), and its gradient (3,)."""
        shadowing = math.exp(min(max(float(values[2]), -5.0), 5.0))
        deviations = (self.powers - values[0] + values[1] * self.logs) / shadowing
        below = special.log_ndtr(deviations)
        density = np.exp(-0.5 * deviations**2 - below) / math.sqrt(2.0 * math.pi)
        terms = np.where(self.seen, -0.5 * deviations**2 - math.log(shadowing), below)
        slopes = weights * np.where(self.seen, -deviations, density)  # derivative of `terms` by `deviations`
        by_log_shadowing = -float(slopes @ deviations) - float(weights @ self.seen)
        gradient = np.array([-slopes.sum() / shadowing, slopes @ self.logs / shadowing, by_log_shadowing])
        return -float(weights @ terms), -gradient


def _evaluated(fit: LinkFit, rows: LinkRows, in_sample: bool) -> LinkEvaluation:
    """The errors of delivery ratios given powers, and of powers given distances."""
    expected = delivery(rows.powers - fit.values["sensitivity"].value, fit.frame)
    ratio = float(np.sqrt(((rows.ratios - expected) ** 2).mean()))
    power = math.nan
    if rows.places is not None:
        heard = np.isfinite(rows.means)
        power = float(np.sqrt(((rows.means - fit.mean_power(rows.distances))[heard] ** 2).mean()))
    return LinkEvaluation(rows.files[0], in_sample, ratio, power)
