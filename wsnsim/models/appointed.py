"""The policy of appointed clusters: members from a prediction, and a handover by their expected information.

must_appoint(outlook) -> bool      appointment(outlook) -> Appointment      next_head(outlook) -> id or None
seen = ExpectedInformation.along(outlook, path)      seen.spread(chosen)

The Fisher information of a reading about the position is that at the predicted position; nodes that would have no
reading there have none (`base.sensing`). What is compared is the trace of the inverse (A-optimality): the mean square
error of the position that the readings of one step leave. Source: Bar-Shalom, Li, Kirubarajan (2001), section 2.7.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, sqrt
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, is_relative, planar
from wsnsim.base.errors import Issue
from wsnsim.base.network_ports import Appointment, NearNodes, Outlook, steps_in
from wsnsim.base.part import Quantity, part
from wsnsim.base.sensing import detected, informations
from wsnsim.base.setups import NetworkSetup
from wsnsim.models.bounds import SECONDS
from wsnsim.models.clusters import LeadsByPlace, Threshold

PRIOR: Final = 4.0
"""Over the squared sensing range: the information of being somewhere in a disc of that radius, along each axis."""


@dataclass(frozen=True, slots=True)
class ExpectedInformation:
    """The nodes that would have a reading of a target somewhere on its path, and the information in their readings.

    Attributes:
        near: the n nodes.
        information: (n, K, P, P) Fisher information of one reading of each node, at each of the K positions.
        prior: information along each axis that is added to every sum, so that it has an inverse.
    """

    near: NearNodes
    information: Floats
    prior: float

    @classmethod
    def along(cls, outlook: Outlook, path: Floats) -> ExpectedInformation:
        """The information of all nodes about a target at each of the positions of its path (K, P)."""
        reach, points = float(outlook.sensor.reach), planar(path)
        centre = points.mean(axis=0)
        farthest = float(np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
        near = outlook.nodes_near(centre, reach + farthest)
        return cls(near, _information(outlook.sensor, path, near), PRIOR / reach**2)

    def spread(self, chosen: Floats | Bools) -> Floats:
        """(C, K) in m² the mean square error that readings leave, at each position.

        Args:
            chosen: (C, n) whether each node's reading counts, in each of C choices.
        """
        shape = self.information.shape
        total = chosen.astype(np.float64) @ self.information.reshape(shape[0], math.prod(shape[1:]))
        total = total.reshape(-1, *shape[1:])
        first = total[..., 0, 0] + self.prior
        if total.shape[-1] == 1:
            return 1.0 / first
        second = total[..., 1, 1] + self.prior
        return (first + second) / (first * second - total[..., 0, 1] ** 2)


def _information(sensor: Any, path: Floats, near: NearNodes) -> Floats:
    """(n, K, P, P) Fisher information of one reading of each node; a reading may have several components."""
    positions, columns = path.shape
    if not near.ids.size:
        return np.zeros((0, positions, columns, columns))
    found = np.moveaxis(informations(sensor, np.ascontiguousarray(path.T), near.positions, near.traits), 3, 1)
    sensed = detected(sensor, path, near.positions).T & np.isfinite(found).all(axis=(2, 3))
    return np.where(sensed[:, :, None, None], found, 0.0)


DEVIATIONS: Final = 2.0
"""Standard deviations of the predicted position that are added to the radius of appointments (our choice)."""
ALIKE: Final = 0.99
"""Heads whose expected information is equal within 1 % are taken for equally good: the nearest leads (our choice)."""

MOST_STEPS: Final = 1000
"""Steps of a horizon at most: each is predicted by the motion model, at every step of a track."""


@part
class Appointed(LeadsByPlace):
    """A cluster whose head appoints the members from its prediction, and which moves on before it knows too little.

    The head predicts the target's positions for the time `horizon`. Every node within the sensing range and `margin` of
    one of them is a member, if it hears the announcement; no node answers it. At each step the head compares the
    expected information of all nodes in sensing range of the next predicted position with that of the members among
    them: the Fisher information of one reading each, as the trace of the inverse of their sum (A-optimality). If the
    mean square error that all would leave is less than `share` times that of the members, the cluster is renewed. The
    able node within range of the head leads next whose neighbours have the greatest expected information over the
    horizon. The head stays, and appoints again, unless another's neighbours leave less than `share` times the error of
    its own. Who really senses plays no part.

    After `patience` without a reading, and more than one step, the track is lost. A track without a head gets one by an
    election, in which the strongest reading wins, as in `strongest_signal`.

    Our choice. Source of the idea: Zhao, Shin, Reich (2002), "Information-driven dynamic sensor collaboration", IEEE
    Signal Processing Magazine 19(2), doi:10.1109/79.985685.
    """

    protocol: ClassVar[str] = "appointing"
    minimum_active: ClassVar[int] = 0

    share: Annotated[
        float,
        Quantity("", gt=0, le=1),
        "mean square error with all in range over that with the members, below which they are too few",
    ] = 0.8
    horizon: Annotated[float, SECONDS, "time ahead for which members are appointed and the next head is chosen"] = 0.4
    margin: Annotated[
        float, Quantity("m", ge=0.0, le=1e7), "distance beyond the sensing range in which nodes are members"
    ] = 5.0
    patience: Annotated[float, SECONDS, "time for which the head predicts on without a reading; one step at least"] = (
        1.0
    )
    threshold: Threshold = None

    def appointment(self, outlook: Outlook) -> Appointment:
        """The rule by which nodes are members: near the positions that are predicted for the time `horizon`."""
        place = list(outlook.motion.position)
        variance = float(np.linalg.eigvalsh(outlook.forecast.cov[np.ix_(place, place)])[-1])
        radius = outlook.sensor.reach + self.margin + DEVIATIONS * sqrt(max(variance, 0.0))
        steps = steps_in(self.horizon, outlook.dt)
        return Appointment(outlook.forecast.mean, outlook.time, outlook.dt, steps, float(radius))

    def must_appoint(self, outlook: Outlook) -> bool:
        """Whether the readings of the members have too little of the information of all nodes in range."""
        seen = ExpectedInformation.along(outlook, outlook.path(outlook.forecast.mean, 0.0))
        members = (seen.near.ids[:, None] == outlook.members).any(axis=1)
        everyone, own = seen.spread(np.stack([np.ones_like(members), members]))[:, 0]
        return bool(everyone < self.share * own)

    def next_head(self, outlook: Outlook) -> int | None:
        """The best head for the time `horizon`: the head itself, or an able node in its range; None if none is able."""
        path = outlook.path(outlook.succession.mean, self.horizon)
        near = outlook.nodes_near(outlook.place, outlook.reach)
        ids, places = near.ids[near.able], near.positions[near.able]
        if not ids.size:
            return None
        spreads = _spreads(outlook, path, places)
        best = float(spreads.min())
        own = spreads[ids == outlook.head]
        if own.size and best >= self.share * own[0]:
            return outlook.head
        squared = ((places - planar(path).mean(axis=0)) ** 2).sum(axis=1)
        return int(ids[np.where(spreads * ALIKE <= best, squared, inf).argmin()])

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if no battery is large enough for a head, or if the horizon has too many steps."""
        yield from LeadsByPlace.check(self, setup)
        if is_relative(setup.sensor):
            message = "the information of readings of which only the differences count is no sum over nodes"
            yield Issue(("clusters", "kind"), f"{message}: use strongest_signal or moving_head")
        if (steps := steps_in(self.horizon, setup.dt)) > MOST_STEPS:
            allowed = f"at most {MOST_STEPS}, {MOST_STEPS * setup.dt:g} s, can be predicted"
            yield Issue(("clusters", "horizon"), f"{self.horizon:g} s are {steps} steps of {setup.dt:g} s: {allowed}")


def _spreads(outlook: Outlook, path: Floats, places: Floats) -> Floats:
    """(C,) in m² the mean square error that the neighbours of each of C heads would leave, mean along a path."""
    seen = ExpectedInformation.along(outlook, path)
    squared = ((places[:, None, :] - seen.near.positions[None]) ** 2).sum(axis=2)
    means: Floats = seen.spread(squared <= outlook.reach**2).mean(axis=1)
    return means
