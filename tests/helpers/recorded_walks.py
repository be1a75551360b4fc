"""Files of readings that are simulated from a known law, for tests of what is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

NODES = 8
HEIGHT = 1.8


@dataclass(frozen=True)
class Walks:
    """Readings of walks: z = -60 - 17 log10 d + gain + process + noise, or z0 + d + ... with the law `range`."""

    law: str = "rssi"
    z0: float = -60.0
    eta: float = 1.7
    sd: float = 4.0
    shadowing: float = 2.5
    decorrelation: float = 1.0
    dof: float = np.inf
    tracks: int = 4
    seconds: float = 60.0
    dt: float = 0.5
    speed: float = 0.5

    @property
    def total(self) -> float:
        """The standard deviation of all noise."""
        return float(np.hypot(self.sd, self.shadowing))

    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (S, 3) and gains (S,), which have the sum 0."""
        rng = np.random.default_rng(5)
        places = np.column_stack([rng.uniform(0.0, 20.0, (NODES, 2)), rng.uniform(1.0, 2.5, NODES)])
        gains = rng.normal(0.0, 3.0, NODES)
        return places, gains - gains.mean()

    def walk(self, rng: np.random.Generator) -> np.ndarray:
        """(n, 3) places, along straight legs between random points."""
        steps = int(self.seconds / self.dt)
        corners = rng.uniform(0.0, 20.0, (40, 2))
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        now = np.arange(steps) * self.dt * self.speed
        return np.column_stack([*(np.interp(now, lengths, axis) for axis in corners.T), np.full(steps, HEIGHT)])

    def write(self, folder: Path, seed: int) -> tuple[list[str], str]:
        """The files of the tracks, and that of the nodes."""
        rng = np.random.default_rng(seed)
        places, gains = self.nodes()
        rows = [f"n{i},{x:.3f},{y:.3f},{z:.3f}" for i, (x, y, z) in enumerate(places)]
        (folder / "nodes.csv").write_text("\n".join(["id,x,y,z", *rows]) + "\n")
        files = []
        for track in range(self.tracks):
            file = folder / f"track{track}.csv"
            points = self.walk(rng)
            rows = self._rows(points, self.readings(rng, points, places.round(3), gains))
            file.write_text("\n".join(["time,node,reading,x,y,z", *rows]) + "\n")
            files.append(str(file))
        return files, str(folder / "nodes.csv")

    def readings(
        self, rng: np.random.Generator, points: np.ndarray, places: np.ndarray, gains: np.ndarray
    ) -> np.ndarray:
        """(steps, nodes) readings of a target at these points (steps, 3)."""
        distances = np.sqrt(((points[:, None] - places) ** 2).sum(axis=2))
        process = np.empty(distances.shape)
        process[0] = rng.normal(0.0, self.shadowing, len(places))
        along = np.exp(-np.hypot(*np.diff(points[:, :2], axis=0).T) / self.decorrelation)
        for k, rho in enumerate(along, start=1):
            process[k] = rho * process[k - 1] + np.sqrt(1 - rho**2) * rng.normal(0.0, self.shadowing, len(places))
        shape = distances.shape
        unit = rng.standard_normal(shape) if np.isinf(self.dof) else rng.standard_t(self.dof, shape)
        scale = 1.0 if np.isinf(self.dof) else np.sqrt((self.dof - 2) / self.dof)
        expected = distances if self.law == "range" else -10 * self.eta * np.log10(distances)
        return self.z0 + expected + gains + process + self.sd * scale * unit

    def _rows(self, points: np.ndarray, readings: np.ndarray) -> list[str]:
        return [
            f"{k * self.dt + i * 0.001:.3f},n{i},{readings[k, i]:.4f},{x:.5f},{y:.5f},{z:.3f}"
            for k, (x, y, z) in enumerate(points)
            for i in range(readings.shape[1])
        ]
