"""Scans of several targets by some nodes: a simple simulator of its own for trackers of several targets."""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Estimate, components_of
from wsnsim.base.ports import KnownNodes
from wsnsim.base.scans import Facts, Scan
from wsnsim.base.sensing import detected
from wsnsim.models.linear import ConstantVelocity

MOTION = ConstantVelocity(variances=(0.05, 0.05))


def facts_of(sensor: Any, motion: Any = MOTION, probability: float = 0.9, clutter: float = 1.0, volume: float = 200.0):
    """What a head assumes, with steps of a second."""
    return Facts(motion, sensor, 1.0, probability, clutter, volume)


def ring(count: int, radius: float = 60.0, traits: int = 0) -> KnownNodes:
    """Nodes on a circle, with ids that are not their rows."""
    angles = 2.0 * np.pi * (np.arange(count) + 0.3) / count
    places = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return KnownNodes(tuple(range(10, 10 + count)), places, np.zeros((count, traits)))


def grid(side: int, spacing: float) -> KnownNodes:
    """Nodes on a square lattice about the origin."""
    axis = spacing * (np.arange(side) - (side - 1) / 2.0)
    places = np.array([(x, y) for x in axis for y in axis])
    return KnownNodes(tuple(range(len(places))), places, np.zeros((len(places), 0)))


def straight(starts: Any, steps: int) -> np.ndarray:
    """(steps + 1, T, 4) targets that start at states (T, 4) and keep their velocity."""
    states = np.array(starts, dtype=np.float64)
    times = np.arange(steps + 1.0)[:, None]
    result = np.repeat(states[None], steps + 1, axis=0)
    result[:, :, 0] += times * states[:, 1]
    result[:, :, 2] += times * states[:, 3]
    return result


def scans_of(
    truth: np.ndarray, step: int, nodes: KnownNodes, facts: Facts, rng: np.random.Generator, low: Any, high: Any
) -> list[Scan]:
    """The scans of all nodes at a step, of targets (steps, T, 4), NaN where absent; clutter is from `low` to `high`."""
    points, size = truth[step][:, [0, 2]], len(components_of(facts.sensor))
    points = points[np.isfinite(points).all(axis=1)]
    within = detected(facts.sensor, points, nodes.positions) if len(points) else np.zeros((0, len(nodes.ids)))
    result = []
    for row, node in enumerate(nodes.ids):
        made = points[(within[:, row] > 0) & (rng.random(len(points)) < facts.probability)]
        own = nodes.positions[[row] * len(made)], nodes.traits[[row] * len(made)]
        noise = rng.standard_normal((len(made), size) if size > 1 else len(made))
        real = facts.sensor.measure(made, *own, noise).reshape(len(made), size)
        false = rng.uniform(low, high, (rng.poisson(facts.clutter), size))
        rows = np.concatenate([real, false])
        result.append(Scan(node, float(step), rows[rng.permutation(len(rows))]))
    return result


def prior_of(state: np.ndarray, sd: Any = (2.0, 0.5, 2.0, 0.5), rng: np.random.Generator | None = None) -> Estimate:
    """A prior around a state."""
    mean = np.array(state, dtype=np.float64)
    if rng is not None:
        mean = mean + np.array(sd) * rng.standard_normal(4)
    return Estimate(mean, np.diag(np.array(sd) ** 2))


def driven(tracker: Any, belief: Any, all_scans: list[list[Scan]], nodes: KnownNodes, facts: Facts):
    """The outcome of each step; new tracks are numbered on."""
    number = 1 + max((track.number for track in belief.tracks), default=-1)
    for scans in all_scans:
        outcome = tracker.step(belief, scans[0].time, scans, nodes, facts, number)
        belief = outcome.belief
        number += sum(event.kind == "start" for event in outcome.events)
        yield outcome
