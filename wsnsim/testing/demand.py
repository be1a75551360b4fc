"""A demand of a contract check: whatever fails inside it raises an AssertionError that names the demand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def demand(name: str) -> Iterator[None]:
    """Turn every exception into an AssertionError that names the demand."""
    try:
        yield
    except AssertionError as reason:
        raise AssertionError(f"demand '{name}': {reason}") from reason
    except Exception as reason:
        raise AssertionError(f"demand '{name}': {type(reason).__name__} was raised: {reason}") from reason
