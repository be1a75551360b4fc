"""Campaigns on disk without a simulation, and comparisons of their files and tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

import wsnsim
from wsnsim import __version__
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk


def bare_campaign(path: Path, replicates: Mapping[str, int], block: int = 5, **more: Any) -> Folder:
    """A campaign's folder that holds only a manifest."""
    folder = Folder(path)
    points = tuple(PointOnDisk(name, {"key": name}, "w", count) for name, count in replicates.items())
    folder.write_manifest(Manifest("c", ("key",), points, block, __version__, **more))
    return folder


def files_of(path: Path) -> dict[str, tuple[int, bytes]]:
    """(modification time, content) of every result file of a campaign."""
    return {str(p.relative_to(path)): (p.stat().st_mtime_ns, p.read_bytes()) for p in path.glob("*/r*.h5")}


def tables_of(path: Path) -> dict[str, pd.DataFrame]:
    """The tables of a campaign without the measured CPU time."""
    return {name: wsnsim.read(path, name).drop(columns="cpu_seconds", errors="ignore") for name in ("runs", "tracks")}


def assert_same(one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]) -> None:
    """The tables are equal in every byte of every column."""
    for name in one:
        pd.testing.assert_frame_equal(one[name], other[name], check_exact=True)
        for column in one[name].select_dtypes("number"):
            assert one[name][column].to_numpy().tobytes() == other[name][column].to_numpy().tobytes()
