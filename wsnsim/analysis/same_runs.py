"""Points of a campaign that gave the same runs: what they differ in has no effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from wsnsim.analysis import campaigns
from wsnsim.analysis.baselines import label
from wsnsim.base.tables import TABLES
from wsnsim.recording.folder import Folder, Manifest


def same_runs(folder: Folder, manifest: Manifest) -> str:
    """Which points differ in no column of `runs`, the processor time apart; '' if there are none.

    Fingerprints are among the columns: such points differ in no event and in no estimate.
    """
    runs = campaigns.read(folder.path, "runs")
    names = [column.name for column in TABLES["runs"] if column.name in runs and column.name != "cpu_seconds"]
    alike: dict[bytes, list[Mapping[str, Any]]] = {}
    for number, rows in runs.groupby(campaigns.POINT, sort=True):
        content = pd.util.hash_pandas_object(rows[names], index=False).to_numpy().tobytes()
        settings = manifest.points[int(number)].settings
        alike.setdefault(content, []).append(settings)
    groups = [points for points in alike.values() if len(points) > 1]
    if not groups:
        return ""
    differ = [key for key in manifest.keys if any(len({repr(one.get(key)) for one in group}) > 1 for group in groups)]
    shown = [" | ".join(label(one.get(key, "-") for key in manifest.keys) for one in group) for group in groups]
    return f"the same runs, so that {' and '.join(differ)} had no effect there: {'; '.join(shown)}"
