"""Where every test of campaigns is: a folder of its own with a misbehaving tracker in it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from .moody_tracker import write_moody_tracker


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder, which is the current one; workers find the tracker in it."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(os, "environ", os.environ.copy())
    monkeypatch.setitem(os.environ, "PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "moody", raising=False)
    return write_moody_tracker(tmp_path)
