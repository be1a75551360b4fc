"""Scenes: what a cluster head knows at a step without asking."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wsnsim.base.arrays import Floats
from wsnsim.base.network_ports import Field
from wsnsim.base.ports import Scene


def make_scene(
    step: int, ids: Sequence[int], positions: Floats, traits: Floats, motion: Any, sensor: Any, **changes: Any
) -> Scene:
    """Return the scene of one step of 1 s: the first of `ids` is the head, all sense, nobody joined or left.

    `changes` replace fields of the scene; `time` follows from `dt` if it is not among them.
    """
    dt = changes.get("dt", 1.0)
    fields = {
        "time": dt * step, "step": step, "steps": 1, "dt": dt, "target": 0, "head": next(iter(ids), -1),
        "ids": tuple(ids), "positions": positions, "traits": traits, "roster": tuple(ids), "joined": (), "left": (),
        "field": Field(400.0, 400.0), "motion": motion, "sensor": sensor, "key": step,
    }  # fmt: skip
    return Scene(**fields | changes)
