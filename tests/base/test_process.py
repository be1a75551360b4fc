"""What the garbage collector looks at during a run, and what a run leaves behind."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator

import pytest

from wsnsim.base import process
from wsnsim.base.process import NEW_OBJECTS, gc_disabled, gc_frozen


class Circle:
    """An object that refers to itself: only a collection frees it."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Begin with nothing frozen, and leave the collector as it was: the suite freezes what it has imported."""
    frozen = gc.get_freeze_count()
    gc.unfreeze()
    yield
    gc.unfreeze()
    gc.enable()
    if frozen:
        gc.freeze()


def left() -> weakref.ref[Circle]:
    """A circle that nobody else refers to."""
    return weakref.ref(Circle())


@pytest.mark.thorough
def test_what_was_there_is_frozen_inside_and_what_is_left_freed_at_the_end() -> None:
    thresholds = gc.get_threshold()
    with gc_frozen():
        assert gc.get_freeze_count() > 1000 and gc.get_threshold()[0] == NEW_OBJECTS
        own = left()
        with gc_frozen():
            inner = left()
        assert gc.get_freeze_count() > 1000, "the outer one is not over"
    assert own() is None and inner() is None
    assert gc.get_freeze_count() == 0 and gc.get_threshold() == thresholds


def test_an_error_inside_gives_back_what_was_frozen() -> None:
    with pytest.raises(KeyError), gc_frozen():
        raise KeyError
    assert gc.get_freeze_count() == 0


@pytest.mark.thorough
@pytest.mark.parametrize("everything_after", [1, 10**9])
def test_older_garbage_is_looked_for_now_and_then(everything_after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "EVERYTHING_AFTER", everything_after)
    older = left()
    with gc_frozen():
        pass
    assert (older() is None) == (everything_after == 1)
    gc.collect()
    assert older() is None


def test_a_collector_that_is_off_stays_alone() -> None:
    gc.disable()
    with gc_frozen():
        assert gc.get_freeze_count() == 0
        own = left()
    assert own() is not None
    gc.enable()


@pytest.mark.thorough
def test_what_the_caller_froze_stays_frozen() -> None:
    gc.freeze()
    count = gc.get_freeze_count()
    with gc_frozen():
        own = left()
    assert gc.get_freeze_count() >= 0.9 * count and own() is not None


@pytest.mark.thorough
@pytest.mark.parametrize("was_on", [True, False])
def test_what_is_put_off_goes_on_afterwards_as_it_was_even_after_an_error(was_on: bool) -> None:
    (gc.enable if was_on else gc.disable)()
    with pytest.raises(KeyError), gc_disabled():
        assert not gc.isenabled()
        raise KeyError
    assert gc.isenabled() == was_on
