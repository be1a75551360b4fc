"""The likelihood of stacked particles: each member weighs by its own measurement, or by all that it received.

likelihood = likelihood_of("own", members, heard, scene)
log_likelihoods = likelihood.score(stack)(cloud)
likelihood.among(moving.rows).score(stack.part(moving))      the same for some of the members
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias, cast

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.optional_ports import MeasuresEnergy, defined_together
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Delivery, Member
from wsnsim.base.vector_readings import missing
from wsnsim.trackers.shared.readings import Evidence, evidence_at
from wsnsim.trackers.shared.stacks import Score, Stack, place_of


class Energies(NamedTuple):
    """Readings (M,) of an energy, one a member, with the positions (M, 2) and gains (M,) of the sensors and their law.

    The law is that of `kernels.sensing`.
    """

    readings: Floats
    positions: Floats
    gains: Floats
    law: tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class OwnReadings:
    """Likelihood of stacked particles if each node uses only its own measurement."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: Evidence

    @classmethod
    def of(cls, members: Sequence[Member], scene: Scene) -> OwnReadings:
        """From the members' own readings; a missing one is not a number, and so is every likelihood with it."""
        none = missing(scene.sensor)
        values = np.array([none if member.reading is None else member.reading for member in members])
        ids = tuple([member.id for member in members])
        if ids == scene.ids:
            return cls(scene.sensor, place_of(scene), Evidence(ids, values, scene.positions, scene.traits))
        positions = np.concatenate([member.position for member in members]).reshape(len(members), -1)
        traits = np.concatenate([member.traits for member in members]).reshape(len(members), -1)
        return cls(scene.sensor, place_of(scene), Evidence(ids, values, positions, traits))

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [1] * len(self.evidence.ids)

    def energies(self) -> Energies | None:
        """What a kernel needs that weighs by the law of an energy; None if the sensor has a likelihood of its own."""
        if not defined_together(type(self.sensor), "energy_law", "log_likelihood"):
            return None
        seen = self.evidence
        law, gains = cast(MeasuresEnergy, self.sensor).energy_law(seen.traits)
        return Energies(seen.readings, np.ascontiguousarray(seen.positions), gains, law)

    def among(self, rows: Ints) -> OwnReadings:
        """The likelihood of some of the members."""
        seen = self.evidence
        ids = tuple([seen.ids[row] for row in rows.tolist()])
        return replace(self, evidence=Evidence(ids, seen.readings[rows], seen.positions[rows], seen.traits[rows]))

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's."""
        sensor, place, seen, owners = self.sensor, self.place, self.evidence, stack.layout.owners
        readings, positions, traits = seen.readings, seen.positions, seen.traits
        return lambda cloud: sensor.log_likelihood(cloud[place], readings, positions, traits, owners)


@dataclass(frozen=True, slots=True)
class SharedReadings:
    """Likelihood of stacked particles if each node uses the measurements of several nodes."""

    sensor: SensorModel
    place: slice | list[int]
    evidence: list[Evidence]

    @classmethod
    def of(cls, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene) -> SharedReadings:
        """From what the members heard of the broadcast, and their own readings."""
        evidence = [evidence_at(member, news) for member, news in zip(members, heard, strict=True)]
        return cls(scene.sensor, place_of(scene), evidence)

    @property
    def sensors(self) -> list[int]:
        """Number of measurements that each member uses."""
        return [len(seen.ids) for seen in self.evidence]

    def energies(self) -> Energies | None:
        """None: such a likelihood has no kernel for all members."""
        return None

    def among(self, rows: Ints) -> SharedReadings:
        """The likelihood of some of the members."""
        return replace(self, evidence=[self.evidence[row] for row in rows.tolist()])

    def score(self, stack: Stack) -> Score:
        """For clouds laid out as the stack's; one call where all members have the same readings."""
        first = self.evidence[0]
        if all(seen is first for seen in self.evidence):
            return lambda cloud: self._of(cloud[self.place], first)
        cuts = stack.offsets.tolist()
        return lambda cloud: self._piecewise(cloud[self.place], cuts)

    def _piecewise(self, points: Floats, cuts: list[int]) -> Floats:
        segments = zip(self.evidence, pairwise(cuts), strict=True)
        return np.concatenate(
            [self._of(np.ascontiguousarray(points[:, first:last]), seen) for seen, (first, last) in segments]
        )

    def _of(self, points: Floats, seen: Evidence) -> Floats:
        return self.sensor.log_likelihood(points, seen.readings, seen.positions, seen.traits)


Likelihood: TypeAlias = OwnReadings | SharedReadings


def likelihood_of(
    measurements: str, members: Sequence[Member], heard: Sequence[list[Delivery]], scene: Scene
) -> Likelihood:
    """The likelihood that members use: of their 'own' measurements, or of 'all' that they received."""
    if measurements == "own":
        return OwnReadings.of(members, scene)
    return SharedReadings.of(members, heard, scene)
