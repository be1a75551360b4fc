"""A demand of a contract check: whatever fails inside it raises an AssertionError that names the demand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from wsnsim.base.border import checked
from wsnsim.base.errors import PluginAnswerError

Component = TypeVar("Component")


@contextmanager
def demand(name: str) -> Iterator[None]:
    """Turn every exception into an AssertionError that names the demand."""
    try:
        yield
    except (AssertionError, PluginAnswerError) as reason:
        raise AssertionError(f"demand '{name}': {reason}") from reason
    except Exception as reason:
        raise AssertionError(f"demand '{name}': {type(reason).__name__} was raised: {reason}") from reason


def examined(component: Component, port: type, columns: int | None = None) -> Component:
    """The component, whose answers are checked from now on as those of plug-ins are in every run."""
    with demand("answers"):
        return checked(component, port, columns)
