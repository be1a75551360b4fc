"""A simulated result for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.recordings import recording


@pytest.fixture(scope="session")
def real() -> Path:
    """A result of two short runs, in which nodes wake, join, sense, send, hand over and sleep."""
    return recording("pso_mhpf")
