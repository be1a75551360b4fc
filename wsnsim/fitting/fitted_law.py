"""Laws that can be fitted to readings, and fitted laws: values with intervals, and their block in a scenario.

LAWS["rssi"].design(distances (n,)) -> (n, C)      expectation = offset + design @ coefficients (+ gain of the node)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from wsnsim.base.arrays import Floats
from wsnsim.fitting.located_readings import CONFIDENCE, DataFile, LocatedReadings
from wsnsim.fitting.residuals import Family, Noise, correlation_at
from wsnsim.models.ranging import GREATEST_RANGE, Range, Rssi

LEAST_RANGE: Final = -100.0
"""Least range (m) in a file (our choice): the sensor `range` has it if sd = 10 m; before a fit, sd is unknown."""


class Coefficient(NamedTuple):
    """A coefficient of a law: its key in the scenario, its unit, and what it is."""

    name: str
    unit: str
    about: str


class LawForm(NamedTuple):
    """A law whose expected reading is linear in its coefficients.

    Attributes:
        sensor: class of the sensor, whose fields are what a scenario can express.
        kind: its kind in a scenario.
        unit: unit of the residuals.
        reading_unit: unit of the readings.
        coefficients: one for each column of the design; the first is a constant.
        design: (n,) distances -> (n, C) columns.
        offset: (n,) distances -> (n,) the part of the expectation that has no coefficient.
        constants: key of what is added to the readings of each node.
        least: the least reading in a file.
        greatest: the greatest reading in a file.
    """

    sensor: type[Any]
    kind: str
    unit: str
    reading_unit: str
    coefficients: tuple[Coefficient, ...]
    design: Callable[[Floats], Floats]
    offset: Callable[[Floats], Floats]
    constants: str
    least: float
    greatest: float

    def has(self, key: str) -> bool:
        """Whether the sensor has this key."""
        return hasattr(self.sensor, key)


def _log_distance(distances: Floats) -> Floats:
    """The columns of z0 - 10 η log10(d / 1 m); d is at least the floor of the sensor `rssi`."""
    return np.column_stack([np.ones(len(distances)), -10.0 * np.log10(np.maximum(distances, Rssi.floor))])


LAWS: Final = {
    "rssi": LawForm(
        Rssi, "rssi", "dB", "dBm",
        (Coefficient("z0", "dBm", "strength at 1 m"), Coefficient("eta", "", "exponent of the loss with distance")),
        _log_distance, np.zeros_like, "gains", *Rssi.reading_limits,
    ),
    "range": LawForm(
        Range, "range", "m", "m", (Coefficient("bias", "m", "mean of reading minus distance"),),
        lambda distances: np.ones((len(distances), 1)), lambda distances: distances, "biases",
        LEAST_RANGE, GREATEST_RANGE,
    ),
}  # fmt: skip
"""The laws, by their kind."""
DIRECTIONS: Final = "a bearing is an angle, and no linear function of coefficients"
UNFITTED: Final = {
    "bearing": DIRECTIONS,
    "range_bearing": f"{DIRECTIONS}; a file has one number in a row",
    "tdoa": "the times of emission are unknown, one for each step; give sd, such as that of the synchronisation",
    "acoustic_energy": "its readings are a power of the distance, and not linear in its exponent",
}
"""Sensors that cannot be fitted, and why."""


class FittedValue(NamedTuple):
    """An estimate with its interval.

    Attributes:
        value: the estimate.
        low: the lower end of its 95 % interval; NaN where there is none.
        high: the upper end.
        unit: its unit.
        about: what it is.
        approximate: why the interval is approximate; '' if it is not.
    """

    value: float
    low: float
    high: float
    unit: str
    about: str
    approximate: str = ""


def resampled(units: int, resamples: int, seed: int) -> Floats:
    """(resamples + 1, units) weights of units: ones, then how often each unit is in each resample of a bootstrap."""
    counts = np.random.default_rng(seed).multinomial(units, np.full(units, 1.0 / units), resamples)
    return np.concatenate([np.ones((1, units)), counts])


def percentiles(values: Floats, unit: str, about: str) -> FittedValue:
    """The first value as estimate, with the 95 % interval of the other values, which are those of resamples."""
    known = values[1:][np.isfinite(values[1:])]
    low, high = np.quantile(known, [0.025, 0.975]).tolist() if known.size else (math.nan, math.nan)
    return FittedValue(float(values[0]), low, high, unit, about)


def logarithmic(
    values: Floats, units: int, unit: str, about: str, approximate: str = "", inflation: float = 1.0
) -> FittedValue:
    """The first value as estimate, with an interval of its logarithm by the other values, which are those of resamples.

    Args:
        values: (R,) the estimate and those of resamples.
        units: number of units that were resampled; Student's t has one degree of freedom less.
        unit: the unit of the values.
        about: what they are.
        approximate: why the interval is approximate.
        inflation: the variance is multiplied by this.
    """
    known = values[1:][np.isfinite(values[1:]) & (values[1:] > 0.0)]
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, units - 1)) * math.sqrt(inflation * units / (units - 1))
    value, factor = float(values[0]), math.exp(reach * float(np.log(known).std())) if known.size > 1 else math.nan
    return FittedValue(value, value / factor, value * factor, unit, about, approximate)


class FittedGain(NamedTuple):
    """The gain of a node, or its bias minus their mean.

    Attributes:
        node: the name of the node.
        readings: the number of its readings.
        value: the gain in dB, or the bias in m; 0 without readings.
        low: the lower end of its 95 % interval.
        high: the upper end.
    """

    node: str
    readings: int
    value: float
    low: float
    high: float


class FittedModel(NamedTuple):
    """The expectation and noise of readings.

    Attributes:
        form: the law.
        coefficients: (C,) of the law.
        gains: (S,) of the nodes; empty if all have the same.
        noise: of a reading.
        heights: whether distances are three-dimensional.
    """

    form: LawForm
    coefficients: Floats
    gains: Floats
    noise: Noise
    heights: bool

    def residuals(self, sample: LocatedReadings) -> Floats:
        """(n,) readings minus their expectations."""
        distances = sample.distances(self.heights)
        expected = self.form.offset(distances) + self.form.design(distances) @ self.coefficients
        if self.gains.size:
            expected = expected + self.gains[sample.nodes]
        return sample.readings - expected


class ResidualFigures(NamedTuple):
    """Figures of residuals: RMSE, skewness, kurtosis (3 if normal), correlation at 1 s, and mean log density."""

    rmse: float
    skewness: float
    kurtosis: float
    correlation: float
    log_likelihood: float


class Evaluation(NamedTuple):
    """Figures of the law on a file.

    Attributes:
        file: the file.
        in_sample: whether the law was fitted to it.
        fitted: figures under the fitted law.
        plain: figures under the law without gains, with one normal noise, fitted to the same readings.
    """

    file: DataFile
    in_sample: bool
    fitted: ResidualFigures
    plain: ResidualFigures


class FitBasis(NamedTuple):
    """The basis of the intervals and of the choice of the family of noise.

    Attributes:
        aic: Akaike's criterion of each family of noise, with readings taken as independent.
        blocks: number of the blocks of time and path that intervals are computed from.
        seconds: their least length in s.
        path: their least length in m.
        stays: number of blocks in which the target stands still.
    """

    aic: Mapping[Family, float]
    blocks: int
    seconds: float
    path: float
    stays: int


@dataclass(frozen=True)
class FittedLaw:
    """A law fitted to recorded readings.

    Attributes:
        model: expectation and noise of readings.
        values: estimates with intervals: coefficients, sd, dof, shadowing, decorrelation, and `total`, the sd of all
            noise, if the sensor has shadowing. Keys of the sensor have the interval of what `sensor` has.
        gains: of the nodes, in the order of the deployment; empty if none were fitted.
        sample: the readings that were fitted.
        basis: the basis of the intervals and of the choice of the family of noise.
        plain: the law without gains and with one normal noise, fitted to the same readings.
        test: figures of both on other files, or on the same ones if that was requested.
    """

    model: FittedModel
    values: Mapping[str, FittedValue]
    gains: tuple[FittedGain, ...]
    sample: LocatedReadings
    basis: FitBasis
    plain: FittedModel
    test: tuple[Evaluation, ...] = ()

    @property
    def digests(self) -> list[str]:
        """The digests of the files that were fitted."""
        return [file.digest for file in self.sample.files]

    @property
    def residuals(self) -> Floats:
        """(n,) residuals of the readings in `sample`."""
        return self.model.residuals(self.sample)

    @property
    def train(self) -> tuple[ResidualFigures, ResidualFigures]:
        """Figures of the fitted readings under the fitted and under the plain law."""
        return figures(self.model, self.sample), figures(self.plain, self.sample)

    @property
    def target_height(self) -> float | None:
        """The median height (m) of the target, which filters take for known; None if heights are not used."""
        return round(float(np.median(self.sample.points[:, 2])), 3) if self.model.heights else None

    @property
    def sensor(self) -> dict[str, Any]:
        """The block `sensor` of a scenario."""
        form = self.model.form
        block: dict[str, Any] = {"kind": form.kind}
        block |= {name: _rounded(value.value) for name, value in self.values.items() if form.has(name)}
        if form.kind == "range":
            own = self.model.gains if self.gains else np.zeros(len(self.sample.deployment.ids))
            block["biases"] = [_rounded(self.values["bias"].value + bias) for bias in own.tolist()]
            if self.sample.distances(heights=False).max() > Range.reach:
                block["reach"] = ".inf"
        else:
            block |= {"d0": 1.0} | ({"gains": [round(gain.value, 3) for gain in self.gains]} if self.gains else {})
        if form.constants in block:
            block["nodes"] = list(self.sample.deployment.ids)
        if self.target_height is not None:
            block["target_height"] = self.target_height
        if math.isfinite(self.model.noise.dof):
            block["noise"] = "student_t"
        return block | {"fitted_on": self.digests}

    @property
    def law(self) -> dict[str, Any]:
        """The block `sensor` as filters believe it: they take readings as independent, and shadowing as part of sd."""
        block = {name: value for name, value in self.sensor.items() if name not in ("shadowing", "decorrelation")}
        return block | ({"sd": _rounded(self.values["total"].value)} if "total" in self.values else {})


def figures(model: FittedModel, sample: LocatedReadings) -> ResidualFigures:
    """The figures of a sample's residuals under a model."""
    residuals = model.residuals(sample)
    second = float((residuals**2).mean())
    centred = residuals - residuals.mean()
    variance = float((centred**2).mean())
    skewness, kurtosis = (
        float((centred**power).mean()) / variance ** (power / 2) if variance > 0.0 else math.nan for power in (3, 4)
    )
    likelihood = float(model.noise.log_density(residuals).mean())
    return ResidualFigures(math.sqrt(second), skewness, kurtosis, correlation_at(sample, residuals, 1.0), likelihood)


def _rounded(value: float) -> float:
    """The value with six significant digits."""
    return float(f"{value:.6g}")
