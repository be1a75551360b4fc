"""Fixtures of all tests: a cache for compiled kernels, one thread per numerical library, random rows."""

from __future__ import annotations

import contextlib
import gc
import os
import secrets
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from tests.helpers.costs import APART, count_examples, excess, shared_by_all_tests, spent, start_counting
from tests.helpers.kernel_cache import kernel_cache
from tests.helpers.recordings import FOLDER as RECORDINGS
from tests.helpers.thorough import THOROUGH, keep_fast_cases
from wsnsim.base.tables import columns_of

_NAME = os.environ.get("PYTEST_XDIST_WORKER", "")
_WORKER = bool(_NAME)
if not _WORKER:  # the workers of one session share its cache and its recordings
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_cache(Path(__file__).parents[1], Path(sys.prefix)))
    os.environ[RECORDINGS] = tempfile.mkdtemp(prefix="wsnsim-recordings-")
for _library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_library, "1")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background of a shell; processes inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Hypothesis also tries constants of the modules that happen to be loaded: other examples in another order of tests.
providers.is_local_module_file = lambda _: False
settings.register_profile("wsnsim", deadline=None, database=None, derandomize=True, max_examples=20)
settings.register_profile("thorough", deadline=None, database=None, max_examples=100, print_blob=True)
settings.load_profile("thorough" if THOROUGH else "wsnsim")

_spent: pytest.StashKey[Counter[str]] = pytest.StashKey()

STATES = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
Rows = dict[str, np.ndarray]


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let every other worker read the modules backwards: what one has rewritten and compiled is there for the other."""
    report = yield
    if isinstance(collector, pytest.Directory) and _NAME[2:].isdigit() and int(_NAME[2:]) % 2:
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Choose the seed of random examples: one for all workers. Hypothesis reads the option afterwards."""
    if THOROUGH and config.getoption("--hypothesis-seed") is None:
        config.option.hypothesis_seed = str(secrets.randbelow(10**9))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how to repeat the random examples."""
    if THOROUGH:
        seed = config.getoption("--hypothesis-seed")
        terminalreporter.write_line(f"random examples: make thorough ARGS=--hypothesis-seed={seed} repeats them")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """All workers have the same order, that of the paths; some cases of a thorough test may be fast."""
    items.sort(key=lambda item: item.path.parts)
    unknown = keep_fast_cases(items)
    if unknown and not any("::" in argument for argument in config.args):
        raise pytest.UsageError(f"the mark thorough names cases that do not exist: {', '.join(sorted(unknown))}")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Remember what has been spent before the test."""
    item.stash[_spent] = spent()
    if isinstance(item, pytest.Function):
        count_examples(item.obj)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
    """What a fixture makes for several tests counts for none of them: which one comes first depends on the worker."""
    with contextlib.nullcontext() if fixturedef.scope == "function" else shared_by_all_tests():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None]:
    """Fail a test of the fast tier that costs more than it may."""
    yield
    if _in_fast_tier(item) and (above := excess(item.stash[_spent])):
        pytest.fail(
            f"costs too much for the fast tier: {', '.join(above)}; make it smaller or mark it @pytest.mark.thorough",
            pytrace=False,
        )


def pytest_collection_finish() -> None:
    """What was imported lives as long as the session, and figures have a quarter of their pixels."""
    gc.freeze()
    start_counting()
    if (style := sys.modules.get("wsnsim.analysis.figure_style")) is not None:
        style.STYLE["savefig.dpi"] = 75


def pytest_unconfigure() -> None:
    """Remove the recordings, and a temporary cache of compiled kernels."""
    if _WORKER:
        return
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    if not folder.is_relative_to(sys.prefix):
        shutil.rmtree(folder, ignore_errors=True)
    shutil.rmtree(os.environ[RECORDINGS], ignore_errors=True)


def _in_fast_tier(item: pytest.Item) -> bool:
    """Whether this test belongs to the fast tier of this run."""
    folder = item.path.relative_to(Path(__file__).parent).parts[0]
    return not THOROUGH and folder not in APART and item.get_closest_marker("thorough") is None


@pytest.fixture
def fresh_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the working directory of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def states() -> tuple[tuple[str, str], ...]:
    """(name, unit) of the state columns of a target that moves in the plane."""
    return STATES


@pytest.fixture
def rows_of() -> Callable[..., Rows]:
    """rows_of(table, count, seed=0): random rows that the table can hold."""
    return random_rows


def random_rows(table: str, count: int, seed: int = 0) -> Rows:
    """Random values of each column's type; categories within their meanings."""
    rng = np.random.default_rng(seed)
    return {
        column.name: rng.integers(0, len(column.meanings) or 200, count).astype(column.dtype)
        if np.dtype(column.dtype).kind in "iu"
        else rng.normal(0.0, 100.0, count)
        for column in columns_of(table, STATES)
    }
