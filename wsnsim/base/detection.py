"""What the errors of detection leave unchanged."""

from __future__ import annotations

import numpy as np

from wsnsim.base.ports import Detection


def is_perfect(detection: Detection) -> bool:
    """Whether all readings are reported as they are taken."""
    probe = np.ones(1)
    return detection.missed == detection.false_alarm == 0 and (
        detection.distort(probe, np.zeros(1, dtype=np.uint64)) is probe
    )
