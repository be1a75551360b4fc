"""Scenarios of this folder name components without behaviour, which the border of plug-ins would refuse."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="package")
def _without_border() -> Iterator[None]:
    """Let components answer as they like: `tests/base/test_border.py` tests what is refused."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wsnsim.base.border.checked_setup", lambda setup: setup)
        yield
