"""Looking ahead: what a head makes of its belief for those who are to sense the target next, and tells them.

look_ahead(stage, track, head, belief, scene) -> Waking or None      predicted(stage, track, belief, scene) -> (2,)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats, planar
from wsnsim.base.ports import Foresees, Portable, Scene
from wsnsim.base.sleeping import Point, WakeUpPlan
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_up_service import WakeUpRound
from wsnsim.network.run_context import RunContext


def look_ahead(
    stage: RunContext, track: Track, head: int, belief: Any, scene: Scene, fixed_at: float | None = None
) -> WakeUpRound | None:
    """Wake nodes for the next step, if the scenario has a way to; nobody waits for it. None where it has none.

    `fixed_at`: when the target was last sensed; left out: at the scene's time.
    """
    waker = stage.waker
    if waker is None or stage.step >= stage.parts.steps:
        return None
    waker.sequence += 1
    plan = _plan(stage, track, head, belief, scene, scene.time if fixed_at is None else fixed_at, waker.sequence)
    message = stage.parts.wakeup.compose(plan, belief if stage.parts.wakeup.carries_belief else None)
    return waker.start(track, head, message, plan.foreseen)


def predicted(stage: RunContext, track: Track, belief: Any, scene: Scene) -> Floats:
    """(2,) where the target is expected at the next step."""
    parts = stage.parts
    forecast = parts.tracker.forecast(belief, scene, stage.step - scene.step + 1)
    return planar(forecast.mean[list(parts.filter_motions[track.target].position)])


def _plan(
    stage: RunContext, track: Track, head: int, belief: Any, scene: Scene, fixed_at: float, sequence: int
) -> WakeUpPlan:
    parts, target = stage.parts, track.target
    motion = parts.filter_motions[target]
    mean = parts.tracker.estimate(belief).mean
    due = (stage.step + 1) * parts.dt
    foreseen = parts.tracker.foresees(belief) if isinstance(parts.tracker, Foresees) else True
    return WakeUpPlan(
        target=target,
        step=stage.step + 1,
        sequence=sequence,
        sender=head,
        place=(stage.fleet.x[head], stage.fleet.y[head]),
        fix=_point(planar(mean[list(motion.position)])),
        heading=_heading(mean, motion.columns),
        prediction=_point(predicted(stage, track, belief, scene)),
        foreseen=foreseen,
        due=due,
        ahead=due - fixed_at,
        sensing=parts.sensor.reach,
        reach=stage.fleet.reach,
        payload_bits=parts.tracker.belief_bits(belief) if isinstance(parts.tracker, Portable) else 0,
    )


def _heading(mean: Floats, columns: tuple[str, ...]) -> Point:
    """Where the target is going, as its velocity; (0, 0) where the state has none."""
    if "vx" not in columns or "vy" not in columns:
        return 0.0, 0.0
    return _point(mean[[columns.index("vx"), columns.index("vy")]])


def _point(values: Floats) -> Point:
    x, y = np.asarray(values, dtype=np.float64).tolist()
    return x, y
