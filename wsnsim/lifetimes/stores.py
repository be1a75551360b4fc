"""The energy stores of a network's nodes over years."""

from __future__ import annotations

import dataclasses

import numpy as np

from wsnsim.base.arrays import Bools, Floats


@dataclasses.dataclass(frozen=True)
class Stores:
    """Linear batteries.

    Attributes:
        joules: (N,) initial energy in J; infinite for mains.
        alive: (N,) which nodes live at the start.
    """

    joules: Floats
    alive: Bools

    def full(self, paths: int) -> dict[str, Floats]:
        """The states (R, N) at the start."""
        return {"left": np.repeat(self.joules[None], paths, axis=0)}

    def least_life(self, watts: Floats) -> float:
        """The shortest life (s) of a node at constant power (N,) in W."""
        return float((self.joules / np.maximum(watts, 1e-300)).min())

    def advance(
        self, state: dict[str, Floats], alive: Bools, watts: Floats, seconds: Floats
    ) -> tuple[dict[str, Floats], Bools, Floats]:
        """The states after some seconds of constant power, who is alive then, and after how many seconds that changed."""
        left = state["left"]
        spent = watts * seconds
        after = np.where(alive, left - spent, left)
        dead = alive & (after <= 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            when = np.where(dead, left / watts, 0.0)
        return {"left": np.where(dead, 0.0, after)}, alive & ~dead, when
