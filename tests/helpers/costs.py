"""What a test of the fast tier may cost, as counts: a clock would judge a busy machine, not the test.

A test that exceeds a limit is marked `thorough`, or made smaller; see `pytest_runtest_protocol` in `tests/conftest.py`.
"""

from __future__ import annotations

import functools
import multiprocessing.process
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

LIMITS: Final = {"node-steps": 250_000, "particle-steps": 100_000, "processes": 2, "examples": 50}
"""Nodes times steps of all simulated runs; particles times steps and runs; processes started; Hypothesis examples."""
APART: Final = ("documentation", "campaign_cluster", "browser")
"""Folders of tests that are targets of the Makefile of their own."""

_counts: Counter[str] = Counter()
_counted: set[Any] = set()


def excess(before: Counter[str]) -> list[str]:
    """What has been spent since `before` and is above its limit, in words."""
    costs = {name: _counts[name] - before[name] for name in LIMITS}
    return [f"{costs[name]:,} {name} (at most {most:,})" for name, most in LIMITS.items() if costs[name] > most]


def spent() -> Counter[str]:
    """What this process has spent until now."""
    return Counter(_counts)


@contextmanager
def shared_by_all_tests() -> Iterator[None]:
    """What is made here once for many tests counts for none of them."""
    before = spent()
    yield
    _counts.clear()
    _counts.update(before)


def start_counting() -> None:
    """Count runs and processes from now on."""
    from wsnsim.network.workload_world import WorkloadWorld
    from wsnsim.network.world import World
    from wsnsim.offline import batch
    from wsnsim.offline.offline_run import OfflineRun

    for world in (World, WorkloadWorld):
        _count_before(world, "run", lambda self, *_: _count_run(self._setup, len(self._nodes.positions)))
    _count_before(OfflineRun, "run", lambda self, *_: _count_run(self._setup, len(self._conditions.positions)))
    _count_before(batch, "_followed", lambda setup, number, conditions, *_: [
        _count_run(setup, len(each.positions)) for each in conditions if number == 0
    ])  # fmt: skip
    _count_before(subprocess.Popen, "__init__", _count_command)
    _count_before(multiprocessing.process.BaseProcess, "start", lambda *_: _counts.update(processes=1))


def count_examples(test: Any) -> None:
    """Count the examples of a test, if it is a property."""
    handle = getattr(test, "hypothesis", None)
    if handle is not None and handle.inner_test not in _counted:
        _count_before(handle, "inner_test", lambda *_: _counts.update(examples=1))
        _counted.add(handle.inner_test)


def _count_command(_: Any, command: Any = (), *__: Any) -> None:
    """Count a process, unless it is git, which takes milliseconds."""
    _counts["processes"] += not (isinstance(command, list) and command[0] == "git")


def _count_run(setup: Any, nodes: int) -> None:
    _counts["node-steps"] += nodes * setup.steps
    particles = getattr(getattr(setup, "tracker", None), "particles", 0)
    _counts["particle-steps"] += setup.steps * (particles if isinstance(particles, int) else 0)


def _count_before(owner: Any, name: str, count: Callable[..., Any]) -> None:
    """Call `count` with the positional arguments before each call of owner.name."""
    original = getattr(owner, name)

    @functools.wraps(original)
    def counted(*args: Any, **keywords: Any) -> Any:
        count(*args)
        return original(*args, **keywords)

    setattr(owner, name, counted)
