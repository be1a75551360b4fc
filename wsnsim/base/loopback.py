"""Former name of `wsnsim.offline.loopback`."""

from typing import Any

from wsnsim.base.deprecation import moved


def __getattr__(name: str) -> Any:
    return moved(__name__, name)
