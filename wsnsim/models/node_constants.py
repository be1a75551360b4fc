"""Constants of nodes in a reading of a distance: what is added to it, and heights; and what filters assume of them.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

T is 0, 1 or 2: what is added to the readings of a node where nodes differ, and its height in m where heights count.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import ClassVar, Final, Literal, NamedTuple, Self

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError, shortened
from wsnsim.base.initial_conditions import joined_by_name, node_names
from wsnsim.base.part import part
from wsnsim.base.sensing import HEIGHT
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import number_of_nodes
from wsnsim.models.distances import Excess, OfDistance, reach_issues, squared_distances

NAMES: Final = "names of the nodes in whose order constants are listed; default: all nodes, in the deployment's order"
"""The description of `nodes`."""
HowGains = Literal["known", "unknown", "estimated"]


class Constants(NamedTuple):
    """What is added to readings: a normal number of each node, one that all have in common, or listed ones.

    Attributes:
        key: the parameter that lists them.
        listed: those of the nodes in their order; none: they are drawn.
        spread: standard deviation of that of a node.
        common: standard deviation of that of all.
    """

    key: str
    listed: tuple[float, ...]
    spread: float
    common: float = 0.0


class OfNodes(OfDistance):
    """The base of sensors of a distance whose nodes may differ in what is added to a reading, and in height.

    A subclass gives the field `target_height`, `constants`, `law`, `ranges` and `_means`. With a target height the
    distance is that in space, with the heights of the nodes from the deployment.
    """

    constant: ClassVar[str]
    reach: float
    target_height: float | None
    nodes: tuple[int | str, ...] = ()

    @property
    def constants(self) -> Constants:
        """What is added to the readings of nodes."""
        raise NotImplementedError

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """The constants for the kernels; `inflation` is added to R."""
        raise NotImplementedError

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected."""
        raise NotImplementedError

    def _means(self, squared: Floats) -> Floats:
        """(n,) readings without noise and constants at squared distances (n,)."""
        raise NotImplementedError

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of a node's traits: what is added if nodes differ, and its height if heights count."""
        if self.target_height is not None:
            return (self.constant, HEIGHT)
        return (self.constant,) if self.gain_variance else ()

    def with_nodes(self, names: Sequence[str]) -> Self:
        """The sensor whose constants are listed in the order of nodes of these names.

        Raises:
            RunError: one of them has no constant, or names and constants are not as many.
        """
        if not self.nodes:
            return self
        key, listed, *_ = self.constants
        own = tuple(map(str, self.nodes))
        if not len({*own}) == len(own) == len(listed):
            raise RunError(f"{len(listed)} {key} for the {len(own)} names in nodes: name each node once")
        found = joined_by_name(names, own, "the deployment", "sensor.nodes")
        if lacking := [name for name, node in zip(names, found, strict=True) if node < 0]:
            raise RunError(f"{key}: none for {shortened(', '.join(lacking))}, they are those of {', '.join(own)}")
        return dataclasses.replace(self, nodes=(), **{key: tuple(listed[node] for node in found.tolist())})  # type: ignore[type-var]

    @property
    def gain_variance(self) -> float:
        """The variance of what is added, as filters know it: that of the listed numbers without a spread."""
        _, listed, spread, common = self.constants
        if spread or common or not listed:
            return spread**2 + common**2
        return math.fsum(gain**2 for gain in listed) / len(listed)

    @property
    def gain_prior(self) -> float:
        """The variance of a gain that the filter estimates: 0, it knows the gains."""
        return 0.0

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) what is added to the readings of each node, and its height: 0 until the deployment gives it.

        Raises:
            RunError: the numbers listed are not those of the nodes.
        """
        if not self.trait_names:
            return np.empty((nodes, 0))
        key, listed, spread, common = self.with_nodes([*map(str, range(nodes))]).constants
        if listed and len(listed) != nodes:
            raise RunError(_wrong_count(key, len(listed), nodes))
        drawn = spread * rng.standard_normal(nodes)
        if common:
            drawn = drawn + common * rng.standard_normal()
        return np.column_stack([listed or drawn, np.zeros(nodes)])[:, : len(self.trait_names)]

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings of targets at points (n, P) by sensors at positions (n, 2), with standard normal noise.

        Points with three columns have the target's height, which counts instead of `target_height`.
        """
        readings = self.expected(points, positions, traits) + self._errors(noise, math.sqrt(self._law[3]))
        return readings + traits[:, 0] if self.trait_names else readings

    def expected(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(n,) readings without noise and without what is added to those of a node."""
        squared = squared_distances(points[:, :2], positions)
        if self.target_height is not None:
            squared = squared + (traits[:, 1] - (points[:, 2] if points.shape[1] > 2 else self.target_height)) ** 2
        return self._means(squared)

    def ranges_in_plane(self, readings: Floats, traits: Floats) -> Floats:
        """(S,) as `ranges`, without what is added, in the plane: sqrt(max(d² - (h_node - h_target)², 0))."""
        return self.in_plane(self.ranges(readings - traits[:, 0] if self.trait_names else readings), traits)

    def in_plane(self, ranges: Floats, traits: Floats) -> Floats:
        """(S,) the distances in the plane of distances in space, both in m."""
        if self.target_height is None:
            return ranges
        return np.sqrt(np.maximum(ranges**2 - (traits[:, 1] - self.target_height) ** 2, 0.0))

    def assumed(self, gains: str, inflate: bool) -> OfNodes | AssumedDistance:
        """The model that a filter assumes: what is added is 'known', 'unknown' (taken as 0) or 'estimated'.

        With `inflate`, the variances of what is unknown and of shadowing are added to that of a reading.
        """
        how: HowGains = gains if gains in ("unknown", "estimated") and self.gain_variance else "known"  # type: ignore[assignment]
        if how == "known" and not (inflate and getattr(self, "shadowing", None)):
            return self
        return AssumedDistance(sensor=self, gains=how, inflate=inflate)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the range is finite and too long, and if other than one number a node is listed."""
        yield from reach_issues(self.reach)
        key, listed, *_ = self.constants
        if self.nodes:
            try:
                self.with_nodes(node_names(setup))
            except RunError as error:
                yield Issue(("sensor", "nodes"), str(error))
            return
        nodes = number_of_nodes(setup.deploy) if listed else None
        if nodes is not None and nodes != len(listed):
            yield Issue(("sensor", key), _wrong_count(key, len(listed), nodes))

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        """(S, 2) the positions, or (S, 3) with the squared difference in height."""
        if self.target_height is None:
            return np.ascontiguousarray(positions)
        return np.column_stack([positions, (traits[:, 1] - self.target_height) ** 2])

    def _gains(self, traits: Floats) -> Floats | None:
        return np.ascontiguousarray(traits[:, 0]) if self.trait_names else None

    @cached_property
    def _law(self) -> kernels.Law:
        return self.law()


@part
class AssumedDistance(OfDistance):
    """The model that a filter assumes of a sensor of which it does not know all: constants not known are 0.

    With `inflate`, the variances of unknown constants and of shadowing are added to that of a reading, as if both were
    independent from step to step: R' = R + σ_g² + σ² (our choice). A filter that estimates the constants beside the
    state (`estimated`) takes them off the readings itself: `gain_prior` is the variance with which it begins, of which
    `common_prior` is that of a part that all nodes have in common.
    """

    sensor: OfNodes
    gains: HowGains
    inflate: bool

    @property
    def gain_prior(self) -> float:
        """The variance of a gain that the filter estimates, at first; 0 if it estimates none."""
        return self.sensor.gain_variance if self.gains == "estimated" else 0.0

    @property
    def common_prior(self) -> float:
        """The covariance of the gains of two nodes, at first."""
        return self.sensor.constants.common**2

    @property
    def reach(self) -> float:
        """The sensing range of the true sensor, in m."""
        return self.sensor.reach

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of a node's traits, as of the true sensor."""
        return self.sensor.trait_names

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) the traits of each node that the filter knows: gains are 0 if it does not."""
        return self._known(self.sensor.draw_traits(nodes, rng))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings as the filter assumes them: without gains that it does not know, with its variance."""
        known, errors = self._known(traits), self._errors(noise, math.sqrt(self._law[3]))
        readings = self.sensor.expected(points, positions, known) + errors
        return readings + known[:, 0] if self.trait_names else readings

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, as from the true sensor."""
        return self.sensor.ranges(readings)

    def ranges_in_plane(self, readings: Floats, traits: Floats) -> Floats:
        """(S,) as `ranges`, in the plane."""
        return self.sensor.ranges_in_plane(readings, self._known(traits))

    def assumed(self, gains: str, inflate: bool) -> OfNodes | AssumedDistance:
        """The model that another filter assumes of the same sensor."""
        return self.sensor.assumed(gains, inflate)

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        return self.sensor._places(positions, traits)

    def _gains(self, traits: Floats) -> Floats | None:
        return np.ascontiguousarray(traits[:, 0]) if self.gains == "known" and self.trait_names else None

    def _known(self, traits: Floats) -> Floats:
        """The traits (n, T) with gains that are not known as 0."""
        return traits if self.gains == "known" else traits * (0.0, 1.0)[: traits.shape[1]]

    @cached_property
    def _law(self) -> kernels.Law:
        unknown = self.sensor.gain_variance if self.gains == "unknown" else 0.0
        return self.sensor.law(unknown + getattr(self.sensor, "shadowing", 0.0) ** 2 if self.inflate else 0.0)

    @property
    def _dof(self) -> float:
        return self.sensor._dof

    @property
    def _excess(self) -> Excess | None:
        return self.sensor._excess


def _wrong_count(key: str, listed: int, nodes: int) -> str:
    return f"{listed} {key} for {nodes} nodes: list one for each node, in the order of the nodes"
