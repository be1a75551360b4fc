"""The Python files of the papers and studies that come with wsnsim."""

from __future__ import annotations

from types import ModuleType

from wsnsim.papers.study import study


def module(name: str, file: str = "study") -> ModuleType:
    """A Python file of a paper or study: module('frontier', 'settings')."""
    return study(name).code.module(file)
