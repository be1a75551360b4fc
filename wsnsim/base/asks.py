"""Former name of `wsnsim.base.requests`."""

from typing import Any

from wsnsim.base.deprecation import moved


def __getattr__(name: str) -> Any:
    return moved(__name__, name)
