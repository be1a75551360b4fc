"""A working folder with a misbehaving tracker for tests of campaigns."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from .moody_tracker import write_moody_tracker


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, in which workers find the tracker."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(os, "environ", os.environ.copy())
    monkeypatch.setitem(os.environ, "PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "moody", raising=False)
    return write_moody_tracker(tmp_path)
