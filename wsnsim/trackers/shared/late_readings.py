"""Readings that arrive some steps after they were taken: the head computes those steps and the later ones again.

    filtered(kept steps, mixture, {step: readings}, scene) -> kept steps, this one the last

The head keeps the readings of as many steps as a packet may span, and the mixture after each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.ports import Scene
from wsnsim.trackers.shared.mixtures import Hypotheses, predicted_mixture, updated_mixture
from wsnsim.trackers.shared.readings import Evidence

PREDICTION_CYCLES: Final = 300.0
"""Operations by which a Gaussian is predicted over one step (our estimate, as those below)."""
READING_CYCLES: Final = 1100.0
"""Operations by which a Gaussian is updated with one reading."""


class Kept(NamedTuple):
    """A step that may have to be computed once more: its readings, and the mixture after them."""

    step: int
    seen: Evidence
    mixture: Hypotheses


def by_step(answer: Mapping[int, tuple[Any, Bools]], scene: Scene) -> dict[int, Evidence]:
    """The readings that arrived, by the step in which they were taken."""
    found: dict[int, list[tuple[int, int, Any]]] = {}
    for row, node in enumerate(scene.ids):
        if node in answer and answer[node][1].all():
            for ago, value in answer[node][0]:
                found.setdefault(scene.step - ago, []).append((row, node, value))
    return {step: _evidence(taken, scene) for step, taken in found.items()}


def _evidence(taken: list[tuple[int, int, Any]], scene: Scene) -> Evidence:
    rows = [row for row, _, _ in taken]
    values = np.array([value for _, _, value in taken], dtype=np.float64)
    return Evidence(tuple(node for _, node, _ in taken), values, scene.positions[rows], scene.traits[rows])


def filtered(
    kept: tuple[Kept, ...], mixture: Hypotheses, arrived: dict[int, Evidence], scene: Scene
) -> tuple[Kept, ...]:
    """The kept steps and this one. Where readings of earlier steps arrived, these are computed once more."""
    now = scene.step
    first = min(arrived, default=now)
    before = tuple(each for each in kept if each.step < first)
    if first >= now or not before:
        seen = arrived.get(now, _nothing(scene))
        return (*kept, Kept(now, seen, updated_mixture(mixture, seen, scene)))
    again = {each.step: each.seen for each in kept if each.step >= first}
    for step in sorted({*again, *arrived, now}):
        seen = _joined(again.get(step), arrived.get(step), scene)
        last = before[-1]
        mixture = predicted_mixture(last.mixture, scene, last.step * scene.dt, step - last.step)
        before = (*before, Kept(step, seen, updated_mixture(mixture, seen, scene)))
    return before


def _joined(first: Evidence | None, second: Evidence | None, scene: Scene) -> Evidence:
    if first is None or second is None or not first.ids or not second.ids:
        return next((each for each in (first, second) if each is not None and each.ids), _nothing(scene))
    return Evidence(
        first.ids + second.ids,
        np.concatenate([first.readings, second.readings]),
        np.concatenate([first.positions, second.positions]),
        np.concatenate([first.traits, second.traits]),
    )


def _nothing(scene: Scene) -> Evidence:
    return Evidence((), np.zeros(0), scene.positions[:0], scene.traits[:0])


def filter_cycles(kept: tuple[Kept, ...], arrived: Mapping[int, Evidence], scene: Scene) -> float:
    """Operations of the predictions and updates of this step, repeated ones included."""
    first = min(arrived, default=scene.step)
    cycles = 0.0 if first >= scene.step else PREDICTION_CYCLES * len(kept[-1].mixture)  # the plan was judged by another
    for each in kept:
        if each.step >= first:
            cycles += len(each.mixture) * (PREDICTION_CYCLES + READING_CYCLES * len(each.seen.ids))
    return cycles
