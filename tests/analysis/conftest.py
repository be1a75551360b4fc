"""A real run that the tests of this folder draw."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.recordings import recording


@pytest.fixture(scope="session")
def real() -> Path:
    """A network in which nodes wake, join, sense, send, hand over and sleep."""
    return recording("pso_mhpf")
