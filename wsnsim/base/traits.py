"""The names of the traits of nodes' sensors that more than the sensor model knows.

gain_factors(names, traits) -> (N,)      gain_column(names) -> column or None
recorded_traits(law, nodes, rng) -> (N, T)
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats

GAIN: Final = "gain"
"""A factor of a sensor's readings, or of the signal in them."""
GAIN_DB: Final = "gain_db"
"""What is added to a sensor's readings of received power, in dB."""
HEIGHT: Final = "height"
"""The height of a node in m, which the deployment gives (`HasHeights`)."""


def gain_factors(names: tuple[str, ...], traits: Floats) -> Floats:
    """(N,) the gain of each node as a factor, from traits (N, T): 1 where sensors have none, 10^(g/10) for g in dB."""
    if GAIN in names:
        gains: Floats = traits[:, names.index(GAIN)]
        return gains
    if GAIN_DB in names:
        factors: Floats = 10.0 ** (traits[:, names.index(GAIN_DB)] / 10.0)
        return factors
    return np.ones(len(traits))


def recorded_traits(law: Any, nodes: int, rng: np.random.Generator) -> Floats:
    """(nodes, T) the traits of nodes whose readings were recorded: as the law, but for gains that it would sample.

    The true gains are not known, and a sample says nothing of them: they are 1, or 0 dB, as filters take unknown gains.
    """
    traits: Floats = law.draw_traits(nodes, rng)
    if samples_gains(law):
        column = gain_column(law.trait_names)
        traits = traits.copy()
        traits[:, column] = 1.0 if law.trait_names[column] == GAIN else 0.0
    return traits


def samples_gains(sensor: Any) -> bool:
    """Whether a sensor model samples gains that differ from node to node, instead of listing them."""
    return has_gains(sensor) and not getattr(sensor, "gains", ())


def has_gains(sensor: Any) -> bool:
    """Whether the nodes of a sensor model differ in gain, which a filter may not know."""
    return gain_column(sensor.trait_names) is not None and gain_variance(sensor) > 0.0


def may_have_gains(sensor: Any) -> bool:
    """Whether the nodes of a sensor model differ in gain, or would if its spread were not 0."""
    return gain_column(sensor.trait_names) is not None or hasattr(sensor, "gain_spread")


def gain_variance(sensor: Any) -> float:
    """The variance of the gains, in the square of their unit; 0 if the sensor model does not say."""
    variance: float = getattr(sensor, "gain_variance", 0.0)
    return variance


def gain_column(names: tuple[str, ...]) -> int | None:
    """The column of the gain among a sensor's traits; None if sensors have no gain."""
    return next((column for column, name in enumerate(names) if name in (GAIN, GAIN_DB)), None)
