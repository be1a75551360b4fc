"""Which nodes sense and listen when."""

from __future__ import annotations

from typing import ClassVar

from wsnsim.base.part import part


@part
class EventWake:
    """A dormant node keeps sensor and receiver on: the target or a frame wakes it (Jiang, Song, Lin 2013, 2.3)."""

    always_listening: ClassVar[bool] = True
