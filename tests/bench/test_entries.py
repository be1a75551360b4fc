"""The table of kernels that the benchmark measures. This is tested; what it measures never is."""

from __future__ import annotations

import importlib
import pkgutil

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import wsnsim.kernels
from tests.bench.entries import ENTRIES
from tests.bench.ratios import check_agreement


def kernels_of(name: str) -> set[str]:
    """The compiled functions of a file of kernels that Python may call."""
    module = importlib.import_module(f"wsnsim.kernels.{name}")
    mine = {key: value for key, value in vars(module).items() if isinstance(value, Dispatcher)}
    return {
        f"{name}.{key}"
        for key, value in mine.items()
        if value.py_func.__module__ == module.__name__ and not value.targetoptions.get("no_cpython_wrapper")
    }


def test_every_kernel_is_a_line_of_the_table() -> None:
    files = [found.name for found in pkgutil.iter_modules(wsnsim.kernels.__path__)]
    assert set().union(*map(kernels_of, files)) == {entry.kernel for entry in ENTRIES}


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.kernel)
def test_a_line_names_a_twin_and_gives_it_the_same_arguments_each_time(entry) -> None:
    assert callable(entry.load_twin())
    for first, again in zip(entry.arguments(8), entry.arguments(8), strict=True):
        assert np.array_equal(first, again)


@pytest.mark.thorough(fast=["elementary.particle_keys"])
@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.kernel)
def test_a_kernel_and_its_twin_agree_on_the_arguments_of_the_benchmark(entry) -> None:
    check_agreement(entry, entry.load(), entry.load_twin(), entry.arguments(entry.sizes[0]))
