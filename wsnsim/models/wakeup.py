"""How nodes ahead of the target are woken."""

from __future__ import annotations

from typing import ClassVar

from wsnsim.base.part import part


@part
class NoWakeUp:
    """Nobody is woken ahead of the target: event-wake nodes need no warning (Jiang, Song, Lin 2013)."""

    mechanism: ClassVar[str] = "none"
