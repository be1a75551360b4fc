"""The time in which kernels are compiled: it is counted, announced once, and no part of a run."""

import time

import pytest
from numba.core import event

import wsnsim
from wsnsim import experiment
from wsnsim.base.runs import Progress
from wsnsim.models.compilation import announced, compilation_seconds, time_without_compilation


def spend(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def compiled(seconds, calls=0):
    """What Numba does to compile a kernel that calls others which are not compiled either."""
    with event.trigger_event("numba:compile"):
        spend(seconds)
        for _ in range(calls):
            compiled(seconds)


def test_the_time_of_compilation_counts_once_though_kernels_call_kernels():
    before, began = compilation_seconds(), time.process_time()
    compiled(0.01, calls=2)
    taken, counted = time.process_time() - began, compilation_seconds() - before
    assert 0.03 <= counted <= taken


def test_a_compilation_that_fails_ends_too():
    with pytest.raises(ZeroDivisionError), event.trigger_event("numba:compile"):
        raise ZeroDivisionError
    before = compilation_seconds()
    spend(0.01)
    assert compilation_seconds() == before
    compiled(0.01)
    assert compilation_seconds() >= before + 0.01


def test_the_clock_stands_while_kernels_are_compiled():
    before, began = time_without_compilation(), time.process_time()
    compiled(0.05)
    assert time_without_compilation() - before <= time.process_time() - began - 0.05


def test_the_first_compilation_is_announced_and_only_while_somebody_wants_to_know():
    calls = []
    with announced(lambda: calls.append("compiling")):
        assert calls == []
        compiled(0.0, calls=1)
        compiled(0.0)
    compiled(0.0)
    assert calls == ["compiling"]


@pytest.mark.thorough
def test_a_run_counts_and_announces_what_it_compiles_and_leaves_it_out_of_its_cpu_time(tmp_path):
    said, seen = [], []

    def compile_something(progress: Progress) -> None:
        seen.append(progress)
        if len(seen) == 1:  # kernels may have been compiled before, where the cache is empty
            compiled(0.3)

    out = tmp_path / "x.h5"
    scenario = wsnsim.load("pso_mhpf", ["duration=0.08 s"])
    began = time.process_time()
    report = experiment.run(
        scenario, replicates=1, out=out, progress=compile_something, on_compile=lambda: said.append("compiling")
    )
    taken = time.process_time() - began
    assert said == ["compiling"] and report.compiled >= 0.3
    assert 0.0 < report.summaries[0].run["cpu_seconds"] <= taken - report.compiled
    assert 0.0 < seen[0].overhead <= seen[-1].overhead - 0.3 and seen[-1].overhead < seen[-1].wall
    assert (seen[0].left, seen[-1].left) == (None, 0.0)
