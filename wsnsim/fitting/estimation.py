"""A law is fitted to a sample: least squares, then the split of the residuals' variance, then the family of noise.

fit_sample(sample, form, options) -> Fit
fit_readings(files, nodes, form, test, reading, options) -> Fit, judged on files that share no rows with the fitted ones
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import RunError, UsageError
from wsnsim.fitting import residuals as noises
from wsnsim.fitting.data_files import ReadingOptions, read_nodes, read_sample
from wsnsim.fitting.fitted_law import (
    Evaluation,
    FitBasis,
    FittedGain,
    FittedModel,
    FittedValue,
    LawForm,
    figures,
    logarithmic,
    resampled,
)
from wsnsim.fitting.located_readings import Coefficients, LocatedReadings, is_shared, least_squares, shared_with
from wsnsim.fitting.residuals import Family, Noise, Shadowing, averaged, lagged, shadowing
from wsnsim.fitting.result import Fit

RESAMPLES: Final = 400
BLOCK: Final = 10.0
"""Length (s) of a block: several times the time over which residuals of a walking target are correlated."""
LEAST_BLOCKS: Final = 10
"""Shorter recordings are cut into this many blocks."""
DECORRELATIONS: Final = 4.0
"""Decorrelation distances of path in a block, at least."""
LEAST_NOISE: Final = 1e-6
"""Least standard deviation that a sensor can have."""
AT_LIMIT: Final = " (at a limit of what was tried)"
LEAST_WHITE: Final = 1e-3
"""Least standard deviation of the white part, relative to that of the residuals."""
LEAST_SPREAD: Final = 1e-3
"""Least standard deviation of a column of the design among readings of one node that tells it from the gains."""


@dataclass(frozen=True)
class FitOptions:
    """What is fitted.

    Attributes:
        gains: whether each node has a gain, or a bias.
        heights: whether distances are those in space; None: if the heights of nodes and target are known.
        noise: family of the white part; `auto`: that with the lower criterion of Akaike.
        block: least length (s) of the blocks from which intervals are computed; None: 10 s, and a path of
            `DECORRELATIONS` times the fitted decorrelation distance, but each at most a tenth of the recording. Stays
            are never cut.
        seed: of the bootstrap.
        in_sample: whether the law may be judged on readings that it was fitted to.
    """

    gains: bool = True
    heights: bool | None = None
    noise: Literal["auto", "normal", "student_t"] = "auto"
    block: float | None = None
    seed: int = 0
    in_sample: bool = False

    def __post_init__(self) -> None:
        """Raises UsageError for an unknown family of noise, or a block without length."""
        if self.noise not in ("auto", "normal", "student_t"):
            raise UsageError(f"noise: must be auto, normal or student_t, is {self.noise!r}")
        if self.block is not None and not 0.0 < self.block < math.inf:
            raise UsageError(f"block: must be a positive number of seconds, is {self.block!r}")


class _Residuals(NamedTuple):
    """What the noise is fitted to.

    Attributes:
        values: (n,) residuals.
        blocks: (n,) number of the block of each.
        weights: (R, B) weightings of the blocks: one for each block first, then those of the bootstrap.
        parameters: number of parameters of the expectation.
    """

    values: Floats
    blocks: Ints
    weights: Floats
    parameters: int


def fit_sample(sample: LocatedReadings, form: LawForm, options: FitOptions) -> Fit:
    """Fit a law to the readings of a sample.

    Raises:
        UsageError: the sensor has no heavy tails, which are asked for.
        RunError: the readings do not determine the law.
    """
    if options.noise == "student_t" and not form.has("dof"):
        raise UsageError(f"noise: the sensor `{form.kind}` has normal noise alone; give normal or auto")
    heights = sample.has_heights if options.heights is None else options.heights
    if heights and not sample.has_heights:
        raise RunError("heights: the file of nodes or that of the trajectory has no column z")
    count = len(sample.deployment.ids) if options.gains else 0
    _check_determined(sample, form, heights, count)
    asked = dataclasses.replace(options, heights=heights)
    if options.block is not None:
        return _fit_in_blocks(sample, form, asked, count, options.block)
    first = _fit_in_blocks(sample, form, asked, count, *_block_length(sample, 0.0))
    if "decorrelation" not in first.values:
        return first
    wanted = _block_length(sample, DECORRELATIONS * first.values["decorrelation"].value)
    return _fit_in_blocks(sample, form, asked, count, *wanted)


def _fit_in_blocks(
    sample: LocatedReadings, form: LawForm, options: FitOptions, count: int, block: float, path: float = 0.0
) -> Fit:
    """The fit with intervals from blocks of at least this time (s) and path (m)."""
    heights = bool(options.heights)
    blocks = sample.blocks(block, path)
    if not blocks.any():
        raise RunError(f"the readings lie within one block of {block:g} s or one stay: intervals need at least two")
    weights = resampled(int(blocks.max()) + 1, RESAMPLES, options.seed)
    solved = _regression(sample, form, heights, count, blocks)
    model = FittedModel(form, solved.values, solved.gains, Noise("normal", 1.0, math.inf, 0.0), heights)
    left = _Residuals(model.residuals(sample), blocks, weights, len(solved.values) + count)
    noise, values, aic = _fitted_noise(sample, left, form, options)
    inflation = 1.0
    if noise.shadowing > 0.0:
        ratio = sample.whole_path / weights.shape[1] / values["decorrelation"].value
        each = len(blocks) / weights.shape[1] / len(np.unique(sample.nodes))
        inflation = _inflation(ratio, (noise.sd / noise.shadowing) ** 2 / each)
    reaches = solved.reaches * math.sqrt(inflation)
    if not form.has("shadowing"):
        noise = Noise("normal", values["sd"].value, math.inf, 0.0)
    return Fit(
        model._replace(noise=noise),
        _coefficients(form, solved, reaches[: len(solved.values)]) | values,
        _gains(sample, solved, reaches[len(solved.values) :]),
        sample,
        FitBasis(aic, weights.shape[1], block, path, sample.stays(blocks)),
        _plain(sample, model, blocks),
    )


def _regression(sample: LocatedReadings, form: LawForm, heights: bool, count: int, blocks: Ints) -> Coefficients:
    distances = sample.distances(heights)
    response = sample.readings - form.offset(distances)
    return least_squares(form.design(distances), response, sample.nodes, count, blocks)


def _plain(sample: LocatedReadings, model: FittedModel, blocks: Ints) -> FittedModel:
    """The law without gains, and with one normal noise."""
    solved = _regression(sample, model.form, model.heights, 0, blocks)
    plain = model._replace(coefficients=solved.values, gains=np.empty(0))
    residuals = plain.residuals(sample)
    variance = float((residuals**2).sum()) / max(len(residuals) - len(solved.values), 1)
    return plain._replace(noise=Noise("normal", math.sqrt(variance), math.inf, 0.0))


def _check_determined(sample: LocatedReadings, form: LawForm, heights: bool, count: int) -> None:
    """Raises RunError if there are too few readings, or distances do not vary enough."""
    design = form.design(sample.distances(heights))
    heard = len(np.unique(sample.nodes)) if count else 0
    needed = design.shape[1] + heard + 2
    if len(design) < needed:
        raise RunError(f"{len(design)} readings cannot determine this law: at least {needed} are needed")
    apart = design[:, 1:] - design[:, 1:].mean(axis=0)
    if count:
        sizes = np.maximum(np.bincount(sample.nodes, minlength=count), 1)
        means = [np.bincount(sample.nodes, column, count) / sizes for column in apart.T]
        apart -= np.column_stack([*means, np.empty((count, 0))])[sample.nodes]
    if apart.size and apart.std(axis=0).min() < LEAST_SPREAD:
        hint = "; without gains (--no-gains) it may be" if count else ""
        raise RunError(f"the distances hardly vary, and {form.coefficients[1].name} is not determined{hint}")


def _block_length(sample: LocatedReadings, path: float) -> tuple[float, float]:
    """The least time (s) and path (m) of a block: as wanted, but short enough for `LEAST_BLOCKS` of them."""
    total = sum(float(np.ptp(sample.times[own])) for _, own in sample.by_file() if own.any())
    return min(BLOCK, total / LEAST_BLOCKS) or BLOCK, min(path, sample.whole_path / LEAST_BLOCKS)


def _inflation(ratio: float, white: float = 0.0) -> float:
    """The variance of a mean of correlated readings, relative to what it were if blocks were independent.

    Args:
        ratio: path of a block, relative to the decorrelation distance.
        white: variance of the mean of a block's white parts, relative to the variance of the correlated part.
    """
    return (white + 2.0 / ratio) / (white + 2.0 * (ratio - 1.0 + math.exp(-ratio)) / ratio**2)


def _fitted_noise(
    sample: LocatedReadings, left: _Residuals, form: LawForm, options: FitOptions
) -> tuple[Noise, dict[str, FittedValue], dict[Family, float]]:
    """The noise, its values with intervals from the bootstrap, and the criterion of each family.

    Raises:
        RunError: there is hardly any noise, or its family cannot be told.
    """
    total = _variances(left)
    if total[0] <= LEAST_NOISE**2:
        raise RunError(f"the readings follow the law to {LEAST_NOISE:g} {form.unit}: there is no noise to be fitted")
    found = lagged(sample, left.values, left.blocks, sample.travelled)
    mean = averaged(sample, left.parameters > len(form.coefficients))
    parts = _significant(shadowing(found, mean, left.weights), total)
    white = np.sqrt(np.maximum(total - parts.variances * parts.remaining, LEAST_WHITE**2 * total))
    sd, spread = float(white[0]), math.sqrt(float(parts.variances[0]))
    histogram = noises.histogram(left.values, left.blocks, math.sqrt(float(total[0])))
    dofs, likelihoods = noises.student_t(histogram, sd, spread, left.weights)
    normal = noises.normal_log_likelihood(histogram, math.hypot(sd, spread))
    aic: dict[Family, float] = {
        "normal": 2.0 * (left.parameters + 1) - 2.0 * normal,
        "student_t": 2.0 * (left.parameters + 2) - 2.0 * float(likelihoods[0]),
    }
    if sd < noises.LEAST_WHITE_SHARE * spread:
        aic["student_t"] = math.inf
        if options.noise == "student_t":
            raise RunError("noise: nearly all of it is correlated along the path, so that its family cannot be told")
    family: Family = min(aic, key=lambda name: aic[name]) if options.noise == "auto" else options.noise
    tails = dofs if family == "student_t" and form.has("dof") else None
    values = _noise_values(sample, np.stack([white, np.sqrt(total)]), tails, parts, left.weights.shape[1], form)
    return Noise(family, sd, math.inf if tails is None else float(tails[0]), spread), values, aic


def _noise_values(
    sample: LocatedReadings, deviations: Floats, dofs: Floats | None, parts: Shadowing, count: int, form: LawForm
) -> dict[str, FittedValue]:
    """The values of the noise with intervals from this number of blocks; deviations (2, R) of white part and of all."""
    unit, split = form.unit, form.has("shadowing")
    few = f"{count} blocks are fewer than {LEAST_BLOCKS}" if count < LEAST_BLOCKS else ""
    about = f"standard deviation of {'the white part of ' * split}the noise"
    values = {"sd": logarithmic(deviations[0 if split else 1], count, unit, about, few)}
    if dofs is not None:
        why = "it takes sd and shadowing as known"
        limit = AT_LIMIT * (dofs[0] in (noises.GRID[0], noises.GRID[-1]))
        values["dof"] = logarithmic(dofs, count, "", f"degrees of freedom of the white part{limit}", why)
    if parts.variances[0] > 0.0:
        about = "standard deviation of the part that is correlated along the path"
        values["shadowing"] = logarithmic(np.sqrt(parts.variances), count, unit, about, few)
        if split:
            both = np.sqrt(deviations[0] ** 2 + parts.variances)
            values["total"] = logarithmic(both, count, unit, "standard deviation of both parts together", few)
        few = few or ("the noise has heavy tails" if dofs is not None else "")
        about = f"path over which that correlation falls to 1/e{AT_LIMIT * parts.limited}"
        inflation = _inflation(sample.whole_path / count / float(parts.distances[0]))
        values["decorrelation"] = logarithmic(parts.distances, count, "m", about, few, inflation)
    return values


def _variances(left: _Residuals) -> Floats:
    """(R,) variance of the residuals for each weighting of the blocks."""
    squares = np.bincount(left.blocks, left.values**2)
    counts = np.bincount(left.blocks)
    freed = len(left.values) / max(len(left.values) - left.parameters, 1)
    return (left.weights @ squares) / np.maximum(left.weights @ counts, 1.0) * freed


def _significant(parts: Shadowing, total: Floats) -> Shadowing:
    """The correlated parts, or none at all if any resample has none."""
    if parts.variances.min() > 0.0:
        return parts
    return Shadowing(np.zeros_like(total), np.full_like(total, np.nan), np.ones_like(total), False)


def _coefficients(form: LawForm, solved: Coefficients, reaches: Floats) -> dict[str, FittedValue]:
    return {
        column.name: FittedValue(value, value - reach, value + reach, column.unit, column.about)
        for column, value, reach in zip(form.coefficients, solved.values.tolist(), reaches.tolist(), strict=True)
    }


def _gains(sample: LocatedReadings, solved: Coefficients, reaches: Floats) -> tuple[FittedGain, ...]:
    counts = np.bincount(sample.nodes, minlength=len(sample.deployment.ids)).tolist()
    rows = zip(sample.deployment.ids, counts, solved.gains.tolist(), reaches.tolist(), strict=False)
    return tuple(FittedGain(node, count, value, value - reach, value + reach) for node, count, value, reach in rows)


def fit_readings(
    files: Sequence[str],
    nodes: str,
    form: LawForm,
    test: Sequence[str] = (),
    reading: ReadingOptions | None = None,
    options: FitOptions | None = None,
) -> Fit:
    """Fit a law to the readings of all files and judge it on the test files.

    Without test files, and with `in_sample`, it is judged on the files that it was fitted to.

    Raises:
        UsageError: a test file shares readings with a train file (`SAME_SHARE` of them), and `in_sample` is not said.
        RunError: a file cannot be used, or the readings do not determine the law.
    """
    how, wanted = reading or ReadingOptions(), options or FitOptions()
    table = read_nodes(nodes, how.node_columns)
    every = read_sample([*files, *test], table, form, how)
    train = every.of(range(len(files)))
    judged = [every.of([index]) for index in range(len(files), len(every.files))]
    if not test and wanted.in_sample:
        judged = [every.of([index]) for index in range(len(files))]
    known = {file.path: train.keys(index) for index, file in enumerate(train.files)}
    shared = []
    for sample in judged:
        (file,) = sample.files
        named = next((other.path for other in train.files if other.digest == file.digest), None)
        found = (named, 1.0) if named else shared_with(sample.keys(0), known)
        shared.append(is_shared(file.path, found, wanted.in_sample))
    fitted = fit_sample(train, form, wanted)
    test_rows = (
        Evaluation(sample.files[0], again, figures(fitted.model, sample), figures(fitted.plain, sample))
        for sample, again in zip(judged, shared, strict=True)
    )
    return dataclasses.replace(fitted, test=tuple(test_rows))
